//! The service of one connection, in front of the router: it tells the connection's slot when a request begins, progresses
//! and ends, and tells the request its peer address.

use std::convert::Infallible;
use std::net::IpAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};

use axum::Router;
use axum::body::Body;
use axum::http::{Request, Response};
use bytes::Bytes;
use hyper::body::{Body as _, Frame, Incoming, SizeHint};
use hyper::service::Service;
use tower::Service as _;

use super::client::Peer;
use super::connection_limiter::{ConnectionSlot, OpenBody, OpenRequest};

/// The router as the hyper service of one connection.
pub(super) struct ConnectionService {
    router: Router,
    slot: Arc<ConnectionSlot>,
    peer: IpAddr,
}

impl ConnectionService {
    /// Serves the connection that holds this slot and comes from this address.
    pub(super) fn new(router: Router, slot: Arc<ConnectionSlot>, peer: IpAddr) -> Self {
        Self { router, slot, peer }
    }
}

impl Service<Request<Incoming>> for ConnectionService {
    type Response = Response<GuardedBody<Body, OpenRequest>>;
    type Error = Infallible;
    type Future = Pin<Box<dyn Future<Output = Result<Self::Response, Infallible>> + Send>>;

    fn call(&self, mut request: Request<Incoming>) -> Self::Future {
        let open = self.slot.begin_request();
        request.extensions_mut().insert(Peer(self.peer));
        if let Some(limit) = self.slot.exceeded_limit() {
            request.extensions_mut().insert(limit);
        }
        let body = (!request.body().is_end_stream()).then(|| self.slot.begin_body());
        let request = request.map(|incoming| match body {
            Some(open) => Body::new(GuardedBody { inner: incoming, guard: Some(open) }),
            None => Body::new(incoming),
        });
        // A router is always ready.
        let response = self.router.clone().call(request);
        Box::pin(async move { Ok(response.await?.map(|body| GuardedBody { inner: body, guard: Some(open) })) })
    }
}

/// A guard that a body holds until its end.
pub(super) trait BodyGuard: Unpin {
    /// Records the arrival of a chunk.
    fn progress(&self) {}
}

impl BodyGuard for OpenRequest {}

impl BodyGuard for OpenBody {
    fn progress(&self) {
        Self::progress(self);
    }
}

/// A body that drops its guard at its end.
pub(super) struct GuardedBody<B, G> {
    inner: B,
    guard: Option<G>,
}

impl<B: hyper::body::Body<Data = Bytes> + Unpin, G: BodyGuard> hyper::body::Body for GuardedBody<B, G> {
    type Data = Bytes;
    type Error = B::Error;

    fn poll_frame(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, B::Error>>> {
        let frame = ready!(Pin::new(&mut self.inner).poll_frame(cx));
        match (&frame, &self.guard) {
            (Some(Ok(_)), Some(guard)) => guard.progress(),
            _ => self.guard = None,
        }
        Poll::Ready(frame)
    }

    fn is_end_stream(&self) -> bool {
        self.inner.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.inner.size_hint()
    }
}

//! What a connection's requests go through before the router: the connection's place learns when a request begins and
//! ends and whether its body comes, and the request learns who is at the other end.

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
use super::places::{OpenBody, OpenRequest, Seat};

/// The router, for one connection.
pub(super) struct Seated {
    router: Router,
    seat: Arc<Seat>,
    peer: IpAddr,
}

impl Seated {
    /// Serves the connection that has this place and comes from this address.
    pub(super) fn new(router: Router, seat: Arc<Seat>, peer: IpAddr) -> Self {
        Self { router, seat, peer }
    }
}

impl Service<Request<Incoming>> for Seated {
    type Response = Response<Held<Body, OpenRequest>>;
    type Error = Infallible;
    type Future = Pin<Box<dyn Future<Output = Result<Self::Response, Infallible>> + Send>>;

    fn call(&self, mut request: Request<Incoming>) -> Self::Future {
        let open = self.seat.request();
        request.extensions_mut().insert(Peer(self.peer));
        if let Some(full) = self.seat.full() {
            request.extensions_mut().insert(full);
        }
        let body = (!request.body().is_end_stream()).then(|| self.seat.body());
        let request = request.map(|incoming| match body {
            Some(open) => Body::new(Held { inner: incoming, held: Some(open) }),
            None => Body::new(incoming),
        });
        // A router is ready at all times.
        let answer = self.router.clone().call(request);
        Box::pin(async move { Ok(answer.await?.map(|body| Held { inner: body, held: Some(open) })) })
    }
}

/// What a body holds until its end.
pub(super) trait Hold: Unpin {
    /// A piece came.
    fn progress(&self) {}
}

impl Hold for OpenRequest {}

impl Hold for OpenBody {
    fn progress(&self) {
        Self::progress(self);
    }
}

/// A body that holds something until its end.
pub(super) struct Held<B, H> {
    inner: B,
    held: Option<H>,
}

impl<B: hyper::body::Body<Data = Bytes> + Unpin, H: Hold> hyper::body::Body for Held<B, H> {
    type Data = Bytes;
    type Error = B::Error;

    fn poll_frame(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, B::Error>>> {
        let frame = ready!(Pin::new(&mut self.inner).poll_frame(cx));
        match (&frame, &self.held) {
            (Some(Ok(_)), Some(held)) => held.progress(),
            _ => self.held = None,
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

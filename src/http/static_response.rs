//! Responses that never change while the process runs: compressed once, when the program is built or on first use.

use std::io::{self, Read, Write};

use axum::body::Bytes;
use axum::http::header::{CONTENT_ENCODING, CONTENT_TYPE, ETAG, VARY};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use sha2::{Digest, Sha256};

use super::extract::etag_matches;
use super::layers::weaken;
use super::negotiate::accepts_gzip;

/// A body, plain and compressed, with its entity tag.
pub(super) struct StaticResponse {
    bytes: Bytes,
    gzip: Option<Bytes>,
    etag: String,
    media_type: String,
}

impl StaticResponse {
    /// Compresses `bytes` if that makes them smaller.
    pub(super) fn new(bytes: impl Into<Bytes>, media_type: String) -> Self {
        let bytes = bytes.into();
        let gzip = compress(&bytes).ok().map(Bytes::from);
        Self::of(bytes, gzip, media_type)
    }

    /// Response of bytes that were compressed before.
    ///
    /// # Errors
    /// [`io::Error`] if they are not a gzip stream.
    pub(super) fn of_gzip(gzip: &'static [u8], media_type: String) -> io::Result<Self> {
        let mut bytes = Vec::new();
        GzDecoder::new(gzip).read_to_end(&mut bytes)?;
        Ok(Self::of(bytes.into(), Some(Bytes::from_static(gzip)), media_type))
    }

    fn of(bytes: Bytes, gzip: Option<Bytes>, media_type: String) -> Self {
        let gzip = gzip.filter(|gzip| gzip.len() < bytes.len());
        let etag = format!("\"{}\"", crate::wire::hex(&Sha256::digest(&bytes)));
        Self { bytes, gzip, etag, media_type }
    }

    /// Builds the response, compressed if the client accepts that.
    pub(super) fn respond(&self, headers: &HeaderMap) -> Response {
        let gzip = self.gzip.as_ref().filter(|_| accepts_gzip(headers));
        let version = [(ETAG, self.etag.clone()), (VARY, "accept-encoding".to_owned())];
        let mut response = if etag_matches(headers, &self.etag) {
            (StatusCode::NOT_MODIFIED, version).into_response()
        } else {
            let media_type = [(CONTENT_TYPE, self.media_type.clone())];
            match gzip {
                Some(gzip) => (version, media_type, [(CONTENT_ENCODING, "gzip")], gzip.clone()).into_response(),
                None => (version, media_type, self.bytes.clone()).into_response(),
            }
        };
        if gzip.is_some() {
            weaken(response.headers_mut());
        }
        response
    }
}

fn compress(bytes: &[u8]) -> io::Result<Vec<u8>> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes)?;
    encoder.finish()
}

/// Media type of an embedded file, by the ending of its name.
pub(super) fn media_type(name: &str) -> &'static str {
    match name.rsplit_once('.').map_or("", |(_, extension)| extension) {
        "html" => "text/html; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "js" => "text/javascript; charset=utf-8",
        "png" => "image/png",
        "svg" => "image/svg+xml",
        "txt" => "text/plain; charset=utf-8",
        _ => "application/octet-stream",
    }
}

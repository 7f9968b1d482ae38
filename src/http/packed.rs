//! Answers that are the same as long as the program runs: compressed once, when they are first asked for.

use std::io::{self, Write};

use axum::body::Bytes;
use axum::http::header::{CONTENT_ENCODING, CONTENT_TYPE, ETAG, VARY};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use flate2::Compression;
use flate2::write::GzEncoder;
use sha2::{Digest, Sha256};

use super::extract::is_known;
use super::negotiate::takes_gzip;

/// Bytes in both forms, and the tag of their content.
pub(super) struct Packed {
    bytes: Bytes,
    gzip: Option<Bytes>,
    etag: String,
    media_type: String,
}

impl Packed {
    /// Compresses `bytes`, where that makes them smaller.
    pub(super) fn new(bytes: impl Into<Bytes>, media_type: String) -> Self {
        let bytes = bytes.into();
        let gzip = compress(&bytes).ok().filter(|gzip| gzip.len() < bytes.len()).map(Bytes::from);
        let etag = format!("\"{}\"", crate::service::hex(&Sha256::digest(&bytes)));
        Self { bytes, gzip, etag, media_type }
    }

    /// The answer, in the form that the client takes.
    pub(super) fn answer(&self, headers: &HeaderMap) -> Response {
        let about = [(ETAG, self.etag.clone()), (VARY, "accept-encoding".to_owned())];
        if is_known(headers, &self.etag) {
            return (StatusCode::NOT_MODIFIED, about).into_response();
        }
        let about = (about, [(CONTENT_TYPE, self.media_type.clone())]);
        match &self.gzip {
            Some(gzip) if takes_gzip(headers) => {
                (about.0, about.1, [(CONTENT_ENCODING, HeaderValue::from_static("gzip"))], gzip.clone()).into_response()
            }
            _ => (about.0, about.1, self.bytes.clone()).into_response(),
        }
    }
}

fn compress(bytes: &[u8]) -> io::Result<Vec<u8>> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes)?;
    encoder.finish()
}

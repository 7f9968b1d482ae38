//! Keyset pagination of listings, newest first: the token holds the last id of the page and a digest of the listing's
//! filters, so that a token cannot be used for another listing.

use serde::Serialize;
use sha2::{Digest, Sha256};

use super::files::hex;
use crate::service::error::Error;

/// A page of a listing.
#[derive(Clone, Debug)]
pub(crate) struct Page {
    /// Max number of entries.
    pub size: u32,
    /// Upper bound of the ids, exclusive, compared as text; for the first page above every id.
    pub before: String,
    filters: String,
}

/// Text above every id.
const ABOVE_ALL_IDS: &str = "~";
const DIGEST_LENGTH: usize = 16;
/// Max size of a page's entries as JSON.
const MAX_PAGE_BYTES: usize = 4 << 20;

impl Page {
    /// A page of `size` entries at `token`, in the listing with these `filters`.
    pub(crate) fn new(size: u32, token: Option<&str>, filters: &str) -> Result<Self, Error> {
        let filters = hex(&Sha256::digest(filters))[..DIGEST_LENGTH].to_owned();
        let before = match token {
            None => ABOVE_ALL_IDS.to_owned(),
            Some(token) => match token.split_once('.') {
                Some((id, digest)) if digest == filters && id.parse::<uuid::fmt::Hyphenated>().is_ok() => id.to_owned(),
                _ => return Err(Error::BadPageToken),
            },
        };
        Ok(Self { size, before, filters })
    }

    /// Number of rows to query: one more than the page has, to know whether another page follows.
    pub(crate) fn limit(&self) -> i64 {
        i64::from(self.size) + 1
    }

    /// Truncates the rows to the page's size and to [`MAX_PAGE_BYTES`]; returns the token of the next page, if any.
    pub(crate) fn cut<T: Serialize>(&self, rows: &mut Vec<T>, id: impl Fn(&T) -> String) -> Result<Option<String>, Error> {
        let (mut bytes, mut length) = (0, 0);
        for row in rows.iter().take(self.size as usize) {
            bytes += serde_json::to_vec(row)?.len();
            if length > 0 && bytes > MAX_PAGE_BYTES {
                break;
            }
            length += 1;
        }
        if rows.len() <= length {
            return Ok(None);
        }
        rows.truncate(length);
        Ok(rows.last().map(|last| format!("{}.{}", id(last), self.filters)))
    }
}

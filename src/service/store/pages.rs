//! Pages of listings, newest first, by keyset: the token holds the last id of the page and a digest of the listing's
//! filters, so that a token cannot be used on another listing.

use serde::Serialize;
use sha2::{Digest, Sha256};

use super::files::hex;
use crate::service::error::Error;

/// Which page of a listing.
#[derive(Clone, Debug)]
pub(crate) struct Page {
    /// Entries at most.
    pub size: u32,
    /// Only entries with an id below this one; ids are compared as text. The highest text, for the first page.
    pub before: String,
    filters: String,
}

/// Above every id.
const FIRST: &str = "~";
const DIGEST_LENGTH: usize = 16;
/// JSON of the entries of one page.
const MAX_PAGE_BYTES: usize = 4 << 20;

impl Page {
    /// The page of `size` entries that `token` asks for, in the listing with these `filters`.
    pub(crate) fn new(size: u32, token: Option<&str>, filters: &str) -> Result<Self, Error> {
        let filters = hex(&Sha256::digest(filters))[..DIGEST_LENGTH].to_owned();
        let before = match token {
            None => FIRST.to_owned(),
            Some(token) => match token.split_once('.') {
                Some((id, digest)) if digest == filters && id.parse::<uuid::fmt::Hyphenated>().is_ok() => id.to_owned(),
                _ => return Err(Error::BadPageToken),
            },
        };
        Ok(Self { size, before, filters })
    }

    /// Rows to ask for: one more than the page has, to know whether another follows.
    pub(crate) fn limit(&self) -> i64 {
        i64::from(self.size) + 1
    }

    /// Cuts the page after its last entry, and before it takes more than [`MAX_PAGE_BYTES`]; makes the next page's token.
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

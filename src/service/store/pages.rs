//! Pages of listings, newest first, by keyset: the token holds the last id of the page and a digest of the listing's
//! filters, so that a token cannot be used on another listing.

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

    /// Cuts the extra row off and makes the next page's token.
    pub(crate) fn cut<T>(&self, rows: &mut Vec<T>, id: impl Fn(&T) -> String) -> Option<String> {
        if rows.len() <= self.size as usize {
            return None;
        }
        rows.truncate(self.size as usize);
        rows.last().map(|last| format!("{}.{}", id(last), self.filters))
    }
}

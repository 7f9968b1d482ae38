//! Keyset pagination of listings: the token holds the place of the last entry of the page, its id and the key that the listing
//! is sorted by, and a digest of the listing's filters and order, so that a token cannot be used for another listing.

use serde::Serialize;
use sha2::{Digest, Sha256};
use sqlx::Row;
use sqlx::sqlite::SqliteRow;

use crate::service::error::Error;
use crate::wire::hex;

/// A page of a listing.
#[derive(Clone, Debug)]
pub(crate) struct Page {
    /// Max number of entries.
    pub size: u32,
    /// Place of the last entry of the previous page.
    pub after: Option<Place>,
    filters: String,
}

/// Row of a listing: its place, and what is read of it, if it can be read.
pub(crate) type Entry<T> = (Place, Option<T>);

/// Entry of a row in a listing that is sorted by the column `id`; one that cannot be read is logged.
pub(crate) fn entry<T>(row: &SqliteRow, read: impl Fn(&SqliteRow) -> Result<T, Error>) -> Entry<T> {
    let place = Place::of_id(row.try_get::<String, _>("id").unwrap_or_default());
    let item = read(row).inspect_err(|error| {
        tracing::error!(id = place.id, error = error as &dyn std::error::Error, "a row is missing in a list: it cannot be read");
    });
    let item = item.ok();
    (place, item)
}

/// Place of an entry in a listing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Place {
    /// Key that the listing is sorted by; empty if it is sorted by id.
    pub key: String,
    /// Id of the entry.
    pub id: String,
}

impl Place {
    /// Place of an entry in a listing that is sorted by id.
    pub(crate) fn of_id(id: impl ToString) -> Self {
        Self { key: String::new(), id: id.to_string() }
    }

    /// Reads a token without its digest.
    fn read(id: &str, key: Option<&str>) -> Option<Self> {
        let id = match id.strip_prefix(UNREADABLE) {
            Some(hex) => text_of_hex(hex)?,
            None => id.parse::<uuid::fmt::Hyphenated>().map(|_| id.to_owned()).ok()?,
        };
        Some(Self { key: key.map_or_else(|| Some(String::new()), text_of_hex)?, id })
    }
}

/// Beginning of a token whose row has an invalid id; the page behind it is read all the same.
const UNREADABLE: char = 'x';
/// Text above every id.
const ABOVE_ALL_IDS: &str = "~";
const DIGEST_LENGTH: usize = 16;
/// Max size of a page's entries as JSON.
const MAX_PAGE_BYTES: usize = 4 << 20;

impl Page {
    /// A page of `size` entries at `token`, in the listing with these `filters`.
    pub(crate) fn new(size: u32, token: Option<&str>, filters: &str) -> Result<Self, Error> {
        let filters = hex(&Sha256::digest(filters))[..DIGEST_LENGTH].to_owned();
        let after = token.map(|token| {
            let mut parts = token.splitn(3, '.');
            let (id, digest, key) = (parts.next()?, parts.next()?, parts.next());
            if digest == filters { Place::read(id, key) } else { None }
        });
        match after {
            Some(None) => Err(Error::BadPageToken),
            after => Ok(Self { size, after: after.flatten(), filters }),
        }
    }

    /// Upper bound of the ids of a listing with the newest first, exclusive, compared as text; for the first page above every id.
    pub(crate) fn before(&self) -> &str {
        self.after.as_ref().map_or(ABOVE_ALL_IDS, |place| &place.id)
    }

    /// Number of rows to query: one more than the page has, to know whether another page follows.
    pub(crate) fn limit(&self) -> i64 {
        i64::from(self.size) + 1
    }

    /// The items of a page of at most [`MAX_PAGE_BYTES`], and the token of the next page, if any. Rows that cannot be read are left
    /// out, and the next page begins behind the last row, readable or not.
    pub(crate) fn cut<T: Serialize>(&self, rows: impl IntoIterator<Item = Entry<T>>) -> Result<(Vec<T>, Option<String>), Error> {
        let (mut items, mut bytes, mut last) = (Vec::new(), 0, None);
        for (number, (place, item)) in rows.into_iter().enumerate() {
            bytes += serde_json::to_vec(&item)?.len();
            if number == self.size as usize || (number > 0 && bytes > MAX_PAGE_BYTES) {
                return Ok((items, last.map(|place| self.token(&place))));
            }
            items.extend(item);
            last = Some(place);
        }
        Ok((items, None))
    }

    fn token(&self, place: &Place) -> String {
        let key = if place.key.is_empty() { String::new() } else { format!(".{}", hex(place.key.as_bytes())) };
        let is_id = place.id.parse::<uuid::fmt::Hyphenated>().is_ok();
        let id = if is_id { place.id.clone() } else { format!("{UNREADABLE}{}", hex(place.id.as_bytes())) };
        format!("{id}.{}{key}", self.filters)
    }
}

/// Text that [`hex`] wrote.
fn text_of_hex(hex: &str) -> Option<String> {
    let digits: Vec<u8> =
        hex.chars().map(|c| c.to_digit(16).and_then(|digit| u8::try_from(digit).ok())).collect::<Option<_>>()?;
    let (pairs, []) = digits.as_chunks::<2>() else { return None };
    String::from_utf8(pairs.iter().map(|[high, low]| 16 * high + low).collect()).ok()
}

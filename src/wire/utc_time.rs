//! Times that users write, in the one form that is compared.

use std::fmt;
use std::str::FromStr;
use std::time::{SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

const MS_PER_SEC: i64 = 1000;
const SECS_PER_DAY: i64 = 86_400;
/// Year in which the clocks of operating systems begin.
const UNIX_YEAR: i64 = 1970;
/// Last day of a year that has four digits, from the first day of year 0.
const MAX_DAYS: i64 = days_before_year(10_000) - 1;

/// A time in UTC to the millisecond, `2026-01-31T12:00:00.000Z`, so that text sorts by time. Every form of RFC 3339 is accepted;
/// a finer fraction is rounded up.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(try_from = "String")]
#[schema(value_type = String, format = DateTime)]
pub struct UtcTime(String);

impl UtcTime {
    /// The text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// Time that a clock shows.
    #[must_use]
    pub fn of(clock: SystemTime) -> Self {
        let after = clock.duration_since(UNIX_EPOCH).map_or(0, |since| i64::try_from(since.as_millis()).unwrap_or(i64::MAX));
        Self::from_ms((days_before_year(UNIX_YEAR) * SECS_PER_DAY * MS_PER_SEC).saturating_add(after))
    }

    /// Hours from `earlier` to this time; negative if this is the earlier one.
    #[must_use]
    pub fn hours_since(&self, earlier: &Self) -> f64 {
        let ms = |time: &Self| parse_ms(&time.0).unwrap_or_default();
        (ms(self) - ms(earlier)) as f64 / (MS_PER_SEC * 3600) as f64
    }

    /// Time of so many milliseconds since the first day of year 0; times beyond four digits of a year become the nearest.
    fn from_ms(ms: i64) -> Self {
        let ms = ms.clamp(0, (MAX_DAYS + 1) * SECS_PER_DAY * MS_PER_SEC - 1);
        let (days, ms) = (ms / (SECS_PER_DAY * MS_PER_SEC), ms % (SECS_PER_DAY * MS_PER_SEC));
        let (year, month, day) = date(days);
        let (secs, ms) = (ms / MS_PER_SEC, ms % MS_PER_SEC);
        Self(format!("{year:04}-{month:02}-{day:02}T{:02}:{:02}:{:02}.{ms:03}Z", secs / 3600, secs / 60 % 60, secs % 60))
    }
}

impl fmt::Display for UtcTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl FromStr for UtcTime {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        parse_ms(text)
            .map(Self::from_ms)
            .ok_or_else(|| format!("{text:?} is not a time; write it as 2026-01-31T12:00:00Z or 2026-01-31T13:00:00+01:00"))
    }
}

impl TryFrom<String> for UtcTime {
    type Error = String;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        text.parse()
    }
}

/// Milliseconds since the first day of year 0.
fn parse_ms(text: &str) -> Option<i64> {
    let (date, rest) = text.split_at_checked(10)?;
    let [year, month, day] = numbers(date, '-', [4, 2, 2])?;
    let (clock, rest) = rest.strip_prefix(['T', 't'])?.split_at_checked(8)?;
    let [hour, minute, second] = numbers(clock, ':', [2, 2, 2])?;
    let (ms, rest) = fraction_ms(rest)?;
    let offset_minutes = offset_minutes(rest)?;
    // Second 60 is a leap second; the clocks here have none.
    let is_date = (1..=12).contains(&month) && (1..=days_of_month(year, month)).contains(&day);
    if !is_date || hour > 23 || minute > 59 || second > 60 {
        return None;
    }
    let days = days_before_year(year) + (1..month).map(|month| days_of_month(year, month)).sum::<i64>() + day - 1;
    let secs = days * SECS_PER_DAY + hour * 3600 + (minute - offset_minutes) * 60 + second;
    Some(secs * MS_PER_SEC + ms)
}

/// Three numbers of so many digits, with `separator` between them and nothing else.
fn numbers(text: &str, separator: char, digits: [usize; 3]) -> Option<[i64; 3]> {
    let mut parts = text.split(separator);
    let mut next = |digits: usize| {
        let part = parts.next()?;
        let fits = part.len() == digits && part.bytes().all(|c| c.is_ascii_digit());
        if fits { part.parse().ok() } else { None }
    };
    let found = [next(digits[0])?, next(digits[1])?, next(digits[2])?];
    parts.next().is_none().then_some(found)
}

/// Milliseconds of a fraction of a second, rounded up, and the text behind it.
fn fraction_ms(text: &str) -> Option<(i64, &str)> {
    let Some(fraction) = text.strip_prefix('.') else { return Some((0, text)) };
    let length = fraction.bytes().take_while(u8::is_ascii_digit).count();
    let (digits, rest) = fraction.split_at(length);
    let ms = digits.bytes().chain(*b"000").take(3).fold(0, |ms, digit| 10 * ms + i64::from(digit - b'0'));
    let is_finer = digits.bytes().skip(3).any(|digit| digit != b'0');
    (length > 0).then_some((ms + i64::from(is_finer), rest))
}

/// Minutes by which a clock is ahead of UTC: `Z`, or hours and minutes with a sign. A space is a plus that lost its escape in a
/// query.
fn offset_minutes(text: &str) -> Option<i64> {
    if text == "Z" || text == "z" {
        return Some(0);
    }
    let sign = if text.starts_with(['+', ' ']) { 1 } else { -1 };
    let [hours, minutes, _] = numbers(&format!("{}:00", text.strip_prefix(['+', ' ', '-'])?), ':', [2, 2, 2])?;
    (hours <= 23 && minutes <= 59).then_some(sign * (60 * hours + minutes))
}

/// Days from the first day of year 0 to that of `year`, in the Gregorian calendar.
const fn days_before_year(year: i64) -> i64 {
    365 * year + (year + 3) / 4 - (year + 99) / 100 + (year + 399) / 400
}

fn days_of_month(year: i64, month: i64) -> i64 {
    match month {
        2 => 28 + i64::from(days_before_year(year + 1) - days_before_year(year) == 366),
        4 | 6 | 9 | 11 => 30,
        _ => 31,
    }
}

/// Year, month and day of a number of days from the first day of year 0.
fn date(days: i64) -> (i64, i64, i64) {
    // 146 097 days are 400 years; the estimate is at most one year off.
    let estimate = days * 400 / 146_097;
    let year = (estimate - 1..=estimate + 1).rev().find(|year| days_before_year(*year) <= days).unwrap_or(estimate);
    let (mut month, mut rest) = (1, days - days_before_year(year));
    while rest >= days_of_month(year, month) {
        rest -= days_of_month(year, month);
        month += 1;
    }
    (year, month, rest + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Option<String> {
        text.parse::<UtcTime>().ok().map(|time| time.to_string())
    }

    #[test]
    fn every_form_becomes_the_one_that_is_compared() {
        for (written, time) in [
            ("2026-01-31T12:00:00Z", "2026-01-31T12:00:00.000Z"),
            ("2026-01-31t12:00:00z", "2026-01-31T12:00:00.000Z"),
            ("2026-01-31T12:00:00.5Z", "2026-01-31T12:00:00.500Z"),
            ("2026-01-31T12:00:00.0001Z", "2026-01-31T12:00:00.001Z"),
            ("2026-12-31T23:59:59.9999Z", "2027-01-01T00:00:00.000Z"),
            ("2026-01-01T00:30:00+01:00", "2025-12-31T23:30:00.000Z"),
            ("2026-01-01T00:30:00 01:00", "2025-12-31T23:30:00.000Z"),
            ("2026-02-28T23:30:00-01:00", "2026-03-01T00:30:00.000Z"),
            ("2024-02-28T23:30:00-01:00", "2024-02-29T00:30:00.000Z"),
            ("2016-12-31T23:59:60Z", "2017-01-01T00:00:00.000Z"),
            ("0000-01-01T00:00:00+23:59", "0000-01-01T00:00:00.000Z"),
            ("9999-12-31T23:59:59-01:00", "9999-12-31T23:59:59.999Z"),
        ] {
            assert_eq!(read(written).as_deref(), Some(time), "{written}");
        }
    }

    #[test]
    fn hours_between_two_times_and_the_time_of_a_clock() {
        let at = |text: &str| text.parse::<UtcTime>().expect("a time");
        let (noon, later) = (at("2026-02-28T12:00:00Z"), at("2026-03-01T14:30:00+01:00"));
        assert_eq!((later.hours_since(&noon), noon.hours_since(&later)), (25.5, -25.5));
        let clock = UNIX_EPOCH + std::time::Duration::from_millis(1_767_225_600_250);
        assert_eq!(UtcTime::of(clock).as_str(), "2026-01-01T00:00:00.250Z");
        assert_eq!(UtcTime::of(UNIX_EPOCH - std::time::Duration::from_secs(9)).as_str(), "1970-01-01T00:00:00.000Z");
    }

    #[test]
    fn each_day_of_a_century_has_its_own_date() {
        let first = days_before_year(1999);
        for days in first..first + 36_525 {
            let (year, month, day) = date(days);
            let text = format!("{year:04}-{month:02}-{day:02}T00:00:00.000Z");
            assert_eq!(read(&text), Some(text.clone()), "{days}");
            assert_eq!(UtcTime::from_ms(days * SECS_PER_DAY * MS_PER_SEC).as_str(), text);
        }
    }

    #[test]
    fn other_texts_are_no_time() {
        for text in [
            "",
            "now",
            "2026-01-31",
            "2026-01-31 12:00:00Z",
            "2026-01-31T12:00Z",
            "2026-01-31T12:00:00",
            "2026-01-31T12:00:00.Z",
            "2026-02-29T12:00:00Z",
            "2026-13-01T12:00:00Z",
            "2026-00-01T12:00:00Z",
            "2026-01-32T12:00:00Z",
            "2026-01-31T24:00:00Z",
            "2026-01-31T12:60:00Z",
            "2026-01-31T12:00:61Z",
            "2026-01-31T12:00:00+24:00",
            "2026-01-31T12:00:00+1:00",
            "2026-01-31T12:00:00+01:00:00",
            "2026-01-3äT12:00:00Z",
            "+026-01-31T12:00:00Z",
            "1767225600",
        ] {
            assert_eq!(read(text), None, "{text}");
        }
    }
}

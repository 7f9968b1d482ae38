//! Kind and allowed range of every setting, and the values of the merged layers read as these kinds. Nothing is rounded or
//! converted: `true` for a number of days would be a day, after which runs are deleted.

use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;

use config::{Value, ValueKind};

use super::Settings;
use crate::cell::{Findings, decimal_comma_advice};

/// Kind of the values that a setting takes.
#[derive(Clone, Copy, Debug)]
enum Kind {
    /// True or false.
    Switch,
    /// Whole number.
    Integer(Bounds),
    /// Finite number, written as a whole number or as a decimal fraction.
    Number(Bounds),
    /// String.
    Text,
    /// String that no message shows.
    Secret,
    /// String of an IP address and a port.
    Address,
    /// List of strings.
    List,
}

/// Bounds of the numbers that a setting takes.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    /// Smallest number.
    low: f64,
    /// Largest number; infinite for none.
    high: f64,
    /// Unit, for messages; empty for a count and a share.
    unit: &'static str,
    /// Meaning of 0 where that is allowed besides the numbers from `low` to `high`; empty where it is not.
    zero: &'static str,
}

const fn integer(low: f64, high: f64, unit: &'static str) -> Kind {
    Kind::Integer(Bounds { low, high, unit, zero: "" })
}

const fn integer_or_zero(zero: &'static str, low: f64, high: f64, unit: &'static str) -> Kind {
    Kind::Integer(Bounds { low, high, unit, zero })
}

const fn number(low: f64, high: f64, unit: &'static str) -> Kind {
    Kind::Number(Bounds { low, high, unit, zero: "" })
}

/// Meaning of 0 for memory.
const MEMORY_SHARE: &str = "a share of the machine's memory";
/// Largest number of connections, streams and waits.
const MAX_CLIENTS: f64 = 1e5;
/// Largest number of hours: ten years.
const MAX_HOURS: f64 = 87_600.0;
/// Largest number of days: a hundred years.
const MAX_DAYS: f64 = 36_500.0;

/// Every setting with its kind, in the order of `config/default.toml`, whose comments tell the same ranges.
const SETTINGS: &[(&str, Kind)] = &[
    ("server.listen", Kind::Address),
    ("server.insecure", Kind::Switch),
    ("server.api_key", Kind::Secret),
    ("server.api_keys_file", Kind::Text),
    ("server.hosts", Kind::List),
    ("server.trusted_proxies", Kind::List),
    ("server.public_path", Kind::Text),
    ("server.cors_origins", Kind::List),
    ("server.max_connections", integer(1.0, MAX_CLIENTS, "")),
    ("server.max_connections_per_address", integer(1.0, MAX_CLIENTS, "")),
    ("server.max_event_streams", integer(1.0, MAX_CLIENTS, "")),
    ("server.max_event_streams_per_address", integer(1.0, MAX_CLIENTS, "")),
    ("server.max_waits", integer(1.0, MAX_CLIENTS, "")),
    ("server.max_waits_per_address", integer(1.0, MAX_CLIENTS, "")),
    ("server.http2_max_streams", integer(1.0, 1e4, "")),
    ("server.header_timeout_secs", number(0.1, 600.0, "s")),
    ("server.idle_timeout_secs", number(0.1, 86_400.0, "s")),
    ("server.body_idle_timeout_secs", number(0.1, 600.0, "s")),
    ("server.request_timeout_secs", number(0.1, 600.0, "s")),
    ("server.drain_timeout_secs", number(0.0, 600.0, "s")),
    ("limits.upload_bytes", integer(1024.0, 1_099_511_627_776.0, "bytes")),
    ("limits.json_bytes", integer(1024.0, 1_073_741_824.0, "bytes")),
    ("limits.download_bytes_per_sec", integer(1e6, 1e12, "bytes per second")),
    ("limits.uploads_at_once", integer(1.0, 256.0, "")),
    ("limits.uploads_at_once_per_address", integer(1.0, 256.0, "")),
    ("limits.mesh_triangles", integer(1.0, 1e9, "")),
    ("limits.queued_jobs", integer(1.0, 1e6, "")),
    ("limits.parse_secs", number(1.0, 3600.0, "s")),
    ("limits.parse_memory_bytes", integer_or_zero(MEMORY_SHARE, 67_108_864.0, f64::INFINITY, "bytes")),
    ("limits.job_memory_bytes", integer_or_zero(MEMORY_SHARE, 268_435_456.0, f64::INFINITY, "bytes")),
    // At most a week.
    ("limits.job_secs", Kind::Number(Bounds { low: 1.0, high: 604_800.0, unit: "s", zero: "no limit" })),
    ("store.data_dir", Kind::Text),
    ("store.event_retention_hours", integer(1.0, MAX_HOURS, "h")),
    ("store.min_free_bytes", integer(0.0, 1e15, "bytes")),
    ("store.min_free_share", number(0.0, 0.9, "")),
    ("store.orphan_hours", integer(1.0, MAX_HOURS, "h")),
    ("store.swept_hours", integer(1.0, MAX_HOURS, "h")),
    ("store.scrub_hours", integer_or_zero("never", 1.0, MAX_HOURS, "h")),
    ("retention.job_days", integer_or_zero("never", 1.0, MAX_DAYS, "days")),
    ("retention.jobs_per_part", integer_or_zero("all", 1.0, 1e6, "")),
    ("retention.unused_mesh_days", integer_or_zero("never", 1.0, MAX_DAYS, "days")),
    ("retention.run_days", integer_or_zero("never", 1.0, MAX_DAYS, "days")),
    ("retention.max_disk_share", number(0.0, 1.0, "")),
    ("retention.hold_label", Kind::Text),
    ("planning.threads", integer_or_zero("one per core", 1.0, 1024.0, "")),
    ("planning.concurrent_jobs", integer_or_zero("as many as there are threads", 1.0, 64.0, "")),
    ("planning.max_attempts", integer(1.0, 100.0, "")),
    ("execution.live", Kind::Switch),
    ("execution.cells", Kind::List),
    ("execution.lease_secs", number(0.5, 30.0, "s")),
    ("execution.heartbeat_secs", number(0.1, 15.0, "s")),
    ("execution.audit_dir", Kind::Text),
    ("execution.audit_file_bytes", integer(65_536.0, 1_073_741_824.0, "bytes")),
    ("execution.audit_files", integer(2.0, 1000.0, "")),
    ("execution.max_runs", integer(1.0, 256.0, "")),
    ("telemetry.log", Kind::Text),
    ("telemetry.format", Kind::Text),
];

/// Settings as they are read from the merged layers, with all that is wrong in them.
pub(super) struct Read {
    /// All settings, for a deserializer; a value that is refused is as it is built in, and an unknown key is null.
    pub(super) settings: serde_json::Value,
    /// Values of other kinds.
    pub(super) mismatches: Findings,
    /// Numbers out of range.
    pub(super) out_of_range: Findings,
}

/// Reads the merged layers. The values of `texts` come from the environment or a flag: they are strings, whatever their kind.
pub(super) fn read(merged: &Value, texts: &BTreeSet<String>, built_in: serde_json::Value) -> Read {
    let mut read = Read { settings: built_in, mismatches: Findings::default(), out_of_range: Findings::default() };
    for &(key, kind) in SETTINGS {
        let Some((section, name)) = key.split_once('.') else { continue };
        if let Some(value) = entry(merged, section).and_then(|table| entry(table, name)) {
            read.take(section, name, kind, Written { value: &value.kind, is_text: texts.contains(key) });
        }
    }
    read.take_unknown(merged);
    read
}

impl Read {
    fn take(&mut self, section: &str, name: &str, kind: Kind, written: Written<'_>) {
        let pointer = format!("/{section}/{name}");
        let Some(value) = kind.read(written) else {
            self.mismatches.push(pointer, kind.mismatch(written));
            return;
        };
        let beyond = kind.bounds().zip(value.as_f64()).filter(|(bounds, number)| !bounds.allows(*number));
        let Some((bounds, number)) = beyond else {
            self.settings[section][name] = value;
            return;
        };
        if matches!(kind, Kind::Integer(_)) {
            // It may be one that its type does not hold.
            self.out_of_range.push(pointer, format!("is {value}; allowed is {}", kind.allowed()));
            return;
        }
        if bounds.zero.is_empty() {
            // With the share that was meant by a percentage.
            self.out_of_range.range(pointer, number, bounds.low, bounds.high, bounds.unit);
        } else {
            self.out_of_range.push(pointer, format!("is {number} {}; allowed is {}", bounds.unit, kind.allowed()));
        }
        self.settings[section][name] = value;
    }

    /// Adds the keys that no setting has, which the deserializer refuses with the one that was meant.
    fn take_unknown(&mut self, merged: &Value) {
        for (section, table) in entries(merged) {
            if !Settings::has_section(section) {
                self.settings[section] = serde_json::Value::Null;
                continue;
            }
            if !matches!(table.kind, ValueKind::Table(_)) {
                let detail = format!("is {}; allowed is a table, [{section}]", found(&table.kind));
                self.mismatches.push(format_args!("/{section}"), detail);
            }
            for name in entries(table).into_keys() {
                if !is_setting(section, name) {
                    self.settings[section][name] = serde_json::Value::Null;
                }
            }
        }
    }
}

fn is_setting(section: &str, name: &str) -> bool {
    SETTINGS.iter().any(|(key, _)| key.split_once('.') == Some((section, name)))
}

/// Entry of a table.
pub(super) fn entry<'a>(table: &'a Value, name: &str) -> Option<&'a Value> {
    if let ValueKind::Table(table) = &table.kind { table.get(name) } else { None }
}

/// Entries of a table in the order of their names; none of another value.
fn entries(table: &Value) -> BTreeMap<&str, &Value> {
    if let ValueKind::Table(table) = &table.kind {
        table.iter().map(|(name, value)| (name.as_str(), value)).collect()
    } else {
        BTreeMap::new()
    }
}

/// Value as it was written.
#[derive(Clone, Copy)]
struct Written<'a> {
    value: &'a ValueKind,
    /// True if the value is a string for want of another kind: in an environment variable or a flag.
    is_text: bool,
}

impl<'a> Written<'a> {
    /// The string that stands for a value of another kind.
    fn text(self) -> Option<&'a str> {
        self.string().filter(|_| self.is_text)
    }

    fn string(self) -> Option<&'a str> {
        if let ValueKind::String(text) = self.value { Some(text) } else { None }
    }

    fn switch(self) -> Option<bool> {
        if let ValueKind::Boolean(value) = self.value { Some(*value) } else { self.text()?.parse().ok() }
    }

    fn integer(self) -> Option<u64> {
        match self.value {
            ValueKind::I64(number) => u64::try_from(*number).ok(),
            ValueKind::I128(number) => u64::try_from(*number).ok(),
            ValueKind::U64(number) => Some(*number),
            ValueKind::U128(number) => u64::try_from(*number).ok(),
            ValueKind::String(_) => {
                // The parser of the standard library takes a sign too.
                let digits = self.text().filter(|text| text.bytes().all(|byte| byte.is_ascii_digit()))?;
                digits.parse().ok()
            }
            ValueKind::Nil | ValueKind::Boolean(_) | ValueKind::Float(_) | ValueKind::Table(_) | ValueKind::Array(_) => None,
        }
    }

    fn number(self) -> Option<f64> {
        let number = match self.value {
            ValueKind::I64(number) => Some(*number as f64),
            ValueKind::I128(number) => Some(*number as f64),
            ValueKind::U64(number) => Some(*number as f64),
            ValueKind::U128(number) => Some(*number as f64),
            ValueKind::Float(number) => Some(*number),
            ValueKind::String(_) => self.text().and_then(|text| text.parse().ok()),
            ValueKind::Nil | ValueKind::Boolean(_) | ValueKind::Table(_) | ValueKind::Array(_) => None,
        };
        number.filter(|number| number.is_finite())
    }

    /// A list, or the entries of a string that are separated by commas.
    fn list(self) -> Option<Vec<String>> {
        if let ValueKind::Array(values) = self.value {
            let string = |value: &Value| Written { value: &value.kind, is_text: false }.string().map(str::to_owned);
            return values.iter().map(string).collect();
        }
        Some(self.text()?.split(',').map(str::trim).filter(|entry| !entry.is_empty()).map(str::to_owned).collect())
    }
}

impl Kind {
    /// The value, if it is one of this kind.
    fn read(self, written: Written<'_>) -> Option<serde_json::Value> {
        match self {
            Self::Switch => written.switch().map(Into::into),
            Self::Integer(_) => written.integer().map(Into::into),
            Self::Number(_) => written.number().map(Into::into),
            Self::Text | Self::Secret => written.string().map(Into::into),
            Self::Address => written.string().filter(|text| text.parse::<SocketAddr>().is_ok()).map(Into::into),
            Self::List => written.list().map(Into::into),
        }
    }

    fn bounds(self) -> Option<Bounds> {
        match self {
            Self::Integer(bounds) | Self::Number(bounds) => Some(bounds),
            Self::Switch | Self::Text | Self::Secret | Self::Address | Self::List => None,
        }
    }

    /// Values that are allowed, for messages.
    fn allowed(self) -> String {
        match self {
            Self::Switch => "true or false".to_owned(),
            Self::Integer(bounds) => bounds.allowed("a whole number"),
            Self::Number(bounds) => bounds.allowed("a number"),
            Self::Text | Self::Secret => "a string, in quotes".to_owned(),
            Self::Address => "a string ADDRESS:PORT, such as \"127.0.0.1:8080\"".to_owned(),
            Self::List => "a list of strings, such as [\"one\", \"two\"]".to_owned(),
        }
    }

    /// Message for a value of another kind.
    fn mismatch(self, written: Written<'_>) -> String {
        let allowed = self.allowed();
        if matches!(self, Self::Secret) {
            return format!("is of the wrong kind; allowed is {allowed}");
        }
        let is_list = matches!(self, Self::List);
        let is_quoted = !is_list && self.read(Written { is_text: true, ..written }).is_some();
        let comma = written.string().filter(|_| matches!(self, Self::Number(_))).map_or("", decimal_comma_advice);
        let hint = if is_quoted { "; write it without quotes" } else { comma };
        format!("is {}; allowed is {allowed}{hint}", found(written.value))
    }
}

impl Bounds {
    fn allows(self, number: f64) -> bool {
        (self.low..=self.high).contains(&number) || (number == 0.0 && !self.zero.is_empty())
    }

    fn allowed(self, noun: &str) -> String {
        let Self { low, high, unit, zero } = self;
        let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
        let range = if high.is_finite() {
            format!("{noun} from {low} to {high}{unit}")
        } else {
            format!("{noun} of at least {low}{unit}")
        };
        if zero.is_empty() { range } else { format!("0 ({zero}), or {range}") }
    }
}

/// The value, for messages.
fn found(value: &ValueKind) -> String {
    match value {
        ValueKind::Nil => "a date or a time".to_owned(),
        ValueKind::Boolean(value) => value.to_string(),
        ValueKind::I64(number) => number.to_string(),
        ValueKind::I128(number) => number.to_string(),
        ValueKind::U64(number) => number.to_string(),
        ValueKind::U128(number) => number.to_string(),
        // With its point or exponent: 1.0 is not the whole number 1.
        ValueKind::Float(number) => format!("{number:?}"),
        ValueKind::String(text) => format!("{text:?}"),
        ValueKind::Table(_) => "a table".to_owned(),
        ValueKind::Array(values) => {
            format!("[{}]", values.iter().map(|value| found(&value.kind)).collect::<Vec<_>>().join(", "))
        }
    }
}

#[cfg(test)]
mod tests;

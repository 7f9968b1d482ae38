//! KUKA Robot Sensor Interface: a telegram of XML by UDP in every interpolation cycle, answered within it with the same `IPOC`.
//! The controller sends `<Rob>` with measured axes, the answer is `<Sen>` with corrections of the axes, both in degrees; names of
//! the elements are those of the controller's configuration (`RSI_EthernetConfig.xml`).

use std::fmt::Write as _;

use crate::execution::device::DeviceError;

/// Largest telegram that is read, bytes; a UDP datagram is no longer.
pub const MAX_TELEGRAM_BYTES: usize = 65_507;

/// Names that a controller's configuration gives to what it receives.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RsiNames {
    /// `SENTYPE`.
    pub sender_type: String,
    /// Element with the corrections of `A1` to `A6`.
    pub axis_tag: String,
    /// Element with the correction of an external axis.
    pub table_tag: String,
}

/// Telegram of a controller, one a cycle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RsiReport {
    /// Measured axes `AIPos`, degrees.
    pub axes_deg: [f64; 6],
    /// Commanded axes `ASPos`, degrees, where they are sent.
    pub commanded_deg: Option<[f64; 6]>,
    /// Measured external axes `EIPos`, degrees, where they are sent.
    pub external_deg: Option<[f64; 6]>,
    /// Number of late answers so far, `Delay`, where it is sent.
    pub late: Option<u32>,
    /// Time stamp of the cycle.
    pub ipoc: u64,
}

/// Answer to a telegram.
#[derive(Clone, Debug, PartialEq)]
pub struct RsiCorrection {
    /// Corrections of `A1` to `A6`, degrees.
    pub axes_deg: [f64; 6],
    /// External axis, 1 to 6, with its correction, degrees.
    pub table: Option<(u8, f64)>,
    /// Time stamp of the telegram answered.
    pub ipoc: u64,
}

impl RsiReport {
    /// Reads a telegram.
    ///
    /// # Errors
    /// [`DeviceError::Malformed`]: no `<Rob>` with `AIPos` and `IPOC`.
    pub fn decode(telegram: &[u8]) -> Result<Self, DeviceError> {
        let (mut axes, mut ipoc, mut report) = (None, None, Self::default());
        for element in elements(telegram, "Rob")? {
            let element = element?;
            match element.name {
                "AIPos" => axes = Some(element.numbers('A')?),
                "ASPos" => report.commanded_deg = Some(element.numbers('A')?),
                "EIPos" => report.external_deg = Some(element.numbers('E')?),
                "Delay" => report.late = element.number::<u32>("D")?,
                "IPOC" => ipoc = Some(element.text::<u64>()?),
                _ => {}
            }
        }
        report.axes_deg = axes.ok_or_else(|| malformed("a telegram without AIPos; the configuration must send DEF_AIPos"))?;
        report.ipoc = ipoc.ok_or_else(|| malformed("a telegram without IPOC"))?;
        Ok(report)
    }

    /// Writes the telegram, as a controller does.
    #[must_use]
    pub fn encode(&self) -> String {
        let mut xml = "<Rob Type=\"KUKA\">".to_owned();
        let groups = [("AIPos", 'A', Some(self.axes_deg)), ("ASPos", 'A', self.commanded_deg), ("EIPos", 'E', self.external_deg)];
        for (name, letter, deg) in groups {
            if let Some(deg) = deg {
                write_numbers(&mut xml, name, letter, &deg);
            }
        }
        if let Some(late) = self.late {
            let _ = write!(xml, "<Delay D=\"{late}\"/>");
        }
        let _ = write!(xml, "<IPOC>{}</IPOC></Rob>", self.ipoc);
        xml
    }
}

impl RsiCorrection {
    /// Writes the answer.
    #[must_use]
    pub fn encode(&self, names: &RsiNames) -> String {
        let mut xml = format!("<Sen Type=\"{}\">", names.sender_type);
        write_numbers(&mut xml, &names.axis_tag, 'A', &self.axes_deg);
        if let Some((axis, deg)) = self.table {
            let _ = write!(xml, "<{} E{axis}=\"{deg:.6}\"/>", names.table_tag);
        }
        let _ = write!(xml, "<IPOC>{}</IPOC></Sen>", self.ipoc);
        xml
    }

    /// Reads an answer, as a controller does.
    ///
    /// # Errors
    /// [`DeviceError::Malformed`]: no `<Sen>` with the corrections and `IPOC`.
    pub fn decode(answer: &[u8], names: &RsiNames) -> Result<Self, DeviceError> {
        let (mut axes, mut table, mut ipoc) = (None, None, None);
        for element in elements(answer, "Sen")? {
            let element = element?;
            if element.name == names.axis_tag {
                axes = Some(element.numbers('A')?);
            } else if element.name == names.table_tag {
                for axis in 1..=6 {
                    table = element.number(&format!("E{axis}"))?.map(|deg| (axis, deg)).or(table);
                }
            } else if element.name == "IPOC" {
                ipoc = Some(element.text::<u64>()?);
            }
        }
        let axes_deg = axes.ok_or_else(|| malformed("an answer without corrections"))?;
        Ok(Self { axes_deg, table, ipoc: ipoc.ok_or_else(|| malformed("an answer without IPOC"))? })
    }
}

fn write_numbers(xml: &mut String, name: &str, letter: char, deg: &[f64; 6]) {
    let _ = write!(xml, "<{name}");
    for (index, deg) in deg.iter().enumerate() {
        let _ = write!(xml, " {letter}{}=\"{deg:.6}\"", index + 1);
    }
    xml.push_str("/>");
}

fn malformed(what: impl Into<String>) -> DeviceError {
    DeviceError::Malformed { what: what.into() }
}

/// An element as far as telegrams have them: attributes or text, no element within.
struct Element<'a> {
    name: &'a str,
    attributes: &'a str,
    text: &'a str,
}

/// Elements of a telegram whose root is `root`: one pass, nothing kept.
fn elements<'a>(telegram: &'a [u8], root: &str) -> Result<impl Iterator<Item = Result<Element<'a>, DeviceError>>, DeviceError> {
    let text = std::str::from_utf8(telegram).map_err(|_| malformed("a telegram that is not text"))?;
    if telegram.len() > MAX_TELEGRAM_BYTES {
        return Err(malformed("a telegram longer than a datagram"));
    }
    let mut tags = text.split('<').skip(1).filter(|tag| !tag.starts_with(['?', '!'])).map(|tag| {
        let (inside, text) = tag.split_once('>').ok_or_else(|| malformed("a telegram that ends within a tag"))?;
        let (name, attributes) = inside.trim_end_matches('/').split_once(char::is_whitespace).unwrap_or((inside, ""));
        Ok(Element { name: name.trim_end_matches('/'), attributes, text: text.trim() })
    });
    match tags.next() {
        Some(Ok(first)) if first.name == root => {}
        _ => return Err(malformed(format!("a telegram that does not begin with <{root}>"))),
    }
    if !text.trim_end().ends_with(&format!("</{root}>")) {
        return Err(malformed(format!("a telegram without its end </{root}>")));
    }
    Ok(tags)
}

impl Element<'_> {
    /// Value of an attribute; `None` without it.
    fn attribute(&self, name: &str) -> Option<&str> {
        let mut rest = self.attributes;
        while let Some((key, after)) = rest.split_once('=') {
            let after = after.trim_start();
            let quote = after.chars().next().filter(|quote| ['"', '\''].contains(quote))?;
            let (value, next) = after.get(1..)?.split_once(quote)?;
            if key.trim() == name {
                return Some(value.trim());
            }
            rest = next;
        }
        None
    }

    fn number<T: Finite>(&self, name: &str) -> Result<Option<T>, DeviceError> {
        self.attribute(name).map(|value| finite(self.name, value)).transpose()
    }

    /// The six numbers `A1` to `A6`, or of another letter.
    fn numbers(&self, letter: char) -> Result<[f64; 6], DeviceError> {
        let mut numbers = [0.0; 6];
        for (index, number) in numbers.iter_mut().enumerate() {
            let name = format!("{letter}{}", index + 1);
            *number = self.number(&name)?.ok_or_else(|| malformed(format!("{} without {name}", self.name)))?;
        }
        Ok(numbers)
    }

    fn text<T: Finite>(&self) -> Result<T, DeviceError> {
        finite(self.name, self.text)
    }
}

/// Numbers of telegrams.
trait Finite: std::str::FromStr {
    fn is_number(&self) -> bool {
        true
    }
}

impl Finite for u32 {}
impl Finite for u64 {}
impl Finite for f64 {
    fn is_number(&self) -> bool {
        self.is_finite()
    }
}

fn finite<T: Finite>(name: &str, value: &str) -> Result<T, DeviceError> {
    let short: String = value.chars().take(20).collect();
    value.parse().ok().filter(T::is_number).ok_or_else(|| malformed(format!("{name} with {short:?}, not a number")))
}

#[cfg(test)]
mod tests;

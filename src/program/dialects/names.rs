//! Names and comments as each language allows them. What users wrote never becomes code: identifiers keep letters, digits
//! and underscores only, comments lose line ends and everything that is not printable ASCII.

/// Names that Windows keeps for devices, whatever the extension: a file cannot have them there, and KUKA's controllers run on it.
const DEVICES: [&str; 22] = [
    "AUX", "COM1", "COM2", "COM3", "COM4", "COM5", "COM6", "COM7", "COM8", "COM9", "CON", "LPT1", "LPT2", "LPT3", "LPT4", "LPT5",
    "LPT6", "LPT7", "LPT8", "LPT9", "NUL", "PRN",
];

/// Rules of a language for the name of a program.
pub(super) struct NameRule {
    /// Largest number of characters.
    pub longest: usize,
    /// Names that mean something else, in capitals.
    pub reserved: &'static [&'static str],
    /// Beginning of the names of a program's own points, in capitals, whose numbers follow; empty where points have no names.
    pub point: &'static str,
}

impl NameRule {
    /// Returns true for a name, in capitals, that means something else.
    fn is_taken(&self, name: &str) -> bool {
        let number = name.strip_prefix(self.point).unwrap_or_default();
        let is_point = !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit());
        is_point || self.reserved.contains(&name) || DEVICES.contains(&name)
    }
}

/// An identifier that resembles `name`: runs of other characters become one underscore, a first digit, a reserved word or the name
/// of a point or a device gets `v_` before it, a later setup its number behind it, within the length.
pub(super) fn identifier(name: &str, setup: usize, rule: &NameRule) -> String {
    let words = name.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
    let mut plain = words.collect::<Vec<_>>().join("_");
    let suffix = if setup == 0 { String::new() } else { format!("_{}", setup + 1) };
    let cut = |text: &mut String| {
        text.truncate(rule.longest - suffix.len());
        text.truncate(text.trim_end_matches('_').len());
    };
    cut(&mut plain);
    let whole = format!("{plain}{suffix}");
    if !plain.starts_with(|c: char| c.is_ascii_alphabetic()) || rule.is_taken(&whole.to_ascii_uppercase()) {
        plain.insert_str(0, "v_");
        cut(&mut plain);
    }
    format!("{plain}{suffix}")
}

/// A text as a comment: printable ASCII on one line, anything else a question mark.
pub(super) fn comment(text: &str) -> String {
    text.chars().map(|c| if c == ' ' || c.is_ascii_graphic() { c } else { '?' }).collect()
}

/// The text in lines of at most `width` characters, broken at spaces; longer words are cut.
pub(super) fn wrap(text: &str, width: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split(' ').filter(|word| !word.is_empty()) {
        match lines.last_mut() {
            Some(line) if line.len() + 1 + word.len() <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.extend(word.as_bytes().chunks(width).map(|part| String::from_utf8_lossy(part).into_owned())),
        }
    }
    lines
}

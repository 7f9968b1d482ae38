//! Names and comments as each language allows them. What users wrote never becomes code: identifiers keep letters, digits
//! and underscores only, comments lose line ends and everything that is not printable ASCII.

/// Rules of a language for the name of a program.
pub(super) struct NameRule {
    /// Largest number of characters.
    pub longest: usize,
    /// Names that mean something else, in capitals.
    pub reserved: &'static [&'static str],
}

/// An identifier that resembles `name`: runs of other characters become one underscore, a first digit or a reserved word
/// gets `v_` before it, a later setup its number behind it, within the length.
pub(super) fn identifier(name: &str, setup: usize, rule: &NameRule) -> String {
    let words = name.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
    let mut plain = words.collect::<Vec<_>>().join("_");
    let suffix = if setup == 0 { String::new() } else { format!("_{}", setup + 1) };
    let cut = |text: &mut String| text.truncate(rule.longest - suffix.len());
    cut(&mut plain);
    let whole = format!("{plain}{suffix}");
    if !plain.starts_with(|c: char| c.is_ascii_alphabetic()) || rule.reserved.contains(&whole.to_ascii_uppercase().as_str()) {
        plain.insert_str(0, "v_");
        cut(&mut plain);
    }
    format!("{plain}{suffix}").trim_end_matches('_').to_owned()
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

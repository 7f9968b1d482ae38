//! The frame of the page.

use super::markup::escape;
use crate::wire::words::is_control;

const STYLE: &str = include_str!("style.css");
/// Policy that keeps the page from running scripts and loading files, should a name ever slip through unescaped.
const POLICY: &str = "default-src 'none'; img-src data:; style-src 'unsafe-inline'";

/// The document around `body`; `title` may be untrusted text.
pub(in crate::report) fn document(title: &str, body: &str) -> String {
    printed(title, &[], body)
}

/// The document around `body`; in print, `foot` stands at the bottom of every page beside its number. `title` and `foot` may be
/// untrusted text.
pub(in crate::report) fn printed(title: &str, foot: &[&str], body: &str) -> String {
    let foot: Vec<String> = foot.iter().filter(|text| !text.is_empty()).map(|text| css_string(text)).collect();
    let foot = foot.join(" \"  ·  \" ");
    let foot = if foot.is_empty() { "\"\"".to_owned() } else { foot };
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\"/>\n\
         <title>{}</title>\n<style>\n{STYLE}@page {{ @bottom-left {{ content: {foot}; }} }}\n</style>\n</head>\n<body>\n{body}</body>\n</html>\n",
        escape(title)
    )
}

/// Text as a string of a style sheet: all but ASCII letters and digits as escapes, so that no text ends the string or the sheet.
fn css_string(text: &str) -> String {
    let mut string = String::from("\"");
    for character in text.chars() {
        match character {
            c if c.is_ascii_alphanumeric() => string.push(c),
            c if is_control(c) => string.push_str("\\fffd "),
            c => string.push_str(&format!("\\{:x} ", u32::from(c))),
        }
    }
    string.push('"');
    string
}

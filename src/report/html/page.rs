//! The frame of the page.

use super::markup::escape;

const STYLE: &str = include_str!("style.css");
/// Policy that keeps the page from running scripts and loading files, should a name ever slip through unescaped.
const POLICY: &str = "default-src 'none'; img-src data:; style-src 'unsafe-inline'";

/// The document around `body`; `title` may be untrusted text.
pub(in crate::report) fn document(title: &str, body: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\"/>\n\
         <title>{}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n{body}</body>\n</html>\n",
        escape(title)
    )
}

//! Pages for users of the API: one for each kind of problem, to which its `type` leads, their list, and the lists of parameters.
//! Links are relative.

use std::fmt::Write as _;

use super::problem::Code;
use crate::wire::{FailureCode, parameters};

/// Media type of the pages.
pub(super) const HTML: &str = "text/html; charset=utf-8";

/// A kind of problem, as its page shows it.
struct Kind {
    code: &'static str,
    title: &'static str,
    /// Status of the response; `None` for the problem of a job that failed.
    status: Option<u16>,
    meaning: &'static str,
}

/// Meaning of the problems that failed jobs carry.
const OF_A_JOB: &str = "A job ended with this problem and without results; its `detail` says why, its `errors` name the fields at \
                        fault. Correct the request and start another job.";

/// Every kind: of responses, then of failed jobs.
fn kinds() -> impl Iterator<Item = Kind> {
    let of_responses = Code::ALL.iter().map(|code| Kind {
        code: code.as_str(),
        title: code.title(),
        status: Some(code.status().as_u16()),
        meaning: code.meaning(),
    });
    let is_new = |code: &str| Code::ALL.iter().all(|other| other.as_str() != code);
    let of_jobs = FailureCode::ALL.into_iter().filter(move |failure| is_new(failure.as_str()));
    let of_job = |failure: FailureCode| Kind { code: failure.as_str(), title: failure.title(), status: None, meaning: OF_A_JOB };
    of_responses.chain(of_jobs.map(of_job))
}

/// Page of one kind of problem; `None` if there is none with this code.
pub(super) fn problem(code: &str) -> Option<String> {
    let Kind { code, title, status, meaning } = kinds().find(|kind| kind.code == code)?;
    let also = match status {
        Some(_) if FailureCode::ALL.iter().any(|failure| failure.as_str() == code) => {
            " A job that failed can carry this problem too."
        }
        _ => "",
    };
    let status = status.map_or("none: the problem of a job that failed".to_owned(), |status| status.to_string());
    let body = format!(
        "<h2>{}</h2>\n<p>{}{also}</p>\n\
         <dl>\n<dt>code</dt><dd><code>{code}</code></dd>\n<dt>HTTP status</dt><dd>{status}</dd>\n</dl>\n\
         <p><code>detail</code> of the response describes the occurrence; <code>errors</code> lists the fields at fault, each \
         with its JSON pointer or the name of its query parameter or header; under <code>request_id</code> the server's log \
         has more.</p>\n<p><a href=\"../problems\">All problems</a> · <a href=\"../docs/\">API</a></p>",
        escaped(title),
        marked(meaning)
    );
    Some(document(&format!("{code}: {title}"), "../", &body))
}

/// List of all kinds of problems.
pub(super) fn problems() -> String {
    let mut body = String::from(
        "<h2>Problems</h2>\n<p>Every response other than 2xx and 3xx is <code>application/problem+json</code> (RFC 9457) with a \
         stable <code>code</code>.</p>\n<div class=\"regions\"><table>\n<thead><tr><th scope=\"col\">Code</th>\
         <th scope=\"col\">Status</th><th scope=\"col\">Meaning</th></tr></thead>\n<tbody>\n",
    );
    for Kind { code, title, status, meaning } in kinds() {
        let status = status.map_or("job".to_owned(), |status| status.to_string());
        let _ = writeln!(
            body,
            "<tr id=\"{code}\"><td><a href=\"problems/{code}\"><code>{code}</code></a></td><td>{status}</td><td>{}. {}</td></tr>",
            escaped(title),
            marked(meaning)
        );
    }
    body.push_str("</tbody>\n</table></div>");
    document("Problems", "", &body)
}

/// Lists of the parameters with defaults and ranges.
pub(super) fn parameters() -> String {
    let mut body = String::from(
        "<p>A dot in a key stands for a nested object, <code>[]</code> for each entry of a list. The command line takes the same \
         names: <code>--set KEY=VALUE</code>.</p>\n",
    );
    for (title, place, parameters) in parameters::lists() {
        let _ = writeln!(
            body,
            "<h2>{}</h2>\n<p>{}.</p>\n<div class=\"regions\"><table>\n<thead><tr><th scope=\"col\">Key</th><th \
             scope=\"col\">Default</th><th scope=\"col\">Range</th><th scope=\"col\">Meaning</th></tr></thead>\n<tbody>",
            escaped(title),
            marked(place)
        );
        for parameter in parameters {
            let (key, default) = (escaped(&parameter.key), escaped(&parameter.default_text()));
            let (range, meaning) = (escaped(&parameter.range_text()), marked(&parameter.description));
            let _ = writeln!(
                body,
                "<tr id=\"{key}\"><td><code>{key}</code></td><td><code>{default}</code></td><td>{range}</td>\
                 <td>{meaning}</td></tr>"
            );
        }
        body.push_str("</tbody>\n</table></div>\n");
    }
    body.push_str("<p><a href=\"docs/\">API</a></p>");
    document("Parameters", "", &body)
}

/// A page; `root` is the way to the folder of the dashboard.
fn document(title: &str, root: &str, body: &str) -> String {
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n\
         <title>{} – Vantage</title>\n<link rel=\"icon\" href=\"{root}assets/icon.svg\" type=\"image/svg+xml\">\n\
         <link rel=\"stylesheet\" href=\"{root}assets/style.css\">\n</head>\n<body>\n<header><h1>Vantage</h1></header>\n<main>\n\
         <section>\n{body}\n</section>\n</main>\n</body>\n</html>\n",
        escaped(title)
    )
}

/// Text as HTML, with words between backticks as code.
fn marked(text: &str) -> String {
    let parts = text.split('`').enumerate();
    parts.map(|(index, part)| if index % 2 == 1 { format!("<code>{}</code>", escaped(part)) } else { escaped(part) }).collect()
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

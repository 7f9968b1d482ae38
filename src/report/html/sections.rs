//! Frame of the report: header, footer, and the foot of printed pages.

use super::ReportSubject;
use super::markup::{area, edges, escape, number};
use super::page;

/// Number of characters shown of a digest.
const DIGEST_SHOWN: usize = 12;
/// Characters of a time up to its minutes: `2026-01-31T08:15`.
const TO_MINUTES: usize = 16;

/// The whole page; `kind` names the report.
pub(super) fn document(subject: &ReportSubject<'_>, kind: &str, body: &str) -> String {
    let part_number = subject.echo.part_number.as_deref().unwrap_or_default();
    let (date, version) = (subject.date.map(date_text).unwrap_or_default(), format!("Vantage {}", env!("CARGO_PKG_VERSION")));
    let title = format!("{kind}: {}", subject.part_name);
    page::printed(&title, &[subject.part_name, part_number, &date, &version], body)
}

/// Header: the part, its hardware, the date and the version, and the report's `own` facts, whose text is escaped already.
pub(super) fn header(subject: &ReportSubject<'_>, kind: &str, own: &[(&'static str, String)]) -> String {
    let size = edges(subject.mesh.aabb().extent_mm().into());
    let mut facts = Vec::new();
    facts.extend(subject.echo.part_number.iter().map(|number| ("Part number", escape(number))));
    facts.extend(subject.echo.serial.iter().map(|serial| ("Serial number", escape(serial))));
    facts.extend(subject.date.map(|date| ("Date", escape(&date_text(date)))));
    facts.extend([
        ("Version", format!("Vantage {}", env!("CARGO_PKG_VERSION"))),
        ("Size", size),
        ("Surface", format!("{} in {} triangles", area(subject.mesh.area_mm2()), number(subject.mesh.faces.len() as f64, 0))),
        ("Scanner", escape(&subject.scanner.name)),
        ("Cell", subject.cell.map_or_else(|| "none: viewpoints only".into(), |cell| escape(&cell.name))),
    ]);
    facts.extend_from_slice(own);
    let label = |(name, value): (&String, &String)| format!("<span class=\"chip\">{}: {}</span>", escape(name), escape(value));
    let labels: Vec<String> = subject.echo.labels.iter().map(label).collect();
    if !labels.is_empty() {
        facts.push(("Labels", labels.join(" ")));
    }
    let facts: Vec<String> = facts.iter().map(|(name, value)| format!("<div><dt>{name}</dt><dd>{value}</dd></div>")).collect();
    format!(
        "<header>\n<p class=\"kind\">{kind}</p>\n<h1>{}</h1>\n<dl class=\"facts\">{}</dl>\n</header>\n",
        escape(subject.part_name),
        facts.concat()
    )
}

/// Footer: source of the numbers.
pub(super) fn footer(source: &str) -> String {
    format!("<footer>\n<p>Written by Vantage {} from {source}.</p>\n</footer>\n", env!("CARGO_PKG_VERSION"))
}

/// The beginning of a digest, with all of it as a title.
pub(super) fn digest(sha256: &str) -> String {
    let shown: String = sha256.chars().take(DIGEST_SHOWN).collect();
    format!("<code title=\"{}\">{}…</code>", escape(sha256), escape(&shown))
}

/// Formats a time of RFC 3339 in UTC to the minute; another text is returned as it is.
pub(super) fn date_text(date: &str) -> String {
    match date.get(..TO_MINUTES) {
        Some(shown) if date.is_ascii() && date.ends_with('Z') && shown.as_bytes()[10] == b'T' => {
            format!("{} {} UTC", &shown[..10], &shown[11..])
        }
        _ => date.to_owned(),
    }
}

//! Text with a point a line: XYZ, ASC, PTS, CSV. Columns are separated by white space, commas or semicolons; where there are
//! semicolons, a comma is a decimal mark. Lines that begin with `#`, `//`, `;` or `!` are comments. One line of names may stand before
//! the points; it tells where x, y and z are, and their unit (`x_mm`, `X [mm]`). It may be a comment, which is then held against the number
//! of columns: it may say more than names. A first line of one whole number is a count (PTS).

use super::stream::CloudStream;
use super::{CloudError, CloudLimits, Collected, StoredCloud};
use crate::geometry::mesh_io::text::{Line, Lines, excerpt, number};
use crate::geometry::mesh_io::{MeshError, Position};
use crate::geometry::parallel;
use crate::geometry::poll::Poll;
use crate::geometry::unit::LengthUnit;

/// Bytes of text that are parsed together.
const PIECE_BYTES: usize = 1 << 17;
/// Lines that are looked at to tell whether a text is one of columns.
const LINES_LOOKED_AT: usize = 2000;

/// Layout of the lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Columns {
    xyz: [usize; 3],
    separator: Separator,
}

/// Separator of the columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Separator {
    Space,
    Comma,
    Semicolon,
}

/// Kind of a line.
enum LineKind {
    Blank,
    Names(Names),
    Count,
    Point(Columns),
    Other,
}

/// Names of columns.
struct Names {
    columns: Columns,
    /// Number of names.
    count: usize,
    unit: Option<LengthUnit>,
}

impl Names {
    /// Columns of the points that follow on this line, the first of which is `first`, if it is at hand. `None` where it is a comment that
    /// names none: x, y and z are words of it, or names follow in a line of their own.
    fn columns(&self, line: Line<'_>, first: Option<&[u8]>) -> Result<Option<Columns>, MeshError> {
        let Columns { mut xyz, separator } = self.columns;
        let (Some(first), in_comment) = (first, is_comment(line.text)) else { return Ok(Some(self.columns)) };
        let separator = match kind_of(first) {
            LineKind::Names(_) if in_comment => return Ok(None),
            LineKind::Point(found) => found.separator,
            LineKind::Names(_) | LineKind::Blank | LineKind::Count | LineKind::Other => separator,
        };
        let (count, last) = (words(first, separator).count(), xyz[0].max(xyz[1]).max(xyz[2]));
        if in_comment && self.count != count && last > 2 {
            // Words before the names, as many as there are too many.
            let surplus = self.count.saturating_sub(count);
            if surplus == 0 {
                let expected = "a comment that names every column, or x, y and z first, or none of them";
                return Err(MeshError::Syntax { at: line.at(), expected, found: excerpt(line.text.trim_ascii()) });
            }
            if xyz.iter().any(|place| *place < surplus) {
                return Ok((last < count).then_some(Columns { xyz, separator }));
            }
            xyz = xyz.map(|place| place - surplus);
        }
        Ok(Some(Columns { xyz, separator }))
    }
}

/// Returns true if the text's first lines are comments, at most one line of names or a count, and then points.
pub(super) fn is_columns(head: &[u8], poll: &Poll<'_>) -> bool {
    if head.contains(&0) {
        return false;
    }
    let (mut headings, mut is_named) = (0, false);
    for line in Lines::new(without_mark(head), 1, poll).take(LINES_LOOKED_AT) {
        match kind_of(line.text) {
            LineKind::Blank => {}
            LineKind::Names(_) if is_comment(line.text) => is_named = true,
            LineKind::Names(_) | LineKind::Count if headings == 0 => headings += 1,
            LineKind::Point(_) => return true,
            LineKind::Names(_) | LineKind::Count | LineKind::Other => return false,
        }
    }
    headings > 0 || is_named
}

/// Reads all points, and the unit if the names state it.
pub(super) fn read(stream: &mut CloudStream<'_>, limits: &CloudLimits) -> Result<(Option<LengthUnit>, StoredCloud), CloudError> {
    let mark = stream.fill(3)?.starts_with(b"\xEF\xBB\xBF");
    stream.consume(if mark { 3 } else { 0 });
    let mut collected = Collected::new(0, false, limits)?;
    let (mut columns, mut unit, mut first_line) = (None, None, 1);
    loop {
        let length = stream.fill_lines()?;
        if length == 0 {
            return Ok((unit, collected.into_cloud(None)));
        }
        let mut text = &stream.window()[..length];
        if columns.is_none() {
            let found = find_columns(text, first_line, stream.poll)?;
            (columns, unit) = (found.columns, found.unit.or(unit));
            (text, first_line) = (&text[found.bytes..], first_line + found.lines);
        }
        if let Some(columns) = columns {
            first_line = collect(text, columns, first_line, &mut collected)?;
        }
        stream.consume(length);
    }
}

/// Begin of the points.
struct Begin {
    columns: Option<Columns>,
    unit: Option<LengthUnit>,
    bytes: usize,
    lines: u64,
}

fn find_columns(text: &[u8], first_line: u64, poll: &Poll<'_>) -> Result<Begin, CloudError> {
    let mut begin = Begin { columns: None, unit: None, bytes: 0, lines: 0 };
    // The line behind all comments, once it was sought.
    let mut first: Option<Option<&[u8]>> = None;
    let mut lines = Lines::new(text, first_line, poll);
    while let Some(line) = lines.next() {
        match kind_of(line.text) {
            LineKind::Blank | LineKind::Count => {}
            LineKind::Names(names) => {
                let find_point = || Lines::new(lines.rest(), 1, poll).find(|line| !is_comment(line.text)).map(|line| line.text);
                begin.columns = names.columns(line, *first.get_or_insert_with(find_point))?;
                begin.unit = names.unit.filter(|_| begin.columns.is_some());
            }
            LineKind::Point(columns) => {
                begin.columns = Some(columns);
                return Ok(begin);
            }
            LineKind::Other => {
                let found = excerpt(line.text.trim_ascii());
                return Err(
                    MeshError::Syntax { at: line.at(), expected: "three coordinates, or the names x, y, z", found }.into()
                );
            }
        }
        (begin.bytes, begin.lines) = (text.len() - lines.rest().len(), lines.number() + 1 - first_line);
        if begin.columns.is_some() {
            break;
        }
    }
    Ok(begin)
}

/// Parses lines side by side; returns the number of the line after them.
fn collect(text: &[u8], columns: Columns, first_line: u64, into: &mut Collected) -> Result<u64, CloudError> {
    let mut pieces = Vec::new();
    let mut rest = text;
    while !rest.is_empty() {
        let from = PIECE_BYTES.min(rest.len());
        // A piece ends behind an LF, or where there is none with the text: a CR alone may be half of a line's end.
        let end = rest[from..].iter().position(|byte| *byte == b'\n').map_or(rest.len(), |end| from + end + 1);
        let (piece, others) = rest.split_at(end);
        pieces.push(piece);
        rest = others;
    }
    let parsed: Vec<Parsed> = parallel::map(&pieces, |piece| parse(piece, columns));
    let mut line = first_line;
    for piece in parsed {
        for point in piece.points {
            into.push(point)?;
        }
        if let Some((local, error)) = piece.fault {
            return Err(at_line(error, line + local - 1).into());
        }
        line += piece.lines;
    }
    Ok(line)
}

/// Points of a piece up to its first fault.
struct Parsed {
    points: Vec<[f32; 3]>,
    lines: u64,
    fault: Option<(u64, MeshError)>,
}

fn parse(text: &[u8], columns: Columns) -> Parsed {
    let poll = Poll::never();
    let mut parsed = Parsed { points: Vec::with_capacity(text.len() / 24), lines: 0, fault: None };
    for line in Lines::new(text, 1, &poll) {
        parsed.lines = line.number;
        match point_of(line.text, columns, line.at()) {
            Ok(Some(point)) => parsed.points.push(point),
            Ok(None) => {}
            Err(error) => {
                parsed.fault = Some((line.number, error));
                break;
            }
        }
    }
    parsed
}

fn point_of(line: &[u8], columns: Columns, at: Position) -> Result<Option<[f32; 3]>, MeshError> {
    if is_comment(line) {
        return Ok(None);
    }
    let (mut point, mut found, mut place) = ([0.0_f32; 3], 0, 0);
    let last = columns.xyz[0].max(columns.xyz[1]).max(columns.xyz[2]);
    let mut words = words(line, columns.separator);
    while place <= last {
        let Some(word) = words.next() else { break };
        if let Some(axis) = columns.xyz.iter().position(|column| *column == place) {
            point[axis] = value(word, columns.separator, at)?;
            found += 1;
        }
        place += 1;
    }
    if found < 3 {
        return Err(MeshError::Syntax { at, expected: "three coordinates", found: excerpt(line.trim_ascii()) });
    }
    Ok(Some(point))
}

fn value(word: &[u8], separator: Separator, at: Position) -> Result<f32, MeshError> {
    if word.is_empty() {
        return Ok(f32::NAN);
    }
    if separator == Separator::Semicolon && word.contains(&b',') {
        let with_point: Vec<u8> = word.iter().map(|byte| if *byte == b',' { b'.' } else { *byte }).collect();
        return number(&with_point, at).map(|value| value as f32);
    }
    number(word, at).map(|value| value as f32)
}

fn words(line: &[u8], separator: Separator) -> impl Iterator<Item = &[u8]> {
    let split = move |byte: &u8| match separator {
        Separator::Space => byte.is_ascii_whitespace(),
        Separator::Comma => *byte == b',',
        Separator::Semicolon => *byte == b';',
    };
    let is_spaced = separator == Separator::Space;
    line.split(split).map(<[u8]>::trim_ascii).filter(move |word| !(is_spaced && word.is_empty()))
}

fn is_comment(line: &[u8]) -> bool {
    let line = line.trim_ascii_start();
    line.is_empty() || line.starts_with(b"//") || matches!(line[0], b'#' | b';' | b'!')
}

fn kind_of(line: &[u8]) -> LineKind {
    // A comment may hold the names of the columns, behind a word and a colon.
    let names = line.trim_ascii_start();
    let in_comment = names.strip_prefix(b"//").or_else(|| names.strip_prefix(b"#"));
    let names = in_comment.map_or(names, |text| text.rsplit(|byte| *byte == b':').next().unwrap_or(text));
    let separator = match names {
        _ if names.contains(&b';') => Separator::Semicolon,
        _ if names.contains(&b',') => Separator::Comma,
        _ => Separator::Space,
    };
    if let Some(names) = named_columns(names, separator) {
        return LineKind::Names(names);
    }
    if is_comment(line) {
        return LineKind::Blank;
    }
    let words: Vec<&[u8]> = words(line, separator).take(4).collect();
    let is_number = |word: &&[u8]| value(word, separator, Position::Line(1)).is_ok();
    match words[..] {
        [one] if one.iter().all(u8::is_ascii_digit) => LineKind::Count,
        [x, y, z, ..] if [x, y, z].iter().all(is_number) => LineKind::Point(Columns { xyz: [0, 1, 2], separator }),
        _ => LineKind::Other,
    }
}

/// Names of columns, x, y and z among them.
fn named_columns(line: &[u8], separator: Separator) -> Option<Names> {
    // A name such as `T [°C]` may be in any encoding.
    let text = Some(line).filter(|line| line.len() < 4096).map(|line| String::from_utf8_lossy(line).to_lowercase())?;
    let plain: Vec<String> = match separator {
        Separator::Space => spaced_names(&text),
        Separator::Comma => text.split(',').map(str::to_owned).collect(),
        Separator::Semicolon => text.split(';').map(str::to_owned).collect(),
    };
    let parts = plain.iter().map(|word| {
        let word = word.trim().trim_matches('"');
        let (name, unit) = word.split_once(['_', '[', '(', ' ']).unwrap_or((word, ""));
        (name.trim().to_owned(), unit.trim_matches(|c| "[]() ".contains(c)).to_owned())
    });
    let parts: Vec<(String, String)> = parts.collect();
    let place = |axis: &str| {
        parts.iter().position(|(name, unit)| name == axis && (unit.is_empty() || unit.parse::<LengthUnit>().is_ok()))
    };
    let xyz = [place("x")?, place("y")?, place("z")?];
    let count = parts.iter().rposition(|(name, _)| !name.is_empty()).map_or(0, |last| last + 1);
    Some(Names { columns: Columns { xyz, separator }, count, unit: parts[xyz[0]].1.parse().ok() })
}

/// Names that white space separates, each with its unit, which stands in brackets behind it.
fn spaced_names(text: &str) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match names.last_mut() {
            Some(name) if word.starts_with(['[', '(']) => name.push_str(word),
            _ => names.push(word.to_owned()),
        }
    }
    names
}

fn without_mark(text: &[u8]) -> &[u8] {
    text.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(text)
}

/// A fault of a piece, at its line in the file.
fn at_line(error: MeshError, line: u64) -> MeshError {
    let at = Position::Line(line);
    if let MeshError::Syntax { expected, found, .. } = error { MeshError::Syntax { at, expected, found } } else { error }
}

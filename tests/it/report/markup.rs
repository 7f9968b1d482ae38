//! A strict look at a page: is it well-formed, and what pictures does it hold.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

/// A decoded picture.
pub(crate) struct Picture {
    pub(crate) size_px: [usize; 2],
    rgba: Vec<u8>,
}

impl Picture {
    pub(crate) fn at(&self, x: usize, y: usize) -> [u8; 4] {
        let at = 4 * (y * self.size_px[0] + x);
        self.rgba[at..at + 4].try_into().expect("four channels")
    }
}

/// The pictures of a page, in order.
pub(crate) fn data_uris(page: &str) -> Vec<Picture> {
    page.split("src=\"data:image/png;base64,")
        .skip(1)
        .map(|rest| decode(rest.split('"').next().expect("a closing quote")))
        .collect()
}

fn decode(base64: &str) -> Picture {
    let bytes = STANDARD.decode(base64).expect("base64");
    let mut decoder = png::Decoder::new(std::io::Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info().expect("a PNG");
    let mut rgba = vec![0; reader.output_buffer_size().expect("a size")];
    let info = reader.next_frame(&mut rgba).expect("a frame");
    assert_eq!(info.color_type, png::ColorType::Rgba);
    Picture { size_px: [info.width as usize, info.height as usize], rgba }
}

/// Checks what XML asks for: tags balance, attributes are quoted and unique, `&` begins a reference, no stray `<`, no
/// forbidden character.
pub(crate) fn well_formed(page: &str) -> Result<(), String> {
    let mut open: Vec<&str> = Vec::new();
    let mut rest = page.strip_prefix("<!DOCTYPE html>").ok_or("no document type")?;
    if let Some(forbidden) =
        page.chars().find(|c| (c.is_control() && !matches!(c, '\n' | '\t' | '\r')) || matches!(c, '\u{fffe}' | '\u{ffff}'))
    {
        return Err(format!("forbidden character {forbidden:?}"));
    }
    while let Some(at) = rest.find('<') {
        let (text, tag) = rest.split_at(at);
        references(text)?;
        let (tag, after) = tag[1..].split_once('>').ok_or("a tag without end")?;
        rest = after;
        if let Some(name) = tag.strip_prefix('/') {
            let expected = open.pop();
            if expected != Some(name) {
                return Err(format!("</{name}> closes {expected:?}"));
            }
        } else if let Some(inner) = tag.strip_suffix('/') {
            attributes(inner)?;
        } else {
            open.push(attributes(tag)?);
        }
    }
    references(rest)?;
    if open.is_empty() { Ok(()) } else { Err(format!("left open: {open:?}")) }
}

/// Checks a tag's attributes and returns its name.
fn attributes(tag: &str) -> Result<&str, String> {
    let (name, mut rest) = tag.split_once(' ').unwrap_or((tag, ""));
    if name.is_empty() || !name.chars().all(|c| c.is_ascii_alphanumeric()) {
        return Err(format!("bad tag name {name:?}"));
    }
    let mut seen = Vec::new();
    while !rest.trim().is_empty() {
        let (key, value) = rest.trim_start().split_once("=\"").ok_or_else(|| format!("unquoted attribute in {tag:.60}"))?;
        let (value, after) = value.split_once('"').ok_or("an attribute without end")?;
        if seen.contains(&key) || !key.chars().all(|c| c.is_ascii_alphanumeric() || c == '-') || value.contains('<') {
            return Err(format!("bad attribute {key:?} in {tag:.60}"));
        }
        references(value)?;
        seen.push(key);
        rest = after;
    }
    Ok(name)
}

fn references(text: &str) -> Result<(), String> {
    for after in text.split('&').skip(1) {
        let name = after.split_once(';').map_or("", |(name, _)| name);
        if !matches!(name, "amp" | "lt" | "gt" | "quot" | "#39") {
            return Err(format!("bad reference &{after:.20}"));
        }
    }
    Ok(())
}

#[test]
fn the_check_refuses_what_is_not_well_formed() {
    let page = |body: &str| format!("<!DOCTYPE html><p>{body}</p>");
    assert_eq!(well_formed(&page("a <b>b</b> &amp; <br/>")), Ok(()));
    for bad in ["<b>", "</b>", "<b></i></b>", "a & b", "<img src=x/>", "<a b=\"1\" b=\"2\"/>", "<script x='1'/>", "\u{1}"] {
        assert!(well_formed(&page(bad)).is_err(), "{bad:?}");
    }
}

//! Lists of toleranced features, as read by `--features`: JSON, an array of the entries of `regions.features` or an object
//! with that array as `features`; or CSV with the columns `name`, `region`, `tolerance_mm`, and optionally
//! `point_spacing_mm` and `target`. In CSV a region is its kind and its values, in mm, separated by blanks:
//!
//! | region | |
//! | --- | --- |
//! | `name bore` | a group in the file |
//! | `faces 12 40-57` | faces of the file, counted from 0 |
//! | `box x y z x y z` | its two opposite corners |
//! | `sphere x y z radius` | its centre and radius |
//! | `half_space x y z nx ny nz` | a point on its plane, its outward normal |
//! | `plane x y z nx ny nz within` | a point, the normal, and the distance to either side |

use std::path::Path;

use super::CliError;
use super::files::{self, from_value, json_fault};
use crate::cell::decimal_comma_advice;
use crate::planning::params::{FeatureParams, Region};
use crate::wire::Distinct;
use crate::wire::words::counted;

#[cfg(test)]
mod tests;

const COLUMNS: [&str; 5] = ["name", "region", "tolerance_mm", "point_spacing_mm", "target"];

/// Reads a list of features.
///
/// # Errors
/// [`CliError::BadInput`] with the file, the line and the allowed values.
pub(super) fn read(path: &Path) -> Result<Vec<FeatureParams>, CliError> {
    let shown = path.display().to_string();
    parse(&files::text(path)?, &shown)
}

fn parse(text: &str, shown: &str) -> Result<Vec<FeatureParams>, CliError> {
    // Spreadsheets begin their UTF-8 with a byte order mark.
    let text = text.trim_start_matches('\u{feff}');
    if !text.trim_start().starts_with(['{', '[']) {
        return csv(text).map_err(|error| CliError::BadInput(format!("{shown}: {error}")));
    }
    let Distinct(mut value) =
        serde_json::from_str(text).map_err(|error| CliError::BadInput(format!("{shown}: {}", json_fault(text, &error))))?;
    let only_field = value.as_object_mut().filter(|fields| fields.len() == 1);
    let list = if let Some(field) = only_field { field.remove("features") } else { Some(value) };
    from_value(list.unwrap_or_default(), shown)
}

fn csv(text: &str) -> Result<Vec<FeatureParams>, String> {
    let mut lines = (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty());
    let (_, header) = lines.next().ok_or("is empty; the first line must name the columns")?;
    if header.contains(';') && !header.contains(',') {
        return Err("its columns are separated by semicolons; use commas, and a point as decimal separator".to_owned());
    }
    let columns = cells_of(header)?;
    if let Some(unknown) = columns.iter().find(|column| !COLUMNS.contains(&column.as_str())) {
        return Err(format!("has a column {unknown:?}; allowed are {}", COLUMNS.join(", ")));
    }
    if let Some(twice) = columns.iter().enumerate().find(|(at, column)| columns[..*at].contains(column)).map(|(_, column)| column)
    {
        return Err(format!("has the column {twice:?} twice"));
    }
    let mut lines = lines.peekable();
    lines.peek().ok_or("has no feature below the line that names the columns")?;
    lines.map(|(number, line)| feature(&columns, line).map_err(|error| format!("line {number}: {error}"))).collect()
}

/// Cells of a line (RFC 4180): one in quotes may hold commas, and a quote as two.
fn cells_of(line: &str) -> Result<Vec<String>, String> {
    let (mut cells, mut rest) = (Vec::new(), line);
    loop {
        let Some(quoted) = rest.trim_start().strip_prefix('"') else {
            let (cell, after) = rest.split_once(',').map_or((rest, None), |(cell, after)| (cell, Some(after)));
            cells.push(cell.trim().to_owned());
            let Some(after) = after else { return Ok(cells) };
            rest = after;
            continue;
        };
        let mut cell = String::new();
        let mut after = quoted;
        loop {
            let (text, behind) = after.split_once('"').ok_or("has an unclosed quote")?;
            cell.push_str(text);
            match behind.strip_prefix('"') {
                Some(behind) => {
                    cell.push('"');
                    after = behind;
                }
                None => {
                    after = behind.trim_start();
                    break;
                }
            }
        }
        cells.push(cell);
        match after.strip_prefix(',') {
            Some(after) => rest = after,
            None if after.is_empty() => return Ok(cells),
            None => return Err(format!("has {after:?} after a closing quote; allowed is a comma")),
        }
    }
}

fn feature(columns: &[String], line: &str) -> Result<FeatureParams, String> {
    let cells = cells_of(line)?;
    if cells.len() != columns.len() {
        return Err(format!("has {}; the header has {}", counted(cells.len(), "cell"), columns.len()));
    }
    let cell = |name: &str| {
        columns.iter().position(|column| *column == name).map(|at| cells[at].as_str()).filter(|cell| !cell.is_empty())
    };
    let optional = |name: &str| cell(name).map(|text| number(text).map_err(|error| format!("{name} {error}"))).transpose();
    Ok(FeatureParams {
        name: cell("name").map(str::to_owned),
        region: region(cell("region").ok_or("has no region")?)?,
        tolerance_mm: optional("tolerance_mm")?.ok_or("has no tolerance_mm")?,
        point_spacing_mm: optional("point_spacing_mm")?,
        target: optional("target")?,
    })
}

fn number(text: &str) -> Result<f64, String> {
    text.parse().map_err(|_| format!("is {text:?}; allowed is a number{}", decimal_comma_advice(text)))
}

fn region(text: &str) -> Result<Region, String> {
    let (kind, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
    let numbers =
        || rest.split_whitespace().map(number).collect::<Result<Vec<f64>, _>>().map_err(|error| format!("region {error}"));
    let point = |numbers: &[f64], first: usize| [0, 1, 2].map(|axis| numbers[first + axis]);
    let taking = |count: usize| {
        let numbers = numbers()?;
        let wrong = || format!("region {kind} has {}; it takes {count}", counted(numbers.len(), "number"));
        if numbers.len() == count { Ok(numbers) } else { Err(wrong()) }
    };
    Ok(match kind {
        "name" => Region::Name { name: rest.trim().to_owned() },
        "faces" => Region::Faces { faces: faces(rest)? },
        "box" => taking(6).map(|n| Region::Box { min_mm: point(&n, 0), max_mm: point(&n, 3) })?,
        "sphere" => taking(4).map(|n| Region::Sphere { centre_mm: point(&n, 0), radius_mm: n[3] })?,
        "half_space" => taking(6).map(|n| Region::HalfSpace { point_mm: point(&n, 0), normal: point(&n, 3) })?,
        "plane" => taking(7).map(|n| Region::Plane { point_mm: point(&n, 0), normal: point(&n, 3), within_mm: n[6] })?,
        _ => return Err(format!("region is of kind {kind:?}; allowed are name, faces, box, sphere, half_space, plane")),
    })
}

/// Parses face numbers and ranges of them.
fn faces(text: &str) -> Result<Vec<u32>, String> {
    /// Maximum number of faces on one line.
    const MAX_FACES: usize = 10_000_000;
    let mut faces = Vec::new();
    for part in text.split_whitespace() {
        let wrong = || format!("region faces has {part:?}; allowed are numbers from 0 and ranges such as 40-57");
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let (first, last): (u32, u32) = (first.parse().map_err(|_| wrong())?, last.parse().map_err(|_| wrong())?);
        if first > last || (last - first) as usize >= MAX_FACES - faces.len() {
            return Err(wrong());
        }
        faces.extend(first..=last);
    }
    Ok(faces)
}

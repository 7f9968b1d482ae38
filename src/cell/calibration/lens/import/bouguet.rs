//! Bouguet's *Camera Calibration Toolbox for Matlab* (2015): assignments of numbers, as in `Calib_Results.m`, and of both cameras
//! of a stereo result under the names of its `.mat` file. Uncertainties are three standard deviations ("Calibration
//! parameters": "approximately three times the standard deviations"). Zeros there mean that none were kept.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Matrix3};

use super::super::fault::{LensError, LensFault};
use super::super::model::LENS;
use super::{ImportedFile, ImportedLens, any_rotation, image_size, of_matrix, pose};
use crate::cell::DeviceName;
use crate::geometry::counted;

/// Standard deviations in an uncertainty of the toolbox.
const SIGMAS: f64 = 3.0;
/// Most numbers of one assignment.
const MAX_NUMBERS: usize = 100_000;

/// Right-hand sides by their names, by rows.
type Assignments = BTreeMap<String, Vec<f64>>;

pub(super) fn read(text: &str) -> Result<ImportedFile, LensError> {
    let values = assignments(text)?;
    let mut file = ImportedFile::default();
    for (suffix, device) in [("_left", Some(DeviceName::Left)), ("_right", Some(DeviceName::Right)), ("", None)] {
        if !values.contains_key(&format!("fc{suffix}")) {
            continue;
        }
        let place = file.lenses.len();
        file.lenses.push(ImportedLens { device, ..lens(&values, suffix)? });
        let boards = boards(&values, suffix)?;
        if !boards.is_empty() {
            file.boards.push((place, boards));
        }
    }
    if file.lenses.is_empty() {
        return Err(LensError::new(LensFault::MissingField, "fc", "is missing; give the focal length in pixels"));
    }
    let rotation = ["om", "R"].into_iter().find_map(|name| values.get(name).map(|rotation| (name, rotation)));
    if let (Some((name, rotation)), Some(translation)) = (rotation, values.get("T")) {
        file.right_from_left = Some(pose(any_rotation(rotation, name)?, translation, "T")?);
    }
    Ok(file)
}

fn list<'a>(values: &'a Assignments, name: &str, counts: &[usize]) -> Result<&'a [f64], LensError> {
    let list = values.get(name).ok_or_else(|| LensError::new(LensFault::MissingField, name, "is missing"))?;
    if counts.contains(&list.len()) {
        return Ok(list);
    }
    let detail = format!("has {}; allowed are {counts:?}", counted(list.len(), "number"));
    Err(LensError::new(LensFault::WrongShape, name, detail))
}

fn lens(values: &Assignments, suffix: &str) -> Result<ImportedLens, LensError> {
    let name = |name: &str| format!("{name}{suffix}");
    let (focal, centre) = (list(values, &name("fc"), &[2])?, list(values, &name("cc"), &[2])?);
    let distortion = list(values, &name("kc"), &[4, 5])?;
    let skew = values.get(&name("alpha_c")).and_then(|list| list.first()).copied().unwrap_or(0.0);
    let single = |name: &str| values.get(name).and_then(|list| list.first()).copied();
    let size = |axis: &str| single(&name(axis)).or_else(|| single(axis));
    let size_px = match (size("nx"), size("ny")) {
        (Some(width), Some(height)) => Some(image_size(width, height, "nx")?),
        _ => None,
    };
    let matrix = Matrix3::new(focal[0], focal[0] * skew, centre[0], 0.0, focal[1], centre[1], 0.0, 0.0, 1.0);
    let mut lens = ImportedLens::new(of_matrix(&matrix, distortion, size_px, &name("kc"))?);
    lens.lens.skew = skew;
    lens.sigma = sigma(values, suffix);
    Ok(lens)
}

/// Standard deviations; `None` where one is missing or all of them are 0, which are those that were not kept.
fn sigma(values: &Assignments, suffix: &str) -> Option<[f64; LENS]> {
    let list = |name: &str| values.get(&format!("{name}_error{suffix}"));
    let (focal, centre, distortion) = (list("fc")?, list("cc")?, list("kc")?);
    let skew = list("alpha_c").and_then(|list| list.first()).copied().unwrap_or(0.0);
    let at = |list: &Vec<f64>, index: usize| list.get(index).copied().unwrap_or(0.0);
    let k: [f64; 5] = std::array::from_fn(|index| at(distortion, index));
    let three = [at(focal, 0), at(focal, 1), at(centre, 0), at(centre, 1), skew, k[0], k[1], k[2], k[3], k[4]];
    three.iter().any(|value| *value > 0.0).then(|| three.map(|value| value / SIGMAS))
}

/// Poses of boards: `omc_1` or `Rc_1` with `Tc_1`; without a number that of the first view.
fn boards(values: &Assignments, suffix: &str) -> Result<BTreeMap<u32, Isometry3<f64>>, LensError> {
    let prefixed = values.range(format!("Tc{suffix}")..).take_while(|(name, _)| name.starts_with(&format!("Tc{suffix}")));
    let mut boards = BTreeMap::new();
    for (name, translation) in prefixed {
        let end = &name[2 + suffix.len()..];
        let Some(number) = (if end.is_empty() { Some(1) } else { end.strip_prefix('_').and_then(|n| n.parse().ok()) }) else {
            continue;
        };
        let named = ["omc", "Rc"].into_iter().find_map(|kind| {
            let name = format!("{kind}{suffix}{end}");
            values.get(&name).map(|rotation| (name, rotation))
        });
        let Some((rotation_name, rotation)) = named else {
            let detail = format!("is missing beside {name}");
            return Err(LensError::new(LensFault::MissingField, format!("omc{suffix}{end}"), detail));
        };
        // Views that were switched off have numbers that are none.
        if translation.iter().chain(rotation).all(|value| value.is_finite()) {
            boards.insert(number, pose(any_rotation(rotation, &rotation_name)?, translation, name)?);
        }
    }
    Ok(boards)
}

/// Assignments of numbers; other statements are passed over.
fn assignments(text: &str) -> Result<Assignments, LensError> {
    let uncommented: Vec<&str> = text.lines().map(|line| line.split('%').next().unwrap_or_default()).collect();
    let joined = uncommented.join("\n").replace("...\n", " ");
    let mut values = Assignments::new();
    let mut rest = joined.as_str();
    while let Some((before, after)) = rest.split_once('=') {
        let name = before.rsplit(|c: char| !(c.is_ascii_alphanumeric() || c == '_' || c == ' ')).next().unwrap_or_default();
        let name = name.split_whitespace().last().unwrap_or_default();
        let after = after.trim_start_matches([' ', '\t']);
        let (body, tail) = match after.strip_prefix('[') {
            Some(list) => list
                .split_once(']')
                .ok_or_else(|| LensError::new(LensFault::Unreadable, name, "has a bracket that is not closed"))?,
            None => after.split_at(after.find([';', '\n']).unwrap_or(after.len())),
        };
        rest = tail;
        let numbers: Option<Vec<f64>> =
            body.split([' ', '\t', ',', ';', '\n', '\r']).filter(|word| !word.is_empty()).map(number).collect();
        let Some(numbers) = numbers.filter(|numbers| !numbers.is_empty()) else { continue };
        if numbers.len() > MAX_NUMBERS {
            return Err(LensError::new(
                LensFault::TooLarge,
                name,
                format!("has {} numbers; allowed are {MAX_NUMBERS}", numbers.len()),
            ));
        }
        if !name.is_empty() && values.insert(name.to_owned(), numbers).is_some() {
            return Err(LensError::new(LensFault::Inconsistent, name, "is given twice"));
        }
    }
    Ok(values)
}

fn number(word: &str) -> Option<f64> {
    word.parse().ok()
}

//! Faces and groups that a request names in regions, held against the stored report of the part's mesh: its file is not read. A
//! report does not tell everything, so the job may still refuse some that are accepted here.

use crate::cell::FieldError;
use crate::planning::params::{PlanParams, Region};
use crate::service::library::FacesInFile;

/// Errors on faces and groups that the part's file certainly does not have, except for fields with errors that are known.
pub(super) fn absent(params: &PlanParams, file: &FacesInFile, known: &[FieldError]) -> Vec<FieldError> {
    let regions = &params.regions;
    let exclude = regions.exclude.iter().enumerate().map(|(i, region)| (format!("/params/regions/exclude/{i}"), region));
    let interest =
        regions.interest.iter().enumerate().map(|(i, of)| (format!("/params/regions/interest/{i}/region"), &of.region));
    let features =
        regions.features.iter().enumerate().map(|(i, of)| (format!("/params/regions/features/{i}/region"), &of.region));
    let materials = params.materials.regions.iter().enumerate();
    let materials = materials.map(|(i, of)| (format!("/params/materials/regions/{i}/region"), &of.region));
    let all = exclude.chain(interest).chain(features).chain(materials);
    let errors = all.filter_map(|(at, region)| error_on(region, &at, file));
    errors.filter(|error| known.iter().all(|known| !known.pointer.starts_with(&error.pointer))).collect()
}

/// The error on a region, in the words of the planner.
fn error_on(region: &Region, at: &str, file: &FacesInFile) -> Option<FieldError> {
    match region {
        Region::Faces { faces } => {
            let beyond = faces.iter().find(|face| **face as usize >= file.triangles)?;
            let at_most = if file.may_be_polygons { " at most" } else { "" };
            let detail = format!("names face {beyond}; the file's faces are 0 to {}{at_most}", file.triangles.saturating_sub(1));
            Some(FieldError { pointer: format!("{at}/faces"), detail })
        }
        Region::Name { name } => {
            let none = || "the file has no named groups".to_owned();
            let groups = match &file.group_names {
                Some(groups) if groups.contains(name) => return None,
                Some(groups) if !groups.is_empty() => format!("the file's groups are {}", first_names(groups)),
                Some(_) => none(),
                None if file.may_be_grouped => return None,
                None => none(),
            };
            Some(FieldError { pointer: format!("{at}/name"), detail: format!("is {name:?}; {groups}") })
        }
        Region::Box { .. } | Region::Sphere { .. } | Region::HalfSpace { .. } | Region::Plane { .. } => None,
    }
}

/// The first names of groups, as many as the planner tells.
fn first_names(groups: &[String]) -> String {
    groups.iter().map(String::as_str).take(20).collect::<Vec<_>>().join(", ")
}

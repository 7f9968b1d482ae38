//! Regions of the surface: excluded regions, regions of interest, and features with
//! tolerances. All in part coordinates, mm.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::knob::params;
use crate::cell::{Findings, field_ranges};
use crate::planning::verdict::Grade;

/// Largest number of regions of interest and features of one job.
const MAX_REGIONS: usize = 10_000;
/// Standard deviations that an expanded uncertainty of k = 2 spans to both sides.
const SIGMAS: f64 = 4.0;

params! {
    /// Excluded regions, regions of interest and toleranced features.
    RegionParams {
        /// Regions that need not be measured: clamped, resting or of no interest. A face list or a name excludes whole faces, the
        /// other kinds exclude the samples inside them.
        exclude: Vec<Region> = Vec::new();
        /// Regions with a weight, a target or limits of their own.
        interest: Vec<InterestParams> = Vec::new();
        /// Toleranced features. The quality at which each must be measured follows from its tolerance and from `noise`.
        features: Vec<FeatureParams> = Vec::new();
        /// Expected noise of a measured point, with which the tolerances of features are compared.
        noise: NoiseParams = NoiseParams::default();
    }
}

/// Largest number of a face: the largest of the API document's `int32`, and beyond those of any mesh that is read.
const MAX_FACE: u32 = i32::MAX as u32;

/// A region of the part, in part coordinates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields, expecting = "an object")]
pub enum Region {
    /// Faces of the uploaded file, counted from 0.
    Faces {
        /// Face numbers.
        faces: Vec<u32>,
    },
    /// Axis-aligned box.
    Box {
        /// Lowest corner, mm.
        #[schema(min_items = 3, max_items = 3)]
        min_mm: [f64; 3],
        /// Highest corner, mm.
        #[schema(min_items = 3, max_items = 3)]
        max_mm: [f64; 3],
    },
    /// Ball.
    Sphere {
        /// Centre, mm.
        #[schema(min_items = 3, max_items = 3)]
        centre_mm: [f64; 3],
        /// Radius, mm, above 0.
        radius_mm: f64,
    },
    /// All points p with (p − point)·normal ≤ 0.
    HalfSpace {
        /// A point of the plane, mm.
        #[schema(min_items = 3, max_items = 3)]
        point_mm: [f64; 3],
        /// Outward direction, any length above 0.
        #[schema(min_items = 3, max_items = 3)]
        normal: [f64; 3],
    },
    /// All points within a distance of a plane.
    Plane {
        /// A point of the plane, mm.
        #[schema(min_items = 3, max_items = 3)]
        point_mm: [f64; 3],
        /// Direction across the plane, any length above 0.
        #[schema(min_items = 3, max_items = 3)]
        normal: [f64; 3],
        /// Distance to either side, mm, above 0.
        within_mm: f64,
    },
    /// A named group of the file (`g` and `o` lines of OBJ).
    Name {
        /// The group's name.
        name: String,
    },
}

params! {
    /// Region of interest. If several contain a sample, the largest weight and the strictest limits apply.
    required InterestParams {
        /// Name in the plan and the report, which no other region of interest or feature may have. Default: `interest` and its
        /// number.
        #[serde(default)]
        name: Option<String>;
        /// Region of the surface.
        region: Region;
        /// Weight of the region's area in the score; elsewhere it is 1. A larger weight favours views of this region. Targets
        /// ignore weights.
        #[serde(default = "one")]
        #[schema(default = one)]
        weight: f64, [0.0, 100.0] "";
        /// Share of the region's asked area to measure, besides the plan's own target; a plan that falls short of it says so.
        /// Default: no target of its own.
        #[serde(default)]
        target: Option<f64>, [0.0, 1.0] "";
        /// Maximum angle between the surface normal and the ray to either camera in this region, degrees; no more than each
        /// camera's own limit. Default: the job's limit.
        #[serde(default)]
        camera_deg: Option<f64>, [1.0, 89.9] "°";
        /// Maximum angle between the surface normal and the projector ray in this region, degrees; no more than the projector's
        /// own limit. Default: the job's limit.
        #[serde(default)]
        projector_deg: Option<f64>, [1.0, 89.9] "°";
        /// Lowest grade at which area of this region counts as measured. Default: `selection.min_grade`.
        #[serde(default)]
        min_grade: Option<Grade>;
    }
}

params! {
    /// Toleranced feature: an entry of a `features.json` or a row of a CSV file.
    required FeatureParams {
        /// Name in the plan and the report, which no other region of interest or feature may have. Default: `feature` and its
        /// number.
        #[serde(default)]
        name: Option<String>;
        /// Region that must keep the tolerance.
        region: Region;
        /// Width of the tolerance zone from limit to limit, mm: 0.3 for ±0.15 mm in a drawing. A feature whose tolerance is below
        /// 4 · `noise.best_mm` / `noise.budget` (0.156 mm by default) is accepted with a warning, but none of it counts as
        /// measured: even at best, the noise is too large for it.
        tolerance_mm: f64, [0.001, 100.0] "mm";
        /// Maximum distance between measured points on the surface, mm. Default: no limit.
        #[serde(default)]
        point_spacing_mm: Option<f64>, [0.01, 100.0] "mm";
        /// Share of the feature's asked area to measure at that quality; a plan that falls short of it says so. Default: no
        /// target of its own.
        #[serde(default)]
        target: Option<f64>, [0.0, 1.0] "";
    }
}

params! {
    /// Expected noise of a measured point ([`crate::planning::surface::requirements`]). It grows with the distance from best
    /// focus and with the incidence.
    NoiseParams {
        /// Standard deviation of a point along the surface normal, at best focus and normal incidence, mm. The default is a third
        /// of the TransCAN C's single-shot accuracy of 0.035 mm (thesis, Table 4.3), which is taken as three sigma.
        best_mm: f64 = 0.035 / 3.0, [1e-4, 10.0] "mm";
        /// Relative increase of the noise from best focus to the ends of the working depth; 1 doubles it. The default is our
        /// choice: no figure is known for this scanner.
        depth_gain: f64 = 1.0, [0.0, 100.0] "";
        /// Share of the tolerance that the expanded uncertainty to both sides, four sigma, may take. A larger share accepts finer
        /// tolerances. The default is what VDA Volume 5 recommends for a measurement process; taking the noise for the whole
        /// uncertainty is our choice.
        budget: f64 = 0.3, [0.01, 1.0] "";
    }
}

fn one() -> f64 {
    1.0
}

impl NoiseParams {
    /// Largest noise with which a feature of this tolerance is measured, mm: budget · T / 4.
    #[must_use]
    pub fn max_noise_mm(&self, tolerance_mm: f64) -> f64 {
        self.budget * tolerance_mm / SIGMAS
    }

    /// Finest tolerance that can be served, mm: 4 σ_F / budget, at a point that is seen straight on at the best focus.
    #[must_use]
    pub fn min_tolerance_mm(&self) -> f64 {
        SIGMAS * self.best_mm / self.budget
    }

    /// Returns true if no point can be measured with so little noise, wherever it is seen from.
    #[must_use]
    pub fn exceeds(&self, max_noise_mm: f64) -> bool {
        self.best_mm > max_noise_mm
    }
}

impl RegionParams {
    /// Features of a finer tolerance than the noise allows anywhere, each with its place in the list.
    pub fn beyond_noise(&self) -> impl Iterator<Item = (usize, &FeatureParams)> {
        let is_beyond = |feature: &FeatureParams| self.noise.exceeds(self.noise.max_noise_mm(feature.tolerance_mm));
        self.features.iter().enumerate().filter(move |(_, feature)| is_beyond(feature))
    }

    pub(super) fn check(&self, findings: &mut Findings) {
        for (index, region) in self.exclude.iter().enumerate() {
            region.check(&format!("/regions/exclude/{index}"), findings);
        }
        let count = self.interest.len() + self.features.len();
        findings.require(count <= MAX_REGIONS, "/regions/interest", || {
            format!("and /regions/features have {count} entries together; allowed are {MAX_REGIONS}")
        });
        for (index, interest) in self.interest.iter().enumerate() {
            interest.check(&format!("/regions/interest/{index}"), findings);
        }
        for (index, feature) in self.features.iter().enumerate() {
            feature.check(&format!("/regions/features/{index}"), findings);
        }
        self.check_ranges("/regions", findings);
        self.noise.check_ranges("/regions/noise", findings);
    }

    /// Requires a name of its own of each region of interest and feature: results tell them apart by their names alone.
    pub(super) fn check_names(&self, findings: &mut Findings) {
        let interest = self.interest.iter().enumerate();
        let interest = interest.map(|(index, region)| ("interest", index, region.name.is_some(), region.name_at(index)));
        let features = self.features.iter().enumerate();
        let features = features.map(|(index, feature)| ("features", index, feature.name.is_some(), feature.name_at(index)));
        let mut first_of = BTreeMap::new();
        for (list, index, is_given, name) in interest.chain(features) {
            match first_of.entry(name) {
                Entry::Vacant(entry) => {
                    entry.insert((list, index));
                }
                Entry::Occupied(entry) => {
                    let (name, (first_list, first_index)) = (entry.key(), entry.get());
                    let by_default = if is_given { "" } else { " by default" };
                    let detail = format!(
                        "is {name:?}{by_default}, which is the name of regions.{first_list}[{first_index}] too; give each region \
                         of interest and each feature a name of its own"
                    );
                    findings.push(format!("/regions/{list}/{index}/name"), detail);
                }
            }
        }
    }
}

impl InterestParams {
    /// Name of the region at a place of its list.
    pub(in crate::planning) fn name_at(&self, index: usize) -> String {
        self.name.clone().unwrap_or_else(|| format!("interest {}", index + 1))
    }

    fn check(&self, at: &str, findings: &mut Findings) {
        self.region.check(&format!("{at}/region"), findings);
        self.check_ranges(at, findings);
    }
}

impl FeatureParams {
    /// Name of the feature at a place of its list.
    pub(in crate::planning) fn name_at(&self, index: usize) -> String {
        self.name.clone().unwrap_or_else(|| format!("feature {}", index + 1))
    }

    fn check(&self, at: &str, findings: &mut Findings) {
        self.region.check(&format!("{at}/region"), findings);
        self.check_ranges(at, findings);
    }
}

field_ranges! {
    Region {
        FACES = "faces", [0.0, MAX_FACE as f64] "";
        RADIUS_MM = "radius_mm", [1e-6, 1e5] "mm";
        WITHIN_MM = "within_mm", [1e-6, 1e5] "mm";
    }
}

impl Region {
    pub(super) fn check(&self, at: &str, findings: &mut Findings) {
        let direction = |normal: &[f64; 3], findings: &mut Findings| {
            findings.require(normal.iter().any(|c| *c != 0.0), format!("{at}/normal"), || "is zero; give a direction".into());
        };
        match self {
            Self::Faces { faces } => {
                findings.require(!faces.is_empty(), format!("{at}/faces"), || "is empty; name at least one face".into());
                for (place, face) in faces.iter().enumerate().filter(|(_, face)| **face > MAX_FACE) {
                    let detail = || format!("is {face}; faces are numbered from 0 to {MAX_FACE} at most");
                    findings.require(false, format!("{at}/faces/{place}"), detail);
                }
            }
            Self::Box { min_mm, max_mm } => {
                findings.require((0..3).all(|i| min_mm[i] <= max_mm[i]), format!("{at}/min_mm"), || {
                    format!("is {min_mm:?}; no coordinate may exceed that of max_mm, {max_mm:?}")
                });
            }
            Self::Sphere { radius_mm, .. } => Self::RADIUS_MM.check(at, radius_mm, findings),
            Self::HalfSpace { normal, .. } => direction(normal, findings),
            Self::Plane { normal, within_mm, .. } => {
                direction(normal, findings);
                Self::WITHIN_MM.check(at, within_mm, findings);
            }
            Self::Name { name } => {
                findings.require(!name.is_empty(), format!("{at}/name"), || "is empty; name a group in the file".into());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ball() -> Region {
        Region::Sphere { centre_mm: [0.0; 3], radius_mm: 1.0 }
    }

    fn interest(name: Option<&str>) -> InterestParams {
        let name = name.map(str::to_owned);
        InterestParams { name, region: ball(), weight: 1.0, target: None, camera_deg: None, projector_deg: None, min_grade: None }
    }

    fn feature(name: Option<&str>) -> FeatureParams {
        let name = name.map(str::to_owned);
        FeatureParams { name, region: ball(), tolerance_mm: 0.5, point_spacing_mm: None, target: None }
    }

    /// Findings on regions of interest and features, each in a sentence that begins with its pointer.
    fn found(interest: Vec<InterestParams>, features: Vec<FeatureParams>) -> Vec<String> {
        let mut findings = Findings::default();
        let regions = RegionParams { interest, features, ..RegionParams::default() };
        regions.check(&mut findings);
        regions.check_names(&mut findings);
        findings.into_result().err().unwrap_or_default().iter().map(ToString::to_string).collect()
    }

    /// Two of one name were taken, and nobody could tell which of them a result was of.
    #[test]
    fn regions_and_features_of_one_name_are_refused_with_both() {
        let features = vec![feature(Some("rim")), feature(None), feature(None), feature(Some("Rim"))];
        assert_eq!(found(vec![interest(Some("seat")), interest(None)], features), Vec::<String>::new());
        let features = vec![feature(Some("rim")), feature(Some("bore"))];
        assert_eq!(
            found(vec![interest(Some("bore"))], features),
            ["/regions/features/1/name: is \"bore\", which is the name of regions.interest[0] too; give each region of \
              interest and each feature a name of its own"]
        );
        let told = found(vec![interest(Some("interest 2")), interest(None), interest(Some("interest 2"))], Vec::new());
        assert_eq!(told.len(), 2, "{told:#?}");
        assert!(
            told[0].starts_with("/regions/interest/1/name: is \"interest 2\" by default, which is the name of regions.int"),
            "{told:#?}"
        );
        assert!(told[1].starts_with("/regions/interest/2/name: is \"interest 2\", which"), "{told:#?}");
    }
}

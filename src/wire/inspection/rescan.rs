//! State of a part between two rounds of scans (`vantage.rescan_state/1`): what is measured, what no further view mends, and how often
//! the scanner returns what it sees.

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::learned::RateBinDocument;
use crate::cell::FieldError;
use crate::inspection::Inspection;
use crate::inspection::identification::{RateBin, RateCurve, ReturnModel};
use crate::inspection::rescan::hopeless;
use crate::planning::params::{PlanParams, RescanParams, TargetOf};
use crate::planning::visibility::SampleSet;
use crate::wire::plan::PlanDocument;

/// Schema name in the document.
const RESCAN_STATE_SCHEMA: &str = "vantage.rescan_state/1";

/// Rate of return along an axis.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RateCurveDocument {
    /// Counts.
    pub bins: Vec<RateBinDocument>,
    /// Places and rates, ascending: degrees or mm, and 0 to 1.
    pub points: Vec<[f64; 2]>,
}

/// State of a part between two rounds of scans.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RescanState {
    /// Schema name, `vantage.rescan_state/1`.
    pub schema: String,
    /// SHA-256 of the bytes of the first round's `plan.json`.
    pub plan_sha256: String,
    /// Parameters of the first round's plan.
    pub plan_params: PlanParams,
    /// Area of which the plan's target is a share, mm².
    pub target_of_mm2: f64,
    /// Rescans that were made.
    pub rounds: u32,
    /// True if the scans do not fit the part: what they measured of it is not known.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_not_found: bool,
    /// Number of samples; `null` in states from before it was introduced.
    #[serde(default)]
    pub samples: Option<usize>,
    /// Samples that scans have measured: bits, 64 a word, little-endian, in Base64.
    pub measured: String,
    /// Samples that no further view mends, likewise.
    pub hopeless: String,
    /// Rate of easy pairs.
    pub easy_rate: f64,
    /// Rate of return by worst incidence.
    pub by_incidence: RateCurveDocument,
    /// Rate of return by mirror angle.
    pub by_mirror: RateCurveDocument,
    /// Rate of return by depth.
    pub by_depth: RateCurveDocument,
}

/// Request for a rescan. Unknown fields are refused.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields, expecting = "an object")]
pub struct RescanRequest {
    /// Stopping rules of the rescan.
    pub params: RescanParams,
}

fn other_samples(found: usize, own: usize) -> String {
    format!(
        "is of {found} samples, but this part has {own}: it is from another part or another release; compare the first round's \
         scans with their plan again"
    )
}

fn bits(samples: &SampleSet) -> String {
    let bytes: Vec<u8> = samples.words().iter().flat_map(|word| word.to_le_bytes()).collect();
    BASE64_STANDARD.encode(bytes)
}

fn samples(text: &str, pointer: &str) -> Result<SampleSet, FieldError> {
    let refuse = || FieldError { pointer: pointer.to_owned(), detail: "is not Base64 of whole words of 8 bytes".to_owned() };
    let bytes = BASE64_STANDARD.decode(text).map_err(|_| refuse())?;
    if bytes.len() % 8 != 0 {
        return Err(refuse());
    }
    let word = |bytes: &[u8]| bytes.iter().rev().fold(0, |word: u64, byte| word << 8 | u64::from(*byte));
    Ok(SampleSet::from_words(bytes.chunks_exact(8).map(word).collect()))
}

impl From<&RateCurve> for RateCurveDocument {
    fn from(curve: &RateCurve) -> Self {
        Self { bins: curve.bins.iter().map(RateBinDocument::from).collect(), points: curve.points.clone() }
    }
}

impl From<&RateCurveDocument> for RateCurve {
    fn from(document: &RateCurveDocument) -> Self {
        let bin = |bin: &RateBinDocument| RateBin { range: bin.range, expected: bin.expected, returned: bin.returned };
        Self { bins: document.bins.iter().map(bin).collect(), points: document.points.clone() }
    }
}

impl RescanState {
    /// State after an inspection; `before` is that of the round before, whose samples stay measured.
    #[must_use]
    pub fn new(inspection: &Inspection, plan: &PlanDocument, plan_sha256: &str, before: Option<&Self>) -> Self {
        let mut measured = inspection.coverage.measured.clone();
        let mut hopeless = hopeless(&inspection.losses, inspection.surface.sample_mm.len());
        // What was told by an alignment that was not found is not taken over.
        let known = before.filter(|before| !before.is_not_found);
        if let Some(known) = known {
            known.add_to(&mut measured, &mut hopeless);
        }
        let returns = inspection.learned.as_ref().and_then(|learned| learned.returns.as_ref());
        let model = returns.map(|returns| returns.model.clone()).or_else(|| known.map(Self::model)).unwrap_or_default();
        let first = |of: fn(&Self) -> &str, own: &str| before.map_or_else(|| own.to_owned(), |before| of(before).to_owned());
        let params = &plan.params;
        let coverage = &plan.coverage;
        let target_of_mm2 = match params.selection.target_of {
            TargetOf::Coverable => coverage.coverable_area_mm2,
            TargetOf::Asked => coverage.asked_area_mm2,
            TargetOf::Total => plan.part.area_mm2,
        };
        Self {
            schema: RESCAN_STATE_SCHEMA.to_owned(),
            plan_sha256: first(|before| &before.plan_sha256, plan_sha256),
            plan_params: before.map_or_else(|| params.clone(), |before| before.plan_params.clone()),
            target_of_mm2: before.map_or(target_of_mm2, |before| before.target_of_mm2),
            rounds: before.map_or(0, |before| before.rounds + 1),
            is_not_found: !inspection.registration.fits(),
            samples: Some(inspection.surface.sample_mm.len()),
            measured: bits(&measured),
            hopeless: bits(&hopeless),
            easy_rate: model.easy_rate,
            by_incidence: RateCurveDocument::from(&model.incidence),
            by_mirror: RateCurveDocument::from(&model.mirror),
            by_depth: RateCurveDocument::from(&model.depth),
        }
    }

    /// Adds what earlier rounds measured, and what no view mends by them: the losses of a round are of what that round planned.
    /// States of another number of samples add nothing.
    fn add_to(&self, measured: &mut SampleSet, hopeless: &mut SampleSet) {
        for (set, known) in [(&mut *measured, &self.measured), (&mut *hopeless, &self.hopeless)] {
            let known = samples(known, "").ok().filter(|known| known.words().len() == set.words().len());
            known.into_iter().for_each(|known| set.insert_all(&known));
        }
        hopeless.remove_all(measured);
    }

    /// Refuses a state of scans that do not fit the part.
    ///
    /// # Errors
    /// The finding.
    pub fn check_found(&self) -> Result<(), FieldError> {
        let detail = "is true: these scans do not fit the part (alignment not found); compare scans of this part first";
        let refused = || FieldError { pointer: "/is_not_found".to_owned(), detail: detail.to_owned() };
        if self.is_not_found { Err(refused()) } else { Ok(()) }
    }

    /// Refuses a state of another number of samples than those of the part that it is used for.
    ///
    /// # Errors
    /// The finding; [`Self::measured`] and [`Self::hopeless`] have others.
    pub fn check_samples(&self, own: usize) -> Result<(), FieldError> {
        if let Some(samples) = self.samples.filter(|samples| *samples != own) {
            return Err(FieldError { pointer: "/samples".to_owned(), detail: other_samples(samples, own) });
        }
        let sets = [("/measured", self.measured()?), ("/hopeless", self.hopeless()?)];
        let other = sets.into_iter().find(|(_, set)| set.words().len() != own.div_ceil(64));
        other.map_or(Ok(()), |(pointer, set)| {
            Err(FieldError { pointer: pointer.to_owned(), detail: other_samples(64 * set.words().len(), own) })
        })
    }

    /// Refuses a state whose samples were drawn otherwise than those of a plan with these parameters: as many of them may lie elsewhere.
    ///
    /// # Errors
    /// The finding.
    pub fn check_sampling(&self, own: &PlanParams) -> Result<(), FieldError> {
        let known = &self.plan_params;
        let refuse = |field: &str, found: String, own: String| FieldError {
            pointer: format!("/plan_params/{field}"),
            detail: format!(
                "is {found} in the inspection of the previous round, but {own} in the plan that these scans are of: the two have other \
                 samples, which do not add up; name the inspection from which this plan was made by a rescan"
            ),
        };
        if known.seed != own.seed {
            return Err(refuse("seed", known.seed.to_string(), own.seed.to_string()));
        }
        let sizes = [
            ("part/samples_per_mm2", known.part.samples_per_mm2, own.part.samples_per_mm2),
            ("part/patch_edge_mm", known.part.patch_edge_mm, own.part.patch_edge_mm),
        ];
        // A size that is not given follows from the part, and tells nothing here.
        let given = sizes.into_iter().filter_map(|(field, known, own)| Some((field, known?, own?)));
        let other = given.into_iter().find(|(_, known, own)| known.to_bits() != own.to_bits());
        other.map_or(Ok(()), |(field, known, own)| Err(refuse(field, known.to_string(), own.to_string())))
    }

    /// Samples that scans have measured.
    ///
    /// # Errors
    /// A text that is not one of samples.
    pub fn measured(&self) -> Result<SampleSet, FieldError> {
        samples(&self.measured, "/measured")
    }

    /// Samples that no further view mends.
    ///
    /// # Errors
    /// A text that is not one of samples.
    pub fn hopeless(&self) -> Result<SampleSet, FieldError> {
        samples(&self.hopeless, "/hopeless")
    }

    /// Rates of return.
    #[must_use]
    pub fn model(&self) -> ReturnModel {
        ReturnModel {
            easy_rate: self.easy_rate,
            incidence: RateCurve::from(&self.by_incidence),
            mirror: RateCurve::from(&self.by_mirror),
            depth: RateCurve::from(&self.by_depth),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planning::ids::SampleId;

    fn state(samples: Option<usize>, measured: usize) -> RescanState {
        let none = RateCurveDocument::default();
        RescanState {
            schema: RESCAN_STATE_SCHEMA.to_owned(),
            plan_sha256: String::new(),
            plan_params: PlanParams::default(),
            target_of_mm2: 1.0,
            rounds: 0,
            is_not_found: false,
            samples,
            measured: bits(&SampleSet::none_of(measured)),
            hopeless: bits(&SampleSet::none_of(measured)),
            easy_rate: 1.0,
            by_incidence: none.clone(),
            by_mirror: none.clone(),
            by_depth: none,
        }
    }

    #[test]
    fn a_state_of_scans_that_do_not_fit_the_part_is_refused_also_from_its_file() {
        let found = state(Some(130), 130);
        assert_eq!(found.check_found(), Ok(()));
        let written = serde_json::to_value(&found).expect("JSON");
        assert!(written.get("is_not_found").is_none(), "as before");
        let lost = serde_json::to_string(&RescanState { is_not_found: true, ..found }).expect("JSON");
        let lost: RescanState = serde_json::from_str(&lost).expect("a state");
        let told = lost.check_found().expect_err("refused").to_string();
        assert!(told.contains("alignment not found") && told.contains("compare scans of this part first"), "{told}");
    }

    #[test]
    fn what_no_view_mends_stays_so_from_round_to_round_until_it_is_measured() {
        let set = |samples: &[u32]| {
            let mut set = SampleSet::none_of(130);
            samples.iter().for_each(|sample| set.insert(SampleId(*sample)));
            set
        };
        let before = RescanState { measured: bits(&set(&[1])), hopeless: bits(&set(&[7, 8])), ..state(Some(130), 130) };
        let (mut measured, mut hopeless) = (set(&[2, 8]), set(&[9]));
        before.add_to(&mut measured, &mut hopeless);
        assert_eq!((measured, hopeless), (set(&[1, 2, 8]), set(&[7, 9])));
        let (mut measured, mut hopeless) = (SampleSet::none_of(64), SampleSet::none_of(64));
        before.add_to(&mut measured, &mut hopeless);
        assert_eq!((measured, hopeless), (SampleSet::none_of(64), SampleSet::none_of(64)), "samples of another part");
    }

    /// Samples of another seed, though as many, lie elsewhere, and what was measured of those was taken for measured.
    #[test]
    fn a_state_whose_samples_were_drawn_otherwise_is_refused() {
        let state = state(Some(130), 130);
        let mut params = PlanParams::default();
        assert_eq!(state.check_sampling(&params), Ok(()));
        params.seed = 3;
        let told = state.check_sampling(&params).expect_err("refused").to_string();
        assert!(told.starts_with("/plan_params/seed: is 0 in the inspection of the previous round, but 3 in the plan"), "{told}");
        params.seed = 0;
        params.part.samples_per_mm2 = Some(0.5);
        assert_eq!(state.check_sampling(&params), Ok(()), "of a state that does not give it nothing is told");
        let mut given = state;
        given.plan_params.part.samples_per_mm2 = Some(0.25);
        let told = given.check_sampling(&params).expect_err("refused").to_string();
        assert!(told.starts_with("/plan_params/part/samples_per_mm2: is 0.25 in"), "{told}");
        given.plan_params.part.samples_per_mm2 = Some(0.5);
        assert_eq!(given.check_sampling(&params), Ok(()));
    }

    #[test]
    fn a_state_of_other_samples_is_refused_to_the_last_one() {
        assert_eq!(state(Some(130), 130).check_samples(130), Ok(()));
        assert_eq!(state(None, 130).check_samples(131), Ok(()), "an old one tells no more than its words");
        let told = |state: RescanState, own| state.check_samples(own).expect_err("refused").to_string();
        assert!(
            told(state(Some(130), 130), 131)
                .starts_with("/samples: is of 130 samples, but this part has 131: it is from another part")
        );
        assert!(told(state(None, 130), 300).starts_with("/measured: is of 192 samples, but this part has 300"));
        let before = serde_json::to_value(state(Some(130), 130)).map(|mut value| {
            value.as_object_mut().map(|fields| fields.remove("samples"));
            value
        });
        let read: RescanState = serde_json::from_value(before.expect("JSON")).expect("a state");
        assert_eq!(read.samples, None);
    }
}

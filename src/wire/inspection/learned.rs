//! Findings about the scanner from its scans.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cell::DeviceName;
use crate::inspection::identification::{
    Identified, Learned, LearnedReturns, LimitEstimate, Offer, OfferedChange, OfferedField, RateBin, RateCurve, Withheld,
    incidence_gap,
};
use crate::wire::schema_name::schema_name;

/// Schema name of the findings.
const LEARNED_SCHEMA: &str = "vantage.learned/1";

schema_name!(LearnedSchema, LEARNED_SCHEMA);

/// An estimate with its 95 % confidence interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct EstimateDocument {
    /// Estimated value.
    pub value: f64,
    /// Ends of the interval.
    #[schema(min_items = 2, max_items = 2)]
    pub interval: [f64; 2],
    /// Number of pairs of view and sample, or triples of points, that it is based on.
    pub count: u64,
}

/// Rate of return in one interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RateBinDocument {
    /// Lower and upper end: degrees, or mm of depth.
    #[schema(min_items = 2, max_items = 2)]
    pub range: [f64; 2],
    /// Pairs of view and sample that an ideal scanner would measure.
    pub expected: u64,
    /// Pairs of view and sample that were measured.
    pub returned: u64,
}

/// A suggested change; none is applied automatically.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OfferedChangeDocument {
    /// Field to change.
    pub field: OfferedField,
    /// Key of the planning parameter; `null` where only the scanner's specification has the field.
    pub parameter: Option<String>,
    /// JSON pointers of the field in the scanner's specification.
    pub in_scanner: Vec<String>,
    /// Value in force; `null` where there is none.
    pub from: Option<f64>,
    /// Suggested value.
    pub to: f64,
    /// Value identified from the scans.
    pub identified: EstimateDocument,
    /// Sentence for people.
    pub detail: String,
}

/// Findings about the scanner from its scans (`learned.json`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LearnedDocument {
    /// Schema name, `vantage.learned/1`.
    #[schema(value_type = LearnedSchema)]
    pub schema: String,
    /// SHA-256 of the bytes of `plan.json`.
    pub plan_sha256: String,
    /// Standard deviation of a point along the surface normal at best focus, mm; `null` if there are too few points.
    pub noise_best_mm: Option<EstimateDocument>,
    /// Relative increase of the noise at the ends of the working depth; `null` if there are too few points, or all at about one
    /// distance from the best focus.
    pub noise_depth_gain: Option<EstimateDocument>,
    /// Worst incidence over the three devices up to which three quarters of the points return, degrees; `null` where no limit
    /// shows.
    pub incidence_deg: Option<EstimateDocument>,
    /// Incidence limit of each device by itself, found where the other devices are far from theirs.
    pub incidence_by_device: Vec<DeviceLimitDocument>,
    /// Angle around the mirror direction within which glare takes half of the points, degrees; `null` where no glare shows.
    pub lobe_deg: Option<EstimateDocument>,
    /// Nearest and farthest depth at which three quarters of the points return, mm; `null` where no limit shows.
    #[schema(min_items = 2, max_items = 2)]
    pub depth_mm: [Option<EstimateDocument>; 2],
    /// Rate of return by worst incidence, degrees.
    pub by_incidence: Vec<RateBinDocument>,
    /// Rate of return by mirror angle, degrees.
    pub by_mirror: Vec<RateBinDocument>,
    /// Rate of return by depth, mm.
    pub by_depth: Vec<RateBinDocument>,
    /// Suggested changes.
    pub offers: Vec<OfferedChangeDocument>,
    /// Reasons for which the scans reveal little or nothing about the scanner's limits or noise.
    #[serde(default)]
    pub withheld: Vec<WithheldDocument>,
}

/// Reason for which scans reveal little or nothing about the scanner's limits or noise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WithheldDocument {
    /// The reason.
    pub reason: Withheld,
    /// Sentence for people.
    pub detail: String,
}

impl WithheldDocument {
    fn new(reason: Withheld, kept_views: [usize; 2], gap_deg: [f64; 2]) -> Self {
        Self { reason, detail: withheld_sentence(reason, kept_views, gap_deg) }
    }
}

/// Sentence for a reason, with the views that kept their stated poses and all views, and the incidences between which nothing was
/// seen and the limit lies, degrees.
fn withheld_sentence(reason: Withheld, [kept, views]: [usize; 2], [from_deg, to_deg]: [f64; 2]) -> String {
    let sentence = match reason {
        Withheld::MergedCloud => {
            "the scanner's limits are not judged: in a merged cloud the view of a point is unknown; give one file for each view"
        }
        Withheld::CoarseCloud => {
            "the scanner's limits are judged on little of the surface: the points lie too far apart, or came without the \
             camera's grid; give the scans at full resolution, with the grid"
        }
        Withheld::FilteredPoints => {
            "the scanner's limits are judged on little of the surface: most points were removed near plate and \
             fixture, at edges or as specks"
        }
        Withheld::IncidenceGap => {
            return format!(
                "no limit of incidence is suggested: it lies between {from_deg:.0}° and {to_deg:.0}°, and no surface was seen at \
                 angles in between; add views that see surface at such angles"
            );
        }
        Withheld::OneDepth => {
            "the increase of the noise with depth is not determined, and the noise at best focus only within its interval: all \
             points that tell it lie at about one distance from the best focus, or too few lie elsewhere; scan from other \
             distances too"
        }
        Withheld::MisplacedViews => {
            return format!(
                "the scanner's limits are judged on little of the surface: {kept} of {views} views could not be registered to \
                 the part and may not lie at their stated poses; check the poses or the calibration"
            );
        }
    };
    sentence.to_owned()
}

/// Limit of incidence of one device.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DeviceLimitDocument {
    /// The device.
    #[schema(value_type = DeviceName)]
    pub device: String,
    /// Limit of incidence, degrees; `null` where none shows.
    pub incidence_deg: Option<EstimateDocument>,
}

impl EstimateDocument {
    fn new(estimate: &Identified, count: u64) -> Self {
        Self { value: estimate.value, interval: estimate.interval, count }
    }

    fn of_limit(limit: &LimitEstimate) -> Self {
        Self::new(&limit.limit, limit.pairs)
    }
}

impl From<&RateBin> for RateBinDocument {
    fn from(bin: &RateBin) -> Self {
        Self { range: bin.range, expected: bin.expected, returned: bin.returned }
    }
}

fn bins(curve: &RateCurve) -> Vec<RateBinDocument> {
    curve.bins.iter().map(RateBinDocument::from).collect()
}

impl From<&OfferedChange> for OfferedChangeDocument {
    fn from(change: &OfferedChange) -> Self {
        Self {
            field: change.field,
            parameter: change.field.parameter().map(str::to_owned),
            in_scanner: change.field.in_scanner().iter().map(|pointer| (*pointer).to_owned()).collect(),
            from: change.from,
            to: change.to,
            identified: EstimateDocument::new(&change.identified, change.count),
            detail: offer_sentence(change),
        }
    }
}

/// Sentence for an offered change.
#[must_use]
pub fn offer_sentence(change: &OfferedChange) -> String {
    let (value, to) = (change.identified.value, change.to);
    match change.field {
        OfferedField::CameraLimit => format!(
            "the cameras return fewer points from {to}° on, three quarters at {value:.0}°: plan with limits.camera_deg={to}"
        ),
        OfferedField::ProjectorLimit => format!(
            "fewer points return from a projector angle of {to}° on, three quarters at {value:.0}°: plan with \
             limits.projector_deg={to}"
        ),
        OfferedField::Lobe => format!("glare takes points within {value:.1}° of the mirror direction: plan with a lobe of {to}°"),
        OfferedField::NoiseBest => format!("points scatter by {value:.4} mm at best focus: plan with regions.noise.best_mm={to}"),
        OfferedField::NoiseDepthGain => {
            format!(
                "the noise at the ends of the depth is {:.2} times that at best focus: plan with regions.noise.depth_gain={to}",
                1.0 + value
            )
        }
        OfferedField::DepthNear => format!(
            "fewer points return from nearer than {to} mm, three quarters at {value:.0} mm: set depth_mm.near of the scanner to \
             {to}"
        ),
        OfferedField::DepthFar => format!(
            "fewer points return from beyond {to} mm, three quarters at {value:.0} mm: set depth_mm.far of the scanner to {to}"
        ),
    }
}

impl LearnedDocument {
    /// Document of what was learned and is offered.
    #[must_use]
    pub fn new(learned: Option<&Learned>, offer: &Offer, plan_sha256: &str) -> Self {
        let noise = learned.and_then(|learned| learned.noise.as_ref());
        let gain = noise.filter(|noise| noise.is_gain_determined);
        let one_depth = noise.filter(|noise| !noise.is_gain_determined).map(|_| Withheld::OneDepth);
        let returns = learned.and_then(|learned| learned.returns.as_ref());
        let is_told = offer.changes.iter().any(|change| change.field == OfferedField::CameraLimit);
        let gap_deg = returns.filter(|_| !is_told).and_then(incidence_gap);
        let limit =
            |of: fn(&LearnedReturns) -> Option<LimitEstimate>| returns.and_then(of).as_ref().map(EstimateDocument::of_limit);
        let rates = |of: fn(&LearnedReturns) -> &RateCurve| returns.map(|returns| bins(of(returns))).unwrap_or_default();
        let of_device = |(device, limit): &(DeviceName, Option<LimitEstimate>)| DeviceLimitDocument {
            device: device.as_str().to_owned(),
            incidence_deg: limit.as_ref().map(EstimateDocument::of_limit),
        };
        Self {
            schema: LEARNED_SCHEMA.to_owned(),
            plan_sha256: plan_sha256.to_owned(),
            noise_best_mm: noise.map(|noise| EstimateDocument::new(&noise.best_mm, noise.triples as u64)),
            noise_depth_gain: gain.map(|noise| EstimateDocument::new(&noise.depth_gain, noise.triples as u64)),
            incidence_deg: limit(|returns| returns.incidence),
            incidence_by_device: returns.iter().flat_map(|returns| &returns.by_device).map(of_device).collect(),
            lobe_deg: limit(|returns| returns.lobe),
            depth_mm: [limit(|returns| returns.depth[0]), limit(|returns| returns.depth[1])],
            by_incidence: rates(|returns| &returns.model.incidence),
            by_mirror: rates(|returns| &returns.model.mirror),
            by_depth: rates(|returns| &returns.model.depth),
            offers: offer.changes.iter().map(OfferedChangeDocument::from).collect(),
            withheld: offer
                .withheld
                .iter()
                .copied()
                .chain(gap_deg.map(|_| Withheld::IncidenceGap))
                .chain(one_depth)
                .map(|reason| WithheldDocument::new(reason, offer.kept_views, gap_deg.unwrap_or_default()))
                .collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inspection::identification::{NoiseEstimate, ReturnModel};

    #[test]
    fn a_limit_that_lies_where_nothing_was_seen_is_told_as_such() {
        let interval = [36.0, 70.0];
        let limit = LimitEstimate {
            limit: Identified { value: 44.7, interval },
            between: [36.6, 69.4],
            plan_with: 38.2,
            plan_interval: interval,
            pairs: 7_000,
        };
        let of = |incidence: LimitEstimate| {
            let returns = LearnedReturns {
                pairs: 7_000,
                views: 20,
                easy_rate: 1.0,
                incidence: Some(incidence),
                by_device: Vec::new(),
                lobe: None,
                depth: [None; 2],
                model: ReturnModel::default(),
            };
            LearnedDocument::new(Some(&Learned { noise: None, returns: Some(returns) }), &Offer::default(), "").withheld
        };
        let open = of(limit);
        assert_eq!(open.iter().map(|withheld| withheld.reason).collect::<Vec<_>>(), [Withheld::IncidenceGap]);
        assert!(open[0].detail.contains("between 37° and 69°"), "{open:?}");
        let dense = LimitEstimate { between: [44.7; 2], ..limit };
        assert!(of(dense).is_empty(), "no stretch without surface keeps it from being known");
    }

    /// A gain with an interval of all that it can be was told as a figure.
    #[test]
    fn a_gain_that_one_depth_does_not_determine_is_told_as_such() {
        let about = |value: f64, interval: [f64; 2]| Identified { value, interval };
        let (best_mm, triples, outliers) = (about(0.03, [0.0005, 0.031]), 5_000, 0);
        let of = |depth_gain: Identified, is_gain_determined: bool| {
            let noise = NoiseEstimate { best_mm, depth_gain, is_gain_determined, triples, outliers };
            let learned = Learned { noise: Some(noise), returns: None };
            LearnedDocument::new(Some(&learned), &Offer::default(), "")
        };
        let open = of(about(0.0, [0.0, 100.0]), false);
        assert!(open.noise_depth_gain.is_none() && open.noise_best_mm.is_some(), "{open:?}");
        assert_eq!(open.withheld.iter().map(|withheld| withheld.reason).collect::<Vec<_>>(), [Withheld::OneDepth]);
        assert!(open.withheld[0].detail.ends_with("scan from other distances too"), "{open:?}");
        // Depths on both sides of the best focus were told as one.
        assert!(open.withheld[0].detail.contains("at about one distance from the best focus"), "{open:?}");
        let known = of(about(1.0, [0.9, 1.1]), true);
        assert!(known.noise_depth_gain.is_some() && known.withheld.is_empty(), "{known:?}");
    }
}

//! Advice on a plan as a whole, and turns of the part in operators' words.

use std::collections::BTreeMap;

use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Number, Value, json};
use utoipa::ToSchema;

use crate::cell::PoseSpec;
use crate::geometry::{Part, Pose, Table};
use crate::planning::params::Registration;
use crate::planning::plan::{AdviceKind, AdvisedSetup, Coverage, ParamChange, Plan, PlanAdvice, Turn, TurnKind, share};
use crate::planning::verdict::Grade;
use crate::wire::angle::degrees;
use crate::wire::words::{counted, fixed, lie_phrase, listed, percent_below, percents_apart, rounded_to, turn_phrase};

/// Parameters of an advice that are whole numbers.
const WHOLE_SETTINGS: [&str; 2] = ["setups", "selection.max_views"];

/// Turn of the part from one resting pose to another.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct TurnDocument {
    /// Kind of turn.
    #[schema(value_type = TurnKind)]
    pub kind: String,
    /// Side of the part that comes to face down, or the one nearest to it, as the part lies before the turn: right is +x of the
    /// table, back +y, left −x, front −y. `null` for the kinds `none` and `upside_down`.
    #[schema(value_type = Option<crate::planning::plan::PartSide>)]
    pub side: Option<String>,
    /// Angle between what is down before and afterwards, 0 to 180.
    pub angle_deg: f64,
    /// The turn in words, such as `turn it upside down`. A rotation about the vertical is not described; the pose includes it.
    pub text: String,
}

impl From<&Turn> for TurnDocument {
    fn from(turn: &Turn) -> Self {
        let has_side = matches!(turn.kind, TurnKind::OnSide | TurnKind::Tilt);
        Self {
            kind: turn.kind.as_str().to_owned(),
            side: has_side.then(|| turn.side.as_str().to_owned()),
            angle_deg: degrees(turn.angle_rad),
            text: turn_phrase(turn),
        }
    }
}

/// Setup of an advised plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct AdvisedSetupDocument {
    /// Pose of the part in it.
    pub table_from_part: PoseSpec,
    /// Turn into that pose from the first setup of the plan that the advice is on.
    pub turn: TurnDocument,
    /// Pose of the part after that turn in words, such as `upside down`.
    pub lies: String,
}

impl From<&AdvisedSetup> for AdvisedSetupDocument {
    fn from(setup: &AdvisedSetup) -> Self {
        Self {
            table_from_part: PoseSpec::from(&setup.table_from_part),
            turn: TurnDocument::from(&setup.turn),
            lies: lie_phrase(&setup.turn),
        }
    }
}

/// Parameters with which the plan would measure more, or better, tried in simulation: usable views were chosen for them,
/// and those of a further setup were put in order. Area, views and time are estimates, since a plan made with the parameters
/// chooses all its views anew, among more candidates. Their errors are given for 20 parts of 120 mm, planned with default
/// parameters in the default cell (`more_views`: 3 parts; `better_grades`: 13 plans, three of them without a cell), and then
/// planned with the advice.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct AdviceDocument {
    /// Kind of advice.
    #[schema(value_type = AdviceKind)]
    pub kind: String,
    /// Description in one sentence.
    pub text: String,
    /// Parameters to set, by their dotted names.
    #[serde(deserialize_with = "settings_as_written")]
    pub set: BTreeMap<String, Value>,
    /// Pose of the part in the further setup, for `turn_over`; `null` with `setups`.
    #[serde(default)]
    pub table_from_part: Option<PoseSpec>,
    /// Turn into that pose from the first setup.
    #[serde(default)]
    pub turn: Option<TurnDocument>,
    /// All setups of the advised plan; given for `turn_over` if it replaces setups of this plan.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub setups: Vec<AdvisedSetupDocument>,
    /// Estimated number of views that a plan with these parameters adds: those added in the trial, minus the views of setups that
    /// it gives up; never below 0.
    pub added_views: usize,
    /// Estimated number of views of a plan with these parameters. Plans made with `turn_over` had 3 views fewer to 3 more for 18
    /// of the 20 parts, and 5 and 39 more for two with thin walls; plans made with `more_views` had at most 1 view fewer, plans
    /// made with `better_grades` 1 fewer to 1 more.
    pub views: usize,
    /// Asked area measured in the trial, as far as the target requires it (all of it with `best_coverage`), on the samples that
    /// views are chosen on. It is an estimate on the low side: plans made with `turn_over` measured 0.1 to 4.8 percentage points
    /// of the asked area more (median: 0.5), plans made with `more_views` 0 to 0.1.
    pub measured_area_mm2: f64,
    /// Measured area of the trial as a share of the asked area; `coverage.of_asked` is the share of this plan.
    pub of_asked: f64,
    /// Share of the asked area at grade A with the added view, for `better_grades`; `coverage.grades.A` is that of this plan.
    /// Plans made with it had 0.3 percentage points less to 10 points more (median: 2).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub grade_a_of_asked: Option<f64>,
    /// Measured area of the trial as a share of the area that would then be visible: what the part stands on in one setup can be
    /// seen in another.
    pub of_visible: f64,
    /// Estimated cycle time with the added views, s; `null` without a cell. Plans made with `turn_over` took 20 % less to 72 %
    /// more (median: as much), plans made with `more_views` 5 to 17 % less, with `better_grades` 12 % less to 15 % more. Turning the
    /// part over is not counted, moves to further views of a setup are taken as straight, and each added view is captured as often as
    /// the plan's on average.
    pub cycle_secs: Option<f64>,
    /// Names of the regions and features that miss their target now and would meet it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub regions_met: Vec<String>,
}

impl AdviceDocument {
    /// The documents of a plan's advice.
    #[must_use]
    pub fn all_of(plan: &Plan) -> Vec<Self> {
        plan.advice.iter().map(|advice| Self::new(advice, &plan.coverage)).collect()
    }

    fn new(advice: &PlanAdvice, coverage: &Coverage) -> Self {
        let of_asked = |area_mm2: f64| share(area_mm2, coverage.asked_area_mm2);
        let mut document = Self {
            kind: advice.kind.as_str().to_owned(),
            text: String::new(),
            set: advice.changes.iter().map(setting).collect(),
            table_from_part: advice.table_from_part.as_ref().map(PoseSpec::from),
            turn: advice.turn.as_ref().map(TurnDocument::from),
            setups: advice.setups.iter().map(AdvisedSetupDocument::from).collect(),
            added_views: advice.added_views,
            views: advice.views,
            measured_area_mm2: advice.measured_area_mm2,
            of_asked: of_asked(advice.measured_area_mm2),
            grade_a_of_asked: advice.grade_a_area_mm2.map(of_asked),
            of_visible: share(advice.measured_area_mm2, advice.visible_area_mm2),
            cycle_secs: advice.cycle_secs,
            regions_met: advice.regions_met.clone(),
        };
        document.text = document.sentence(advice.kind, coverage);
        document
    }

    /// Request to lay the part otherwise, in words; `None` where the plan does not.
    pub(crate) fn laying(&self) -> Option<String> {
        let lies: Vec<&str> = self.setups.iter().map(|setup| setup.lies.as_str()).collect();
        let laying = match (&self.turn, lies.len()) {
            (Some(turn), _) => format!("{} and scan again", turn.text),
            (None, 0) => return None,
            (None, 1) => format!("scan it in another setup, {}", listed(&lies)),
            (None, _) => format!("scan it in other setups, {}", listed(&lies)),
        };
        // Without them the plan is possible, and its scans are not.
        let needs_markers = self.set.get("registration").is_some_and(|means| *means == json!(Registration::Markers));
        Some(laying + if needs_markers { ", with markers on the part to register its setups" } else { "" })
    }

    fn sentence(&self, kind: AdviceKind, coverage: &Coverage) -> String {
        let more = self.more_views();
        let action = match kind {
            AdviceKind::TurnOver => {
                let laying = self.laying().unwrap_or_else(|| "turn it onto another side and scan again".to_owned());
                let about = if self.added_views == 0 { "" } else { "about " };
                format!("{laying}, {about}{more}")
            }
            AdviceKind::MoreViews => format!("choose {more}"),
            AdviceKind::BetterGrades => return self.grades_sentence(coverage),
        };
        let [now, then] = percents_apart([coverage.of_asked(), self.of_asked]);
        format!(
            "{action} ({}): estimated {then} % of asked, now {now} %, and {} % of what is visible then, {}{}",
            self.settings(),
            percent_below(self.of_visible, 1.0, 1),
            self.size_phrase(),
            self.regions_clause(),
        )
    }

    fn grades_sentence(&self, coverage: &Coverage) -> String {
        let now_of_asked = share(coverage.measured.grade_area_mm2[Grade::A as usize], coverage.asked_area_mm2);
        let [now, then] = percents_apart([now_of_asked, self.grade_a_of_asked.unwrap_or(now_of_asked)]);
        format!(
            "for better grades choose {} ({}): estimated {then} % of asked at grade A, now {now} %, {}",
            self.more_views(),
            self.settings(),
            self.size_phrase(),
        )
    }

    fn more_views(&self) -> String {
        match self.added_views {
            0 => "no more views".to_owned(),
            added => counted(added, "more view"),
        }
    }

    /// Views and cycle of the advised plan. It chooses its views anew: no digit behind the point would hold.
    fn size_phrase(&self) -> String {
        let cycle = self.cycle_secs.map_or_else(String::new, |secs| format!(", cycle about {} s", fixed(secs, 0)));
        format!("with about {}{cycle}", counted(self.views, "view"))
    }

    /// The regions that meet their target then, as a clause; their names are quoted, so that none breaks a line.
    pub(in crate::wire) fn regions_clause(&self) -> String {
        let names: Vec<String> = self.regions_met.iter().map(|name| format!("{name:?}")).collect();
        if names.is_empty() { String::new() } else { format!("; meets the target of {}", names.join(", ")) }
    }

    /// The parameters to set as text; lists are left to the document.
    fn settings(&self) -> String {
        let setting = |(name, value): (&String, &Value)| match value {
            Value::Array(_) => format!("{name} as in plan.json"),
            Value::String(text) => format!("{name} = {text}"),
            Value::Null | Value::Bool(_) | Value::Number(_) | Value::Object(_) => format!("{name} = {value}"),
        };
        // The number of setups first, lists last.
        let (lists, values): (Vec<_>, Vec<_>) = self.set.iter().rev().partition(|(_, value)| value.is_array());
        values.into_iter().chain(lists).map(setting).collect::<Vec<_>>().join(", ")
    }

    /// Options of the command line that set the parameters.
    #[must_use]
    pub fn options(&self) -> String {
        options(&self.set)
    }
}

/// Options of the command line that set parameters, given by their dotted names.
pub(crate) fn options(set: &BTreeMap<String, Value>) -> String {
    let option = |(name, value): (&String, &Value)| match value {
        Value::Array(_) | Value::Object(_) => format!("--set '{name}={value}'"),
        Value::String(text) => format!("--set {name}={text}"),
        Value::Null | Value::Bool(_) | Value::Number(_) => format!("--set {name}={value}"),
    };
    set.iter().rev().map(option).collect::<Vec<_>>().join(" ")
}

/// Reads parameters such that their numbers are written as they were: some programs write 1.0 as `1`, and the digest of a plan is that of
/// its text.
fn settings_as_written<'de, D: Deserializer<'de>>(deserializer: D) -> Result<BTreeMap<String, Value>, D::Error> {
    fn as_floats(value: &mut Value) {
        match value {
            Value::Number(number) => {
                if let Some(float) = number.as_f64().and_then(Number::from_f64) {
                    *number = float;
                }
            }
            Value::Array(items) => items.iter_mut().for_each(as_floats),
            Value::Object(fields) => fields.values_mut().for_each(as_floats),
            Value::Null | Value::Bool(_) | Value::String(_) => {}
        }
    }
    let mut set: BTreeMap<String, Value> = Deserialize::deserialize(deserializer)?;
    set.iter_mut().filter(|(name, _)| !WHOLE_SETTINGS.contains(&name.as_str())).for_each(|(_, value)| as_floats(value));
    Ok(set)
}

/// A pose with as many digits as people copy: 10⁻⁷ of a quaternion, within what its norm may be off by, and 0.1 µm.
fn rounded(pose: &Pose<Table, Part>) -> PoseSpec {
    let PoseSpec { quaternion_xyzw, translation_mm } = PoseSpec::from(pose);
    let to = |decimals: i32| move |value: f64| rounded_to(value, decimals);
    PoseSpec { quaternion_xyzw: quaternion_xyzw.map(to(7)), translation_mm: translation_mm.map(to(4)) }
}

/// Name and value of a parameter to set.
fn setting(change: &ParamChange) -> (String, Value) {
    let (name, value) = match change {
        ParamChange::Setups(setups) => ("setups", json!(setups)),
        ParamChange::RestingPoses(poses) => ("part.resting_poses", json!(poses.iter().map(rounded).collect::<Vec<_>>())),
        ParamChange::Registration(registration) => ("registration", json!(registration)),
        ParamChange::Target(target) => ("selection.target", json!(target)),
        ParamChange::MaxViews(views) => ("selection.max_views", json!(views)),
        ParamChange::MinGradeA(share) => ("selection.min_grade_a", json!(share)),
    };
    (name.to_owned(), value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::Findings;
    use crate::planning::plan::{MeasuredArea, PartSide};

    fn advice(kind: AdviceKind, changes: Vec<ParamChange>) -> PlanAdvice {
        PlanAdvice {
            kind,
            changes,
            table_from_part: None,
            turn: None,
            setups: Vec::new(),
            added_views: 3,
            views: 10,
            measured_area_mm2: 97.1,
            grade_a_area_mm2: None,
            visible_area_mm2: 98.0,
            cycle_secs: Some(93.26),
            regions_met: Vec::new(),
        }
    }

    fn document(advice: &PlanAdvice) -> AdviceDocument {
        let measured = MeasuredArea { area_mm2: 80.0, ..MeasuredArea::default() };
        AdviceDocument::new(advice, &Coverage { measured, asked_area_mm2: 100.0, ..Coverage::default() })
    }

    #[test]
    fn advice_to_turn_the_part_over_is_one_sentence_with_what_it_gives() {
        let turn = Turn { kind: TurnKind::UpsideDown, side: PartSide::Right, angle_rad: std::f64::consts::PI };
        let changes = vec![ParamChange::Setups(2), ParamChange::Registration(Registration::Markers)];
        let told = document(&PlanAdvice { turn: Some(turn), ..advice(AdviceKind::TurnOver, changes) });
        assert_eq!(
            told.text,
            "turn it upside down and scan again, with markers on the part to register its setups, about 3 more views (setups = 2, \
             registration = markers): estimated 97.1 % of asked, now 80.0 %, and 99.1 % of what is visible then, with about 10 \
             views, cycle about 93 s"
        );
        assert_eq!(told.options(), "--set setups=2 --set registration=markers");
        let turn = told.turn.expect("a turn");
        assert_eq!((turn.kind.as_str(), turn.side, turn.angle_deg), ("upside_down", None, 180.0));
    }

    #[test]
    fn advice_that_leaves_a_setup_names_how_the_part_lies_in_all_of_its_own() {
        let advised = |kind, side, deg: f64| AdvisedSetup {
            table_from_part: Pose::identity(),
            turn: Turn { kind, side, angle_rad: deg.to_radians() },
        };
        let over = advised(TurnKind::UpsideDown, PartSide::Right, 180.0);
        let setups = vec![over, advised(TurnKind::OnSide, PartSide::Back, 90.0)];
        let told = document(&PlanAdvice { setups, ..advice(AdviceKind::TurnOver, vec![ParamChange::Setups(2)]) });
        assert!(
            told.text.starts_with("scan it in other setups, upside down and on its back, about 3 more views (setups = 2): "),
            "{told:?}"
        );
        assert_eq!((told.table_from_part, told.turn, told.setups.len()), (None, None, 2));
        let json = serde_json::to_value(&told.setups).expect("JSON");
        assert_eq!((&json[1]["lies"], &json[1]["turn"]["text"]), (&json!("on its back"), &json!("stand it on its back")));
        let as_many = PlanAdvice { added_views: 0, setups: vec![over; 3], ..advice(AdviceKind::TurnOver, Vec::new()) };
        let told = document(&as_many).text;
        assert!(told.starts_with("scan it in other setups, upside down, upside down and upside down, no more views ("), "{told}");
        // Plans from before it have the bytes that they had.
        let usual = serde_json::to_value(document(&advice(AdviceKind::TurnOver, Vec::new()))).expect("JSON");
        assert!(usual.get("setups").is_none(), "{usual}");
    }

    #[test]
    fn advice_for_more_views_names_the_target_and_the_regions_that_meet_theirs() {
        let mut more = advice(AdviceKind::MoreViews, vec![ParamChange::Target(0.992), ParamChange::MaxViews(10)]);
        (more.added_views, more.cycle_secs, more.regions_met) = (1, None, vec!["bore".to_owned(), "rim\nof it".to_owned()]);
        let told = document(&more);
        assert_eq!(
            told.text,
            "choose 1 more view (selection.target = 0.992, selection.max_views = 10): estimated 97.1 % of asked, now 80.0 %, and \
             99.1 % of what is visible then, with about 10 views; meets the target of \"bore\", \"rim\\nof it\""
        );
        assert_eq!(told.options(), "--set selection.target=0.992 --set selection.max_views=10");
    }

    #[test]
    fn advice_for_better_grades_names_the_share_at_grade_a() {
        let changes = vec![ParamChange::MinGradeA(0.45)];
        let better = PlanAdvice { grade_a_area_mm2: Some(45.0), ..advice(AdviceKind::BetterGrades, changes) };
        let better = PlanAdvice { added_views: 1, measured_area_mm2: 80.0, ..better };
        let measured = MeasuredArea { area_mm2: 80.0, grade_area_mm2: [36.12, 20.0, 13.88, 10.0], ..MeasuredArea::default() };
        let coverage = Coverage { measured, asked_area_mm2: 100.0, ..Coverage::default() };
        let told = AdviceDocument::new(&better, &coverage);
        assert_eq!(
            told.text,
            "for better grades choose 1 more view (selection.min_grade_a = 0.45): estimated 45.0 % of asked at grade A, now 36.1 %, \
             with about 10 views, cycle about 93 s"
        );
        assert_eq!((told.of_asked, told.options().as_str()), (0.8, "--set selection.min_grade_a=0.45"));
        let usual = serde_json::to_value(document(&advice(AdviceKind::MoreViews, Vec::new()))).expect("JSON");
        assert!(usual.get("grade_a_of_asked").is_none(), "{usual}");
    }

    #[test]
    fn advice_of_little_effect_is_told_with_the_digits_that_show_it() {
        let little = PlanAdvice { measured_area_mm2: 80.02, ..advice(AdviceKind::MoreViews, vec![ParamChange::MaxViews(10)]) };
        let told = document(&little).text;
        assert!(told.contains("estimated 80.02 % of asked, now 80.00 %, and"), "{told}");
    }

    #[test]
    fn advice_that_a_program_wrote_without_points_has_the_same_bytes() {
        let pose = crate::geometry::Pose::identity();
        let changes = vec![
            ParamChange::Setups(2),
            ParamChange::RestingPoses(vec![pose]),
            ParamChange::Registration(Registration::Markers),
            ParamChange::Target(1.0),
            ParamChange::MaxViews(10),
        ];
        let told = document(&advice(AdviceKind::TurnOver, changes));
        let text = serde_json::to_string(&told).expect("JSON");
        let mut without_points = serde_json::to_value(&told).expect("JSON");
        let set = &mut without_points["set"];
        (set["selection.target"], set["part.resting_poses"][0]["quaternion_xyzw"]) = (json!(1), json!([0, 0, 0, 1]));
        let read: AdviceDocument = serde_json::from_value(without_points).expect("advice");
        assert_eq!(serde_json::to_string(&read).expect("JSON"), text);
    }

    #[test]
    fn a_pose_of_advice_has_few_digits_and_is_a_rotation() {
        let turn = nalgebra::UnitQuaternion::from_euler_angles(0.3, -1.1, 2.7);
        let pose = Pose::from_parts(nalgebra::Vector3::new(35.468_808_054_3, -1e-9, 43.522_333_4), turn);
        let spec = rounded(&pose);
        assert_eq!(serde_json::to_value(spec.translation_mm).expect("JSON"), json!([35.4688, 0.0, 43.5223]));
        let mut findings = Findings::default();
        spec.check("", &mut findings);
        assert_eq!(findings.into_result(), Ok(()));
        assert!(spec.pose::<Table, Part>().isometry().rotation.angle_to(&turn) < 1e-6);
    }

    #[test]
    fn poses_to_choose_from_are_left_to_the_document_and_quoted_for_the_command_line() {
        let pose = crate::geometry::Pose::identity();
        let told =
            document(&advice(AdviceKind::TurnOver, vec![ParamChange::Setups(2), ParamChange::RestingPoses(vec![pose, pose])]));
        assert!(told.text.contains("(setups = 2, part.resting_poses as in plan.json)"), "{}", told.text);
        assert!(told.options().starts_with("--set setups=2 --set 'part.resting_poses=[{"), "{}", told.options());
        assert_eq!(told.set["part.resting_poses"].as_array().map(Vec::len), Some(2));
    }
}

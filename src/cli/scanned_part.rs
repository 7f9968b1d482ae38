//! Part, cell and plan of commands on scans.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use utoipa::ToSchema;

use super::check::fixture_of;
use super::given_params::{insert, named_by_sets, warn_of_replaced};
use super::plan::{load_cell, load_mesh, load_scanner};
use super::{CliError, files, output, set_value};
use crate::cell::{Cell, FieldError, Scanner, did_you_mean};
use crate::geometry::{LengthUnit, Mesh};
use crate::service::inspect_job::{InspectedPart, viewpoints_without_scan};
use crate::service::plan_job::{PLAN_FILE, plan_sha256};
use crate::service::rescan_job::RESCAN_STATE_FILE;
use crate::wire::decode;
use crate::wire::inspection::{RescanState, ranges};
use crate::wire::plan::PlanDocument;
use crate::wire::run::{RunMode, RunRecordDocument};

/// The plan that was scanned, and what it was made for.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct ScannedPartArgs {
    /// Plan: plan.json, or the folder that `vantage plan` wrote.
    #[arg(value_name = "PLAN")]
    plan: PathBuf,
    /// Part as it was planned: an STL, OBJ or PLY file.
    #[arg(long)]
    mesh: PathBuf,
    /// Unit of the mesh files, required: mm, cm, m or inch.
    #[arg(long)]
    unit: Option<LengthUnit>,
    /// Fixture that the plan was made with, in the part's coordinates and unit [default: the file that the plan names].
    #[arg(long)]
    fixture: Option<PathBuf>,
    /// Cell of the plan: a preset name, or a TOML or JSON file [default: the preset that the plan names].
    #[arg(long)]
    cell: Option<String>,
    /// Scanner of a plan without a cell: a preset name, or a TOML or JSON file [default: the preset that the plan names].
    #[arg(long)]
    scanner: Option<String>,
}

/// The run in which the scans are taken.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct RecordArgs {
    /// Record of the run that takes the scans (`vantage run --record`); its measured poses are used in place of the plan's.
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
}

impl RecordArgs {
    /// Reads the record, where there is one.
    pub(super) fn load(&self) -> Result<Option<RunRecordDocument>, CliError> {
        self.record.as_deref().map(read_record).transpose()
    }

    /// Refuses the record of a run of another plan, whose views were taken from elsewhere.
    pub(super) fn check_plan(&self, record: Option<&RunRecordDocument>, plan_sha256: &str) -> Result<(), CliError> {
        match (&self.record, record) {
            (Some(path), Some(record)) if record.run.plan_sha256 != plan_sha256 => Err(CliError::BadInput(format!(
                "{}: is the record of a run of another plan\n  → name the record of the run that carried out this one's program",
                path.display()
            ))),
            _ => Ok(()),
        }
    }

    /// Warns of views that the run did not scan: their planned poses are taken.
    pub(super) fn warn_of_missing(&self, record: Option<&RunRecordDocument>, plan: &PlanDocument) {
        if let Some((path, detail)) = self.record.as_ref().zip(record.and_then(|record| missing_scans(record, plan))) {
            output::warning(&path.display().to_string(), "/steps", &detail, "give the record of the run that took these scans");
        }
    }
}

/// Views of a plan that a run did not scan, in a clause; `None` where it scanned all.
fn missing_scans(record: &RunRecordDocument, plan: &PlanDocument) -> Option<String> {
    let missing = viewpoints_without_scan(plan, record);
    let words = if missing.len() == 1 { "viewpoint" } else { "viewpoints" };
    (!missing.is_empty()).then(|| format!("has no scan of {words} {}: the poses of the plan are taken there", ranges(&missing)))
}

/// A plan that was read, with part and hardware.
pub(super) struct ScannedPart {
    pub(super) plan: PlanDocument,
    pub(super) plan_bytes: Vec<u8>,
    pub(super) plan_sha256: String,
    pub(super) mesh: Mesh,
    pub(super) fixture: Option<Mesh>,
    /// SHA-256 of the fixture's file.
    pub(super) fixture_sha256: Option<String>,
    pub(super) name: String,
    pub(super) scanner: Scanner,
    pub(super) cell: Option<Cell>,
}

impl ScannedPartArgs {
    /// Unit of the mesh files.
    pub(super) fn unit(&self) -> LengthUnit {
        self.unit.unwrap_or(LengthUnit::Millimetre)
    }

    /// Reads every file, and holds part and hardware against the plan.
    pub(super) fn load(&self, cancel: &AtomicBool) -> Result<ScannedPart, CliError> {
        let path = if self.plan.is_dir() { self.plan.join(PLAN_FILE) } else { self.plan.clone() };
        let shown = path.display().to_string();
        let plan_bytes = std::fs::read(&path).map_err(|error| files::unreadable(&path, &error))?;
        let plan: PlanDocument = files::from_value(files::value(&path)?, &shown)?;
        let of_plan = plan.cell.as_ref().map_or("none", |cell| cell.name.as_str());
        let cell = self.cell.as_deref().unwrap_or(of_plan);
        let cell = load_cell(cell, self.scanner.as_deref()).map_err(|error| named(error, self.cell.is_none(), "--cell"))?;
        let scanner = self.scanner.as_deref().unwrap_or(&plan.scanner.name);
        let scanner = load_scanner(cell.as_ref(), Some(scanner));
        let scanner = scanner.map_err(|error| named(error, self.scanner.is_none(), "--scanner"))?;
        let (part, _) = load_mesh(&self.mesh, self.unit, cancel)?;
        let (fixture, fixture_sha256) = fixture_of(&plan, self.fixture.as_deref(), self.unit, cancel)?.unzip();
        let name = self.mesh.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        let scanned = ScannedPart {
            plan_sha256: plan_sha256(&plan_bytes),
            fixture,
            fixture_sha256,
            mesh: part.mesh,
            plan,
            plan_bytes,
            name,
            scanner,
            cell,
        };
        scanned.part().check(&scanned.plan).map_err(|errors| files::findings(&shown, &errors))?;
        Ok(scanned)
    }
}

/// The error on a file that the plan names and nobody gave: which option names it.
fn named(error: CliError, is_of_plan: bool, option: &str) -> CliError {
    match error {
        CliError::BadInput(text) if is_of_plan => CliError::BadInput(format!("{text}\n  → name the file with {option}")),
        CliError::BadInput(_)
        | CliError::Failed(_)
        | CliError::Findings(_)
        | CliError::NoPlan(_)
        | CliError::RegionsUnmet(_)
        | CliError::NotCalibrated(_)
        | CliError::Cancelled(_) => error,
    }
}

fn read_record(path: &Path) -> Result<RunRecordDocument, CliError> {
    let shown = path.display().to_string();
    let record: RunRecordDocument = files::of_kind(files::value(path)?, ("a record of a run", None), &shown)?;
    if record.run.mode == RunMode::DryRun {
        return Err(CliError::BadInput(format!(
            "{shown}: is the record of a dry run, which moves nothing and takes no scans\n  → name the record of the run in which \
             they were taken, or leave --record out, to use the poses of the plan"
        )));
    }
    Ok(record)
}

impl ScannedPart {
    /// Part and hardware.
    pub(super) fn part(&self) -> InspectedPart<'_> {
        InspectedPart {
            mesh: &self.mesh,
            fixture: self.fixture.as_ref(),
            name: &self.name,
            scanner: &self.scanner,
            cell: self.cell.as_ref(),
        }
    }
}

/// Parameters with defaults, changed by every `--set KEY=VALUE`, and checked.
pub(super) fn with_sets<T>(sets: &[String], check: impl Fn(&T) -> Result<(), Vec<FieldError>>) -> Result<T, CliError>
where
    T: Default + Serialize + DeserializeOwned + ToSchema + 'static,
{
    let mut value = serde_json::to_value(T::default()).unwrap_or(Value::Null);
    for set in sets {
        let keys = known_keys(&value);
        let (key, text) = set.split_once('=').ok_or_else(|| {
            CliError::BadInput(format!("--set {set}: not of the form KEY=VALUE; the parameters are {}", keys.join(", ")))
        })?;
        let known = value.pointer(&format!("/{}", key.replace('.', "/"))).is_some();
        if !known {
            let (question, known) = (did_you_mean(key, keys.iter().map(String::as_str)), keys.join(", "));
            let told = format!("{key} is not a parameter{question} (the parameters are {known})");
            return Err(CliError::BadInput(format!("--set {set}: {told}")));
        }
        let inserted = set_value::parse(key, text).and_then(|new| insert(&mut value, key, new));
        inserted.map_err(|reason| CliError::BadInput(format!("--set {set}: {reason}")))?;
    }
    warn_of_replaced(sets);
    let read: Result<T, CliError> = files::from_value(value, "parameters");
    let checked = read.and_then(|params| match check(&params) {
        Ok(()) => Ok(params),
        Err(errors) => Err(files::findings("parameters", &errors)),
    });
    checked.map_err(|error| named_by_sets(error, sets))
}

/// Keys of a value that are no tables.
fn known_keys(value: &Value) -> Vec<String> {
    fn add(prefix: &str, value: &Value, keys: &mut Vec<String>) {
        match value.as_object() {
            Some(table) => table.iter().for_each(|(name, value)| add(&format!("{prefix}.{name}"), value, keys)),
            None => keys.push(prefix.trim_start_matches('.').to_owned()),
        }
    }
    let mut keys = Vec::new();
    add("", value, &mut keys);
    keys
}

/// Reads the state that an inspection left, from its folder or its file.
pub(super) fn read_state(inspection: &Path) -> Result<RescanState, CliError> {
    let file = if inspection.is_dir() { inspection.join(RESCAN_STATE_FILE) } else { inspection.to_owned() };
    let shown = file.display().to_string();
    if inspection.is_dir() && !file.is_file() {
        let what = format!("{}: has no {RESCAN_STATE_FILE}", inspection.display());
        return Err(CliError::BadInput(format!("{what}\n  → name the folder that `vantage compare` wrote")));
    }
    decode(&files::value(&file)?)
        .map_err(|error| CliError::BadInput(format!("{shown}: {error}\n  → name the folder that `vantage compare` wrote")))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::cli::planned_block::plan_of_two_views;
    use crate::geometry::mesh_io::write_stl;
    use crate::inspection::InspectionParams;
    use crate::planning::params::RescanParams;
    use crate::testing::{box_mesh, nominal_scanner};
    use crate::wire::run::RUN_RECORD_SCHEMA;

    /// Any mesh was taken for the fixture, and one that was left out was not missed: a rescan planned its views through it.
    #[test]
    fn the_fixture_has_to_be_the_one_of_the_plan() {
        let folder = tempfile::tempdir().expect("a folder");
        let stl = |name: &str, mesh: &Mesh| {
            let (path, bytes) = (folder.path().join(name), write_stl(mesh));
            std::fs::write(&path, &bytes).expect("a file");
            (path, plan_sha256(&bytes))
        };
        let block = box_mesh([0.0; 3], [60.0, 40.0, 30.0]);
        let [low, high] = [10.0, 20.0].map(|height_mm| box_mesh([70.0, 0.0, 0.0], [80.0, 10.0, height_mm]));
        let (mesh, _) = stl("part.stl", &block);
        let (clamp, clamp_sha256) = stl("clamp.stl", &low);
        let (vice, _) = stl("vice.stl", &high);
        let load = |plan: &Value, fixture: Option<&Path>| {
            let (path, fixture) = (folder.path().join(PLAN_FILE), fixture.map(Path::to_owned));
            std::fs::write(&path, plan.to_string()).expect("a file");
            let (mesh, unit) = (mesh.clone(), Some(LengthUnit::Millimetre));
            let args = ScannedPartArgs { plan: path, mesh, unit, fixture, cell: None, scanner: None };
            let loaded = args.load(&AtomicBool::new(false));
            loaded.map(|scanned| scanned.fixture_sha256).map_err(|error| error.to_string())
        };
        let mut plan = plan_of_two_views();
        assert_eq!(load(&plan, None), Ok(None));
        let told = load(&plan, Some(clamp.as_path())).expect_err("it has none");
        assert!(told.contains("clamp.stl: the plan was made without a fixture"), "{told}");
        plan["params"]["part"]["fixture_mesh"] = "nowhere.stl".into();
        let bbox_mm = json!({"min": [70.0, 0.0, 0.0], "max": [80.0, 10.0, 10.0]});
        plan["fixture"] = json!({"sha256": clamp_sha256, "bbox_mm": bbox_mm});
        let told = load(&plan, None).expect_err("it has one");
        assert!(told.starts_with("--fixture: is not given; ") && told.contains("\"nowhere.stl\""), "{told}");
        let told = load(&plan, Some(vice.as_path())).expect_err("another one");
        assert!(told.contains("vice.stl: is not the fixture of the plan: its SHA-256 is "), "{told}");
        assert_eq!(load(&plan, Some(clamp.as_path())), Ok(Some(clamp_sha256.clone())));
        let held: PlanDocument = serde_json::from_value(plan.clone()).expect("a plan");
        plan["params"]["part"]["fixture_mesh"] = clamp.display().to_string().into();
        assert_eq!(load(&plan, None), Ok(Some(clamp_sha256)), "the file at its name");
        let scanner = nominal_scanner();
        for (fixture, told) in [(None, "is not given"), (Some(&low), ""), (Some(&high), "the planned fixture is")] {
            let part = InspectedPart { mesh: &block, fixture, name: "block", scanner: &scanner, cell: None };
            let found = part.check(&held).err().unwrap_or_default();
            let is_told = found.iter().any(|error| error.pointer == "/fixture" && error.detail.contains(told));
            assert_eq!(is_told, !told.is_empty(), "{told:?}: {found:?}");
        }
    }

    /// A misspelled parameter was told every parameter, and not the one that was meant.
    #[test]
    fn a_misspelled_parameter_is_told_the_nearest() {
        let told = |set: &str| with_sets(&[set.to_owned()], InspectionParams::check).map(drop).expect_err(set).to_string();
        let misspelled = told("compare.tolerance=0.3");
        let nearest = "--set compare.tolerance=0.3: compare.tolerance is not a parameter; did you mean compare.tolerance_mm? (";
        assert!(misspelled.starts_with(nearest) && misspelled.contains("align.method, "), "{misspelled}");
        let bare = told("compare.tolerance_mm");
        assert!(bare.contains("not of the form KEY=VALUE; the parameters are align.method, "), "{bare}");
    }

    /// The message named `parameters: /compare/tolerance_mm`, which nobody had typed.
    #[test]
    fn a_value_that_is_refused_is_told_at_the_option_that_gave_it() {
        let told = |sets: &[&str]| {
            let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
            with_sets(&sets, InspectionParams::check).map(drop).expect_err("refused").to_string()
        };
        for set in ["compare.tolerance_mm=-1", "compare.tolerance_mm=wide", "align.method=somehow"] {
            let told = told(&[set]);
            assert!(told.starts_with(&format!("--set {set}: ")) && !told.contains("parameters"), "{told}");
        }
        let later = told(&["align.prior_mm=0.1", "align.prior_mm=1e9"]);
        assert!(later.starts_with("--set align.prior_mm=1e9: is "), "the one that counts: {later}");
        let rescan = |set: &str| with_sets(&[set.to_owned()], RescanParams::check).map(drop).expect_err(set).to_string();
        assert!(rescan("max_views=0").starts_with("--set max_views=0: is 0"), "{}", rescan("max_views=0"));
        assert!(rescan("max_views=many").starts_with("--set max_views=many: "), "{}", rescan("max_views=many"));
    }

    /// The missing file was told, and not which folder is meant.
    #[test]
    fn a_folder_without_an_inspection_says_which_one_to_name() {
        let folder = tempfile::tempdir().expect("a folder");
        let told = read_state(folder.path()).map(drop).expect_err("it is empty").to_string();
        assert!(told.ends_with("has no rescan.json\n  → name the folder that `vantage compare` wrote"), "{told}");
    }

    /// The record of a run of the plan `ab`, in a file.
    fn record_of(mode: RunMode, folder: &Path) -> RecordArgs {
        let path = folder.join("run.json");
        let run = json!({
            "id": "01a1f77c-78a1-7554-855a-a9513c22aa2b", "state": "done", "reason": "all_steps", "mode": mode.as_str(), "setup": 0,
            "cell": "cell", "plan_sha256": "ab", "program_sha256": "cd", "speed_override": 1.0, "time_factor": 1.0,
            "single_step": false, "from_step": 0, "locate": false, "step": 9, "steps": 9, "scans": 3, "planned_secs": 9.0,
            "elapsed_secs": 9.0, "objections": [], "created_at": "", "notice": "",
        });
        let record = json!({"schema": RUN_RECORD_SCHEMA, "run": run, "steps": []});
        std::fs::write(&path, record.to_string()).expect("a file");
        RecordArgs { record: Some(path) }
    }

    /// The record of a dry run was once accepted, and so was that of another plan, whose poses then counted.
    #[test]
    fn a_record_has_to_be_of_a_run_of_the_plan_that_takes_scans() {
        let folder = tempfile::tempdir().expect("a folder");
        let refused = |result: Result<(), CliError>, wanted: [&str; 3]| {
            let Err(CliError::BadInput(told)) = result else { panic!("{result:?}") };
            assert!(wanted.iter().all(|words| told.contains(*words)), "{told}");
        };
        let dry = record_of(RunMode::DryRun, folder.path()).load().map(drop);
        refused(dry, ["run.json", "a dry run, which moves nothing", "leave --record out"]);
        let of_run = record_of(RunMode::Live, folder.path());
        let record = of_run.load().expect("a record");
        of_run.check_plan(record.as_ref(), "ab").expect("its plan");
        refused(of_run.check_plan(record.as_ref(), "ef"), ["run.json", "of another plan", "this one's program"]);
        // The poses of the plan were taken without a word for views that a run had not scanned.
        let plan: PlanDocument = serde_json::from_value(plan_of_two_views()).expect("a plan");
        let missing = record.and_then(|record| missing_scans(&record, &plan)).expect("no scan at all");
        assert_eq!(missing, "has no scan of viewpoints 0 to 1: the poses of the plan are taken there");
        let none = RecordArgs { record: None };
        none.check_plan(none.load().expect("nothing to read").as_ref(), "ef").expect("the poses of the plan");
    }
}

//! Programs in the languages of robot controllers: goldens (`UPDATE_GOLDEN=1` writes them anew), and grammars of the
//! languages written from the vendors' manuals, which read every statement back and hold it against the program.

mod fanuc;
mod hans;
mod krl;
mod rapid;
mod urscript;

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use vantage::cell::{Cell, CollisionScene, Configuration, JointThreeOrigin, Presets, SpecLibrary};
use vantage::geometry::Mesh;
use vantage::planning::context::{Context, Silent};
use vantage::planning::params::{CandidateParams, DialectParams, PlanParams};
use vantage::planning::plan::ViewId;
use vantage::planning::{PlanInput, plan};
use vantage::program::dialects::{CheckedProgram, CheckedWith, Dialect, DialectFile};
use vantage::program::{Move, Program, Step, compile, interlock};

use crate::support::box_mesh;

/// Instruction that a text gives a controller, angles in degrees.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Said {
    /// Demands that arm and table stand there before anything else.
    Begin([f64; 7]),
    /// Goes there and stops.
    Go([f64; 7]),
    /// Waits so many seconds.
    Wait(f64),
    /// Captures.
    Scan,
}

/// A cell, a program for it, and where it was checked.
pub(crate) struct Job {
    pub(crate) cell: Cell,
    pub(crate) program: Program,
    scene: CollisionScene,
}

/// The default cell, with a robot whose language is not known: it takes them all.
fn default_cell() -> Cell {
    let mut cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
    cell.robot.dialect = None;
    cell
}

/// Parameters with which every dialect renders it: angles are written as they are.
fn params() -> DialectParams {
    DialectParams { fanuc_joint_3_from: Some(JointThreeOrigin::Ground), ..DialectParams::default() }
}

impl Job {
    /// A tour near home: the table alone, the arm alone, both, and two scans.
    pub(crate) fn tour() -> Self {
        let cell = default_cell();
        let at = |joints_deg: [f64; 6], table_deg: f64| -> Configuration {
            let off = Configuration { joints_rad: joints_deg.map(f64::to_radians), table_rad: table_deg.to_radians() };
            cell.home_rad.along(&off.axes_rad(), 1.0)
        };
        let home = cell.home_rad;
        let first = at([10.123_456_7, -3.0, 4.0, 5.0, -6.0, 7.0], 45.0);
        let second = at([-10.0, -3.0, 4.0, -0.000_01, 0.0, -7.654_321], -20.0);
        let legs = [
            vec![home, at([0.0; 6], 30.0), at([5.0, 0.0, 0.0, 0.0, 0.0, 0.0], 30.0), first],
            vec![first, second],
            vec![second, home],
        ];
        let axes = cell.axes();
        let go = |points: &[Configuration]| {
            Step::Move(Move {
                via_rad: points[1..points.len() - 1].to_vec(),
                target_rad: points[points.len() - 1],
                speed_fraction: 0.25,
                duration_secs: axes.path_secs(points, 0.25),
                passed_within_rad: None,
            })
        };
        let scan = |view| [Step::Settle { secs: 0.3 }, Step::Scan { view: ViewId(view), brightness: 5, capture_secs: 1.0 }];
        let mut steps = Vec::new();
        for (leg, view) in legs.iter().zip([Some(4), Some(0), None]) {
            steps.push(go(leg));
            steps.extend(view.into_iter().flat_map(scan));
        }
        let program = Program {
            plan_sha256: "0123456789abcdef".repeat(4),
            setup: 0,
            calibration: None,
            robot: cell.robot.name.clone(),
            turntable: cell.turntable.name.clone(),
            home_rad: home,
            cycle_secs: steps.iter().map(Step::secs).sum(),
            steps,
        };
        let scene = CollisionScene::without_part(&cell, 5.0);
        Self { cell, program, scene }
    }

    /// A job that the planner makes of a box on the table.
    pub(crate) fn planned() -> Self {
        let (cell, mesh) = (default_cell(), box_mesh([-30.0, -20.0, 0.0], [30.0, 20.0, 40.0]));
        let mut params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
        params.part.samples_per_mm2 = Some(0.3);
        let (program, scene) = program_of(&mesh, &cell, &params);
        Self { cell, program, scene }
    }

    pub(crate) fn render(&self, dialect: Dialect, params: &DialectParams) -> Vec<DialectFile> {
        let checked = CheckedProgram::new(&self.program, &self.cell, &self.scene, None, CheckedWith::CellAlone).expect("sound");
        checked.render(dialect, params).expect("sayable")
    }

    /// Instructions that have to be given.
    pub(crate) fn wanted(&self, dialect: Dialect) -> Vec<Said> {
        let interlocked = interlock(&self.program, &self.cell, &self.scene).expect("free");
        let program = if dialect.moves_table_with_arm() { &self.program } else { &interlocked };
        let degrees = |point: &Configuration| point.axes_rad().map(f64::to_degrees);
        let mut wanted = vec![Said::Begin(degrees(&program.home_rad))];
        for step in &program.steps {
            match step {
                Step::Move(step) => wanted.extend(step.via_rad.iter().chain([&step.target_rad]).map(|p| Said::Go(degrees(p)))),
                Step::Settle { secs } => wanted.push(Said::Wait(*secs)),
                Step::Scan { .. } => wanted.push(Said::Scan),
            }
        }
        wanted
    }
}

fn program_of(mesh: &Mesh, cell: &Cell, params: &PlanParams) -> (Program, CollisionScene) {
    let cancel = AtomicBool::new(false);
    let input = PlanInput { mesh, fixture: None, part_sha256: "", scanner: &cell.scanner, cell: Some(cell), roadmaps: None };
    let outcome = plan(&input, params, &Context::new(&cancel, &Silent)).expect("a plan");
    let sequence = outcome.plan.sequences().next().expect("with a cell");
    let program = compile(sequence, 0, cell, &"ab".repeat(32), &outcome.plan.params);
    let table_from_part = outcome.plan.table_from_part.expect("with a cell");
    (program, CollisionScene::new(cell, mesh, None, &table_from_part, params.motion.clearance_mm))
}

/// Asserts that `said` is `wanted`, angles to half a unit of the last digit written.
fn assert_said(said: &[Said], wanted: &[Said], last_digit_deg: f64, what: &str) {
    let near = |a: f64, b: f64, by: f64| (a - b).abs() <= by + 1e-9;
    let same = |a: &[f64; 7], b: &[f64; 7]| a.iter().zip(b).all(|(a, b)| near(*a, *b, 0.5 * last_digit_deg));
    for (index, (said, wanted)) in said.iter().zip(wanted).enumerate() {
        let agrees = match (said, wanted) {
            (Said::Begin(a), Said::Begin(b)) | (Said::Go(a), Said::Go(b)) => same(a, b),
            (Said::Wait(a), Said::Wait(b)) => near(*a, *b, 1e-6),
            (Said::Scan, Said::Scan) => true,
            _ => false,
        };
        assert!(agrees, "{what}, {index}: says {said:?}, the program {wanted:?}");
    }
    assert_eq!(said.len(), wanted.len(), "{what}");
}

#[test]
fn each_dialect_is_written_as_before() {
    let job = Job::tour();
    for dialect in Dialect::ALL {
        for file in job.render(dialect, &params()) {
            let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden/dialects")).join(&file.name);
            if std::env::var_os("UPDATE_GOLDEN").is_some() {
                std::fs::write(&path, &file.text).expect("the golden file");
            }
            let wanted = std::fs::read_to_string(&path).unwrap_or_default();
            assert!(file.text == wanted, "{} differs; UPDATE_GOLDEN=1 writes it anew. Found:\n{}", path.display(), file.text);
        }
    }
}

#[test]
fn every_statement_reads_back_as_the_program() {
    let params = DialectParams { scan_output: 3, scan_input: 5, table_axis: 2, ..params() };
    let named =
        DialectParams { program_name: "Gehäuse №7 «end»; 螺丝".to_owned(), fanuc_name_chars: 36, ..params.clone() };
    for (job, what) in [(Job::tour(), "tour"), (Job::planned(), "box")] {
        for params in [&params, &named] {
            for dialect in Dialect::ALL {
                // FANUC programs turn axis 1 of motion group 2 alone.
                let table_axis = if dialect == Dialect::Fanuc { 1 } else { params.table_axis };
                let params = &DialectParams { table_axis, ..params.clone() };
                let files = job.render(dialect, params);
                let (said, last_digit_deg) = match dialect {
                    Dialect::Hans => (hans::read(&files[0], params), 1e-4),
                    Dialect::Urscript => (urscript::read(&files[0], params), 1e-4),
                    Dialect::Rapid => (rapid::read(&files[0], params), 1e-4),
                    Dialect::Krl => (krl::read(&files, params), 1e-4),
                    Dialect::Fanuc => (fanuc::read(&files[0], params), 1e-3),
                    // The one is read by Python (`oracle_dialects`), the other by the tests of its own module.
                    Dialect::Robodk | Dialect::Csv => continue,
                };
                assert_said(&said, &job.wanted(dialect), last_digit_deg, &format!("{dialect:?} of the {what}"));
            }
        }
    }
}

/// An answer that was still on was that of the next capture too.
#[test]
fn a_scan_begins_once_the_answer_before_is_off_and_not_at_all_where_the_input_stays_on() {
    let file = Job::tour().render(Dialect::Urscript, &params()).remove(0);
    let begun = |on_for_secs: f64| urscript::secs_of_pulse(&file, on_for_secs);
    assert_eq!(begun(0.0), Ok(0.0));
    let begun_secs = begun(0.5).expect("a pulse");
    assert!((0.5..0.6).contains(&begun_secs), "{begun_secs} s");
    assert_eq!(begun(f64::INFINITY), Err("The scanner's input stays on".to_owned()));
}

/// Text that is wrong must not read back as right.
#[test]
fn the_grammars_refuse_what_is_no_statement() {
    let (job, params) = (Job::tour(), params());
    let broken = |dialect: Dialect, from: &str, to: &str, read: fn(&[DialectFile], &DialectParams) -> Vec<Said>| {
        let mut files = job.render(dialect, &params);
        let text = files[0].text.replacen(from, to, 1);
        assert_ne!(text, files[0].text, "{dialect:?} has {from:?}");
        files[0].text = text;
        assert!(std::panic::catch_unwind(|| read(&files, &params)).is_err(), "{dialect:?} takes {to:?}");
    };
    broken(Dialect::Rapid, "fine,tool0;", "fine,tool0", |f, p| rapid::read(&f[0], p));
    broken(Dialect::Rapid, "ENDPROC", "END", |f, p| rapid::read(&f[0], p));
    broken(Dialect::Krl, "ENDWHILE", "", krl::read);
    broken(Dialect::Krl, "PTP XP1", "PTP XP99", krl::read);
    broken(Dialect::Urscript, "halt\n  end", "halt", |f, p| urscript::read(&f[0], p));
    broken(Dialect::Urscript, "r=0)", "r=0", |f, p| urscript::read(&f[0], p));
    broken(Dialect::Urscript, "warning=True, blocking=True", "warning=True", |f, p| urscript::read(&f[0], p));
    broken(Dialect::Fanuc, "FINE ACC25 ;", "CNT100 ACC25 ;", |f, p| fanuc::read(&f[0], p));
    broken(Dialect::Fanuc, "J6=", "J7=", |f, p| fanuc::read(&f[0], p));
    broken(Dialect::Hans, "SetBoxDO,1,1,;", "SetBoxDO,1,1;", |f, p| hans::read(&f[0], p));
    // A scan that does not wait until the answer to the one before is off.
    broken(Dialect::Rapid, "    WaitDI scan_input,0\\MaxTime:=30.000;\n", "", |f, p| rapid::read(&f[0], p));
    broken(Dialect::Krl, "WHILE $IN[1]\n", "WHILE FALSE\n", krl::read);
    broken(Dialect::Urscript, "while get_standard_digital_in(1):", "while False:", |f, p| urscript::read(&f[0], p));
    broken(Dialect::Fanuc, "WAIT DI[1]=OFF ", "WAIT DI[1]=ON ", |f, p| fanuc::read(&f[0], p));
    broken(Dialect::Hans, "@off 1 30.000\n", "", |f, p| hans::read(&f[0], p));
}

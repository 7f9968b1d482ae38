//! `vantage calibrate poses`: the poses from which observations tell most.

use std::path::PathBuf;
use std::str::FromStr;
use std::sync::atomic::AtomicBool;

use super::pose_files::PoseFiles;
use crate::cell::calibration::data::Sigma;
use crate::cell::calibration::poses::{PlannedBoard, PlannedPose, PosePlan, PosePlanner, board_on_plate};
use crate::cell::calibration::refine::Square;
use crate::cell::{Cell, CloudFrame, CloudFrameSpec, CollisionScene, PoseSpec};
use crate::check::field_errors;
use crate::cli::check::cell;
use crate::cli::files;
use crate::cli::ranges::{number, whole};
use crate::cli::{CliError, output};
use crate::geometry::{Board, Plate, Pose};
use crate::planning::context::{Context, Silent};
use crate::planning::params::PlanParams;
use crate::program::dialects::{CheckedProgram, CheckedWith, Dialect, DialectFile};
use crate::program::{Program, compile};
use crate::service::calibration_poses::{RoutedPoses, TooFewPoses, expected, route};
use crate::service::plan_job::plan_sha256;
use crate::wire::calibration::{CALIBRATION_POSES_SCHEMA, CalibrationPosesDocument, PlannedPoseDocument};
use crate::wire::echo::Echo;
use crate::wire::json_file_bytes;
use crate::wire::program::ProgramDocument;
use crate::wire::words::counted;

/// Plan calibration poses: reachable, collision-free, with the board in view, most informative first.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Example:
  vantage calibrate poses --cell my-cell.toml --count 15 --board 11x8x15 \\
      --out poses.json")]
pub(super) struct PosesArgs {
    /// Cell: a preset name, or a TOML or JSON file.
    #[arg(long, default_value = "e05-transcan")]
    cell: String,
    /// Number of poses to calibrate from, 4 to 200; 12 or more are recommended.
    #[arg(long, default_value_t = 15, value_parser = whole::<u16>(4..=200))]
    count: u16,
    /// Number of further poses to hold out as a test, 0 to 50.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = whole::<u16>(0..=50))]
    hold_out: u16,
    /// Board: COLUMNSxROWSxSQUARE, the numbers of inner corners and the edge of a square in mm.
    #[arg(long, value_name = "CxRxMM", default_value = "11x8x15")]
    board: BoardSize,
    /// Height of the board above the plate, mm, 0 to 1000.
    #[arg(long, value_name = "MM", default_value_t = 10.0, value_parser = number)]
    height: f64,
    /// Smallest distance between bodies, mm, 1 to 200 [default: 5, as for plans].
    #[arg(long, value_name = "MM", value_parser = number)]
    clearance: Option<f64>,
    /// JSON file to write the poses to [default: standard output]. A checked program.json that moves to them is written beside
    /// it; programs of the poses that were in the file before are replaced or removed.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Controller language, such as urscript, in which to write the program too, beside program.json.
    #[arg(long, value_name = "DIALECT", requires = "out")]
    program: Option<Dialect>,
}

/// Fewest inner corners of a board along a side.
const MIN_CORNERS: f64 = 3.0;
/// Smallest square of a board, mm: smaller ones are given in metres.
const MIN_SQUARE_MM: f64 = 0.5;
/// Length that the columns of a board together stay below, mm.
const MAX_BOARD_MM: f64 = 2000.0;

/// Extent of a board.
#[derive(Clone, Copy, Debug, PartialEq)]
struct BoardSize([f64; 2]);

impl FromStr for BoardSize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let numbers: Option<Vec<f64>> = text.split(['x', 'X', '×']).map(|number| number.trim().parse().ok()).collect();
        let finite = numbers.filter(|numbers| numbers.iter().all(|number| number.is_finite()));
        let Some([columns, rows, edge]) = finite.as_deref() else {
            return Err("give COLUMNSxROWSxSQUARE, as in 11x8x15".to_owned());
        };
        let refused = |found: String| {
            Err(format!(
                "{found}; allowed are {MIN_CORNERS} or more corners each way, squares of {MIN_SQUARE_MM} mm or more, and {MAX_BOARD_MM} \
                 mm for all columns together, as in 11x8x15"
            ))
        };
        match () {
            () if columns.min(*rows) < MIN_CORNERS => refused(format!("has {columns} x {rows} corners")),
            () if *edge < MIN_SQUARE_MM => refused(format!("has squares of {edge} mm: metres?")),
            () if columns * edge >= MAX_BOARD_MM => {
                refused(format!("has squares of {edge} mm, {} mm for all columns", columns * edge))
            }
            () => Ok(Self([(columns - 1.0) * edge, (rows - 1.0) * edge])),
        }
    }
}

/// Plans the poses.
pub(super) fn run(args: &PosesArgs) -> Result<(), CliError> {
    if !(0.0..=1000.0).contains(&args.height) {
        return Err(CliError::BadInput(format!("--height: is {} mm; allowed is 0 to 1000 mm", args.height)));
    }
    let place = args.out.as_deref().map(PoseFiles::at).transpose()?;
    let params = params(args.clearance)?;
    let cell = cell(&args.cell)?;
    let BoardSize(size_mm) = args.board;
    let frame = cell.scanner.cloud_frame.unwrap_or(CloudFrameSpec::Named(CloudFrame::Scanner));
    let planner = PosePlanner {
        cell: &cell,
        board: PlannedBoard { size_mm, plate_from_board: board_on_plate(size_mm, args.height) },
        sigma: Sigma::CALIBRATED_ARM,
        clearance_mm: params.motion.clearance_mm,
        scanner_from_cloud: frame.scanner_from_cloud(&cell.scanner.devices),
    };
    let (count, hold_out) = (usize::from(args.count), usize::from(args.hold_out));
    let (never, scene) = (AtomicBool::new(false), planner.scene());
    let ctx = Context::new(&never, &Silent);
    let routed = route(&planner, &scene, (count, hold_out), &params, &ctx);
    let routed =
        routed.map_err(|_| CliError::Failed("cancelled".to_owned()))?.map_err(|TooFewPoses { reached, without_path }| {
            let is_given_up = reached - without_path >= count + hold_out;
            let pathless = match (without_path, is_given_up) {
                (0, _) => String::new(),
                (some, false) => format!(", {some} of them without a collision-free path"),
                (some, true) => format!(", to {some} of them no collision-free path was found, which ended the search"),
            };
            CliError::NoPlan(format!(
                "the arm reaches {} with the whole board in view{pathless}, and {} are needed: use a smaller board, move it, or \
             ask for fewer",
                counted(reached, "pose"),
                count + hold_out
            ))
        })?;
    let document = document(&routed.plan, &planner, &cell, hold_out);
    let bytes = json_file_bytes(&document);
    let program = Linted::new(&planner, &scene, &routed, &plan_sha256(&bytes), &params)?;
    let written = place.as_ref().map_or(Ok(Vec::new()), |place| program.write(place, &bytes, args.program))?;
    let lines: String = written.iter().map(|path| format!("{}\n", path.display())).collect();
    output::result(&document, text(&document) + &lines)?;
    let work = args.program.and_then(|dialect| dialect.before_first_run_of([&program.program]));
    work.into_iter().for_each(|work| output::note(format!("Before the first run: {work}")));
    Ok(())
}

/// Parameters with the clearance that `--clearance` gives, which is in the range of plans.
fn params(clearance: Option<f64>) -> Result<PlanParams, CliError> {
    let mut params = PlanParams::default();
    params.motion.clearance_mm = clearance.unwrap_or(params.motion.clearance_mm);
    params.check().map_err(|errors| {
        let details: Vec<&str> = errors.iter().map(|error| error.detail.as_str()).collect();
        CliError::BadInput(format!("--clearance: {}", details.join("; ")))
    })?;
    Ok(params)
}

/// Program through the poses, with the files of its languages.
struct Linted {
    program: Program,
    files: Vec<(Dialect, Result<Vec<DialectFile>, String>)>,
}

impl Linted {
    /// Compiles and checks the program, and writes it in every language.
    fn new(
        planner: &PosePlanner<'_>,
        scene: &CollisionScene,
        routed: &RoutedPoses,
        plan_sha256: &str,
        params: &PlanParams,
    ) -> Result<Self, CliError> {
        let program = compile(&routed.sequence, 0, planner.cell, plan_sha256, params);
        let expected = expected(planner, &routed.plan, plan_sha256);
        let checked = CheckedProgram::new(&program, planner.cell, scene, Some(&expected), CheckedWith::Board);
        let checked = checked.map_err(|found| files::findings("program.json", &field_errors(&found)))?;
        let files = Dialect::ALL.map(|dialect| (dialect, checked.render(dialect, &params.dialects).map_err(|e| e.to_string())));
        Ok(Self { files: files.into(), program })
    }

    /// Writes poses and program into one folder, and the program in a language that is asked for. Returns the paths written.
    fn write(&self, place: &PoseFiles<'_>, poses: &[u8], dialect: Option<Dialect>) -> Result<Vec<PathBuf>, CliError> {
        let asked = self.files.iter().find(|(known, _)| Some(*known) == dialect).map(|(_, files)| files);
        let rendered = asked
            .map_or(Ok(&[][..]), |files| files.as_deref().map_err(|error| CliError::BadInput(format!("--program: {error}"))))?;
        let known = self.files.iter().filter_map(|(_, files)| files.as_ref().ok()).flatten();
        let known: Vec<&str> = known.map(|file| file.name.as_str()).collect();
        let program = ProgramDocument::new(&self.program, Echo::default()).to_bytes();
        place.write((poses, &program), rendered, &known)
    }
}

fn document(plan: &PosePlan, planner: &PosePlanner<'_>, cell: &Cell, hold_out: usize) -> CalibrationPosesDocument {
    let used = plan.poses.len() - hold_out;
    let sd = |columns: [usize; 3]| columns.into_iter().map(|column| plan.covariance[(column, column)].sqrt()).fold(0.0, f64::max);
    let pose = |(index, planned): (usize, &PlannedPose)| PlannedPoseDocument {
        id: format!("p{:02}", index + 1),
        joints_deg: planned.configuration.joints_rad.map(f64::to_degrees),
        table_angle_deg: planned.configuration.table_rad.to_degrees(),
        scanner_from_board: PoseSpec::from(&planned.scanner_from_board),
        hold_out: index >= used,
    };
    CalibrationPosesDocument {
        schema: CALIBRATION_POSES_SCHEMA.to_owned(),
        cell: cell.name.clone(),
        plate_from_board: PoseSpec::from(&Pose::<Plate, Board>::claim(planner.board.plate_from_board)),
        poses: plan.poses.iter().enumerate().map(pose).collect(),
        hold_out,
        candidates: plan.candidates,
        rotation_sd_deg: sd([0, 1, 2]).to_degrees(),
        translation_sd_mm: sd([3, 4, 5]),
        axis_sd_mm: plan.covariance[(8, 8)].sqrt().max(plan.covariance[(9, 9)].sqrt()),
        worst_rotation_sd_deg: Some(worst_sd(&plan.covariance, 0).to_degrees()),
        worst_translation_sd_mm: Some(worst_sd(&plan.covariance, 3)),
    }
}

/// Standard deviation of the three unknowns from `first` on in the direction in which it is largest: root of the largest eigenvalue.
fn worst_sd(covariance: &Square, first: usize) -> f64 {
    covariance.fixed_view::<3, 3>(first, first).into_owned().symmetric_eigenvalues().max().max(0.0).sqrt()
}

fn text(document: &CalibrationPosesDocument) -> String {
    let sd = |shift_mm: f64, turn_deg: f64| format!("scanner {shift_mm:.3} mm and {turn_deg:.4}°");
    let expected = sd(document.translation_sd_mm, document.rotation_sd_deg);
    let worst = document.worst_translation_sd_mm.zip(document.worst_rotation_sd_deg);
    // Where an axis is the worst direction, as printed, that is told already.
    let worst = worst.map(|(shift_mm, turn_deg)| sd(shift_mm, turn_deg)).filter(|worst| *worst != expected);
    let worst = worst.map_or_else(String::new, |worst| format!("In the worst direction: {worst}\n"));
    let told = format!(
        "{} poses of {} candidates, {} of them to hold out; expected standard deviation with a calibrated arm: {expected}, table axis \
{:.3} mm\n",
        document.poses.len(),
        document.candidates,
        document.hold_out,
        document.axis_sd_mm
    );
    told + &worst
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::{BoardSize, CalibrationPosesDocument, PosesArgs, Square, params, run, text, worst_sd};
    use crate::cell::PoseSpec;
    use crate::wire::calibration::CALIBRATION_POSES_SCHEMA;

    #[test]
    fn what_the_poses_will_tell_is_told_as_a_standard_deviation() {
        let document = CalibrationPosesDocument {
            schema: CALIBRATION_POSES_SCHEMA.to_owned(),
            cell: "line-4".to_owned(),
            plate_from_board: PoseSpec::default(),
            poses: Vec::new(),
            hold_out: 0,
            candidates: 120,
            rotation_sd_deg: 0.001_2,
            translation_sd_mm: 0.034,
            axis_sd_mm: 0.021,
            worst_rotation_sd_deg: None,
            worst_translation_sd_mm: None,
        };
        let told = text(&document);
        assert!(told.ends_with("scanner 0.034 mm and 0.0012°, table axis 0.021 mm\n"), "{told}");
        let (worst_rotation_sd_deg, worst_translation_sd_mm) = (Some(0.001_21), Some(0.034_4));
        let same = CalibrationPosesDocument { worst_rotation_sd_deg, worst_translation_sd_mm, ..document.clone() };
        assert_eq!(text(&same), told, "the same figures are told once");
        let (worst_rotation_sd_deg, worst_translation_sd_mm) = (Some(0.001_5), Some(0.041));
        let told = text(&CalibrationPosesDocument { worst_rotation_sd_deg, worst_translation_sd_mm, ..document });
        assert!(told.ends_with("table axis 0.021 mm\nIn the worst direction: scanner 0.041 mm and 0.0015°\n"), "{told}");
    }

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        args: PosesArgs,
    }

    /// The program was said to be checked with the part in the cell, and stayed beside the poses of a later run.
    #[test]
    fn the_program_tells_of_the_board_and_goes_with_its_poses() {
        let folder = tempfile::tempdir().expect("a folder");
        let [out, script, program] = ["poses.json", "vantage.cps", "program.json"].map(|name| folder.path().join(name));
        let planned = |options: &[&str]| {
            let shown = out.display().to_string();
            let fixed = ["poses", "--count", "4", "--hold-out", "0", "--out", &shown];
            run(&Line::try_parse_from([&fixed[..], options].concat()).unwrap_or_else(|error| panic!("{error}")).args)
        };
        planned(&["--program", "hans"]).expect("files");
        let told = std::fs::read_to_string(&script).expect("the script");
        assert!(told.contains("calibration board") && !told.contains("with the part in it"), "{told}");
        planned(&[]).expect("files");
        assert!(program.is_file() && !script.exists(), "the script is of the earlier run");
        std::fs::write(&program, "mine").expect("a file");
        let refused = planned(&[]).expect_err("a file of the user");
        assert!(refused.exit_code() == 2 && refused.to_string().contains("program.json beside it"), "{refused}");
        assert_eq!(std::fs::read_to_string(&program).expect("there"), "mine");
    }

    #[test]
    fn the_worst_direction_may_lie_between_the_axes() {
        let mut covariance = Square::identity();
        (covariance[(3, 4)], covariance[(4, 3)]) = (0.5, 0.5);
        assert!((worst_sd(&covariance, 3) - 1.5_f64.sqrt()).abs() < 1e-12, "{covariance}");
        assert!((worst_sd(&covariance, 0) - 1.0).abs() < 1e-12, "{covariance}");
    }

    #[test]
    fn a_clearance_out_of_range_is_told_the_range() {
        for clearance in [-5.0, 0.5, 201.0, f64::NAN] {
            let refused = params(Some(clearance)).expect_err("out of range").to_string();
            assert!(refused.starts_with("--clearance: is ") && refused.contains("allowed is 1 to 200 mm"), "{refused}");
        }
        let kept = |clearance: Option<f64>| params(clearance).expect("in range").motion.clearance_mm;
        assert_eq!((kept(Some(12.5)), kept(None)), (12.5, 5.0));
    }

    #[test]
    fn a_board_out_of_range_is_told_the_range() {
        assert_eq!("11x8x15".parse(), Ok(BoardSize([150.0, 105.0])));
        let refused = |text: &str| text.parse::<BoardSize>().expect_err(text);
        assert!(refused("11x8x0.015").starts_with("has squares of 0.015 mm: metres?; allowed are 3 or more corners each way"));
        assert!(refused("11x8x15000").contains("165000 mm for all columns; allowed are"));
        assert!(refused("2x8x15").starts_with("has 2 x 8 corners") && refused("11x8").starts_with("give COLUMNSxROWSxSQUARE"));
    }
}

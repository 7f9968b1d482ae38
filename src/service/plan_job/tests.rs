use super::*;
use crate::cell::{CollisionScene, Configuration, Presets, SpecLibrary};
use crate::planning::ids::ViewId;
use crate::program::{Move, Step};
use crate::testing::box_mesh;

/// The default cell, whose robot is Han's.
fn cell() -> Cell {
    Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("it builds")
}

/// A program that turns the table, scans at each of some brightness levels, and turns it back.
fn program(cell: &Cell, levels: &[u8]) -> Program {
    let (home, mut turned) = (cell.home_rad, cell.home_rad);
    turned.table_rad += 0.5;
    let travel = |from: Configuration, target_rad: Configuration| {
        Step::Move(Move {
            via_rad: Vec::new(),
            target_rad,
            speed_fraction: 0.25,
            duration_secs: cell.axes().path_secs([&from, &target_rad], 0.25),
            passed_within_rad: None,
        })
    };
    let scans = levels.iter().map(|&brightness| Step::Scan { view: ViewId(7), brightness, capture_secs: 1.0 });
    let mut steps = vec![travel(home, turned), Step::Settle { secs: 0.3 }];
    steps.extend(scans);
    steps.push(travel(turned, home));
    Program {
        plan_sha256: "0123456789abcdef".repeat(4),
        setup: 0,
        calibration: None,
        robot: cell.robot.name.clone(),
        turntable: cell.turntable.name.clone(),
        home_rad: home,
        cycle_secs: steps.iter().map(Step::secs).sum(),
        steps,
    }
}

/// Cycle of the program in a dialect, and its file with what is refused, as a plan with these parameters has them.
fn told(dialect: Dialect, levels: &[u8], params: &DialectParams) -> (Result<Option<ProgramCycle>, String>, Vec<Artifact>) {
    let mut cell = cell();
    cell.robot.dialect = Some(dialect);
    let (scene, programs) = (CollisionScene::without_part(&cell, 5.0), [program(&cell, levels)]);
    let checked = CheckedProgram::new(&programs[0], &cell, &scene, None, CheckedWith::CellAlone).expect("sound");
    let rendered = vec![in_dialect(Ok(&checked), dialect, "program", params)];
    let cycle = own_cycle((dialect, params), &programs, &[Ok(checked)], &rendered);
    let (mut files, mut refused) = (Files::new(), Refused::new());
    rendered.into_iter().flatten().for_each(|program| program.sort_into(&mut files, &mut refused));
    files.push((REFUSED_FILE.into(), json_file_bytes(&refused)));
    (cycle, files.into_iter().map(|(name, bytes)| Artifact { name, bytes }).collect())
}

#[test]
fn a_program_that_is_refused_has_no_cycle_but_a_reason() {
    let far = DialectParams { scan_output: 12, ..DialectParams::default() };
    for (dialect, params, file, reason) in [
        (Dialect::Hans, &far, "program.cps", "dialects.scan_output is 12; hans has 0 to 7"),
        (Dialect::Fanuc, &DialectParams::default(), "program.ls", "dialects.fanuc_joint_3_from"),
    ] {
        let (cycle, files) = told(dialect, &[5], params);
        let refused = cycle.expect_err("refused");
        assert!(refused.contains(reason), "{refused}");
        assert!(bytes_of(&files, file).is_empty(), "{file} is written");
        assert_eq!(refused_programs(&files, dialect), [(file.to_owned(), refused)]);
        assert_eq!(refused_programs(&files, Dialect::Rapid), [], "another language's are not the robot's");
    }
    // One warning for a program of two files.
    let none = DialectParams { scan_input: 0, ..DialectParams::default() };
    let (_, files) = told(Dialect::Krl, &[5], &none);
    let names: Vec<String> = refused_programs(&files, Dialect::Krl).into_iter().map(|(name, _)| name).collect();
    assert_eq!(names, ["program.src"]);
}

#[test]
fn a_program_that_is_written_has_its_cycle_and_the_work_before_its_first_run() {
    let cycle = |dialect, levels: &[u8]| {
        let (cycle, files) = told(dialect, levels, &DialectParams::default());
        assert_eq!(refused_programs(&files, dialect), []);
        cycle.expect("written").expect("a program")
    };
    assert_eq!(cycle(Dialect::Hans, &[5, 9]).before_first_run, None, "the sender is told each level");
    assert_eq!(cycle(Dialect::Robodk, &[5]).before_first_run, None);
    let work = cycle(Dialect::Robodk, &[5, 9]).before_first_run.expect("the levels");
    assert!(work.contains("(5 and 9)"), "{work}");
    let none = DialectParams::default();
    assert_eq!(own_cycle((Dialect::Hans, &none), &[], &[], &[]), Ok(None), "no cell, or no view");
}

/// Nothing said that a KUKA controller takes the files of a plan under the name of their module alone.
#[test]
fn a_program_whose_files_have_other_names_on_the_controller_says_under_which_to_copy_them() {
    let params = DialectParams { program_name: "bracket".to_owned(), ..DialectParams::default() };
    let (cycle, _) = told(Dialect::Krl, &[5, 9], &params);
    let cycle = cycle.expect("written").expect("a program");
    let text = cycle.before_first_run_text().expect("work");
    let wanted = "copy program.src and program.dat to the controller as BRACKET.src and BRACKET.dat (vantage program writes";
    assert!(text.contains(wanted) && text.contains("; and have the scanner's own software switch"), "{text}");
    let stems = [0, 1].map(|setup| (setup, program_stem(setup)));
    let two = Dialect::Krl.renaming_of(&params, &stems).expect("names");
    assert!(two.contains(" as BRACKET.src, BRACKET.dat, BRACKET_2.src and BRACKET_2.dat ("), "{two}");
    assert_eq!(Dialect::Rapid.renaming_of(&params, &stems), None, "it takes any name");
}

/// "as read in inch" was told of a part in inches.
#[test]
fn a_part_in_inches_is_told_its_unit_as_people_write_it() {
    let (cell, params) = (cell(), PlanParams::default());
    let mesh = box_mesh([-1500.0, -50.0, 0.0], [1500.0, 50.0, 40.0]);
    let job = PlanJob {
        mesh: &mesh,
        fixture: None,
        fixture_sha256: None,
        part_name: "beam".to_owned(),
        part_sha256: "",
        unit: LengthUnit::Inch,
        scanner: &cell.scanner,
        cell: Some(&cell),
        roadmaps: None,
        rescan: None,
        params: &params,
        echo: Echo::default(),
        date: None,
    };
    let told = |pointer: &str| {
        let error = FieldError { pointer: pointer.to_owned(), detail: "is not allowed".to_owned() };
        job.error_of_part(&error, false).expect("an error of the part")
    };
    let (size, lies) = (told("/part"), told("/part/table_from_part"));
    assert!(size.starts_with("is not allowed (read in inches; it would fit if the file is in mm (118.1 ×"), "{size}");
    assert!(lies.starts_with("is 3000 × 100.0 × 40.0 mm as read in inches; in the middle of the plate"), "{lies}");
}

use std::collections::BTreeSet;

use super::names::{NameRule, comment, identifier, wrap};
use super::numbers::{DEGREE, angles, fixed};
use super::walk::{Action, actions};
use super::{CheckedProgram, CheckedWith, Dialect, DialectError, DialectFile, DialectOutput};
use crate::cell::{Cell, CollisionScene, Configuration, JointThreeOrigin, Presets, SpecKind, SpecLibrary};
use crate::planning::params::DialectParams;
use crate::planning::plan::ViewId;
use crate::program::{Move, Program, Step};

/// The default cell, with a robot whose language is not known: it takes them all.
fn cell() -> Cell {
    let mut cell = Presets.cell("e05-transcan").expect("preset").build(&Presets).expect("builds");
    cell.robot.dialect = None;
    cell
}

/// A short tour about home: table alone, arm alone, both.
fn program(cell: &Cell) -> Program {
    let home = cell.home_rad;
    let at = |joint_deg: f64, table_deg: f64| {
        let mut point = home;
        point.joints_rad[0] += joint_deg.to_radians();
        point.table_rad += table_deg.to_radians();
        point
    };
    let axes = cell.axes();
    let travel = |points: &[Configuration]| {
        let (target, before) = points.split_last().expect("a target");
        Step::Move(Move {
            via_rad: before[1..].to_vec(),
            target_rad: *target,
            speed_fraction: 0.25,
            duration_secs: axes.path_secs(points, 0.25),
            passed_within_rad: None,
        })
    };
    let steps = vec![
        travel(&[home, at(0.0, 30.0), at(5.0, 30.0), at(10.0, 45.0)]),
        Step::Settle { secs: 0.305 },
        Step::Scan { view: ViewId(7), brightness: 5, capture_secs: 1.0 },
        travel(&[at(10.0, 45.0), home]),
    ];
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

/// The tour at a share of the rated speeds and accelerations.
fn program_at(cell: &Cell, speed_fraction: f64) -> Program {
    let (mut program, mut here) = (program(cell), cell.home_rad);
    for step in &mut program.steps {
        if let Step::Move(step) = step {
            step.speed_fraction = speed_fraction;
            step.duration_secs = step.derived_secs(&here, &cell.axes());
            here = step.target_rad;
        }
    }
    program.cycle_secs = program.steps.iter().map(Step::secs).sum();
    program
}

/// Parameters with which every dialect renders the default cell.
fn params() -> DialectParams {
    DialectParams { fanuc_joint_3_from: Some(JointThreeOrigin::Ground), ..DialectParams::default() }
}

fn rendered(program: &Program, cell: &Cell, dialect: Dialect, params: &DialectParams) -> Result<Vec<String>, DialectError> {
    let scene = CollisionScene::without_part(cell, 5.0);
    let checked = CheckedProgram::new(program, cell, &scene, None, CheckedWith::CellAlone).expect("sound");
    Ok(checked.render(dialect, params)?.into_iter().map(|file| file.text).collect())
}

#[test]
fn no_module_is_named_by_a_word_of_its_language_or_a_point_of_its_own() {
    let cell = cell();
    let program = program(&cell);
    let first_line = |dialect: Dialect, name: &str, start: &str| {
        let params = DialectParams { program_name: name.to_owned(), ..params() };
        let text = rendered(&program, &cell, dialect, &params).expect("renders").remove(0);
        text.lines().find(|line| line.starts_with(start)).unwrap_or_else(|| panic!("no {start:?} in\n{text}")).to_owned()
    };
    for name in ["trigger", "then", "spline", "until", "cell", "true", "xhome", "xp3", "XP12"] {
        assert_eq!(first_line(Dialect::Krl, name, "DEF "), format!("DEF V_{}( )", name.to_uppercase()));
    }
    for name in ["with", "undo", "xor", "viewonly", "user"] {
        assert_eq!(first_line(Dialect::Rapid, name, "MODULE "), format!("MODULE v_{name}"));
    }
    for name in ["triggers", "xp", "xp3a"] {
        assert_eq!(first_line(Dialect::Krl, name, "DEF "), format!("DEF {}( )", name.to_uppercase()));
    }
    assert_eq!(first_line(Dialect::Rapid, "without", "MODULE "), "MODULE without");
    // Windows has no file AUX.src, and Python takes robodk.py for the package of that name.
    assert_eq!(first_line(Dialect::Krl, "aux", "DEF "), "DEF V_AUX( )");
    assert!(first_line(Dialect::Robodk, "RoboDK", "# Vantage").ends_with("File name: v_RoboDK.py"));
}

#[test]
fn names_become_identifiers_of_each_length() {
    let rule = |longest| NameRule { longest, reserved: &["MODULE", "MODULE_2"], point: "P" };
    for (name, setup, longest, wanted) in [
        ("vantage", 0, 8, "vantage"),
        ("vantage", 1, 8, "vantag_2"),
        ("Gehäuse №7 (links)", 0, 32, "Geh_use_7_links"),
        ("7up", 0, 8, "v_7up"),
        ("123456789", 3, 8, "v_1234_4"),
        ("module", 0, 32, "v_module"),
        ("module", 1, 32, "v_module_2"),
        ("螺丝", 0, 8, "v"),
        ("x\"; DROP", 0, 32, "x_DROP"),
        ("a_______b", 0, 32, "a_b"),
        ("module_x", 0, 7, "v_modul"),
        ("p12", 0, 32, "v_p12"),
        ("p12", 1, 32, "p12_2"),
        ("p", 0, 32, "p"),
        ("abcdefg_h", 0, 8, "abcdefg"),
        ("aux", 0, 32, "v_aux"),
        ("Com7", 0, 32, "v_Com7"),
        ("aux", 1, 32, "aux_2"),
    ] {
        let found = identifier(name, setup, &rule(longest));
        assert_eq!(found, wanted, "{name:?} in {longest}");
        assert!(found.len() <= longest);
    }
}

#[test]
fn comments_stay_on_their_line() {
    assert_eq!(comment("arm\r\nMoveAbsJ évil\t\u{2028}"), "arm??MoveAbsJ ?vil??");
    assert_eq!(wrap("aa bb  cccc dddddddd", 5), ["aa bb", "cccc", "ddddd", "ddd"]);
}

#[test]
fn numbers_are_rounded_within_the_limits_and_never_minus_zero() {
    assert_eq!([fixed(-0.0004, 3), fixed(-0.0, 1), fixed(-1.25, 1), fixed(30.0, 4)], ["0.000", "0.0", "-1.2", "30.0000"]);
    let mut axes = cell().axes();
    axes.0[0].max_rad = 1.234_56_f64.to_radians();
    axes.0[0].min_rad = -1.234_56_f64.to_radians();
    let first = |joint_rad: f64| {
        let at = Configuration { joints_rad: [joint_rad, 0.0, 0.0, 0.0, 0.0, 0.0], table_rad: 0.0 };
        angles(&at, &axes, DEGREE, 4)[0].clone()
    };
    assert_eq!(first(axes.0[0].max_rad), "1.2345");
    assert_eq!(first(axes.0[0].min_rad), "-1.2345");
}

#[test]
fn the_interlocked_program_turns_the_table_with_the_arm_at_rest() {
    let cell = cell();
    let scene = CollisionScene::without_part(&cell, 5.0);
    let program = program(&cell);
    let interlocked = crate::program::interlock(&program, &cell, &scene).expect("free");
    let stretches: Vec<_> = actions(&interlocked)
        .into_iter()
        .filter_map(|a| if let Action::Go(stretch) = a { Some(stretch) } else { None })
        .collect();
    assert!(stretches.iter().all(|stretch| stretch.from_rad.moves_arm(&stretch.to_rad) != stretch.moves_table()));
    assert_eq!(stretches.len(), 6, "one for table or arm alone, two for both: {stretches:?}");
    assert_eq!(crate::program::check(&interlocked, &cell, &scene, None), []);
    assert!(interlocked.cycle_secs > program.cycle_secs);
    assert_eq!(crate::program::interlock(&interlocked, &cell, &scene).expect("free"), interlocked);
}

#[test]
fn a_program_with_faults_is_not_rendered() {
    let cell = cell();
    let scene = CollisionScene::without_part(&cell, 5.0);
    let mut faulty = program(&cell);
    faulty.cycle_secs += 1.0;
    let findings = CheckedProgram::new(&faulty, &cell, &scene, None, CheckedWith::Part).expect_err("refused");
    assert_eq!(findings.len(), 1);
}

#[test]
fn signals_that_a_controller_lacks_are_refused() {
    let cell = cell();
    let program = program(&cell);
    let refused = |dialect, params: DialectParams| rendered(&program, &cell, dialect, &params).expect_err("refused").to_string();
    let far = DialectParams { scan_output: 8, ..params() };
    assert_eq!(refused(Dialect::Urscript, far.clone()), "dialects.scan_output is 8; urscript has 0 to 7");
    assert!(rendered(&program, &cell, Dialect::Krl, &far).is_ok());
    let none = DialectParams { scan_input: 0, ..params() };
    assert_eq!(refused(Dialect::Krl, none), "dialects.scan_input is 0; krl has 1 to 4096");
}

/// The controller's system inputs (*KSS 8.x System Variables*, `$IOSYS_IN_TRUE` and `$IOSYS_IN_FALSE`): no scanner is wired to them.
#[test]
fn inputs_of_a_kuka_controller_that_never_change_are_refused() {
    let cell = cell();
    let program = program(&cell);
    for (number, told) in [
        (1025, "input 1025 of a KUKA controller is always TRUE, so that every scan would count as done at once"),
        (1026, "input 1026 of a KUKA controller is always FALSE, so that no scan would ever count as done"),
    ] {
        let constant = DialectParams { scan_input: number, ..params() };
        let refused = rendered(&program, &cell, Dialect::Krl, &constant).expect_err("refused").to_string();
        assert!(refused.starts_with(&format!("dialects.scan_input is {number}; ")) && refused.contains(told), "{refused}");
        assert!(refused.ends_with("give the number of the input that the scanner is wired to"), "{refused}");
        assert!(rendered(&program, &cell, Dialect::Fanuc, &constant).is_ok(), "an input as any other");
    }
    for number in [1024, 1027] {
        let wired = DialectParams { scan_input: number, scan_output: 1025, ..params() };
        assert!(rendered(&program, &cell, Dialect::Krl, &wired).is_ok(), "{number}");
    }
}

/// 29.67 % became 30 % for AccSet, and 0.3001 s a wait of 0.300 s.
#[test]
fn no_dialect_accelerates_harder_or_waits_shorter_than_was_planned() {
    let cell = cell();
    let mut program = program_at(&cell, 0.2967);
    for step in &mut program.steps {
        if let Step::Settle { secs } = step {
            *secs = 0.300_1;
        }
    }
    program.cycle_secs = program.steps.iter().map(Step::secs).sum();
    let params = DialectParams { pulse_secs: 0.100_1, timeout_secs: 30.000_1, ..params() };
    for (dialect, wanted) in [
        (Dialect::Rapid, ["AccSet 29,100;", "WaitTime\\InPos,0.301;", "WaitTime 0.101;", "MaxTime:=30.001;"]),
        (Dialect::Krl, ["$ACC_AXIS[I]=29\n", "WAIT SEC 0.301\n", "WAIT SEC 0.101\n", "$TIMER[10]>30001 "]),
        (Dialect::Fanuc, ["29% FINE ACC29 ;", " .31(sec)", " .11(sec)", "$WAITTMOUT=3001 "]),
        (Dialect::Urscript, ["  movej(", "  sleep(0.301)", "  sleep(0.101)", "waited >= 30.001:"]),
        (Dialect::Hans, ["WayPoint,", "@wait 0.301\n", "@wait 0.101\n", "@input 1 30.001\n"]),
        (Dialect::Robodk, ["move([", "robot.Pause(301)\n", "robot.Pause(101)\n", "waitDI(1, 1, 30001)"]),
    ] {
        let text = rendered(&program, &cell, dialect, &params).expect("renders").remove(0);
        for wanted in wanted {
            assert!(text.contains(wanted), "{dialect:?} does not say {wanted:?}:\n{text}");
        }
    }
}

/// A "done" that was still on counted as the answer to the next capture, and the arm moved while the scanner captured.
#[test]
fn every_dialect_waits_until_the_scanners_answer_is_off_before_it_starts_a_capture() {
    let cell = cell();
    for (dialect, wait, pulse, stop) in [
        (Dialect::Rapid, "    WaitDI scan_input,0\\MaxTime:=30.000;\n", "    SetDO scan_output,1;\n", ""),
        (Dialect::Krl, "WHILE $IN[1]\nIF $TIMER[10]>30000 THEN\n", "$OUT[1]=TRUE\n", "; The scanner's input stays on.\nHALT\n"),
        (Dialect::Fanuc, "  WAIT DI[1]=OFF TIMEOUT,LBL[98] ;\n", "  DO[1]=ON ;\n", "MESSAGE[SCANNER INPUT STAYS ON] ;\n"),
        (
            Dialect::Urscript,
            "    while get_standard_digital_in(1):\n      if waited >= 30.000:\n",
            "    set_standard_digital_out(1, True)\n",
            "        vantage_stop(\"The scanner's input stays on\")\n",
        ),
        (
            Dialect::Hans,
            "@off 1 30.000\n",
            "SetBoxDO,1,1,;\n",
            "# @off N S: poll ReadBoxDI,N,; until it is 0; stop when it is not within S seconds.\n",
        ),
        (Dialect::Robodk, "    robot.waitDI(1, 0, 30000)\n", "    robot.setDO(1, 1)\n", ""),
    ] {
        let text = rendered(&program(&cell), &cell, dialect, &params()).expect("renders").remove(0);
        let [waits, pulses] = [wait, pulse].map(|line| text.match_indices(line).map(|(at, _)| at).collect::<Vec<_>>());
        assert!(waits.len() == 1 && pulses.len() == 1 && waits[0] < pulses[0], "{dialect:?}: {waits:?}, {pulses:?} in\n{text}");
        assert!(text.contains(stop), "{dialect:?} does not say {stop:?}:\n{text}");
        let told = "Input 1 has to be off before the next scan: the program waits for that, 30 s at most, and then stops.";
        assert!(said(&text).contains(told), "{dialect:?} does not say {told:?}:\n{text}");
    }
}

/// Reads a line of a program: speed and acceleration of a move of the arm, in the unit of the language, if it is one.
type ReadRates = fn(&str) -> Option<[f64; 2]>;

fn number(text: &str) -> f64 {
    text.trim().parse().unwrap_or_else(|_| panic!("{text:?} is no number"))
}

fn urscript_rates(line: &str) -> Option<[f64; 2]> {
    let (_, rates) = line.strip_prefix("  movej(")?.split_once(", a=")?;
    let (acceleration, rest) = rates.split_once(", v=")?;
    Some([number(rest.split(',').next()?), number(acceleration)])
}

fn hans_rates(line: &str) -> Option<[f64; 2]> {
    let (_, rates) = line.strip_prefix("WayPoint,")?.split_once(",TCP,Base,")?;
    let mut rates = rates.split(',');
    Some([number(rates.next()?), number(rates.next()?)])
}

fn robodk_rates(line: &str) -> Option<[f64; 2]> {
    let (_, rates) = line.strip_prefix("move([")?.split_once("], ")?;
    let (speed, acceleration) = rates.trim_end_matches(')').split_once(", ")?;
    Some([number(speed), number(acceleration)])
}

/// Rounded to the nearest, every other speed was above the one that was checked.
#[test]
fn speeds_and_accelerations_in_decimals_are_rounded_down() {
    let cell = cell();
    let program = program_at(&cell, 0.2967);
    let scene = CollisionScene::without_part(&cell, 5.0);
    let in_turn = crate::program::interlock(&program, &cell, &scene).expect("free");
    let mut would_rise = 0;
    let in_decimals: [(Dialect, f64, i32, ReadRates); 3] = [
        (Dialect::Urscript, 1.0, 5, urscript_rates),
        (Dialect::Hans, DEGREE, 4, hans_rates),
        (Dialect::Robodk, DEGREE, 4, robodk_rates),
    ];
    for (dialect, unit_rad, decimals, rates) in in_decimals {
        let said = if dialect.moves_table_with_arm() { &program } else { &in_turn };
        let leads = actions(said).into_iter().filter_map(|action| match action {
            Action::Go(stretch) if dialect.moves_table_with_arm() || !stretch.moves_table() => Some(stretch.lead(&cell.axes())),
            Action::Go(_) | Action::Toward(_) | Action::Settle(_) | Action::Scan { .. } => None,
        });
        let planned: Vec<[f64; 2]> = leads.map(|lead| [lead.rad_per_s, lead.rad_per_s2].map(|rad| rad / unit_rad)).collect();
        let text = rendered(&program, &cell, dialect, &params()).expect("renders").remove(0);
        let told: Vec<[f64; 2]> = text.lines().filter_map(rates).collect();
        assert_eq!(told.len(), planned.len(), "{dialect:?}");
        let digit = 10_f64.powi(-decimals);
        for (told, planned) in told.iter().flatten().zip(planned.iter().flatten()) {
            assert!(*told <= planned + 1e-5 * digit && *told > planned - digit, "{dialect:?}: {told} for {planned}");
            would_rise += usize::from((planned / digit).round() * digit > planned + 1e-3 * digit);
        }
    }
    assert!(would_rise > 0, "no speed that rounding to the nearest would raise");
}

/// `AccSet` sets 20 % of the rated at least (3HAC050917).
#[test]
fn a_rapid_program_tells_that_it_accelerates_harder_than_planned_below_accsets_least() {
    let cell = cell();
    let text = |speed_fraction: f64| {
        rendered(&program_at(&cell, speed_fraction), &cell, Dialect::Rapid, &params()).expect("renders").remove(0)
    };
    let told = "Acceleration: 20 % of the rated, not the 12.5 % that were planned, since AccSet sets no less.";
    let words = |text: &str| text.lines().filter_map(|line| line.strip_prefix("  ! ")).collect::<Vec<_>>().join(" ");
    let slow = text(0.125);
    assert!(words(&slow).contains(told) && slow.contains("AccSet 20,100;"), "{slow}");
    assert!(!words(&text(0.2)).contains("Acceleration:"), "20 % is said as it is");
}

/// The note spoke for every move, those that were planned quick enough too.
#[test]
fn a_rapid_program_tells_which_moves_accelerate_harder_than_planned() {
    let cell = cell();
    for (shares, told) in [
        ([0.25, 0.125], "not the 12.5 % that were planned, since AccSet sets no less. This concerns the move home;"),
        ([0.15, 0.25], "not the 15 % that were planned, since AccSet sets no less. This concerns the move to viewpoint 7;"),
        ([0.15, 0.125], "not the 12.5 to 15 % that were planned, since AccSet sets no less. This concerns every move;"),
    ] {
        let (mut program, mut here, mut shares) = (program(&cell), cell.home_rad, shares.into_iter());
        for step in &mut program.steps {
            if let Step::Move(step) = step {
                step.speed_fraction = shares.next().expect("two moves");
                step.duration_secs = step.derived_secs(&here, &cell.axes());
                here = step.target_rad;
            }
        }
        program.cycle_secs = program.steps.iter().map(Step::secs).sum();
        let text = said(&rendered(&program, &cell, Dialect::Rapid, &params()).expect("renders")[0]);
        assert!(text.contains(told), "{told:?} is not in\n{text}");
    }
}

/// `AccSet` set 29 % while `\T` and the told cycle were those at 29.99 %, which the moves then overran.
#[test]
fn the_times_of_a_rapid_program_are_those_at_the_acceleration_that_it_sets() {
    let cell = cell();
    let scene = CollisionScene::without_part(&cell, 5.0);
    let (planned, set) = (program_at(&cell, 0.2999), program_at(&cell, 0.29));
    let checked = CheckedProgram::new(&planned, &cell, &scene, None, CheckedWith::CellAlone).expect("sound");
    let told_secs = checked.cycle_secs(Dialect::Rapid).expect("renders");
    assert!((told_secs - set.cycle_secs).abs() < 1e-9, "{told_secs} s, not {} s", set.cycle_secs);
    let motion = |text: &str| -> Vec<String> {
        let lines = text.lines().filter(|line| line.contains("AccSet ") || line.contains("MoveAbsJ "));
        lines.map(str::to_owned).collect()
    };
    let text = checked.render(Dialect::Rapid, &params()).expect("renders").remove(0).text;
    assert_eq!(motion(&text), motion(&rendered(&set, &cell, Dialect::Rapid, &params()).expect("renders")[0]));
    for told in [format!("predicted cycle {:.1} s", set.cycle_secs), "29 % of the rated, not the 29.99 %".to_owned()] {
        assert!(said(&text).contains(&told), "it does not say {told}:\n{text}");
    }
}

/// 16.1 s became 16101 ms and 16.11 s: the product is off by the last digit of a double.
#[test]
fn a_time_out_that_a_file_can_say_is_said_as_it_is() {
    let cell = cell();
    let params = DialectParams { timeout_secs: 16.1, ..params() };
    for (dialect, wanted) in [(Dialect::Krl, "$TIMER[10]>16100 "), (Dialect::Fanuc, "$WAITTMOUT=1610 ")] {
        let text = rendered(&program(&cell), &cell, dialect, &params).expect("renders").remove(0);
        assert!(text.contains(wanted), "{dialect:?} does not say {wanted:?}:\n{text}");
    }
}

/// The variable is one for all programs of the controller, and TP has no place of its own to keep its value in.
#[test]
fn a_fanuc_program_says_that_it_leaves_the_time_out_of_waits_set() {
    let cell = cell();
    let text = said(&rendered(&program(&cell), &cell, Dialect::Fanuc, &params()).expect("renders")[0]);
    let told = "Sets $WAITTMOUT, the time-out of waits in every program, and leaves it so: others have to set their own.";
    assert!(text.contains(told), "{text}");
}

/// `TCP` and `Base` were called the controller's own frames, though it may have none of these names.
#[test]
fn a_script_for_hans_says_which_frames_it_names_and_that_they_change_no_motion() {
    let cell = cell();
    let text = rendered(&program(&cell), &cell, Dialect::Hans, &params()).expect("renders").remove(0);
    let told = "Targets are joints: no frame changes the motion. Each WayPoint names tool frame TCP and user frame Base all the \
                same; where the controller has no frames of these names, put names of its own in their place.";
    assert!(said(&text).contains(told), "{text}");
    assert!(text.lines().filter(|line| line.starts_with("WayPoint,")).all(|line| line.contains(",TCP,Base,")), "{text}");
}

/// A string as it stands is no reference, which the instruction's syntax asks for (3HAC050917, AliasIO).
#[test]
fn a_rapid_module_names_its_signals_by_constants() {
    let cell = cell();
    let numbered = DialectParams { scan_output: 3, scan_input: 5, ..params() };
    let text = rendered(&program(&cell), &cell, Dialect::Rapid, &numbered).expect("renders").remove(0);
    for line in [
        "  LOCAL CONST string scan_output_name:=\"DO_3\";\n",
        "  LOCAL CONST string scan_input_name:=\"DI_5\";\n",
        "    AliasIO scan_output_name,scan_output;\n",
        "    AliasIO scan_input_name,scan_input;\n",
    ] {
        assert_eq!(text.matches(line).count(), 1, "{line}{text}");
    }
}

/// Points that differ by the last digits of a double are a move of less than a microsecond, which was written as 0 s.
#[test]
fn a_rapid_move_of_next_to_nothing_has_a_time() {
    let cell = cell();
    let mut program = program(&cell);
    let Step::Move(step) = &mut program.steps[0] else { panic!("a program begins with a move") };
    step.via_rad[0] = Configuration { table_rad: cell.home_rad.table_rad + 1e-15, ..cell.home_rad };
    step.duration_secs = step.derived_secs(&cell.home_rad, &cell.axes());
    program.cycle_secs = program.steps.iter().map(Step::secs).sum();
    let text = rendered(&program, &cell, Dialect::Rapid, &params()).expect("renders").remove(0);
    assert!(text.contains("MoveAbsJ p1\\NoEOffs,vmax\\T:=0.001,fine,tool0;") && !text.contains("T:=0.000"), "{text}");
}

/// Axis 1 of the group was turned, such as the tilt of a positioner, by the angle of the table.
#[test]
fn a_table_that_is_another_axis_than_a_fanuc_program_turns_is_refused() {
    let cell = cell();
    let program = program(&cell);
    let second = DialectParams { table_axis: 2, ..params() };
    for dialect in Dialect::ALL {
        let rendered = rendered(&program, &cell, dialect, &second);
        if dialect == Dialect::Fanuc {
            let refused = rendered.expect_err("refused").to_string();
            let wanted = "dialects.table_axis is 2; a fanuc program turns axis 1 of motion group 2 alone";
            assert!(refused.starts_with(wanted) && refused.ends_with("set dialects.table_axis = 1"), "{refused}");
        } else {
            assert!(rendered.is_ok(), "{dialect:?}");
        }
    }
}

#[test]
fn speeds_below_a_percent_are_refused_where_percents_are_whole() {
    let cell = cell();
    let mut slow = program(&cell);
    let axes = cell.axes();
    let mut here = slow.home_rad;
    for step in &mut slow.steps {
        if let Step::Move(step) = step {
            step.speed_fraction = 0.005;
            step.duration_secs = axes.path_secs(std::iter::once(&here).chain(&step.via_rad).chain([&step.target_rad]), 0.005);
            here = step.target_rad;
        }
    }
    slow.cycle_secs = slow.steps.iter().map(Step::secs).sum();
    for dialect in Dialect::ALL {
        let slow = rendered(&slow, &cell, dialect, &params());
        assert_eq!(slow.is_err(), matches!(dialect, Dialect::Krl | Dialect::Fanuc), "{dialect:?}");
    }
}

#[test]
fn hostile_names_stay_comments_and_strings() {
    let mut cell = cell();
    let nasty = "arm\"\n; */ MoveL \u{202e}\\ 螺\r\nEND";
    cell.robot.name = nasty.to_owned();
    let tame = program(&self::cell());
    let mut program = tame.clone();
    program.robot = nasty.to_owned();
    let params = DialectParams { program_name: nasty.replace(['\r', '\n'], " "), ..params() };
    for dialect in Dialect::ALL {
        let wild = rendered(&program, &cell, dialect, &params).expect("renders");
        let calm = rendered(&tame, &self::cell(), dialect, &params).expect("renders");
        for (wild, calm) in wild.iter().zip(&calm) {
            assert!(wild.bytes().all(|b| matches!(b, b'\n' | b'\r' | b'\t' | b' '..=b'~')), "{dialect:?} is ASCII");
            let code = |text: &str| -> Vec<String> {
                let is_comment = |line: &&str| {
                    let line = line.trim_start().trim_start_matches(|c: char| c.is_ascii_digit() || c == ':').trim_start();
                    !line.starts_with(['#', '!', ';'])
                };
                let robot = |line: &str| line.split("Item(").next().unwrap_or_default().to_owned();
                text.lines().filter(is_comment).filter(|line| !line.starts_with("LINE_COUNT")).map(robot).collect()
            };
            let unnumbered = |lines: Vec<String>| -> Vec<String> {
                lines
                    .into_iter()
                    .map(|line| line.trim_start().trim_start_matches(|c: char| c.is_ascii_digit()).to_owned())
                    .collect()
            };
            assert_eq!(unnumbered(code(wild)), unnumbered(code(calm)), "{dialect:?}: names change nothing but comments");
        }
    }
}

#[test]
fn a_robot_gets_its_makers_language_and_neutral_ones_and_others_by_force_with_a_warning() {
    let mut cell = cell();
    let scene = CollisionScene::without_part(&cell, 5.0);
    let program = program(&cell);
    for own in Dialect::ALL {
        cell.robot.dialect = Some(own);
        let checked = CheckedProgram::new(&program, &cell, &scene, None, CheckedWith::CellAlone).expect("sound");
        for dialect in Dialect::ALL {
            let takes = dialect == own || dialect.is_neutral();
            let rendered = checked.render(dialect, &params());
            let forced = checked.render_forced(dialect, &params()).expect("renders");
            let warns = |file: &DialectFile| file.text.contains("WARNING: FORCED");
            assert_eq!(takes, !forced.iter().any(warns), "{own:?}, {dialect:?}");
            assert_eq!(takes, !forced.iter().all(warns), "every file of it warns: {own:?}, {dialect:?}");
            match rendered {
                Ok(files) => assert!(takes && files == forced, "{own:?}, {dialect:?}"),
                Err(error) => {
                    let (dialect, own) = (dialect.as_str(), own.as_str());
                    let wanted =
                        format!("{dialect} is not a language of robot hans-e05, whose specification has dialect = \"{own}\"");
                    assert!(!takes && error.to_string() == wanted, "{error}");
                }
            }
        }
    }
}

#[test]
fn the_preset_robots_have_the_languages_of_their_makers() {
    for (robot, own) in [
        ("hans-e05", Dialect::Hans),
        ("abb-irb1600-6-12", Dialect::Rapid),
        ("kuka-kr6-r700", Dialect::Krl),
        ("fanuc-m20ia", Dialect::Fanuc),
        ("ur5e", Dialect::Urscript),
        ("staubli-tx2-60", Dialect::Robodk),
    ] {
        assert_eq!(Presets.robot(robot).expect("a preset").dialect, Some(own), "{robot}");
    }
}

/// The table of dialects and the facts of each: what interfaces make of them holds for a dialect that is added.
#[test]
fn the_facts_of_the_dialects_fit_together() {
    let outputs: Vec<&DialectOutput> = Dialect::ALL.into_iter().flat_map(Dialect::outputs).collect();
    let formats: BTreeSet<&str> = outputs.iter().map(|output| output.format).collect();
    let extensions: BTreeSet<&str> = outputs.iter().map(|output| output.extension).collect();
    assert_eq!([formats.len(), extensions.len()], [outputs.len(); 2], "no two share one: {outputs:?}");
    assert_eq!(Dialect::ALL.into_iter().filter(|dialect| dialect.is_table()).count(), 1, "one stands first");
    for dialect in Dialect::ALL {
        assert_eq!(dialect.outputs()[0].format, dialect.as_str(), "requests name the first file as the dialect");
        let is_field = |param: &str| DialectParams::KNOBS.knobs.iter().any(|knob| knob.field == param);
        assert!(dialect.name_length_param().is_none_or(is_field), "{dialect:?}");
    }
}

#[test]
fn joint_3_of_a_fanuc_program_is_counted_from_the_ground() {
    let mut cell = cell();
    cell.robot.dialect = None;
    let program = program(&cell);
    let error = rendered(&program, &cell, Dialect::Fanuc, &DialectParams::default()).expect_err("the model does not say");
    assert!(error.to_string().contains("dialects.fanuc_joint_3_from"), "{error}");
    let points_deg = |joint_3_from: JointThreeOrigin| -> Vec<[f64; 2]> {
        let params = DialectParams { fanuc_joint_3_from: Some(joint_3_from), ..params() };
        let text = rendered(&program, &cell, Dialect::Fanuc, &params).expect("renders").remove(0);
        let angle = |line: &str, joint: &str| -> Option<f64> {
            let after = line.split_once(joint)?.1.trim_start();
            after.split_whitespace().next()?.parse().ok()
        };
        let arm = text.lines().filter(|line| line.contains("J2="));
        arm.filter_map(|line| Some([angle(line, "J2=")?, angle(line, "J3=")?])).collect()
    };
    let [ground, upper_arm] = [JointThreeOrigin::Ground, JointThreeOrigin::UpperArm].map(points_deg);
    assert!(ground.iter().any(|[joint_2, _]| joint_2.abs() > 1.0), "{ground:?}");
    for ([joint_2, joint_3], [same, converted]) in ground.iter().zip(&upper_arm) {
        assert!((joint_2 - same).abs() < 1e-9 && (joint_3 - joint_2 - converted).abs() < 2e-3, "{ground:?} {upper_arm:?}");
    }
    cell.robot.kinematics = Presets.robot("fanuc-m20ia").expect("a preset").kinematics.build();
    assert!(cell.robot.kinematics.counts_joint_3_from_ground(), "such a model needs no parameter");
}

/// The program of an arm from a URDF with a parallel rod was wrong by joint 2, without a word.
#[test]
fn the_header_of_a_rapid_program_tells_how_joint_3_is_counted_and_how_to_try_it() {
    let [plain, mut ground] = [cell(), cell()];
    ground.robot.kinematics = Presets.robot("abb-irb2400-10").expect("a preset").kinematics.build();
    let program = program(&plain);
    let scene = CollisionScene::without_part(&plain, 5.0);
    let checked = || CheckedProgram::new(&program, &plain, &scene, None, CheckedWith::CellAlone).expect("sound");
    let head = |checked: &CheckedProgram<'_>| -> String {
        let text = checked.render(Dialect::Rapid, &params()).expect("renders").remove(0).text;
        let lines: Vec<&str> = text.lines().filter_map(|line| line.strip_prefix("  ! ")).collect();
        lines.join(" ")
    };
    let told = head(&checked());
    assert!(told.contains("compare the joint angles that the controller shows with those of p0"), "{told}");
    assert!(told.contains("Joint 3 is counted from the upper arm") && told.contains("joint_3_from_ground = true"), "{told}");
    // The same program, as if it were of an arm whose specification says so.
    let told = head(&CheckedProgram { cell: &ground, ..checked() });
    assert!(told.contains("Joint 3 is counted from the ground") && !told.contains("upper arm"), "{told}");
    let work = Dialect::Rapid.before_first_run().expect("work");
    assert!(work.contains("compare the joint angles"), "{work}");
}

#[test]
fn every_preset_names_its_language() {
    for name in Presets.names(SpecKind::Robot) {
        assert!(Presets.robot(&name).expect("a preset").dialect.is_some(), "{name}");
    }
}

#[test]
fn a_fanuc_program_says_which_frames_its_positions_declare_and_that_it_selects_none() {
    let cell = cell();
    let text = rendered(&program(&cell), &cell, Dialect::Fanuc, &params()).expect("renders").remove(0);
    let remarks = text.lines().filter_map(|line| Some(line.split_once('!')?.1.trim_end_matches(" ;").trim()));
    let head = remarks.collect::<Vec<_>>().join(" ");
    let frames = "Positions are in joints, of UFRAME 0 and UTOOL 1: select these in both groups first. None is selected here";
    assert!(head.contains(frames), "{text}");
    assert!(!text.contains("UFRAME_NUM") && !text.contains("UTOOL_NUM"), "{text}");
    let work = Dialect::Fanuc.before_first_run().expect("work");
    assert!(work.starts_with("select user frame 0 and tool frame 1 in both motion groups"), "{work}");
}

#[test]
fn every_file_names_its_plan() {
    let cell = cell();
    let program = program(&cell);
    let (first, last) = program.plan_sha256.split_at(32);
    for dialect in Dialect::ALL {
        // FANUC has 32 characters a remark.
        for text in rendered(&program, &cell, dialect, &params()).expect("renders") {
            assert!(text.contains(first) && text.matches(last).count() > 0, "{dialect:?}: {text}");
        }
    }
}

/// The tables of all setups were called `program.csv`.
#[test]
fn no_two_files_of_a_plan_of_several_setups_have_one_name() {
    let cell = cell();
    let scene = CollisionScene::without_part(&cell, 5.0);
    for dialect in Dialect::ALL {
        for program_name in ["vantage", "a-very-long-name-of-a-bracket-for-the-left-side-of-the-line"] {
            let params = DialectParams { program_name: program_name.to_owned(), ..params() };
            let names_of = |setup: usize| {
                let program = Program { setup, ..program(&cell) };
                let checked = CheckedProgram::new(&program, &cell, &scene, None, CheckedWith::CellAlone).expect("sound");
                let files = checked.render(dialect, &params).expect("renders");
                files.into_iter().map(|file| file.name.to_ascii_lowercase()).collect::<Vec<_>>()
            };
            let names: Vec<String> = (0..4).flat_map(names_of).collect();
            let different: std::collections::BTreeSet<&String> = names.iter().collect();
            assert_eq!((different.len(), names.len()), (names.len(), 4 * dialect.outputs().len()), "{dialect:?}: {names:?}");
        }
    }
}

/// A program through calibration poses said that it was checked with the part.
#[test]
fn the_header_tells_what_stood_in_the_scene() {
    let cell = cell();
    let (program, scene) = (program(&cell), CollisionScene::without_part(&cell, 5.0));
    for (with, told) in [
        (CheckedWith::Part, "with the part in it"),
        (CheckedWith::Board, "with the calibration board on the table, WITHOUT a part"),
        (CheckedWith::CellAlone, "WITHOUT the part"),
    ] {
        let checked = CheckedProgram::new(&program, &cell, &scene, None, with).expect("sound");
        let text = checked.render(Dialect::Urscript, &params()).expect("renders").remove(0).text;
        assert!(said(&text).contains(told), "{with:?}: {text}");
    }
}

#[test]
fn dialects_are_found_by_name() {
    for dialect in Dialect::ALL {
        assert_eq!(dialect.as_str().parse(), Ok(dialect));
    }
    let refused = "karel".parse::<Dialect>().expect_err("none");
    assert_eq!(refused, "unknown dialect \"karel\"; known are hans, urscript, rapid, krl, fanuc, robodk, csv");
}

#[test]
fn the_table_has_a_row_a_point_and_action() {
    let cell = cell();
    let program = program(&cell);
    let text = rendered(&program, &cell, Dialect::Csv, &params()).expect("renders").remove(0);
    let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
    let ops: Vec<_> = rows.iter().map(|row| row[1]).collect();
    assert_eq!(ops, ["op", "home", "via", "via", "move_joints", "settle", "scan", "move_joints"]);
    assert!(rows.iter().all(|row| row.len() == 21));
    assert!(rows[1..].iter().all(|row| row[20] == program.plan_sha256), "{text}");
    // At the scan arm and table stand where the move ended, and so does the scanner.
    assert_eq!((&rows[6][2..9], &rows[6][13..20]), (&rows[4][2..9], &rows[4][13..20]));
    assert_eq!(rows[6][11..13], ["7", "5"]);
    let number = |row: usize, column: usize| rows[row][column].parse::<f64>().expect("number");
    let (joint_deg, table_deg) = (cell.home_rad.joints_rad[0].to_degrees(), cell.home_rad.table_rad.to_degrees());
    assert!((number(4, 2) - joint_deg - 10.0).abs() < 1e-8 && (number(4, 8) - table_deg - 45.0).abs() < 1e-8);
    let scanner = cell.base_from_scanner(&cell.home_rad.joints_rad);
    assert!((0..3).all(|axis| (number(1, 13 + axis) - scanner.origin_mm()[axis]).abs() < 1e-6));
}

/// Returns true for the number at the head of a line of a TP program.
fn is_line_number(word: &str) -> bool {
    word.strip_suffix(':').is_some_and(|number| number.parse::<u32>().is_ok())
}

/// Words of a file without line ends and marks of comments: long comments break.
fn said(text: &str) -> String {
    let words = text.split_whitespace().filter(|word| !is_line_number(word)).map(|word| word.trim_start_matches('!'));
    words.filter(|word| !["", "#", ";"].contains(word)).collect::<Vec<_>>().join(" ")
}

/// The tour with a second scan where it stands, at another brightness.
fn at_two_levels(cell: &Cell) -> Program {
    let mut program = program(cell);
    program.steps.insert(3, Step::Scan { view: ViewId(7), brightness: 9, capture_secs: 1.0 });
    program.cycle_secs = program.steps.iter().map(Step::secs).sum();
    program
}

#[test]
fn a_program_of_several_brightness_levels_warns_that_the_scanner_is_not_told_which() {
    let cell = cell();
    let (one, two) = (program(&cell), at_two_levels(&cell));
    let warning = "WARNING: the scans are at brightness levels 5 and 9, and this program does not tell the scanner which.";
    for dialect in Dialect::ALL {
        let is_told = matches!(dialect, Dialect::Hans | Dialect::Csv);
        let warns =
            |program: &Program| said(&rendered(program, &cell, dialect, &params()).expect("renders")[0]).contains(warning);
        assert_eq!((warns(&one), warns(&two)), (false, !is_told), "{dialect:?}");
    }
    assert!(rendered(&two, &cell, Dialect::Hans, &params()).expect("renders")[0].contains("\n@scan 7 9\n"), "Hans tells it");
}

#[test]
fn the_work_before_the_first_run_has_the_brightness_levels_that_the_scanner_is_not_told() {
    let cell = cell();
    let (one, two) = (program(&cell), at_two_levels(&cell));
    for dialect in Dialect::ALL {
        let own = dialect.before_first_run();
        assert_eq!(dialect.before_first_run_of([&one]).as_deref(), own, "{dialect:?}");
        let work = dialect.before_first_run_of([&one, &two]);
        if matches!(dialect, Dialect::Hans | Dialect::Csv) {
            assert_eq!(work.as_deref(), own, "{dialect:?}");
        } else {
            let work = work.expect("the levels");
            assert!(
                work.starts_with(own.unwrap_or_default()) && work.contains("the level in the comment there (5 and 9)"),
                "{work}"
            );
        }
    }
}

#[test]
fn one_scan_is_no_scans_in_the_header() {
    let cell = cell();
    for dialect in Dialect::ALL {
        let text = rendered(&program(&cell), &cell, dialect, &params()).expect("renders").remove(0);
        assert!(dialect == Dialect::Csv || text.contains("Setup 1, 1 scan, predicted"), "{text}");
    }
}

/// The cycle that a summary tells is the one that the operator reads at the head of the program.
#[test]
fn the_cycle_in_a_dialect_is_that_of_the_header_of_its_programs() {
    let cell = cell();
    let (scene, program) = (CollisionScene::without_part(&cell, 5.0), program(&cell));
    let checked = CheckedProgram::new(&program, &cell, &scene, None, CheckedWith::CellAlone).expect("sound");
    let secs = |dialect: Dialect| checked.cycle_secs(dialect).expect("renders");
    for dialect in Dialect::ALL.into_iter().filter(|dialect| *dialect != Dialect::Csv) {
        let files = checked.render(dialect, &params()).expect("renders");
        let told = format!("predicted cycle {:.1} s", secs(dialect));
        assert!(files.iter().any(|file| said(&file.text).contains(&told)), "{dialect:?} does not say {told}:\n{}", files[0].text);
    }
    assert!((secs(Dialect::Rapid) - program.cycle_secs).abs() < 1e-12, "the table turns with the arm");
    assert!(secs(Dialect::Hans) > program.cycle_secs + 0.1 && secs(Dialect::Hans) <= secs(Dialect::Urscript), "in turn");
}

/// Every chord of a rounded corner became a stop of its own where table and arm move in turn.
#[test]
fn no_dialect_takes_a_program_that_passes_points_without_stopping() {
    let cell = cell();
    let (scene, mut passing) = (CollisionScene::without_part(&cell, 5.0), program(&cell));
    if let Step::Move(step) = &mut passing.steps[0] {
        step.passed_within_rad = Some(0.01);
        step.duration_secs = step.derived_secs(&passing.home_rad, &cell.axes());
    }
    passing.cycle_secs = passing.steps.iter().map(Step::secs).sum();
    let checked = CheckedProgram::new(&passing, &cell, &scene, None, CheckedWith::CellAlone).expect("sound");
    for dialect in Dialect::ALL {
        assert_eq!(checked.cycle_secs(dialect), Err(DialectError::Passing), "{dialect:?}");
        assert_eq!(checked.render(dialect, &params()), Err(DialectError::Passing), "{dialect:?}");
    }
}

/// The files set 2 % of the rated speed, and their headers told the cycle at 2.9 %.
#[test]
fn a_fractional_percent_is_told_as_the_speed_that_is_set_with_its_cycle() {
    let cell = cell();
    let scene = CollisionScene::without_part(&cell, 5.0);
    let (planned, set) = (program_at(&cell, 0.029), program_at(&cell, 0.02));
    let checked = CheckedProgram::new(&planned, &cell, &scene, None, CheckedWith::CellAlone).expect("sound");
    for dialect in [Dialect::Krl, Dialect::Fanuc] {
        let told_secs = checked.cycle_secs(dialect).expect("renders");
        assert!((told_secs - set.cycle_secs).abs() < 1e-9, "{told_secs} s, not {} s", set.cycle_secs);
        let text = said(&checked.render(dialect, &params()).expect("renders").remove(0).text);
        for told in [format!("predicted cycle {:.1} s", set.cycle_secs), "2 % of the rated, not the 2.9 %".to_owned()] {
            assert!(text.contains(&told), "{dialect:?} does not say {told}:\n{text}");
        }
    }
    let secs = checked.cycle_secs(Dialect::Rapid).expect("renders");
    assert!((secs - planned.cycle_secs).abs() < 1e-9, "{secs} s: its moves have the planned times");
    let whole = CheckedProgram::new(&set, &cell, &scene, None, CheckedWith::CellAlone).expect("sound");
    for dialect in [Dialect::Krl, Dialect::Fanuc] {
        let text = said(&whole.render(dialect, &params()).expect("renders").remove(0).text);
        assert!(!text.contains("whole percents"), "{text}");
    }
    let slowest = program_at(&cell, 0.009);
    let checked = CheckedProgram::new(&slowest, &cell, &scene, None, CheckedWith::CellAlone).expect("sound");
    assert_eq!(checked.cycle_secs(Dialect::Krl), Err(DialectError::TooSlow(0.009, Dialect::Krl.as_str())));
}

//! Sentences of the findings: what the data look like, and what to do.

use nalgebra::Vector3;

use crate::cell::calibration::findings::{CalibrationFinding, Figures, FindingCode, Subject};
use crate::cell::calibration::observability::{MIN_SPREAD_RAD, UncertaintyLimits};
use crate::wire::words::{counted, fixed};

/// The finding as a sentence.
#[must_use]
pub fn sentence(finding: &CalibrationFinding) -> String {
    let about = finding.observations.join(", ");
    let figures = &finding.figures;
    match finding.code {
        FindingCode::DegenerateMotion | FindingCode::WeakMotion => of_motion(finding.code, figures),
        FindingCode::OutOfStep if figures.subject.is_none() => of_arm(finding.code, figures),
        FindingCode::ToolActive | FindingCode::WrongRobotModel | FindingCode::JointOrder | FindingCode::AngleUnit => {
            of_arm(finding.code, figures)
        }
        FindingCode::Inverted
        | FindingCode::OtherSetup
        | FindingCode::Transposed
        | FindingCode::QuaternionOrder
        | FindingCode::OutOfStep
        | FindingCode::BoardTurned => of_reading(finding.code, figures),
        FindingCode::TableSign | FindingCode::TableScale | FindingCode::TableStill => of_table(finding.code, figures),
        FindingCode::BoardScale => of_board(figures),
        FindingCode::BadPose
        | FindingCode::Moved
        | FindingCode::Swapped
        | FindingCode::Flipped
        | FindingCode::DuplicatePose
        | FindingCode::HeldOutDisagrees => of_poses(finding.code, &about, figures),
        FindingCode::TooFew => of_count(figures),
        FindingCode::UnitMismatch => of_unit(&about, figures),
        FindingCode::SigmaTooSmall => format!(
            "the observations scatter {:.1} × more than the given sigma: leave sigma out to have it estimated",
            figures.ratio.unwrap_or(f64::NAN)
        ),
        FindingCode::ArmModel => format!(
            "residuals grow with joint {} (r = {:.1}): the cause is the arm's own calibration, not the hand-eye",
            figures.joint.unwrap_or(0),
            figures.ratio.unwrap_or(f64::NAN)
        ),
        FindingCode::NoPlateFace => format!(
            "the {} points of the plate lie in no plane perpendicular to its axis: scan the bare plate, from more than one place",
            figures.count.unwrap_or(0)
        ),
        FindingCode::Stale => of_age(figures),
        FindingCode::NotConverged => format!(
            "the refinement did not converge in {} iterations, and its figures are not to be relied on: add observations with other \
             rotations of the arm, and check the nominal cell",
            figures.count.unwrap_or(0)
        ),
        FindingCode::BoardScaleNotConverged => format!(
            "the scale of the distances to the board did not converge in {} rounds, and says nothing about the size of the board: \
             add observations from other distances and with other rotations of the arm, and measure the board",
            figures.count.unwrap_or(0)
        ),
        FindingCode::NoConsensus => of_consensus(figures),
        FindingCode::ScannerHeld => of_held_scanner(figures),
    }
}

fn of_count(figures: &Figures) -> String {
    let (count, held_out) = (figures.count.unwrap_or(0), figures.held_out.unwrap_or(0));
    let duplicates = figures.given.unwrap_or(0).saturating_sub(count + held_out);
    let reasons: Vec<String> = [(held_out, "is held out", "are held out"), (duplicates, "is a duplicate", "are duplicates")]
        .into_iter()
        .filter(|(number, ..)| *number > 0)
        .map(|(number, one, more)| format!("{number} {}", if number == 1 { one } else { more }))
        .collect();
    let observations = counted(count, "observation");
    let remain = if reasons.is_empty() {
        String::new()
    } else {
        let remain = if count == 1 { "remains" } else { "remain" };
        format!(" {remain} of {}, since {}", count + held_out + duplicates, reasons.join(" and "))
    };
    format!("{observations}{remain}; at least 3 are needed, preferably 12, with rotations of the arm about two axes")
}

/// Field that a finding is about.
fn field(subject: Option<Subject>) -> &'static str {
    match subject {
        Some(Subject::Board) => "cloud_from_board",
        Some(Subject::Flange) => "base_from_flange",
        Some(Subject::Table) => "table_angle_deg",
        None => "the poses",
    }
}

fn of_unit(about: &str, figures: &Figures) -> String {
    let name = |unit_mm: f64| match unit_mm {
        centimetres if centimetres < 16.0 => "centimetres",
        inches if inches < 60.0 => "inches",
        _ => "metres",
    };
    let Some(ratio) = figures.ratio else {
        let (field, unit) = (field(figures.subject), name(figures.length_mm.unwrap_or(f64::NAN)));
        return format!("translations of {field} agree with all other lengths if they are in {unit} rather than millimetres");
    };
    let size = if ratio >= 1.0 { format!("{ratio:.0} × smaller") } else { format!("{:.0} × larger", ratio.recip()) };
    let than = if figures.count.is_some() { "than the scanner's distance" } else { "than the others" };
    let unit = name(figures.length_mm.unwrap_or(ratio.max(ratio.recip())));
    format!("translations of {about} are {size} {than}: are they in {unit} rather than millimetres?")
}

/// Observations that a residual is of: those that were used, with their number where some were dropped.
fn judged(figures: &Figures) -> String {
    match figures.count.zip(figures.given) {
        Some((used, given)) if used < given => format!("the {used} of {given} observations that agree best"),
        Some(_) | None => "the observations".to_owned(),
    }
}

fn of_consensus(figures: &Figures) -> String {
    if let Some(mm) = figures.length_mm {
        let judged = judged(figures);
        let few = figures.needed.map_or_else(String::new, |needed| format!("; give at least {needed} to have the cause named"));
        return format!(
            "{judged} contradict each other by {mm:.1} mm, root mean square: check that board, arm and table of each \
             observation belong together, that the board did not move (or turned with the table, with solve = joint), and units, \
             conventions and robot model{few}"
        );
    }
    let agreeing = match figures.count.unwrap_or(0) {
        0 | 1 => "no two".to_owned(),
        count => format!("only {count}"),
    };
    let of = figures.given.map_or_else(String::new, |given| format!(" of {given}"));
    format!("{agreeing}{of} observations agree with each other: check robot model, board and order of the observations")
}

fn of_held_scanner(figures: &Figures) -> String {
    let rms = figures.length_mm.map(|mm| format!("{} differ by {} mm, root mean square", judged(figures), fixed(mm, 2)));
    let sd = figures.other_length_mm.zip(figures.other_turn_rad).map(|(mm, rad)| {
        let deg = fixed(rad.to_degrees(), 3);
        format!("the table's axis has a standard deviation of {} mm and {deg}°", fixed(mm, 2))
    });
    let known: Vec<String> = rms.into_iter().chain(sd).collect();
    let known = if known.is_empty() { String::new() } else { known.join(", and ") + ": " };
    format!(
        "{known}turn the table further if it turned by less than 60°; else the scanner's pose, held as the cell has it, \
         may be off: solve for joint, or check the order of the observations if the scanner is calibrated"
    )
}

fn of_motion(code: FindingCode, figures: &Figures) -> String {
    let spread = figures.turn_rad.unwrap_or(0.0).to_degrees();
    let axis = figures.vector.map_or_else(String::new, |axis| format!(" {}", near_axis(axis.into())));
    let limits = UncertaintyLimits::default();
    let known = match (figures.length_mm, figures.other_turn_rad) {
        (Some(mm), Some(rad)) => {
            let limit = if code == FindingCode::WeakMotion {
                format!("up to {} mm is good", limits.warn_mm)
            } else {
                format!("allowed are {} mm and {}°", limits.max_mm, fixed(limits.max_rad.to_degrees(), 2))
            };
            format!(
                "the translation along{axis} has a standard deviation of {mm:.2} mm, rotations one of {:.3}°; {limit}",
                rad.to_degrees()
            )
        }
        _ if axis.is_empty() => "the scanner's pose is not determined".to_owned(),
        _ => format!("all rotations are about{axis}: the translation along it is not determined"),
    };
    // Wide enough turns leave the residuals for a reason.
    let is_wide = spread >= 20.0;
    let advice = match (code, is_wide) {
        (FindingCode::WeakMotion, _) => "more tilt or more poses would help".to_owned(),
        (_, true) => {
            let least = figures.needed.map_or_else(String::new, |needed| format!(" (at least {needed})"));
            format!("take more poses{least}, and find out why they disagree")
        }
        (_, false) => "tilt the arm by 20° or more".to_owned(),
    };
    let only = if is_wide { "" } else { "only " };
    let least_deg = MIN_SPREAD_RAD.to_degrees();
    let least = if spread < least_deg { format!(" (at least {least_deg:.0}° is needed)") } else { String::new() };
    format!("rotations spread {only}{spread:.1}° across their main axis{least}: {known}; {advice}")
}

/// Axis by name where it is within 15° of one, else its direction.
fn near_axis(axis: [f64; 3]) -> String {
    let named = ["x", "y", "z"].into_iter().zip(axis).find(|(_, component)| component.abs() > 0.966);
    named.map_or_else(|| format!("({})", axis.map(|component| fixed(component, 2)).join(" ")), |(name, _)| name.to_owned())
}

#[expect(clippy::wildcard_enum_match_arm, reason = "the last arm is for the last of the codes that it is called with")]
fn of_arm(code: FindingCode, figures: &Figures) -> String {
    let (mm, deg) = (figures.length_mm.unwrap_or(0.0), figures.turn_rad.unwrap_or(0.0).to_degrees());
    let differ = format!("FK(joints) and base_from_flange differ by up to {mm:.1} mm and {deg:.2}°");
    match code {
        FindingCode::ToolActive => {
            // Rounded here, so that nothing is printed as -0.0.
            let [x, y, z] = figures.vector.map_or([0.0; 3], Into::into).map(|mm: f64| (10.0 * mm).round() / 10.0 + 0.0);
            format!(
                "FK(joints) and base_from_flange differ by a constant {x:.1}, {y:.1}, {z:.1} mm and {deg:.2}°: a tool is active in the \
                 controller; export the flange, or set the tool to zero"
            )
        }
        FindingCode::JointOrder => format!("{differ} as given, but agree with the joints in another order or direction"),
        FindingCode::AngleUnit => format!("{differ} as given, but agree with degrees and radians exchanged"),
        FindingCode::OutOfStep => {
            format!("{differ} as given, but agree if shifted by one observation: the records are out of step")
        }
        _ => format!("{differ}, which is not constant: the cell's robot is not this arm"),
    }
}

#[expect(clippy::wildcard_enum_match_arm, reason = "the last arm is for the last of the codes that it is called with")]
fn of_reading(code: FindingCode, figures: &Figures) -> String {
    let (given, other) = (figures.length_mm.unwrap_or(f64::NAN), figures.other_length_mm.unwrap_or(f64::NAN));
    let stands = |place_mm: Vector3<f64>| {
        let [x, y, z] = <[f64; 3]>::from(place_mm).map(|mm| fixed(mm, 0));
        format!(
            "with the arm's poses inverted, which puts the scanner at {x}, {y}, {z} mm of the base and the board on the flange: give the \
             setup eye_to_hand, and leave the poses as they are"
        )
    };
    let reading = match code {
        FindingCode::Inverted => "with cloud_from_board inverted: board_from_cloud was given".to_owned(),
        FindingCode::OtherSetup => figures.vector.map_or_else(
            || {
                "with the arm's poses inverted: eye_in_hand was given for a scanner that stands in the cell (eye_to_hand) or the \
                 reverse, or flange_from_base was given"
                    .to_owned()
            },
            stands,
        ),
        FindingCode::QuaternionOrder => {
            let field = field(figures.subject);
            format!("with the quaternions of {field} read as w, x, y, z: give them as x, y, z, w")
        }
        FindingCode::OutOfStep => {
            let field = field(figures.subject);
            format!("with {field} shifted by one observation: the records are out of step")
        }
        FindingCode::BoardTurned => "if the board turned with the table: solve for joint".to_owned(),
        _ => format!("with the rotations of {} transposed: their columns were written as rows", field(figures.subject)),
    };
    format!("the boards disagree by {given:.1} mm as given, and by {other:.2} mm {reading}")
}

fn of_board(figures: &Figures) -> String {
    let (ratio, mm) = (figures.ratio.unwrap_or(1.0), figures.length_mm.unwrap_or(0.0));
    let size = figures.other_length_mm.map_or_else(
        || format!("the board is probably {:.4} of the size that was given", ratio.recip()),
        |likely_mm| format!("squares or spacings given as {:.3} mm are probably {likely_mm:.3} mm", likely_mm * ratio),
    );
    format!(
        "distances to the board are {:+.2} % off those of the arm's motions, which puts the scanner {mm:.2} mm off along its \
         viewing direction: {size}, or the scale of the scanner or of the arm is off; measure the board, and find its poses \
         again with its true size",
        100.0 * (ratio - 1.0)
    )
}

#[expect(clippy::wildcard_enum_match_arm, reason = "the last arm is for the last of the codes that it is called with")]
fn of_table(code: FindingCode, figures: &Figures) -> String {
    let (asked, found) = (figures.turn_rad.unwrap_or(0.0).to_degrees(), figures.other_turn_rad.unwrap_or(0.0).to_degrees());
    match code {
        FindingCode::TableSign => {
            format!("the board turned by {found:.2}° when the table reported {asked:+.2}°: invert the table's axis")
        }
        FindingCode::TableScale => {
            format!("the table turns {:.5} of the angle that it reports: check its gear ratio", figures.ratio.unwrap_or(f64::NAN))
        }
        _ => format!(
            "the table turned by {asked:.1}° in all; its axis needs 10°, preferably a full turn; a board that stands beside the \
             table gives only the scanner (solve = hand_eye)"
        ),
    }
}

#[expect(clippy::wildcard_enum_match_arm, reason = "the last arm is for the last of the codes that it is called with")]
fn of_poses(code: FindingCode, about: &str, figures: &Figures) -> String {
    let (mm, deg) = (figures.length_mm.unwrap_or(0.0), figures.turn_rad.unwrap_or(0.0).to_degrees());
    match code {
        FindingCode::Moved => format!(
            "{about} agree with each other but not with the others ({mm:.1} mm, {deg:.2}°): the board or the scanner moved in \
             between"
        ),
        FindingCode::Swapped => format!("{about}: each fits the board of the other, so that they are probably exchanged"),
        FindingCode::Flipped => format!("{about} fits if turned by 180°: the board has no orientation"),
        FindingCode::DuplicatePose => format!("{about} are the same to within {mm} mm: the first is left out"),
        FindingCode::HeldOutDisagrees => {
            format!("{about} was held out, and is {mm:.2} mm and {deg:.3}° off: the calibration does not hold there")
        }
        _ => format!("{about} does not agree with the others ({mm:.2} mm, {deg:.3}°) and was dropped"),
    }
}

fn of_age(figures: &Figures) -> String {
    match (figures.temperatures_c, figures.ratio) {
        (Some([now, then]), _) => {
            format!(
                "taken at {now:.1} °C, but calibrated at {then:.1} °C: the difference of {:.1} K exceeds 5 K; calibrate again",
                (now - then).abs()
            )
        }
        (None, Some(hours)) => format!("the calibration is {hours:.0} hours old: check it again"),
        (None, None) => "the calibration is stale: check it again".to_owned(),
    }
}

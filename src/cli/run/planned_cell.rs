//! Cell of a run beside the one that its program was planned for, in an operator's words: what follows from another robot, table
//! or scanner is many numbers, and tells nobody what is wrong.

use crate::cell::{Cell, FieldError, PoseSpec};
use crate::check::{Reference, field_errors};
use crate::cli::{CliError, FileFinding};
use crate::geometry::Pose;
use crate::program::{Finding, Program};
use crate::wire::plan::PlanDocument;

/// Largest distance from the plan's place that no scan is refused for, mm.
const SAME_MM: f64 = 0.1;
/// Largest turn from it likewise, degrees.
const SAME_DEG: f64 = 0.01;

/// Refuses a cell with other hardware than was planned for, by its names, and a scanner that is not as it was.
pub(super) fn check(given: &str, cell: &Cell, program: &Program, reference: &Reference) -> Result<(), CliError> {
    let plan = plan_of(reference);
    let scanner = plan.map_or(cell.scanner.name.as_str(), |plan| plan.scanner.name.as_str());
    let differing = other_hardware(cell, [program.robot.as_str(), program.turntable.as_str(), scanner]);
    if !differing.is_empty() {
        let planned = plan.and_then(|plan| plan.cell.as_ref()).map_or_else(String::new, |cell| format!(", {}", cell.name));
        return Err(CliError::BadInput(format!(
            "{given}: is not the cell that was planned for: it has {differing}\n  → give the cell that was{planned}, or plan \
             again for this one"
        )));
    }
    reference.check_scanner(cell).map_err(|errors| {
        let detail = format!(
            "{} has other lenses, poses or depths than were planned for: it was calibrated or edited since; plan again for this \
             cell, or give the one that was planned for. What differs:",
            cell.scanner.name
        );
        let first = FieldError { pointer: "/scanner".to_owned(), detail };
        CliError::Findings(findings(given, std::iter::once(first).chain(errors)))
    })
}

/// Findings in a program, behind what of the cell is not where the plan has it, which most of them come from.
pub(super) fn refused(given: &str, cell: &Cell, reference: &Reference, shown: &str, found: &[Finding]) -> CliError {
    let planned = plan_of(reference).and_then(|plan| plan.cell.as_ref());
    let moved: Vec<FieldError> = planned.map_or_else(Vec::new, |planned| {
        let places = [
            ("/base_from_table", "table", apart(&planned.base_from_table, &cell.base_from_table)),
            ("/flange_from_scanner", "scanner", apart(&planned.flange_from_scanner, &cell.flange_from_scanner)),
        ];
        let told = places.into_iter().filter_map(|(pointer, what, apart)| {
            let detail = format!(
                "puts the {what} {} from where the plan has it; plan again for this cell, or give the one that was planned for",
                apart?
            );
            Some(FieldError { pointer: pointer.to_owned(), detail })
        });
        told.collect()
    });
    CliError::Findings([findings(given, moved), findings(shown, field_errors(found))].concat())
}

fn plan_of(reference: &Reference) -> Option<&PlanDocument> {
    reference.plan.as_ref().map(|(plan, _)| plan)
}

/// Robot, turntable and scanner that the cell has in place of those planned for; empty if it has the same.
fn other_hardware(cell: &Cell, planned: [&str; 3]) -> String {
    let present = [&cell.robot.name, &cell.turntable.name, &cell.scanner.name];
    let pairs = ["robot", "turntable", "scanner"].into_iter().zip(present).zip(planned);
    let other = pairs.filter(|((_, present), planned)| present.as_str() != *planned);
    other.map(|((what, present), planned)| format!("{what} {present}, not {planned}")).collect::<Vec<_>>().join("; ")
}

/// Distance and turn of a pose from the planned one; `None` if a scan would not tell them apart.
fn apart<To, From>(planned: &PoseSpec, present: &Pose<To, From>) -> Option<String> {
    let planned: Pose<To, From> = planned.pose();
    let mm = (planned.origin_mm() - present.origin_mm()).norm();
    let deg = planned.isometry().rotation.angle_to(&present.isometry().rotation).to_degrees();
    (mm > SAME_MM || deg > SAME_DEG).then(|| format!("{mm:.2} mm and {deg:.2}°"))
}

fn findings(file: &str, errors: impl IntoIterator<Item = FieldError>) -> Vec<FileFinding> {
    let finding = |FieldError { pointer, detail }: FieldError| FileFinding { file: file.to_owned(), pointer, detail };
    errors.into_iter().map(finding).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::{Presets, SpecLibrary};

    fn cell() -> Cell {
        Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("builds")
    }

    fn program(cell: &Cell, robot: &str) -> Program {
        Program {
            plan_sha256: "ab".repeat(32),
            setup: 0,
            calibration: None,
            robot: robot.to_owned(),
            turntable: cell.turntable.name.clone(),
            home_rad: cell.home_rad,
            cycle_secs: 0.0,
            steps: Vec::new(),
        }
    }

    #[test]
    fn a_cell_with_another_robot_is_refused_by_its_name_with_what_to_do() {
        let (cell, reference) = (cell(), Reference::default());
        let own = program(&cell, &cell.robot.name);
        assert_eq!(check("cell.toml", &cell, &own, &reference).map_err(|error| error.to_string()), Ok(()));
        let told = check("cell.toml", &cell, &program(&cell, "ur5e"), &reference).expect_err("another robot").to_string();
        let wanted = "cell.toml: is not the cell that was planned for: it has robot hans-e05, not ur5e\n  → give the cell \
                      that was, or plan again for this one";
        assert_eq!(told, wanted);
    }

    #[test]
    fn hardware_that_differs_is_told_together() {
        let cell = cell();
        let told = other_hardware(&cell, ["ur5e", &cell.turntable.name, "transcan-c-nominal"]);
        assert_eq!(told, "robot hans-e05, not ur5e; scanner transcan-c, not transcan-c-nominal");
    }

    #[test]
    fn a_place_is_another_where_a_scan_would_be_refused_for_it() {
        let cell = cell();
        let mut planned = PoseSpec::from(&cell.base_from_table);
        assert_eq!(apart(&planned, &cell.base_from_table), None);
        planned.translation_mm[1] += 12.3;
        assert_eq!(apart(&planned, &cell.base_from_table).as_deref(), Some("12.30 mm and 0.00°"));
    }
}

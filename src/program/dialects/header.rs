//! The header that every program begins with.

use super::names::comment;
use super::walk::Action;
use super::{CheckedWith, Job};

/// The header, a paragraph a line, without marks of a comment. `units` and `table` are the dialect's own words on its
/// units and on how the table is moved; `extra` is what else has to be known.
pub(super) fn paragraphs(job: &Job<'_>, file: &str, units: &str, table: &str, extra: &[&str]) -> Vec<String> {
    let (program, cell) = (job.program, job.cell);
    let scans = match job.actions.iter().filter(|action| matches!(action, Action::Scan { .. })).count() {
        1 => "1 scan".to_owned(),
        scans => format!("{scans} scans"),
    };
    let checked = match job.checked_with {
        CheckedWith::Part => "Checked in the model of the cell with the part in it: limits, speeds, collisions.",
        CheckedWith::Board => {
            "Checked in the model of the cell with the calibration board on the table, WITHOUT a part: limits, speeds, \
             collisions. Take part and fixture off the table."
        }
        CheckedWith::CellAlone => {
            "WARNING: checked in the model of the cell WITHOUT the part: what hits the part was not looked for."
        }
    };
    let mut lines = vec![format!("Vantage scan program. File name: {file}")];
    lines.extend(origin(job));
    lines.extend([
        format!("Setup {}, {scans}, predicted cycle {:.1} s", program.setup + 1, program.cycle_secs),
        format!("Cell {}, robot {}, turntable {}", cell.name, cell.robot.name, cell.turntable.name),
        format!("Units: {units}"),
        "WARNING: not safety-rated. Guarding, speed limits and stops belong to the cell's safety system.".to_owned(),
        "WARNING: run first at reduced speed, nobody in the cell, a hand on the stop.".to_owned(),
        checked.to_owned(),
        format!(
            "Payload to be set on the controller: {:.2} kg at the flange, and cables.",
            cell.scanner.mass_kg + cell.mount_mass_kg
        ),
        format!("Table: {table}"),
        "Each point is a stop: the paths between them were checked as straight joint moves.".to_owned(),
        format!(
            "Scan: output {} on for {} s starts it; input {input} on ends it, after {secs} s the program stops. Input {input} \
             has to be off before the next scan: the program waits for that, {secs} s at most, and then stops.",
            job.params.scan_output,
            job.params.pulse_secs,
            input = job.params.scan_input,
            secs = job.params.timeout_secs
        ),
    ]);
    lines.extend(job.slowed.as_ref().map(|slowed| {
        format!(
            "Speed: {slowed}, since this program sets speeds or accelerations in whole percents, rounded down. The cycle above \
             is the one at this speed."
        )
    }));
    lines.extend(job.untold_levels.as_ref().map(|levels| {
        format!(
            "WARNING: the scans are at brightness levels {levels}, and this program does not tell the scanner which. The scanner's own \
             software has to switch before each scan, to the level in the comment there."
        )
    }));
    lines.extend(extra.iter().map(|&line| line.to_owned()));
    lines.iter().map(|line| comment(line)).collect()
}

/// Plan that the program is made from, and a warning if the language is another maker's: what every file of a program says.
pub(super) fn origin(job: &Job<'_>) -> Vec<String> {
    let warning = job.foreign.map(|own| {
        let robot = &job.cell.robot.name;
        format!("WARNING: FORCED. Robot {robot} takes {own}, not this language: zeros and signs of its joints may be others.")
    });
    let lines = std::iter::once(format!("Plan SHA-256 {}", job.program.plan_sha256)).chain(warning);
    lines.map(|line| comment(&line)).collect()
}

/// The paragraphs in lines of at most 100 characters, each behind `mark`.
pub(super) fn commented(paragraphs: &[String], mark: &str) -> Vec<String> {
    let lines = paragraphs.iter().flat_map(|paragraph| super::names::wrap(paragraph, 100));
    lines.map(|line| format!("{mark} {line}")).collect()
}

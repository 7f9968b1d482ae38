//! Programs in the languages of robot controllers. Motion is the program's, point by point with a stop at each, since that
//! is what was checked; a dialect adds nothing but the words. Only a [`CheckedProgram`] can be rendered, in the language that
//! the robot's specification names or in a neutral one; any other has to be forced, and its header then warns.
//!
//! Angles are degrees here where the language's are. The table is an external axis where the language has one (RAPID, KRL,
//! FANUC, RoboDK); Han's and URScript call for it by name, and get the interlocked program, in which it never moves with
//! the arm. Each file documents what of its language it relies on.

mod header;
mod names;
mod numbers;
mod walk;

use std::borrow::Cow;
use std::collections::BTreeSet;

use super::{Expected, Finding, Program, Step, Together, check, interlock};
pub use crate::cell::Dialect;
use crate::cell::{Axes, Cell, CollisionScene, dialect_table};
use crate::geometry::listed;
use crate::planning::params::DialectParams;

/// A file of a dialect, as interfaces name it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DialectOutput {
    /// Name of the format in requests.
    pub format: &'static str,
    /// Extension of the file's name.
    pub extension: &'static str,
    /// Media type; none of the languages has a registered one.
    pub media_type: &'static str,
}

/// Difference of two shares of the rated speed that are one but for rounding.
const SAME_SPEED: f64 = 1e-9;
/// Difference of cycles from which on two are told apart, s.
const SAME_CYCLE_SECS: f64 = 0.05;

/// Facts of a dialect; each stands in the dialect's own file.
struct DialectFacts {
    /// Files, in the order rendered.
    outputs: &'static [DialectOutput],
    /// True if its controllers move the table with the arm.
    has_table_axis: bool,
    /// Share of the rated speed from which on its files set speeds or accelerations in whole percents; `None` if none does.
    whole_percents_from: Option<f64>,
    /// True if the file tells its reader the brightness level of each scan, and not in a comment alone.
    tells_brightness: bool,
    /// True if it is a table: its files are named as a plan names its own, and it stands first among the forms of a program.
    is_table: bool,
    /// Name that the files of a setup's program must have on the controller, without extension; `None` of a language that takes any.
    file_stem: Option<fn(&DialectParams, usize) -> String>,
    /// Field of [`DialectParams`] that allows longer names of programs; `None` if none does.
    name_length_param: Option<&'static str>,
    /// Work that the integrator has to do before the first run, in a clause; `None` if the file runs as it is.
    before_first_run: Option<&'static str>,
    /// Writes the files.
    render: fn(&Job<'_>) -> Result<Vec<DialectFile>, DialectError>,
}

/// Declares the file of each dialect in the table, and finds its facts there.
macro_rules! dialect_modules {
    ($($(#[$about:meta])* $dialect:ident = $name:literal in $file:ident: $facts:expr;)*) => {
        $(mod $file;)*

        impl Dialect {
            fn facts(self) -> &'static DialectFacts {
                match self {
                    $(Self::$dialect => &$file::FACTS,)*
                }
            }
        }
    };
}

dialect_table!(dialect_modules);

impl Dialect {
    /// Files, in the order rendered.
    #[must_use]
    pub fn outputs(self) -> &'static [DialectOutput] {
        self.facts().outputs
    }

    /// Returns true if its controllers move the table with the arm; those of the others move them in turn.
    #[must_use]
    pub fn moves_table_with_arm(self) -> bool {
        self.facts().has_table_axis
    }

    /// Name that the files of a setup's program must have on the controller, without extension; `None` of a language that takes any.
    #[must_use]
    pub fn file_stem(self, params: &DialectParams, setup: usize) -> Option<String> {
        self.facts().file_stem.map(|file_stem| file_stem(params, setup))
    }

    /// Returns true if it is a table: its files are named as a plan names its own, and it stands first among the forms of a program.
    #[must_use]
    pub fn is_table(self) -> bool {
        self.facts().is_table
    }

    /// Field of [`DialectParams`] that allows longer names of programs; `None` if none does.
    #[must_use]
    pub fn name_length_param(self) -> Option<&'static str> {
        self.facts().name_length_param
    }

    /// Work that the integrator has to do before the first run, in a clause; `None` if the file runs as it is.
    #[must_use]
    pub fn before_first_run(self) -> Option<&'static str> {
        self.facts().before_first_run
    }

    /// Work that the integrator has to do before the first run of these programs, in a clause; `None` if they run as they are.
    #[must_use]
    pub fn before_first_run_of<'p>(self, programs: impl IntoIterator<Item = &'p Program>) -> Option<String> {
        let switching = self.untold_levels(programs).map(|levels| {
            format!(
                "have the scanner's own software switch its brightness before each scan, to the level in the comment there ({levels}); the \
                 program does not"
            )
        });
        let work: Vec<String> = self.before_first_run().map(str::to_owned).into_iter().chain(switching).collect();
        (!work.is_empty()).then(|| work.join("; and "))
    }

    /// Names that the files of a plan have to take on the controller, in a clause; `stems` are setups with the names of their files
    /// in the plan, without extension. `None` of a language that takes any name, and where there is no file.
    #[must_use]
    pub fn renaming_of(self, params: &DialectParams, stems: &[(usize, String)]) -> Option<String> {
        let (mut in_plan, mut on_controller) = (Vec::new(), Vec::new());
        for (setup, stem) in stems {
            let wanted = self.file_stem(params, *setup)?;
            for DialectOutput { extension, .. } in self.outputs() {
                in_plan.push(format!("{stem}.{extension}"));
                on_controller.push(format!("{wanted}.{extension}"));
            }
        }
        let (found, wanted) = (listed(&in_plan), listed(&on_controller));
        let copied = format!("copy {found} to the controller as {wanted} (vantage program writes them under these names)");
        (!in_plan.is_empty()).then_some(copied)
    }

    /// Brightness levels of programs, as `5 and 9`; `None` if there is one only, or if the dialect tells the level of each scan.
    fn untold_levels<'p>(self, programs: impl IntoIterator<Item = &'p Program>) -> Option<String> {
        if self.facts().tells_brightness {
            return None;
        }
        let levels: BTreeSet<u8> = programs.into_iter().flat_map(Program::brightness_levels).collect();
        let levels: Vec<String> = levels.iter().map(ToString::to_string).collect();
        (levels.len() > 1).then(|| listed(&levels))
    }
}

/// A file for a controller.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DialectFile {
    /// The name that the controller asks for.
    pub name: String,
    /// Content of the file; ASCII.
    pub text: String,
}

/// Reason why a program cannot be rendered in a dialect.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DialectError {
    /// The language of another maker.
    #[error("{dialect} is not a language of robot {robot}, whose specification has dialect = \"{own}\"")]
    Foreign {
        /// Name of the dialect.
        dialect: &'static str,
        /// Name of the robot.
        robot: String,
        /// Name of the robot's own dialect.
        own: &'static str,
    },
    /// A signal that the controller does not have.
    #[error("dialects.{parameter} is {number}; {dialect} has {lowest} to {highest}")]
    Signal {
        /// Name of the parameter.
        parameter: &'static str,
        /// Number found.
        number: u32,
        /// Name of the dialect.
        dialect: &'static str,
        /// Lowest.
        lowest: u32,
        /// Highest.
        highest: u32,
    },
    /// An input of KUKA controllers that never changes.
    #[error(
        "dialects.scan_input is {number}; input {number} of a KUKA controller is always {level}, so that {effect}: give the number of the \
         input that the scanner is wired to"
    )]
    ConstantInput {
        /// Number found.
        number: u32,
        /// Level of the input, in the language's word.
        level: &'static str,
        /// Consequence, in a clause.
        effect: &'static str,
    },
    /// The table is another axis than FANUC programs turn.
    #[error(
        "dialects.table_axis is {0}; a fanuc program turns axis 1 of motion group 2 alone: make the table that axis, and set \
         dialects.table_axis = 1"
    )]
    TableAxis(u32),
    /// Whole percents cannot say it without being quicker than was checked.
    #[error("the speed is {0} of the rated; {1} cannot go below 1 %")]
    TooSlow(f64, &'static str),
    /// The controller counts joint 3 from the ground, and the robot's model does not say that it does.
    #[error(
        "the robot's model does not count joint 3 from the ground, as the controller does; set dialects.fanuc_joint_3_from = \"upper_arm\" \
         if it counts it from the upper arm, as models in URDF do"
    )]
    JointThree,
    /// Moves are passed through that every dialect stops in.
    #[error(
        "the program passes points without stopping, which is for executors that stream set points; plan it with motion.corners = \"stop\""
    )]
    Passing,
    /// Arm and table have to move together.
    #[error(transparent)]
    Together(#[from] Together),
    /// The linter finds faults where arm and table move one after the other.
    #[error("with arm and table moving one after the other: {0}")]
    Interlocked(Finding),
}

/// The model that a program was checked against, which its header says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CheckedWith {
    /// The cell with the part in it.
    Part,
    /// The cell with the calibration board on its table.
    Board,
    /// The cell alone.
    CellAlone,
}

/// A program that the linter found nothing in.
#[derive(Clone, Debug)]
pub struct CheckedProgram<'a> {
    program: &'a Program,
    interlocked: Result<Program, DialectError>,
    cell: &'a Cell,
    checked_with: CheckedWith,
}

impl<'a> CheckedProgram<'a> {
    /// Checks the program, and its interlocked form, in `scene`.
    ///
    /// # Errors
    /// Findings in the program; those in the interlocked form are told when that is rendered.
    pub fn new(
        program: &'a Program,
        cell: &'a Cell,
        scene: &CollisionScene,
        expected: Option<&Expected>,
        checked_with: CheckedWith,
    ) -> Result<Self, Vec<Finding>> {
        let findings = check(program, cell, scene, expected);
        if !findings.is_empty() {
            return Err(findings);
        }
        let interlocked = interlock(program, cell, scene).map_err(DialectError::from).and_then(|interlocked| {
            match check(&interlocked, cell, scene, expected).into_iter().next() {
                Some(finding) => Err(DialectError::Interlocked(finding)),
                None => Ok(interlocked),
            }
        });
        Ok(Self { program, interlocked, cell, checked_with })
    }

    /// Predicted cycle time of the program in a dialect: what the header of its files says.
    ///
    /// # Errors
    /// [`DialectError`], if the dialect cannot say what the program does.
    pub fn cycle_secs(&self, dialect: Dialect) -> Result<f64, DialectError> {
        self.form_for(dialect).map(|program| program.cycle_secs)
    }

    /// Returns true if the program moves table and arm in turn in a dialect, where the plan moves both at once.
    #[must_use]
    pub fn moves_in_turn(&self, dialect: Dialect) -> bool {
        self.at_planned_speeds(dialect)
            .is_ok_and(|program| (program.cycle_secs - self.program.cycle_secs).abs() >= SAME_CYCLE_SECS)
    }

    /// The form of the program that a dialect says: interlocked where its controllers do not move the table with the arm, and at
    /// the speeds that its files set, with their times.
    fn form_for(&self, dialect: Dialect) -> Result<Cow<'_, Program>, DialectError> {
        let program = self.at_planned_speeds(dialect)?;
        match dialect.facts().whole_percents_from {
            Some(from) => self.in_whole_percents(program, dialect, from),
            None => Ok(Cow::Borrowed(program)),
        }
    }

    /// The form of the program for a dialect's controllers, at the speeds that were planned.
    fn at_planned_speeds(&self, dialect: Dialect) -> Result<&Program, DialectError> {
        // Asked of the program as planned: where table and arm move in turn, the points passed have become stops.
        if self.program.passes_points() {
            return Err(DialectError::Passing);
        }
        if dialect.moves_table_with_arm() { Ok(self.program) } else { self.interlocked.as_ref().map_err(Clone::clone) }
    }

    /// The program at the whole percents that its speeds, those `from` this share on, are rounded down to; times are derived anew
    /// where that is slower.
    fn in_whole_percents<'p>(&self, program: &'p Program, dialect: Dialect, from: f64) -> Result<Cow<'p, Program>, DialectError> {
        let axes = self.cell.axes();
        let (mut slowed, mut here) = (program.clone(), program.home_rad);
        for step in &mut slowed.steps {
            if let Step::Move(step) = step {
                if step.speed_fraction >= from {
                    let fraction = f64::from(percent(step.speed_fraction, dialect)?) / 100.0;
                    if step.speed_fraction - fraction > SAME_SPEED {
                        step.speed_fraction = fraction;
                        step.duration_secs = step.derived_secs(&here, &axes);
                    }
                }
                here = step.target_rad;
            }
        }
        slowed.cycle_secs = slowed.steps.iter().map(Step::secs).sum();
        Ok(if slowed.steps == program.steps { Cow::Borrowed(program) } else { Cow::Owned(slowed) })
    }

    /// The program in a dialect that the robot takes: one file for each of its extensions. `params` are taken as checked.
    ///
    /// # Errors
    /// [`DialectError`].
    pub fn render(&self, dialect: Dialect, params: &DialectParams) -> Result<Vec<DialectFile>, DialectError> {
        match self.own_instead_of(dialect) {
            None => self.render_forced(dialect, params),
            Some(own) => {
                let robot = self.cell.robot.name.clone();
                Err(DialectError::Foreign { dialect: dialect.as_str(), robot, own: own.as_str() })
            }
        }
    }

    /// The program in any dialect. If it is another maker's, the header warns.
    ///
    /// # Errors
    /// [`DialectError`], but not [`DialectError::Foreign`].
    pub fn render_forced(&self, dialect: Dialect, params: &DialectParams) -> Result<Vec<DialectFile>, DialectError> {
        let (program, planned) = (self.form_for(dialect)?, self.at_planned_speeds(dialect)?);
        let program: &Program = &program;
        let job = Job {
            program,
            actions: walk::actions(program),
            slowed: slowed(planned, program),
            cell: self.cell,
            axes: self.cell.axes(),
            params,
            checked_with: self.checked_with,
            foreign: self.own_instead_of(dialect).map(Dialect::as_str),
            untold_levels: dialect.untold_levels([program]),
        };
        (dialect.facts().render)(&job)
    }

    /// The robot's own dialect, if it does not take `dialect`.
    fn own_instead_of(&self, dialect: Dialect) -> Option<Dialect> {
        let robot = &self.cell.robot;
        robot.dialect.filter(|_| !robot.takes(dialect))
    }
}

/// Everything that a dialect is rendered from.
struct Job<'a> {
    program: &'a Program,
    actions: Vec<walk::Action>,
    /// Planned speeds, in words, where the program's are lower.
    slowed: Option<String>,
    cell: &'a Cell,
    axes: Axes,
    params: &'a DialectParams,
    checked_with: CheckedWith,
    /// Name of the robot's own dialect, if it does not take the one rendered.
    foreign: Option<&'static str>,
    /// Brightness levels that the scanner has to be switched between without being told, in words.
    untold_levels: Option<String>,
}

impl Job<'_> {
    /// The file called `name` with the dialect's `extension`.
    fn file(name: &str, extension: &str, lines: &[String]) -> DialectFile {
        DialectFile { name: format!("{name}.{extension}"), text: lines.join("\n") + "\n" }
    }

    fn check_signals(&self, dialect: Dialect, lowest: u32, highest: u32) -> Result<(), DialectError> {
        let numbers = [("scan_output", self.params.scan_output), ("scan_input", self.params.scan_input)];
        match numbers.into_iter().find(|(_, number)| !(lowest..=highest).contains(number)) {
            Some((parameter, number)) => {
                Err(DialectError::Signal { parameter, number, dialect: dialect.as_str(), lowest, highest })
            }
            None => Ok(()),
        }
    }
}

/// Whole percents of a share of the rated speed, rounded down: never quicker than was checked.
fn whole_percent(speed_fraction: f64) -> u32 {
    (100.0 * speed_fraction + 1e-9).floor() as u32
}

/// Speed in whole percents, of which a controller takes one at least.
fn percent(speed_fraction: f64, dialect: Dialect) -> Result<u32, DialectError> {
    match whole_percent(speed_fraction) {
        0 => Err(DialectError::TooSlow(speed_fraction, dialect.as_str())),
        percent => Ok(percent),
    }
}

/// Speeds of a program that are lower than those that were planned, as `2 % of the rated, not the 2.5 %`; `None` if none is.
fn slowed(planned: &Program, program: &Program) -> Option<String> {
    let mut told = Vec::new();
    for (planned, slowed) in planned.steps.iter().zip(&program.steps) {
        if let (Step::Move(planned), Step::Move(slowed)) = (planned, slowed)
            && planned.speed_fraction > slowed.speed_fraction
        {
            let [was, is] = [planned, slowed].map(|step| shortest(100.0 * step.speed_fraction));
            let words = format!("{is} % of the rated, not the {was} % that were planned");
            if !told.contains(&words) {
                told.push(words);
            }
        }
    }
    (!told.is_empty()).then(|| told.join("; "))
}

/// Formats a number with as many decimals as it has, at most three.
fn shortest(value: f64) -> String {
    let text = numbers::fixed(value, 3);
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests;

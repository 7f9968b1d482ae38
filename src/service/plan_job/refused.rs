//! Files that a plan lacks, and why: programs in dialects that were refused or are kept under a name of their own, and a listing that is
//! too large. All of them stand in [`REFUSED_FILE`], from which jobs and the command line tell them.

use std::collections::BTreeMap;

use super::{Artifact, Files, bytes_of};
use crate::planning::params::DialectParams;
use crate::program::dialects::{CheckedProgram, Dialect, DialectError, DialectOutput};
use crate::wire::candidates::CANDIDATES_FILE;
use crate::wire::warnings::{FieldWarning, WarningCode};

/// File with the reasons why some files are missing: programs in some dialects, or a listing that is too large.
pub const REFUSED_FILE: &str = "refused.json";

/// Reasons why files are missing, by their names.
pub(super) type Refused = BTreeMap<String, String>;

/// Name under which a program is kept that is in the language of another maker than the robot's: `program.mod` as
/// `program.foreign.mod`. `None` if the name is not a program's in a maker's language.
#[must_use]
pub fn foreign_name(name: &str) -> Option<String> {
    let (stem, extension) = name.rsplit_once('.')?;
    dialect_of(name).map(|_| format!("{stem}.foreign.{extension}"))
}

/// Language of the program that a file name is of, if that is a maker's.
#[must_use]
pub fn dialect_of(name: &str) -> Option<Dialect> {
    let (stem, extension) = name.rsplit_once('.')?;
    let mut makers = Dialect::ALL.into_iter().filter(|dialect| !dialect.is_neutral());
    let is_program = stem.starts_with("program") && !stem.contains('.');
    makers.find(|dialect| is_program && dialect.outputs().iter().any(|output| output.extension == extension))
}

/// A program in some dialect.
pub(super) struct DialectProgram {
    /// Name of its file.
    name: String,
    /// Language of the program.
    pub(super) dialect: Dialect,
    /// Text of the program, or the reason why it has none.
    pub(super) text: Result<String, String>,
    /// Reason why it is refused unless it is forced, if the robot does not take the dialect.
    foreign: Option<String>,
}

impl DialectProgram {
    /// Adds the file, and the reason why it is missing or refused.
    pub(super) fn sort_into(self, files: &mut Files, refused: &mut Refused) {
        let kept_as = self.foreign.as_ref().and_then(|_| foreign_name(&self.name));
        match self.text {
            Ok(text) => files.push((kept_as.unwrap_or_else(|| self.name.clone()).into(), text.into_bytes())),
            Err(reason) => drop(refused.insert(self.name.clone(), reason)),
        }
        refused.extend(self.foreign.map(|reason| (self.name, reason)));
    }
}

/// Every file of a program in a dialect. If the robot does not take the dialect, that is told beside a text that warns of it.
pub(super) fn in_dialect(
    checked: Result<&CheckedProgram<'_>, &String>,
    dialect: Dialect,
    stem: &str,
    params: &DialectParams,
) -> Vec<DialectProgram> {
    let rendered = checked.map_err(Clone::clone).and_then(|checked| {
        let foreign = match checked.render(dialect, params) {
            Ok(files) => return Ok((files, None)),
            Err(foreign @ DialectError::Foreign { .. }) => foreign.to_string(),
            Err(error) => return Err(error.to_string()),
        };
        let forced = checked.render_forced(dialect, params).map_err(|error| error.to_string())?;
        Ok((forced, Some(foreign)))
    });
    let program = |(index, output): (usize, &DialectOutput)| DialectProgram {
        name: format!("{stem}.{}", output.extension),
        dialect,
        text: rendered.as_ref().map(|(files, _)| files[index].text.clone()).map_err(Clone::clone),
        foreign: rendered.as_ref().ok().and_then(|(_, foreign)| foreign.clone()),
    };
    dialect.outputs().iter().enumerate().map(program).collect()
}

/// Programs in a dialect that were refused: names of their files, of several files of a program the first, and the reasons.
#[must_use]
pub fn refused_programs(artifacts: &[Artifact], dialect: Dialect) -> Vec<(String, String)> {
    let refused: Refused = serde_json::from_slice(bytes_of(artifacts, REFUSED_FILE)).unwrap_or_default();
    let first = dialect.outputs().first().map(|output| output.extension);
    let is_in_dialect = |name: &str| {
        name.rsplit_once('.').is_some_and(|(stem, extension)| stem.starts_with("program") && Some(extension) == first)
    };
    refused.into_iter().filter(|(name, _)| is_in_dialect(name)).collect()
}

/// Warning on the list of every candidate, where it was asked for and is not among the files; `at` is the pointer to the parameters.
#[must_use]
pub fn left_out_candidates(artifacts: &[Artifact], at: &str) -> Option<FieldWarning> {
    let mut refused: Refused = serde_json::from_slice(bytes_of(artifacts, REFUSED_FILE)).unwrap_or_default();
    let reason = refused.remove(CANDIDATES_FILE)?;
    let (reason, remedy) = reason.split_once("; ").unwrap_or((reason.as_str(), "reduce the number of candidates"));
    Some(FieldWarning {
        code: WarningCode::CandidatesLeftOut,
        pointer: format!("{at}/output/candidates"),
        detail: format!("is true, but {CANDIDATES_FILE} is not written: {reason}"),
        remedy: remedy.to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::candidates::ListingError;
    use crate::wire::json_file_bytes;

    #[test]
    fn a_list_of_candidates_that_is_too_large_is_told_with_what_to_do() {
        let refused = |name: &str, reason: String| {
            vec![Artifact { name: REFUSED_FILE.into(), bytes: json_file_bytes(&Refused::from([(name.to_owned(), reason)])) }]
        };
        let too_large = ListingError::TooLarge { max_mib: 512 }.to_string();
        let told = left_out_candidates(&refused(CANDIDATES_FILE, too_large), "/params").expect("a warning");
        let expected = FieldWarning {
            code: WarningCode::CandidatesLeftOut,
            pointer: "/params/output/candidates".to_owned(),
            detail: "is true, but candidates.json is not written: it would be larger than 512 MiB".to_owned(),
            remedy: "reduce part.samples_per_mm2 or the number of candidates".to_owned(),
        };
        assert_eq!(told, expected);
        assert!(told.code.is_of_plan(), "a job tells it");
        assert_eq!(left_out_candidates(&refused("program.cps", "far away".to_owned()), "/params"), None);
        assert_eq!(left_out_candidates(&[], "/params"), None);
    }
}

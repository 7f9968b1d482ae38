//! Files of calibration poses: the poses, and beside them the program that moves to them. Only files that Vantage wrote for the
//! poses that stand there are replaced; programs of these poses that are not written anew are removed.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::cli::out::{is_program_text, refused};
use crate::cli::{CliError, files};
use crate::program::dialects::DialectFile;
use crate::service::plan_job::{PLAN_FILE, plan_sha256};
use crate::wire::calibration::CALIBRATION_POSES_SCHEMA;
use crate::wire::output_record::RECORD_FILE;
use crate::wire::program::PROGRAM_SCHEMA;

/// File of the program itself.
const PROGRAM_FILE: &str = "program.json";
/// Digits of a digest that stand together in every language: FANUC has 32 characters a remark.
const DIGITS_TOGETHER: usize = 32;

/// Places of the files.
#[derive(Debug)]
pub(super) struct PoseFiles<'a> {
    poses: &'a Path,
    /// SHA-256 of the poses that stand there.
    earlier_sha256: Option<String>,
}

impl<'a> PoseFiles<'a> {
    /// Places beside `poses`, the file of the poses.
    ///
    /// # Errors
    /// [`CliError::BadInput`] for a folder with a plan or programs, and for a file that does not hold calibration poses.
    pub(super) fn at(poses: &'a Path) -> Result<Self, CliError> {
        let in_the_way = |what: &str| CliError::BadInput(format!("--out {}: {what}", poses.display()));
        if [PLAN_FILE, RECORD_FILE].iter().any(|name| poses.with_file_name(name).is_file()) {
            let what = "its folder has a plan or programs, whose files have the same names; name a file in another folder";
            return Err(in_the_way(what));
        }
        // What is no file, such as a pipe, is not read.
        if !poses.is_file() {
            return Ok(Self { poses, earlier_sha256: None });
        }
        let earlier = std::fs::read(poses).map_err(|error| files::unreadable(poses, &error))?;
        if !earlier.is_empty() && !has_schema(&earlier, CALIBRATION_POSES_SCHEMA) {
            return Err(in_the_way("exists and does not hold calibration poses; move it away or name another file"));
        }
        Ok(Self { poses, earlier_sha256: Some(plan_sha256(&earlier)) })
    }

    /// Writes poses, program and the files of its language; removes those of `known` names that are programs of the earlier
    /// poses. Returns the paths written.
    ///
    /// # Errors
    /// [`CliError::BadInput`] if a file of the user is in the way, [`CliError::Failed`] if the system refuses.
    pub(super) fn write(
        &self,
        (poses, program): (&[u8], &[u8]),
        rendered: &[DialectFile],
        known: &[&str],
    ) -> Result<Vec<PathBuf>, CliError> {
        let beside = |name: &str| self.poses.with_file_name(name);
        let written: Vec<&str> = std::iter::once(PROGRAM_FILE).chain(rendered.iter().map(|file| file.name.as_str())).collect();
        let in_the_way = |what: String| Err(CliError::BadInput(format!("--out {}: {what}", self.poses.display())));
        if let Some(name) = written.iter().find(|name| beside(name) == self.poses) {
            return in_the_way(format!(
                "{name} is the name of the program, which is written beside the poses; name another file"
            ));
        }
        if let Some(name) = written.iter().find(|name| beside(name).is_file() && !self.is_of_earlier(&beside(name))) {
            return in_the_way(format!(
                "{name} beside it was not written with it; move {name} away, or name a file in another folder"
            ));
        }
        for path in known.iter().filter(|name| !written.contains(name)).map(|name| beside(name)) {
            if self.is_of_earlier(&path) {
                std::fs::remove_file(&path).map_err(|error| refused(&path, &error))?;
            }
        }
        files::write(self.poses, poses)?;
        files::write(&beside(PROGRAM_FILE), program)?;
        rendered.iter().try_for_each(|file| files::write(&beside(&file.name), file.text.as_bytes()))?;
        Ok(std::iter::once(self.poses.to_owned()).chain(written.iter().map(|name| beside(name))).collect())
    }

    /// Returns true for a program of the poses that stand there.
    fn is_of_earlier(&self, path: &Path) -> bool {
        let Some(sha256) = self.earlier_sha256.as_ref().filter(|_| path.is_file()) else { return false };
        let Ok(bytes) = std::fs::read(path) else { return false };
        let is_program = is_program_text(&bytes) || has_schema(&bytes, PROGRAM_SCHEMA);
        is_program && String::from_utf8_lossy(&bytes).contains(&sha256[..DIGITS_TOGETHER])
    }
}

/// Returns true for a JSON document of this schema.
fn has_schema(bytes: &[u8], schema: &str) -> bool {
    serde_json::from_slice::<Value>(bytes).is_ok_and(|document| document["schema"].as_str() == Some(schema))
}

#[cfg(test)]
mod tests {
    use std::path::{Path, PathBuf};

    use super::{PoseFiles, plan_sha256};
    use crate::program::dialects::DialectFile;

    const POSES: [&str; 2] = [
        r#"{"schema": "vantage.calibration_poses/1", "poses": []}"#,
        r#"{"schema": "vantage.calibration_poses/1", "poses": [], "hold_out": 1}"#,
    ];

    /// Writes the poses, their program and the files of these names; the error, if it is refused.
    fn written(path: &Path, poses: &str, names: &[&str]) -> Result<Vec<String>, String> {
        let sha256 = plan_sha256(poses.as_bytes());
        let program = format!(r#"{{"schema": "vantage.program/1", "plan_sha256": "{sha256}"}}"#);
        let text = format!("# Vantage scan program\n# Plan SHA-256 {sha256}\n");
        let rendered: Vec<_> = names.iter().map(|name| DialectFile { name: (*name).to_owned(), text: text.clone() }).collect();
        let files = PoseFiles::at(path).map_err(|error| error.to_string())?;
        let paths = files.write((poses.as_bytes(), program.as_bytes()), &rendered, &["vantage.script", "vantage.mod"]);
        let names = |path: &PathBuf| path.file_name().expect("a name").to_string_lossy().into_owned();
        paths.map(|paths| paths.iter().map(names).collect()).map_err(|error| error.to_string())
    }

    /// A script of the poses before stayed beside a program of others.
    #[test]
    fn programs_of_the_poses_before_are_replaced_or_go() {
        let folder = tempfile::tempdir().expect("a folder");
        let (poses, script) = (folder.path().join("poses.json"), folder.path().join("vantage.script"));
        let all = |names: &[&str]| Ok(names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>());
        assert_eq!(written(&poses, POSES[0], &["vantage.script"]), all(&["poses.json", "program.json", "vantage.script"]));
        assert_eq!(written(&poses, POSES[1], &["vantage.script"]), all(&["poses.json", "program.json", "vantage.script"]));
        assert!(std::fs::read_to_string(&script).expect("a script").contains(&plan_sha256(POSES[1].as_bytes())));
        std::fs::write(folder.path().join("vantage.mod"), "! my own").expect("a file");
        assert_eq!(written(&poses, POSES[0], &[]), all(&["poses.json", "program.json"]));
        assert!(!script.exists() && folder.path().join("vantage.mod").exists(), "what is not of the poses stays");
    }

    /// Such files were overwritten without a word.
    #[test]
    fn files_of_the_user_are_not_replaced() {
        let folder = tempfile::tempdir().expect("a folder");
        let poses = folder.path().join("poses.json");
        let others = format!(r#"{{"schema": "vantage.program/1", "plan_sha256": "{}"}}"#, "ab".repeat(32));
        for (name, text) in [
            ("poses.json", "{\"mine\": true}"),
            ("program.json", "{\"mine\": true}"),
            ("program.json", others.as_str()),
            ("vantage.script", "# my own"),
        ] {
            std::fs::write(folder.path().join(name), text).expect("a file");
            let refused = written(&poses, POSES[0], &["vantage.script"]).expect_err("a file of the user");
            assert!(refused.starts_with("--out ") && refused.contains("move") && refused.contains(name), "{name}: {refused}");
            assert_eq!(std::fs::read_to_string(folder.path().join(name)).expect("there"), text);
            std::fs::remove_file(folder.path().join(name)).expect("there");
            assert!(std::fs::read_dir(folder.path()).expect("a folder").next().is_none(), "nothing is written");
        }
        let refused = written(&folder.path().join("program.json"), POSES[0], &[]).expect_err("the name of the program");
        assert!(refused.contains("program.json is the name of the program"), "{refused}");
        std::fs::write(folder.path().join("vantage.json"), "{}").expect("a record");
        assert!(written(&poses, POSES[0], &[]).expect_err("programs").contains("has a plan or programs"));
    }
}

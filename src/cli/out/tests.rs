use std::path::Path;

use super::*;

fn artifact(name: &'static str, bytes: &str) -> Artifact {
    Artifact { name: name.into(), bytes: bytes.as_bytes().to_vec() }
}

fn plan_of(sha256: &str) -> FileOrigin {
    FileOrigin { plan_sha256: Some(sha256.to_owned()), made_from: None }
}

fn write(folder: &Path, writer: OutputWriter, files: &[(&'static str, &str)], origin: &FileOrigin) -> Result<(), CliError> {
    let artifacts: Vec<Artifact> = files.iter().map(|(name, bytes)| artifact(name, bytes)).collect();
    OutputFolder::prepare(folder, writer, &[])?.replace(&artifacts, origin)
}

/// Every file with its text, but the record.
fn found(folder: &Path) -> Vec<(String, String)> {
    let entries = fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").file_name());
    let names = entries.map(|name| name.to_string_lossy().into_owned()).filter(|name| name != RECORD_FILE);
    let mut found: Vec<_> = names.map(|name| (name.clone(), fs::read_to_string(folder.join(name)).expect("a file"))).collect();
    found.sort();
    found
}

fn is(files: &[(&str, &str)]) -> Vec<(String, String)> {
    files.iter().map(|(name, text)| ((*name).to_owned(), (*text).to_owned())).collect()
}

fn record(folder: &Path) -> OutputRecord {
    OutputRecord::parse(&fs::read(folder.join(RECORD_FILE)).expect("a record")).expect("readable")
}

/// An old program beside a new plan was the way to a wrong one.
#[test]
fn a_run_replaces_what_an_earlier_one_wrote_and_leaves_the_users_files() {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("notes.txt"), "mine").expect("a file");
    let first = [("plan.json", "1"), ("program.json", "of 1"), ("regions.csv", "of 1")];
    write(folder.path(), OutputWriter::Plan, &first, &plan_of("aa")).expect("written");
    assert_eq!(record(folder.path()).files.iter().map(|file| &*file.name).collect::<Vec<_>>(), first.map(|(name, _)| name));
    assert!(record(folder.path()).files.iter().all(|file| file.plan_sha256.as_deref() == Some("aa")));
    write(folder.path(), OutputWriter::Program, &[("vantage.script", "of 1")], &plan_of("aa")).expect("written");
    write(folder.path(), OutputWriter::Study("weights"), &[("weights.csv", "w")], &FileOrigin::default()).expect("written");
    write(folder.path(), OutputWriter::Plan, &[("plan.json", "2")], &plan_of("bb")).expect("written");
    let left = [("notes.txt", "mine"), ("plan.json", "2"), ("weights.csv", "w")];
    assert_eq!(found(folder.path()), is(&left));
    assert!(record(folder.path()).complete && record(folder.path()).files.len() == 2);
    write(folder.path(), OutputWriter::Plan, &[], &FileOrigin::default()).expect("removed");
    write(folder.path(), OutputWriter::Study("weights"), &[], &FileOrigin::default()).expect("removed");
    assert_eq!(found(folder.path()), is(&[("notes.txt", "mine")]));
    assert!(!folder.path().join(RECORD_FILE).exists(), "nothing is left to record");
}

#[test]
fn a_plan_that_was_not_completed_stays_so_until_it_is_replaced() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), OutputWriter::Plan, &[("plan.json", "1"), ("program.json", "of 1")], &plan_of("aa")).expect("written");
    let half = OutputRecord { complete: false, ..record(folder.path()) };
    fs::write(folder.path().join(RECORD_FILE), half.to_bytes()).expect("a record");
    write(folder.path(), OutputWriter::Study("weights"), &[("weights.csv", "w")], &FileOrigin::default()).expect("written");
    assert!(check_complete(folder.path()).is_err());
    write(folder.path(), OutputWriter::Plan, &[("plan.json", "2")], &plan_of("bb")).expect("written");
    check_complete(folder.path()).expect("complete");
}

#[test]
fn a_record_that_names_a_file_elsewhere_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    fs::create_dir(&out).expect("a folder");
    fs::write(folder.path().join("mine.txt"), "mine").expect("a file");
    for name in ["../mine.txt", "/etc/hostname", "a/b", ".."] {
        let (name, written_by) = (name.to_owned(), OutputWriter::Plan.name());
        let file = RecordedFile { name, sha256: sha256(b"mine"), written_by, plan_sha256: None, made_from: None };
        fs::write(out.join(RECORD_FILE), OutputRecord::new(vec![file], true).to_bytes()).expect("a record");
        let error = write(&out, OutputWriter::Plan, &[("plan.json", "2")], &plan_of("bb")).expect_err("not a record");
        assert!(error.to_string().contains("is not a record"), "{error}");
    }
    assert!(folder.path().join("mine.txt").exists());
}

#[test]
fn a_program_beside_the_plan_of_a_release_without_records_goes_with_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let plan = format!("{{\"schema\": \"{PLAN_SCHEMA}\"}}");
    fs::write(folder.path().join("plan.json"), &plan).expect("a file");
    fs::write(folder.path().join("vantage.script"), "# Vantage scan program").expect("a file");
    fs::write(folder.path().join("vantage.src"), "mine").expect("a file");
    let error = write(folder.path(), OutputWriter::Program, &[("scan.cps", "p")], &plan_of("bb")).expect_err("of another plan");
    assert!(error.to_string().contains("another plan"), "{error}");
    write(folder.path(), OutputWriter::Plan, &[("plan.json", "2")], &plan_of("bb")).expect("written");
    assert_eq!(found(folder.path()), is(&[("plan.json", "2"), ("vantage.src", "mine")]));
}

#[test]
fn files_of_the_user_are_neither_replaced_nor_removed() {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("report.txt"), "mine").expect("a file");
    let refused = OutputFolder::prepare(folder.path(), OutputWriter::Plan, &["report.txt"]).expect_err("mine");
    assert!(refused.exit_code() == 2 && refused.to_string().contains("report.txt (not written by Vantage)"), "{refused}");
    let files = [("plan.json", "1"), ("vantage.script", "turn the table here")];
    write(folder.path(), OutputWriter::Plan, &files, &plan_of("aa")).expect("report.txt is not in the way of these");
    fs::write(folder.path().join("vantage.script"), "turned by my own lines").expect("edited");
    let before = found(folder.path());
    let refused = write(folder.path(), OutputWriter::Plan, &[("plan.json", "2")], &plan_of("bb")).expect_err("edited");
    assert!(refused.to_string().contains("vantage.script (changed since Vantage wrote it)"), "{refused}");
    let late =
        write(folder.path(), OutputWriter::Study("reach"), &[("report.txt", "2")], &FileOrigin::default()).expect_err("mine");
    assert_eq!((late.exit_code(), found(folder.path())), (2, before), "nothing has changed");
    fs::write(folder.path().join(RECORD_FILE), "{\"mine\": true}").expect("a file");
    let refused = OutputFolder::prepare(folder.path(), OutputWriter::Plan, &[]).expect_err("no record");
    assert!(refused.to_string().contains("vantage.json is not a record"), "{refused}");
}

#[test]
fn a_run_that_fails_leaves_the_earlier_files_as_they_were() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), OutputWriter::Plan, &[("plan.json", "1"), ("program.json", "of 1")], &plan_of("aa")).expect("written");
    let before = (found(folder.path()), record(folder.path()));
    let broken = [("plan.json", "2"), ("nowhere/program.json", "cannot be written")];
    let error = write(folder.path(), OutputWriter::Plan, &broken, &plan_of("bb")).expect_err("no such folder");
    assert_eq!(error.exit_code(), 1, "{error}");
    assert_eq!((found(folder.path()), record(folder.path())), before);
}

/// The command took the old files away, and said "No such file or directory".
#[test]
fn two_files_of_one_name_are_refused_before_anything_changes() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), OutputWriter::Plan, &[("plan.json", "1"), ("program.csv", "of 1")], &plan_of("aa")).expect("written");
    let before = (found(folder.path()), record(folder.path()));
    for twice in [[("program.csv", "1"), ("program.csv", "2")], [("Scan.csv", "1"), ("scan.csv", "2")]] {
        let refused = write(folder.path(), OutputWriter::Program, &twice, &plan_of("aa")).expect_err("one name");
        assert!(refused.to_string().contains("would be written twice"), "{refused}");
        assert_eq!((found(folder.path()), record(folder.path())), before);
    }
}

/// A kill between two renames.
#[test]
fn a_folder_that_was_left_half_written_is_refused_and_the_next_run_makes_it_whole() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    write(folder.path(), OutputWriter::Plan, &[("plan.json", "1"), ("program.json", "of 1")], &plan_of("aa")).expect("written");
    assert_eq!(check_complete(folder.path()), Ok(()));
    let mut half = record(folder.path());
    half.complete = false;
    half.files.push(RecordedFile { sha256: sha256(b"2"), plan_sha256: Some("bb".into()), ..half.files[0].clone() });
    fs::write(at(RECORD_FILE), half.to_bytes()).expect("a record");
    fs::write(at("plan.json"), "2").expect("a file");
    fs::create_dir(at(STAGING)).expect("a folder");
    fs::write(at(STAGING).join("program.json"), "of 2").expect("a file");
    let refused = check_complete(folder.path()).expect_err("half");
    assert!(refused.exit_code() == 2 && refused.to_string().contains("plan again"), "{refused}");
    write(folder.path(), OutputWriter::Plan, &[("plan.json", "3")], &plan_of("cc")).expect("written");
    assert_eq!((found(folder.path()), check_complete(folder.path())), (is(&[("plan.json", "3")]), Ok(())));
    fs::remove_file(at("plan.json")).expect("there");
    assert!(check_complete(folder.path()).expect_err("gone").to_string().contains("plan.json is gone"));
}

/// The error told nothing but what the system said.
#[test]
fn who_cannot_write_is_told_what_to_do_next() {
    let elsewhere = "name a place where you may write, such as one in your home folder";
    if cfg!(target_os = "linux") {
        let told = OutputFolder::prepare(Path::new("/proc/nowhere"), OutputWriter::Plan, &[]).expect_err("the system's own");
        assert_eq!(told.exit_code(), 1);
        let told = told.to_string();
        assert!(told.starts_with("--out /proc/nowhere: cannot be written: ") && told.ends_with(elsewhere), "{told}");
        let told = write_file(Path::new("/proc/nowhere"), b"").expect_err("the system's own").to_string();
        assert!(told.ends_with(elsewhere), "{told}");
    }
    for full in [ErrorKind::StorageFull, ErrorKind::QuotaExceeded] {
        let told = refused(Path::new("plans"), &full.into()).to_string();
        assert!(told.ends_with("\n  → free space on its disk, or name a place on another disk"), "{told}");
    }
}

#[test]
fn two_runs_do_not_write_to_one_folder() {
    let folder = tempfile::tempdir().expect("a folder");
    let first = OutputFolder::prepare(folder.path(), OutputWriter::Plan, &[]).expect("free");
    if cfg!(unix) {
        let refused = OutputFolder::prepare(folder.path(), OutputWriter::Plan, &[]).expect_err("taken");
        assert!(refused.exit_code() == 2 && refused.to_string().contains("another vantage command is writing"), "{refused}");
    }
    drop(first);
    assert!(OutputFolder::prepare(folder.path(), OutputWriter::Plan, &[]).is_ok());
    assert_eq!(found(folder.path()), is(&[]), "the trial leaves nothing");
}

#[test]
fn a_folder_of_a_release_without_records_can_be_used_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let plan = format!("{{\"schema\": \"{PLAN_SCHEMA}\", \"viewpoints\": []}}");
    for (name, text) in [("plan.json", &*plan), ("program.json", "of 1"), ("program.mod", "of 1"), ("program.csv", "of 1")] {
        fs::write(folder.path().join(name), text).expect("a file");
    }
    fs::write(folder.path().join("program.txt"), "mine").expect("a file");
    write(folder.path(), OutputWriter::Plan, &[("plan.json", "2")], &plan_of("bb")).expect("written");
    assert_eq!(found(folder.path()), is(&[("plan.json", "2"), ("program.txt", "mine")]));

    let other = tempfile::tempdir().expect("a folder");
    fs::write(other.path().join("plan.json"), "{\"schema\": \"floor\"}").expect("a file");
    let refused = OutputFolder::prepare(other.path(), OutputWriter::Plan, &FILES_OF_EVERY_PLAN).expect_err("another's plan");
    assert!(refused.to_string().contains("plan.json (not written by Vantage)"), "{refused}");

    let programs = tempfile::tempdir().expect("a folder");
    fs::write(programs.path().join("vantage.script"), "# Vantage scan program. File name: vantage.script").expect("a file");
    fs::write(programs.path().join("own.script"), "# my own").expect("a file");
    write(programs.path(), OutputWriter::Program, &[("vantage.script", "2")], &plan_of("bb")).expect("an earlier program");
    assert!(write(programs.path(), OutputWriter::Program, &[("own.script", "2")], &plan_of("bb")).is_err());
}

#[test]
fn programs_of_the_same_place_and_an_earlier_plan_go() {
    let folder = tempfile::tempdir().expect("a folder");
    let from = |place: &str, sha256: &str| FileOrigin { made_from: Some(place.to_owned()), ..plan_of(sha256) };
    write(folder.path(), OutputWriter::Program, &[("a.script", "1")], &from("plans/a", "aa")).expect("written");
    write(folder.path(), OutputWriter::Program, &[("a.csv", "1")], &from("plans/a", "aa")).expect("another dialect of it");
    write(folder.path(), OutputWriter::Program, &[("b.script", "1")], &from("plans/b", "bb")).expect("another part's");
    write(folder.path(), OutputWriter::Program, &[("a.mod", "2")], &from("plans/a", "a2")).expect("a new plan");
    assert_eq!(found(folder.path()), is(&[("a.mod", "2"), ("b.script", "1")]));
}

#[test]
fn a_program_does_not_go_beside_the_results_of_another_plan() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), OutputWriter::Plan, &[("plan.json", "1"), ("program.csv", "1")], &plan_of("aa")).expect("written");
    let refused = write(folder.path(), OutputWriter::Program, &[("vantage.mod", "2")], &plan_of("bb")).expect_err("another plan");
    assert!(refused.to_string().contains("the results of another plan"), "{refused}");
    write(folder.path(), OutputWriter::Program, &[("program.csv", "again")], &plan_of("aa")).expect("its own");
    assert_eq!(found(folder.path()), is(&[("plan.json", "1"), ("program.csv", "again")]));
}

#[test]
fn a_run_that_writes_nothing_leaves_no_folder_that_it_made() {
    let folder = tempfile::tempdir().expect("a folder");
    let (outer, inner) = (folder.path().join("plans"), folder.path().join("plans/lid"));
    drop(OutputFolder::prepare(&inner, OutputWriter::Plan, &[]).expect("made"));
    assert!(!inner.exists() && !outer.exists() && folder.path().exists());
    fs::create_dir_all(&inner).expect("the user's");
    drop(OutputFolder::prepare(&inner, OutputWriter::Plan, &[]).expect("there"));
    assert!(inner.exists(), "the user made it");
    fs::remove_dir(&inner).expect("empty");
    write(&inner, OutputWriter::Plan, &[("plan.json", "1")], &plan_of("aa")).expect("written");
    assert!(inner.join("plan.json").is_file(), "what is written stays");
}

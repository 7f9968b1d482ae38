use std::fmt::Write as _;

use super::*;
use crate::settings::layers::keys;
use crate::settings::tests::{load, refusal};
use crate::settings::{Flags, SettingsError};

/// File of settings with the values that `value` gives, and the keys of these.
fn file_of(value: impl Fn(Kind) -> Option<String>) -> (Vec<&'static str>, String) {
    let (mut keys, mut text, mut last) = (Vec::new(), String::new(), "");
    for &(key, kind) in SETTINGS {
        let (section, name) = key.split_once('.').expect("a section");
        let Some(value) = value(kind) else { continue };
        if section != last {
            writeln!(text, "[{section}]").expect("written");
            last = section;
        }
        writeln!(text, "{name} = {value}").expect("written");
        keys.push(key);
    }
    (keys, text)
}

fn variable(key: &str) -> String {
    format!("VANTAGE_{}", key.replace('.', "__").to_uppercase())
}

fn load_variables(variables: &[(String, String)]) -> Result<Settings, SettingsError> {
    let environment: Vec<(&str, &str)> = variables.iter().map(|(name, value)| (name.as_str(), value.as_str())).collect();
    load(None, &environment, &Flags::new())
}

/// Values in a file that a setting of this kind does not take.
fn wrong_in_file(kind: Kind) -> &'static [&'static str] {
    match kind {
        Kind::Switch => &["1", "0", "\"true\"", "1.0", "\"yes\"", "[true]"],
        Kind::Integer(_) => &[
            "true",
            "1.5",
            "1.0",
            "-1",
            "\"1\"",
            "2024-01-01",
            "{ x = 1 }",
            "[1]",
            "inf",
            "99999999999999999999",
            "0xffffffffffffffffffff",
            "10000000000000000000000000000000000000000",
        ],
        Kind::Number(_) => &["true", "\"1\"", "-1", "inf", "nan", "1e999", "2024-01-01", "{ x = 1.0 }", "[1.0]"],
        Kind::Text | Kind::Secret | Kind::Address => &["1", "true", "1.5", "2024-01-01", "[\"a\"]", "{ x = \"a\" }"],
        Kind::List => &["\"a\"", "1", "true", "[1]", "[\"a\", true]", "2024-01-01"],
    }
}

/// Values in the environment that a setting of this kind does not take.
fn wrong_in_environment(kind: Kind) -> &'static [&'static str] {
    match kind {
        Kind::Switch => &["1", "0", "yes", "on", "TRUE", "", " true"],
        Kind::Integer(_) => {
            &["true", "1.5", "1.0", "-1", "+1", "", " 1", "1_000", "0x10", "1e3", "4GiB", "7 days", "99999999999999999999"]
        }
        Kind::Number(_) => &["true", "yes", "", "inf", "NaN", "1e999", "5 s", "5s", "-1", "1,5"],
        Kind::Address => &["", "nowhere", "127.0.0.1", "8080"],
        Kind::Text | Kind::Secret | Kind::List => &[],
    }
}

#[test]
fn the_table_has_the_settings_of_the_defaults_and_no_others() {
    let documented: Vec<String> = keys().map(|(section, key)| format!("{section}.{key}")).collect();
    assert_eq!(SETTINGS.iter().map(|(key, _)| *key).collect::<Vec<_>>(), documented);
}

/// Comments of the defaults are where an operator reads the ranges.
#[test]
fn the_comments_of_the_defaults_tell_the_ranges() {
    let lines: Vec<&str> = crate::settings::DEFAULTS.lines().collect();
    for &(key, kind) in SETTINGS {
        let Some(bounds) = kind.bounds() else { continue };
        let start = format!("{} = ", key.split_once('.').expect("a section").1);
        let at = lines.iter().position(|line| line.starts_with(&start)).expect(key);
        // A comment may stand above several keys.
        let above = lines[..at].iter().rev().skip_while(|line| !line.starts_with('#')).take_while(|line| line.starts_with('#'));
        let words: Vec<&str> = above.flat_map(|line| line.split(|c: char| !c.is_ascii_digit() && c != '.')).collect();
        let tells = |number: f64| words.iter().any(|word| word.trim_end_matches('.') == number.to_string());
        let low = if bounds.zero.is_empty() { tells(bounds.low) } else { tells(0.0) };
        assert!(low && (bounds.high.is_infinite() || tells(bounds.high)), "{key}");
    }
}

#[test]
fn a_value_of_another_kind_in_a_file_is_refused_with_setting_file_value_and_what_is_allowed() {
    for i in 0..12 {
        let (keys, text) = file_of(|kind| wrong_in_file(kind).get(i).map(|value| (*value).to_owned()));
        let told = refusal(Some(&text), &[], &Flags::new());
        assert_eq!(told.lines().count(), keys.len(), "{told}");
        for key in keys {
            let line = told.lines().find(|line| line.starts_with(&format!("{key} ("))).expect(key);
            assert!(line.contains("vantage.toml): is ") && line.contains("; allowed is "), "{line}");
        }
    }
}

#[test]
fn a_value_of_another_kind_in_the_environment_is_refused_with_its_variable() {
    for i in 0..13 {
        let wrong = |kind: Kind| wrong_in_environment(kind).get(i).copied();
        let wrong: Vec<(&str, &str)> = SETTINGS.iter().filter_map(|(key, kind)| Some((*key, wrong(*kind)?))).collect();
        let variables: Vec<(String, String)> = wrong.iter().map(|(key, value)| (variable(key), (*value).to_owned())).collect();
        let told = load_variables(&variables).expect_err("it is refused").to_string();
        assert_eq!(told.lines().count(), wrong.len(), "{told}");
        for (key, value) in wrong {
            let line = told.lines().find(|line| line.starts_with(&format!("{key} ("))).expect(key);
            // A number out of range is told as a number.
            let is_told = value == "-1" || line.contains(&format!("is {value:?}; "));
            assert!(line.starts_with(&format!("{key} ({} in the environment): is ", variable(key))) && is_told, "{line}");
            assert!(line.contains("allowed is "), "{line}");
            assert_eq!(line.ends_with("; use a point as decimal separator"), value == "1,5", "{line}");
        }
    }
}

/// Runs would be deleted after a day.
#[test]
fn true_is_no_number_of_days() {
    let allowed = "allowed is 0 (never), or a whole number from 1 to 36500 days";
    for (value, said) in [
        ("true", format!("is true; {allowed}")),
        ("1.5", format!("is 1.5; {allowed}")),
        ("-1", format!("is -1; {allowed}")),
        ("36501", format!("is 36501; {allowed}")),
        ("5000000000", format!("is 5000000000; {allowed}")),
        ("99999999999999999999", format!("is 99999999999999999999; {allowed}")),
        ("2024-01-01", format!("is a date or a time; {allowed}")),
        ("[1]", format!("is [1]; {allowed}")),
        ("{}", format!("is a table; {allowed}")),
        ("\"1\"", format!("is \"1\"; {allowed}; write it without quotes")),
    ] {
        let told = refusal(Some(&format!("[retention]\nrun_days = {value}\n")), &[], &Flags::new());
        assert!(told.starts_with("retention.run_days (") && told.ends_with(&format!("vantage.toml): {said}")), "{told}");
    }
    let told = refusal(None, &[("VANTAGE_RETENTION__RUN_DAYS", "true")], &Flags::new());
    assert_eq!(told, format!("retention.run_days (VANTAGE_RETENTION__RUN_DAYS in the environment): is \"true\"; {allowed}"));
    let told = refusal(None, &[("VANTAGE_RETENTION__RUN_DAYS", "36501")], &Flags::new());
    assert_eq!(told, format!("retention.run_days (VANTAGE_RETENTION__RUN_DAYS in the environment): is 36501; {allowed}"));
    for value in ["30", "3_0", "0x1e"] {
        let text = format!("[retention]\nrun_days = {value}\n");
        assert_eq!(load(Some(&text), &[], &Flags::new()).expect("days").retention.run_days, 30);
    }
    let days = load(None, &[("VANTAGE_RETENTION__RUN_DAYS", "030")], &Flags::new()).expect("days");
    assert_eq!(days.retention.run_days, 30);
}

#[test]
fn all_bounds_are_allowed_and_the_numbers_beyond_are_not() {
    let low = |bounds: Bounds| bounds.low;
    let high = |bounds: Bounds| bounds.high.min(1e18);
    for bound in [low as fn(Bounds) -> f64, high] {
        let (keys, text) = file_of(|kind| Some(bound(kind.bounds()?).to_string()));
        load(Some(&text), &[], &Flags::new()).expect("bounds are allowed");
        let variables: Vec<(String, String)> =
            SETTINGS.iter().filter_map(|(key, kind)| Some((variable(key), bound(kind.bounds()?).to_string()))).collect();
        assert_eq!(keys.len(), variables.len());
        load_variables(&variables).expect("bounds are allowed");
    }
    let (_, text) = file_of(|kind| kind.bounds().filter(|bounds| !bounds.zero.is_empty()).map(|_| "0".to_owned()));
    load(Some(&text), &[], &Flags::new()).expect("0 is allowed where it has a meaning");
    for step in [-1.0, 1.0] {
        let beyond = |bounds: Bounds| if step < 0.0 { bounds.low + step } else { bounds.high + step };
        let refused = |bounds: &Bounds| beyond(*bounds).is_finite() && !bounds.allows(beyond(*bounds));
        let (keys, text) = file_of(|kind| Some(beyond(kind.bounds().filter(refused)?).to_string()));
        let told = refusal(Some(&text), &[], &Flags::new());
        for key in keys {
            assert!(
                told.lines().any(|line| line.starts_with(&format!("{key} (")) && line.contains("allowed is ")),
                "{key}: {told}"
            );
        }
    }
}

#[test]
fn a_number_may_be_written_as_a_whole_one_and_keeps_its_fraction() {
    let secs = |text: &str| load(None, &[("VANTAGE_SERVER__DRAIN_TIMEOUT_SECS", text)], &Flags::new()).expect(text);
    assert!((secs("2").server.drain_timeout_secs - 2.0).abs() < 1e-12);
    assert!((secs("2.5e-1").server.drain_timeout_secs - 0.25).abs() < 1e-12);
    let file = load(Some("[server]\ndrain_timeout_secs = 3\n"), &[], &Flags::new()).expect("seconds");
    assert!((file.server.drain_timeout_secs - 3.0).abs() < 1e-12);
    let told = refusal(Some("[store]\nmin_free_share = 90\n"), &[], &Flags::new());
    assert!(told.ends_with("vantage.toml): is 90; allowed is 0 to 0.9; 90 % is 0.9"), "{told}");
    let told = refusal(Some("[limits]\njob_secs = 0.5\n"), &[], &Flags::new());
    assert!(told.ends_with("): is 0.5 s; allowed is 0 (no limit), or a number from 1 to 604800 s"), "{told}");
}

#[test]
fn a_key_that_is_no_string_is_refused_without_it() {
    let told = refusal(Some("[server]\napi_key = 1234567890123456\n"), &[], &Flags::new());
    assert!(
        told.starts_with("server.api_key (") && told.ends_with("): is of the wrong kind; allowed is a string, in quotes"),
        "{told}"
    );
    let told = refusal(Some("[server]\napi_key = [\"0012345678901234\"]\n"), &[], &Flags::new());
    assert!(told.starts_with("server.api_key (") && !told.contains("0012345"), "{told}");
}

#[test]
fn empty_paths_are_refused_where_they_name_nothing() {
    let told = refusal(None, &[("VANTAGE_STORE__DATA_DIR", "")], &Flags::new());
    assert!(told.starts_with("store.data_dir (VANTAGE_STORE__DATA_DIR in the environment): is empty; "), "{told}");
    let told = refusal(Some("[execution]\ncells = [\"\"]\n"), &[], &Flags::new());
    assert!(told.starts_with("execution.cells (") && told.contains("contains an empty path"), "{told}");
    let audit = load(Some("[execution]\naudit_dir = \"\"\n"), &[], &Flags::new()).expect("the one in the store");
    assert!(audit.service().execution.audit_dir.ends_with("audit"));
}

#[test]
fn faults_of_all_kinds_are_told_together() {
    let file = "[server]\nlisen = \"x\"\n[retention]\nrun_days = true\njob_days = 40000\n[planning]\nthreads = \"two\"\n";
    let told = refusal(Some(file), &[], &Flags::new());
    let lines: Vec<&str> = told.lines().collect();
    assert_eq!(lines.len(), 4, "{told}");
    let starts = ["retention.run_days (", "planning.threads (", "retention.job_days (", "server.lisen ("];
    for (line, start) in lines.iter().zip(starts) {
        assert!(line.starts_with(start) && line.contains("vantage.toml): "), "{line}");
    }
    assert!(lines[3].ends_with("; did you mean `listen`?"), "{told}");
}

#[test]
fn a_section_that_is_none_is_refused_with_its_file() {
    for (file, start, said) in [
        ("server = 5\n", "server (", "is 5; allowed is a table, [server]"),
        ("[[server]]\n", "server (", "is [a table]; allowed is a table, [server]"),
        ("[colour]\n", "colour (", "unknown field `colour`"),
    ] {
        // A flag or a variable for one setting does not stand for the rest, among which may be a key.
        let (flag, variable) = (("server.listen", "127.0.0.1:0".to_owned()), ("VANTAGE_SERVER__INSECURE", "true"));
        for told in [refusal(Some(file), &[], &Flags::new()), refusal(Some(file), &[variable], &vec![flag])] {
            assert!(told.starts_with(start) && told.contains("vantage.toml): ") && told.contains(said), "{told}");
        }
    }
}

#[test]
fn the_alphabetically_first_unknown_key_is_told() {
    for _ in 0..4 {
        let told = refusal(Some("[planning]\nzebra = 1\nmoose = 1\napple = 1\nyak = 1\n"), &[], &Flags::new());
        assert!(told.starts_with("planning.apple (") && told.lines().count() == 1, "{told}");
    }
}

#[test]
fn variables_that_name_no_setting_or_the_same_twice_are_refused() {
    for name in
        ["VANTAGE_SERVER__HOSTS[0]", "VANTAGE_SERVER__LISTEN__PORT", "VANTAGE_SERVER__", "VANTAGE___LISTEN", "VANTAGE_A.B__C"]
    {
        let told = refusal(None, &[(name, "x")], &Flags::new());
        assert!(
            told.starts_with(&format!("{name} (the environment): is not a setting; ")) && told.contains("VANTAGE_SECTION__KEY"),
            "{told}"
        );
    }
    let told = refusal(None, &[("VANTAGE_PLANNING__THREADS", "1"), ("VANTAGE_planning__threads", "2")], &Flags::new());
    assert!(
        told.starts_with("VANTAGE_planning__threads (the environment): sets the same as VANTAGE_PLANNING__THREADS "),
        "{told}"
    );
    let low = load(None, &[("VANTAGE_planning__threads", "2")], &Flags::new()).expect("a setting");
    assert_eq!(low.planning.threads, 2);
}

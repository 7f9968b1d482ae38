use std::time::Duration;

use super::*;

pub(super) fn load(file: Option<&str>, environment: &[(&str, &str)], flags: &Flags) -> Result<Settings, SettingsError> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("vantage.toml");
    if let Some(text) = file {
        std::fs::write(&path, text).expect("a file");
    }
    let environment = environment.iter().map(|(name, value)| (name.into(), value.into()));
    Settings::from_layers(file.map(|_| path.as_path()), environment, flags)
}

#[track_caller]
pub(super) fn refusal(file: Option<&str>, environment: &[(&str, &str)], flags: &Flags) -> String {
    load(file, environment, flags).expect_err("it is refused").to_string()
}

#[test]
fn the_defaults_are_complete_and_stay_on_this_machine() {
    let settings = load(None, &[], &Vec::new()).expect("defaults");
    assert_eq!(settings.server.listen.to_string(), "127.0.0.1:8080");
    assert_eq!(settings.limits.upload_bytes, 1 << 30);
    assert_eq!(settings.service().planning_threads, 0);
    assert_eq!(settings.http().header_timeout, Duration::from_secs(10));
}

#[test]
fn each_layer_overrides_the_one_before() {
    let file = "[server]\nlisten = \"127.0.0.1:1\"\n[planning]\nthreads = 1\nmax_attempts = 4\n";
    let environment = [("VANTAGE_SERVER__LISTEN", "127.0.0.1:2"), ("VANTAGE_PLANNING__THREADS", "2"), ("VANTAGE_FAILPOINT", "x")];
    let flags = vec![("server.listen", "127.0.0.1:3".to_owned())];
    let settings = load(Some(file), &environment, &flags).expect("settings");
    assert_eq!(settings.server.listen.port(), 3);
    assert_eq!((settings.planning.threads, settings.planning.max_attempts, settings.planning.concurrent_jobs), (2, 4, 0));
}

#[test]
fn a_fault_names_key_layer_and_range() {
    let text = refusal(Some("[server]\nheader_timeout_secs = 0\n"), &[], &Vec::new());
    assert!(
        text.contains("server.header_timeout_secs") && text.contains("vantage.toml") && text.contains("0.1 to 600"),
        "{text}"
    );
    let text = refusal(None, &[("VANTAGE_PLANNING__THREADS", "many")], &Vec::new());
    assert!(text.contains("planning.threads") && text.contains("environment"), "{text}");
    let text = refusal(None, &[], &vec![("server.listen", "nowhere".to_owned())]);
    assert!(text.contains("server.listen") && text.contains("a flag"), "{text}");
    let text = refusal(Some("[server]\nlisen = \"x\"\n"), &[], &Vec::new());
    assert!(text.contains("server.lisen") && text.contains("vantage.toml"), "{text}");
    let text = refusal(Some("[colour]\n"), &[], &Vec::new());
    assert!(text.contains("colour"), "{text}");
    let text = refusal(Some("[planing]\nthreads = 2\n"), &[], &Vec::new());
    assert!(text.contains("planing") && text.contains("vantage.toml"), "{text}");
    let text = refusal(Some("[server\n"), &[], &Vec::new());
    assert!(text.contains("vantage.toml"), "{text}");
}

#[test]
fn limits_of_jobs_are_shares_of_the_machine_unless_they_are_given() {
    let service = |file: &str| load(Some(file), &[], &Vec::new()).expect("settings").service();
    let defaults = service("");
    assert_eq!((defaults.parse_limit, defaults.job_limit), (Duration::from_secs(60), Some(Duration::from_secs(3600))));
    // The limit is of all jobs together, so their number does not divide it.
    let beside = service("[planning]\nconcurrent_jobs = 2\n");
    assert_eq!((defaults.job_memory_bytes, defaults.concurrent_jobs), (beside.job_memory_bytes, 0));
    if let Some(bytes) = machine::memory_bytes() {
        assert!(defaults.job_memory_bytes + defaults.parse_memory_bytes < bytes);
        assert!((bytes / 10..bytes / 4).contains(&defaults.parse_memory_bytes));
        assert!((bytes / 2..bytes).contains(&defaults.job_memory_bytes));
    }
    let given = service("[limits]\njob_memory_bytes = 1073741824\njob_secs = 0\nparse_secs = 5\nparse_memory_bytes = 67108864\n");
    assert_eq!(given.parse_memory_bytes, 64 << 20);
    assert_eq!((given.job_memory_bytes, given.job_limit, given.parse_limit), (1 << 30, None, Duration::from_secs(5)));
    let text = refusal(
        Some("[limits]\njob_memory_bytes = 5\njob_secs = 0.5\nparse_secs = 0\nparse_memory_bytes = 67108863\n"),
        &[],
        &Vec::new(),
    );
    for key in ["limits.job_memory_bytes", "limits.job_secs", "limits.parse_secs", "limits.parse_memory_bytes"] {
        assert!(text.contains(key), "{key} is not in {text}");
    }
}

#[test]
fn all_faults_are_reported_at_once() {
    let file = "[limits]\nupload_bytes = 1\nqueued_jobs = 0\n[planning]\nconcurrent_jobs = 65\n";
    assert_eq!(refusal(Some(file), &[], &Vec::new()).lines().count(), 3);
}

/// The label `hold=yes` has the key `hold`; a hold by another key would protect no job.
#[test]
fn the_hold_label_is_a_key_that_labels_can_have() {
    let hold = |label: &str| load(None, &[("VANTAGE_RETENTION__HOLD_LABEL", label)], &Vec::new());
    for label in ["hold=yes", "=", "hold\nyes"] {
        let text = hold(label).expect_err("no job can have it").to_string();
        assert!(
            text.starts_with("retention.hold_label (") && text.contains(&format!("is {label:?}; the key of a label")),
            "{text}"
        );
    }
    assert_eq!(hold("to keep").expect("a key").retention.hold_label, "to keep");
}

#[test]
fn listening_to_other_machines_needs_a_key_or_insecure() {
    let open = ("VANTAGE_SERVER__LISTEN", "0.0.0.0:8080");
    let text = refusal(None, &[open], &Vec::new());
    assert!(text.contains("server.listen") && text.contains("api_key") && text.contains("--insecure"), "{text}");
    assert!(load(None, &[open, ("VANTAGE_SERVER__INSECURE", "true")], &Vec::new()).is_ok());
    let settings = load(None, &[open, ("VANTAGE_SERVER__API_KEY", "0012345678901234")], &Vec::new()).expect("with a key");
    // The key stays as written, though it looks like a number, and its debug form does not show it.
    assert!(settings.server.api_key.as_ref().is_some_and(|key| key.matches("0012345678901234")));
    assert!(!format!("{settings:?}").contains("0012345"));
    let text = refusal(None, &[open, ("VANTAGE_SERVER__API_KEY", "too-short")], &Vec::new());
    assert!(text.contains("server.api_key") && !text.contains("too-short"), "{text}");
}

#[test]
fn a_file_of_keys_guards_the_server_and_is_read_at_the_start() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("keys.toml");
    std::fs::write(&path, "mes = \"0012345678901234\"\n").expect("written");
    let file = path.to_str().expect("a path");
    let environment = [("VANTAGE_SERVER__LISTEN", "0.0.0.0:8080"), ("VANTAGE_SERVER__API_KEYS_FILE", file)];
    let settings = load(None, &environment, &Vec::new()).expect("guarded");
    assert!(settings.http().requires_key() && settings.http().api_key.is_none());
    std::fs::write(&path, "mes = \"short\"\n").expect("written");
    let text = refusal(None, &environment, &Vec::new());
    assert!(text.contains("server.api_keys_file") && text.contains("\"mes\"") && !text.contains("short"), "{text}");
    std::fs::remove_file(&path).expect("removed");
    let text = refusal(None, &environment, &Vec::new());
    assert!(text.contains("server.api_keys_file") && text.contains(file), "{text}");
}

#[test]
fn lists_are_lists_in_files_and_texts_with_commas_in_the_environment() {
    let file = "[server]\nhosts = [\"Planner\", \"planner.plant.example\"]\n\
                trusted_proxies = [\"10.0.0.1\", \"::1\", \"172.16.0.0/12\", \"fd00::/8\"]\n";
    let in_environment = [
        ("VANTAGE_SERVER__HOSTS", "Planner, planner.plant.example"),
        ("VANTAGE_SERVER__TRUSTED_PROXIES", "10.0.0.1,::1, 172.16.0.0/12,fd00::/8"),
    ];
    for settings in [load(Some(file), &[], &Vec::new()), load(None, &in_environment, &Vec::new())] {
        let http = settings.expect("settings").http();
        assert_eq!(http.hosts, ["planner", "planner.plant.example"]);
        assert_eq!(
            http.trusted_proxies.iter().map(ToString::to_string).collect::<Vec<_>>(),
            ["10.0.0.1", "::1", "172.16.0.0/12", "fd00::/8"]
        );
    }
    let none = load(None, &[("VANTAGE_SERVER__HOSTS", "")], &Vec::new()).expect("settings");
    assert!(none.server.hosts.is_empty());
    for host in ["http://planner", "planner:8080", "planner/", ".plant", "plant.", "a b"] {
        let text = refusal(None, &[("VANTAGE_SERVER__HOSTS", host)], &Vec::new());
        assert!(text.contains("server.hosts") && text.contains(host), "{text}");
    }
    for (proxy, reason) in [
        ("10.0.0.0/33", "has \"33\" as the length of its prefix"),
        ("10.1.2.3/8", "is not the lowest address of its network; give 10.0.0.0/8"),
        ("proxy", "is not an IP address"),
    ] {
        let text = refusal(None, &[("VANTAGE_SERVER__TRUSTED_PROXIES", proxy)], &Vec::new());
        assert!(text.contains("server.trusted_proxies") && text.contains(&format!("{proxy:?}: {reason}")), "{text}");
    }
}

#[test]
fn a_misspelled_key_is_answered_with_the_one_that_was_meant() {
    let told = refusal(Some("[server]\nlisten_on = \"127.0.0.1:0\"\n"), &[], &Flags::new());
    assert!(told.contains("did you mean `listen`?"), "{told}");
}

#[test]
fn origins_and_the_public_path_are_exact() {
    let file = "[server]\npublic_path = \"/plant/vantage\"\ncors_origins = [\"https://MES.plant.example:8443\", \"http://[::1]:3000\"]\n";
    let http = load(Some(file), &[], &Vec::new()).expect("settings").http();
    assert_eq!((http.public_path.as_str(), http.cors_origins.len()), ("/plant/vantage", 2));
    assert_eq!(http.cors_origins[0], "https://mes.plant.example:8443");
    for path in ["vantage", "/", "//x", "/a/../b", "https://x", "/a b"] {
        let text = refusal(None, &[], &vec![("server.public_path", path.to_owned())]);
        assert!(text.contains("server.public_path") && text.contains(path), "{text}");
    }
    for origin in [
        "*",
        "null",
        "mes.plant.example",
        "https://mes.plant.example/",
        "https://mes.plant.example:443",
        "http://x:80",
        "https://x:99999",
        "ftp://x",
        "https://a b",
        "https://*.x",
    ] {
        let text = refusal(None, &[("VANTAGE_SERVER__CORS_ORIGINS", origin)], &Vec::new());
        assert!(text.contains("server.cors_origins") && text.contains(origin), "{text}");
    }
}

#[cfg(unix)]
#[test]
fn variables_that_are_not_utf_8_are_refused_if_they_are_settings_and_passed_over_else() {
    use std::os::unix::ffi::OsStringExt as _;
    let bytes = || OsString::from_vec(b"\xff".to_vec());
    let strange = [("OTHER".into(), bytes()), (bytes(), "x".into()), ("VANTAGE_FAILPOINT".into(), bytes())];
    Settings::from_layers(None, strange.into_iter(), &Flags::new()).expect("none of them is a setting");
    let setting = [("VANTAGE_STORE__DATA_DIR".into(), bytes())];
    let error = Settings::from_layers(None, setting.into_iter(), &Flags::new()).expect_err("another folder");
    assert_eq!(error.to_string(), "VANTAGE_STORE__DATA_DIR (the environment): is not UTF-8; set it to a text in UTF-8");
}

/// Some said what was wrong and no more.
#[test]
fn a_value_that_is_not_allowed_is_told_with_what_to_do_next() {
    for (variable, value, told) in [
        (
            "VANTAGE_EXECUTION__HEARTBEAT_SECS",
            "14",
            "is 14 s; allowed is half of execution.lease_secs at most, 1 s: lower it, or raise execution.lease_secs",
        ),
        ("VANTAGE_EXECUTION__LIVE", "true", "; name those of the cells to run there, or set it to false"),
        ("VANTAGE_SERVER__API_KEY", "short", "; give another, such as one of `openssl rand -hex 32`"),
        ("VANTAGE_SERVER__API_KEYS_FILE", "/nowhere/keys.toml", "; name a text file that the server's user may read"),
        ("VANTAGE_RETENTION__HOLD_LABEL", "hold=yes", ": leave them out"),
        ("VANTAGE_LIMITS__JOB_SECS", "1,5", "; use a point as decimal separator"),
    ] {
        let text = refusal(None, &[(variable, value)], &Flags::new());
        assert!(text.ends_with(told), "{text}");
    }
}

/// The author of such variables would believe them set: an address, or a key.
#[test]
fn variables_with_too_few_underscores_are_answered_with_those_that_were_meant() {
    for (name, meant) in [
        ("VANTAGE_SERVER_LISTEN", "VANTAGE_SERVER__LISTEN"),
        ("VANTAGE_API_KEY", "VANTAGE_SERVER__API_KEY"),
        ("VANTAGE_SERVER_API_KEYS_FILE", "VANTAGE_SERVER__API_KEYS_FILE"),
        ("VANTAGE_HTTP2_MAX_STREAMS", "VANTAGE_SERVER__HTTP2_MAX_STREAMS"),
        ("VANTAGE_TELEMETRY_FORMAT", "VANTAGE_TELEMETRY__FORMAT"),
    ] {
        let text = refusal(None, &[(name, "0012345678901234")], &Flags::new());
        assert_eq!(text, format!("{name} (the environment): is not a setting; did you mean {meant}?"));
    }
    // Kubernetes sets these for a service of the name `vantage`.
    let strange = [("VANTAGE_SERVICE_HOST", "10.0.0.1"), ("VANTAGE_PORT", "tcp://10.0.0.1:80")];
    assert!(load(None, &strange, &Flags::new()).is_ok());
}

#[test]
fn a_file_that_is_no_toml_is_told_by_its_place_without_its_keys() {
    let text = refusal(Some("[server]\n\n  api_key = \"0012345678901234\n"), &[], &Flags::new());
    assert!(text.contains("vantage.toml: line 3, column ") && !text.contains("0012345"), "{text}");
    let folder = tempfile::tempdir().expect("a folder");
    let error = Settings::from_layers(Some(folder.path()), std::iter::empty(), &Flags::new()).expect_err("a folder");
    let error = error.to_string();
    assert!(error.starts_with("--config ") && error.ends_with(": is a folder; give a file in it"), "{error}");
    // The words were those of the operating system.
    let missing = folder.path().join("vantage.toml");
    let error = Settings::from_layers(Some(&missing), std::iter::empty(), &Flags::new()).expect_err("no such file").to_string();
    assert!(error.contains("vantage.toml: there is no such file; `vantage serve --print-defaults"), "{error}");
    std::fs::write(&missing, b"[server]\n# k\xf6nnte\n").expect("a file");
    let error = Settings::from_layers(Some(&missing), std::iter::empty(), &Flags::new()).expect_err("Latin-1").to_string();
    assert!(error.ends_with(": is not a text in UTF-8; give a TOML file"), "{error}");
}

/// `"server.insecure"` would open the server to other machines, or not, as the tables of the file are merged.
#[test]
fn a_key_in_quotes_is_refused_where_it_looks_like_a_setting() {
    for (file, key, instead) in [
        ("\"server.insecure\" = true\n", "\"server.insecure\"", "write insecure without quotes below [server]"),
        ("\"server.insecure\" = true\n[server]\ninsecure = false\n", "\"server.insecure\"", "below [server]"),
        ("[\"execution.live\"]\n", "\"execution.live\"", "write live without quotes below [execution]"),
        ("\"server[0]\" = 1\n", "\"server[0]\"", "vantage serve --print-defaults"),
        ("\"colour.red\" = 1\n", "\"colour.red\"", "vantage serve --print-defaults"),
    ] {
        let text = refusal(Some(file), &[], &Flags::new());
        assert!(text.starts_with(&format!("{key} (")) && text.contains("vantage.toml") && text.contains(instead), "{text}");
    }
    let two = refusal(Some("\"server.hosts\" = []\n\"server.api_key\" = \"0012345678901234\"\n"), &[], &Flags::new());
    let keys: Vec<_> = two.lines().filter_map(|line| line.split(' ').next()).collect();
    assert!(keys == ["\"server.api_key\"", "\"server.hosts\""] && !two.contains("0012345"), "{two}");
    // Without quotes, and with quotes around one name, it is the setting.
    for file in ["server.max_waits = 7\n", "\"server\".\"max_waits\" = 7\n", "[\"server\"]\n\"max_waits\" = 7\n"] {
        assert_eq!(load(Some(file), &[], &Flags::new()).expect("a setting").server.max_waits, 7, "{file}");
    }
    // Its layer is the file, though the name begins like that of a setting.
    let text = refusal(Some("[server]\n\"insecure.x\" = true\n"), &[], &Flags::new());
    assert!(text.starts_with("server.insecure.x (") && text.contains("vantage.toml): unknown field"), "{text}");
}

#[test]
fn a_format_of_the_log_that_is_none_is_answered_with_those_that_are() {
    let text = refusal(None, &[("VANTAGE_TELEMETRY__FORMAT", "yaml")], &Flags::new());
    assert_eq!(text, "telemetry.format (VANTAGE_TELEMETRY__FORMAT in the environment): is \"yaml\"; allowed is text or json");
    let json = load(None, &[("VANTAGE_TELEMETRY__FORMAT", "JSON")], &Flags::new()).expect("a format");
    assert_eq!(json.telemetry.format, LogFormat::Json);
}

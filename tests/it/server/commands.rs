//! The commands around the server, and what they end with.

use super::process::{Server, vantage};

fn run(arguments: &[&str]) -> (i32, String, String) {
    let output = vantage().args(arguments).output().expect("it runs");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code().expect("a code"), text(&output.stdout), text(&output.stderr))
}

#[test]
fn a_healthcheck_ends_with_zero_only_for_a_server_that_is_well() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[]);
    assert_eq!(run(&["healthcheck", "--url", &server.url("")]).0, 0);
    assert_eq!(run(&["healthcheck", "--url", &server.url("/")]).0, 0);
    let url = server.url("");
    drop(server);
    let (code, _, errors) = run(&["healthcheck", "--url", &url]);
    assert_eq!(code, 1);
    assert!(errors.contains("does not answer"), "{errors}");
    assert_eq!(run(&["healthcheck", "--url", "https://example.org"]).0, 2);
    assert_eq!(run(&["healthcheck", "--url", "http://a/b"]).0, 2);
}

#[test]
fn settings_that_cannot_be_used_end_it_with_two_and_say_which() {
    let (code, _, errors) = run(&["serve", "--listen", "0.0.0.0:0"]);
    assert_eq!(code, 2);
    assert!(errors.contains("server.listen") && errors.contains("--insecure"), "{errors}");
    let (code, _, errors) = run(&["serve", "--config", "/nowhere/vantage.toml"]);
    assert_eq!(code, 2);
    assert!(errors.contains("/nowhere/vantage.toml"), "{errors}");
    assert_eq!(run(&["serve", "--colour"]).0, 2);
}

#[test]
fn a_folder_in_use_and_an_address_in_use_end_it_with_one() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[]);
    let folder = data.path().to_str().expect("text");
    let (code, _, errors) = run(&["serve", "--listen", "127.0.0.1:0", "--data", folder]);
    assert_eq!(code, 1);
    assert!(errors.contains("in use"), "{errors}");
    let other = tempfile::tempdir().expect("a folder");
    let address = server.address.to_string();
    let (code, _, errors) = run(&["serve", "--listen", &address, "--data", other.path().to_str().expect("text")]);
    assert_eq!(code, 1);
    assert!(errors.contains(&address), "{errors}");
}

#[test]
fn help_and_completions_name_every_command() {
    let (code, help, _) = run(&["--help"]);
    assert_eq!(code, 0);
    let (_, completions, _) = run(&["completions", "bash"]);
    for command in ["serve", "demo", "plan", "healthcheck", "completions"] {
        assert!(help.contains(command) && completions.contains(command), "{command}");
        let (code, text, _) = run(&[command, "--help"]);
        assert_eq!(code, 0);
        assert!(text.contains("Example"), "{command} --help has no example");
    }
}

#[test]
fn the_key_is_asked_for_on_a_real_socket() {
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[("VANTAGE_SERVER__API_KEY", "0123456789abcdef")]);
    assert!(matches!(server.get("/api/v1/jobs"), Err(ureq::Error::StatusCode(401))));
    let answer = ureq::get(server.url("/api/v1/jobs")).header("authorization", "Bearer 0123456789abcdef").call().expect("let in");
    assert_eq!(answer.status(), 200);
    assert_eq!(run(&["healthcheck", "--url", &server.url("")]).0, 0);
}

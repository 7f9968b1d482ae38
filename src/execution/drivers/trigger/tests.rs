//! Tests of triggers against a server and programs of this process.

use serde_json::json;
use tokio::net::TcpListener;

use super::*;

fn capture(deadline_ms: u64) -> Capture {
    Capture {
        run: "r1".to_owned(),
        step: 3,
        view: 7,
        brightness: 5,
        expected: Duration::from_millis(10),
        deadline: Duration::from_millis(deadline_ms),
    }
}

async fn triggered(spec: serde_json::Value, deadline_ms: u64) -> Result<Captured, DeviceError> {
    let spec = serde_json::from_value(spec).expect("a specification");
    ScannerTrigger::new(&spec, Arc::new(())).expect("a trigger").capture(&capture(deadline_ms)).await
}

/// Answers one request; what it was.
async fn answering(answer: &'static str) -> (String, tokio::task::JoinHandle<String>) {
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let url = format!("http://{}/capture", listener.local_addr().expect("an address"));
    let asked = tokio::spawn(async move {
        let (mut stream, _) = listener.accept().await.expect("a client");
        let mut bytes = vec![0; 4096];
        let mut read = 0;
        while !String::from_utf8_lossy(&bytes[..read]).ends_with('}') {
            read += stream.read(&mut bytes[read..]).await.expect("bytes");
        }
        stream.write_all(answer.as_bytes()).await.expect("sent");
        String::from_utf8_lossy(&bytes[..read]).into_owned()
    });
    (url, asked)
}

#[tokio::test]
async fn a_request_tells_the_capture_and_2xx_acknowledges_it() {
    let (url, asked) = answering("HTTP/1.1 201 Created\r\n\r\n{\"id\": \"scan-1\"}").await;
    let captured = triggered(json!({"protocol": "http", "url": url}), 2000).await.expect("acknowledged");
    assert_eq!(captured.id.as_deref(), Some("scan-1"));
    let asked = asked.await.expect("a request");
    assert!(asked.starts_with("POST /capture HTTP/1.1\r\n") && asked.contains("\"viewpoint\":7"), "{asked}");
    for (answer, is_refused) in [("HTTP/1.1 503 Busy\r\n\r\n", true), ("nonsense\r\n", false), ("", false)] {
        let (url, _asked) = answering(answer).await;
        let error = triggered(json!({"protocol": "http", "url": url}), 2000).await.expect_err("not acknowledged");
        assert_eq!(matches!(error, DeviceError::Refused { code: 503, .. }), is_refused, "{error}");
    }
}

#[tokio::test]
async fn a_program_acknowledges_by_its_exit_code_in_time() {
    let program =
        |script: &str| json!({"protocol": "command", "program": "/bin/sh", "arguments": ["-c", script, "sh", "{view}"]});
    triggered(program("test \"$1\" = 7"), 5000).await.expect("acknowledged");
    let error = triggered(program("exit 3"), 5000).await.expect_err("refused");
    assert!(matches!(error, DeviceError::Refused { code: 3, .. }), "{error}");
    let error = triggered(program("sleep 60"), 100).await.expect_err("late");
    assert!(matches!(error, DeviceError::Silent { .. }), "{error}");
    let error = triggered(json!({"protocol": "command", "program": "/nowhere"}), 100).await.expect_err("none");
    assert!(matches!(error, DeviceError::Unreachable { .. }), "{error}");
}

#[tokio::test]
async fn without_a_trigger_the_predicted_time_is_waited_for() {
    let captured = triggered(json!({"protocol": "none"}), 1000).await.expect("taken");
    assert!(captured.took >= Duration::from_millis(10) && captured.id.is_none());
    let spec = serde_json::from_value(json!({"protocol": "digital", "output": 0, "input": 0})).expect("a specification");
    assert!(ScannerTrigger::new(&spec, Arc::new(())).is_err());
}

//! Triggers against what they trigger: the simulated controller, a small server, programs of this machine.

use std::sync::Mutex;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpListener;

use super::*;
use crate::cell::{HansSpec, Presets, SpecLibrary};
use crate::execution::protocol::hans::{HansFrames, HansReply, HansRequest};
use crate::execution::simulators::hans::HansSimulator;
use crate::execution::tests::simulated_network::{NetworkDialer, NetworkEnd, RoughNetwork};

/// Log that keeps its texts.
#[derive(Default)]
struct KeptBytes(Mutex<Vec<String>>);

impl WireLog for KeptBytes {
    fn record(&self, device: &'static str, _direction: Direction, bytes: &[u8]) {
        assert_eq!(device, DEVICE);
        self.0.lock().expect("no panic").push(String::from_utf8_lossy(bytes).into_owned());
    }
}

fn controllers(arm: &Value, trigger: &Value) -> ControllersSpec {
    let table = json!({"protocol": "with_arm"});
    serde_json::from_value(json!({"arm": arm, "table": table, "trigger": trigger})).expect("controllers")
}

fn hans_at(address: &str) -> Value {
    json!({"protocol": "hans", "address": address})
}

fn capture(deadline_ms: u64) -> Capture {
    Capture {
        run: "run-1".to_owned(),
        step: 4,
        view: 7,
        brightness: 5,
        expected: Duration::from_millis(30),
        deadline: Duration::from_millis(deadline_ms),
    }
}

async fn taken(trigger: &Value, deadline_ms: u64) -> (Result<Captured, DeviceError>, Vec<String>) {
    let log = Arc::new(KeptBytes::default());
    let controllers = controllers(&hans_at("127.0.0.1:1"), trigger);
    let mut trigger = ScannerTrigger::new(&controllers, Arc::clone(&log) as Arc<dyn WireLog>).expect("a trigger");
    trigger.set_brightness(5).await.expect("set");
    let taken = trigger.capture(&capture(deadline_ms)).await;
    let texts = log.0.lock().expect("no panic").clone();
    (taken, texts)
}

#[tokio::test]
async fn signals_are_exchanged_with_the_arms_controller() {
    let robot = Presets.robot("hans-e05").expect("a preset").build().expect("valid");
    let simulator = HansSimulator::listen("127.0.0.1:0", robot, [0.0; 6], 1.0).await.expect("bound");
    let address = simulator.addresses().expect("addresses").text.to_string();
    let server = tokio::spawn(simulator.serve());
    let digital = json!({"protocol": "digital", "output": 3, "input": 3});
    let log: Arc<dyn WireLog> = Arc::new(());
    let mut trigger = ScannerTrigger::new(&controllers(&hans_at(&address), &digital), log).expect("a trigger");
    // The second begins while the acknowledgement of the first is still on.
    for _ in 0..2 {
        let captured = trigger.capture(&capture(5_000)).await.expect("acknowledged");
        assert!(captured.took >= Duration::from_millis(400), "{captured:?}");
    }
    // Wired to another input, nothing acknowledges.
    let crossed = json!({"protocol": "digital", "output": 3, "input": 8});
    let mut trigger = ScannerTrigger::new(&controllers(&hans_at(&address), &crossed), Arc::new(())).expect("a trigger");
    let told = trigger.capture(&capture(900)).await.expect_err("nothing acknowledges").to_string();
    let wanted =
        "input 8 did not come on after output 3 within 900 ms, the exposure of 30 ms and deadline_ms = 870 ms; see whether";
    assert!(told.starts_with(wanted), "{told}");
    server.abort();
}

#[tokio::test]
async fn an_output_whose_capture_nothing_acknowledges_is_taken_back() {
    let robot = Presets.robot("hans-e05").expect("a preset").build().expect("valid");
    let simulator = HansSimulator::listen("127.0.0.1:0", robot, [0.0; 6], 1.0).await.expect("bound");
    let address = simulator.addresses().expect("addresses").text.to_string();
    let server = tokio::spawn(simulator.serve());
    let log = Arc::new(KeptBytes::default());
    let crossed = json!({"protocol": "digital", "output": 3, "input": 8});
    let kept = Arc::clone(&log) as Arc<dyn WireLog>;
    let mut trigger = ScannerTrigger::new(&controllers(&hans_at(&address), &crossed), kept).expect("a trigger");
    assert!(matches!(trigger.capture(&capture(300)).await, Err(DeviceError::Unacknowledged { .. })));
    let texts = log.0.lock().expect("no panic").clone();
    let levels: Vec<&String> = texts.iter().filter(|text| text.starts_with("SetBoxDO,3,")).collect();
    assert_eq!(levels, ["SetBoxDO,3,0,;", "SetBoxDO,3,1,;", "SetBoxDO,3,0,;"], "{texts:?}");
    server.abort();
}

#[tokio::test]
async fn an_output_whose_capture_is_given_up_is_taken_back_by_a_withdrawal_once() {
    let robot = Presets.robot("hans-e05").expect("a preset").build().expect("valid");
    let simulator = HansSimulator::listen("127.0.0.1:0", robot, [0.0; 6], 1.0).await.expect("bound");
    let address = simulator.addresses().expect("addresses").text.to_string();
    let server = tokio::spawn(simulator.serve());
    let log = Arc::new(KeptBytes::default());
    let levels = || {
        let texts = log.0.lock().expect("no panic");
        texts.iter().filter(|text| text.starts_with("SetBoxDO,3,")).cloned().collect::<Vec<_>>()
    };
    let crossed = json!({"protocol": "digital", "output": 3, "input": 8});
    let kept = Arc::clone(&log) as Arc<dyn WireLog>;
    let mut trigger = ScannerTrigger::new(&controllers(&hans_at(&address), &crossed), kept).expect("a trigger");
    trigger.withdraw().await;
    assert!(levels().is_empty(), "nothing was left on");
    let is_on = async {
        while levels().len() < 2 {
            sleep(Duration::from_millis(1)).await;
        }
    };
    let asked_for = capture(60_000);
    tokio::select! {
        captured = trigger.capture(&asked_for) => panic!("{captured:?}"),
        () = is_on => {}
    }
    for _ in 0..2 {
        trigger.withdraw().await;
        assert_eq!(levels(), ["SetBoxDO,3,0,;", "SetBoxDO,3,1,;", "SetBoxDO,3,0,;"]);
    }
    server.abort();
}

/// Answers as a control box whose inputs have a level; where they have none, it answers nothing to those who read them.
async fn control_box(mut end: NetworkEnd, level: Option<&'static str>) {
    let (mut frames, mut bytes) = (HansFrames::default(), Vec::new());
    while end.read_buf(&mut bytes).await.is_ok_and(|read| read > 0) {
        frames.push(&bytes);
        bytes.clear();
        while let Some(message) = frames.next_message() {
            let request = HansRequest::parse(&message.expect("a message")).expect("a request");
            let is_read = matches!(request, HansRequest::ReadBoxDi { .. });
            let values = if is_read { level.map(|level| vec![level.to_owned()]) } else { Some(Vec::new()) };
            if let Some(values) = values {
                end.write_all(HansReply::done(request.name(), values).encode().as_bytes()).await.expect("taken");
            }
        }
    }
}

#[tokio::test(start_paused = true)]
async fn an_input_is_told_to_be_on_only_where_it_was_read_as_such() {
    for level in [Some("1"), None] {
        let network = RoughNetwork::new(1, move |end| {
            tokio::spawn(control_box(end, level));
        });
        let wiring = Wiring { dialer: Arc::new(NetworkDialer(network)), log: Arc::new(()), device: DEVICE };
        let spec: HansSpec =
            serde_json::from_value(json!({"address": "box:10003", "reply_timeout_ms": 1_000})).expect("a specification");
        let digital = DigitalTriggerSpec { output: 3, input: 4, deadline_ms: 10_000 };
        let mut trigger = ScannerTrigger::Digital(digital, Box::new(HansSignals::new(spec, wiring)));
        let captured = trigger.capture(&capture(10_000)).await;
        let is_told = match (level, &captured) {
            (Some(_), Err(DeviceError::NotReady { reason })) => reason.contains("input 4 ") && reason.contains("for 500 ms"),
            (None, Err(DeviceError::Silent { .. })) => true,
            _ => false,
        };
        assert!(is_told, "{level:?}: {captured:?}");
    }
}

#[test]
fn signals_of_arms_without_them_are_refused() {
    let arm = json!({"protocol": "fanuc_rmi", "address": "127.0.0.1:16001"});
    let digital = json!({"protocol": "digital", "output": 3, "input": 3});
    let refused = ScannerTrigger::new(&controllers(&arm, &digital), Arc::new(())).expect_err("refused");
    assert!(refused.contains("fanuc_rmi") && refused.contains("http"), "{refused}");
}

async fn server(answer: &'static str) -> (String, tokio::task::JoinHandle<String>) {
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("bound");
    let address = listener.local_addr().expect("an address");
    let asked = tokio::spawn(async move {
        let (mut stream, _) = listener.accept().await.expect("a client");
        let mut bytes = vec![0; 4096];
        let mut read = 0;
        while !String::from_utf8_lossy(&bytes[..read]).contains('}') {
            read += stream.read(&mut bytes[read..]).await.expect("bytes");
        }
        stream.write_all(answer.as_bytes()).await.expect("sent");
        String::from_utf8_lossy(&bytes[..read]).into_owned()
    });
    (format!("http://{address}/scans?cell=1"), asked)
}

#[tokio::test]
async fn a_request_says_what_is_captured() {
    let (url, asked) = server("HTTP/1.1 201 Created\r\ncontent-length: 14\r\n\r\n{\"id\": \"s-19\"}").await;
    let (taken, log) = taken(&json!({"protocol": "http", "url": url}), 3_000).await;
    assert_eq!(taken.expect("acknowledged").id.as_deref(), Some("s-19"));
    let asked = asked.await.expect("asked");
    assert!(asked.starts_with("POST /scans?cell=1 HTTP/1.1\r\n"), "{asked}");
    assert!(
        asked.contains(r#""run":"run-1""#) && asked.contains(r#""view":7"#) && asked.contains(r#""brightness":5"#),
        "{asked}"
    );
    assert!(log.iter().any(|text| text.contains("s-19")), "{log:?}");
}

#[tokio::test]
async fn a_refusal_a_silence_and_nobody_are_errors() {
    let (url, _asked) = server("HTTP/1.1 503 Busy\r\ncontent-length: 4\r\n\r\nbusy").await;
    let (refused, _) = taken(&json!({"protocol": "http", "url": url}), 3_000).await;
    assert!(matches!(&refused, Err(DeviceError::Refused { code: 503, text }) if text == "busy"), "{refused:?}");
    let (url, _asked) = server("HTTP/1.1 200 OK\r\ncontent-length: 400\r\n\r\n").await;
    let (silent, _) = taken(&json!({"protocol": "http", "url": url}), 300).await;
    assert!(matches!(silent, Err(DeviceError::Unacknowledged { .. } | DeviceError::Closed { .. })), "{silent:?}");
    // Its connection is taken, and nobody reads.
    let port = TcpListener::bind("127.0.0.1:0").await.expect("bound");
    let url = format!("http://{}/scans", port.local_addr().expect("an address"));
    let (silent, _) = taken(&json!({"protocol": "http", "url": url}), 200).await;
    let told = silent.expect_err("no answer").to_string();
    let wanted = format!("{url} did not answer within 200 ms, the exposure of 30 ms and deadline_ms = 170 ms; see whether");
    assert!(told.starts_with(&wanted), "{told}");
    let (nobody, _) = taken(&json!({"protocol": "http", "url": "http://127.0.0.1:1/", "deadline_ms": 100}), 3_000).await;
    assert!(matches!(nobody, Err(DeviceError::Unreachable { .. })), "{nobody:?}");
}

#[tokio::test]
async fn a_program_acknowledges_by_its_end() {
    let program = |program: &str, arguments: &[&str]| json!({"protocol": "command", "program": program, "arguments": arguments});
    let (done, log) = taken(&program("/bin/true", &["{run}", "v{view}"]), 3_000).await;
    assert_eq!(done.expect("acknowledged").id, None);
    assert!(log[0].ends_with("run-1 v7"), "{log:?}");
    let (failed, _) = taken(&program("/bin/false", &[]), 3_000).await;
    assert!(matches!(failed, Err(DeviceError::Refused { code: 1, .. })), "{failed:?}");
    let (missing, _) = taken(&program("/nowhere/trigger", &[]), 3_000).await;
    let is_told = |reason: &str| reason.starts_with("the program /nowhere/trigger cannot be started") && reason.contains("path");
    assert!(matches!(&missing, Err(DeviceError::NotReady { reason }) if is_told(reason)), "{missing:?}");
    let (late, _) = taken(&program("/bin/sleep", &["5"]), 200).await;
    let told = late.expect_err("it does not end").to_string();
    assert!(told.starts_with("the program /bin/sleep did not end within 200 ms, the exposure of 30 ms and"), "{told}");
}

#[tokio::test]
async fn without_a_trigger_the_predicted_time_is_waited_out() {
    let (waited, log) = taken(&json!({"protocol": "none"}), 3_000).await;
    assert!(waited.expect("waited").took >= Duration::from_millis(30) && log.is_empty());
}

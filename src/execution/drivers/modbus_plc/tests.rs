//! The driver against a PLC of some lines: it goes to its target at once, or stays while it is told to stop.

use std::sync::{Arc, Mutex};

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpListener;
use tokio::time::timeout;

use super::*;
use crate::cell::WordOrder;
use crate::execution::device::STOP_ATTEMPT;
use crate::execution::drivers::stream::ByteStream;
use crate::execution::protocol::modbus::{ModbusAdu, ModbusReply, ModbusSide, values_of};
use crate::execution::tests::simulated_network::{NetworkDialer, Passage, RoughNetwork};

/// Registers of the PLC: target 10, speed 12, command 14, state 15, position 16, fault 18, heartbeat 19.
type Registers = Arc<Mutex<[u16; 20]>>;

async fn serve(listener: TcpListener, registers: Registers) {
    while let Ok((stream, _)) = listener.accept().await {
        talk(stream, &registers).await;
    }
}

/// Answers one client until it goes.
async fn talk(mut stream: impl ByteStream, registers: &Registers) {
    let (mut held, mut chunk) = (Vec::new(), [0; 512]);
    while let Ok(read @ 1..) = stream.read(&mut chunk).await {
        held.extend_from_slice(&chunk[..read]);
        while let Ok(Some(adu)) = ModbusAdu::take(&mut held, ModbusFraming::Tcp, ModbusSide::Server) {
            let request = ModbusRequest::parse(&adu.pdu).expect("a request");
            let pdu = request.reply_pdu(&answer(&request, &mut registers.lock().expect("registers")));
            let _ = stream.write_all(&ModbusAdu { pdu, ..adu }.frame(ModbusFraming::Tcp)).await;
        }
    }
}

fn answer(request: &ModbusRequest, registers: &mut [u16; 20]) -> ModbusReply {
    let mut write = |address: u16, values: &[u16]| {
        let before = registers[14];
        registers[usize::from(address)..][..values.len()].copy_from_slice(values);
        if registers[14] == START && before == 0 {
            registers.copy_within(10..12, 16);
        }
        ModbusReply::Written
    };
    match request {
        ModbusRequest::WriteRegister { address, value } => write(*address, &[*value]),
        ModbusRequest::WriteRegisters { address, values } => write(*address, values),
        ModbusRequest::ReadRegisters { address, count } => {
            ModbusReply::Registers(registers[usize::from(*address)..][..usize::from(*count)].to_vec())
        }
        ModbusRequest::ReadCoils { .. } | ModbusRequest::WriteCoil { .. } | ModbusRequest::WriteCoils { .. } => {
            ModbusReply::Exception(1)
        }
    }
}

async fn bench() -> (PlcTable, Registers) {
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a socket");
    let spec = spec(&listener.local_addr().expect("an address").to_string());
    let registers = ready();
    tokio::spawn(serve(listener, Arc::clone(&registers)));
    (PlcTable::new(spec, Wiring::over_tcp("table", Arc::new(()))), registers)
}

fn spec(address: &str) -> ModbusPlcSpec {
    let spec = serde_json::json!({
        "address": address, "units_per_turn": 36_000, "home_units": 100, "is_reversed": true, "word_order": "high_first",
        "target_register": 10, "speed_register": 12, "command_register": 14, "state_register": 15, "position_register": 16,
        "fault_register": 18, "heartbeat_register": 19,
    });
    serde_json::from_value(spec).expect("a specification")
}

/// Registers of a PLC whose table is ready and in position.
fn ready() -> Registers {
    let registers: Registers = Arc::default();
    registers.lock().expect("registers")[15] = 0b101;
    registers
}

fn target(angle_deg: f64) -> Target<1> {
    Target {
        sequence: 1,
        positions_rad: [angle_deg.to_radians()],
        max_speed_rad_s: [30_f64.to_radians()],
        max_acceleration_rad_s2: [60_f64.to_radians()],
        duration: Duration::from_secs(1),
    }
}

#[tokio::test]
async fn targets_speeds_and_heartbeats_stand_in_the_registers_of_the_map() {
    let (mut table, registers) = bench().await;
    table.connect().await.expect("a PLC");
    table.arm(Duration::from_millis(200)).await.expect("armed");
    table.start(&target(-90.0)).await.expect("accepted");
    let state = table.state().await.expect("a state");
    assert!(state.condition.in_position && (state.positions_rad[0].to_degrees() + 90.0).abs() < 1e-9);
    table.keep_alive().await.expect("alive");
    let held = *registers.lock().expect("registers");
    assert_eq!(values_of(&held[10..14], WordOrder::HighFirst), [9100, 3000], "reversed, from home");
    assert_eq!((held[14], held[19]), (START, 2));
    table.stop(&mut None).await.expect("acknowledged");
    assert_eq!(registers.lock().expect("registers")[14], STOP);
    assert!(matches!(table.start(&target(0.0)).await, Err(DeviceError::NotReady { .. })));
}

#[tokio::test]
async fn faults_show_in_the_state_and_keep_the_table_from_being_armed() {
    let (mut table, registers) = bench().await;
    table.connect().await.expect("a PLC");
    (registers.lock().expect("registers")[15], registers.lock().expect("registers")[18]) = (0b11_1001, 77);
    let condition = table.state().await.expect("a state").condition;
    assert!(condition.emergency_stop && condition.guard_open && condition.fault == Some(FaultCode(77)));
    assert!(matches!(table.arm(Duration::from_millis(200)).await, Err(DeviceError::NotReady { .. })));
}

#[tokio::test(start_paused = true)]
async fn a_stop_gets_past_a_half_open_link_within_an_attempt_however_long_answers_are_waited_for() {
    let registers = ready();
    let served = Arc::clone(&registers);
    let network = RoughNetwork::new(1, move |end| {
        let served = Arc::clone(&served);
        tokio::spawn(async move { talk(end, &served).await });
    });
    let wiring = Wiring { dialer: Arc::new(NetworkDialer(Arc::clone(&network))), log: Arc::new(()), device: "table" };
    let mut table = PlcTable::new(ModbusPlcSpec { reply_timeout_ms: 1000, ..spec("table:502") }, wiring);
    table.connect().await.expect("a PLC");
    table.arm(Duration::from_millis(200)).await.expect("armed");
    // What is sent over the link that there is is lost from here on.
    network.set_passage(Passage::Lost);
    network.set_passage(Passage::Open);
    let (asked_at, mut sent_at) = (Instant::now(), None);
    let stopped = timeout(STOP_ATTEMPT, table.stop(&mut sent_at)).await.expect("within an attempt");
    let acknowledged_at = stopped.expect("acknowledged over a new link");
    // The request that was lost went out too, and is told.
    let sent_at = sent_at.expect("sent");
    assert!(sent_at < asked_at + STOP_WAIT && acknowledged_at >= asked_at + STOP_WAIT, "{:?}", sent_at - asked_at);
    assert_eq!(registers.lock().expect("registers")[14], STOP);
}

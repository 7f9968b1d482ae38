//! Tests of Modbus.

use proptest::prelude::*;

use super::*;
use crate::execution::protocol::mangled::each_mangled;

/// Bytes written in hexadecimal.
fn hex(text: &str) -> Vec<u8> {
    text.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).expect("a byte")).collect()
}

/// Frames of Panasonic's documents, with their requests.
fn golden() -> [(&'static str, ModbusRequest); 5] {
    [
        ("01 05 00 60 00 00 CD D4", ModbusRequest::WriteCoil { address: 0x60, on: false }),
        ("01 05 00 60 FF 00 8C 24", ModbusRequest::WriteCoil { address: 0x60, on: true }),
        ("01 06 43 00 00 55 5C 71", ModbusRequest::WriteRegister { address: 0x4300, value: 0x55 }),
        ("01 03 60 01 00 01 CB CA", ModbusRequest::ReadRegisters { address: 0x6001, count: 1 }),
        ("01 03 60 2C 00 02 1B C2", ModbusRequest::ReadRegisters { address: 0x602C, count: 2 }),
    ]
}

#[test]
fn frames_are_those_of_the_drive_s_documents() {
    for (text, request) in golden() {
        let adu = ModbusAdu { transaction: 0, node: 1, pdu: request.pdu() };
        assert_eq!(adu.frame(ModbusFraming::Rtu), hex(text));
        let read = ModbusAdu::take(&mut hex(text), ModbusFraming::Rtu, ModbusSide::Server);
        assert_eq!(read, Ok(Some(adu)));
        assert_eq!(ModbusRequest::parse(&request.pdu()), Ok(request));
    }
    let mut answer = hex("01 03 04 22 E0 00 02 70 7C");
    let adu = ModbusAdu::take(&mut answer, ModbusFraming::Rtu, ModbusSide::Client).expect("a frame").expect("complete");
    assert_eq!(golden()[4].1.parse_reply(&adu.pdu), Ok(ModbusReply::Registers(vec![0x22E0, 0x0002])));
}

#[test]
fn the_specification_s_example_of_tcp_is_read() {
    // Section 4.1 of Modbus Messaging on TCP/IP: transaction 15 01, unit FF, one register from 4.
    let mut held = hex("15 01 00 00 00 06 FF 03 00 04 00 01 99");
    let adu = ModbusAdu::take(&mut held, ModbusFraming::Tcp, ModbusSide::Server).expect("a frame").expect("complete");
    assert_eq!((adu.transaction, adu.node), (0x1501, 0xFF));
    assert_eq!(ModbusRequest::parse(&adu.pdu), Ok(ModbusRequest::ReadRegisters { address: 4, count: 1 }));
    assert_eq!(held, [0x99]);
}

#[test]
fn a_frame_is_taken_when_it_is_complete_and_not_before() {
    for framing in [ModbusFraming::Rtu, ModbusFraming::Tcp] {
        let request = ModbusRequest::WriteRegisters { address: 0x4800, values: vec![1, 2, 3, 4] };
        let whole = ModbusAdu { transaction: 0, node: 1, pdu: request.pdu() }.frame(framing);
        for length in 0..whole.len() {
            assert_eq!(ModbusAdu::take(&mut whole[..length].to_vec(), framing, ModbusSide::Server), Ok(None), "{length}");
        }
    }
}

#[test]
fn answers_to_something_else_and_damaged_frames_are_errors() {
    let read = ModbusRequest::ReadRegisters { address: 1, count: 2 };
    assert_eq!(read.parse_reply(&[3, 2, 0, 1]), Err(ModbusError::Shape), "one register for two");
    assert_eq!(read.parse_reply(&[1, 1, 0]), Err(ModbusError::OtherRequest));
    assert_eq!(read.parse_reply(&[0x83, 2]), Ok(ModbusReply::Exception(2)));
    let write = ModbusRequest::WriteRegister { address: 7, value: 8 };
    assert_eq!(write.parse_reply(&[6, 0, 7, 0, 9]), Err(ModbusError::OtherRequest), "another value");
    let mut damaged = hex("01 05 00 60 FF 00 8C 25");
    assert_eq!(ModbusAdu::take(&mut damaged, ModbusFraming::Rtu, ModbusSide::Server), Err(ModbusError::Checksum));
    let mut long = hex("00 01 00 00 FF FF 01 03");
    assert_eq!(ModbusAdu::take(&mut long, ModbusFraming::Tcp, ModbusSide::Client), Err(ModbusError::Header));
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_million_inputs_neither_panic_nor_pile_up() {
    let requests = golden().map(|(_, request)| request);
    let mut known: Vec<Vec<u8>> = golden().iter().map(|(text, _)| hex(text)).collect();
    known.push(hex("01 03 04 22 E0 00 02 70 7C"));
    known.push(hex("15 01 00 00 00 06 FF 03 00 04 00 01"));
    known.extend(requests.iter().map(ModbusRequest::pdu));
    let kinds =
        [ModbusFraming::Rtu, ModbusFraming::Tcp].map(|framing| [(framing, ModbusSide::Server), (framing, ModbusSide::Client)]);
    let kinds = kinds.as_flattened();
    let mut held = vec![Vec::new(); kinds.len()];
    each_mangled(&known, |input| {
        let _ = ModbusRequest::parse(input);
        for request in &requests {
            let _ = request.parse_reply(input);
        }
        for ((framing, side), held) in kinds.iter().zip(&mut held) {
            held.extend_from_slice(input);
            while let Ok(Some(_)) = ModbusAdu::take(held, *framing, *side) {}
            if ModbusAdu::take(held, *framing, *side).is_err() {
                held.clear();
            }
            assert!(held.len() <= 300 + input.len());
        }
    });
}

fn requests() -> impl Strategy<Value = ModbusRequest> {
    let address = any::<u16>();
    prop_oneof![
        (address, 1..=MAX_READ_COILS).prop_map(|(address, count)| ModbusRequest::ReadCoils { address, count }),
        (address, 1..=MAX_READ_REGISTERS).prop_map(|(address, count)| ModbusRequest::ReadRegisters { address, count }),
        (address, any::<bool>()).prop_map(|(address, on)| ModbusRequest::WriteCoil { address, on }),
        (address, any::<u16>()).prop_map(|(address, value)| ModbusRequest::WriteRegister { address, value }),
        (address, prop::collection::vec(any::<bool>(), 1..=MAX_WRITE_COILS))
            .prop_map(|(address, on)| ModbusRequest::WriteCoils { address, on }),
        (address, prop::collection::vec(any::<u16>(), 1..=MAX_WRITE_REGISTERS))
            .prop_map(|(address, values)| ModbusRequest::WriteRegisters { address, values }),
    ]
}

proptest! {
    #[test]
    fn requests_and_answers_survive_a_round_trip(request in requests(), transaction: u16, node: u8, seed: u16, code: u8) {
        let bits = |count: usize| (0..count).map(|index| (index as u16).wrapping_mul(seed) & 4 == 4).collect();
        let words = |count: u16| (0..count).map(|index| index.wrapping_mul(seed)).collect();
        let done = match &request {
            ModbusRequest::ReadCoils { count, .. } => ModbusReply::Coils(bits((*count).into())),
            ModbusRequest::ReadRegisters { count, .. } => ModbusReply::Registers(words(*count)),
            ModbusRequest::WriteCoil { .. } | ModbusRequest::WriteRegister { .. } | ModbusRequest::WriteCoils { .. }
            | ModbusRequest::WriteRegisters { .. } => ModbusReply::Written,
        };
        for framing in [ModbusFraming::Rtu, ModbusFraming::Tcp] {
            let transaction = if framing == ModbusFraming::Tcp { transaction } else { 0 };
            let adu = ModbusAdu { transaction, node, pdu: request.pdu() };
            prop_assert_eq!(ModbusAdu::take(&mut adu.frame(framing), framing, ModbusSide::Server), Ok(Some(adu)));
            for reply in [done.clone(), ModbusReply::Exception(code)] {
                let adu = ModbusAdu { transaction, node, pdu: request.reply_pdu(&reply) };
                let taken = ModbusAdu::take(&mut adu.frame(framing), framing, ModbusSide::Client);
                prop_assert_eq!(&taken, &Ok(Some(adu.clone())));
                prop_assert_eq!(request.parse_reply(&adu.pdu), Ok(reply));
            }
        }
        prop_assert_eq!(ModbusRequest::parse(&request.pdu()), Ok(request));
    }
}

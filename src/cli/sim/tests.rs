//! Tests of the printed sections.

use clap::Parser;

use super::*;
use crate::cell::ControllersSpec;

#[derive(Debug, Parser)]
struct Line {
    #[command(subcommand)]
    device: SimulatedDevice,
}

fn turntable(words: &[&str]) -> TurntableSimArgs {
    match Line::try_parse_from([&["sim", "turntable"], words].concat()).expect("arguments").device {
        SimulatedDevice::Turntable(args) => args,
        other @ (SimulatedDevice::Robot(_) | SimulatedDevice::Scanner(_)) => panic!("{other:?}"),
    }
}

#[test]
fn printed_sections_are_those_of_a_cell_file() {
    for (words, address) in [
        (&[][..], "tcp://127.0.0.1:1502"),
        (&["--modbus-tcp", "--infinite-rotation"], "tcp://127.0.0.1:1502"),
        (&["--pty", "--gear-ratio", "7", "--units-per-turn", "36000"], "/dev/pts/7"),
    ] {
        let sections = [arm_section("127.0.0.1:10003", "hans-e05"), table_section(address, &turntable(words))];
        let texts = sections.map(|section| toml::to_string(&json!({ "controllers": section })).expect("TOML"));
        let file: toml::Table = toml::from_str(&texts.concat().replacen("[controllers]\n", "", 9)).expect("both in one file");
        let spec: ControllersSpec = file["controllers"].clone().try_into().expect("a section");
        assert_eq!(spec.check(), Ok(()), "{words:?}");
    }
}

#[test]
fn factors_of_time_are_bounded() {
    assert_eq!(["1", "×5", "x0.5"].map(|text| speed(text).ok()), [Some(1.0), Some(5.0), Some(0.5)]);
    for text in ["0", "101", "nan", "fast"] {
        assert_eq!(speed(text), Err(format!("is {text}; allowed is 0.1 to 100")));
    }
}

/// The message was "invalid socket address syntax", which does not say that the port is missing.
#[test]
fn an_address_without_its_port_says_what_to_give() {
    let refused = |option: &str| {
        let line = Line::try_parse_from(["sim", "turntable", option, "127.0.0.1"]);
        line.map(drop).expect_err("no port").to_string()
    };
    for told in [refused("--listen"), refused("--control")] {
        assert!(told.contains("give ADDRESS:PORT, an IP address and a port, as in 127.0.0.1:10003"), "{told}");
    }
}

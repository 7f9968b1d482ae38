//! Tests of the drive's addresses and values, against the examples of its manual.

use proptest::prelude::*;

use super::*;
use crate::cell::WordOrder;
use crate::execution::protocol::mangled::each_mangled;
use crate::execution::protocol::modbus::{registers_of, values_of};

#[test]
fn addresses_of_parameters_follow_the_manual_s_formula() {
    assert_eq!(parameter(1, 10), 0x3114, "the manual's example");
    assert_eq!((COMMUNICATION_TIMEOUT, ABSOLUTE_ENCODER, MULTI_TURN_LIMIT), (0x3550, 0x301E, 0x36B0));
    assert_eq!(MoveBlock::register(255) + 2, 0x4BFE);
}

#[test]
fn a_block_is_that_of_the_manual_s_example() {
    // Section 5, block 3: absolute, speed 1, acceleration 2, deceleration 3, 100000 units; ours ends there instead of going on.
    let block =
        MoveBlock { travel: BlockTravel::Absolute(100_000), speed: 1, acceleration: 2, deceleration: 3, is_followed: false };
    assert_eq!(block.words(), [0x0212_3000, 0x0001_86A0]);
    let followed = MoveBlock { is_followed: true, ..block };
    assert_eq!(followed.words()[0], 0x0212_3300);
    assert_eq!(MoveBlock::read([0x0420_0300, 0]), None, "homing does not move to a target");
    assert_eq!(MoveBlock::read([0, 0]), None, "an empty block");
}

#[test]
fn words_come_low_first_and_text_in_swapped_pairs() {
    // PN voltage of the manual: 140 000 mV.
    assert_eq!(values_of(&[0x22E0, 0x0002], WordOrder::LowFirst), [140_000]);
    assert_eq!(values_of(&[0x0002, 0x22E0], WordOrder::HighFirst), [140_000]);
    assert_eq!(text_of(&[0x414D, 0x4C44, 0x3154, 0x5335, 0x0046, 0, 0, 0]), "MADLT15SF");
    assert_eq!(registers_of_text("MADLT15SF", 8), [0x414D, 0x4C44, 0x3154, 0x5335, 0x0046, 0, 0, 0]);
}

#[test]
fn errors_have_numbers_and_words() {
    assert_eq!(error_number(0x1A00), 2600);
    assert_eq!(error_number(0x5000), ERROR_TIMEOUT);
    assert_eq!(error_number(0x5C03), 9203);
    assert!(error_text(8000).contains("Err80.0"));
    assert!(error_text(1401).contains("Err14"));
}

proptest! {
    #[test]
    fn blocks_values_and_errors_survive_a_round_trip(
        units: i32, is_relative: bool, speed in 0_u8..16, acceleration in 0_u8..16, deceleration in 0_u8..16, is_followed: bool,
        values: Vec<i32>, main in 0_u32..256, sub in 0_u32..100,
    ) {
        let travel = if is_relative { BlockTravel::Relative(units) } else { BlockTravel::Absolute(units) };
        let block = MoveBlock { travel, speed, acceleration, deceleration, is_followed };
        prop_assert_eq!(MoveBlock::read(block.words()), Some(block));
        for order in WordOrder::ALL {
            prop_assert_eq!(values_of(&registers_of(&values, order), order), values.clone());
        }
        prop_assert_eq!(error_number(error_register(100 * main + sub)), 100 * main + sub);
    }
}

/// Registers of any bytes: nothing panics, texts are printable and no longer than their registers, what is read as a block is that block
/// again, and values come back in either order of words.
#[test]
#[ignore = "long: tests/all runs it"]
fn a_million_mangled_inputs_are_read_or_refused() {
    let block =
        MoveBlock { travel: BlockTravel::Relative(-400_000), speed: 3, acceleration: 2, deceleration: 1, is_followed: true };
    let known = [registers_of(&block.words(), WordOrder::LowFirst), registers_of_text("MADLT15SF", 8)];
    let known = known.map(|registers| registers.into_iter().flat_map(u16::to_be_bytes).collect::<Vec<u8>>());
    let mut blocks = 0_u32;
    each_mangled(&known, |input| {
        let registers: Vec<u16> = input.chunks_exact(2).map(|pair| u16::from_be_bytes([pair[0], pair[1]])).collect();
        let text = text_of(&registers);
        assert!(text.len() <= 2 * registers.len() && text.bytes().all(|byte| (b' '..=b'~').contains(&byte)));
        for order in WordOrder::ALL {
            let values = values_of(&registers, order);
            assert_eq!(registers_of(&values, order), registers[..2 * values.len()]);
            if let Some(words) = values.first_chunk()
                && let Some(block) = MoveBlock::read(*words)
            {
                assert_eq!(block.words(), *words);
                blocks += 1;
            }
        }
        registers.iter().for_each(|register| assert!(!error_text(error_number(*register)).is_empty()));
    });
    assert!(blocks > 1000, "{blocks} blocks are read");
}

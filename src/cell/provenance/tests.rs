use super::*;
use crate::cell::{Cell, Presets, SpecLibrary};

fn cell() -> Cell {
    Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset")
}

/// The preset's poses as calibrated and compensated: 0.4 mm and 0.05°, at 22 °C, for a day and 5 K.
fn provenance(cell: &Cell) -> CalibrationProvenance {
    let calibration_id = "ab".repeat(32);
    CalibrationProvenance {
        by: "vantage".into(),
        at: "2026-11-20T09:00:00Z".into(),
        calibration_id: calibration_id.clone(),
        data_sha256: "cd".repeat(32),
        rms_rotation_deg: 0.01,
        rms_translation_mm: 0.1,
        point_sd_mm: 0.05,
        rotation_sd_deg: 0.004,
        translation_sd_mm: 0.04,
        temperature_c: Some(21.0),
        max_age_hours: Some(720.0),
        max_temperature_change_k: Some(8.0),
        compensation_sha256: Some("ef".repeat(32)),
        compensation: Some(CompensationProvenance {
            cell: cell.name.clone(),
            calibration_id,
            at: "2026-11-23T06:00:00Z".into(),
            temperature_c: Some(22.0),
            flange_from_scanner: PoseSpec::from(&cell.flange_from_scanner),
            rotation_deg: 0.05,
            translation_mm: 0.4,
            max_rotation_deg: 1.0,
            max_translation_mm: 8.4,
            max_age_hours: 24.0,
            max_temperature_change_k: 5.0,
        }),
    }
}

fn objections(change: impl FnOnce(&mut Cell, &mut UseConditions)) -> Vec<CalibrationObjection> {
    let mut cell = cell();
    cell.calibrated = Some(provenance(&cell));
    let mut conditions =
        UseConditions { calibration_age_hours: Some(70.0), compensation_age_hours: Some(1.0), temperature_c: Some(23.0) };
    change(&mut cell, &mut conditions);
    cell.calibration_objections(&conditions)
}

fn compensation(cell: &mut Cell) -> &mut CompensationProvenance {
    cell.calibrated.as_mut().expect("calibrated").compensation.as_mut().expect("compensated")
}

#[test]
fn a_fresh_compensation_of_the_cell_is_used() {
    assert_eq!(objections(|_, _| {}), []);
    assert_eq!(objections(|_, conditions| *conditions = UseConditions::default()), [], "what is not known forbids nothing");
    assert_eq!(objections(|cell, _| cell.calibrated = None), []);
    assert_eq!(objections(|_, conditions| conditions.compensation_age_hours = Some(24.0)), [], "to the end of its age");
    assert_eq!(objections(|_, conditions| conditions.compensation_age_hours = Some(-0.05)), [], "clocks differ by minutes");
}

/// Each reason, by its words.
#[test]
fn each_reason_against_a_compensation_is_named() {
    let said = |change: fn(&mut Cell, &mut UseConditions)| {
        let found = objections(change);
        assert_eq!(found.len(), 1, "{found:?}");
        found[0].to_string()
    };
    type Change = fn(&mut Cell, &mut UseConditions);
    let cases: [(Change, &str); 9] = [
        (|_, now| now.compensation_age_hours = Some(24.1), "the compensation is 24.1 h old; allowed is 0 to 24 h"),
        (|_, now| now.compensation_age_hours = Some(-1.0), "the compensation is -1.0 h old"),
        (|_, now| now.calibration_age_hours = Some(721.0), "the calibration is 721.0 h old; allowed is 0 to 720 h"),
        (|_, now| now.calibration_age_hours = Some(f64::INFINITY), "the calibration is inf h old"),
        (|_, now| now.temperature_c = Some(27.5), "taken at 22.0 °C; at 27.5 °C it may not be used: allowed is a change of 5 K"),
        (|cell, _| cell.name = "line-4".into(), "is of cell \"e05-transcan\", not of \"line-4\""),
        (|cell, _| compensation(cell).calibration_id = "00".repeat(32), "corrects calibration 0000"),
        (|cell, _| compensation(cell).flange_from_scanner.translation_mm[0] += 0.01, "is not the pose"),
        (|cell, _| compensation(cell).translation_mm = 8.5, "corrects 8.500 mm and 0.0500°; allowed are 8.4 mm and 1°"),
    ];
    for (change, words) in cases {
        let said = said(change);
        assert!(said.contains(words), "{said}");
        assert!(["; check", ": check", ". Check", ": calibrate", "; give"].iter().any(|next| said.contains(next)), "{said}");
    }
    let both = objections(|_, now| now.temperature_c = Some(31.0));
    assert_eq!(both.len(), 2, "calibration and compensation: {both:?}");
}

#[test]
fn a_compensation_goes_with_its_digest() {
    let said = |change: fn(&mut CalibrationProvenance)| {
        let mut known = provenance(&cell());
        change(&mut known);
        let mut findings = Findings::default();
        known.check("/calibrated", &mut findings);
        findings.into_result().map_or_else(|errors| errors[0].pointer.clone(), |()| String::new())
    };
    assert_eq!(said(|_| {}), "");
    assert_eq!(said(|known| known.compensation = None), "/calibrated/compensation");
    assert_eq!(said(|known| known.compensation_sha256 = None), "/calibrated/compensation");
    assert_eq!(said(|known| known.max_age_hours = Some(0.0)), "/calibrated/max_age_hours");
    assert_eq!(
        said(|known| known.compensation.as_mut().expect("there").max_temperature_change_k = f64::NAN),
        "/calibrated/compensation/max_temperature_change_k"
    );
}

//! `vantage inspect SCANNER`: a scanner's fields of view and measurement volume, compared with the boxes stated in its
//! specification.

use std::fmt::Write as _;

use serde_json::Value;

use super::CliError;
use super::files::toml_fault;
use crate::cell::{DepthBoundSource, FieldError, ScannerSpec};
use crate::check::kind_of;
use crate::wire::scanner_facts::{DepthOfFieldFacts, Excess, FieldFacts, PlanarFacts, ScannerFacts, StatedBox, VolumeFacts};
use crate::wire::words::fixed;
use crate::wire::{DocumentKind, from_value};

/// Describes the scanner that `text` specifies, as text or as JSON.
///
/// # Errors
/// [`CliError::BadInput`] if `text` is not the TOML of a scanner, or with every field that is out of range.
pub fn render(text: &str, json: bool) -> Result<String, CliError> {
    let value: Value = toml::from_str(text).map_err(|error| neither(&toml_fault(text, &error)))?;
    render_document(&value, json)
}

fn neither(error: &str) -> CliError {
    CliError::BadInput(format!("neither a mesh (STL, OBJ or PLY) nor a scanner (TOML): {error}"))
}

/// Describes the scanner that `document` specifies, as text or as JSON.
///
/// # Errors
/// [`CliError::BadInput`] if it is not a scanner, or with every field that is out of range.
pub(super) fn render_document(document: &Value, json: bool) -> Result<String, CliError> {
    let lines = |errors: Vec<FieldError>| errors.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n");
    let spec: ScannerSpec = from_value(document).map_err(|errors| match kind_of(document) {
        Some(DocumentKind::Scanner) => CliError::BadInput(lines(errors)),
        _ => neither(&lines(errors)),
    })?;
    let scanner = spec.build().map_err(|errors| CliError::BadInput(lines(errors)))?;
    let facts = ScannerFacts::new(&scanner);
    if json {
        let document = serde_json::to_string_pretty(&facts).map_err(|error| CliError::BadInput(error.to_string()))?;
        return Ok(document + "\n");
    }
    Ok(describe(&facts))
}

fn describe(facts: &ScannerFacts) -> String {
    let mut out = format!(
        "scanner {}\nrig     baseline {:.2} mm, optical axes {:.2}° apart\n\n",
        facts.name, facts.baseline_mm, facts.axes_angle_deg
    );
    out += "device     centre mm                 axis                     view          incidence up to\n";
    for device in &facts.devices {
        let [cx, cy, cz] = device.centre_mm.map(|mm| fixed(mm, 2));
        let [ax, ay, az] = device.axis.map(|part| fixed(part, 4));
        let [horizontal, vertical] = device.field_of_view_deg;
        line(
            &mut out,
            format_args!(
                "{:<10} {cx:>8} {cy:>6} {cz:>6}   {ax:>7} {ay:>7} {az:>7}   {horizontal:.1}° × {vertical:.1}°   {:.1}°",
                device.name, device.incidence_max_deg
            ),
        );
    }
    describe_fields(&mut out, &facts.fields);
    describe_depth_bounds(&mut out, facts);
    if let Some(field) = &facts.depth_of_field {
        describe_depth_of_field(&mut out, field);
    }
    match &facts.volume {
        Some(volume) => describe_volume(&mut out, volume),
        None => out += "\nmeasurement volume: none around best focus\n",
    }
    match &facts.planar_construction {
        Some(planar) => describe_planar(&mut out, planar),
        None => out += "\nplanar construction of the thesis: its lines leave no depth\n",
    }
    out
}

fn describe_planar(out: &mut String, planar: &PlanarFacts) {
    let PlanarFacts { width_mm, height_mm, depth_mm, best_mm, printed_best_mm, .. } = planar;
    let stated = planar.stated_mm.map_or_else(String::new, |[x, y, z]| format!("; stated by optics {x:.0} × {y:.0} × {z:.0}"));
    *out += "\nplanar construction of the thesis (§3.1.1.2–3), x × y × z, mm:\n";
    line(out, format_args!("L_opt × height × W_opt   {width_mm:.1} × {height_mm:.1} × {depth_mm:.1}{stated}"));
    line(
        out,
        format_args!("best plane               {best_mm:.1} (H_opt as printed: {printed_best_mm:.1}, the half height twice)"),
    );
    *out += "W_opt ends where the cameras' outer sides cross, not at the far end of the working depth, and L_opt is the mean width\n\
             of a trapezoid: a comparison with a box stated by optics, not one to be equal. Planning does not use it.\n";
}

/// Appends a line; writing to a string cannot fail.
fn line(out: &mut String, text: std::fmt::Arguments<'_>) {
    let _ = writeln!(out, "{text}");
}

fn describe_fields(out: &mut String, fields: &[FieldFacts]) {
    *out += "\nfield mm   left x            right x           projector x       common x          common\n";
    for field in fields {
        let x = |[from, to]: [f64; 2]| format!("{:>7} … {:<7}", fixed(from, 1), fixed(to, 1));
        let columns: String = field.devices.iter().chain([&field.common]).map(|f| x(f.x_mm)).collect();
        let size = |[from, to]: [f64; 2]| (to - from).max(0.0);
        line(
            out,
            format_args!("at {:<6.0} {columns} {:.1} × {:.1}", field.depth_mm, size(field.common.x_mm), size(field.common.y_mm)),
        );
    }
}

/// Limits of the working depth, where devices state a depth of field.
fn describe_depth_bounds(out: &mut String, facts: &ScannerFacts) {
    if facts.depth_bounds.len() < 2 {
        return;
    }
    *out += "\nworking depth mm, on the axis and over the whole field at best focus\n";
    for bound in &facts.depth_bounds {
        let end = |mm: Option<f64>| mm.map_or_else(|| "infinite".to_owned(), |mm| format!("{mm:.1}"));
        let [near, far, field_near, field_far] = [bound.near_mm, bound.far_mm, bound.field_near_mm, bound.field_far_mm].map(end);
        line(out, format_args!("{:<10} {near:>8} … {far:<9} {field_near:>8} … {field_far}", bound.source.as_str()));
    }
    let words = |source: DepthBoundSource| match source {
        DepthBoundSource::Practical => "the practical depth",
        DepthBoundSource::Left => "the left camera's depth of field",
        DepthBoundSource::Right => "the right camera's depth of field",
        DepthBoundSource::Projector => "the projector's depth of field",
    };
    line(out, format_args!("limited    near by {}, far by {}", words(facts.near_bound), words(facts.far_bound)));
}

fn describe_depth_of_field(out: &mut String, facts: &DepthOfFieldFacts) {
    line(
        out,
        format_args!(
            "\ndepth of field of the left camera, f = {:.3} mm, circle of confusion {:.4} mm (2 px)",
            facts.focal_mm, facts.circle_mm
        ),
    );
    for stop in &facts.by_f_number {
        let rear = stop.rear_mm.map_or_else(|| "infinite".to_owned(), |mm| format!("{mm:.1} mm"));
        line(
            out,
            format_args!(
                "at f/{:<5} front {:>5.1} mm, rear {rear}; infinite from {:.0} mm on",
                stop.f_number, stop.front_mm, stop.hyperfocal_mm
            ),
        );
    }
    let ([front, rear], [by_front, by_rear]) = (facts.working_mm, facts.working_blur_mm);
    line(
        out,
        format_args!(
            "working    front {front:>5.1} mm, rear {rear:.1} mm: equivalent to a circle of confusion times f-number of {by_front:.4} mm (front) and {by_rear:.4} mm (rear)"
        ),
    );
}

fn describe_volume(out: &mut String, volume: &VolumeFacts) {
    let [x, y, z] = volume.largest_cuboid_mm;
    line(
        out,
        format_args!(
            "\nmeasurement volume: {:.3} l, {} corners; curvature due to lens distortion (up to {:.2} mm) is neglected",
            volume.volume_mm3 / 1e6,
            volume.vertices_mm.len(),
            volume.bow_mm
        ),
    );
    *out += "boxes aligned with the scanner and centred on best focus, mm:\n";
    line(out, format_args!("largest cuboid   {x:.1} × {y:.1} × {z:.1}"));
    line(out, format_args!("largest cube     {:.1}", volume.largest_cube_mm));
    for stated in &volume.stated {
        describe_box(out, stated);
    }
    *out += "A stated box may extend beyond this volume, which all three devices see at every depth: a box from a drawing has\n\
             the mean width over the depth, and a practical box the range that is worth scanning. Planning tests every\n\
             point against the devices themselves; practical volume and block cube only guide where viewpoints are tried.\n";
}

fn describe_box(out: &mut String, stated: &StatedBox) {
    let name = match stated.name {
        "stated" => "stated by optics",
        "practical" => "practical",
        _ => "block cube",
    };
    let [x, y, z] = stated.size_mm;
    line(out, format_args!("{name:<16} {x:.0} × {y:.0} × {z:.0}: {:.1} % inside", 100.0 * stated.inside));
    for Excess { of, corner_mm, outside_mm } in &stated.excess {
        let [x, y, z] = corner_mm.map(|mm| fixed(mm, 1));
        let what = if *of == "depth" { "working depth".to_owned() } else { format!("field of the {of}") };
        line(out, format_args!("                   leaves the {what} by {outside_mm:.1} mm at ({x}, {y}, {z})"));
    }
}

use clap::Parser;

use super::*;
use crate::check::{Reference, check};
use crate::planning::context::{Context, Silent};

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    args: ScannerArgs,
}

const SHEET: [&str; 9] = ["scanner", "--field", "300x200", "--at", "500", "--depth", "440..560", "--baseline", "200"];

fn args(options: &[&str]) -> Result<ScannerArgs, String> {
    Line::try_parse_from([&SHEET, options].concat()).map(|line| line.args).map_err(|error| error.to_string())
}

#[test]
fn a_data_sheet_becomes_a_file_that_check_accepts_with_a_sketch_beside_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (out, sketch) = (path("mine.toml"), path("mine.svg"));
    run(&args(&["--out", &out, "--sketch", &sketch, "--name", "mine"]).expect("options")).expect("files");
    let value = files::value(Path::new(&out)).expect("TOML");
    let never = std::sync::atomic::AtomicBool::new(false);
    let ctx = Context::new(&never, &Silent);
    let sound = check(value.clone(), &files::FileLibrary, None, &Reference::default(), &ctx).expect("sound");
    assert_eq!((sound.description.as_str(), sound.warnings.len()), ("scanner mine", 0));
    let spec: ScannerSpec = files::from_value(value, "mine").expect("a scanner");
    assert_eq!(spec, args(&["--name", "mine"]).expect("options").sheet().spec().expect("valid"), "the file says all of it");
    assert_eq!((spec.depth_mm.near, spec.depth_mm.best, spec.depth_mm.far, spec.block_cube_mm), (440.0, 500.0, 560.0, None));
    assert!(std::fs::read_to_string(sketch).expect("the sketch").contains("best focus, 500 mm"));
    let text = std::fs::read_to_string(out).expect("the file");
    assert!(text.starts_with("# From a data sheet") && text.contains("field 300 x 200 mm at 500 mm"), "{text}");
}

#[test]
fn figures_are_read_as_people_write_them() {
    assert_eq!("300x200".parse::<Dimensions<f64>>().map(|pair| pair.0), Ok([300.0, 200.0]));
    assert_eq!("300 × 200.5".parse::<Dimensions<f64>>().map(|pair| pair.0), Ok([300.0, 200.5]));
    assert_eq!("440..560".parse::<Span>().map(|span| span.0), Ok([440.0, 560.0]));
    assert_eq!("440-560".parse::<Span>().map(|span| span.0), Ok([440.0, 560.0]));
    assert_eq!("-900, 0,300".parse::<Triple>().map(|triple| triple.0), Ok([-900.0, 0.0, 300.0]));
    assert_eq!("300x130x110".parse::<Triple>().map(|triple| triple.0), Ok([300.0, 130.0, 110.0]));
    for wrong in ["300", "300x", "x200", "300x200x1", "wide"] {
        assert!(wrong.parse::<Dimensions<f64>>().expect_err(wrong).contains("as in 300x200"));
    }
    assert!("500".parse::<Span>().expect_err("one number").contains("as in 440..560"));
    assert!("1,2".parse::<Triple>().expect_err("two numbers").contains("as in 900,0,300"));
}

#[test]
fn figures_that_hardly_fit_together_are_doubted_by_their_options() {
    let sheet = args(&[]).expect("options").sheet();
    let spec = sheet.spec().expect("valid");
    assert_eq!(doubts_about(&sheet, &spec, &spec.build().expect("valid")), []);
    let wide = DataSheet { baseline_mm: 1400.0, ..sheet };
    let spec = wide.spec().expect("valid");
    let found = doubts_about(&wide, &spec, &spec.build().expect("valid"));
    let baseline = found.iter().find(|doubt| doubt.pointer == "--baseline").expect("doubted");
    assert!(baseline.detail.contains("109° apart: at the incidence limit of 60° only about 6° is left"), "{baseline:?}");
}

#[test]
fn figures_out_of_range_are_told_together_by_their_options() {
    let wrong = ["--mass", "0", "--camera-incidence", "95", "--projector", "0,0,450", "--name", ""];
    let error = run(&args(&wrong).expect("options")).expect_err("refused");
    let told = error.to_string();
    assert_eq!(error.exit_code(), 2);
    for line in [
        "--mass: is 0 kg; allowed is 0.01 to 100 kg",
        "--camera-incidence: is 95 °",
        "--projector: is 450 mm",
        "--name: is empty",
    ] {
        assert!(told.contains(line), "{line:?} is not in {told}");
    }
    assert!(args(&["--resolution", "12M"]).expect_err("one number").contains("as in 300x200"));
}

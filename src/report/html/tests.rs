use std::sync::atomic::AtomicBool;

use nalgebra::{Isometry3, UnitQuaternion};

use super::Draft;
use super::album::{Album, Picture};
use super::draft_bytes::NoDraft;
use super::markup::{area, duration, escape, nonzero, number, percent};
use super::page::printed;
use super::sections::date_text;
use super::views::together;
use crate::geometry::Pose;
use crate::planning::context::{Context, Silent};
use crate::planning::params::{PartParams, RegionParams};
use crate::planning::plan::Grade;
use crate::planning::surface;
use crate::rendering::{Camera, Ink, MissGroup, SampledModel};
use crate::testing::cylinder_mesh;

#[test]
fn markup_neutralises_text_and_reads_numbers_out() {
    assert_eq!(escape("<b a='1'>\"&\u{7}\u{202e}\n"), "&lt;b a=&#39;1&#39;&gt;&quot;&amp;\u{fffd}\u{fffd} ");
    assert_eq!(number(-1_234_567.891, 1), "−1\u{202f}234\u{202f}567.9");
    assert_eq!((number(-0.001, 1), number(999.0, 0)), ("0.0".into(), "999".into()));
    assert_eq!(
        (nonzero(0.031, 1), nonzero(-0.031, 1), nonzero(1234.0, 1)),
        ("0.031".into(), "−0.031".into(), "1\u{202f}234.0".into())
    );
    assert_eq!((percent(0.000_031), percent(0.0)), ("0.0031\u{a0}%".into(), "0.00\u{a0}%".into()));
    assert_eq!((area(12.34), area(12345.6)), ("12.3\u{a0}mm²".into(), "12\u{202f}346\u{a0}mm²".into()));
    assert_eq!((duration(42.04), duration(143.2)), ("42.0\u{a0}s".into(), "2\u{a0}min 23\u{a0}s".into()));
    assert_eq!((duration(99.94), duration(99.96)), ("99.9\u{a0}s".into(), "1\u{a0}min 40\u{a0}s".into()));
    assert_eq!((duration(119.6), duration(3600.0)), ("2\u{a0}min 0\u{a0}s".into(), "60\u{a0}min 0\u{a0}s".into()));
}

#[test]
fn dates_are_told_to_the_minute_and_other_texts_as_they_are() {
    assert_eq!(date_text("2026-01-31T08:15:42.123456Z"), "2026-01-31 08:15 UTC");
    for other in ["", "yesterday", "2026-01-31T08:15:42+01:00", "2026-01-31T08:1…Z"] {
        assert_eq!(date_text(other), other);
    }
}

#[test]
fn the_foot_of_a_printed_page_is_text_and_nothing_else() {
    let page = printed("t", &["\"; } </style><script>", "", "PN 7\u{202e}"], "<p>b</p>\n");
    let foot = page.split("@bottom-left { content: ").nth(1).and_then(|rest| rest.split(';').next()).expect("a foot");
    assert!(foot.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '"' | '\\' | ' ' | '·')), "{foot}");
    assert!(foot.starts_with("\"\\22 \\3b \\20 ") && foot.ends_with("PN\\20 7\\fffd \""), "{foot}");
    assert_eq!(page.matches("</style>").count(), 1);
    assert!(page.contains("counter(page)") && !page.contains("<script"));
}

#[test]
fn print_keeps_pictures_with_their_legend_and_leaves_out_what_is_for_a_screen() {
    let page = printed("t", &[], "");
    let print = page.split("@media print {").nth(1).expect("a style for print");
    for rule in [".together { break-inside: avoid; }", ".screen, .fold:not([open]) { display: none; }"] {
        assert!(print.contains(rule), "{rule} is not in {print}");
    }
    assert_eq!(together("<img/>", "<ul></ul>\n"), "<div class=\"together\">\n<img/><ul></ul>\n</div>\n");
}

/// A page with pictures of a cylinder from two cameras, two of them from one, with ink in stripes.
fn draft() -> Draft {
    let mut mesh = cylinder_mesh(20.0, 40.0, 24);
    mesh.vertices_mm.iter_mut().for_each(|p| p.z += 80.0);
    let params = PartParams { patch_edge_mm: Some(1000.0), samples_per_mm2: Some(0.0001), ..PartParams::default() };
    let surface = surface::sample(&mesh, &params, &RegionParams::default(), 0).expect("a surface");
    let inks = [Ink::Measured(Grade::A), Ink::Missed(MissGroup::Shadow), Ink::ByOthers, Ink::Missed(MissGroup::Reach)];
    let codes: Vec<u8> = surface.sample_mm.iter().map(|p| inks[(p.x.abs() * 0.4) as usize % 4].code()).collect();
    let ctx = (AtomicBool::new(false), Silent);
    let mut album = Album::new(SampledModel::new(&mesh, &surface, None, &Context::new(&ctx.0, &ctx.1)).expect("not cancelled"));
    let near = Camera::fitted(Pose::identity(), [64, 48], &mesh.vertices_mm);
    let upright = UnitQuaternion::from_euler_angles(0.2, 0.1, -0.3);
    let turned = Pose::claim(Isometry3::from_parts(nalgebra::Translation3::new(0.1, 0.2, 30.0), upright));
    let far = Camera::fitted(turned, [80, 60], &mesh.vertices_mm);
    let (striped, plain) = (album.inks(&codes), album.plain(Ink::ByOthers));
    let marks = [
        album.add(Picture { camera: near.clone(), inks: striped.clone(), through: false }),
        album.add(Picture { camera: far, inks: striped.clone(), through: false }),
        album.add(Picture { camera: near.clone(), inks: plain, through: true }),
        album.add(Picture { camera: near, inks: striped, through: false }),
    ];
    assert_eq!((&marks[0], marks[1] == marks[0], marks[2] == marks[0]), (&marks[3], false, false), "equal ones are one");
    album.into_draft(format!("<p>{}</p>", marks.map(|mark| format!("<img src=\"{mark}\"/>")).join("and 1 ")))
}

fn drawn_by(draft: &Draft, threads: usize) -> String {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    pool.install(|| draft.draw(&Context::new(&AtomicBool::new(false), &Silent)).expect("not cancelled"))
}

#[test]
fn a_draft_gives_the_same_page_on_any_threads_and_after_it_was_kept() {
    let draft = draft();
    let page = drawn_by(&draft, 1);
    assert_eq!(page.matches("data:image/png;base64,").count(), 4);
    assert!(page.contains("and 1 ") && !page.contains('\u{1}'), "numbers in the text stay");
    assert_eq!(drawn_by(&draft, 3), page);
    let kept = Draft::from_bytes(&draft.to_bytes()).expect("a draft");
    assert_eq!(kept, draft);
    assert_eq!(drawn_by(&kept, 2), page);
    let cancelled = draft.draw(&Context::new(&AtomicBool::new(true), &Silent));
    assert!(cancelled.is_err());
}

#[test]
fn bytes_that_are_no_draft_are_refused() {
    let bytes = draft().to_bytes();
    for length in (0..bytes.len()).step_by(37) {
        assert_eq!(Draft::from_bytes(&bytes[..length]), Err(NoDraft), "{length} of {} bytes", bytes.len());
    }
    assert_eq!(Draft::from_bytes(&[bytes.clone(), vec![0]].concat()), Err(NoDraft));
    // Whatever a byte is changed to, it is read or refused.
    for at in (0..bytes.len()).step_by(11) {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0xff;
        let _ = Draft::from_bytes(&damaged);
    }
}

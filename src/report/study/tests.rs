use super::*;
use crate::planning::plan::StopReason;
use crate::planning::studies::StudyStep;

fn series(label: &str, of_asked: &[f64]) -> Series {
    let step = |of_asked: &f64| StudyStep {
        of_asked: *of_asked,
        of_coverable: *of_asked,
        of_total: of_asked / 2.0,
        grades: [of_asked / 4.0; 4],
    };
    Series {
        label: label.into(),
        settings: vec![("score.a", "1".into()), ("score.b", "0".into())],
        candidates: 54,
        coverable_of_asked: 1.0,
        steps: of_asked.iter().map(step).collect(),
        stopped_because: StopReason::MaxViews,
    }
}

fn findings() -> StudyResult {
    let series = vec![series("a = 1", &[0.5, 0.75, 1.0]), series("<b> & \"a\" = 0", &[0.25, 0.5]), series("none", &[])];
    StudyResult { study: Study::Weights, series, skipped: vec![("reach".into(), "needs a cell".into())] }
}

fn told<R>(ask: impl FnOnce(&StudyInput<'_>) -> R) -> R {
    let (findings, params) = (findings(), PlanParams::default());
    ask(&StudyInput { findings: &findings, params: &params, part_name: "part.stl", scanner_name: "rig", cell_name: None, at: 2 })
}

#[test]
fn the_table_has_every_step_and_ends_each_series_with_its_reason() {
    let csv = told(csv);
    let rows: Vec<&str> = csv.lines().collect();
    assert_eq!(rows.len(), 1 + 3 + 2);
    assert!(rows[0].starts_with("score.a,score.b,candidates,coverable_of_asked,views,of_asked,"), "{csv}");
    assert_eq!(rows[2], "1,0,54,1,2,0.75,0.75,0.375,0.1875,0.1875,0.1875,0.1875,");
    assert!(rows[3].ends_with(",max_views") && rows[5].ends_with(",max_views"), "{csv}");
}

#[test]
fn the_text_says_views_for_the_goal_and_what_was_left_out() {
    let text = told(text);
    let lines: Vec<&str> = text.lines().collect();
    assert!(lines[1].contains(" 3 ") && lines[1].contains("75.00") && lines[2].contains(" – "), "{text}");
    assert!(text.contains("reach") && text.contains("left out: needs a cell"), "{text}");
    assert!(text.ends_with("goal: 98.5 % of what the candidates can measure\n"), "{text}");
}

#[test]
fn the_plots_have_axes_with_units_and_every_series_in_the_legend() {
    let coverage = told(coverage_svg);
    for wanted in [
        "number of views",
        "measured, % of the asked area",
        "a = 1",
        "&lt;b&gt; &amp; &quot;a&quot; = 0",
        "measures nothing",
        "75.00",
    ] {
        assert!(coverage.contains(wanted), "{wanted:?} is not in\n{coverage}");
    }
    assert_eq!(coverage.matches("<polyline").count(), 2 * 3, "a line and its legend");
    let grades = told(grades_svg);
    for wanted in ["share of the asked area, %", "grade A", "not measured", "a = 1", "18.8"] {
        assert!(grades.contains(wanted), "{wanted:?} is not in\n{grades}");
    }
    for svg in [coverage, grades] {
        assert!(svg.starts_with("<svg xmlns=\"http://www.w3.org/2000/svg\"") && svg.ends_with("</svg>\n"));
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    }
}

#[test]
fn the_page_holds_both_plots_and_the_table() {
    let page = told(html);
    assert_eq!(page.matches("<svg ").count(), 2);
    for wanted in ["<h1>Weights of coverage and quality</h1>", "<b>reach</b>: needs a cell", "not reached", "limit of views"] {
        assert!(page.contains(wanted), "{wanted:?} is not in\n{page}");
    }
}

#[test]
fn a_share_below_the_whole_is_not_rounded_up_to_it_and_one_view_is_no_views() {
    let (findings, params) = (
        StudyResult { study: Study::Weights, series: vec![series("a = 1", &[0.99996])], skipped: Vec::new() },
        PlanParams::default(),
    );
    let input =
        StudyInput { findings: &findings, params: &params, part_name: "part.stl", scanner_name: "rig", cell_name: None, at: 1 };
    for told in [text(&input), coverage_svg(&input), html(&input)] {
        assert!(told.contains("99.99") && !told.contains("1 views"), "{told}");
        assert!(told.contains("after 1 view") || told.contains("After 1 view"), "{told}");
    }
    assert!(html(&input).contains("<td>1 view: limit of views</td>"), "{}", html(&input));
    assert_eq!(text(&input).matches("100.00").count(), 1, "what can be measured: {}", text(&input));
    assert!(!coverage_svg(&input).contains("100.00"), "{}", coverage_svg(&input));
}

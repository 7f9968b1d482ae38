use super::*;

#[test]
fn each_part_has_a_folder_and_equal_names_are_refused() {
    let paths = |meshes: &[&str]| folders(&meshes.iter().map(PathBuf::from).collect::<Vec<_>>(), Path::new("out"));
    assert_eq!(paths(&["a.stl", "in/b.v2.stl"]), Ok(vec![PathBuf::from("out/a"), PathBuf::from("out/b.v2")]));
    for pair in [["a.stl", "other/a.obj"], ["Lid.stl", "lid.stl"]] {
        let refused = paths(&pair).expect_err("one folder for both");
        assert!(refused.exit_code() == 2 && pair.iter().all(|name| refused.to_string().contains(name)), "{refused}");
    }
    assert_eq!(paths(&[".."]).expect_err("no file").exit_code(), 2);
}

fn row(name: &str, error: Option<CliError>) -> PartRow {
    PartRow { error, ..PartRow::new(Path::new(name)) }
}

#[test]
fn the_exit_code_is_the_worst() {
    let of = |errors: &[Option<CliError>]| {
        let rows: Vec<PartRow> = errors.iter().map(|error| row("a.stl", error.clone())).collect();
        worst(&rows).map_or_else(|error| error.exit_code(), |()| 0)
    };
    let [no_plan, bad, failed, cancelled] = [
        CliError::NoPlan(String::new()),
        CliError::BadInput(String::new()),
        CliError::Failed(String::new()),
        CliError::Cancelled(String::new()),
    ]
    .map(Some);
    assert_eq!(of(&[None, None]), 0);
    assert_eq!(of(&[None, no_plan.clone(), None]), 3);
    assert_eq!(of(&[None, Some(CliError::RegionsUnmet(String::new()))]), 3);
    assert_eq!(of(&[no_plan.clone(), bad.clone()]), 2);
    assert_eq!(of(&[failed.clone(), bad.clone(), no_plan]), 1);
    assert_eq!(of(&[bad, failed, cancelled]), 4);
}

#[test]
fn the_table_has_a_line_a_part() {
    let planned = PartRow {
        views: Some(12),
        of_visible: Some(0.9876),
        cycle: Some("49.6 s (hans: 69.9 s)".to_owned()),
        ..row("housing.stl", None)
    };
    let told = table(&[planned, row("lid.stl", Some(CliError::NoPlan("why".into())))]);
    let wanted = "part         views  of visible                  cycle  result\n\
                  housing.stl     12     98.76 %  49.6 s (hans: 69.9 s)  planned\n\
                  lid.stl          –           –                      –  no plan\n";
    assert_eq!(told, wanted);
}

#[test]
fn a_share_below_the_whole_is_not_rounded_up_to_it() {
    let told = |of_visible: f64| table(&[PartRow { of_visible: Some(of_visible), ..row("lid.stl", None) }]);
    assert!(told(0.999_96).contains(" 99.99 %") && told(1.0).contains(" 100.00 %"), "{}", told(0.999_96));
}

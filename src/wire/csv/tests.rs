use super::Csv;

#[test]
fn cells_are_separated_and_rows_end_in_crlf() {
    let mut csv = Csv::new(&["a", "b", "c"]);
    csv.number(-1.5);
    csv.optional(None::<u8>);
    csv.text("plain");
    csv.end_row();
    assert_eq!(csv.finish(), "a,b,c\r\n-1.5,,plain\r\n");
}

#[test]
fn text_is_quoted_and_never_a_formula() {
    let mut csv = Csv::new(&["a"]);
    for cell in ["=1+1", "@x", "-2", "say \"so\"", "=a,b", "two\nlines"] {
        csv.text(cell);
        csv.end_row();
    }
    assert_eq!(csv.finish(), "a\r\n'=1+1\r\n'@x\r\n'-2\r\n\"say \"\"so\"\"\"\r\n\"'=a,b\"\r\n\"two\nlines\"\r\n");
}

use super::*;

#[test]
fn the_clock_tells_the_time_and_what_is_left() {
    assert_eq!(clock(72.9, 0.5), "1:12, about 1:12 left");
    assert_eq!(clock(0.4, 0.5), "0:00");
    assert_eq!(clock(5.0, 0.0), "0:05");
}

#[test]
fn the_clock_turns_over_at_whole_minutes_and_goes_on_after_an_hour() {
    for (secs, text) in [(59.9, "0:59"), (60.0, "1:00"), (3599.9, "59:59"), (3600.0, "60:00"), (7325.0, "122:05")] {
        assert_eq!(clock(secs, 0.0), text, "{secs} s");
    }
    assert_eq!(clock(60.0, 0.5), "1:00, about 1:00 left");
    assert_eq!(clock(60.0, 1.0), "1:00, about 0:00 left");
}

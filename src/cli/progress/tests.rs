use super::*;

#[test]
fn the_clock_tells_the_time_and_what_is_left() {
    assert_eq!(clock(72.9, 0.5), "1:12, about 1:12 left");
    assert_eq!(clock(0.4, 0.5), "0:00");
    assert_eq!(clock(5.0, 0.0), "0:05");
}

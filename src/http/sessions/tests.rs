//! Beginning and end of sessions.

use super::*;

#[test]
fn a_session_ends_when_it_is_ended_and_when_nobody_uses_it() {
    let (sessions, now) = (Sessions::default(), Instant::now());
    let [one, other] = [sessions.begin(now).expect("an id"), sessions.begin(now).expect("an id")];
    assert!(one.len() == 64 && one != other);
    assert!(sessions.is_open(&one, now) && sessions.is_open(&other, now));
    assert!(!sessions.is_open("", now) && !sessions.is_open(&one[1..], now));
    sessions.end(&one);
    assert!(!sessions.is_open(&one, now));
    let almost = IDLE_TIMEOUT - Duration::from_secs(1);
    assert!(sessions.is_open(&other, now + almost));
    assert!(sessions.is_open(&other, now + 2 * almost), "each use puts its end off");
    assert!(!sessions.is_open(&other, now + 2 * almost + IDLE_TIMEOUT));
    assert!(sessions.lock().is_empty());
}

#[test]
fn there_are_only_so_many_and_the_one_unused_for_longest_makes_room() {
    let (sessions, now) = (Sessions::default(), Instant::now());
    let at = |second: usize| now + Duration::from_secs(second as u64);
    let ids: Vec<String> = (0..MAX_SESSIONS).map(|second| sessions.begin(at(second)).expect("an id")).collect();
    assert!(sessions.is_open(&ids[0], at(MAX_SESSIONS)));
    sessions.begin(at(MAX_SESSIONS)).expect("an id");
    assert_eq!(sessions.lock().len(), MAX_SESSIONS);
    assert!(sessions.is_open(&ids[0], at(MAX_SESSIONS)) && !sessions.is_open(&ids[1], at(MAX_SESSIONS)));
}

#[test]
fn ids_are_not_stored() {
    let sessions = Sessions::default();
    let id = sessions.begin(Instant::now()).expect("an id");
    assert!(sessions.lock().keys().all(|stored| hex(stored) != id && *stored == hash(&id)));
}

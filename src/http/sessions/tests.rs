//! Beginning and end of sessions.

use super::*;

const KEY: KeyDigest = [7; 32];

fn is_open(sessions: &Sessions, id: &str, now: Instant) -> bool {
    sessions.key_of(id, now).is_some_and(|key| key == KEY)
}

#[test]
fn a_session_ends_when_it_is_ended_and_when_nobody_uses_it() {
    let (sessions, now) = (Sessions::default(), Instant::now());
    let [one, other] = [sessions.begin(KEY, now).expect("an id"), sessions.begin(KEY, now).expect("an id")];
    assert!(one.len() == 64 && one != other);
    assert!(is_open(&sessions, &one, now) && is_open(&sessions, &other, now));
    assert!(!is_open(&sessions, "", now) && !is_open(&sessions, &one[1..], now));
    sessions.end(&one);
    assert!(!is_open(&sessions, &one, now));
    let almost = IDLE_TIMEOUT - Duration::from_secs(1);
    assert!(is_open(&sessions, &other, now + almost));
    assert!(is_open(&sessions, &other, now + 2 * almost), "each use puts its end off");
    assert!(!is_open(&sessions, &other, now + 2 * almost + IDLE_TIMEOUT));
    assert!(sessions.lock().is_empty());
}

#[test]
fn a_look_at_a_session_does_not_put_its_end_off() {
    let (sessions, now) = (Sessions::default(), Instant::now());
    let id = sessions.begin(KEY, now).expect("an id");
    let almost = IDLE_TIMEOUT - Duration::from_secs(1);
    assert_eq!(sessions.begun_with(&id, now + almost), Some(KEY));
    assert_eq!(sessions.begun_with(&id, now + IDLE_TIMEOUT), None);
    sessions.end(&id);
    assert_eq!(sessions.begun_with(&id, now), None);
}

#[test]
fn there_are_only_so_many_and_the_one_unused_for_longest_makes_room() {
    let (sessions, now) = (Sessions::default(), Instant::now());
    let at = |second: usize| now + Duration::from_secs(second as u64);
    let ids: Vec<String> = (0..MAX_SESSIONS).map(|second| sessions.begin(KEY, at(second)).expect("an id")).collect();
    assert!(is_open(&sessions, &ids[0], at(MAX_SESSIONS)));
    sessions.begin(KEY, at(MAX_SESSIONS)).expect("an id");
    assert_eq!(sessions.lock().len(), MAX_SESSIONS);
    assert!(is_open(&sessions, &ids[0], at(MAX_SESSIONS)) && !is_open(&sessions, &ids[1], at(MAX_SESSIONS)));
}

#[test]
fn ids_are_not_stored() {
    let sessions = Sessions::default();
    let id = sessions.begin(KEY, Instant::now()).expect("an id");
    assert!(sessions.lock().keys().all(|stored| hex(stored) != id && *stored == hash(&id)));
}

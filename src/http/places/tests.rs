//! Who gets a place, and who loses one.

use super::*;

const A: IpAddr = IpAddr::V4(std::net::Ipv4Addr::new(10, 0, 0, 1));
const B: IpAddr = IpAddr::V4(std::net::Ipv4Addr::new(10, 0, 0, 2));

/// Whether the place was given to another connection.
async fn is_evicted(seat: &Seat) -> bool {
    tokio::time::timeout(Duration::from_millis(1), seat.evicted()).await.is_ok()
}

fn admitted(places: &Arc<Places>, address: IpAddr) -> Arc<Seat> {
    let seat = places.admit(address).expect("a place");
    assert_eq!(seat.full(), None);
    seat
}

#[tokio::test]
async fn the_connection_that_has_been_idle_longest_makes_room() {
    let places = Places::new(3, 3, Vec::new());
    let seats = [admitted(&places, A), admitted(&places, B), admitted(&places, A)];
    // The first has had a request since.
    drop(seats[0].request());
    let _next = admitted(&places, B);
    assert!(is_evicted(&seats[1]).await);
    assert!(!is_evicted(&seats[0]).await && !is_evicted(&seats[2]).await);
    let _next = admitted(&places, B);
    assert!(is_evicted(&seats[2]).await && !is_evicted(&seats[0]).await);
    assert_eq!(places.held(), 3);
}

#[tokio::test]
async fn an_address_beyond_its_share_pushes_out_itself() {
    let places = Places::new(10, 2, Vec::new());
    let other = admitted(&places, B);
    let own = [admitted(&places, A), admitted(&places, A)];
    let _third = admitted(&places, A);
    assert!(is_evicted(&own[0]).await && !is_evicted(&own[1]).await && !is_evicted(&other).await);
    assert_eq!(places.held(), 3);
}

#[tokio::test]
async fn what_is_in_use_keeps_its_place_and_the_next_gets_one_of_the_reserve() {
    let places = Places::new(3, 2, Vec::new());
    let seats = [admitted(&places, A), admitted(&places, A), admitted(&places, B)];
    let _open: Vec<_> = seats.iter().map(Seat::request).collect();
    assert_eq!(places.admit(A).expect("of the reserve").full(), Some(Full::Address));
    assert_eq!(places.admit(B).expect("of the reserve").full(), Some(Full::Server));
    for seat in &seats {
        assert!(!is_evicted(seat).await);
    }
}

#[test]
fn a_proxy_speaks_for_many_and_has_no_share() {
    let places = Places::new(100, 2, vec![A]);
    let _open: Vec<_> = (0..50).map(|_| admitted(&places, A).request()).collect();
    assert_eq!(places.held(), 50);
}

#[tokio::test]
async fn one_address_does_not_fill_the_reserve() {
    let places = Places::new(1, 1, Vec::new());
    let _open = admitted(&places, A).request();
    let seats: Vec<_> = (0..RESERVE_PER_ADDRESS).map(|_| places.admit(A).expect("of the reserve")).collect();
    let _next = places.admit(A).expect("that of its own first");
    assert!(is_evicted(&seats[0]).await);
    let _asking: Vec<_> = seats[1..].iter().map(Seat::request).collect();
    let _last = _next.request();
    assert_eq!(places.admit(A).err(), Some(Full::Address));
    assert!(places.admit(B).is_ok());
}

#[tokio::test]
async fn a_body_that_stalls_costs_the_place_when_nothing_is_idle() {
    let places = Places::new(2, 2, Vec::new());
    let seats = [admitted(&places, A), admitted(&places, A)];
    let _requests = [seats[0].request(), seats[1].request()];
    let body = seats[0].body();
    // It has only just begun.
    assert_eq!(places.admit(B).expect("of the reserve").full(), Some(Full::Server));
    tokio::time::sleep(STALLED + Duration::from_millis(200)).await;
    body.progress();
    assert_eq!(places.admit(B).expect("of the reserve").full(), Some(Full::Server));
    tokio::time::sleep(STALLED + Duration::from_millis(200)).await;
    let _admitted = admitted(&places, B);
    assert!(is_evicted(&seats[0]).await && !is_evicted(&seats[1]).await);
}

#[tokio::test]
async fn an_answer_that_is_being_taken_is_in_use() {
    let places = Places::new(1, 1, Vec::new());
    let seat = admitted(&places, A);
    drop(seat.request());
    seat.writing.store(true, Ordering::Relaxed);
    assert_eq!(places.admit(B).expect("of the reserve").full(), Some(Full::Server));
    seat.writing.store(false, Ordering::Relaxed);
    let _admitted = admitted(&places, B);
    assert!(is_evicted(&seat).await);
}

#[test]
fn a_place_is_given_back_once() {
    let places = Places::new(1, 1, Vec::new());
    let seat = admitted(&places, A);
    let request = seat.request();
    let body = seat.body();
    seat.leave();
    seat.leave();
    drop((request, body));
    assert_eq!(places.held(), 0);
    let _next = admitted(&places, A);
    assert_eq!(places.held(), 1);
    assert_eq!(places.lock().addresses.len(), 1);
}

#[tokio::test]
async fn idleness_is_counted_from_the_last_request() {
    let places = Places::new(1, 1, Vec::new());
    let seat = admitted(&places, A);
    let (short, long) = (Duration::from_millis(50), Duration::from_millis(300));
    let began = Instant::now();
    seat.idle_for(began, short, long).await;
    assert!(began.elapsed() < long, "the time before the first request counts");
    let request = seat.request();
    assert!(tokio::time::timeout(2 * long, seat.idle_for(began, short, long)).await.is_err(), "a request is open");
    drop(request);
    let ended = Instant::now();
    seat.idle_for(began, short, long).await;
    assert!(ended.elapsed() >= long);
}

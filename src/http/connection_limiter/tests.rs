//! Admission and eviction.

use super::*;

const A: IpAddr = IpAddr::V4(std::net::Ipv4Addr::new(10, 0, 0, 1));
const B: IpAddr = IpAddr::V4(std::net::Ipv4Addr::new(10, 0, 0, 2));

/// Returns true if the connection was evicted.
async fn is_evicted(slot: &ConnectionSlot) -> bool {
    tokio::time::timeout(Duration::from_millis(1), slot.evicted()).await.is_ok()
}

fn admitted(limiter: &Arc<ConnectionLimiter>, address: IpAddr) -> Arc<ConnectionSlot> {
    let slot = limiter.admit(address).expect("a slot");
    assert_eq!(slot.exceeded_limit(), None);
    slot
}

#[tokio::test]
async fn the_connection_that_has_been_idle_longest_makes_room() {
    let limiter = ConnectionLimiter::new(2, 3, Vec::new());
    let slots = [admitted(&limiter, A), admitted(&limiter, B)];
    // The first has had a request since.
    drop(slots[0].begin_request());
    let next = admitted(&limiter, B);
    assert!(is_evicted(&slots[1]).await && !is_evicted(&slots[0]).await);
    let _next = admitted(&limiter, B);
    assert!(is_evicted(&slots[0]).await && !is_evicted(&next).await);
    assert_eq!(limiter.held(), 2);
}

#[tokio::test]
async fn the_address_with_the_most_idle_connections_makes_room() {
    let limiter = ConnectionLimiter::new(4, 3, Vec::new());
    let of_b = admitted(&limiter, B);
    let of_a = [admitted(&limiter, A), admitted(&limiter, A), admitted(&limiter, A)];
    let _used = of_a[0].begin_request();
    let _next = limiter.admit(IpAddr::V4(std::net::Ipv4Addr::new(10, 0, 0, 3))).expect("a slot");
    assert!(is_evicted(&of_a[1]).await, "idle for longest of those of A");
    assert!(!is_evicted(&of_b).await && !is_evicted(&of_a[0]).await && !is_evicted(&of_a[2]).await);
}

#[tokio::test]
async fn an_address_beyond_its_share_pushes_out_itself() {
    let limiter = ConnectionLimiter::new(10, 2, Vec::new());
    let other = admitted(&limiter, B);
    let own = [admitted(&limiter, A), admitted(&limiter, A)];
    let _third = admitted(&limiter, A);
    assert!(is_evicted(&own[0]).await && !is_evicted(&own[1]).await && !is_evicted(&other).await);
    assert_eq!(limiter.held(), 3);
}

#[tokio::test]
async fn what_is_in_use_keeps_its_place_and_the_next_gets_one_of_the_reserve() {
    let limiter = ConnectionLimiter::new(3, 2, Vec::new());
    let slots = [admitted(&limiter, A), admitted(&limiter, A), admitted(&limiter, B)];
    let _open: Vec<_> = slots.iter().map(ConnectionSlot::begin_request).collect();
    assert_eq!(limiter.admit(A).expect("of the reserve").exceeded_limit(), Some(ExceededLimit::Address));
    assert_eq!(limiter.admit(B).expect("of the reserve").exceeded_limit(), Some(ExceededLimit::Server));
    for slot in &slots {
        assert!(!is_evicted(slot).await);
    }
}

#[test]
fn a_proxy_speaks_for_many_and_has_no_share() {
    let limiter = ConnectionLimiter::new(100, 2, vec![A.into()]);
    let _open: Vec<_> = (0..50).map(|_| admitted(&limiter, A).begin_request()).collect();
    assert_eq!(limiter.held(), 50);
}

#[test]
fn the_addresses_of_an_ipv6_client_have_one_share() {
    let address = |text: &str| text.parse::<IpAddr>().expect("an address");
    let proxy = address("2001:db8::aa");
    let limiter = ConnectionLimiter::new(100, 2, vec![proxy.into()]);
    // The proxy's connections, which serve many, are not those of its neighbours.
    let _of_proxy: Vec<_> = (0..5).map(|_| admitted(&limiter, proxy).begin_request()).collect();
    let _own = ["2001:db8::1", "2001:db8::ffff:0:0:2"].map(|text| admitted(&limiter, address(text)).begin_request());
    let third = limiter.admit(address("2001:db8::3")).expect("of the reserve");
    assert_eq!(third.exceeded_limit(), Some(ExceededLimit::Address));
    let _next_network = admitted(&limiter, address("2001:db8:0:1::1"));
    let _mapped = ["10.0.0.1", "::ffff:10.0.0.1"].map(|text| admitted(&limiter, address(text)).begin_request());
    assert_eq!(limiter.admit(A).expect("of the reserve").exceeded_limit(), Some(ExceededLimit::Address));
}

#[tokio::test]
async fn one_address_does_not_fill_the_reserve() {
    let limiter = ConnectionLimiter::new(1, 1, Vec::new());
    let _open = admitted(&limiter, A).begin_request();
    let slots: Vec<_> = (0..RESERVED_PER_ADDRESS).map(|_| limiter.admit(A).expect("of the reserve")).collect();
    let _next = limiter.admit(A).expect("that of its own first");
    assert!(is_evicted(&slots[0]).await);
    let _asking: Vec<_> = slots[1..].iter().map(ConnectionSlot::begin_request).collect();
    let _last = _next.begin_request();
    assert_eq!(limiter.admit(A).err(), Some(ExceededLimit::Address));
    assert!(limiter.admit(B).is_ok());
}

#[tokio::test]
#[ignore = "long: tests/all runs it"]
async fn a_body_that_stalls_costs_the_place_when_nothing_is_idle() {
    let limiter = ConnectionLimiter::new(2, 2, Vec::new());
    let slots = [admitted(&limiter, A), admitted(&limiter, A)];
    let _requests = [slots[0].begin_request(), slots[1].begin_request()];
    let body = slots[0].begin_body();
    // It has only just begun.
    assert_eq!(limiter.admit(B).expect("of the reserve").exceeded_limit(), Some(ExceededLimit::Server));
    tokio::time::sleep(STALLED + Duration::from_millis(200)).await;
    body.progress();
    assert_eq!(limiter.admit(B).expect("of the reserve").exceeded_limit(), Some(ExceededLimit::Server));
    tokio::time::sleep(STALLED + Duration::from_millis(200)).await;
    let _admitted = admitted(&limiter, B);
    assert!(is_evicted(&slots[0]).await && !is_evicted(&slots[1]).await);
}

#[tokio::test]
async fn an_answer_that_is_being_taken_is_in_use() {
    let limiter = ConnectionLimiter::new(1, 1, Vec::new());
    let slot = admitted(&limiter, A);
    drop(slot.begin_request());
    slot.writing.store(true, Ordering::Relaxed);
    assert_eq!(limiter.admit(B).expect("of the reserve").exceeded_limit(), Some(ExceededLimit::Server));
    slot.writing.store(false, Ordering::Relaxed);
    let _admitted = admitted(&limiter, B);
    assert!(is_evicted(&slot).await);
}

#[test]
fn a_place_is_given_back_once() {
    let limiter = ConnectionLimiter::new(1, 1, Vec::new());
    let slot = admitted(&limiter, A);
    let request = slot.begin_request();
    let body = slot.begin_body();
    slot.release();
    slot.release();
    drop((request, body));
    assert_eq!(limiter.held(), 0);
    let _next = admitted(&limiter, A);
    assert_eq!(limiter.held(), 1);
    assert_eq!(limiter.lock().clients.len(), 1);
}

#[tokio::test]
async fn idleness_is_counted_from_the_last_request() {
    let limiter = ConnectionLimiter::new(1, 1, Vec::new());
    let slot = admitted(&limiter, A);
    let (short, long) = (Duration::from_millis(50), Duration::from_millis(300));
    let began = Instant::now();
    slot.idle_for(began, short, long).await;
    assert!(began.elapsed() < long, "the time before the first request counts");
    let request = slot.begin_request();
    assert!(tokio::time::timeout(2 * long, slot.idle_for(began, short, long)).await.is_err(), "a request is open");
    drop(request);
    let ended = Instant::now();
    slot.idle_for(began, short, long).await;
    assert!(ended.elapsed() >= long);
}

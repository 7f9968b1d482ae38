use std::time::Duration;

use tokio::time::advance;

use super::{Fence, LeaseError, Leases};

const TTL: Duration = Duration::from_secs(2);

#[tokio::test(start_paused = true)]
async fn one_holder_at_a_time_with_tokens_that_rise() {
    let leases = Leases::after(Fence(41));
    let first = leases.acquire("a", "one", TTL).expect("free");
    assert_eq!(first.token, Fence(42));
    assert!(matches!(leases.acquire("a", "two", TTL), Err(LeaseError::Held { remaining, .. }) if remaining == TTL));
    assert!(matches!(leases.acquire("a", "one", TTL), Err(LeaseError::Held { .. })), "not twice by one either");
    assert_eq!(leases.acquire("b", "two", TTL).expect("another cell").token, Fence(43));
    advance(TTL - Duration::from_millis(1)).await;
    leases.renew("a", first.token).expect("in time");
    advance(TTL - Duration::from_millis(1)).await;
    leases.check("a", first.token).expect("renewed");
    advance(Duration::from_millis(1)).await;
    assert_eq!(leases.renew("a", first.token), Err(LeaseError::Expired { cell: "a".into(), token: first.token }));
    assert_eq!(leases.current("a"), None);
    let second = leases.acquire("a", "two", TTL).expect("free again");
    assert!(second.token > first.token);
    assert!(matches!(leases.check("a", first.token), Err(LeaseError::WrongToken { .. })));
    assert!(leases.release("a", first.token).is_err());
    leases.release("a", second.token).expect("its own");
    assert_eq!(leases.current("a"), None);
}

/// A holder without a name was told as nobody: `is leased to  for`.
#[tokio::test(start_paused = true)]
async fn a_holder_is_told_with_the_time_that_is_left() {
    let leases = Leases::default();
    for (cell, holder, told) in [("a", "line 3", "line 3"), ("b", "", "another client")] {
        leases.acquire(cell, holder, TTL).expect("free");
        let said = leases.acquire(cell, "two", TTL).expect_err("held").to_string();
        assert_eq!(said, format!("cell {cell} is leased to {told} for another 2000 ms, longer if they renew it"));
    }
}

#[tokio::test(start_paused = true)]
async fn a_lease_has_a_time_within_bounds() {
    let leases = Leases::default();
    for ttl in [Duration::from_millis(199), Duration::from_millis(30_001)] {
        let refused = leases.acquire("a", "one", ttl).expect_err("out of bounds");
        assert_eq!(refused, LeaseError::Ttl(ttl));
        let told = format!("a lease lasts 200 to 30000 ms, not {} ms; set execution.lease_secs within that", ttl.as_millis());
        assert_eq!(refused.to_string(), told);
    }
}

#[tokio::test(start_paused = true)]
async fn a_lease_that_ended_is_not_kept_for_ever() {
    let leases = Leases::default();
    for cell in 0..100 {
        leases.acquire(&format!("cell-{cell}"), "one", TTL).expect("free");
    }
    advance(TTL + super::KEPT_AFTER_END).await;
    leases.acquire("another", "one", TTL).expect("free");
    assert_eq!(leases.table().of_cell.len(), 1);
}

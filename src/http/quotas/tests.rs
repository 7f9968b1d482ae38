//! Limits of one client and of all clients.

use super::*;
use crate::http::problem::Code;

fn client(last: u8) -> Client {
    Client { address: [10, 0, 0, last].into(), is_https: false }
}

#[test]
fn one_client_s_limit_is_its_own_and_the_total_is_everybody_s() {
    let (quotas, options) = (Arc::<Quotas>::default(), ServerOptions::for_tests());
    let options = ServerOptions { uploads: Quota { total: 3, per_address: 2 }, ..options };
    let acquire = |last: u8| quotas.acquire(Resource::Uploads, client(last), &options).map_err(|error| error.code());
    let own = [acquire(1).expect("one"), acquire(1).expect("two")];
    assert_eq!(acquire(1).err(), Some(Code::TooManyRequests));
    let other = acquire(2).expect("three");
    assert_eq!(acquire(2).err(), Some(Code::Busy));
    // Another resource is not affected.
    let _stream = quotas.acquire(Resource::EventStreams, client(1), &options).map_err(|error| error.code()).expect("a stream");
    drop(own);
    let _again = acquire(2).expect("given back");
    drop((other, _again));
    assert!(quotas.lock(Resource::Uploads).by_client.is_empty());
    assert_eq!(quotas.lock(Resource::Uploads).total, 0);
}

/// Every host has all of its /64 (RFC 6177), so a limit per address would be none.
#[test]
fn the_addresses_of_an_ipv6_client_have_one_share() {
    let (quotas, options) = (Arc::<Quotas>::default(), ServerOptions::for_tests());
    let proxy = "2001:db8::aa";
    let options = ServerOptions {
        uploads: Quota { total: 9, per_address: 2 },
        trusted_proxies: vec![proxy.parse().expect("a network")],
        ..options
    };
    let acquire = |address: &str| {
        let client = Client { address: address.parse().expect("an address"), is_https: false };
        quotas.acquire(Resource::Uploads, client, &options).map_err(|error| (error.code(), format!("{error:?}")))
    };
    let _own = [acquire("2001:db8::1").expect("one"), acquire("2001:db8::ffff:0:0:2").expect("two")];
    let (code, told) = acquire("2001:db8::3").err().expect("its share is used");
    assert_eq!(code, Code::TooManyRequests);
    assert!(told.contains("2001:db8::/64 has 2 uploads open"), "{told}");
    // The next network, and a proxy for others in the same one.
    let _others = [acquire("2001:db8:0:1::1").expect("another"), acquire(proxy).expect("its own"), acquire(proxy).expect("too")];
    let _mapped = [acquire("::ffff:10.0.0.1").expect("one"), acquire("10.0.0.1").expect("two")];
    for same in ["10.0.0.1", "::ffff:10.0.0.1"] {
        assert_eq!(acquire(same).err().map(|(code, _)| code), Some(Code::TooManyRequests), "{same}");
    }
    let _next = acquire("10.0.0.2").expect("another IPv4 address");
}

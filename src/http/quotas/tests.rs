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
    assert!(quotas.lock(Resource::Uploads).by_address.is_empty());
    assert_eq!(quotas.lock(Resource::Uploads).total, 0);
}

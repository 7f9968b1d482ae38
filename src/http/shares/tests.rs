//! Whose share is used up when.

use super::*;
use crate::http::problem::Code;

fn client(last: u8) -> Client {
    Client { address: [10, 0, 0, last].into(), is_https: false }
}

#[test]
fn a_share_is_one_client_s_own_and_the_whole_is_everybody_s() {
    let (shares, options) = (Arc::<Shares>::default(), Options::for_tests());
    let options = Options { uploads: Quota { total: 3, per_address: 2 }, ..options };
    let take = |last: u8| shares.take(Kind::Uploads, client(last), &options).map_err(|problem| problem.code());
    let own = [take(1).expect("one"), take(1).expect("two")];
    assert_eq!(take(1).err(), Some(Code::TooManyRequests));
    let other = take(2).expect("three");
    assert_eq!(take(2).err(), Some(Code::Busy));
    // Another kind is not touched by it.
    let _stream = shares.take(Kind::EventStreams, client(1), &options).map_err(|problem| problem.code()).expect("a stream");
    drop(own);
    let _again = take(2).expect("given back");
    drop((other, _again));
    assert!(shares.lock(Kind::Uploads).by_address.is_empty());
    assert_eq!(shares.lock(Kind::Uploads).total, 0);
}

//! Datagrams of two hosts, of which one is the controller's: on Linux the whole of 127.0.0.0/8 is this machine.
#![cfg(target_os = "linux")]

use super::*;
use crate::execution::drivers::there_and_back::KeptWords;

/// Datagrams of the controller of `host`, a log, and sockets of 127.0.0.1 and 127.0.0.2.
async fn datagrams(host: Option<&str>) -> (Datagrams, Arc<KeptWords>, [UdpSocket; 2]) {
    let (log, host) = (KeptWords::new(), host.map(|host| host.parse().expect("an address")));
    let datagrams = Datagrams::bind("127.0.0.1:0", host, log.clone(), "arm").await.expect("a socket");
    let of_one = UdpSocket::bind("127.0.0.1:0").await.expect("a socket");
    let of_two = UdpSocket::bind("127.0.0.2:0").await.expect("a socket");
    let here = datagrams.socket.local_addr().expect("an address");
    for socket in [&of_one, &of_two] {
        socket.connect(here).await.expect("an address");
    }
    (datagrams, log, [of_one, of_two])
}

/// The host that had been taken was told nowhere.
#[tokio::test]
async fn without_a_host_the_first_that_sends_is_taken_and_noted_and_no_other_takes_over() {
    let (mut datagrams, log, [first, second]) = datagrams(None).await;
    first.send(b"first").await.expect("sent");
    assert_eq!(datagrams.receive().await, Ok(&b"first"[..]));
    for _ in 0..3 {
        second.send(b"second").await.expect("sent");
    }
    first.send(b"again").await.expect("sent");
    assert_eq!(datagrams.receive().await, Ok(&b"again"[..]));
    datagrams.send(b"answer").await.expect("sent");
    let mut answer = [0; 16];
    assert_eq!(first.recv(&mut answer).await.expect("an answer"), 6, "to the first");
    let taken = "arm: datagrams are taken from 127.0.0.1 alone, which sent first: the cell file has no controller_host";
    let refused = "arm: datagrams from 127.0.0.2 are refused: the controller is 127.0.0.1";
    assert_eq!(log.noted(), [taken, refused], "each once");
}

#[tokio::test]
async fn another_host_than_that_of_the_cell_file_is_refused_and_noted_though_it_sends_first() {
    let (mut datagrams, log, [other, controller]) = datagrams(Some("127.0.0.2")).await;
    other.send(b"other").await.expect("sent");
    controller.send(b"report").await.expect("sent");
    assert_eq!(datagrams.receive().await, Ok(&b"report"[..]));
    assert_eq!(log.noted(), ["arm: datagrams from 127.0.0.1 are refused: the controller is 127.0.0.2"]);
}

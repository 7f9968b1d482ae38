//! Datagrams from one controller, which sends first, and answers to it.

use std::io;
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;

use tokio::net::UdpSocket;

use crate::execution::device::{DeviceError, Direction, WireLog};

/// Largest datagram, bytes.
const MAX_BYTES: usize = 65_507;

/// Socket for the datagrams of one controller.
pub(super) struct Datagrams {
    socket: UdpSocket,
    /// Host that may send; without one, the first that does.
    host: Option<IpAddr>,
    /// True once another host was refused, which is noted once.
    has_refused: bool,
    peer: Option<SocketAddr>,
    /// The newest datagram.
    newest: Vec<u8>,
    /// Room for the next.
    next: Vec<u8>,
    log: Arc<dyn WireLog>,
    device: &'static str,
}

impl Datagrams {
    /// Binds an address of this machine.
    pub(super) async fn bind(
        address: &str,
        host: Option<IpAddr>,
        log: Arc<dyn WireLog>,
        device: &'static str,
    ) -> Result<Self, DeviceError> {
        let unbound = |error: io::Error| DeviceError::Unbound { address: address.to_owned(), reason: error.to_string() };
        let socket = UdpSocket::bind(address).await.map_err(unbound)?;
        let (host, has_refused, peer) = (host.map(|host| host.to_canonical()), false, None);
        Ok(Self { socket, host, has_refused, peer, newest: vec![0; MAX_BYTES], next: vec![0; MAX_BYTES], log, device })
    }

    /// Returns true of the controller's host. The first that sends is taken for it where the cell file names none; from then on no other
    /// is. Who was taken, and the first who was refused, is noted.
    fn is_controller(&mut self, host: IpAddr) -> bool {
        if self.host.is_none() {
            let words = format!("datagrams are taken from {host} alone, which sent first: the cell file has no controller_host");
            self.log.note(self.device, &words);
        }
        let controller = *self.host.get_or_insert(host);
        if controller != host && !std::mem::replace(&mut self.has_refused, true) {
            self.log.note(self.device, &format!("datagrams from {host} are refused: the controller is {controller}"));
        }
        controller == host
    }

    /// Waits for the controller's next datagram, and returns the newest of those that are here: an answer to one that another has
    /// overtaken comes too late. May be dropped while it waits. Those of others are skipped.
    pub(super) async fn receive(&mut self) -> Result<&[u8], DeviceError> {
        let mut newest_bytes = None;
        loop {
            let received = match newest_bytes {
                None => self.socket.recv_from(&mut self.next).await,
                Some(_) => self.socket.try_recv_from(&mut self.next),
            };
            match (received, newest_bytes) {
                (Ok((length, from)), _) if self.is_controller(from.ip().to_canonical()) => {
                    self.log.record(self.device, Direction::Received, &self.next[..length]);
                    std::mem::swap(&mut self.newest, &mut self.next);
                    (self.peer, newest_bytes) = (Some(from), Some(length));
                }
                (Ok(_), _) => {}
                (Err(error), Some(length)) if error.kind() == io::ErrorKind::WouldBlock => return Ok(&self.newest[..length]),
                (Err(error), _) => return Err(closed(&error)),
            }
        }
    }

    /// Answers where the latest datagram came from.
    pub(super) async fn send(&self, datagram: &[u8]) -> Result<(), DeviceError> {
        if let Some(peer) = self.peer {
            self.log.record(self.device, Direction::Sent, datagram);
            self.socket.send_to(datagram, peer).await.map_err(|error| closed(&error))?;
        }
        Ok(())
    }
}

fn closed(error: &io::Error) -> DeviceError {
    DeviceError::Closed { reason: error.to_string() }
}

#[cfg(test)]
mod tests;

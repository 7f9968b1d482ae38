//! A network in memory, below the drivers and the simulators, with every delay from a seed: it delays, splits, holds, loses, cuts,
//! garbles and refuses. On a clock that is paused a run is the same each time.
//!
//! A stream that is dropped sends nothing more, as the drivers' sockets do: bytes that a held network has not let through are gone.

use std::collections::VecDeque;
use std::io;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker};
use std::time::Duration;

use futures_util::future::BoxFuture;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::sync::watch;
use tokio::time::{Instant, Sleep, sleep};

use super::rehearsal::Chance;
use crate::execution::drivers::stream::{ByteStream, Dialer};

/// Treatment of connections by a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Passage {
    /// Bytes pass.
    Open,
    /// Bytes wait until it opens again.
    Held,
    /// Connections are half open: whatever is sent on them is lost, now and later, and neither side is told.
    Lost,
    /// Connections are cut and none are taken.
    Refused,
}

/// Conditions of a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Weather {
    pub(crate) passage: Passage,
    /// Longest delay of a piece, ms.
    pub(crate) max_delay_ms: u64,
    /// Most pieces that a message comes in.
    pub(crate) max_pieces: u64,
    /// Bytes are changed.
    pub(crate) is_garbled: bool,
}

impl Weather {
    pub(crate) const FAIR: Self = Self { passage: Passage::Open, max_delay_ms: 1, max_pieces: 1, is_garbled: false };
}

/// The network of one device.
pub(crate) struct RoughNetwork {
    weather: watch::Sender<Weather>,
    /// Both directions of each connection.
    pipes: Mutex<Vec<Arc<Mutex<Pipe>>>>,
    chance: Mutex<Chance>,
    serve: Box<dyn Fn(NetworkEnd) + Send + Sync>,
}

/// One direction of a connection.
#[derive(Default)]
struct Pipe {
    pieces: VecDeque<(Instant, Vec<u8>)>,
    has_ended: bool,
    is_cut: bool,
    is_lost: bool,
    reader: Option<Waker>,
}

impl Pipe {
    fn wake(&mut self) {
        if let Some(reader) = self.reader.take() {
            reader.wake();
        }
    }
}

/// One end of a connection.
pub(crate) struct NetworkEnd {
    network: Arc<RoughNetwork>,
    reads: Arc<Mutex<Pipe>>,
    writes: Arc<Mutex<Pipe>>,
    chance: Chance,
    alarm: Pin<Box<Sleep>>,
}

impl RoughNetwork {
    /// A network in which `serve` gets the device's end of each connection.
    pub(crate) fn new(seed: u64, serve: impl Fn(NetworkEnd) + Send + Sync + 'static) -> Arc<Self> {
        let (weather, chance) = (watch::Sender::new(Weather::FAIR), Mutex::new(Chance(seed)));
        Arc::new(Self { weather, pipes: Mutex::default(), chance, serve: Box::new(serve) })
    }

    pub(crate) fn weather(&self) -> Weather {
        *self.weather.borrow()
    }

    pub(crate) fn set_weather(&self, weather: Weather) {
        self.weather.send_replace(weather);
        match weather.passage {
            Passage::Lost => self.each_pipe(|pipe| pipe.is_lost = true),
            Passage::Refused => self.cut(),
            Passage::Open | Passage::Held => {}
        }
        self.each_pipe(Pipe::wake);
    }

    pub(crate) fn set_passage(&self, passage: Passage) {
        self.set_weather(Weather { passage, ..self.weather() });
    }

    /// Cuts every connection, and loses what is under way.
    pub(crate) fn cut(&self) {
        self.each_pipe(|pipe| {
            pipe.is_cut = true;
            pipe.pieces.clear();
            pipe.wake();
        });
    }

    fn each_pipe(&self, change: impl Fn(&mut Pipe)) {
        let mut pipes = lock(&self.pipes);
        pipes.retain(|pipe| Arc::strong_count(pipe) > 1);
        pipes.iter().for_each(|pipe| change(&mut lock(pipe)));
    }

    fn connect(self: &Arc<Self>) -> NetworkEnd {
        let (there, back) = (Arc::<Mutex<Pipe>>::default(), Arc::<Mutex<Pipe>>::default());
        lock(&self.pipes).extend([Arc::clone(&there), Arc::clone(&back)]);
        let end = |reads: &Arc<Mutex<Pipe>>, writes: &Arc<Mutex<Pipe>>| NetworkEnd {
            network: Arc::clone(self),
            reads: Arc::clone(reads),
            writes: Arc::clone(writes),
            chance: Chance(lock(&self.chance).next()),
            alarm: Box::pin(sleep(Duration::ZERO)),
        };
        (self.serve)(end(&there, &back));
        end(&back, &there)
    }
}

/// Dials into a network, whatever the address.
pub(crate) struct NetworkDialer(pub(crate) Arc<RoughNetwork>);

impl Dialer for NetworkDialer {
    fn dial<'a>(&'a self, _address: &'a str) -> BoxFuture<'a, io::Result<Box<dyn ByteStream>>> {
        Box::pin(async move {
            let mut weather = self.0.weather.subscribe();
            sleep(Duration::from_millis(1)).await;
            let passes = |weather: &Weather| matches!(weather.passage, Passage::Open | Passage::Refused);
            let found = weather.wait_for(passes).await.map(|weather| weather.passage);
            match found {
                Ok(Passage::Open) => Ok(Box::new(self.0.connect()) as Box<dyn ByteStream>),
                Ok(Passage::Held | Passage::Lost | Passage::Refused) | Err(_) => Err(io::ErrorKind::ConnectionRefused.into()),
            }
        })
    }
}

impl AsyncRead for NetworkEnd {
    fn poll_read(self: Pin<&mut Self>, cx: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let this = self.get_mut();
        let is_held = this.network.weather().passage == Passage::Held;
        let mut pipe = lock(&this.reads);
        if pipe.is_cut {
            return Poll::Ready(Err(io::ErrorKind::ConnectionReset.into()));
        }
        pipe.reader = Some(cx.waker().clone());
        if is_held || pipe.is_lost {
            return Poll::Pending;
        }
        let Some((at, bytes)) = pipe.pieces.front_mut() else {
            return if pipe.has_ended { Poll::Ready(Ok(())) } else { Poll::Pending };
        };
        if *at > Instant::now() {
            this.alarm.as_mut().reset(*at);
            if this.alarm.as_mut().poll(cx).is_pending() {
                return Poll::Pending;
            }
        }
        let taken = bytes.len().min(buffer.remaining());
        buffer.put_slice(&bytes[..taken]);
        bytes.drain(..taken);
        if bytes.is_empty() {
            pipe.pieces.pop_front();
        }
        Poll::Ready(Ok(()))
    }
}

impl AsyncWrite for NetworkEnd {
    fn poll_write(self: Pin<&mut Self>, _cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let this = self.get_mut();
        let Weather { max_delay_ms, max_pieces, is_garbled, .. } = this.network.weather();
        let mut pipe = lock(&this.writes);
        if pipe.is_cut {
            return Poll::Ready(Err(io::ErrorKind::BrokenPipe.into()));
        }
        if pipe.is_lost || bytes.is_empty() {
            return Poll::Ready(Ok(bytes.len()));
        }
        let chance = &mut this.chance;
        let pieces = 1 + chance.of(max_pieces.min(bytes.len() as u64)) as usize;
        for piece in bytes.chunks(bytes.len().div_ceil(pieces)) {
            let soonest = Instant::now() + Duration::from_millis(1 + chance.of(max_delay_ms));
            let at = pipe.pieces.back().map_or(soonest, |(last, _)| soonest.max(*last));
            let mut piece = piece.to_vec();
            if is_garbled {
                let place = chance.of(piece.len() as u64) as usize;
                piece[place] ^= 0x15;
            }
            pipe.pieces.push_back((at, piece));
        }
        pipe.wake();
        Poll::Ready(Ok(bytes.len()))
    }

    fn poll_flush(self: Pin<&mut Self>, _cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }

    fn poll_shutdown(self: Pin<&mut Self>, _cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        let mut pipe = lock(&self.writes);
        pipe.has_ended = true;
        pipe.wake();
        Poll::Ready(Ok(()))
    }
}

impl Drop for NetworkEnd {
    fn drop(&mut self) {
        let is_held = self.network.weather().passage == Passage::Held;
        let mut pipe = lock(&self.writes);
        if is_held {
            pipe.pieces.clear();
        }
        pipe.has_ended = true;
        pipe.wake();
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use tokio::io::{AsyncReadExt, AsyncWriteExt};

    use super::*;

    /// A network that echoes.
    fn echo(seed: u64) -> Arc<RoughNetwork> {
        RoughNetwork::new(seed, |end| {
            tokio::spawn(async move {
                let (mut reads, mut writes) = tokio::io::split(end);
                tokio::io::copy(&mut reads, &mut writes).await
            });
        })
    }

    #[tokio::test(start_paused = true)]
    async fn bytes_come_whole_and_in_order_whatever_the_delays_and_the_same_from_a_seed() {
        let mut took = Vec::new();
        for seed in [1, 1, 2] {
            let (network, began) = (echo(seed), Instant::now());
            network.set_weather(Weather { max_delay_ms: 30, max_pieces: 7, ..Weather::FAIR });
            let mut end = NetworkDialer(network).dial("").await.expect("open");
            let sent: Vec<u8> = (0..=255).collect();
            end.write_all(&sent).await.expect("taken");
            let mut received = vec![0; 256];
            end.read_exact(&mut received).await.expect("echoed");
            assert_eq!(received, sent);
            took.push(began.elapsed());
        }
        assert!(took[0] == took[1] && took[0] != took[2], "{took:?}");
    }

    #[tokio::test(start_paused = true)]
    async fn held_bytes_pass_later_lost_ones_never_and_cut_connections_say_so() {
        let network = echo(3);
        let mut end = NetworkDialer(Arc::clone(&network)).dial("").await.expect("open");
        let wait = Duration::from_secs(5);
        for (passage, passes) in [(Passage::Held, true), (Passage::Lost, false)] {
            network.set_passage(passage);
            end.write_all(b"held").await.expect("taken");
            let mut received = [0; 4];
            assert!(tokio::time::timeout(wait, end.read_exact(&mut received)).await.is_err());
            network.set_passage(Passage::Open);
            assert_eq!(tokio::time::timeout(wait, end.read_exact(&mut received)).await.is_ok(), passes);
        }
        let mut end = NetworkDialer(Arc::clone(&network)).dial("").await.expect("open");
        network.set_passage(Passage::Refused);
        assert!(end.read_u8().await.is_err());
        assert!(NetworkDialer(network).dial("").await.is_err());
    }
}

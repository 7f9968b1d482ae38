//! Places of connections. There are so many in all and so many for one address; a few more are a reserve in which only
//! the probes are answered, so that the server can be watched while every place is held.
//!
//! Who has a place and uses it keeps it. When places are short, the connection that has gone without a request for the
//! longest time loses its own: one that never sent a whole request head, one that is kept alive. When there is none, the
//! one whose request's body has made no headway for longest. So a client that opens connections and stalls pushes out
//! itself, not others.

use std::collections::{BTreeMap, HashMap};
use std::net::IpAddr;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::Notify;

/// Places for connections beyond all others, in which only probes are answered.
pub const RESERVE: usize = 64;
/// Places of the reserve that one address may hold.
const RESERVE_PER_ADDRESS: usize = 8;
/// A body that has made no headway for this long may cost its connection the place.
const STALLED: Duration = Duration::from_secs(1);

/// What is full, so that a connection got a place of the reserve, or none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Full {
    /// The share of its address.
    Address,
    /// The server.
    Server,
}

/// The kinds of places.
#[derive(Clone, Copy)]
enum Row {
    General,
    Reserve,
}

/// Who holds which place.
pub(super) struct Places {
    max: usize,
    per_address: usize,
    /// Addresses that may hold any number: proxies, which speak for many.
    exempt: Vec<IpAddr>,
    began: Instant,
    table: Mutex<Table>,
}

#[derive(Default)]
struct Table {
    /// Turns, which order connections by when they became idle; also ids.
    turn: u64,
    seats: HashMap<u64, Seated>,
    rows: [Line; 2],
    addresses: HashMap<IpAddr, [Line; 2]>,
}

/// The connections of a row, of all addresses or of one.
#[derive(Default)]
struct Line {
    held: usize,
    /// Ids of those without a request, by the turn in which they became so.
    idle: BTreeMap<u64, u64>,
}

/// What is known of one connection.
struct Seated {
    seat: Arc<Seat>,
    address: IpAddr,
    row: Row,
    /// Requests that are not answered to the end.
    open: usize,
    /// Requests whose body is not there to the end.
    receiving: usize,
    /// The turn in which it became idle, and when.
    idle: Option<(u64, Instant)>,
    had_request: bool,
}

/// A connection's place. It counts until [`Seat::leave`], or until another connection is given it.
pub(super) struct Seat {
    id: u64,
    full: Option<Full>,
    places: Arc<Places>,
    evicted: Notify,
    /// Whether bytes of an answer wait to be taken.
    pub(super) writing: Arc<AtomicBool>,
    /// When a body last made headway, in milliseconds from the beginning.
    progress_millis: AtomicU64,
}

impl Places {
    /// So many places, of which one address may hold so many.
    pub(super) fn new(max: usize, per_address: usize, exempt: Vec<IpAddr>) -> Arc<Self> {
        Arc::new(Self { max, per_address, exempt, began: Instant::now(), table: Mutex::default() })
    }

    /// A place for a connection from `address`; if need be that of one that does not use it.
    ///
    /// # Errors
    /// What is full, when there is no place in the reserve either.
    pub(super) fn admit(self: &Arc<Self>, address: IpAddr) -> Result<Arc<Seat>, Full> {
        let mut table = self.lock();
        let held = table.addresses.get(&address).map_or(0, |lines| lines[Row::General as usize].held);
        let full = if held >= self.per_address && !self.exempt.contains(&address) {
            Some(Full::Address).filter(|_| !table.evict(Row::General, Some(address)))
        } else if table.rows[Row::General as usize].held >= self.max {
            Some(Full::Server).filter(|_| !table.evict(Row::General, None))
        } else {
            None
        };
        match full {
            None => Ok(table.seat(self, address, Row::General, None)),
            Some(full) => {
                table.clear_reserve(address, full)?;
                Ok(table.seat(self, address, Row::Reserve, Some(full)))
            }
        }
    }

    /// Takes the places of up to `count` connections that do not use them, for want of file descriptors.
    pub(super) fn make_room(&self, count: usize) {
        let mut table = self.lock();
        for _ in 0..count {
            if !table.evict(Row::General, None) {
                return;
            }
        }
    }

    /// Connections that hold a place, those of the reserve included.
    #[cfg(test)]
    fn held(&self) -> usize {
        self.lock().seats.len()
    }

    fn lock(&self) -> MutexGuard<'_, Table> {
        // No operation on the table breaks off half way.
        self.table.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Table {
    fn lines(&mut self, address: IpAddr, row: Row) -> [&mut Line; 2] {
        [&mut self.rows[row as usize], &mut self.addresses.entry(address).or_default()[row as usize]]
    }

    fn next(&mut self) -> u64 {
        self.turn += 1;
        self.turn
    }

    fn seat(&mut self, places: &Arc<Places>, address: IpAddr, row: Row, full: Option<Full>) -> Arc<Seat> {
        let id = self.next();
        let (writing, progress_millis) = (Arc::default(), AtomicU64::new(0));
        let seat = Arc::new(Seat { id, full, places: places.clone(), evicted: Notify::new(), writing, progress_millis });
        for line in self.lines(address, row) {
            line.held += 1;
            line.idle.insert(id, id);
        }
        let idle = Some((id, Instant::now()));
        let seated = Seated { seat: seat.clone(), address, row, open: 0, receiving: 0, idle, had_request: false };
        self.seats.insert(id, seated);
        seat
    }

    /// Makes sure that the reserve has a place for `address`.
    fn clear_reserve(&mut self, address: IpAddr, full: Full) -> Result<(), Full> {
        let all = self.rows[Row::Reserve as usize].held;
        let own = self.addresses.get(&address).map_or(0, |lines| lines[Row::Reserve as usize].held);
        let made = if own >= RESERVE_PER_ADDRESS {
            self.evict(Row::Reserve, Some(address))
        } else {
            all < RESERVE || self.evict(Row::Reserve, None)
        };
        if made { Ok(()) } else { Err(full) }
    }

    /// Takes the place of the connection of this row, and of this address if one is given, that makes the least use of it.
    fn evict(&mut self, row: Row, address: Option<IpAddr>) -> bool {
        let line = match address {
            Some(address) => self.addresses.get(&address).map(|lines| &lines[row as usize]),
            None => Some(&self.rows[row as usize]),
        };
        let is_unused = |id: &&u64| self.seats.get(id).is_some_and(|seated| !seated.seat.writing.load(Ordering::Relaxed));
        let idle = line.and_then(|line| line.idle.values().find(is_unused)).copied();
        let Some(id) = idle.or_else(|| self.stalled(row, address)) else { return false };
        if let Some(seated) = self.remove(id) {
            seated.seat.evicted.notify_one();
        }
        true
    }

    /// The connection that does nothing but receive, of which nothing has come for longest.
    fn stalled(&self, row: Row, address: Option<IpAddr>) -> Option<u64> {
        let of_line = |seated: &&Seated| seated.row as usize == row as usize && address.is_none_or(|a| a == seated.address);
        let receives = |seated: &&Seated| seated.open > 0 && seated.open == seated.receiving;
        let candidates = self.seats.values().filter(of_line).filter(receives);
        let stalled = candidates.map(|seated| (seated.seat.stalled_for(), seated.seat.id)).filter(|(time, _)| *time > STALLED);
        stalled.max().map(|(_, id)| id)
    }

    fn remove(&mut self, id: u64) -> Option<Seated> {
        let seated = self.seats.remove(&id)?;
        for line in self.lines(seated.address, seated.row) {
            line.held -= 1;
            if let Some((turn, _)) = seated.idle {
                line.idle.remove(&turn);
            }
        }
        if self.addresses.get(&seated.address).is_some_and(|lines| lines.iter().all(|line| line.held == 0)) {
            self.addresses.remove(&seated.address);
        }
        Some(seated)
    }

    fn begin(&mut self, id: u64) {
        let Some(seated) = self.seats.get_mut(&id) else { return };
        seated.open += 1;
        seated.had_request = true;
        let (address, row) = (seated.address, seated.row);
        if let Some((turn, _)) = seated.idle.take() {
            for line in self.lines(address, row) {
                line.idle.remove(&turn);
            }
        }
    }

    fn end(&mut self, id: u64) {
        let turn = self.next();
        let Some(seated) = self.seats.get_mut(&id) else { return };
        seated.open -= 1;
        if seated.open > 0 {
            return;
        }
        seated.idle = Some((turn, Instant::now()));
        let (address, row) = (seated.address, seated.row);
        for line in self.lines(address, row) {
            line.idle.insert(turn, id);
        }
    }
}

impl Seat {
    /// What was full, if this is a place of the reserve.
    pub(super) fn full(&self) -> Option<Full> {
        self.full
    }

    /// Gives the place back.
    pub(super) fn leave(&self) {
        self.places.lock().remove(self.id);
    }

    /// Waits until the place is given to another connection.
    pub(super) async fn evicted(&self) {
        self.evicted.notified().await;
    }

    /// Waits until the connection has been without a request for so long, but not before so long after `from`: `before`
    /// its first request, and `between` two.
    pub(super) async fn idle_for(&self, from: Instant, before: Duration, between: Duration) {
        loop {
            let wait = match self.idle_since() {
                Some((since, had_request)) => {
                    let limit = if had_request { between } else { before };
                    let over = since.max(from) + limit;
                    let left = over.saturating_duration_since(Instant::now());
                    if left.is_zero() {
                        return;
                    }
                    left
                }
                None => between,
            };
            tokio::time::sleep(wait).await;
        }
    }

    /// Since when there is no request, if there is none; and whether there ever was.
    fn idle_since(&self) -> Option<(Instant, bool)> {
        if self.writing.load(Ordering::Relaxed) {
            return None;
        }
        let table = self.places.lock();
        table.seats.get(&self.id).and_then(|seated| seated.idle.map(|(_, since)| (since, seated.had_request)))
    }

    /// A request begins.
    pub(super) fn request(self: &Arc<Self>) -> OpenRequest {
        self.places.lock().begin(self.id);
        OpenRequest(self.clone())
    }

    /// A request's body begins to come.
    pub(super) fn body(self: &Arc<Self>) -> OpenBody {
        self.progress();
        if let Some(seated) = self.places.lock().seats.get_mut(&self.id) {
            seated.receiving += 1;
        }
        OpenBody(self.clone())
    }

    fn progress(&self) {
        self.progress_millis.store(self.millis(), Ordering::Relaxed);
    }

    fn stalled_for(&self) -> Duration {
        Duration::from_millis(self.millis().saturating_sub(self.progress_millis.load(Ordering::Relaxed)))
    }

    fn millis(&self) -> u64 {
        u64::try_from(self.places.began.elapsed().as_millis()).unwrap_or(u64::MAX)
    }
}

/// A request that is open while this lives.
pub(super) struct OpenRequest(Arc<Seat>);

impl Drop for OpenRequest {
    fn drop(&mut self) {
        self.0.places.lock().end(self.0.id);
    }
}

/// A body that comes while this lives.
pub(super) struct OpenBody(Arc<Seat>);

impl OpenBody {
    /// A piece of it came.
    pub(super) fn progress(&self) {
        self.0.progress();
    }
}

impl Drop for OpenBody {
    fn drop(&mut self) {
        if let Some(seated) = self.0.places.lock().seats.get_mut(&self.0.id) {
            seated.receiving -= 1;
        }
    }
}

#[cfg(test)]
mod tests;

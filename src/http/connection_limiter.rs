//! Connection limits: a maximum for the server, a maximum for one client, which is an IPv4 address or an IPv6 /64, and a few
//! reserved connections on which only probes, pauses and stops are answered, so that the server can be monitored, and a run
//! stopped, while it is full.
//!
//! A connection in use keeps its slot. When slots run out, the client with the most idle connections loses the one that
//! has been idle for longest: one that never sent a complete request head, or one that is kept alive. If none is idle, the
//! connection whose request body has stalled for longest is evicted. So a client
//! that opens connections and stalls evicts its own, however fast it reconnects, unless another client has more idle ones.
//! An eviction for the whole server looks at every client: some microseconds at a thousand of them.

use std::cmp::Reverse;
use std::collections::{BTreeMap, HashMap};
use std::net::IpAddr;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::Notify;

use super::client::counted_as;
use super::network::IpNetwork;

/// Connections beyond the maximum, on which only probes, pauses and stops are answered.
pub const RESERVED_CONNECTIONS: usize = 64;
/// Reserved connections that one client may hold.
const RESERVED_PER_ADDRESS: usize = 8;
/// Time without progress of a request body after which its connection may be evicted.
const STALLED: Duration = Duration::from_secs(1);

/// The limit that kept a connection out of the general pool.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ExceededLimit {
    /// The maximum of its client.
    Address,
    /// The maximum of the server.
    Server,
}

/// Pools of slots.
#[derive(Clone, Copy)]
enum Pool {
    General,
    Reserve,
}

/// Admission and eviction of connections.
pub(super) struct ConnectionLimiter {
    max: usize,
    per_address: usize,
    /// Networks whose addresses have no limit of their own: proxies, which serve many clients.
    exempt: Vec<IpNetwork>,
    began: Instant,
    table: Mutex<Table>,
}

#[derive(Default)]
struct Table {
    /// Logical clock: orders connections by when they became idle, and provides their ids.
    tick: u64,
    connections: HashMap<u64, Connection>,
    held: [usize; 2],
    clients: HashMap<IpNetwork, [Occupancy; 2]>,
}

/// Connections of a pool from one client.
#[derive(Default)]
struct Occupancy {
    held: usize,
    /// Ids of idle connections, by the tick at which they became idle.
    idle: BTreeMap<u64, u64>,
}

/// State of one connection.
struct Connection {
    slot: Arc<ConnectionSlot>,
    client: IpNetwork,
    pool: Pool,
    /// Requests whose response is not complete.
    open: usize,
    /// Requests whose body is not complete.
    receiving: usize,
    /// Tick and time at which it became idle.
    idle: Option<(u64, Instant)>,
    had_request: bool,
}

/// A connection's slot. It counts until [`ConnectionSlot::release`], or until it is evicted.
pub(super) struct ConnectionSlot {
    id: u64,
    exceeded: Option<ExceededLimit>,
    limiter: Arc<ConnectionLimiter>,
    evicted: Notify,
    /// True while bytes of a response wait for the client.
    pub(super) writing: Arc<AtomicBool>,
    /// Time of the last progress of a body, milliseconds since `began`.
    progress_millis: AtomicU64,
    /// Number of requests that were begun.
    begun: AtomicU64,
    /// Number of requests whose response was handed over whole, to be written.
    ended: AtomicU64,
}

impl ConnectionLimiter {
    /// Limits connections to `max`, and to `per_address` from one client that is not `exempt`.
    pub(super) fn new(max: usize, per_address: usize, exempt: Vec<IpNetwork>) -> Arc<Self> {
        Arc::new(Self { max, per_address, exempt, began: Instant::now(), table: Mutex::default() })
    }

    /// Admits a connection from `address`, if need be by evicting one that is idle or stalled.
    ///
    /// # Errors
    /// The exceeded limit, if the reserve is full too.
    pub(super) fn admit(self: &Arc<Self>, address: IpAddr) -> Result<Arc<ConnectionSlot>, ExceededLimit> {
        let client = counted_as(address, &self.exempt);
        let mut table = self.lock();
        let held = table.clients.get(&client).map_or(0, |occupancies| occupancies[Pool::General as usize].held);
        let exceeded = if held >= self.per_address && !self.exempt.iter().any(|network| network.contains(address)) {
            Some(ExceededLimit::Address).filter(|_| !table.evict(Pool::General, Some(client)))
        } else if table.held[Pool::General as usize] >= self.max {
            Some(ExceededLimit::Server).filter(|_| !table.evict(Pool::General, None))
        } else {
            None
        };
        match exceeded {
            None => Ok(table.occupy(self, client, Pool::General, None)),
            Some(limit) => {
                table.make_reserve_room(client, limit)?;
                Ok(table.occupy(self, client, Pool::Reserve, Some(limit)))
            }
        }
    }

    /// Evicts up to `count` idle or stalled connections, to free file descriptors.
    pub(super) fn evict_idle(&self, count: usize) {
        let mut table = self.lock();
        for _ in 0..count {
            if !table.evict(Pool::General, None) {
                return;
            }
        }
    }

    /// Number of connections, reserved ones included.
    #[cfg(test)]
    fn held(&self) -> usize {
        self.lock().connections.len()
    }

    fn lock(&self) -> MutexGuard<'_, Table> {
        // No operation leaves the table half changed.
        self.table.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Table {
    fn occupancy(&mut self, client: IpNetwork, pool: Pool) -> &mut Occupancy {
        &mut self.clients.entry(client).or_default()[pool as usize]
    }

    fn next(&mut self) -> u64 {
        self.tick += 1;
        self.tick
    }

    fn occupy(
        &mut self,
        limiter: &Arc<ConnectionLimiter>,
        client: IpNetwork,
        pool: Pool,
        exceeded: Option<ExceededLimit>,
    ) -> Arc<ConnectionSlot> {
        let id = self.next();
        let slot = Arc::new(ConnectionSlot {
            id,
            exceeded,
            limiter: limiter.clone(),
            evicted: Notify::new(),
            writing: Arc::default(),
            progress_millis: AtomicU64::new(0),
            begun: AtomicU64::new(0),
            ended: AtomicU64::new(0),
        });
        self.held[pool as usize] += 1;
        let occupancy = self.occupancy(client, pool);
        occupancy.held += 1;
        occupancy.idle.insert(id, id);
        let idle = Some((id, Instant::now()));
        let connection = Connection { slot: slot.clone(), client, pool, open: 0, receiving: 0, idle, had_request: false };
        self.connections.insert(id, connection);
        slot
    }

    /// Makes sure that the reserve has a slot for `client`.
    fn make_reserve_room(&mut self, client: IpNetwork, limit: ExceededLimit) -> Result<(), ExceededLimit> {
        let all = self.held[Pool::Reserve as usize];
        let own = self.clients.get(&client).map_or(0, |occupancies| occupancies[Pool::Reserve as usize].held);
        let has_room = if own >= RESERVED_PER_ADDRESS {
            self.evict(Pool::Reserve, Some(client))
        } else {
            all < RESERVED_CONNECTIONS || self.evict(Pool::Reserve, None)
        };
        if has_room { Ok(()) } else { Err(limit) }
    }

    /// Evicts a connection of this pool (and of this client, if given): the longest idle one of the client with the most
    /// idle ones, else the one stalled for longest. Returns true if there was one.
    fn evict(&mut self, pool: Pool, client: Option<IpNetwork>) -> bool {
        let idle = match client {
            Some(client) => self.clients.get(&client).and_then(|occupancies| self.longest_idle(&occupancies[pool as usize])),
            None => {
                let of_each = self.clients.values().map(|occupancies| &occupancies[pool as usize]);
                let oldest = of_each.filter_map(|occupancy| Some((occupancy.idle.len(), Reverse(self.longest_idle(occupancy)?))));
                oldest.max().map(|(_, Reverse(oldest))| oldest)
            }
        };
        let Some(id) = idle.map(|(_, id)| id).or_else(|| self.stalled(pool, client)) else { return false };
        if let Some(connection) = self.remove(id) {
            connection.slot.evicted.notify_one();
        }
        true
    }

    /// Tick and id of the connection that has been idle for longest, among those with no bytes waiting to be sent.
    fn longest_idle(&self, occupancy: &Occupancy) -> Option<(u64, u64)> {
        let is_unused = |id: u64| self.connections.get(&id).is_some_and(|c| !c.slot.writing.load(Ordering::Relaxed));
        occupancy.idle.iter().map(|(tick, id)| (*tick, *id)).find(|(_, id)| is_unused(*id))
    }

    /// The connection stalled for longest, among those that only receive request bodies.
    fn stalled(&self, pool: Pool, client: Option<IpNetwork>) -> Option<u64> {
        let in_pool = |c: &&Connection| c.pool as usize == pool as usize && client.is_none_or(|client| client == c.client);
        let receives = |c: &&Connection| c.open > 0 && c.open == c.receiving;
        let candidates = self.connections.values().filter(in_pool).filter(receives);
        let stalled = candidates.map(|c| (c.slot.stalled_for(), c.slot.id)).filter(|(time, _)| *time > STALLED);
        stalled.max().map(|(_, id)| id)
    }

    fn remove(&mut self, id: u64) -> Option<Connection> {
        let connection = self.connections.remove(&id)?;
        self.held[connection.pool as usize] -= 1;
        let occupancy = self.occupancy(connection.client, connection.pool);
        occupancy.held -= 1;
        if let Some((tick, _)) = connection.idle {
            occupancy.idle.remove(&tick);
        }
        if self.clients.get(&connection.client).is_some_and(|both| both.iter().all(|occupancy| occupancy.held == 0)) {
            self.clients.remove(&connection.client);
        }
        Some(connection)
    }

    fn begin(&mut self, id: u64) {
        let Some(connection) = self.connections.get_mut(&id) else { return };
        connection.open += 1;
        connection.had_request = true;
        let (client, pool) = (connection.client, connection.pool);
        if let Some((tick, _)) = connection.idle.take() {
            self.occupancy(client, pool).idle.remove(&tick);
        }
    }

    fn end(&mut self, id: u64) {
        let tick = self.next();
        let Some(connection) = self.connections.get_mut(&id) else { return };
        connection.open -= 1;
        if connection.open > 0 {
            return;
        }
        connection.idle = Some((tick, Instant::now()));
        let (client, pool) = (connection.client, connection.pool);
        self.occupancy(client, pool).idle.insert(tick, id);
    }
}

impl ConnectionSlot {
    /// The limit that put this connection into the reserve; `None` in the general pool.
    pub(super) fn exceeded_limit(&self) -> Option<ExceededLimit> {
        self.exceeded
    }

    /// Frees the slot.
    pub(super) fn release(&self) {
        self.limiter.lock().remove(self.id);
    }

    /// Waits until the connection is evicted.
    pub(super) async fn evicted(&self) {
        self.evicted.notified().await;
    }

    /// Waits until the connection has been idle for the limit, counted from `from` at the earliest: `before` its first
    /// request, `between` two requests.
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

    /// Time since which the connection is idle, and whether it ever had a request; `None` while it is in use.
    fn idle_since(&self) -> Option<(Instant, bool)> {
        if self.writing.load(Ordering::Relaxed) {
            return None;
        }
        let table = self.limiter.lock();
        table.connections.get(&self.id).and_then(|connection| connection.idle.map(|(_, since)| (since, connection.had_request)))
    }

    /// Marks the beginning of a request.
    pub(super) fn begin_request(self: &Arc<Self>) -> OpenRequest {
        self.begun.fetch_add(1, Ordering::Relaxed);
        self.limiter.lock().begin(self.id);
        OpenRequest(self.clone())
    }

    /// Number of requests that were begun.
    pub(super) fn begun(&self) -> u64 {
        self.begun.load(Ordering::Relaxed)
    }

    /// Number of requests whose response was handed over whole, to be written.
    pub(super) fn ended(&self) -> u64 {
        self.ended.load(Ordering::Relaxed)
    }

    /// Marks the beginning of a request body.
    pub(super) fn begin_body(self: &Arc<Self>) -> OpenBody {
        self.progress();
        if let Some(connection) = self.limiter.lock().connections.get_mut(&self.id) {
            connection.receiving += 1;
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
        u64::try_from(self.limiter.began.elapsed().as_millis()).unwrap_or(u64::MAX)
    }
}

/// Guard of an open request, which ends when the guard is dropped.
pub(super) struct OpenRequest(Arc<ConnectionSlot>);

impl Drop for OpenRequest {
    fn drop(&mut self) {
        self.0.ended.fetch_add(1, Ordering::Relaxed);
        self.0.limiter.lock().end(self.0.id);
    }
}

/// Guard of a request body in transfer, which ends when the guard is dropped.
pub(super) struct OpenBody(Arc<ConnectionSlot>);

impl OpenBody {
    /// Records the arrival of a chunk.
    pub(super) fn progress(&self) {
        self.0.progress();
    }
}

impl Drop for OpenBody {
    fn drop(&mut self) {
        if let Some(connection) = self.0.limiter.lock().connections.get_mut(&self.0.id) {
            connection.receiving -= 1;
        }
    }
}

#[cfg(test)]
mod tests;

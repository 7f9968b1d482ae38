//! Memory of the meshes that are read after their upload and for previews: what all of them hold at once stays within a limit of its
//! own, however many come. A mesh waits for its share; one that is estimated beyond the limit is read alone. Meshes of jobs count
//! towards the memory of these, and those of checks and of cells are read by a few requests at a time.
//!
//! Small meshes go past large ones that wait. Large ones wait for each other, in the order in which they came; the first of them takes
//! what it needs once that is free, and waits in one line with the small ones when these alone hold memory: so no stream of small
//! meshes keeps a large one waiting, and a small mesh waits for meshes that are being read, not for those that wait.

use std::fs::File;
use std::io::{self, Read as _};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use tokio::sync::{Mutex, Notify, OwnedSemaphorePermit, Semaphore};

use super::error::Error;

/// Unit in which memory is given out, bytes.
const UNIT_BYTES: u64 = 1 << 20;

/// Bytes that are held at most for each triangle, beside the file of a format other than binary STL: counted in
/// `geometry/mesh_io`, for triangles none of which share a vertex.
const TRIANGLE_BYTES: u64 = 150;
/// Bytes that are held beside that: pieces of the file, of which there are "a few megabytes".
const BESIDE_BYTES: u64 = 16 << 20;
/// Bytes of a triangle in a binary STL file; one in ASCII has 73 at least.
const STL_TRIANGLE_BYTES: u64 = 50;
/// Bytes of a triangle in any other file, at least: a further corner of a polygon in binary PLY is a byte.
const MIN_TRIANGLE_BYTES: u64 = 1;
/// Bytes of a binary STL file before its first triangle; the last four are the number of triangles.
const STL_HEAD_BYTES: u64 = 84;

/// Units that a small mesh may take whatever the limit: 16 for pieces of its file, and 8 for its triangles.
const SMALL_UNITS: u32 = 24;
/// Part of the memory that a small mesh takes at most: one in so many.
const SMALL_PART: u32 = 8;

/// Memory that is given out to those who read meshes.
pub(super) struct ParseMemory {
    /// Free memory, in units. Small meshes wait in its line, and the first of the large ones where small ones alone hold memory.
    free: Arc<Semaphore>,
    /// All of it, in units.
    units: u32,
    /// Held by the first of the large meshes that wait.
    turn: Mutex<()>,
    shared: Arc<Shared>,
}

/// State that those who hold memory share.
#[derive(Default)]
struct Shared {
    /// Large meshes that hold memory.
    large: AtomicUsize,
    /// Memory was given back.
    released: Notify,
}

/// Memory of a mesh; given back when dropped.
pub(super) struct HeldMemory {
    permit: Option<OwnedSemaphorePermit>,
    is_large: bool,
    shared: Arc<Shared>,
}

impl Drop for HeldMemory {
    fn drop(&mut self) {
        // The order matters: who is woken finds the memory free, and this mesh gone.
        drop(self.permit.take());
        if self.is_large {
            self.shared.large.fetch_sub(1, Ordering::AcqRel);
        }
        // One waits at most. If it does not wait yet, the notice is kept for it.
        self.shared.released.notify_one();
    }
}

impl ParseMemory {
    /// Memory of so many bytes.
    pub(super) fn new(bytes: u64) -> Self {
        let units = u32::try_from(bytes / UNIT_BYTES).unwrap_or(u32::MAX).max(1);
        Self { free: Arc::new(Semaphore::new(units as usize)), units, turn: Mutex::default(), shared: Arc::default() }
    }

    /// Waits for so many bytes; for all there are where that is less. A caller that goes away gives up its place.
    ///
    /// # Errors
    /// [`Error::Draining`].
    pub(super) async fn take(&self, bytes: u64) -> Result<HeldMemory, Error> {
        let units = u32::try_from(bytes.div_ceil(UNIT_BYTES)).unwrap_or(u32::MAX).min(self.units);
        let is_large = units > (self.units / SMALL_PART).max(SMALL_UNITS).min(self.units / 2);
        let permit = if is_large { self.take_large(units).await? } else { self.take_in_line(units).await? };
        Ok(HeldMemory { permit: Some(permit), is_large, shared: Arc::clone(&self.shared) })
    }

    /// Waits in the line of the semaphore: whoever comes later waits behind it.
    async fn take_in_line(&self, units: u32) -> Result<OwnedSemaphorePermit, Error> {
        Arc::clone(&self.free).acquire_many_owned(units).await.map_err(|_| Error::Draining)
    }

    /// Waits for the memory of a large mesh, outside the line as long as another large one holds memory; counts it.
    async fn take_large(&self, units: u32) -> Result<OwnedSemaphorePermit, Error> {
        let _turn = self.turn.lock().await;
        let permit = loop {
            if let Ok(permit) = Arc::clone(&self.free).try_acquire_many_owned(units) {
                break permit;
            }
            if self.shared.large.load(Ordering::Acquire) == 0 {
                break self.take_in_line(units).await?;
            }
            self.shared.released.notified().await;
        };
        // Before the next one has its turn, which asks for it.
        self.shared.large.fetch_add(1, Ordering::AcqRel);
        Ok(permit)
    }
}

/// Bytes that are held at once at most while the mesh of a file is read, whatever the file turns out to be. Blocks.
pub(super) fn bytes_to_read(path: &Path, max_triangles: usize) -> io::Result<u64> {
    let file = File::open(path)?;
    let length_bytes = file.metadata()?.len();
    let mut head = Vec::new();
    file.take(STL_HEAD_BYTES).read_to_end(&mut head)?;
    Ok(held_bytes(&head, length_bytes, max_triangles as u64))
}

/// Bytes that are held at once at most for a file of `length_bytes` that begins with `head`.
fn held_bytes(head: &[u8], length_bytes: u64, max_triangles: u64) -> u64 {
    let triangles = |of_one: u64| TRIANGLE_BYTES.saturating_mul((length_bytes / of_one).min(max_triangles));
    let (file, triangles) = if is_binary_stl(head, length_bytes) {
        // It is never held as a whole.
        (0, triangles(STL_TRIANGLE_BYTES))
    } else if begins_with_solid(head) {
        (length_bytes, triangles(STL_TRIANGLE_BYTES))
    } else if is_utf_16(head) {
        // Held as it is and in UTF-8, where two bytes become three at most.
        (length_bytes.saturating_mul(5) / 2, triangles(MIN_TRIANGLE_BYTES))
    } else {
        (length_bytes, triangles(MIN_TRIANGLE_BYTES))
    };
    BESIDE_BYTES.saturating_add(file).saturating_add(triangles)
}

/// Returns true for a file with exactly the triangles that its head declares, as for the reader.
fn is_binary_stl(head: &[u8], length_bytes: u64) -> bool {
    let Some(count) = head.get(80..84).and_then(|count| count.try_into().ok()).map(u32::from_le_bytes) else { return false };
    STL_HEAD_BYTES + STL_TRIANGLE_BYTES * u64::from(count) == length_bytes
}

/// Returns true for the first word of ASCII STL; no other format that is read begins with it.
fn begins_with_solid(head: &[u8]) -> bool {
    let head = head.trim_ascii_start();
    head.get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid")) && head.get(5).is_none_or(u8::is_ascii_whitespace)
}

/// Returns true for the byte order marks of UTF-16.
fn is_utf_16(head: &[u8]) -> bool {
    head.starts_with(&[0xff, 0xfe]) || head.starts_with(&[0xfe, 0xff])
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::geometry::LengthUnit;
    use crate::service::MeshUpload;
    use crate::service::tests::{TRIANGLE, service};

    const GIB: u64 = 1 << 30;
    const MAX_TRIANGLES: u64 = 20_000_000;

    fn binary_stl_head(count: u32) -> Vec<u8> {
        [&[b' '; 80][..], &count.to_le_bytes()].concat()
    }

    #[test]
    fn memory_is_estimated_by_the_format_and_the_size_of_the_file() {
        let held = |head: &[u8], length_bytes: u64| held_bytes(head, length_bytes, MAX_TRIANGLES) - BESIDE_BYTES;
        let count: u32 = 1_000_000;
        assert_eq!(held(&binary_stl_head(count), 84 + 50 * 1_000_000), 150 * 1_000_001, "150 bytes a triangle, with its head");
        // One triangle fewer than it declares: it is read as a whole before it is refused.
        assert_eq!(held(&binary_stl_head(count), 34 + 50 * 1_000_000), 34 + 50_000_000 + 150 * MAX_TRIANGLES);
        for solid in [&b"solid part\nfacet"[..], b"SOLID\n", b" \n solid", b"solid"] {
            assert_eq!(held(solid, 50_000_000), 200_000_000, "the file and 3 bytes a byte of it: {solid:?}");
        }
        for other in [&b"v 0 0 0\nf 1 1 1"[..], b"ply\n", b"solidus", b""] {
            assert_eq!(held(other, 1000), 1000 + 150_000, "a triangle a byte: {other:?}");
            assert_eq!(held(other, GIB), GIB + 150 * MAX_TRIANGLES, "no more than are allowed: {other:?}");
        }
        assert_eq!(held(&[0xff, 0xfe, b'v', 0], 1000), 2500 + 150_000, "in UTF-8 too");
    }

    #[test]
    fn the_estimate_of_a_file_is_that_of_its_head_and_length() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("mesh");
        std::fs::write(&path, [binary_stl_head(2), vec![0; 100]].concat()).expect("written");
        assert_eq!(bytes_to_read(&path, 10).expect("read"), BESIDE_BYTES + 3 * TRIANGLE_BYTES);
        std::fs::write(&path, b"v 0 0 0\n").expect("written");
        assert_eq!(bytes_to_read(&path, 10).expect("read"), BESIDE_BYTES + 8 + 8 * TRIANGLE_BYTES);
        bytes_to_read(&folder.path().join("nothing"), 10).expect_err("no file");
    }

    async fn is_free(memory: &ParseMemory, bytes: u64) -> bool {
        tokio::time::timeout(Duration::from_millis(20), memory.take(bytes)).await.is_ok()
    }

    #[tokio::test]
    async fn meshes_that_are_read_at_once_stay_within_the_memory_and_one_beyond_it_is_read_alone() {
        let memory = ParseMemory::new(GIB);
        let first = memory.take(GIB / 2).await.expect("free");
        let second = memory.take(GIB / 2 - UNIT_BYTES + 1).await.expect("what is left");
        assert!(!is_free(&memory, 1).await, "nothing is left");
        drop(first);
        assert!(is_free(&memory, GIB / 2).await && !is_free(&memory, GIB / 2 + 1).await);
        assert!(!is_free(&memory, u64::MAX).await, "it would not be alone");
        drop(second);
        let alone = memory.take(u64::MAX).await.expect("all of it");
        assert!(!is_free(&memory, 1).await);
        drop(alone);
        assert!(is_free(&ParseMemory::new(0), GIB).await, "one at a time");
    }

    const MIB: u64 = 1 << 20;

    #[tokio::test]
    async fn a_small_mesh_goes_past_large_ones_that_wait() {
        let memory = ParseMemory::new(GIB);
        let read = memory.take(900 * MIB).await.expect("free");
        let (first, second) = (memory.take(900 * MIB), memory.take(200 * MIB));
        tokio::pin!(first);
        tokio::pin!(second);
        for large in [first.as_mut(), second.as_mut()] {
            assert!(tokio::time::timeout(Duration::from_millis(20), large).await.is_err(), "there is no room for it");
        }
        for small in [1, 20 * MIB, 120 * MIB] {
            assert!(is_free(&memory, small).await, "{small} bytes wait behind large meshes");
        }
        assert!(!is_free(&memory, 125 * MIB).await, "it is small, and there is no room for it");
        drop(read);
        let first = first.await.expect("free");
        assert!(tokio::time::timeout(Duration::from_millis(20), second.as_mut()).await.is_err(), "the large ones in order");
        drop(first);
        second.await.expect("free");
    }

    #[tokio::test]
    async fn no_stream_of_small_meshes_keeps_a_large_one_waiting() {
        let memory = ParseMemory::new(GIB);
        let small = memory.take(20 * MIB).await.expect("free");
        let all = memory.take(u64::MAX);
        tokio::pin!(all);
        assert!(tokio::time::timeout(Duration::from_millis(20), all.as_mut()).await.is_err(), "it is read alone");
        assert!(!is_free(&memory, 20 * MIB).await, "only small ones hold memory: who comes later waits behind it");
        drop(small);
        let all = all.await.expect("free");
        // One that waited while a large one was read has its turn before the next large one.
        let (small, next) = (memory.take(20 * MIB), memory.take(u64::MAX));
        tokio::pin!(small);
        tokio::pin!(next);
        assert!(tokio::time::timeout(Duration::from_millis(20), next.as_mut()).await.is_err());
        assert!(tokio::time::timeout(Duration::from_millis(20), small.as_mut()).await.is_err());
        drop(all);
        let small = small.await.expect("free");
        assert!(tokio::time::timeout(Duration::from_millis(20), next.as_mut()).await.is_err());
        drop(small);
        next.await.expect("free");
    }

    #[tokio::test]
    async fn a_large_mesh_whose_sender_goes_away_gives_up_its_place() {
        let memory = ParseMemory::new(GIB);
        let small = memory.take(20 * MIB).await.expect("free");
        for _ in 0..2 {
            // Once in line, and once more where the first one has left.
            assert!(!is_free(&memory, u64::MAX).await);
            assert!(is_free(&memory, 20 * MIB).await, "nobody waits before it");
        }
        let large = memory.take(GIB / 2).await.expect("free");
        assert!(!is_free(&memory, GIB).await, "outside the line");
        drop((small, large));
        assert!(is_free(&memory, GIB).await, "all is given back");
    }

    #[tokio::test]
    async fn an_upload_waits_until_there_is_memory_to_read_it() {
        let (app, _folder) = service().await;
        let turns = app.0.parsing.available_permits();
        let held = app.0.parse_memory.take(u64::MAX).await.expect("all of it");
        let mut upload = app.receive(0).await.expect("room");
        upload.write(TRIANGLE.into()).await.expect("written");
        let upload = upload.finish(None).await.expect("a file");
        let adding = app.add_mesh(upload, MeshUpload { unit: LengthUnit::Millimetre, name: None });
        tokio::pin!(adding);
        let waiting = tokio::time::timeout(Duration::from_millis(100), &mut adding).await;
        assert!(waiting.is_err(), "it was read at once");
        assert_eq!(app.0.parsing.available_permits(), turns, "it keeps none from being read that has memory");
        drop(held);
        adding.await.expect("a mesh");
        let free = app.0.parse_memory.take(u64::MAX).await;
        assert!(free.is_ok(), "what it held is given back");
    }
}

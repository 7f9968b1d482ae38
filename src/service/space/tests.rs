//! Room that is kept for what frees more, on disks that are full.

use super::*;
use crate::service::tests::{ended_job, keep_no_reserve, service, service_below_the_floor};
use crate::wire::{JobId, JobSelection};

#[test]
fn the_reserve_has_room_for_a_write_ahead_log_where_the_floor_has_twice_as_much() {
    const MIB: u64 = 1 << 20;
    let floors = [0, 3 * MIB, 20 * MIB, 1024 * MIB, u64::MAX];
    assert_eq!(floors.map(reserve_bytes), [MIB, 3 * MIB / 2, 10 * MIB, 16 * MIB, 16 * MIB]);
}

#[test]
fn a_file_is_lengthened_by_the_bytes_that_it_lacks() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(RESERVE);
    for (kept_bytes, more_bytes) in [(0, 3), (3, 2 * PIECE_BYTES), (3 + 2 * PIECE_BYTES, PIECE_BYTES + 1)] {
        lengthen(&path, kept_bytes, more_bytes, noise).expect("room");
        assert_eq!(fs::metadata(&path).expect("a file").len(), kept_bytes + more_bytes);
    }
}

/// All was given back, and nothing could be cancelled or deleted from then on.
#[test]
fn a_reserve_that_a_disk_has_no_room_for_keeps_half_of_what_was_written() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(RESERVE);
    fs::write(&path, b"kept").expect("a file");
    let fills_left = std::cell::Cell::new(4_u32);
    let fill = |_: &mut [u8]| -> io::Result<()> {
        let left = fills_left.get().checked_sub(1).ok_or(io::ErrorKind::StorageFull)?;
        fills_left.set(left);
        Ok(())
    };
    let error = lengthen(&path, 4, 9 * PIECE_BYTES, fill).expect_err("no room");
    assert_eq!(error.kind(), io::ErrorKind::StorageFull);
    assert_eq!(fs::metadata(&path).expect("a file").len(), 4 + 2 * PIECE_BYTES);
}

/// Results took the megabyte that had been given up for a cancellation.
#[tokio::test]
async fn results_wait_while_there_is_no_reserve_and_less_than_the_floor_is_free() {
    let (app, folder) = service_below_the_floor().await;
    let stored = || app.0.store.files().list().expect("a list").len();
    let results = || Arc::new(vec![Artifact { name: "coverage.bin".into(), bytes: b"a result".to_vec() }]);
    keep_no_reserve(folder.path());
    let refused = app.put_results(results()).await;
    assert!(matches!(&refused, Err(error @ Error::StorageLow { .. }) if error.is_transient()), "{refused:?}");
    assert_eq!(stored(), 0);
    fs::remove_dir(folder.path().join(RESERVE)).expect("removed");
    app.put_results(results()).await.expect("there is room for both");
    assert!(app.is_reserve_whole() && stored() == 1);
}

#[test]
fn there_is_room_for_what_is_not_larger_than_the_free_space() {
    let space = DiskSpace { free_bytes: 7, total_bytes: 9 };
    let is_there_room = [0, 7, 8].map(|new_bytes| check_room_for(new_bytes, space).is_ok());
    assert_eq!(is_there_room, [true, true, false]);
}

/// Nobody was told that any had been deleted.
#[tokio::test]
async fn a_deletion_of_several_that_fails_tells_how_many_it_deleted() {
    let (app, folder) = service().await;
    let (first, second) = (ended_job(&app).await.id, ended_job(&app).await.id);
    keep_no_reserve(folder.path());
    app.0.store.fill_disk_at(&format!("DELETE ON job WHEN OLD.id = '{second}'")).await;
    let selection = JobSelection { ids: Some(vec![first, second]), ..JobSelection::default() };
    let refused = app.delete_jobs(selection.clone(), false).await.expect_err("the disk is full");
    let said = refused.to_string();
    assert!(matches!(&refused, Error::PartlyDeleted { deleted: 1, .. }), "{refused:?}");
    let told = "the disk is full; delete jobs or meshes, or free space on the disk; 1 of the selected jobs had been deleted before \
                this failure; send";
    assert!(said.starts_with(told), "{said}");
    let there = async |id: JobId| app.job_state(id).await.is_ok();
    assert!(!there(first).await && there(second).await);
    assert_eq!(app.delete_jobs(selection, false).await.expect("there is room").deleted, 1);
}

/// One cancellation gave up the whole reserve, and whatever else filled the disk took it.
#[tokio::test]
async fn a_change_on_a_full_disk_is_given_a_part_of_the_reserve_before_all_of_it() {
    let (app, folder) = service().await;
    app.keep_reserve().await.expect("kept");
    let size = || std::fs::metadata(folder.path().join(RESERVE)).map_or(0, |about| about.len());
    let whole = size();
    for (needed, wanted) in [(2, vec![whole, whole - STEP_BYTES]), (9, vec![whole, whole - STEP_BYTES, 0, 0])] {
        let seen = std::cell::RefCell::new(Vec::new());
        let work = || {
            seen.borrow_mut().push(size());
            let is_done = seen.borrow().len() >= needed;
            std::future::ready(if is_done { Ok(()) } else { Err(Error::StorageFull) })
        };
        let done = app.with_reserve(work).await;
        assert_eq!((done.is_ok(), seen.into_inner()), (needed == 2, wanted));
        assert_eq!(size(), whole, "it is taken back");
    }
}

//! Orphans, missing and foreign databases, damaged files: nothing is lost, and the damage is reported.

use std::time::Duration;

use super::super::sweep::SweepReport;
use super::*;

/// Stores a file that no row refers to.
fn put_orphan(store: &Store, bytes: &[u8]) -> String {
    let received = store.files().write(bytes).expect("a file");
    let sha256 = received.sha256.clone();
    store.files().persist(received).expect("renamed");
    sha256
}

const NOW: Duration = Duration::ZERO;
const LONG: Duration = Duration::from_secs(3600);

#[tokio::test]
async fn what_a_crash_left_between_file_and_row_is_moved_away_once_it_is_old() {
    let opened = open().await;
    let mesh = add_mesh(&opened.store, b"one").await;
    let orphan = put_orphan(&opened.store, b"nobody's");
    std::fs::write(opened.folder.path().join("unfinished/half"), b"ha").expect("a file");
    let opened = opened.reopen().await;
    let store = &opened.store;
    assert_eq!(stored_files(&opened), 2, "opening removes nothing");
    assert_eq!(std::fs::read_dir(opened.folder.path().join("unfinished")).expect("a folder").count(), 0);
    assert_eq!(store.sweep(LONG, LONG).await.expect("too young"), SweepReport::default());
    assert_eq!(store.sweep(NOW, LONG).await.expect("old enough"), SweepReport { moved: 1, removed: 0 });
    assert_eq!(store.files().list().expect("a list").iter().map(|file| &file.sha256).collect::<Vec<_>>(), [&mesh.sha256]);
    assert_eq!(std::fs::read(opened.folder.path().join("swept").join(orphan)).expect("kept"), b"nobody's");
    assert_eq!(store.sweep(NOW, NOW).await.expect("older still"), SweepReport { moved: 0, removed: 1 });
}

#[tokio::test]
async fn a_file_that_somebody_is_about_to_name_is_not_swept() {
    let opened = open().await;
    add_mesh(&opened.store, b"one").await;
    let orphan = put_orphan(&opened.store, b"soon somebody's");
    let pin = opened.store.pinned.pin(vec![orphan.clone()]).await;
    assert_eq!(opened.store.sweep(NOW, LONG).await.expect("pinned"), SweepReport::default());
    opened.store.remove_unreferenced(vec![orphan.clone()]).await.expect("pinned");
    assert_eq!(stored_files(&opened), 2);
    drop(pin);
    assert_eq!(opened.store.sweep(NOW, LONG).await.expect("free").moved, 1);
}

#[tokio::test]
async fn a_database_that_names_no_file_has_none_swept() {
    let opened = open().await;
    put_orphan(&opened.store, b"whose?");
    assert_eq!(opened.store.sweep(NOW, NOW).await.expect("nothing"), SweepReport::default());
    assert_eq!(stored_files(&opened), 1);
}

/// Reopens the store after `change` was applied to its folder.
async fn reopened(opened: Opened, change: impl FnOnce(&std::path::Path)) -> (Result<Store, OpenError>, tempfile::TempDir) {
    let Opened { store, folder } = opened;
    store.close().await.expect("closed");
    drop(store);
    change(folder.path());
    (Store::open(folder.path()).await, folder)
}

#[tokio::test]
async fn a_store_without_its_database_is_not_touched() {
    for change in [
        (|data| std::fs::remove_file(data.join(DATABASE)).expect("removed")) as fn(&std::path::Path),
        |data| std::fs::write(data.join(DATABASE), b"").expect("emptied"),
        |data| {
            std::fs::remove_file(data.join(DATABASE)).expect("removed");
            std::fs::remove_file(data.join("store-id")).expect("removed");
        },
    ] {
        let opened = open().await;
        let mesh = add_mesh(&opened.store, b"one").await;
        let (result, folder) = reopened(opened, change).await;
        assert!(matches!(result.err().expect("refused"), OpenError::DatabaseMissing { .. }));
        assert_eq!(std::fs::read(Files::at(folder.path()).path(&mesh.sha256)).expect("there"), b"one");
        // And a second time, on what the first attempt left behind.
        assert!(matches!(Store::open(folder.path()).await, Err(OpenError::DatabaseMissing { .. })));
    }
}

#[tokio::test]
async fn the_database_of_another_store_is_refused() {
    let other = open().await;
    add_mesh(&other.store, b"other").await;
    other.store.close().await.expect("closed");
    let opened = open().await;
    add_mesh(&opened.store, b"one").await;
    let database = other.folder.path().join(DATABASE);
    let (result, _folder) = reopened(opened, |data| {
        std::fs::copy(database, data.join(DATABASE)).expect("copied");
    })
    .await;
    assert!(matches!(result.err().expect("refused"), OpenError::ForeignDatabase { .. }));
    // A new, empty database beside files without an id.
    let fresh = open().await;
    fresh.store.close().await.expect("closed");
    let opened = open().await;
    add_mesh(&opened.store, b"one").await;
    let database = fresh.folder.path().join(DATABASE);
    let (result, _folder) = reopened(opened, |data| {
        std::fs::copy(database, data.join(DATABASE)).expect("copied");
        std::fs::remove_file(data.join("store-id")).expect("removed");
    })
    .await;
    assert!(matches!(result.err().expect("refused"), OpenError::DatabaseMissing { .. }));
}

#[tokio::test]
async fn a_damaged_database_is_named_and_refused() {
    let opened = open().await;
    for bytes in [b"one", b"two", b"six"] {
        add_mesh(&opened.store, bytes).await;
    }
    let (result, _folder) = reopened(opened, |data| {
        let path = data.join(DATABASE);
        let mut bytes = std::fs::read(&path).expect("it");
        for page in bytes.chunks_mut(4096).skip(2) {
            page[..64].fill(0xa5);
        }
        std::fs::write(path, bytes).expect("damaged");
    })
    .await;
    let error = result.err().expect("refused");
    assert!(matches!(&error, OpenError::DatabaseDamaged { .. }), "{error}");
}

#[tokio::test]
async fn a_closed_store_is_whole_in_its_database_file_alone() {
    let opened = open().await;
    let mesh = add_mesh(&opened.store, b"one").await;
    opened.store.close().await.expect("closed");
    let copy = tempfile::tempdir().expect("a folder");
    std::fs::copy(opened.folder.path().join(DATABASE), copy.path().join(DATABASE)).expect("copied");
    let store = Store::open(copy.path()).await.expect("a store");
    assert_eq!(store.mesh(mesh.id).await.expect("there").sha256, mesh.sha256);
}

#[tokio::test]
async fn a_damaged_file_is_not_given_out_and_is_healed_by_the_same_upload() {
    let opened = open().await;
    let mesh = add_mesh(&opened.store, b"one").await;
    let files = opened.store.files();
    assert!(files.open_checked(&mesh.sha256).is_ok());
    for damage in [Some(&b"onE"[..]), Some(b""), None] {
        match damage {
            Some(bytes) => std::fs::write(files.path(&mesh.sha256), bytes).expect("damage"),
            None => std::fs::remove_file(files.path(&mesh.sha256)).expect("gone"),
        }
        let error = files.open_checked(&mesh.sha256).expect_err("found");
        assert!(
            matches!(&error, Error::FileDamaged { sha256, missing } if *sha256 == mesh.sha256 && *missing == damage.is_none())
        );
        opened.store.scrub_files().await.expect("a look");
        assert_eq!(opened.store.damage().len(), 1);
        assert_eq!(add_mesh(&opened.store, b"one").await.id, mesh.id);
        assert_eq!(files.read(&mesh.sha256).expect("healed"), b"one");
        opened.store.scrub_files().await.expect("a look");
        assert_eq!(opened.store.damage(), []);
    }
}

#[cfg(target_os = "linux")]
#[tokio::test]
async fn a_file_that_the_disk_does_not_give_back_is_damaged_and_the_others_are_checked_all_the_same() {
    let opened = open().await;
    let store = &opened.store;
    let (bad, other, gone) = (add_mesh(store, b"one").await, add_mesh(store, b"two").await, add_mesh(store, b"three").await);
    let path = |mesh: &UploadedMesh| store.files().path(&mesh.sha256);
    for mesh in [&bad, &other, &gone] {
        std::fs::remove_file(path(mesh)).expect("gone");
    }
    // Reading it fails with EIO: nothing lies at the first address of a process.
    std::os::unix::fs::symlink("/proc/self/mem", path(&bad)).expect("a link");
    // Reading it fails with another error, of which nothing is known.
    std::fs::create_dir(path(&other)).expect("a folder");
    store.scrub_files().await.expect_err("one cannot be checked");
    let damaged: Vec<String> = store.damage().into_iter().map(|damage| damage.name).collect();
    let mut wanted = [&bad, &gone].map(|mesh| format!("file {}", mesh.sha256));
    wanted.sort();
    assert_eq!(damaged, wanted);
    assert!(matches!(store.files().read(&bad.sha256), Err(Error::FileDamaged { missing: false, .. })));
    assert_eq!(add_mesh(store, b"one").await.id, bad.id);
    assert_eq!(store.files().read(&bad.sha256).expect("healed"), b"one");
}

#[tokio::test]
async fn damage_to_what_was_deleted_and_files_that_are_there_again_are_forgotten() {
    let opened = open().await;
    let store = &opened.store;
    let (kept, deleted) = (add_mesh(store, b"one").await, add_mesh(store, b"two").await);
    for mesh in [&kept, &deleted] {
        std::fs::remove_file(store.files().path(&mesh.sha256)).expect("gone");
    }
    let unreadable = "UPDATE mesh SET health = '?' WHERE id = ?1";
    sqlx::query(unreadable).bind(deleted.id.to_string()).execute(&store.reader).await.expect("damaged");
    store.scrub_rows().await.expect("a look");
    assert_eq!(store.damage().len(), 3);
    store.delete_mesh(deleted.id, 0).await.expect("free");
    store.scrub_rows().await.expect("a look");
    assert_eq!(store.damage().iter().map(|damage| damage.name.clone()).collect::<Vec<_>>(), [format!("file {}", kept.sha256)]);
    std::fs::write(store.files().path(&kept.sha256), b"one").expect("put back");
    store.scrub_rows().await.expect("a look");
    assert_eq!(store.damage(), []);
}

/// Meshes and jobs of a store, for comparison.
async fn content(data: &Path) -> (Vec<crate::wire::UploadedMesh>, Vec<JobId>) {
    let store = Store::open(data).await.expect("a store");
    let page = Page::new(100, None, "").expect("a page");
    let meshes = store.meshes(&page).await.expect("meshes").items;
    for mesh in &meshes {
        store.files().read(&mesh.sha256).expect("its file");
    }
    let jobs = store.jobs(&JobQuery::default(), &page).await.expect("jobs").items;
    store.close().await.expect("closed");
    (meshes, jobs.iter().map(|job| job.id).collect())
}

#[tokio::test]
async fn a_backup_of_a_store_at_work_is_a_store() {
    let opened = open().await;
    let store = &opened.store;
    let (mesh, other) = (add_mesh(store, b"one").await, add_mesh(store, b"two").await);
    let job = submit(store, mesh.id).await;
    store.claim_next().await.expect("the queue").expect("a job");
    succeed(store, job, vec![("plan.json", b"{}".to_vec())]).await;
    let to = tempfile::tempdir().expect("a folder");
    let (backup_dir, restored) = (to.path().join("backup"), to.path().join("restored"));
    let report = backup(opened.folder.path(), &backup_dir).await.expect("a backup");
    assert_eq!((report.files, report.copied), (3, 3));

    // After a deletion and an upload, only the new file is copied, and the deleted one is removed.
    store.delete_mesh(other.id, 0).await.expect("deleted");
    let third = add_mesh(store, b"three").await;
    let report = backup(opened.folder.path(), &backup_dir).await.expect("a backup");
    assert_eq!((report.files, report.copied), (3, 1));
    assert!(!Files::at(&backup_dir).path(&other.sha256).exists());

    assert_eq!(restore(&backup_dir, &restored).await.expect("restored").files, 3);
    let (meshes, jobs) = content(&restored).await;
    assert_eq!((meshes.len(), jobs), (2, vec![job]));
    assert!(meshes.iter().any(|kept| kept.id == third.id));
    // The backup can be opened as a store itself, and no restore overwrites a store.
    assert_eq!(content(&backup_dir).await.1, [job]);
    assert!(matches!(restore(&backup_dir, &restored).await, Err(BackupError::NotEmpty(_))));
    assert!(matches!(restore(&to.path().join("nothing"), &restored).await, Err(BackupError::NoStore(_))));
    let foreign = open().await;
    assert!(matches!(backup(foreign.folder.path(), &backup_dir).await, Err(BackupError::OtherStore(_))));
}

#[tokio::test]
async fn a_backup_goes_neither_onto_its_store_nor_into_a_folder_in_use() {
    let opened = open().await;
    let data = opened.folder.path();
    for same in [data.to_owned(), data.join("files/..")] {
        let refused = backup(data, &same).await.expect_err("itself");
        assert!(
            matches!(refused, BackupError::OntoItself(_)) && refused.to_string().contains("choose another folder"),
            "{refused}"
        );
    }
    let to = tempfile::tempdir().expect("a folder");
    backup(data, to.path()).await.expect("a backup");
    let live = Store::open(to.path()).await.expect("a store");
    assert!(matches!(backup(data, to.path()).await, Err(BackupError::Open(OpenError::InUse(_)))));
    live.close().await.expect("closed");
    drop(live);
    backup(data, to.path()).await.expect("free again");
}

#[tokio::test]
async fn a_backup_names_what_is_damaged() {
    let opened = open().await;
    let mesh = add_mesh(&opened.store, b"one").await;
    let to = tempfile::tempdir().expect("a folder");
    backup(opened.folder.path(), &to.path().join("good")).await.expect("a backup");
    std::fs::write(opened.store.files().path(&mesh.sha256), b"onE").expect("damage");
    for damaged in [backup(opened.folder.path(), &to.path().join("bad")).await.expect_err("damaged"), {
        std::fs::write(Files::at(&to.path().join("good")).path(&mesh.sha256), b"").expect("damage");
        restore(&to.path().join("good"), &to.path().join("restored")).await.expect_err("damaged")
    }] {
        assert!(matches!(&damaged, BackupError::Damaged(files) if *files == [mesh.sha256.clone()]), "{damaged}");
    }
}

#[tokio::test]
async fn the_same_upload_heals_damage_that_was_not_noticed() {
    let opened = open().await;
    let mesh = add_mesh(&opened.store, b"one").await;
    let files = opened.store.files();
    files.open_checked(&mesh.sha256).expect("whole");
    let path = files.path(&mesh.sha256);
    let before = std::fs::metadata(&path).and_then(|about| about.modified()).expect("a time");
    // Bits that flip on the disk change no time.
    std::fs::write(&path, b"onE").expect("damage");
    std::fs::File::options().write(true).open(&path).and_then(|file| file.set_modified(before)).expect("set back");
    files.open_checked(&mesh.sha256).expect("it was checked within the hour");
    assert_eq!(add_mesh(&opened.store, b"one").await.id, mesh.id);
    assert_eq!(std::fs::read(&path).expect("healed"), b"one");
}

#[tokio::test]
async fn a_disk_that_fails_under_a_checked_file_makes_it_damaged_and_a_shortage_does_not() {
    let opened = open().await;
    let mesh = add_mesh(&opened.store, b"one").await;
    let error = |code| opened.store.files().read_error(&mesh.sha256, std::io::Error::from_raw_os_error(code));
    let [eio, emfile] = [error(5), error(24)];
    assert!(matches!(&eio, Error::FileDamaged { sha256, missing: false } if *sha256 == mesh.sha256), "{eio}");
    assert!(emfile.is_transient(), "{emfile}");
}

#[tokio::test]
async fn a_row_whose_bytes_are_no_text_harms_itself_alone() {
    let opened = open().await;
    let store = &opened.store;
    let mesh = add_mesh(store, b"one").await.id;
    for column in ["request", "input"] {
        let (bad, good) = (submit(store, mesh).await, submit(store, mesh).await);
        store.damage_text(&format!("job_body SET {column}"), &format!("job_id = '{bad}'")).await;
        assert!(store.body(bad).await.expect("looked at").is_none(), "{column}");
        assert_eq!(store.claim_next().await.expect("the queue").expect("the other job").id, good, "{column}");
        let job = store.job(bad).await.expect("shown");
        assert_eq!((job.state, job.problem.expect("the reason").code.as_str()), (JobState::Failed, "job_unreadable"), "{column}");
    }
    store.damage_text("mesh SET health", &format!("id = '{mesh}'")).await;
    store.mesh(mesh).await.expect("usable without its report");
    store.scrub_rows().await.expect("a look");
    let damaged: Vec<String> = store.damage().into_iter().map(|damage| damage.name).collect();
    assert!(damaged.len() == 2 && damaged[0].starts_with("job ") && damaged[1] == format!("mesh {mesh}"), "{damaged:?}");
}

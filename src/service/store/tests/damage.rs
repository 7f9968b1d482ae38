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

    assert_eq!(restore(&backup_dir, &restored, false).await.expect("restored").files, 3);
    let (meshes, jobs) = content(&restored).await;
    assert_eq!((meshes.len(), jobs), (2, vec![job]));
    assert!(meshes.iter().any(|kept| kept.id == third.id));
    // The backup can be opened as a store itself, and no restore overwrites a store.
    assert_eq!(content(&backup_dir).await.1, [job]);
    assert!(matches!(restore(&backup_dir, &restored, false).await, Err(BackupError::NotEmpty(_))));
    assert!(matches!(restore(&to.path().join("nothing"), &restored, false).await, Err(BackupError::NoStore(_))));
    let foreign = open().await;
    assert!(matches!(backup(foreign.folder.path(), &backup_dir).await, Err(BackupError::OtherStore(_))));
}

/// A client from before the restore must not move a cell that another has leased since.
#[tokio::test]
async fn a_fencing_token_that_was_given_after_the_backup_is_not_given_again() {
    let opened = open().await;
    opened.store.note_fence(7, None).await.expect("noted");
    let to = tempfile::tempdir().expect("a folder");
    let (backup_dir, restored) = (to.path().join("backup"), to.path().join("restored"));
    backup(opened.folder.path(), &backup_dir).await.expect("a backup");
    opened.store.note_fence(9, None).await.expect("noted");
    restore(&backup_dir, &restored, false).await.expect("restored");
    let last = Store::open(&restored).await.expect("a store").last_fence().await.expect("read");
    assert!(last > 9, "{last}");
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
    // It would be deleted with the store, as what is restored into a backup would be with the backup.
    for below in ["backup", "files/../deep/backup"].map(|name| data.join(name)) {
        let refused = backup(data, &below).await.expect_err("below the store");
        assert!(matches!(refused, BackupError::BelowSource { .. }) && !data.join("backup").exists(), "{refused}");
        assert!(matches!(restore(data, &below, false).await, Err(BackupError::BelowSource { .. })));
    }
    let to = tempfile::tempdir().expect("a folder");
    backup(data, to.path()).await.expect("a backup");
    let live = Store::open(to.path()).await.expect("a store");
    assert!(matches!(backup(data, to.path()).await, Err(BackupError::Open(OpenError::InUse(_)))));
    live.close().await.expect("closed");
    drop(live);
    backup(data, to.path()).await.expect("free again");
}

/// The last one passed for a folder outside.
#[cfg(unix)]
#[tokio::test]
async fn a_folder_below_the_store_is_refused_however_it_is_named() {
    let opened = open().await;
    let data = opened.folder.path();
    let outside = tempfile::tempdir().expect("a folder");
    let link = outside.path().join("link");
    std::os::unix::fs::symlink(data.join("files"), &link).expect("a link");
    let up: PathBuf = std::env::current_dir().expect("a folder").components().skip(1).map(|_| "..").collect();
    let from_root = std::fs::canonicalize(data).expect("there").strip_prefix("/").expect("absolute").to_owned();
    // `..` after a folder that is missing leads out of it once it is made.
    let hidden = std::fs::canonicalize(outside.path()).expect("there").join("missing");
    let to_root: PathBuf = hidden.components().skip(1).map(|_| "..").collect();
    for below in [
        link.clone(),
        link.join("backup"),
        up.join(&from_root).join("backup"),
        data.join("backup/"),
        hidden.join(to_root).join(&from_root).join("backup"),
    ] {
        let refused = backup(data, &below).await.expect_err("below the store");
        assert!(matches!(refused, BackupError::BelowSource { .. }), "{}: {refused}", below.display());
        let refused = restore(data, &below, false).await.expect_err("below the backup");
        assert!(matches!(refused, BackupError::BelowSource { .. }), "{}: {refused}", below.display());
        let left = [data.join("backup"), data.join("files/backup"), hidden.clone()];
        assert!(left.iter().all(|folder| !folder.exists()), "{}", below.display());
    }
}

/// The files that it had copied stayed, and the next restore refused the folder.
#[tokio::test]
async fn a_restore_that_fails_leaves_nothing_behind() {
    let opened = open().await;
    add_mesh(&opened.store, b"one").await;
    let to = tempfile::tempdir().expect("a folder");
    let (backup_dir, above) = (to.path().join("backup"), to.path().join("above"));
    let restored = above.join("deep/restored");
    backup(opened.folder.path(), &backup_dir).await.expect("a backup");
    // Logs are copied after the files.
    let no_folder = backup_dir.join("audit");
    std::fs::write(&no_folder, b"no folder").expect("a file");
    let failed = restore(&backup_dir, &restored, false).await.expect_err("no logs");
    assert!(matches!(failed, BackupError::File { .. }) && !above.exists(), "{failed}");
    std::fs::create_dir_all(restored.join("lost+found")).expect("a folder");
    restore(&backup_dir, &restored, false).await.expect_err("no logs");
    let name = |entry: std::io::Result<std::fs::DirEntry>| entry.expect("an entry").file_name().into_string().expect("ASCII");
    let mut left: Vec<String> = std::fs::read_dir(&restored).expect("a folder").map(name).collect();
    left.sort();
    assert_eq!(left, ["in-use", "lost+found"]);
    // What another process has there is left alone.
    std::fs::remove_file(&no_folder).expect("removed");
    let live = Store::open(&restored).await.expect("a store");
    assert!(matches!(restore(&backup_dir, &restored, false).await, Err(BackupError::Open(OpenError::InUse(_)))));
    add_mesh(&live, b"two").await;
    live.close().await.expect("closed");
    drop(live);
    assert!(matches!(restore(&backup_dir, &restored, false).await, Err(BackupError::NotEmpty(_))));
    assert_eq!(content(&restored).await.0.len(), 1);
}

#[tokio::test]
async fn a_damaged_file_is_named_and_everything_else_is_backed_up_and_restored() {
    let opened = open().await;
    let store = &opened.store;
    let (mesh, other) = (add_mesh(store, b"one").await, add_mesh(store, b"two").await);
    let job = submit(store, mesh.id).await;
    let to = tempfile::tempdir().expect("a folder");
    let [good, bad, restored] = ["good", "bad", "restored"].map(|name| to.path().join(name));
    backup(opened.folder.path(), &good).await.expect("a backup");
    std::fs::write(store.files().path(&mesh.sha256), b"onE").expect("damage");
    let later = add_mesh(store, b"three").await;

    // A later backup has what is new, and keeps what is whole in it and damaged in the store.
    backup(opened.folder.path(), &good).await.expect("the backup has the file");
    assert_eq!(Files::at(&good).read(&mesh.sha256).expect("kept"), b"one");
    Files::at(&good).read(&later.sha256).expect("copied");

    let told = backup(opened.folder.path(), &bad).await.expect_err("damaged");
    let refused = restore(&bad, &restored, false).await.expect_err("damaged");
    for (error, is_wanted) in
        [(&told, matches!(told, BackupError::Incomplete(_))), (&refused, matches!(refused, BackupError::Damaged(_)))]
    {
        let said = error.to_string();
        assert!(is_wanted && said.contains(&format!("{} (mesh {}, job {job})", mesh.sha256, mesh.id)), "{said}");
        assert!(!said.contains(&other.sha256), "{said}");
    }
    assert!(!restored.exists(), "a folder that it made is gone");
    std::fs::create_dir(&restored).expect("a folder");
    restore(&bad, &restored, false).await.expect_err("damaged");
    assert!(restored.exists() && !restored.join("files").exists(), "the folder is as empty as before");
    let report = restore(&bad, &restored, true).await.expect("the rest");
    assert_eq!((report.copied, report.damaged.len()), (2, 1));
    let store = Store::open(&restored).await.expect("a store");
    assert_eq!(store.files().read(&other.sha256).expect("whole"), b"two");
    assert!(matches!(store.files().read(&mesh.sha256), Err(Error::FileDamaged { missing: true, .. })));
    assert_eq!(add_mesh(&store, b"one").await.id, mesh.id);
    assert_eq!(store.files().read(&mesh.sha256).expect("healed"), b"one");
}

/// Audit logs are the record of what moved: they go with the backup, grow with it, and stay in it as long as their run.
#[tokio::test]
async fn audit_logs_are_backed_up_and_restored() {
    let opened = open().await;
    let data = opened.folder.path();
    let [kept, deleted] = ["018f0000-0000-7000-8000-000000000001", "018f0000-0000-7000-8000-000000000002"];
    let log = |folder: &Path, run: &str| folder.join("audit").join(run).join("audit-00000001.log");
    for run in [kept, deleted] {
        let insert = "INSERT INTO run (id, cell, mode, state, body) VALUES (?1, 'c', 'live', 'done', '')";
        sqlx::query(insert).bind(run).execute(&opened.store.reader).await.expect("a run");
        std::fs::create_dir_all(log(data, run).parent().expect("a folder")).expect("made");
        std::fs::write(log(data, run), b"first\n").expect("a log");
    }
    let to = tempfile::tempdir().expect("a folder");
    let (backup_dir, restored) = (to.path().join("backup"), to.path().join("restored"));
    let copied = async || backup(data, &backup_dir).await.expect("a backup").audit_logs;
    assert_eq!(copied().await, 2);
    assert_eq!(copied().await, 0, "neither has changed");
    std::fs::write(log(data, kept), b"first\nsecond\n").expect("grown");
    sqlx::query("DELETE FROM run WHERE id = ?1").bind(deleted).execute(&opened.store.reader).await.expect("deleted");
    assert_eq!(copied().await, 1);
    assert!(log(&backup_dir, deleted).exists(), "it is in the store too");
    std::fs::remove_dir_all(data.join("audit").join(deleted)).expect("removed");
    assert_eq!(copied().await, 0);
    assert!(!log(&backup_dir, deleted).exists());
    std::fs::remove_dir_all(data.join("audit")).expect("lost");
    assert_eq!(copied().await, 0);
    assert_eq!(restore(&backup_dir, &restored, false).await.expect("restored").audit_logs, 1);
    assert_eq!(std::fs::read(log(&restored, kept)).expect("kept"), b"first\nsecond\n");
}

#[tokio::test]
async fn strange_files_are_left_alone_and_those_of_a_killed_backup_are_removed() {
    let opened = open().await;
    let (data, store) = (opened.folder.path(), &opened.store);
    let mesh = add_mesh(store, b"one").await;
    let shard = &mesh.sha256[..2];
    let strange = [data.join("files/.DS_Store"), data.join("files").join(shard).join("Thumbs.db"), data.join("swept/note")];
    std::fs::create_dir_all(data.join("swept")).expect("a folder");
    strange.iter().for_each(|path| std::fs::write(path, b"strange").expect("a file"));
    assert_eq!(stored_files(&opened), 1);
    store.scrub_rows().await.expect("a look");
    assert_eq!(store.sweep(NOW, NOW).await.expect("nothing"), SweepReport::default());
    assert!(strange.iter().all(|path| path.exists()));

    let to = tempfile::tempdir().expect("a folder");
    let left = to.path().join("files").join(shard).join(".tmpAbC123");
    std::fs::create_dir_all(left.parent().expect("a folder")).expect("made");
    std::fs::write(&left, b"half").expect("a file");
    assert_eq!(backup(data, to.path()).await.expect("a backup").copied, 1);
    assert!(!left.exists());
}

#[tokio::test]
async fn a_new_file_system_is_empty_enough_for_a_restore() {
    let opened = open().await;
    let to = tempfile::tempdir().expect("a folder");
    let (backup_dir, mount) = (to.path().join("backup"), to.path().join("mount"));
    backup(opened.folder.path(), &backup_dir).await.expect("a backup");
    std::fs::create_dir_all(mount.join("lost+found")).expect("a folder");
    restore(&backup_dir, &mount, false).await.expect("restored");
    Store::open(&mount).await.expect("a store");
}

/// Between backup and restore a tag was given that nobody may have for other contents.
#[tokio::test]
async fn no_entity_tag_is_given_again_after_a_restore() {
    let opened = open().await;
    let to = tempfile::tempdir().expect("a folder");
    let (backup_dir, restored) = (to.path().join("backup"), to.path().join("restored"));
    let put = async |store: &Store, name: &str| {
        store.put_spec(SpecCollection::Robot, name, "{}", &Precondition::Absent).await.expect("stored").etag
    };
    put(&opened.store, "a").await;
    backup(opened.folder.path(), &backup_dir).await.expect("a backup");
    let given = put(&opened.store, "b").await;
    restore(&backup_dir, &restored, false).await.expect("restored");
    assert_ne!(put(&Store::open(&restored).await.expect("a store"), "b").await, given);
}

#[tokio::test]
async fn damage_that_a_reader_finds_is_told_at_once() {
    let opened = open().await;
    let store = &opened.store;
    let (mesh, deleted) = (add_mesh(store, b"one").await, add_mesh(store, b"two").await);
    for mesh in [&mesh, &deleted] {
        std::fs::write(store.files().path(&mesh.sha256), b"?").expect("damage");
        store.files().read(&mesh.sha256).expect_err("damaged");
    }
    store.delete_mesh(deleted.id, 0).await.expect("free");
    store.scrub_suspects().await.expect("a look");
    let names: Vec<String> = store.damage().into_iter().map(|damage| damage.name).collect();
    assert_eq!(names, [format!("file {}", mesh.sha256)]);
    add_mesh(store, b"one").await;
    assert!(store.damage().is_empty(), "the same upload repairs it: {:?}", store.damage());
}

#[tokio::test]
async fn a_removed_folder_of_unfinished_files_comes_back_and_a_removed_disk_does_not() {
    let opened = open().await;
    let data = opened.folder.path();
    std::fs::remove_dir(data.join("unfinished")).expect("gone");
    add_mesh(&opened.store, b"one").await;
    std::fs::remove_dir(data.join("unfinished")).expect("gone");
    std::fs::remove_dir_all(data.join("files")).expect("gone");
    assert!(opened.store.files().receive().is_err());
}

#[cfg(unix)]
#[tokio::test]
async fn only_the_owner_reads_what_a_store_creates() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().expect("a folder");
    let data = folder.path().join("new/store");
    let store = Store::open(&data).await.expect("a store");
    let mesh = add_mesh(&store, b"one").await;
    let file = store.files().path(&mesh.sha256);
    let copy = folder.path().join("backup");
    backup(&data, &copy).await.expect("a backup");
    let database = ["vantage.db", "vantage.db-wal", "vantage.db-shm"].map(|name| (data.join(name), 0o600));
    let others = [(data.clone(), 0o700), (data.join("files"), 0o700), (file, 0o600), (copy.join(DATABASE), 0o600)];
    for (path, wanted) in database.into_iter().chain(others) {
        let mode = std::fs::metadata(&path).expect("there").permissions().mode() & 0o777;
        assert_eq!(mode, wanted, "{}: {mode:o}", path.display());
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

//! Audit logs on the disk: a folder a run, in the folder of the settings.

use std::collections::BTreeMap;
use std::fs::{self, DirEntry};
use std::io::{self, ErrorKind};
use std::path::Path;

use crate::wire::RunId;

/// Bytes of each audit log in a folder. What is not named by a run, as in a folder that others use too, does not count. Blocks.
pub(in crate::service) fn log_sizes(audit_dir: &Path) -> io::Result<BTreeMap<RunId, u64>> {
    let mut sizes = BTreeMap::new();
    for folder in entries(audit_dir)? {
        let Some(run) = folder.file_name().to_str().and_then(|name| name.parse().ok()) else { continue };
        if folder.file_type()?.is_dir() {
            sizes.insert(run, size_bytes(&folder.path())?);
        }
    }
    Ok(sizes)
}

/// Bytes of the files in a folder. One may be deleted while it is looked at: logs are rotated, and go with their runs.
fn size_bytes(folder: &Path) -> io::Result<u64> {
    let mut bytes = 0;
    for file in entries(folder)? {
        match file.metadata() {
            Ok(about) if about.is_file() => bytes += about.len(),
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
            Ok(_) | Err(_) => {}
        }
    }
    Ok(bytes)
}

/// Entries of a folder; none if it does not exist.
fn entries(folder: &Path) -> io::Result<Vec<DirEntry>> {
    match fs::read_dir(folder) {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(Vec::new()),
        entries => entries?.collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_files_of_runs_count_and_no_others() {
        let folder = tempfile::tempdir().expect("a folder");
        let [one, other] = [RunId::generate(), RunId::generate()];
        let write = |path: String, bytes: usize| {
            let path = folder.path().join(path);
            fs::create_dir_all(path.parent().expect("a folder")).expect("created");
            fs::write(path, vec![b'x'; bytes]).expect("written");
        };
        write(format!("{one}/audit-00000001.log"), 300);
        write(format!("{one}/audit-00000002.log"), 40);
        write(format!("{other}/audit-00000001.log"), 5);
        write("syslog".to_owned(), 1000);
        write("journal/system".to_owned(), 1000);
        write(RunId::generate().to_string(), 1000);
        assert_eq!(log_sizes(folder.path()).expect("read"), BTreeMap::from([(one, 340), (other, 5)]));
        assert_eq!(log_sizes(&folder.path().join("nowhere")).expect("none yet"), BTreeMap::new());
    }
}

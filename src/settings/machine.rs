//! Resources of the machine.

use std::fs;
use std::path::Path;

/// Place where the system has its control groups.
const CONTROL_GROUPS: &str = "/sys/fs/cgroup";

/// Bytes of memory that this process may use: the machine's, or the limit of its control group or of one that this is in, if that is
/// less. `None` if the system does not report it.
#[must_use]
pub fn memory_bytes() -> Option<u64> {
    let machine = fs::read_to_string("/proc/meminfo").ok().and_then(|text| total_bytes(&text));
    let groups = fs::read_to_string("/proc/self/cgroup").unwrap_or_default();
    machine.into_iter().chain(group_bytes(&groups, Path::new(CONTROL_GROUPS))).min()
}

/// Parses the total in `/proc/meminfo`.
fn total_bytes(text: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kib.checked_mul(1024)
}

/// Smallest limit of the control groups in `/proc/self/cgroup` and of all that they are in, below the folder `root`.
fn group_bytes(groups: &str, root: &Path) -> Option<u64> {
    groups.lines().filter_map(|line| limit_of_group(line, root)).min()
}

/// Limit of one line, `NUMBER:CONTROLLERS:PATH`: version 2 names no controllers, version 1 has a hierarchy for memory.
fn limit_of_group(line: &str, root: &Path) -> Option<u64> {
    let (controllers, path) = line.split_once(':')?.1.split_once(':')?;
    let (root, file) = match controllers {
        "" => (root.to_owned(), "memory.max"),
        _ if controllers.split(',').any(|controller| controller == "memory") => (root.join("memory"), "memory.limit_in_bytes"),
        _ => return None,
    };
    // A container sees its own group as the root, and may be told a path that it cannot see. No limit is `max`, which is no number.
    let levels = Path::new(path.trim_start_matches('/')).ancestors();
    levels.filter_map(|level| fs::read_to_string(root.join(level).join(file)).ok()?.trim().parse().ok()).min()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_total_is_read_in_kibibytes() {
        assert_eq!(total_bytes("MemTotal:       24681384 kB\nMemFree: 1 kB\n"), Some(24_681_384 * 1024));
        assert_eq!(total_bytes("MemFree: 1 kB\n"), None);
        if cfg!(target_os = "linux") {
            assert!(memory_bytes().is_some_and(|bytes| bytes > 1 << 24));
        }
    }

    /// systemd limits a service in its own group or in its slice, a container runtime in what the container sees as the root.
    #[test]
    fn the_least_limit_of_all_levels_counts() {
        let folder = tempfile::tempdir().expect("a folder");
        let write = |path: &str, text: &str| {
            let path = folder.path().join(path);
            std::fs::create_dir_all(path.parent().expect("a folder")).expect("created");
            std::fs::write(path, text).expect("written");
        };
        write("system.slice/vantage.service/memory.max", "max\n");
        write("system.slice/memory.max", "3000\n");
        write("user.slice/memory.max", "1\n");
        write("memory/docker/memory.limit_in_bytes", "2000\n");
        write("memory/memory.limit_in_bytes", "9223372036854771712\n");
        let limit = |groups: &str| group_bytes(groups, folder.path());
        assert_eq!(limit("0::/system.slice/vantage.service\n"), Some(3000));
        assert_eq!(limit("5:cpu,cpuacct:/docker\n4:memory:/docker/not-seen\n0::/\n"), Some(2000));
        assert_eq!(limit("0::/other.slice\n"), None);
        write("memory.max", "1000\n");
        assert_eq!(limit("0::/system.slice/vantage.service\n"), Some(1000));
        assert_eq!(limit(""), None);
    }
}

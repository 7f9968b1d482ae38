//! The keys that clients present: the one in the settings, and those in a file, each with a name. The file is read again when it
//! changes, so that keys are exchanged without a restart; a file that cannot be read any more, or is empty, leaves the keys as they
//! were.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use sha2::{Digest, Sha256};

use super::auth::ApiKey;
use super::options::ServerOptions;
use crate::service::{LogPace, metrics};
use crate::wire::is_spec_name;

/// Name of the key in the settings.
const OF_SETTINGS: &str = "api_key";
/// Time between two looks at the file.
const LOOK_INTERVAL: Duration = Duration::from_secs(1);

/// Time between two lines of the log on wrong keys: who guesses must not fill it.
const WRONG_INTERVAL: Duration = Duration::from_secs(10);

/// SHA-256 of a key.
pub(super) type KeyDigest = [u8; 32];

/// Name of the key that a request presented.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct KeyName(pub Arc<str>);

/// A key with its name. The key itself is not kept.
#[derive(Clone, Debug, PartialEq, Eq)]
struct NamedKey {
    name: KeyName,
    digest: KeyDigest,
}

/// All keys.
#[derive(Debug)]
pub(super) struct Keys {
    of_settings: Option<NamedKey>,
    file: Option<KeysFile>,
    /// Lines of the log on wrong keys.
    wrong: Mutex<LogPace>,
}

/// A file of keys.
#[derive(Debug)]
struct KeysFile {
    path: PathBuf,
    read: Mutex<ReadFile>,
}

/// A file as it was read last.
#[derive(Debug)]
struct ReadFile {
    looked: Instant,
    /// Time of its last change, and its size.
    version: Option<(SystemTime, u64)>,
    keys: Arc<[NamedKey]>,
}

impl Keys {
    /// The keys of a server.
    pub(super) fn open(options: &ServerOptions) -> Self {
        let of_settings = options.api_key.as_ref().map(NamedKey::of_settings);
        let file = options.api_keys_file.clone().map(|path| KeysFile::open(path, of_settings.as_ref()));
        Self { of_settings, file, wrong: Mutex::new(LogPace::every(WRONG_INTERVAL)) }
    }

    /// Returns true if requests need a key, also where none is right at the moment.
    pub(super) fn are_required(&self) -> bool {
        self.of_settings.is_some() || self.file.is_some()
    }

    /// Name of the key that was presented, if it is one of ours.
    pub(super) fn find(&self, presented: &str, now: Instant) -> Option<KeyName> {
        self.name_of(&digest_of(presented), now)
    }

    /// Counts a wrong key. Returns the number of those since the latest line of the log where another line is due.
    pub(super) fn count_wrong(&self, now: Instant) -> Option<u64> {
        // Whole after every operation, also where a thread died in between.
        self.wrong.lock().unwrap_or_else(PoisonError::into_inner).count(now)
    }

    /// Name of the key with this digest, if it is still one of ours.
    pub(super) fn name_of(&self, digest: &KeyDigest, now: Instant) -> Option<KeyName> {
        let in_file = self.file.as_ref().map(|file| file.keys(now, self.of_settings.as_ref()));
        let all = self.of_settings.iter().chain(in_file.iter().flat_map(|keys| keys.iter()));
        // Every key is compared whole, so that the time tells nothing.
        all.fold(None, |found, key| if key.has(digest) { found.or_else(|| Some(key.name.clone())) } else { found })
    }
}

impl NamedKey {
    fn new(name: &str, digest: KeyDigest) -> Self {
        Self { name: KeyName(name.into()), digest }
    }

    fn of_settings(key: &ApiKey) -> Self {
        Self::new(OF_SETTINGS, key.digest())
    }

    fn has(&self, digest: &KeyDigest) -> bool {
        same(&self.digest, digest)
    }
}

impl KeysFile {
    fn open(path: PathBuf, of_settings: Option<&NamedKey>) -> Self {
        let version = version_of(&path);
        let keys = read(&path, of_settings).unwrap_or_else(|reason| {
            tracing::error!(reason, "the keys in server.api_keys_file cannot be read; none of them is accepted");
            Vec::new()
        });
        Self { path, read: Mutex::new(ReadFile { looked: Instant::now(), version, keys: keys.into() }) }
    }

    /// The keys, read again if the file has changed.
    fn keys(&self, now: Instant, of_settings: Option<&NamedKey>) -> Arc<[NamedKey]> {
        // Whole after every operation, also where a thread died in between.
        let mut state = self.read.lock().unwrap_or_else(PoisonError::into_inner);
        if now.saturating_duration_since(state.looked) >= LOOK_INTERVAL {
            state.looked = now;
            let version = version_of(&self.path);
            if version != state.version {
                state.version = version;
                let read = read_changed(&self.path, of_settings);
                // A typing error must not lock everybody out, but a key that was to be revoked is in force as long as it stands.
                metrics::record(|metrics| metrics.api_keys_file_unreadable.set(if read.is_err() { 1.0 } else { 0.0 }));
                match read {
                    Ok(keys) => {
                        tracing::info!(keys = keys.len(), "server.api_keys_file has changed; its keys are in force");
                        state.keys = keys.into();
                    }
                    Err(reason) => tracing::error!(
                        reason,
                        "server.api_keys_file has changed but cannot be used; the earlier keys stay in force"
                    ),
                }
            }
        }
        Arc::clone(&state.keys)
    }
}

fn version_of(path: &Path) -> Option<(SystemTime, u64)> {
    let about = std::fs::metadata(path).ok()?;
    Some((about.modified().ok()?, about.len()))
}

/// Checks a file of keys, beside the key in the settings.
///
/// # Errors
/// The reason why it cannot be used; no key is in it.
pub fn check_keys_file(path: &Path, api_key: Option<&ApiKey>) -> Result<(), String> {
    read(path, api_key.map(NamedKey::of_settings).as_ref()).map(drop)
}

fn read(path: &Path, of_settings: Option<&NamedKey>) -> Result<Vec<NamedKey>, String> {
    parse(path, &text_of(path)?, of_settings)
}

/// Reads a file of keys that has changed. One that is empty is not what somebody wrote who revokes keys: an editor or a full disk has
/// cut it off, which must not lock everybody out.
fn read_changed(path: &Path, of_settings: Option<&NamedKey>) -> Result<Vec<NamedKey>, String> {
    let text = text_of(path)?;
    if text.trim().is_empty() {
        return Err(format!("{}: is empty; to revoke every key, leave a comment in it, such as \"# none\"", path.display()));
    }
    parse(path, &text, of_settings)
}

fn text_of(path: &Path) -> Result<String, String> {
    let next = "name a text file that the server's user may read";
    std::fs::read_to_string(path).map_err(|error| format!("{}: {error}; {next}", path.display()))
}

fn parse(path: &Path, text: &str, of_settings: Option<&NamedKey>) -> Result<Vec<NamedKey>, String> {
    // The error's own text would show the line, and the key in it.
    let keys: BTreeMap<String, ApiKey> = toml::from_str(text)
        .map_err(|error| format!("{}: {}; allowed are lines of the form name = \"key\"", path.display(), error.message()))?;
    let named = keys.iter().map(|(name, key)| match (is_spec_name(name) && name != OF_SETTINGS, key.is_valid()) {
        (true, true) => Ok(NamedKey::new(name, key.digest())),
        (false, _) => Err(format!(
            "{}: {name:?} is not a name for a key: 1 to 64 of a-z, 0-9, '.', '_' and '-', beginning with a letter or digit, but not \
             {OF_SETTINGS:?}",
            path.display()
        )),
        (true, false) => Err(format!(
            "{}: the key of {name:?} must be 16 to 256 visible ASCII characters, without ; and ,; give another",
            path.display()
        )),
    });
    let named = named.collect::<Result<Vec<NamedKey>, String>>()?;
    check_distinct(&named, of_settings).map_err(|reason| format!("{}: {reason}", path.display()))?;
    Ok(named)
}

/// Refuses one key under two names: whoever revokes one of them would leave its holder in under the other.
fn check_distinct(keys: &[NamedKey], of_settings: Option<&NamedKey>) -> Result<(), String> {
    for (index, key) in keys.iter().enumerate() {
        let KeyName(name) = &key.name;
        if of_settings.is_some_and(|other| other.has(&key.digest)) {
            return Err(format!("the key of {name:?} is that of server.api_key too; give each a key of its own"));
        }
        if let Some(NamedKey { name: KeyName(other), .. }) = keys[..index].iter().find(|other| other.has(&key.digest)) {
            return Err(format!("{other:?} and {name:?} have the same key; give each name a key of its own"));
        }
    }
    Ok(())
}

/// SHA-256 of a presented key.
pub(super) fn digest_of(key: &str) -> KeyDigest {
    Sha256::digest(key).into()
}

/// Compares in constant time: all bytes.
pub(super) fn same(a: &KeyDigest, b: &KeyDigest) -> bool {
    a.iter().zip(b).fold(0, |differing, (a, b)| differing | (a ^ b)) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    const MES: &str = "0123456789abcdef-mes";
    const LINE: &str = "0123456789abcdef-line";

    fn opened(text: &str) -> (Keys, tempfile::NamedTempFile) {
        let file = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(file.path(), text).expect("written");
        let options = ServerOptions { api_keys_file: Some(file.path().to_owned()), ..ServerOptions::for_tests() };
        (Keys::open(&options), file)
    }

    fn name(keys: &Keys, presented: &str, secs: u64) -> Option<String> {
        let now = Instant::now() + Duration::from_secs(secs);
        keys.find(presented, now).map(|KeyName(name)| name.to_string())
    }

    #[test]
    fn keys_have_names_and_change_with_their_file() {
        let (keys, file) = opened(&format!("mes = \"{MES}\"\nline-3 = \"{LINE}\"\n"));
        assert!(keys.are_required());
        assert_eq!(name(&keys, MES, 0).as_deref(), Some("mes"));
        assert_eq!(name(&keys, LINE, 0).as_deref(), Some("line-3"));
        assert_eq!(name(&keys, &MES[1..], 0), None);
        let digest = digest_of(MES);
        assert_eq!(keys.name_of(&digest, Instant::now()), Some(KeyName("mes".into())));
        // One is exchanged, one is gone; another size tells the file from the one before within a tick of the clock.
        std::fs::write(file.path(), "mes = \"fedcba9876543210-new\"\n").expect("written");
        assert_eq!(name(&keys, "fedcba9876543210-new", 2).as_deref(), Some("mes"));
        assert_eq!([name(&keys, MES, 2), name(&keys, LINE, 2)], [None, None]);
        assert_eq!(keys.name_of(&digest, Instant::now() + Duration::from_secs(2)), None);
        // A file that is broken or missing locks nobody out, and lets nobody in.
        std::fs::write(file.path(), "mes = fedcba").expect("written");
        assert_eq!(name(&keys, "fedcba9876543210-new", 4).as_deref(), Some("mes"));
        std::fs::remove_file(file.path()).expect("removed");
        assert_eq!(name(&keys, "fedcba9876543210-new", 6).as_deref(), Some("mes"));
        assert_eq!(name(&keys, "", 8), None);
    }

    #[test]
    fn an_emptied_file_locks_nobody_out_and_a_comment_in_it_revokes_every_key() {
        let (keys, file) = opened(&format!("mes = \"{MES}\"\n"));
        std::fs::write(file.path(), "\n").expect("written");
        assert_eq!(name(&keys, MES, 2).as_deref(), Some("mes"));
        std::fs::write(file.path(), "# none\n").expect("written");
        assert_eq!(name(&keys, MES, 4), None);
    }

    /// Someone whose key is removed from one of the two lines would stay in.
    #[test]
    fn one_key_under_two_names_is_refused_at_the_start_and_keeps_the_earlier_keys_in_force_later() {
        let twice = format!("alice = \"{MES}\"\nbob = \"{MES}\"\n");
        let (keys, file) = opened(&twice);
        assert_eq!(name(&keys, MES, 0), None);
        let reason = check_keys_file(file.path(), None).expect_err("one key");
        assert!(reason.contains("\"alice\" and \"bob\"") && !reason.contains(MES), "{reason}");
        std::fs::write(file.path(), format!("alice = \"{MES}\"\n")).expect("written");
        assert_eq!(name(&keys, MES, 2).as_deref(), Some("alice"));
        let api_key = |text: &str| serde_json::from_value::<ApiKey>(text.into()).expect("a key");
        let reason = check_keys_file(file.path(), Some(&api_key(MES))).expect_err("one key");
        assert!(reason.contains("\"alice\"") && reason.contains("server.api_key") && !reason.contains(MES), "{reason}");
        assert_eq!(check_keys_file(file.path(), Some(&api_key(LINE))), Ok(()));
        std::fs::write(file.path(), twice).expect("written");
        assert_eq!(name(&keys, MES, 4).as_deref(), Some("alice"), "the earlier keys");
    }

    /// Whoever revokes the name in the file would leave its holder in under `api_key`.
    #[test]
    fn a_file_that_brings_the_key_of_the_settings_is_refused_and_keeps_the_earlier_keys_in_force() {
        let file = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(file.path(), format!("line-3 = \"{LINE}\"\n")).expect("written");
        let api_key = serde_json::from_value(MES.into()).expect("a key");
        let api_keys_file = Some(file.path().to_owned());
        let keys = Keys::open(&ServerOptions { api_key: Some(api_key), api_keys_file, ..ServerOptions::for_tests() });
        let names = |secs| [MES, LINE].map(|key| name(&keys, key, secs));
        assert_eq!(names(0), [Some("api_key".to_owned()), Some("line-3".to_owned())]);
        std::fs::write(file.path(), format!("mes = \"{MES}\"\n")).expect("written");
        assert_eq!(names(2), [Some("api_key".to_owned()), Some("line-3".to_owned())], "the earlier keys");
        std::fs::write(file.path(), "# none any more\n").expect("written");
        assert_eq!(names(4), [Some("api_key".to_owned()), None]);
    }

    #[test]
    fn the_log_is_told_of_wrong_keys_now_and_then() {
        let (keys, _file) = opened("# nobody yet\n");
        let began = Instant::now();
        let told = [0, 1, 9, 10, 11, 25].map(|secs| keys.count_wrong(began + Duration::from_secs(secs)));
        assert_eq!(told, [Some(1), None, None, Some(3), None, Some(2)]);
    }

    #[test]
    fn a_file_that_cannot_be_read_from_the_start_lets_nobody_in() {
        let options = ServerOptions { api_keys_file: Some("/nowhere/keys.toml".into()), ..ServerOptions::for_tests() };
        let keys = Keys::open(&options);
        assert!(keys.are_required());
        assert_eq!(name(&keys, MES, 0), None);
    }

    #[test]
    fn faults_are_told_without_the_key() {
        for (text, said) in [
            ("mes = 0123456789abcdef-mes", "name = \"key\""),
            ("mes = \"0123456\"", "16 to 256"),
            ("\"M E S\" = \"0123456789abcdef-mes\"", "not a name"),
            ("api_key = \"0123456789abcdef-mes\"", "not a name"),
            ("[mes]\nkey = \"0123456789abcdef-mes\"", "name = \"key\""),
        ] {
            let (_, file) = opened(text);
            let reason = check_keys_file(file.path(), None).expect_err("a fault");
            assert!(reason.contains(said) && !reason.contains("012345"), "{text}: {reason}");
        }
        let (keys, file) = opened("# nobody yet\n");
        assert_eq!((check_keys_file(file.path(), None), keys.are_required()), (Ok(()), true));
    }
}

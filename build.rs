//! Build script: tells the program which commit and which target it is built from, for `vantage --version` and `/version`, and
//! compresses the files of the dashboard, which the program embeds.
//!
//! The commit is `VANTAGE_COMMIT` of the environment, which Docker and CI set; else, in a release build, the one that is
//! checked out; else `unknown`, as from an archive without `.git`. A build for tests says `development` and reads nothing,
//! so that a commit does not make it new.

use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

use flate2::Compression;
use flate2::write::GzEncoder;

/// Digits of a commit that are shown.
const DIGITS: usize = 12;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=VANTAGE_COMMIT");
    let target = env::var("TARGET").unwrap_or_else(|_| "unknown".to_owned());
    println!("cargo::rustc-env=VANTAGE_TARGET={target}");
    println!("cargo::rustc-env=VANTAGE_COMMIT={}", commit());
    if has_packed_relocations(&target) {
        println!("cargo::rustc-link-arg-bins=-Wl,-z,pack-relative-relocs");
    }
    dashboard().expect("static/dist can be read, and OUT_DIR written");
}

/// Returns true if this machine's C library reads packed relocations, which take 1.3 MB less: glibc 2.36 and later. The program
/// then needs such a library too. Not where another linker is named, or another target.
fn has_packed_relocations(target: &str) -> bool {
    let is_native = env::var("HOST").is_ok_and(|host| host == target) && target == "x86_64-unknown-linux-gnu";
    let version = || {
        let told = Command::new("ldd").arg("--version").output().ok()?;
        let told = String::from_utf8(told.stdout).ok()?;
        let (major, minor) = told.lines().next()?.split_whitespace().last()?.split_once('.')?;
        Some((major.parse::<u32>().ok()?, minor.parse::<u32>().ok()?))
    };
    is_native && env::var_os("RUSTC_LINKER").is_none() && version().is_some_and(|version| version >= (2, 36))
}

/// Compresses every file of `static/dist` and writes `dashboard.rs`, the list of their names and compressed bytes.
fn dashboard() -> io::Result<()> {
    println!("cargo::rerun-if-changed=static/dist");
    let out = PathBuf::from(env::var("OUT_DIR").map_err(io::Error::other)?);
    let mut files = fs::read_dir("static/dist")?.map(|entry| entry.map(|entry| entry.path())).collect::<io::Result<Vec<_>>>()?;
    files.sort();
    let mut list = "&[\n".to_owned();
    for file in &files {
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
        encoder.write_all(&fs::read(file)?)?;
        let compressed = format!("{name}.gz");
        fs::write(out.join(&compressed), encoder.finish()?)?;
        let _ = writeln!(list, "    ({name:?}, include_bytes!({compressed:?})),");
    }
    fs::write(out.join("dashboard.rs"), list + "]\n")
}

fn commit() -> String {
    let given = env::var("VANTAGE_COMMIT").ok().as_deref().and_then(shortened);
    let is_release = env::var("PROFILE").is_ok_and(|profile| profile == "release");
    match given {
        Some(given) => given,
        None if !is_release => "development".to_owned(),
        None => checked_out(Path::new(".git")).as_deref().and_then(shortened).unwrap_or_else(|| "unknown".to_owned()),
    }
}

/// First digits of a commit; `None` for any other text.
fn shortened(text: &str) -> Option<String> {
    let text = text.trim();
    let is_commit = text.len() >= 7 && text.bytes().all(|byte| byte.is_ascii_hexdigit());
    is_commit.then(|| text.chars().take(DIGITS).collect())
}

/// Commit that is checked out: HEAD, or what the branch that it names points to.
fn checked_out(dot_git: &Path) -> Option<String> {
    let git = git_folder(dot_git)?;
    let head = read_and_watch(&git.join("HEAD"))?;
    let Some(branch) = head.strip_prefix("ref: ").map(str::trim) else { return Some(head) };
    // A worktree has a HEAD of its own; branches are in the folder that all share.
    let common = fs::read_to_string(git.join("commondir")).map_or_else(|_| git.clone(), |common| git.join(common.trim()));
    let loose = common.join(branch);
    // A packed branch gets a file of its own with the next commit.
    loose.parent().filter(|folder| folder.is_dir()).into_iter().for_each(watch);
    read_and_watch(&loose).or_else(|| packed(&read_and_watch(&common.join("packed-refs"))?, branch))
}

/// Folder of the repository; in a worktree `.git` is a file that names it.
fn git_folder(dot_git: &Path) -> Option<PathBuf> {
    if dot_git.is_dir() {
        return Some(dot_git.to_owned());
    }
    let text = fs::read_to_string(dot_git).ok()?;
    Some(PathBuf::from(text.strip_prefix("gitdir: ")?.trim()))
}

fn packed(refs: &str, branch: &str) -> Option<String> {
    let lines = refs.lines().filter_map(|line| line.split_once(' '));
    lines.filter(|(_, name)| *name == branch).map(|(commit, _)| commit.to_owned()).next()
}

/// Reads a file; the build is made anew once it changes.
fn read_and_watch(path: &Path) -> Option<String> {
    let text = fs::read_to_string(path).ok()?;
    watch(path);
    Some(text)
}

fn watch(path: &Path) {
    println!("cargo::rerun-if-changed={}", path.display());
}

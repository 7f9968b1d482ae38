//! `vantage.json`, schema `vantage.output/1`: what a command wrote to a folder. A file that it does not name, or that has other
//! bytes than it says, is the user's and is neither replaced nor removed.

use std::path::{Component, Path};

use serde::{Deserialize, Serialize};

use super::{json_file_bytes, parse};

/// Name of the file.
pub const RECORD_FILE: &str = "vantage.json";
/// Schema name in the document.
pub const RECORD_SCHEMA: &str = "vantage.output/1";

/// Record of the files that commands wrote to a folder.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct OutputRecord {
    /// Schema name, `vantage.output/1`.
    pub schema: String,
    /// Version of the program that wrote it.
    pub version: String,
    /// False while files are being replaced: the folder then holds only some of what the last command wrote.
    pub complete: bool,
    /// The files, in the order written.
    pub files: Vec<RecordedFile>,
}

/// A file that a command wrote.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordedFile {
    /// Name of the file in the folder.
    pub name: String,
    /// SHA-256 of its bytes, lower-case hexadecimal.
    pub sha256: String,
    /// Command that wrote it.
    pub written_by: String,
    /// SHA-256 of the bytes of `plan.json` of the plan that it belongs to, also where the file itself has no place for it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan_sha256: Option<String>,
    /// Folder or file that it was made from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub made_from: Option<String>,
}

impl OutputRecord {
    /// Record of these files.
    #[must_use]
    pub fn new(files: Vec<RecordedFile>, complete: bool) -> Self {
        Self { schema: RECORD_SCHEMA.to_owned(), version: env!("CARGO_PKG_VERSION").to_owned(), complete, files }
    }

    /// Bytes of the file.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        json_file_bytes(self)
    }

    /// Reads the bytes of a file; `None` if they are not a record, or if it names a file elsewhere than in its folder.
    #[must_use]
    pub fn parse(bytes: &[u8]) -> Option<Self> {
        let record = parse::<Self>(bytes).ok()?;
        let is_here = |file: &RecordedFile| matches!(Path::new(&file.name).components().collect::<Vec<_>>()[..], [Component::Normal(name)] if name == &*file.name);
        (record.schema == RECORD_SCHEMA && record.files.iter().all(is_here)).then_some(record)
    }
}

//! Errors in mesh files, with their position in the file.

use std::{fmt, io};

use crate::geometry::Interrupted;

/// A position in a file: a line of a text format (from 1) or a byte of a binary one (from 0).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Position {
    /// Line, counted from 1.
    Line(u64),
    /// Byte offset, counted from 0.
    Byte(u64),
}

impl fmt::Display for Position {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(line) => write!(f, "line {line}"),
            Self::Byte(byte) => write!(f, "byte {byte}"),
        }
    }
}

/// Reason for which a mesh file cannot be read. Every variant has a stable [`code`](Self::code).
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// The unit was not given; STL, OBJ and PLY files do not state theirs.
    #[error("the file does not state its unit of length; give one of mm, cm, m, inch")]
    UnitMissing,
    /// The file is empty.
    #[error("the file is empty (0 bytes)")]
    EmptyFile,
    /// The content matches none of the formats.
    #[error("the content is not a mesh in a supported format: STL, OBJ or PLY")]
    UnknownFormat,
    /// A known format that is not supported.
    #[error("this is {format}, which is not supported; {advice}")]
    FormatNotRead {
        /// Name of the format.
        format: &'static str,
        /// Advice on what to do instead.
        advice: &'static str,
    },
    /// Text that is not valid in the encoding that its byte order mark declares.
    #[error("{at}: the text is not valid {encoding}")]
    Encoding {
        /// Position of the invalid text.
        at: Position,
        /// The declared encoding.
        encoding: &'static str,
    },
    /// Content that the format does not allow at this position.
    #[error("{at}: expected {expected}, found {found}")]
    Syntax {
        /// Position of the content.
        at: Position,
        /// Description of what the format requires there.
        expected: &'static str,
        /// Excerpt of what is there.
        found: String,
    },
    /// The file ends too early.
    #[error("{at}: the file ends where {expected} should follow")]
    Truncated {
        /// The last position read.
        at: Position,
        /// Description of what is missing.
        expected: &'static str,
    },
    /// A declared number of records does not fit into the file.
    #[error("{at}: {declared} {what} are declared, which take at least {needed_bytes} bytes, but only {present_bytes} follow")]
    CountMismatch {
        /// Position of the declared number.
        at: Position,
        /// The declared number.
        declared: u64,
        /// Name of the records.
        what: String,
        /// Min bytes that so many records take.
        needed_bytes: u64,
        /// Bytes that follow.
        present_bytes: u64,
    },
    /// Data after the last declared record.
    #[error("{at}: {bytes} bytes follow after the last record that the header declares")]
    TrailingData {
        /// Position of the first surplus byte.
        at: Position,
        /// Number of surplus bytes.
        bytes: u64,
    },
    /// A coordinate that is not a finite number.
    #[error("{at}: the coordinate {found} is not a finite number")]
    NotFinite {
        /// Position of the coordinate.
        at: Position,
        /// Excerpt of what is there.
        found: String,
    },
    /// A coordinate larger than any part.
    #[error("{at}: the coordinate {value_mm:e} mm is beyond ±{limit_mm:e} mm; check the file and its unit")]
    OutOfRange {
        /// Position of the coordinate.
        at: Position,
        /// The coordinate.
        value_mm: f64,
        /// Largest absolute value allowed.
        limit_mm: f64,
    },
    /// A face refers to a vertex that does not exist.
    #[error("{at}: a face refers to vertex {index}, but the file has {vertices} vertices{hint}")]
    BadIndex {
        /// Position of the reference.
        at: Position,
        /// The index as written in the file.
        index: i64,
        /// Number of vertices that it could refer to.
        vertices: usize,
        /// Note on how the format counts vertices.
        hint: &'static str,
    },
    /// A valid file without a surface.
    #[error("the file has no surface to scan: {reason}")]
    NoTriangles {
        /// Description of what it has instead.
        reason: &'static str,
    },
    /// A limit is exceeded.
    #[error("{at}: more than {limit} {what}; simplify the mesh, or raise the limit")]
    TooLarge {
        /// Position at which the limit is exceeded.
        at: Position,
        /// Name of the limited items.
        what: &'static str,
        /// The limit.
        limit: usize,
    },
    /// The caller stopped the work.
    #[error("reading was stopped before its end")]
    Interrupted,
}

/// Reason for which a source of bytes gives no mesh.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The source failed.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// The bytes are not a usable mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

impl From<Interrupted> for MeshError {
    fn from(_: Interrupted) -> Self {
        Self::Interrupted
    }
}

impl MeshError {
    /// Stable code of the variant, for programs.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::UnitMissing => "unit_missing",
            Self::EmptyFile => "mesh_empty_file",
            Self::UnknownFormat => "mesh_format_unknown",
            Self::FormatNotRead { .. } => "mesh_format_not_read",
            Self::Encoding { .. } => "mesh_text_encoding",
            Self::Syntax { .. } => "mesh_syntax",
            Self::Truncated { .. } => "mesh_truncated",
            Self::CountMismatch { .. } => "mesh_count_mismatch",
            Self::TrailingData { .. } => "mesh_trailing_data",
            Self::NotFinite { .. } => "mesh_not_finite",
            Self::OutOfRange { .. } => "mesh_out_of_range",
            Self::BadIndex { .. } => "mesh_bad_index",
            Self::NoTriangles { .. } => "mesh_no_triangles",
            Self::TooLarge { .. } => "mesh_too_large",
            Self::Interrupted => "mesh_interrupted",
        }
    }

    /// Position in the file, for errors that have one.
    #[must_use]
    pub fn position(&self) -> Option<Position> {
        match self {
            Self::Encoding { at, .. }
            | Self::Syntax { at, .. }
            | Self::Truncated { at, .. }
            | Self::CountMismatch { at, .. }
            | Self::TrailingData { at, .. }
            | Self::NotFinite { at, .. }
            | Self::OutOfRange { at, .. }
            | Self::BadIndex { at, .. }
            | Self::TooLarge { at, .. } => Some(*at),
            Self::UnitMissing
            | Self::EmptyFile
            | Self::UnknownFormat
            | Self::FormatNotRead { .. }
            | Self::NoTriangles { .. }
            | Self::Interrupted => None,
        }
    }
}

//! Why a mesh file is refused, with the place in the file.

use std::{fmt, io};

use crate::geometry::Interrupted;

/// A place in a file: a line of a text format (from 1), a byte of a binary one (from 0).
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

/// A mesh file that cannot be read. Every variant has a stable [`code`](Self::code).
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// STL, OBJ and PLY do not say their unit, and none was given.
    #[error("the file does not say its unit of length; give one of mm, cm, m, inch")]
    UnitMissing,
    /// Zero bytes.
    #[error("the file is empty (0 bytes)")]
    EmptyFile,
    /// Not one of the formats, as far as its content tells.
    #[error("the content is not a mesh in a format that is read here: STL, OBJ or PLY")]
    UnknownFormat,
    /// A known format that is not read.
    #[error("this is {format}, which is not read; {advice}")]
    FormatNotRead {
        /// What it is.
        format: &'static str,
        /// What to do instead.
        advice: &'static str,
    },
    /// Text that is not what its byte order mark says.
    #[error("{at}: the text is not valid {encoding}")]
    Encoding {
        /// Where.
        at: Position,
        /// The encoding it claims.
        encoding: &'static str,
    },
    /// Something else than the format asks for.
    #[error("{at}: expected {expected}, found {found}")]
    Syntax {
        /// Where.
        at: Position,
        /// What the format asks for there.
        expected: &'static str,
        /// An excerpt of what is there.
        found: String,
    },
    /// The file ends too early.
    #[error("{at}: the file ends where {expected} should follow")]
    Truncated {
        /// The last place read.
        at: Position,
        /// What is missing.
        expected: &'static str,
    },
    /// A declared number of records does not fit into the file.
    #[error("{at}: {declared} {what} are declared, which take at least {needed_bytes} bytes, but {present_bytes} follow")]
    CountMismatch {
        /// Where the number stands.
        at: Position,
        /// The number.
        declared: u64,
        /// Of what.
        what: String,
        /// Bytes that so many records take at least.
        needed_bytes: u64,
        /// Bytes there are.
        present_bytes: u64,
    },
    /// The file goes on after the last declared record.
    #[error("{at}: the file goes on for {bytes} bytes after the last record that its header declares")]
    TrailingData {
        /// Where the surplus begins.
        at: Position,
        /// Its length.
        bytes: u64,
    },
    /// A coordinate that is not a finite number.
    #[error("{at}: the coordinate {found} is not a finite number")]
    NotFinite {
        /// Where.
        at: Position,
        /// What is there.
        found: String,
    },
    /// A coordinate beyond any part.
    #[error("{at}: the coordinate {value_mm:e} mm is beyond ±{limit_mm:e} mm; check the file and its unit")]
    OutOfRange {
        /// Where.
        at: Position,
        /// The coordinate.
        value_mm: f64,
        /// The largest allowed.
        limit_mm: f64,
    },
    /// A face refers to a vertex that does not exist.
    #[error("{at}: a face refers to vertex {index}, but the file has {vertices} vertices{hint}")]
    BadIndex {
        /// Where.
        at: Position,
        /// The reference as it stands in the file.
        index: i64,
        /// Vertices it could refer to.
        vertices: usize,
        /// How the format counts.
        hint: &'static str,
    },
    /// A legal file without a surface.
    #[error("the file holds no surface to scan: {why}")]
    NoTriangles {
        /// What it holds instead.
        why: &'static str,
    },
    /// More than the limits allow.
    #[error("{at}: more than {limit} {what}; simplify the mesh, or raise the limit")]
    TooLarge {
        /// Where the limit was passed.
        at: Position,
        /// Of what.
        what: &'static str,
        /// The limit.
        limit: usize,
    },
    /// The caller no longer wants it.
    #[error("reading was given up before its end")]
    Interrupted,
}

/// Why there is no mesh from a source of bytes.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The source failed.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// What came from it is not a mesh that can be used.
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

    /// Where in the file, for what has a place.
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

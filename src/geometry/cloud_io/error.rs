//! Errors in files of clouds.

use std::io;

use crate::geometry::Interrupted;
use crate::geometry::mesh_io::{MeshError, Position, ReadError};

/// Reason for which a file gives no cloud. Every variant has a stable [`code`](Self::code).
#[derive(Debug, thiserror::Error)]
pub enum CloudError {
    /// The source failed.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// The content matches none of the formats.
    #[error("the content is not a cloud in a supported format: PLY, PCD, E57, text in columns (XYZ, ASC, PTS, CSV), STL or OBJ")]
    UnknownFormat,
    /// Content that the format does not allow.
    #[error(transparent)]
    Content(#[from] MeshError),
    /// A valid file in which no record holds a point.
    #[error("the file has no point with finite coordinates")]
    NoPoints,
    /// More points than the limit.
    #[error("the file has more than {limit} points; export single shots, or raise the limit")]
    TooManyPoints {
        /// The limit.
        limit: usize,
    },
    /// The size of an organised cloud and the number of its points differ.
    #[error("{at}: a grid of {columns} × {rows} cells is declared, but {points} points")]
    GridMismatch {
        /// Position of the declared size.
        at: Position,
        /// Cells a row.
        columns: u64,
        /// Rows.
        rows: u64,
        /// Number of points declared or present.
        points: u64,
    },
    /// Compressed data that cannot be unpacked.
    #[error("{at}: the compressed data refer to bytes that are not there, or unpack to another length than declared")]
    Compression {
        /// Position of the instruction at fault.
        at: Position,
    },
    /// A fault in an E57 file.
    #[error("E57, {part}: {detail}")]
    E57 {
        /// Part of the file: header, or a scan with its number and name.
        part: String,
        /// Description of the fault: whether the file is cut off or damaged, and what to do.
        detail: String,
    },
}

impl From<Interrupted> for CloudError {
    fn from(interrupted: Interrupted) -> Self {
        Self::Content(interrupted.into())
    }
}

impl From<ReadError> for CloudError {
    fn from(error: ReadError) -> Self {
        match error {
            ReadError::Io(error) => Self::Io(error),
            ReadError::Mesh(error) => Self::Content(error),
        }
    }
}

impl CloudError {
    /// Stable code of the variant, for programs.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Io(_) => "cloud_not_readable",
            Self::UnknownFormat => "cloud_format_unknown",
            Self::Content(error) => code_of_content(error),
            Self::NoPoints => "cloud_no_points",
            Self::TooManyPoints { .. } => "cloud_too_large",
            Self::GridMismatch { .. } => "cloud_grid_mismatch",
            Self::Compression { .. } => "cloud_compression",
            Self::E57 { .. } => "cloud_e57",
        }
    }

    /// Position in the file, for errors that have one.
    #[must_use]
    pub fn position(&self) -> Option<Position> {
        match self {
            Self::Content(error) => error.position(),
            Self::GridMismatch { at, .. } | Self::Compression { at } => Some(*at),
            Self::Io(_) | Self::UnknownFormat | Self::NoPoints | Self::TooManyPoints { .. } | Self::E57 { .. } => None,
        }
    }
}

fn code_of_content(error: &MeshError) -> &'static str {
    match error {
        MeshError::UnitMissing => "unit_missing",
        MeshError::EmptyFile => "cloud_empty_file",
        MeshError::UnknownFormat | MeshError::FormatNotRead { .. } => "cloud_format_unknown",
        MeshError::Encoding { .. } => "cloud_text_encoding",
        MeshError::Syntax { .. } => "cloud_syntax",
        MeshError::Truncated { .. } => "cloud_truncated",
        MeshError::CountMismatch { .. } => "cloud_count_mismatch",
        MeshError::TrailingData { .. } => "cloud_trailing_data",
        MeshError::NotFinite { .. } => "cloud_not_finite",
        MeshError::OutOfRange { .. } => "cloud_out_of_range",
        MeshError::BadIndex { .. } => "cloud_bad_index",
        MeshError::NoTriangles { .. } => "cloud_no_points",
        MeshError::TooLarge { .. } => "cloud_too_large",
        MeshError::Interrupted => "cloud_interrupted",
    }
}

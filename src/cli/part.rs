//! `vantage part base|figurine`: writes a demo part as STL, in millimetres.

use std::path::PathBuf;

use super::ranges::whole;
use super::{CliError, files, output};
use crate::geometry::demo_parts::{DEFAULT_TRIANGLES, DemoPart};
use crate::geometry::mesh_io::write_stl;

/// Write a demo part as an STL file, in millimetres.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Example:
  vantage part base --triangles 50000 --out base.stl")]
pub struct PartArgs {
    /// Part to write: base (121 × 73 × 37 mm, a consumer product) or figurine (150 mm tall).
    pub part: DemoPart,
    /// Approximate number of triangles, 8000 to 2000000.
    #[arg(long, default_value_t = DEFAULT_TRIANGLES, value_parser = whole::<usize>(8000..=2_000_000))]
    pub triangles: usize,
    /// STL file to write.
    #[arg(long)]
    pub out: PathBuf,
}

/// Writes the part.
///
/// # Errors
/// [`CliError::BadInput`] if the number is out of range, [`CliError::Failed`] if the file cannot be written.
pub fn run(args: &PartArgs) -> Result<(), CliError> {
    let mesh = args.part.mesh(args.triangles).map_err(|error| CliError::BadInput(error.to_string()))?;
    files::write(&args.out, &write_stl(&mesh))?;
    let triangles = mesh.faces.len();
    let document = serde_json::json!({"file": args.out.display().to_string(), "part": args.part.as_str(), "triangles": triangles, "unit": "mm"});
    output::result(&document, format_args!("{}: {}, {triangles} triangles, millimetres\n", args.out.display(), args.part))
}

//! Writers: binary PLY, where an organised cloud says its size in the comments that range grids have, and binary PCD, whose header
//! has it. Cells without a point are NaN in both.

use std::io::{self, Write};

use crate::geometry::point_cloud::PointCloud;

/// Writes a cloud as binary little-endian PLY, in millimetres.
///
/// # Errors
/// Errors of writing to `out`.
pub fn write_ply(cloud: &PointCloud, out: &mut dyn Write) -> io::Result<()> {
    writeln!(out, "ply\nformat binary_little_endian 1.0\ncomment millimetres")?;
    if let Some(grid) = cloud.grid {
        writeln!(out, "obj_info num_cols {}\nobj_info num_rows {}", grid.columns, grid.rows)?;
    }
    let count = cloud.points_mm.len();
    writeln!(out, "element vertex {count}\nproperty float x\nproperty float y\nproperty float z\nend_header")?;
    write_points(cloud, out)
}

/// Writes a cloud as binary PCD 0.7, in millimetres.
///
/// # Errors
/// Errors of writing to `out`.
pub fn write_pcd(cloud: &PointCloud, out: &mut dyn Write) -> io::Result<()> {
    let (columns, rows) = cloud.grid.map_or((cloud.points_mm.len(), 1), |grid| (grid.columns, grid.rows));
    writeln!(out, "# .PCD v0.7, millimetres\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1")?;
    writeln!(out, "WIDTH {columns}\nHEIGHT {rows}\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {}\nDATA binary", columns * rows)?;
    write_points(cloud, out)
}

fn write_points(cloud: &PointCloud, out: &mut dyn Write) -> io::Result<()> {
    let mut bytes = Vec::with_capacity(12 * 4096);
    for points in cloud.points_mm.chunks(4096) {
        bytes.clear();
        bytes.extend(points.iter().flatten().flat_map(|value| value.to_le_bytes()));
        out.write_all(&bytes)?;
    }
    Ok(())
}

//! Just enough of binary glTF 2.0 for one model of the shared data: all triangles of all nodes, moved to where they are.

use nalgebra::{Isometry3, Matrix4, Point3, Quaternion, Translation3, UnitQuaternion};
use serde_json::Value;
use vantage::geometry::Mesh;

/// Reads a model without compression or sparse values.
pub(crate) fn read(bytes: &[u8]) -> Mesh {
    let length = u32::from_le_bytes(bytes[12..16].try_into().expect("four bytes")) as usize;
    let json: Value = serde_json::from_slice(&bytes[20..20 + length]).expect("the JSON chunk");
    let mut model = Model { json: &json, binary: &bytes[28 + length..], vertices_mm: Vec::new(), faces: Vec::new() };
    let scene = json["scene"].as_u64().unwrap_or(0) as usize;
    for node in json["scenes"][scene]["nodes"].as_array().expect("nodes") {
        model.add(node.as_u64().expect("a number") as usize, &Matrix4::identity());
    }
    let source_face = (0..model.faces.len() as u32).collect();
    Mesh { vertices_mm: model.vertices_mm, faces: model.faces, source_face, groups: Vec::new() }
}

struct Model<'a> {
    json: &'a Value,
    binary: &'a [u8],
    vertices_mm: Vec<Point3<f64>>,
    faces: Vec<[u32; 3]>,
}

impl Model<'_> {
    fn add(&mut self, node: usize, world_from_parent: &Matrix4<f64>) {
        let node = &self.json["nodes"][node];
        let world_from_node = world_from_parent * matrix(node);
        if let Some(mesh) = node["mesh"].as_u64() {
            for primitive in self.json["meshes"][mesh as usize]["primitives"].as_array().expect("primitives") {
                self.add_primitive(primitive, &world_from_node);
            }
        }
        for child in node["children"].as_array().into_iter().flatten() {
            self.add(child.as_u64().expect("a number") as usize, &world_from_node);
        }
    }

    fn add_primitive(&mut self, primitive: &Value, world_from_node: &Matrix4<f64>) {
        let first = self.vertices_mm.len() as u32;
        let positions = self.elements(&primitive["attributes"]["POSITION"], 12).map(|p| {
            let [x, y, z] = [0, 4, 8].map(|at| f64::from(f32::from_le_bytes(p[at..at + 4].try_into().expect("four bytes"))));
            world_from_node.transform_point(&Point3::new(x, y, z))
        });
        let positions: Vec<_> = positions.collect();
        let wide = self.json["accessors"][primitive["indices"].as_u64().expect("indices") as usize]["componentType"] == 5125;
        let indices = self.elements(&primitive["indices"], if wide { 4 } else { 2 });
        let index = |bytes: &[u8]| bytes.iter().rev().fold(0, |value, byte| value << 8 | u32::from(*byte));
        let indices: Vec<u32> = indices.map(|bytes| first + index(bytes)).collect();
        self.vertices_mm.extend(positions);
        self.faces.extend(indices.as_chunks::<3>().0);
    }

    /// The tightly packed elements of an accessor, `size` bytes each.
    fn elements(&self, accessor: &Value, size: usize) -> impl Iterator<Item = &[u8]> {
        let accessor = &self.json["accessors"][accessor.as_u64().expect("an accessor") as usize];
        let view = &self.json["bufferViews"][accessor["bufferView"].as_u64().expect("a view") as usize];
        let offset = |value: &Value| value["byteOffset"].as_u64().unwrap_or(0) as usize;
        let stride = view["byteStride"].as_u64().map_or(size, |stride| stride as usize);
        let start = offset(view) + offset(accessor);
        (0..accessor["count"].as_u64().expect("a count") as usize)
            .map(move |i| &self.binary[start + i * stride..start + i * stride + size])
    }
}

fn matrix(node: &Value) -> Matrix4<f64> {
    let numbers = |key: &str| -> Option<Vec<f64>> {
        node[key].as_array().map(|values| values.iter().map(|value| value.as_f64().expect("a number")).collect())
    };
    if let Some(columns) = numbers("matrix") {
        return Matrix4::from_column_slice(&columns);
    }
    let t = numbers("translation").map_or(Translation3::identity(), |t| Translation3::new(t[0], t[1], t[2]));
    let r = numbers("rotation")
        .map_or(UnitQuaternion::identity(), |r| UnitQuaternion::from_quaternion(Quaternion::new(r[3], r[0], r[1], r[2])));
    let s = numbers("scale").unwrap_or(vec![1.0; 3]);
    Isometry3::from_parts(t, r).to_homogeneous() * Matrix4::new_nonuniform_scaling(&nalgebra::Vector3::new(s[0], s[1], s[2]))
}

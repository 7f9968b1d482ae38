//! The part of the examples in the API document.

/// A tetrahedron of 60 mm as ASCII STL. Uploaded, it gets the id [`super::MeshId::EXAMPLE`].
pub const MESH: &str = "solid tetrahedron
facet normal 0 0 0
outer loop vertex 0 0 0 vertex 0 60 0 vertex 60 0 0 endloop endfacet
facet normal 0 0 0
outer loop vertex 0 0 0 vertex 60 0 0 vertex 0 0 60 endloop endfacet
facet normal 0 0 0
outer loop vertex 0 0 0 vertex 0 0 60 vertex 0 60 0 endloop endfacet
facet normal 0 0 0
outer loop vertex 60 0 0 vertex 0 60 0 vertex 0 0 60 endloop endfacet
endsolid tetrahedron
";

/// SHA-256 of [`MESH`], lower-case hexadecimal.
pub const MESH_SHA256: &str = "77c8fd8828dd0742aaab508caf70daf2fc895085886672ae66f428226f37124d";

/// SHA-256 of [`MESH`] as the value of a `Content-Digest` header (RFC 9530).
pub const MESH_DIGEST: &str = "sha-256=:d8j9iCjdB0Kqq1CMr3Da8vyJUIWIZnKuZvQoIm83Ek0=:";

//! Lists of faces, one for each of something: the faces around a vertex, the faces behind a preview face.

/// Lists of faces, kept one after the other.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FaceLists {
    /// Start of each list in `faces`, and at last the end of the last one.
    pub offsets: Vec<u32>,
    /// The lists, one after the other.
    pub faces: Vec<u32>,
}

impl FaceLists {
    /// List number `index`.
    #[must_use]
    pub fn of(&self, index: usize) -> &[u32] {
        &self.faces[self.offsets[index] as usize..self.offsets[index + 1] as usize]
    }

    /// Lists the faces at each of so many vertices, ascending. Cost: O(faces + vertices).
    #[must_use]
    pub fn around(faces: &[[u32; 3]], vertices: usize) -> Self {
        let offsets = running_sum(faces.iter().flatten(), vertices);
        let mut next = offsets.clone();
        let mut list = vec![0; faces.len() * 3];
        for (corners, face) in faces.iter().zip(0..) {
            for vertex in corners {
                let at = &mut next[*vertex as usize];
                list[*at as usize] = face;
                *at += 1;
            }
        }
        Self { offsets, faces: list }
    }

    /// Lists from pairs of list number and face, ascending.
    pub(super) fn group(pairs: &[(u32, u32)], lists: usize) -> Self {
        Self {
            offsets: running_sum(pairs.iter().map(|(list, _)| list), lists),
            faces: pairs.iter().map(|(_, face)| *face).collect(),
        }
    }
}

/// Sums, for each list, the entries of the lists before it.
fn running_sum<'a>(entries: impl Iterator<Item = &'a u32>, lists: usize) -> Vec<u32> {
    let mut offsets = vec![0; lists + 1];
    for list in entries {
        offsets[*list as usize + 1] += 1;
    }
    for list in 0..lists {
        offsets[list + 1] += offsets[list];
    }
    offsets
}

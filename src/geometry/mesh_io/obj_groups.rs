//! Named groups of an OBJ file: which are current, and which faces each has got.

use super::Limits;
use super::error::{MeshError, Position};
use super::text::Tokens;
use crate::geometry::FaceGroup;
use crate::geometry::id_table::IdTable;
use crate::geometry::poll::Poll;
use crate::geometry::sort::sort_by_key;

/// Most names that a file may give; each takes some hundred bytes.
const MAX_NAMES: usize = 1_000_000;
/// Longest name, in bytes.
const MAX_NAME_BYTES: usize = 1000;

/// See the module.
pub(super) struct Groups<'a> {
    limits: &'a Limits,
    poll: &'a Poll<'a>,
    numbers: IdTable,
    /// By number.
    found: Vec<Group>,
    object: Option<u32>,
    groups: Vec<u32>,
    /// How often the current groups have changed.
    changes: u64,
    memberships: usize,
}

struct Group {
    name: Box<[u8]>,
    source_faces: Vec<u32>,
    /// The change at which it was last named.
    named_at: u64,
}

impl<'a> Groups<'a> {
    pub(super) fn new(limits: &'a Limits, poll: &'a Poll<'a>) -> Self {
        let (numbers, found, groups) = (IdTable::new(), Vec::new(), Vec::new());
        Self { limits, poll, numbers, found, object: None, groups, changes: 0, memberships: 0 }
    }

    fn number(&mut self, name: &[u8], at: Position) -> Result<u32, MeshError> {
        if name.len() > MAX_NAME_BYTES {
            return Err(MeshError::TooLarge { at, what: "bytes of a group's name", limit: MAX_NAME_BYTES });
        }
        self.poll.spend(50 + name.len())?;
        let next = self.found.len() as u32;
        let known = |number: u32| self.found.get(number as usize).map_or(name, |group| &group.name);
        let number = self.numbers.id(&name, next, known, self.poll)?;
        if number == next {
            if self.found.len() >= MAX_NAMES {
                return Err(MeshError::TooLarge { at, what: "names of groups", limit: MAX_NAMES });
            }
            self.found.push(Group { name: name.into(), source_faces: Vec::new(), named_at: 0 });
        }
        Ok(number)
    }

    /// The object from here on; none without a name.
    pub(super) fn set_object(&mut self, name: &[u8], at: Position) -> Result<(), MeshError> {
        self.object = if name.is_empty() { None } else { Some(self.number(name, at)?) };
        Ok(())
    }

    /// The groups from here on.
    pub(super) fn set_groups(&mut self, names: Tokens<'_>, at: Position) -> Result<(), MeshError> {
        self.groups.clear();
        self.changes += 1;
        for name in names {
            let number = self.number(name, at)?;
            let named_at = &mut self.found[number as usize].named_at;
            if *named_at != self.changes {
                *named_at = self.changes;
                self.groups.push(number);
            }
        }
        Ok(sort_by_key(&mut self.groups, |number| u128::from(*number), self.poll)?)
    }

    /// Faces may be in many groups at once; the sum of all is limited, else a small file could ask for much memory.
    pub(super) fn add(&mut self, face: u32, at: Position) -> Result<(), MeshError> {
        let object = self.object.filter(|number| self.groups.binary_search(number).is_err());
        let more = self.groups.len() + usize::from(object.is_some());
        self.memberships += more;
        let limit = self.limits.max_triangles.saturating_mul(2);
        if self.memberships > limit {
            return Err(MeshError::TooLarge { at, what: "memberships of faces in groups", limit });
        }
        self.poll.spend(10 * more)?;
        for &number in self.groups.iter().chain(&object) {
            self.found[number as usize].source_faces.push(face);
        }
        Ok(())
    }

    /// Those that have faces.
    pub(super) fn into_face_groups(self) -> Result<Vec<FaceGroup>, MeshError> {
        let mut groups = Vec::new();
        for group in self.found.into_iter().filter(|group| !group.source_faces.is_empty()) {
            self.poll.spend(100)?;
            let name = String::from_utf8_lossy(&group.name).into_owned();
            groups.push(FaceGroup { name, source_faces: group.source_faces });
        }
        Ok(groups)
    }
}

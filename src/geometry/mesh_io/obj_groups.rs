//! Named groups of an OBJ file: the current ones, and the faces of each.

use super::Limits;
use super::error::{MeshError, Position};
use super::text::Tokens;
use crate::geometry::FaceGroup;
use crate::geometry::id_table::IdTable;
use crate::geometry::poll::Poll;
use crate::geometry::sort::sort_by_key;

/// Max names in a file; each takes some hundred bytes.
const MAX_NAMES: usize = 1_000_000;
/// Max length of a name.
const MAX_NAME_BYTES: usize = 1000;

/// Groups of the file, and the current ones among them.
pub(super) struct Groups<'a> {
    limits: &'a Limits,
    poll: &'a Poll<'a>,
    numbers: IdTable,
    /// Groups, indexed by their numbers.
    found: Vec<Group>,
    object: Option<u32>,
    groups: Vec<u32>,
    /// Number of changes of the current groups so far.
    changes: u64,
    memberships: usize,
}

struct Group {
    name: Box<[u8]>,
    source_faces: Vec<u32>,
    /// Number of the change at which it was last named.
    named_at: u64,
}

impl<'a> Groups<'a> {
    pub(super) fn new(limits: &'a Limits, poll: &'a Poll<'a>) -> Self {
        let (numbers, found, groups) = (IdTable::new(), Vec::new(), Vec::new());
        Self { limits, poll, numbers, found, object: None, groups, changes: 0, memberships: 0 }
    }

    fn number(&mut self, name: &[u8], at: Position) -> Result<u32, MeshError> {
        if name.len() > MAX_NAME_BYTES {
            return Err(MeshError::TooLarge { at, what: "bytes in a group name", limit: MAX_NAME_BYTES });
        }
        self.poll.spend(50 + name.len())?;
        let next = self.found.len() as u32;
        let known = |number: u32| self.found.get(number as usize).map_or(name, |group| &group.name);
        let number = self.numbers.id(&name, next, known, self.poll)?;
        if number == next {
            if self.found.len() >= MAX_NAMES {
                return Err(MeshError::TooLarge { at, what: "group names", limit: MAX_NAMES });
            }
            self.found.push(Group { name: name.into(), source_faces: Vec::new(), named_at: 0 });
        }
        Ok(number)
    }

    /// Sets the current object; an empty name means none.
    pub(super) fn set_object(&mut self, name: &[u8], at: Position) -> Result<(), MeshError> {
        self.object = if name.is_empty() { None } else { Some(self.number(name, at)?) };
        Ok(())
    }

    /// Sets the current groups.
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

    /// Adds a face to the current groups. The sum of all memberships is limited; a small file could demand much memory otherwise.
    pub(super) fn add(&mut self, face: u32, at: Position) -> Result<(), MeshError> {
        let object = self.object.filter(|number| self.groups.binary_search(number).is_err());
        let more = self.groups.len() + usize::from(object.is_some());
        self.memberships += more;
        let limit = self.limits.max_triangles.saturating_mul(2);
        if self.memberships > limit {
            return Err(MeshError::TooLarge { at, what: "group memberships of faces", limit });
        }
        self.poll.spend(10 * more)?;
        for &number in self.groups.iter().chain(&object) {
            self.found[number as usize].source_faces.push(face);
        }
        Ok(())
    }

    /// Groups that have faces.
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

//! The resident scene of a device as a value: named objects, one revision, pure edits.
//!
//! Invariants: identifiers are unique; each object keeps one slot below [`MAX_OBJECTS`] for
//! its life, because the loop keeps the object's contact state there; a slot is reused only
//! after its object is gone. The revision grows by one with every edit and begins at 1.
//! An edit that is refused leaves the scene untouched; whoever wants to save first edits a
//! clone and keeps it only when saving succeeded. No file and no lock here.

use std::collections::{BTreeMap, BTreeSet};
use std::num::NonZeroU64;

use super::scene_layout::write_scene;
use super::{Id, SceneObject};
use crate::environment::{MAX_OBJECTS, SceneItem};
use crate::units::FieldError;

/// The revision that an edit was made for; `None` edits whatever is there. A request's 0
/// becomes `None` by `NonZeroU64::new`.
pub type ExpectedRevision = Option<NonZeroU64>;

/// Why an edit was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SceneError {
    /// No object has this identifier.
    #[error("there is no object {name:?}")]
    NotFound {
        /// The identifier.
        name: String,
    },
    /// Another object has it.
    #[error("there is an object {name:?} already")]
    AlreadyExists {
        /// The identifier.
        name: String,
    },
    /// No slot is left.
    #[error("the scene is full: at most {max} objects")]
    Full {
        /// Most objects of a scene.
        max: usize,
    },
    /// Somebody else edited the scene in between.
    #[error("scene_revision = {expected}: the scene is at revision {actual}; read it again")]
    StaleRevision {
        /// What the edit was made for.
        expected: u64,
        /// What the scene has.
        actual: u64,
    },
    /// A field of the object or of the scene is not allowed.
    #[error(transparent)]
    Invalid(#[from] FieldError),
}

/// A resident scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    revision: u64,
    objects: BTreeMap<Id, Placed>,
}

/// An object and where the loop keeps its state.
#[derive(Clone, Debug, PartialEq)]
struct Placed {
    slot: u16,
    object: SceneObject,
}

impl Default for Scene {
    fn default() -> Self {
        Self { revision: 1, objects: BTreeMap::new() }
    }
}

impl Scene {
    /// A scene as it was saved; `objects` with their slots and revisions.
    pub(super) fn restore(
        revision: u64,
        objects: impl IntoIterator<Item = (u16, SceneObject)>,
    ) -> Result<Self, FieldError> {
        if revision == 0 {
            return Err(FieldError::new("revision", revision, "must be at least 1"));
        }
        let mut scene = Self { revision, objects: BTreeMap::new() };
        for (i, (slot, object)) in objects.into_iter().enumerate() {
            let field = |name: &str| format!("object[{i}].{name}");
            let refuse =
                |name, value: String, allowed| Err(FieldError::new(field(name), value, allowed));
            if usize::from(slot) >= MAX_OBJECTS || scene.slots().any(|used| used == slot) {
                return refuse("slot", slot.to_string(), "must be 0 to 255, each once");
            }
            let changed = object.revision();
            if changed == 0 || changed > revision {
                return refuse(
                    "revision",
                    changed.to_string(),
                    "must be 1 to the scene's revision",
                );
            }
            let id = object.id().clone();
            if scene.objects.contains_key(&id) {
                return refuse("id", id.to_string(), "must be unique");
            }
            scene.objects.insert(id, Placed { slot, object });
        }
        Ok(scene)
    }

    /// The text of its file; `None` for a revision beyond what a file can hold.
    pub fn to_toml(&self) -> Option<String> {
        write_scene(self).ok()
    }

    /// Grows by one with every edit.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// The object of this name.
    pub fn get(&self, name: &str) -> Result<&SceneObject, SceneError> {
        let placed = self.objects.values().find(|placed| placed.object.id().as_str() == name);
        placed.map(|placed| &placed.object).ok_or_else(|| not_found(name))
    }

    /// All objects, by identifier.
    pub fn list(&self) -> impl Iterator<Item = &SceneObject> {
        self.objects.values().map(|placed| &placed.object)
    }

    /// All objects with their slots, by slot.
    pub fn placed(&self) -> Vec<(u16, &SceneObject)> {
        let mut all: Vec<_> =
            self.objects.values().map(|placed| (placed.slot, &placed.object)).collect();
        all.sort_by_key(|(slot, _)| *slot);
        all
    }

    /// Adds an object; the scene's new revision.
    pub fn create(
        &mut self,
        object: SceneObject,
        expected: ExpectedRevision,
    ) -> Result<u64, SceneError> {
        self.check_revision(expected)?;
        if self.objects.contains_key(object.id()) {
            return Err(SceneError::AlreadyExists { name: object.id().to_string() });
        }
        let slot = self.free_slot().ok_or(SceneError::Full { max: MAX_OBJECTS })?;
        self.revision += 1;
        let id = object.id().clone();
        let object = object.at_revision(self.revision);
        self.objects.insert(id, Placed { slot, object });
        Ok(self.revision)
    }

    /// Replaces the object of the same identifier, in its slot; the scene's new revision.
    pub fn update(
        &mut self,
        object: SceneObject,
        expected: ExpectedRevision,
    ) -> Result<u64, SceneError> {
        self.check_revision(expected)?;
        let Some(placed) = self.objects.get_mut(object.id()) else {
            return Err(not_found(object.id().as_str()));
        };
        self.revision += 1;
        placed.object = object.at_revision(self.revision);
        Ok(self.revision)
    }

    /// Replaces all objects at once; the scene's new revision. One that is equal to the
    /// object of its identifier stays as it is; one that is not keeps its slot. The slots of
    /// those that go are taken only when no other is left: their state is not for newcomers.
    pub fn replace(
        &mut self,
        objects: Vec<SceneObject>,
        expected: ExpectedRevision,
    ) -> Result<u64, SceneError> {
        self.check_revision(expected)?;
        if objects.len() > MAX_OBJECTS {
            return Err(SceneError::Full { max: MAX_OBJECTS });
        }
        let mut next = Self { revision: self.revision + 1, objects: BTreeMap::new() };
        let mut new = Vec::new();
        let mut ids = BTreeSet::new();
        for (i, object) in objects.into_iter().enumerate() {
            if !ids.insert(object.id().clone()) {
                let field = format!("objects[{i}].name");
                return Err(FieldError::new(field, object.id(), "must be unique").into());
            }
            match self.objects.get(object.id()) {
                Some(kept) => next.keep(kept, object),
                None => new.push(object),
            }
        }
        let last = self.used();
        for object in new {
            let used = next.used();
            let untouched = std::array::from_fn(|slot| used[slot] || last[slot]);
            let slot = first_free(&untouched).or_else(|| first_free(&used));
            let slot = slot.ok_or(SceneError::Full { max: MAX_OBJECTS })?;
            let object = object.at_revision(next.revision);
            next.objects.insert(object.id().clone(), Placed { slot, object });
        }
        *self = next;
        Ok(self.revision)
    }

    /// Takes over an object, or another one of its identifier, into the same slot.
    fn keep(&mut self, kept: &Placed, object: SceneObject) {
        let Placed { slot, object: last } = kept;
        let same = last.is_same(&object);
        let object = object.at_revision(if same { last.revision() } else { self.revision });
        self.objects.insert(object.id().clone(), Placed { slot: *slot, object });
    }

    /// Removes an object; the scene's new revision.
    pub fn delete(&mut self, name: &str, expected: ExpectedRevision) -> Result<u64, SceneError> {
        self.check_revision(expected)?;
        let id = self.get(name)?.id().clone();
        self.objects.remove(&id);
        self.revision += 1;
        Ok(self.revision)
    }

    /// The scene as the loop takes it, by slot.
    pub fn items(&self) -> Box<[SceneItem]> {
        let item = |(slot, object): (u16, &SceneObject)| SceneItem {
            slot,
            revision: object.revision(),
            element: object.element(),
        };
        self.placed().into_iter().map(item).collect()
    }

    fn check_revision(&self, expected: ExpectedRevision) -> Result<(), SceneError> {
        match expected.map(NonZeroU64::get) {
            Some(expected) if expected != self.revision => {
                Err(SceneError::StaleRevision { expected, actual: self.revision })
            }
            _ => Ok(()),
        }
    }

    fn slots(&self) -> impl Iterator<Item = u16> {
        self.objects.values().map(|placed| placed.slot)
    }

    fn free_slot(&self) -> Option<u16> {
        first_free(&self.used())
    }

    fn used(&self) -> [bool; MAX_OBJECTS] {
        let mut used = [false; MAX_OBJECTS];
        for slot in self.slots() {
            used[usize::from(slot)] = true;
        }
        used
    }
}

fn first_free(used: &[bool; MAX_OBJECTS]) -> Option<u16> {
    let free = used.iter().position(|used| !used)?;
    u16::try_from(free).ok()
}

fn not_found(name: &str) -> SceneError {
    SceneError::NotFound { name: name.to_owned() }
}

#[cfg(test)]
pub(super) mod tests {
    use nalgebra::Vector3;
    use proptest::prelude::*;

    use super::*;
    use crate::config::ObjectKind;
    use crate::environment::Material;

    /// A wall at `x_m`.
    pub(crate) fn wall(id: &str, x_m: f64) -> SceneObject {
        let point_m = Vector3::new(x_m, 0.0, 0.0);
        let kind = ObjectKind::HalfSpace { point_m, normal: -Vector3::x() };
        let material = Material { stiffness_N_per_m: 1e7, ..Material::default() };
        SceneObject::new(Id::parse("id", id).unwrap(), kind, Some(material), false).unwrap()
    }

    fn revision(number: u64) -> ExpectedRevision {
        NonZeroU64::new(number)
    }

    #[test]
    fn edits_bump_the_revision_and_the_object_remembers_it() {
        let mut scene = Scene::default();
        assert_eq!(scene.revision(), 1);
        assert_eq!(scene.create(wall("a", 0.3), revision(1)), Ok(2));
        assert_eq!(scene.create(wall("b", 0.4), None), Ok(3));
        assert_eq!(scene.update(wall("a", 0.2), revision(3)), Ok(4));
        assert_eq!(scene.get("a").unwrap().revision(), 4);
        assert_eq!(scene.get("b").unwrap().revision(), 3);
        assert_eq!(scene.delete("b", revision(0)), Ok(5));
        assert_eq!(scene.list().count(), 1);
    }

    #[test]
    fn a_refused_edit_changes_nothing_and_says_why() {
        let mut scene = Scene::default();
        scene.create(wall("a", 0.3), None).unwrap();
        let before = scene.clone();
        let stale = SceneError::StaleRevision { expected: 1, actual: 2 };
        let missing = SceneError::NotFound { name: "b".into() };
        let exists = SceneError::AlreadyExists { name: "a".into() };
        assert_eq!(scene.create(wall("b", 0.1), revision(1)), Err(stale.clone()));
        assert_eq!(scene.update(wall("a", 0.1), revision(1)), Err(stale.clone()));
        assert_eq!(scene.delete("a", revision(1)), Err(stale));
        assert_eq!(scene.create(wall("a", 0.1), None), Err(exists));
        assert_eq!(scene.update(wall("b", 0.1), None), Err(missing.clone()));
        assert_eq!(scene.delete("b", None), Err(missing.clone()));
        assert_eq!(scene.get("b"), Err(missing));
        assert_eq!(scene, before);
    }

    #[test]
    fn one_object_too_many_is_refused() {
        let mut scene = Scene::default();
        for i in 0..MAX_OBJECTS {
            scene.create(wall(&format!("w{i}"), 0.3), None).unwrap();
        }
        let before = scene.clone();
        let full = Err(SceneError::Full { max: MAX_OBJECTS });
        assert_eq!(scene.create(wall("more", 0.3), None), full);
        assert_eq!(scene, before);
        scene.delete("w7", None).unwrap();
        scene.create(wall("more", 0.3), None).unwrap();
        assert_eq!(scene.placed()[7].1.id().as_str(), "more");
    }

    #[test]
    fn what_is_equal_in_a_new_scene_stays_as_it_was() {
        let mut scene = Scene::default();
        for id in ["a", "b", "c"] {
            scene.create(wall(id, 0.3), None).unwrap();
        }
        // Written in another order: b is the same, c is another, a goes, d comes.
        let next = vec![wall("d", 0.1), wall("c", 0.4), wall("b", 0.3)];
        assert_eq!(scene.replace(next, revision(4)), Ok(5));
        let placed = scene.placed();
        let found: Vec<_> = placed
            .iter()
            .map(|(slot, object)| (*slot, object.id().as_str(), object.revision()))
            .collect();
        assert_eq!(found, [(1, "b", 3), (2, "c", 5), (3, "d", 5)], "nobody takes the slot of a");
        assert_eq!(scene.replace(vec![], None), Ok(6));
        assert_eq!(scene.list().count(), 0);
    }

    #[test]
    fn a_new_scene_that_cannot_be_changes_nothing() {
        let mut scene = Scene::default();
        scene.create(wall("a", 0.3), None).unwrap();
        let before = scene.clone();
        let stale = SceneError::StaleRevision { expected: 1, actual: 2 };
        assert_eq!(scene.replace(vec![], revision(1)), Err(stale));
        let twins = vec![wall("a", 0.1), wall("b", 0.1), wall("a", 0.2)];
        let refused = scene.replace(twins, None).unwrap_err().to_string();
        assert_eq!(refused, "objects[2].name = a: must be unique");
        let many = |from: usize, count: usize| -> Vec<_> {
            (from..from + count).map(|i| wall(&format!("w{i}"), 0.3)).collect()
        };
        let full = Err(SceneError::Full { max: MAX_OBJECTS });
        assert_eq!(scene.replace(many(0, MAX_OBJECTS + 1), None), full);
        assert_eq!(scene, before);
        // A full scene gives way to another full one.
        scene.replace(many(0, MAX_OBJECTS), None).unwrap();
        scene.replace(many(100, MAX_OBJECTS), None).unwrap();
        assert_eq!(scene.placed().len(), MAX_OBJECTS);
        assert_eq!(scene.get("w255").unwrap().revision(), 3, "it was there before");
    }

    #[test]
    fn items_are_what_the_objects_say() {
        let mut scene = Scene::default();
        scene.create(wall("b", 0.3), None).unwrap();
        scene.create(wall("a", 0.4), None).unwrap();
        let items = scene.items();
        assert_eq!(
            items.iter().map(|item| (item.slot, item.revision)).collect::<Vec<_>>(),
            [(0, 2), (1, 3)]
        );
        assert_eq!(items[1].element, wall("a", 0.4).element());
    }

    proptest! {
        #[test]
        fn an_object_keeps_its_slot_for_life(edits in prop::collection::vec((0..3_u8, 0..12_usize), 1..200)) {
            let mut scene = Scene::default();
            let mut slots = BTreeMap::new();
            for (edit, which) in edits {
                let name = format!("w{which}");
                let lowest = (0..).find(|slot| !slots.values().any(|used| used == slot)).unwrap();
                let before = scene.revision();
                let (done, allowed) = match edit {
                    0 => (scene.create(wall(&name, 0.3), None), !slots.contains_key(&name)),
                    1 => (scene.update(wall(&name, 0.1), None), slots.contains_key(&name)),
                    _ => (scene.delete(&name, None), slots.contains_key(&name)),
                };
                prop_assert_eq!(done.is_ok(), allowed);
                prop_assert_eq!(scene.revision(), before + u64::from(allowed));
                match edit {
                    0 if allowed => drop(slots.insert(name, lowest)),
                    2 => drop(slots.remove(&name)),
                    _ => {}
                }
                let found: BTreeMap<_, _> =
                    scene.placed().iter().map(|(slot, object)| (object.id().to_string(), *slot)).collect();
                prop_assert_eq!(&found, &slots);
            }
        }
    }
}

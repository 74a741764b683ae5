//! The TOML of scenes: the server's own file, and the file that people write for `ctl`.
//!
//! Both are rows of [`ObjectLayout`]. The server's has revisions and slots as well, and its
//! last line says that the text is whole; without it [`SceneTextError::CutShort`]. In a file
//! of people's own there is neither; where they give a copy of the server's, its revisions and
//! slots are passed over. An empty one is a mistake: no objects is `object = []`. Numbers are written so that they read back bit by bit.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use super::error::{self, ConfigError};
use super::{ObjectLayout, Scene, SceneObject};
use crate::units::{self, FieldError};

const FIRST_LINE: &str = "# A scene of hapticd. Edit it only while the server is stopped.\n";

/// Closes every whole file of the server's own.
pub(super) const LAST_LINE: &str = "# end of scene";

/// Why a text is no scene.
#[derive(Debug)]
pub(super) enum SceneTextError {
    /// The last line is missing.
    CutShort,
    /// The layout or a value is wrong.
    Malformed(ConfigError),
}

/// The layout of the file.
#[derive(Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct Layout {
    #[serde(skip_serializing_if = "Option::is_none")]
    revision: Option<i64>,
    #[serde(rename = "object", skip_serializing_if = "Option::is_none")]
    objects: Option<Vec<ObjectLayout>>,
}

/// Revisions that survive both TOML's integers and a range's floating-point ends.
const REVISION: units::Range = units::Range::new(1.0, 9_007_199_254_740_991.0, "(revision)");
const SLOT: units::Range = units::Range::new(0.0, 255.0, "(slot)");

/// The scene in the text of the server's file; `file` is for messages only.
pub(super) fn read_scene(text: &str, file: &str) -> Result<Scene, SceneTextError> {
    if text.lines().next_back().map(str::trim_end) != Some(LAST_LINE) {
        return Err(SceneTextError::CutShort);
    }
    let layout: Layout = error::parse(text, file).map_err(SceneTextError::Malformed)?;
    let scene = read_objects(layout.objects.unwrap_or_default(), read_placed).and_then(|objects| {
        let revision = kept(&REVISION, "revision", layout.revision)?;
        Scene::restore(revision, objects)
    });
    scene.map_err(ConfigError::field(file)).map_err(SceneTextError::Malformed)
}

/// The objects in the text of somebody's own file, in their order and each with a name of its
/// own; `file` is for messages only.
pub fn read_scene_objects(text: &str, file: &str) -> Result<Vec<SceneObject>, ConfigError> {
    let layout: Layout = error::parse(text, file)?;
    let missing = || FieldError::new("object", "(none)", "an empty scene says `object = []`");
    let objects = layout.objects.ok_or_else(missing);
    let objects = objects.and_then(|objects| read_objects(objects, ObjectLayout::check));
    let distinct = objects.and_then(|objects| {
        let mut ids = BTreeSet::new();
        match objects.iter().enumerate().find(|(_, object)| !ids.insert(object.id())) {
            Some((i, twin)) => {
                Err(FieldError::new(format!("object[{i}].id"), twin.id(), "must be unique"))
            }
            None => Ok(objects),
        }
    });
    distinct.map_err(ConfigError::field(file))
}

fn read_objects<T>(
    layouts: Vec<ObjectLayout>,
    read: impl Fn(ObjectLayout) -> Result<T, FieldError>,
) -> Result<Vec<T>, FieldError> {
    let read = |(i, layout)| {
        let outer = format!("object[{i}]");
        read(layout).map_err(|refusal| refusal.within(&outer))
    };
    layouts.into_iter().enumerate().map(read).collect()
}

fn read_placed(layout: ObjectLayout) -> Result<(u16, SceneObject), FieldError> {
    let slot = kept(&SLOT, "slot", layout.slot)? as u16;
    let revision = kept(&REVISION, "revision", layout.revision)?;
    Ok((slot, layout.check()?.at_revision(revision)))
}

fn kept(range: &units::Range, field: &str, value: Option<i64>) -> Result<u64, FieldError> {
    let missing = || FieldError::new(field, "(missing)", "the server's own file has it");
    range.check_whole(field, value.ok_or_else(missing)?)
}

/// The text of the server's file. Only a revision beyond TOML's integers has none.
pub(super) fn write_scene(
    scene: &Scene,
) -> Result<String, Box<dyn std::error::Error + Send + Sync>> {
    let objects = scene.placed().into_iter().map(|(slot, object)| {
        let mut layout = ObjectLayout::from(object);
        (layout.slot, layout.revision) = (Some(slot.into()), Some(object.revision().try_into()?));
        Ok(layout)
    });
    let objects = objects.collect::<Result<Vec<_>, std::num::TryFromIntError>>()?;
    let objects = Some(objects).filter(|objects| !objects.is_empty());
    let layout = Layout { revision: Some(scene.revision().try_into()?), objects };
    Ok(format!("{FIRST_LINE}{}{LAST_LINE}\n", toml::to_string(&layout)?))
}

/// The text that [`read_scene_objects`] reads.
pub fn write_scene_objects<'a>(
    objects: impl IntoIterator<Item = &'a SceneObject>,
) -> Result<String, toml::ser::Error> {
    let objects = objects.into_iter().map(ObjectLayout::from).collect();
    toml::to_string(&Layout { revision: None, objects: Some(objects) })
}

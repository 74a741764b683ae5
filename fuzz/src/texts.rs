//! What people write as TOML: device files, the server's file, scenes.
//!
//! Nothing panics, and every refusal names a key, a line or the file as a whole. What is taken
//! is good for what it is for: a device ticks, a scene reads back bit by bit.

use hapticd::config::{
    ConfigError, DeviceDefinition, Scene, SceneFile, ServerConfig, build_plan, read_scene_objects,
    write_scene_objects,
};
use hapticd::control::{ControlState, Mode, Sample, TickInput, tick};

use crate::ticks;

const FILE: &str = "fuzz.toml";

fn check_refusal(error: &ConfigError) {
    let said = error.to_string();
    assert!(said.starts_with(FILE), "{said}");
    match error {
        ConfigError::Layout { line, key, message, .. } => {
            assert!(*line >= 1 && !key.is_empty() && !message.is_empty(), "{said}");
        }
        ConfigError::Field { source, .. } => {
            assert!(!source.field.is_empty() && !source.allowed.is_empty(), "{said}");
        }
        ConfigError::Read { .. } | ConfigError::UnknownDevice { .. } => panic!("{said}"),
    }
}

/// A device file: what is taken can be ticked.
pub fn check_device_file(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let device = match DeviceDefinition::from_toml("fuzzed", text, FILE) {
        Ok(device) => device,
        Err(error) => return check_refusal(&error),
    };
    let plan = build_plan(&device, &Scene::default());
    let mut state = ControlState::new(Mode::Enabled);
    let start = ticks::sample_at(&plan, device.start_m[0], device.start_m[1]);
    let start = start.expect("the start was checked");
    for (number, sample) in [Ok(start), Ok(start), Ok(Sample::default())].into_iter().enumerate() {
        let now_ns = (number as u64 + 1) * plan.tick_ns;
        let decision = tick(&mut state, &TickInput::uncommanded(sample, &plan, now_ns));
        ticks::check_commands(&plan, &decision);
    }
}

/// The server's file.
pub fn check_server_file(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    if let Err(error) = ServerConfig::from_toml(text, FILE) {
        check_refusal(&error);
    }
}

/// A scene file as `ctl scene load` reads it: what is taken is written and read as it was, and
/// becomes a scene. One that ends as the server's own is read as that too.
pub fn check_scene_file(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    if text.contains("# end of scene") {
        check_state_file(text);
    }
    let objects = match read_scene_objects(text, FILE) {
        Ok(objects) => objects,
        Err(error) => return check_refusal(&error),
    };
    let written = write_scene_objects(&objects).expect("every object can be written");
    let again = read_scene_objects(&written, FILE).expect("what was written can be read");
    assert_eq!(again, objects, "bit by bit");
    let mut scene = Scene::default();
    for object in &objects {
        if scene.create(object.clone(), None).is_err() {
            assert!(scene.list().count() >= 256, "names differ, so only room can be short");
        }
    }
    check_state_file(&scene.to_toml().expect("its revision is small"));
}

/// The server's own file, on disk: refused and left as it is, or a scene that is saved as it was.
fn check_state_file(text: &str) {
    let directory = tempfile::tempdir().expect("a directory for temporary files");
    let path = directory.path().join("scene.toml");
    std::fs::write(&path, text).expect("there is room");
    match SceneFile::open(directory.path()) {
        Ok((mut file, scene)) => {
            file.save(&scene).expect("what was read can be written");
            let (_, again) = SceneFile::open(directory.path()).expect("and read");
            assert_eq!(again, scene, "bit by bit");
        }
        Err(refusal) => {
            assert!(refusal.to_string().contains("scene.toml"), "{refusal}");
            assert_eq!(std::fs::read_to_string(&path).expect("it is there"), text, "left as it is");
        }
    }
}

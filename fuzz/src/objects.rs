//! Objects of the resident scene: what is taken comes out as it went in, and can be touched.

use hapticd::config::{
    GuidePath, Id, ObjectKind, Scene, SceneObject as Checked, build_plan, object_from_proto,
    object_to_proto, read_scene_objects, write_scene_objects,
};
use hapticd::control::{ControlState, Mode, TickInput, tick};
use hapticd::environment::Material;
use hapticd::proto::SceneObject;
use nalgebra::{Quaternion, Vector3};
use prost::Message;

use crate::ticks;

/// The message as bytes.
pub fn check(data: &[u8]) {
    let Ok(message) = SceneObject::decode(data) else { return };
    let id = Id::parse("id", "fuzzed").expect("an identifier");
    let object = match object_from_proto(id.clone(), &message) {
        Ok(object) => object,
        Err(refusal) => {
            assert!(!refusal.field.is_empty() && !refusal.allowed.is_empty(), "{refusal}");
            return;
        }
    };
    let shown = object_to_proto(&object, String::new());
    let again = object_from_proto(id, &shown).expect("what is shown can be taken");
    assert_eq!(again.kind(), object.kind(), "contract and back");
    assert_eq!(again.material(), object.material());
    assert_eq!(object_to_proto(&again, String::new()).encode_to_vec(), {
        let unrevised = SceneObject { revision: again.revision(), ..shown };
        unrevised.encode_to_vec()
    });
    let text = write_scene_objects([&object]).expect("every object can be written");
    let of_text = read_scene_objects(&text, "fuzz.toml").expect("what was written can be read");
    assert_eq!((of_text[0].kind(), of_text[0].material()), (object.kind(), object.material()));

    let mut scene = Scene::default();
    scene.create(object, None).expect("it is the first");
    let plan = build_plan(&ticks::devices()[0].0, &scene);
    let mut state = ControlState::new(Mode::Enabled);
    for step in 0..4_u32 {
        let x_m = 0.2 + 0.02 * f64::from(step);
        let sample = ticks::sample_at(&plan, x_m, 0.01).expect("inside");
        let now_ns = u64::from(step + 1) * plan.tick_ns;
        let decision = tick(&mut state, &TickInput::uncommanded(Ok(sample), &plan, now_ns));
        ticks::check_commands(&plan, &decision);
        ticks::check_report(&decision.report);
    }
}

/// One of each kind, for seeds.
pub fn examples() -> Vec<(String, SceneObject)> {
    let v = |x, y, z| Vector3::new(x, y, z);
    let kinds = [
        (
            "half-space",
            ObjectKind::HalfSpace { point_m: v(0.25, 0.0, 0.0), normal: v(-1.0, 0.0, 0.0) },
        ),
        ("sphere", ObjectKind::Sphere { centre_m: v(0.25, 0.05, 0.0), radius_m: 0.04 }),
        (
            "box",
            ObjectKind::Box {
                centre_m: v(0.25, 0.0, 0.0),
                half_extents_m: v(0.02, 0.03, 0.04),
                orientation: Quaternion::new(0.8, 0.0, 0.0, 0.6),
            },
        ),
        (
            "capsule",
            ObjectKind::Capsule { ends_m: [v(0.2, 0.0, 0.0), v(0.3, 0.1, 0.0)], radius_m: 0.02 },
        ),
        (
            "corridor",
            ObjectKind::Corridor {
                points_m: [v(0.2, 0.0, 0.0), v(0.25, 0.02, 0.0), v(0.3, 0.0, 0.0)].into(),
                radius_m: 0.01,
            },
        ),
        (
            "guide",
            ObjectKind::Guide {
                path: GuidePath::Line { point_m: v(0.2, 0.0, 0.0), direction: v(1.0, 1.0, 0.0) },
                radius_m: 0.0,
            },
        ),
        ("constant", ObjectKind::Constant { force_N: v(0.0, -5.0, 0.0) }),
        ("viscous", ObjectKind::Viscous { damping_Ns_per_m: 20.0 }),
    ];
    let material =
        Material { stiffness_N_per_m: 1e4, damping_Ns_per_m: 5.0, ..Material::default() };
    let example = |(name, kind): (&str, ObjectKind)| {
        let id = Id::parse("id", name).expect("an identifier");
        let has_surface = !matches!(name, "constant" | "viscous");
        let material = has_surface.then_some(material.with_friction(0.4));
        let object = Checked::new(id, kind, material, false).expect("a good object");
        (name.to_owned(), object_to_proto(&object, String::new()))
    };
    kinds.into_iter().map(example).collect()
}

/// Scene files with all of them: as people write one, and as the server does.
pub fn example_files() -> [Vec<u8>; 2] {
    let objects: Vec<_> = examples()
        .iter()
        .map(|(name, message)| {
            let id = Id::parse("id", name).expect("an identifier");
            object_from_proto(id, message).expect("a good object")
        })
        .collect();
    let mut scene = Scene::default();
    for object in &objects {
        scene.create(object.clone(), None).expect("there is room");
    }
    let by_people = write_scene_objects(&objects).expect("every object can be written");
    [by_people, scene.to_toml().expect("its revision is small")].map(String::into_bytes)
}

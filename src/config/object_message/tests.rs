//! Objects through every door and back, and a thin plate from the contract to the tick.

use proptest::prelude::*;

use super::*;
use crate::config::{DeviceDefinition, Scene, build_plan, read_scene_objects, write_scene_objects};
use crate::control::{ControlState, Mode, Sample, Setpoint, TickInput, tick};
use crate::notation::PlaneVector;

fn anywhere() -> impl Strategy<Value = proto::Vector3> {
    prop::array::uniform3(-100.0..100.0).prop_map(|[x, y, z]| proto::Vector3 { x, y, z })
}

fn direction() -> impl Strategy<Value = proto::Vector3> {
    let long = anywhere().prop_filter("has a direction", |v| to_vector(*v).norm() > 1e-3);
    long.prop_filter_map("has length 1", |v| some(&to_vector(v).normalize()))
}

fn points(count: std::ops::RangeInclusive<usize>) -> impl Strategy<Value = Vec<proto::Vector3>> {
    prop::collection::vec(anywhere(), count)
}

/// None, a diagonal, or all nine: none of them could be written shorter.
fn any_matrix() -> impl Strategy<Value = Vec<f64>> {
    prop_oneof![
        Just(vec![]),
        prop::collection::vec(1e-3..1e6, 3),
        prop::collection::vec(-1e6..-1e-3, 9),
    ]
}

fn any_path() -> impl Strategy<Value = Path> {
    let point_and_direction = || (anywhere(), direction());
    prop_oneof![
        anywhere().prop_map(|p| Path::Point(proto::GuidePoint { point_m: Some(p) })),
        point_and_direction().prop_map(|(p, d)| {
            Path::Line(proto::GuideLine { point_m: Some(p), direction: Some(d) })
        }),
        point_and_direction().prop_map(|(p, n)| {
            Path::Plane(proto::GuidePlane { point_m: Some(p), normal: Some(n) })
        }),
    ]
}

fn any_box() -> impl Strategy<Value = proto::Box> {
    let turn = prop::array::uniform4(-1.0..1.0).prop_filter_map("turns", |[x, y, z, w]| {
        let q = Quaternion::new(w, x, y, z);
        let q = (q.norm() > 1e-3).then(|| q.normalize())?;
        Some(proto::Quaternion { x: q.i, y: q.j, z: q.k, w: q.w })
    });
    let half = prop::array::uniform3(1e-4..100.0).prop_map(|[x, y, z]| proto::Vector3 { x, y, z });
    (anywhere(), half, prop::option::of(turn)).prop_map(|(centre, half, orientation)| proto::Box {
        centre_m: Some(centre),
        half_extents_m: Some(half),
        orientation,
    })
}

fn any_kind() -> impl Strategy<Value = Kind> {
    prop_oneof![
        (anywhere(), direction()).prop_map(|(p, n)| {
            Kind::HalfSpace(proto::HalfSpace { point_m: Some(p), normal: Some(n) })
        }),
        (anywhere(), 1e-4..100.0).prop_map(|(c, radius_m)| {
            Kind::Sphere(proto::Sphere { centre_m: Some(c), radius_m })
        }),
        any_box().prop_map(Kind::Box),
        (points(2..=2), 1e-4..100.0)
            .prop_map(|(ends_m, radius_m)| { Kind::Capsule(proto::Capsule { ends_m, radius_m }) }),
        (points(2..=64), 0.0..100.0).prop_map(|(points_m, radius_m)| {
            Kind::Corridor(proto::Corridor { points_m, radius_m })
        }),
        (any_path(), 0.0..100.0).prop_map(|(path, radius_m)| {
            Kind::Guide(proto::Guide { radius_m, path: Some(path) })
        }),
        anywhere().prop_map(|f| Kind::Constant(proto::ConstantField { force_n: Some(f) })),
        (0.0..1e6).prop_map(|b| Kind::Viscous(proto::ViscousField { damping_ns_per_m: b })),
        (anywhere(), anywhere(), anywhere(), any_matrix(), any_matrix(), 0.0..100.0).prop_map(
            |(origin, force, moment, stiffness, damping, radius_m)| {
                Kind::ForceField(proto::ForceField {
                    origin_m: Some(origin),
                    wrench: Some(proto::Wrench { force_n: Some(force), moment_nm: Some(moment) }),
                    stiffness_n_per_m: stiffness,
                    damping_ns_per_m: damping,
                    radius_m,
                })
            }
        ),
    ]
}

fn any_material() -> impl Strategy<Value = proto::Material> {
    let above = prop::option::of(1e-3..5.0);
    (0.0..1e9, 0.0..1e6, 0.0..5.0, above, prop::option::of(anywhere())).prop_map(
        |(stiffness, damping, kinetic, above, velocity)| proto::Material {
            stiffness_n_per_m: stiffness,
            damping_ns_per_m: damping,
            kinetic_friction: kinetic,
            static_friction: above.map(|above| kinetic + above),
            surface_velocity_m_per_s: velocity,
        },
    )
}

fn any_object() -> impl Strategy<Value = proto::SceneObject> {
    (any_kind(), any_material(), any::<bool>()).prop_map(|(kind, material, hollow)| {
        let shape =
            matches!(kind, Kind::HalfSpace(_) | Kind::Sphere(_) | Kind::Box(_) | Kind::Capsule(_));
        let led = matches!(kind, Kind::Corridor(_) | Kind::Guide(_));
        proto::SceneObject {
            name: "things/thing".into(),
            revision: 0,
            material: (shape || led).then_some(material),
            hollow: hollow && shape,
            kind: Some(kind),
        }
    })
}

fn id() -> Id {
    Id::parse("id", "thing").expect("it is one")
}

proptest! {
    #[test]
    fn through_the_contract_and_through_toml_an_object_stays_what_it_is(written in any_object()) {
        let object = object_from_proto(id(), &written).unwrap();
        prop_assert_eq!(&object_to_proto(&object, "things/thing".into()), &written);
        let text = write_scene_objects([&object]).unwrap();
        let read = read_scene_objects(&text, "mine.toml").unwrap();
        prop_assert_eq!(&read, std::slice::from_ref(&object), "{}", text);
        prop_assert_eq!(&object_to_proto(&read[0], "things/thing".into()), &written);
        prop_assert_eq!(read[0].element(), object.element());
    }

    #[test]
    fn whatever_numbers_come_in_only_finite_ones_come_through(
        written in any_object(),
        bits in any::<u64>(),
        place in any::<u8>(),
    ) {
        let mut wild = written;
        spoil(&mut wild, f64::from_bits(bits), place);
        if let Ok(object) = object_from_proto(id(), &wild) {
            let text = format!("{:?}", object.element());
            let field_without_edge = matches!(wild.kind, Some(Kind::ForceField(_)));
            prop_assert!(!text.contains("NaN"), "{text}");
            prop_assert!(field_without_edge || !text.contains("inf"), "{text}");
        }
    }
}

/// Puts a number somewhere.
fn spoil(object: &mut proto::SceneObject, number: f64, place: u8) {
    let x = |v: &mut Option<proto::Vector3>| v.get_or_insert_default().x = number;
    if let (Some(material), true) = (&mut object.material, place.is_multiple_of(3)) {
        match place % 5 {
            0 => material.stiffness_n_per_m = number,
            1 => material.damping_ns_per_m = number,
            2 => material.kinetic_friction = number,
            3 => material.static_friction = Some(number),
            _ => x(&mut material.surface_velocity_m_per_s),
        }
        return;
    }
    let first = place.is_multiple_of(2);
    match object.kind.as_mut().expect("it has one") {
        Kind::HalfSpace(wall) => x(if first { &mut wall.point_m } else { &mut wall.normal }),
        Kind::Sphere(ball) if first => ball.radius_m = number,
        Kind::Sphere(ball) => x(&mut ball.centre_m),
        Kind::Box(block) if first => block.orientation.get_or_insert_default().z = number,
        Kind::Box(block) => x(&mut block.half_extents_m),
        Kind::Capsule(capsule) if first => capsule.radius_m = number,
        Kind::Capsule(capsule) => capsule.ends_m[1].y = number,
        Kind::Corridor(corridor) if first => corridor.radius_m = number,
        Kind::Corridor(corridor) => corridor.points_m[0].z = number,
        Kind::Guide(guide) => guide.radius_m = number,
        Kind::Constant(field) => x(&mut field.force_n),
        Kind::Viscous(field) => field.damping_ns_per_m = number,
        Kind::ForceField(field) if first => field.stiffness_n_per_m = vec![number; 3],
        Kind::ForceField(field) => x(&mut field.wrench.get_or_insert_default().moment_nm),
    }
}

#[test]
fn what_is_missing_or_of_the_wrong_number_is_named() {
    let material = Some(proto::Material::default());
    let with = |kind| proto::SceneObject { kind: Some(kind), material, ..Default::default() };
    let x = Some(proto::Vector3::default());
    let lead = |path| Kind::Guide(proto::Guide { radius_m: 0.0, path });
    for (object, expected) in [
        (proto::SceneObject::default(), "kind = (none): one of half_space, sphere, box"),
        (with(Kind::HalfSpace(proto::HalfSpace::default())), "half_space.point_m = (none)"),
        (with(Kind::Box(proto::Box::default())), "box.centre_m = (none): is required"),
        (
            with(Kind::Box(proto::Box { centre_m: x, ..Default::default() })),
            "box.half_extents_m = (none): is required",
        ),
        (with(Kind::Capsule(proto::Capsule::default())), "capsule.ends_m = 0 points: must be 2"),
        (with(Kind::Corridor(proto::Corridor::default())), "corridor.points_m = 0 points"),
        (with(lead(None)), "guide.path = (none): one of point, line, plane is required"),
        (with(lead(Some(Path::Line(proto::GuideLine::default())))), "guide.line.point_m = (none)"),
        (
            with(lead(Some(Path::Plane(proto::GuidePlane { point_m: x, normal: None })))),
            "guide.plane.normal = (none)",
        ),
        (with(Kind::ForceField(proto::ForceField::default())), "force_field.origin_m = (none)"),
        (
            with(Kind::ForceField(proto::ForceField {
                origin_m: x,
                stiffness_n_per_m: vec![1.0; 4],
                ..Default::default()
            })),
            "force_field.stiffness_n_per_m = 4 numbers: must have 0, 3 (the diagonal) or 9",
        ),
    ] {
        let refused = object_from_proto(id(), &object).unwrap_err().to_string();
        assert!(refused.starts_with(expected), "{refused} / {expected}");
    }
}

/// Depth of a plate of 2 mm across x, 350 mm out, in each tick of a hand that nothing stops.
fn felt_depth_m(x_m: impl IntoIterator<Item = f64>) -> Vec<f64> {
    let vector = |x, y, z| Some(proto::Vector3 { x, y, z });
    // A quarter turn about z lays its own y along x of W.
    let turn = Some(proto::Quaternion { x: 0.0, y: 0.0, z: 0.5f64.sqrt(), w: 0.5f64.sqrt() });
    let plate = proto::SceneObject {
        kind: Some(Kind::Box(proto::Box {
            centre_m: vector(0.35, 0.0, 0.0),
            half_extents_m: vector(0.2, 0.001, 0.2),
            orientation: turn,
        })),
        material: Some(proto::Material { stiffness_n_per_m: 2e4, ..Default::default() }),
        ..Default::default()
    };
    let mut scene = Scene::default();
    scene.create(object_from_proto(id(), &plate).unwrap(), None).unwrap();
    let plan = build_plan(&DeviceDefinition::load("cho-2005").unwrap(), &scene);
    let mut state = ControlState::new(Mode::Enabled);
    let per_rad = plan.actuators.counts_per_revolution / std::f64::consts::TAU;
    let mut depth_m = |(now_ms, x_m): (u64, f64)| {
        let posture = plan.mechanism.posture_at(&PlaneVector::new(x_m, 0.02, 0.0)).unwrap();
        let mut sample = Sample::default();
        for i in 0..plan.mechanism.actuators() {
            sample.counts[i] = (posture.shaft_rad[i] * per_rad[i]).round() as i64;
        }
        let (sample, setpoint, now_ns) = (Ok(sample), &Setpoint::NONE, now_ms * 1_000_000);
        let input = TickInput { sample, setpoint, plan: &plan, now_ns, overruns_in_row: 0 };
        let report = tick(&mut state, &input).report;
        report.contacts().first().map_or(0.0, |contact| contact.depth_m)
    };
    (1..).zip(x_m).map(&mut depth_m).collect()
}

#[test]
fn a_plate_of_two_millimetres_set_through_the_contract_is_not_passed_through_at_1_m_per_s() {
    for way in [1.0, -1.0] {
        let gone_m = |tick: i32| 1e-3 * f64::from(tick) - 0.03;
        let depths_m = felt_depth_m((0..80).map(|tick| 0.35 + way * gone_m(tick)));
        for (tick, depth_m) in (0..).zip(depths_m) {
            // From the side on which it came, however far it is beyond the other one.
            let expected_m = (gone_m(tick) + 0.001).max(0.0);
            assert!((depth_m - expected_m).abs() < 1e-4, "{tick}: {depth_m} {expected_m}");
        }
    }
}

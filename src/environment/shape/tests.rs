//! What every shape is held to: sampled nearest points and finite differences.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;

/// Random points around the origin, where the test shapes are.
pub fn points(count: usize) -> Vec<Vector3<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    (0..count).map(|_| Vector3::from_fn(|_, _| rng.random_range(-0.12..0.12))).collect()
}

/// Two shares of 1 as a point of the unit sphere, evenly.
pub fn on_unit_sphere(a: f64, b: f64) -> Vector3<f64> {
    let z: f64 = 2.0 * a - 1.0;
    let (sin, cos) = (b * std::f64::consts::TAU).sin_cos();
    let flat = (1.0 - z * z).max(0.0).sqrt();
    Vector3::new(flat * cos, flat * sin, z)
}

/// Distance and sign against a dense sampling of the surface, and the gradient too.
pub fn check_against_samples(
    shape: &Shape,
    on_surface: impl Fn(f64, f64) -> Vector3<f64>,
    inside: impl Fn(&Vector3<f64>) -> bool,
) {
    const SIDE: usize = 600;
    let grid: Vec<_> = (0..SIDE * SIDE)
        .map(|i| [i / SIDE, i % SIDE].map(|i| (i as f64 + 0.5) / SIDE as f64))
        .map(|[a, b]| on_surface(a, b))
        .collect();
    let mut sides = [0, 0];
    for p in points(120) {
        let sampled_m = grid.iter().map(|q| (p - q).norm()).fold(f64::INFINITY, f64::min);
        let found = shape.nearest(&p);
        sides[usize::from(inside(&p))] += 1;
        // A sample is never nearer than the nearest point; one is within a cell of it.
        let apart_m = sampled_m - found.distance_m.abs();
        assert!((-1e-9..1.5e-3).contains(&apart_m), "{p}: {sampled_m} and {found:?}");
        assert_eq!(found.distance_m < 0.0, inside(&p), "{p}: {found:?}");
    }
    assert!(sides[0] > 5 && sides[1] > 5, "points on both sides: {sides:?}");
    check_gradient(shape);
}

/// The normal is the gradient, by central differences where it is smooth.
pub fn check_gradient(shape: &Shape) {
    const STEP_M: f64 = 1e-6;
    let mut smooth = 0;
    for p in points(200) {
        let at = |d: Vector3<f64>| shape.nearest(&(p + d));
        let steps = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| axis * STEP_M);
        let here = at(Vector3::zeros());
        if steps.iter().any(|step| (at(*step).normal_W - at(-step).normal_W).norm() > 1e-3) {
            continue; // a ridge within the step
        }
        smooth += 1;
        let slope =
            |i: usize, _| (at(steps[i]).distance_m - at(-steps[i]).distance_m) / (2.0 * STEP_M);
        let gradient = Vector3::from_fn(slope);
        assert!((gradient - here.normal_W).norm() < 1e-4, "{p}: {gradient} {here:?}");
        assert!((here.normal_W.norm() - 1.0).abs() < 1e-12);
    }
    assert!(smooth > 190, "{smooth}");
}

fn plate(centre_W_m: Vector3<f64>, turn_rad: f64) -> Shape {
    let q_WS = UnitQuaternion::from_euler_angles(0.3, turn_rad, -0.2);
    Shape::Box { centre_W_m, q_WS, half_extents_m: Vector3::new(0.1, 0.1, 0.001) }
}

#[test]
fn what_is_fixed_to_a_shape_moves_with_it() {
    let before = plate(Vector3::new(0.1, 0.0, 0.0), 0.1);
    let after = plate(Vector3::new(0.0, 0.3, 0.1), 1.2);
    let carry = before.carry(&after).expect("both are boxes");
    for p in points(20) {
        let moved = carry * nalgebra::Point3::from(p);
        let (old, new) = (before.nearest(&p), after.nearest(&moved.coords));
        assert!((old.distance_m - new.distance_m).abs() < 1e-12);
        assert!((carry * old.normal_W - new.normal_W).norm() < 1e-9);
    }
    let ball = Shape::Sphere { centre_W_m: Vector3::zeros(), radius_m: 0.1 };
    assert_eq!(before.carry(&ball), None);
}

#[test]
fn a_shape_that_only_turns_its_normal_carries_points_of_its_plane_to_its_plane() {
    let plane = |normal_W: Vector3<f64>| Shape::HalfSpace { point_W_m: Vector3::x(), normal_W };
    let ends = [Vector3::z(), -Vector3::z(), Vector3::new(0.6, 0.8, 0.0)];
    for (from, to) in ends.iter().flat_map(|from| ends.iter().map(move |to| (from, to))) {
        let carry = plane(*from).carry(&plane(*to)).expect("both are planes");
        let on_plane = Vector3::x() + 0.2 * super::across(from);
        let moved = carry * nalgebra::Point3::from(on_plane);
        assert!(plane(*to).nearest(&moved.coords).distance_m.abs() < 1e-12);
    }
}

#[test]
fn a_ball_too_large_for_a_shell_is_led_to_its_middle() {
    let centre_W_m = Vector3::zeros();
    let p = Vector3::new(0.004, 0.0, 0.0);
    let small = [
        Shape::Sphere { centre_W_m, radius_m: 0.01 },
        Shape::Capsule { ends_W_m: [-Vector3::z(), Vector3::z()], radius_m: 0.01 },
        Shape::Box {
            centre_W_m,
            q_WS: UnitQuaternion::identity(),
            half_extents_m: Vector3::repeat(0.01),
        },
    ];
    for shape in small {
        let faces = shape.faces(-1.0, &p, 0.5).expect("inside");
        let (depth_m, normal_W) = faces.iter().next().expect("a face");
        assert!((depth_m - 0.004).abs() < 1e-12 && (normal_W + Vector3::x()).norm() < 1e-12);
        assert_eq!(shape.faces(1.0, &p, 0.5), None, "outside it depends on the way in");
    }
}

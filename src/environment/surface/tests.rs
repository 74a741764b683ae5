//! Touch, memory and blending of one surface, tick by tick.

use nalgebra::UnitQuaternion;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::environment::{Guide, Tool, ToolMotion};

const TICK_S: f64 = 1e-3;

/// A tool point and what one surface remembers of it.
#[derive(Clone, Default)]
struct Feeler {
    tool: Option<Tool>,
    state: SurfaceState,
    radius_m: f64,
}

impl Feeler {
    fn of_radius(radius_m: f64) -> Self {
        Self { radius_m, ..Self::default() }
    }

    /// One tick later, at this place.
    fn at(&mut self, surface: &Surface, revision: u64, p_WT_m: Vector3<f64>) -> Touches {
        let motion = ToolMotion { p_WT_m, ..ToolMotion::default() };
        let tool = Tool::new(&motion, &[], self.radius_m, TICK_S);
        let tool = self.tool.map_or(tool, |last| tool.after(&last));
        self.tool = Some(tool);
        let point = &tool.points()[0];
        if self.state.is_clear(revision, point) {
            return Touches::NONE; // as a scene does it
        }
        surface.touch(&mut self.state, revision, point, self.radius_m, TICK_S)
    }

    /// Depth of the first touch at a place on x.
    fn depth_m(&mut self, surface: &Surface, revision: u64, x_m: f64) -> f64 {
        let touches = self.at(surface, revision, Vector3::new(x_m, 0.0, 0.0));
        touches.iter().next().map_or(0.0, |touch| touch.depth_m)
    }

    /// Spring force at a place on x.
    fn force_N(&mut self, surface: &Surface, revision: u64, x_m: f64) -> f64 {
        surface.material.stiffness_N_per_m * self.depth_m(surface, revision, x_m)
    }
}

fn solid(shape: Shape) -> Surface {
    let material = Material { stiffness_N_per_m: 1e7, ..Material::default() };
    Surface { shape, material, hollow: false, blend_s: 0.0 }
}

/// What is beyond `x_m`.
fn wall(x_m: f64) -> Surface {
    let point_W_m = Vector3::new(x_m, 0.0, 0.0);
    solid(Shape::HalfSpace { point_W_m, normal_W: -Vector3::x() })
}

fn of_stiffness(stiffness_N_per_m: f64, surface: Surface) -> Surface {
    Surface { material: Material { stiffness_N_per_m, ..surface.material }, ..surface }
}

fn ball() -> Surface {
    solid(Shape::Sphere { centre_W_m: Vector3::zeros(), radius_m: 0.1 })
}

fn shell() -> Surface {
    Surface { hollow: true, ..ball() }
}

/// A plate of 2 mm with its middle at `x_m`, across x.
fn plate(x_m: f64) -> Surface {
    solid(Shape::Box {
        centre_W_m: Vector3::new(x_m, 0.0, 0.0),
        q_WS: UnitQuaternion::identity(),
        half_extents_m: Vector3::new(0.001, 0.1, 0.1),
    })
}

#[test]
fn a_wall_is_felt_behind_its_plane_and_only_there() {
    let mut feeler = Feeler::default();
    assert_eq!(feeler.depth_m(&wall(0.3), 1, 0.2), 0.0);
    assert!((feeler.depth_m(&wall(0.3), 1, 0.301) - 0.001).abs() < 1e-12);
}

#[test]
fn the_tool_radius_counts() {
    for surface in [wall(0.3), plate(0.301)] {
        let mut feeler = Feeler::of_radius(0.01);
        assert_eq!(feeler.depth_m(&surface, 1, 0.1), 0.0);
        assert!((feeler.depth_m(&surface, 1, 0.295) - 0.005).abs() < 1e-9);
    }
}

#[test]
fn a_new_wall_around_the_tool_lets_it_out_but_not_deeper() {
    for surface in [wall(0.3), plate(0.301)] {
        let mut feeler = Feeler::default();
        assert_eq!(feeler.depth_m(&surface, 1, 0.3005), 0.0, "no step of force");
        assert!((feeler.depth_m(&surface, 1, 0.3006) - 1e-4).abs() < 1e-12, "not deeper");
        assert_eq!(feeler.depth_m(&surface, 1, 0.3001), 0.0);
        assert!((feeler.depth_m(&surface, 1, 0.3005) - 4e-4).abs() < 1e-12, "it followed out");
    }
}

#[test]
fn a_plate_is_not_passed_through_at_any_speed_from_either_side() {
    for (speed, way, radius_m) in [0.5, 1.0, 1.5, 2.0]
        .into_iter()
        .flat_map(|speed| [1.0, -1.0].map(|way| (speed, way)))
        .flat_map(|(speed, way)| [0.0, 0.004].map(|radius_m| (speed, way, radius_m)))
    {
        for phase in 0..10 {
            let mut feeler = Feeler::of_radius(radius_m);
            for tick in 0..100 {
                let gone_m = (f64::from(tick) + 0.1 * f64::from(phase)) * speed * TICK_S;
                let x_m = way * (gone_m - 0.03);
                let touches = feeler.at(&plate(0.0), 1, Vector3::new(x_m, 0.01, 0.0));
                let depth_m = (gone_m - 0.03 + 0.001 + radius_m).max(0.0);
                let felt_m = touches.iter().next().map_or(0.0, |touch| touch.depth_m);
                assert!((felt_m - depth_m).abs() < 1e-9, "{felt_m} for {depth_m}");
                let outward = touches.iter().all(|touch| touch.normal_W.x * way < -0.999);
                assert!(outward, "it pushes back where the tool came from");
            }
        }
    }
}

#[test]
fn a_moved_wall_keeps_the_force_it_had() {
    let mut feeler = Feeler::default();
    feeler.depth_m(&wall(0.3), 1, 0.2);
    let before_m = feeler.depth_m(&wall(0.3), 1, 0.302);
    let after_m = feeler.depth_m(&wall(0.25), 2, 0.302);
    assert!((before_m - after_m).abs() < 1e-12);
}

#[test]
fn a_moved_plate_takes_the_way_in_with_it() {
    let mut feeler = Feeler::default();
    feeler.depth_m(&plate(0.3), 1, 0.29);
    // Almost through: the far side would be nearer.
    assert!((feeler.depth_m(&plate(0.3), 1, 0.3008) - 0.0018).abs() < 1e-12);
    let touches = feeler.at(&plate(0.302), 2, Vector3::new(0.3018, 0.0, 0.0));
    let touch = touches.iter().next().expect("still behind the side it came from");
    assert_eq!(touch.normal_W, -Vector3::x());
    assert!((touch.depth_m - 0.0008).abs() < 1e-12, "less is less at once: {}", touch.depth_m);
}

#[test]
fn a_plate_that_passes_a_tool_it_does_not_press_leaves_it_alone() {
    let mut feeler = Feeler::default();
    feeler.depth_m(&plate(0.3), 1, 0.31);
    for (tick, x_m) in [0.307, 0.3095, 0.3105, 0.313].into_iter().enumerate() {
        assert_eq!(feeler.depth_m(&plate(x_m), tick as u64 + 2, 0.31), 0.0);
    }
    assert_eq!(feeler.depth_m(&plate(0.313), 5, 0.30), 0.0, "it is free on its side");
}

#[test]
fn a_wall_renewed_every_tick_is_as_hard_as_one_that_stays() {
    let mut feeler = Feeler::default();
    feeler.depth_m(&wall(0.3), 0, 0.2);
    for tick in 1..=200 {
        let (wall_m, tool_m) = (0.3 - 1e-6 * tick as f64, 0.3 + 5e-6 * tick as f64);
        let depth_m = feeler.depth_m(&wall(wall_m), tick, tool_m);
        assert!((depth_m - (tool_m - 0.3)).abs() < 3e-6, "{depth_m} at tick {tick}");
    }
}

#[test]
fn a_change_of_stiffness_keeps_the_force_and_never_raises_it() {
    let (soft, hard) = (of_stiffness(100.0, wall(0.3)), of_stiffness(1e7, wall(0.3)));
    let mut feeler = Feeler::default();
    feeler.force_N(&soft, 1, 0.29);
    assert!((feeler.force_N(&soft, 1, 0.305) - 0.5).abs() < 1e-9);
    assert!((feeler.force_N(&hard, 2, 0.305) - 0.5).abs() < 1e-6, "not 50 kN");
    assert!((feeler.force_N(&hard, 2, 0.305001) - 10.5).abs() < 1e-6, "hard from here on");
    assert_eq!(feeler.force_N(&hard, 2, 0.3), 0.0, "the ratchet gave it all back");
    assert!((feeler.force_N(&hard, 2, 0.3001) - 1000.0).abs() < 1e-6);
    let softer_N = feeler.force_N(&soft, 3, 0.3001);
    assert!((softer_N - 0.01).abs() < 1e-9, "less is given at once: {softer_N}");
}

#[test]
fn a_blend_approaches_the_true_force_in_even_steps() {
    let blend_s = 0.020;
    for (from, to) in [(100.0, 2e4), (100.0, 1e7), (2e4, 2e4)] {
        let before = of_stiffness(from, wall(0.3));
        let after = Surface { blend_s, ..of_stiffness(to, wall(0.299)) };
        let mut feeler = Feeler::default();
        feeler.force_N(&before, 1, 0.29);
        let mut last_N = feeler.force_N(&before, 1, 0.305);
        let true_N = to * 0.006;
        let step_N = (true_N - last_N) * TICK_S / blend_s * (1.0 + 1e-9);
        for tick in 1..=20 {
            let force_N = feeler.force_N(&after, 2, 0.305);
            assert!((0.0..=step_N).contains(&(force_N - last_N)), "{last_N} {force_N} {tick}");
            last_N = force_N;
        }
        assert!((last_N / true_N - 1.0).abs() < 1e-6, "{last_N} of {true_N}");
    }
}

/// A shape, size, place and kind at random, all near the origin.
fn any_surface(rng: &mut ChaCha8Rng) -> Surface {
    let mut vector = |most: f64| Vector3::from_fn(|_, _| rng.random_range(-most..most));
    let (a, b, turn) = (vector(0.05), vector(0.05), vector(2.0));
    let radius_m = rng.random_range(0.001..0.06);
    let unit = turn.try_normalize(1e-9).unwrap_or_else(Vector3::x);
    let path = match rng.random_range(0..3) {
        0 => Guide::Point { point_W_m: a },
        1 => Guide::Line { point_W_m: a, direction_W: unit },
        _ => Guide::Plane { point_W_m: a, normal_W: unit },
    };
    let shape = match rng.random_range(0..5) {
        0 => Shape::HalfSpace { point_W_m: a, normal_W: unit },
        1 => Shape::Sphere { centre_W_m: a, radius_m },
        2 => Shape::Box {
            centre_W_m: a,
            q_WS: UnitQuaternion::from_scaled_axis(turn),
            half_extents_m: b.abs() + Vector3::repeat(0.001),
        },
        3 => Shape::Capsule { ends_W_m: [a, b], radius_m },
        _ => Shape::Guide { path, radius_m },
    };
    let stiffness = 10f64.powf(rng.random_range(1.0..8.0));
    Surface { hollow: rng.random_bool(0.4), ..of_stiffness(stiffness, solid(shape)) }
}

fn total_N(surface: &Surface, touches: &Touches) -> f64 {
    let sum: Vector3<f64> = touches.iter().map(|touch| touch.depth_m * touch.normal_W).sum();
    surface.material.stiffness_N_per_m * sum.norm()
}

/// Whatever becomes of a surface, its force is at most what it was without the change, to
/// rounding; and everything is a number.
#[test]
fn no_change_of_any_surface_raises_the_force() {
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    let (mut changes_felt, mut ticks_felt) = (0, 0);
    for case in 0..400 {
        let mut feeler = Feeler::of_radius([0.0, 0.003][case % 2]);
        let mut surface = any_surface(&mut rng);
        let mut p = Vector3::from_fn(|_, _| rng.random_range(-0.1..0.1));
        for tick in 0..300u64 {
            p += Vector3::from_fn(|_, _| rng.random_range(-2e-3..2e-3)) - 0.01 * p;
            let unchanged = total_N(&surface, &feeler.clone().at(&surface, tick / 10, p));
            let mut now_N = unchanged;
            if tick % 10 == 9 {
                surface = match rng.random_range(0..3) {
                    0 => any_surface(&mut rng),
                    1 => of_stiffness(10f64.powf(rng.random_range(1.0..8.0)), surface),
                    _ => Surface { hollow: !surface.hollow, ..surface },
                };
                now_N = total_N(&surface, &feeler.at(&surface, tick / 10 + 1, p));
                changes_felt += u32::from(unchanged > 0.0 && now_N > 0.0);
            } else {
                ticks_felt += u32::from(now_N > 0.0);
                feeler.at(&surface, tick / 10, p);
            }
            assert!(now_N <= unchanged * (1.0 + 1e-9) + 1e-6, "{case} {tick} {surface:?}");
            assert!(now_N.is_finite());
        }
    }
    assert!(changes_felt > 500 && ticks_felt > 10_000, "{changes_felt} {ticks_felt}");
}

#[test]
fn a_solid_sphere_pushes_out_and_a_shell_keeps_the_tool_in() {
    let normal_at = |surface: &Surface, from_m, to_m| {
        let mut feeler = Feeler::default();
        assert_eq!(feeler.depth_m(surface, 1, from_m), 0.0);
        let touches = feeler.at(surface, 1, Vector3::new(to_m, 0.0, 0.0));
        touches.iter().next().map(|touch| touch.normal_W)
    };
    assert_eq!(normal_at(&ball(), 0.2, 0.09), Some(Vector3::x()));
    assert_eq!(normal_at(&shell(), 0.05, 0.11), Some(-Vector3::x()));
    assert_eq!(normal_at(&shell(), 0.11, 0.09), Some(Vector3::x()));
    assert_eq!(normal_at(&shell(), 0.11, -0.09), Some(Vector3::x()), "at once through all of it");
}

#[test]
fn the_inside_of_a_hollow_box_has_up_to_three_walls_at_once() {
    let q_WS = UnitQuaternion::from_euler_angles(0.2, 0.5, -1.0);
    let half_extents_m = Vector3::new(0.05, 0.04, 0.03);
    let shape = Shape::Box { centre_W_m: Vector3::z(), q_WS, half_extents_m };
    let room = Surface { hollow: true, ..solid(shape) };
    let mut feeler = Feeler::of_radius(0.01);
    for walls in 0..=3 {
        let corner = Vector3::from_fn(|i, _| {
            if i < walls { half_extents_m[i] - 0.01 + 0.001 * (i + 1) as f64 } else { 0.0 }
        });
        let touches = feeler.at(&room, 1, Vector3::z() + q_WS * corner);
        assert_eq!(touches.iter().count(), walls);
        for (axis, touch) in touches.iter().enumerate() {
            assert!((touch.depth_m - 0.001 * (axis + 1) as f64).abs() < 1e-12);
            let inward = -(q_WS * Vector3::from_fn(|i, _| f64::from(u8::from(i == axis))));
            assert!((touch.normal_W - inward).norm() < 1e-12);
        }
    }
}

#[test]
fn a_surface_begun_again_gives_away_the_depth_of_now() {
    let mut feeler = Feeler::default();
    feeler.depth_m(&plate(0.3), 1, 0.29);
    assert!(feeler.depth_m(&plate(0.3), 1, 0.35) > 0.05);
    feeler.state.reset();
    assert_eq!(feeler.depth_m(&plate(0.3), 1, 0.35), 0.0, "and it is free on the far side");
    assert!((feeler.depth_m(&plate(0.3), 1, 0.3002) - 0.0008).abs() < 1e-9, "from there");
}

#[test]
fn a_guide_is_felt_from_both_sides_and_leads_back() {
    let guide = Guide::Plane { point_W_m: Vector3::zeros(), normal_W: Vector3::x() };
    for radius_m in [0.0, 0.004] {
        let surface = solid(Shape::Guide { path: guide, radius_m });
        let mut feeler = Feeler::of_radius(0.5); // a guide leads the tool point
        feeler.depth_m(&surface, 1, 0.0);
        for x_m in [0.003, 0.006, -0.006, -0.003] {
            let touches = feeler.at(&surface, 1, Vector3::new(x_m, 0.0, 0.0));
            let depth_m = f64::abs(x_m) - radius_m;
            let touch = touches.iter().next();
            assert_eq!(touch.is_some(), depth_m > 0.0);
            if let Some(touch) = touch {
                assert!((touch.depth_m - depth_m).abs() < 1e-12);
                assert!((touch.normal_W.x + f64::signum(x_m)).abs() < 1e-12);
            }
        }
    }
}

#[test]
fn friction_needs_a_load_and_holds_against_the_drag() {
    let rough = Surface { material: wall(0.3).material.with_friction(0.5), ..wall(0.3) };
    let mut feeler = Feeler::default();
    feeler.at(&rough, 1, Vector3::new(0.29, 0.0, 0.0));
    let mut drag = |y_m: f64, load_N: f64| {
        let touches = feeler.at(&rough, 1, Vector3::new(0.3001, y_m, 0.0));
        feeler.state.bear(load_N, 1.0);
        touches.iter().next().map_or((0.0, false), |t| (t.friction_W_N.y, t.sticking))
    };
    assert_eq!(drag(0.0, 10.0), (0.0, false), "no load is known yet");
    let (held_N, sticks) = drag(0.0005, 10.0);
    assert!(sticks && (held_N + 2.5).abs() < 1e-9, "{held_N}");
    let (slips_N, sticks) = drag(0.01, 10.0);
    assert!(!sticks && (slips_N + 5.0).abs() < 1e-9, "{slips_N}");
    assert!(!drag(0.02, 0.0).1);
    assert_eq!(drag(0.03, 10.0), (0.0, false), "nobody told of a load");
}

#[test]
fn whatever_place_it_is_asked_for_nothing_but_numbers_comes_out() {
    let mut rng = ChaCha8Rng::seed_from_u64(21);
    let odd = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e308, -1e308, 0.0, 1e-308];
    for _ in 0..300 {
        let mut feeler = Feeler::default();
        for tick in 0..60u64 {
            let surface = any_surface(&mut rng);
            let wild = rng.random_bool(0.2);
            let coordinate = |_, _| match wild {
                true => odd[rng.random_range(0..odd.len())],
                false => rng.random_range(-0.1..0.1),
            };
            let p = Vector3::from_fn(coordinate);
            let touches = feeler.at(&surface, tick / 3, p);
            for touch in touches.iter() {
                let numbers = touch.normal_W.iter().chain(touch.friction_W_N.iter());
                assert!(numbers.chain([&touch.depth_m]).all(|number| number.is_finite()));
            }
        }
        // And it recovers.
        feeler.at(&wall(0.3), 100, Vector3::zeros());
        assert!((feeler.depth_m(&wall(0.3), 100, 0.301) - 0.001).abs() < 1e-9);
    }
}

//! The proxy on a body's surface that remembers which way the tool came in.
//!
//! The nearest way out of a thin plate is the far side as soon as the tool is half through.
//! The proxy (the god object of Zilles & Salisbury 1995) stays on the side that was entered:
//! on every tick the tool is projected onto the tangent plane at the proxy and from there to
//! the nearest point of the surface. Because a body is convex, it lies wholly behind that
//! plane: a tool before the plane is free, however it got there, and one behind it is held
//! even where the far side was passed.
//!
//! The tool is a ball: the surface here is the body's, `radius_m` further out. W, metres.
//! Entry is found along the path of the tick by sphere tracing (Hart 1996), so that no speed
//! passes through. Work is bounded everywhere.

use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::shape::{Nearest, Shape};

/// Projections of one tick. Each multiplies what is left of the way along a curved surface by
/// `depth / (depth + radius of curvature)`; on a flat one the first is exact.
const PASSES: usize = 4;

/// Steps of a trace. Each leaves `1 - sin(angle to the surface)` of the distance: 16 come
/// from 5 mm to below 0.1 mm at more than 15 degrees, and a flatter path than that goes
/// through no plate in one tick. What is left, the first projection closes.
const STEPS: usize = 16;

/// Nearer than this is on the surface, metres.
const ON_SURFACE_M: f64 = 1e-7;

/// Where the tool would be if it could not enter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Proxy {
    /// On the surface, or `radius_m` before it.
    p_W_m: Vector3<f64>,
    /// Unit vector out of the body there.
    normal_W: Vector3<f64>,
}

impl Proxy {
    /// The point of the surface nearest to a place.
    pub fn nearest(shape: &Shape, radius_m: f64, p_W_m: &Vector3<f64>) -> Self {
        let Nearest { distance_m, normal_W } = shape.nearest(p_W_m);
        Self { p_W_m: p_W_m - normal_W * (distance_m - radius_m), normal_W }
    }

    /// Where a straight path enters, if it does. A path that begins inside entered nearest
    /// to its beginning.
    pub fn entered(
        shape: &Shape,
        radius_m: f64,
        from_W_m: &Vector3<f64>,
        to_W_m: &Vector3<f64>,
    ) -> Option<Self> {
        let path_m = to_W_m - from_W_m;
        let length_m = path_m.norm();
        let mut gone_m = 0.0;
        let mut at_W_m = *from_W_m;
        for _ in 0..STEPS {
            let free_m = shape.nearest(&at_W_m).distance_m - radius_m;
            if free_m <= ON_SURFACE_M && (gone_m > 0.0 || free_m <= 0.0) {
                break;
            }
            gone_m += free_m;
            if gone_m < length_m {
                at_W_m = from_W_m + path_m * (gone_m / length_m);
                continue;
            }
            let end_m = shape.nearest(to_W_m).distance_m - radius_m;
            return (end_m <= 0.0).then(|| Self::nearest(shape, radius_m, to_W_m));
        }
        Some(Self::nearest(shape, radius_m, &at_W_m))
    }

    /// How far the tool is behind the tangent plane.
    pub fn depth_m(&self, p_W_m: &Vector3<f64>) -> f64 {
        (self.p_W_m - p_W_m).dot(&self.normal_W)
    }

    /// The way out.
    pub fn normal_W(&self) -> Vector3<f64> {
        self.normal_W
    }

    /// Slides along the surface after the tool; the depth there, not positive when the tool
    /// has come free.
    pub fn follow(&mut self, shape: &Shape, radius_m: f64, p_W_m: &Vector3<f64>) -> f64 {
        for _ in 0..PASSES {
            let depth_m = self.depth_m(p_W_m);
            if depth_m <= 0.0 || depth_m.is_nan() {
                break;
            }
            let before = self.p_W_m;
            *self = Self::nearest(shape, radius_m, &(p_W_m + depth_m * self.normal_W));
            if (self.p_W_m - before).norm_squared() < ON_SURFACE_M * ON_SURFACE_M {
                break;
            }
        }
        self.depth_m(p_W_m)
    }

    /// The proxy on the same place of a shape that has moved or changed a little.
    pub fn carry(&self, moved: &Isometry3<f64>, shape: &Shape, radius_m: f64) -> Self {
        Self::nearest(shape, radius_m, &(moved * Point3::from(self.p_W_m)).coords)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    const THICK_M: f64 = 0.002;

    /// A plate with its top at z = 1 mm and its bottom at -1 mm.
    fn plate() -> Shape {
        Shape::Box {
            centre_W_m: Vector3::zeros(),
            q_WS: UnitQuaternion::identity(),
            half_extents_m: Vector3::new(0.1, 0.1, THICK_M / 2.0),
        }
    }

    fn ball() -> Shape {
        Shape::Sphere { centre_W_m: Vector3::zeros(), radius_m: 0.02 }
    }

    /// Depth tick by tick along straight paths, with no memory but the proxy.
    fn track(shape: &Shape, radius_m: f64, path: impl Fn(f64) -> Vector3<f64>) -> Vec<f64> {
        let mut proxy: Option<Proxy> = None;
        let mut last = path(0.0);
        let step = |tick: u32| {
            let p = path(f64::from(tick) * 1e-3);
            proxy = proxy.or_else(|| Proxy::entered(shape, radius_m, &last, &p));
            last = p;
            let depth_m = proxy.as_mut().map_or(-1.0, |proxy| proxy.follow(shape, radius_m, &p));
            proxy = proxy.filter(|_| depth_m > 0.0);
            depth_m.max(0.0)
        };
        (0..60).map(step).collect()
    }

    #[test]
    fn a_thin_plate_is_not_passed_through_at_any_speed_angle_side_or_radius() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        for _ in 0..2000 {
            let speed = rng.random_range(0.5..2.0);
            let radius_m = [0.0, 0.005][rng.random_range(0..2)];
            let side = [1.0, -1.0][rng.random_range(0..2)];
            let slope: f64 = rng.random_range(-1.2..1.2);
            let turn = rng.random_range(0.0..std::f64::consts::TAU);
            let down =
                Vector3::new(slope.sin() * turn.cos(), slope.sin() * turn.sin(), -slope.cos());
            let start_m = rng.random_range(0.0061..0.012);
            let path = |t: f64| side * (Vector3::z() * start_m + speed * t * down);
            for (tick, depth_m) in track(&plate(), radius_m, path).into_iter().enumerate() {
                let p = path(tick as f64 * 1e-3);
                let below_m = (THICK_M / 2.0 + radius_m - side * p.z).max(0.0);
                let room_m = 0.1 + radius_m - p.xy().amax();
                if room_m > 0.01 {
                    assert!((depth_m - below_m).abs() < 1e-9, "{tick}: {depth_m}, {below_m}");
                }
            }
        }
    }

    #[test]
    fn over_its_edge_a_plate_lets_go() {
        let path = |t: f64| Vector3::new(0.09 + t, 0.0, -0.004 * (t / 0.001).min(1.0) + 0.002);
        let depths = track(&plate(), 0.0, path);
        assert!((depths[5] - 0.003).abs() < 1e-12, "{}", depths[5]);
        assert!(depths[11..].iter().all(|depth_m| *depth_m == 0.0), "beyond x = 100 mm");
    }

    #[test]
    fn a_ball_pushes_back_the_way_the_tool_came_though_its_centre_was_passed() {
        let down = |t: f64| Vector3::new(1e-6, 0.0, 0.021 - t);
        for (tick, depth_m) in track(&ball(), 0.0, down).into_iter().enumerate().take(25) {
            let below_m = (0.02 - down(tick as f64 * 1e-3).z).max(0.0);
            assert!((depth_m - below_m).abs() < 2e-5, "{tick}: {depth_m}, {below_m}");
        }
    }

    /// Sliding on a curved surface: the proxy is the nearest point, found by sampling.
    #[test]
    fn the_proxy_stays_nearest_on_a_curved_surface() {
        let path = |t: f64| {
            let (sin, cos) = (8.0 * t).sin_cos();
            Vector3::new(0.019 * sin, 0.0, 0.019 * cos)
        };
        for depth_m in track(&ball(), 0.0, path) {
            assert!((depth_m - 0.001).abs() < 1e-7, "{depth_m}");
        }
    }

    #[test]
    fn a_path_that_ends_in_a_body_is_held_and_one_beside_it_is_not() {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut hits = 0;
        for _ in 0..5000 {
            let mut point = || Vector3::from_fn(|_, _| rng.random_range(-0.05..0.05));
            let (from, to) = (point(), point());
            let free = |p: &Vector3<f64>| ball().nearest(p).distance_m > 0.0;
            if !free(&from) {
                continue;
            }
            let crosses = (0..=2000).any(|i| !free(&from.lerp(&to, f64::from(i) / 2000.0)));
            // A trace that ends close to the surface calls it an entry; the first projection
            // then lets go.
            let entered = Proxy::entered(&ball(), 0.0, &from, &to);
            let held = entered.is_some_and(|mut at| at.follow(&ball(), 0.0, &to) > 0.0);
            assert!(crosses || !held, "{from} to {to}");
            if !free(&to) {
                assert!(held, "{from} to {to}");
                hits += 1;
            }
        }
        assert!(hits > 100, "{hits}");
    }

    #[test]
    fn paths_of_no_number_enter_nothing_and_do_not_hang() {
        for bad in [f64::NAN, f64::INFINITY, 1e308] {
            let far = Vector3::repeat(bad);
            for (from, to) in [(far, Vector3::zeros()), (Vector3::z(), far), (far, far)] {
                let _ = Proxy::entered(&plate(), 0.01, &from, &to);
                let mut proxy = Proxy::nearest(&ball(), 0.0, &from);
                let _ = proxy.follow(&ball(), 0.0, &to);
            }
        }
    }
}

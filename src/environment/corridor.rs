//! A corridor: a polyline that the tool is led along, free within a radius of it.
//!
//! W, metres. The tool is in one segment at a time and passes only to neighbours, so that a
//! strand of the same corridor that comes close by never takes it over. A corridor that
//! appears takes the segment that is nearest. For one tick it is a [`Guide::Segment`]; all
//! that a guide does, blending included, is in [`Surface`].

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::shape::{Guide, Shape};
use super::{Material, Surface, SurfaceState, ToolPoint, Touches};

/// Most points of a corridor.
pub const MAX_CORRIDOR_POINTS: usize = 64;

/// A polyline and the room around it. Built outside the loop: it owns its points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Corridor {
    points_W_m: Box<[Vector3<f64>]>,
    /// The tool is free within this distance of the polyline; 0: only on it.
    pub radius_m: f64,
    /// What its wall feels like.
    pub material: Material,
    /// Time over which a change takes effect; zero: only as the tool moves back.
    pub blend_s: f64,
}

impl Corridor {
    /// A corridor through these points, in their order; `None` unless there are 2 to
    /// [`MAX_CORRIDOR_POINTS`].
    pub fn new(
        points_W_m: Box<[Vector3<f64>]>,
        radius_m: f64,
        material: Material,
        blend_s: f64,
    ) -> Option<Self> {
        let enough = (2..=MAX_CORRIDOR_POINTS).contains(&points_W_m.len());
        enough.then_some(Self { points_W_m, radius_m, material, blend_s })
    }

    /// Its points.
    pub fn points_W_m(&self) -> &[Vector3<f64>] {
        &self.points_W_m
    }

    /// The touch of a tool point; advances `state` by `tick_s`.
    pub fn touch(
        &self,
        state: &mut SurfaceState,
        revision: u64,
        point: &ToolPoint,
        tick_s: f64,
    ) -> Touches {
        let last = state.knows(revision).then_some(usize::from(state.segment));
        let segment = self.segment_at(last, &point.p_W_m);
        state.segment = segment as u8;
        let path = Guide::Segment { ends_W_m: self.ends(segment) };
        let shape = Shape::Guide { path, radius_m: self.radius_m };
        let surface =
            Surface { shape, material: self.material, hollow: false, blend_s: self.blend_s };
        surface.touch(state, revision, point, 0.0, tick_s)
    }

    fn ends(&self, segment: usize) -> [Vector3<f64>; 2] {
        [self.points_W_m[segment], self.points_W_m[segment + 1]]
    }

    /// The next segments on either side. One of a repeated point is stepped over: it is never
    /// nearer than the end before it, and nothing would lead past it.
    fn neighbours(&self, here: usize) -> impl Iterator<Item = usize> {
        let has_length = |segment: &usize| {
            let [from_W_m, to_W_m] = self.ends(*segment);
            from_W_m != to_W_m
        };
        let before = (0..here).rev().find(has_length);
        let after = (here + 1..self.points_W_m.len() - 1).find(has_length);
        before.into_iter().chain(after)
    }

    /// From the segment that the tool was in to the nearest that can be reached by ever nearer
    /// neighbours; the nearest of all where it was in none.
    fn segment_at(&self, last: Option<usize>, p_W_m: &Vector3<f64>) -> usize {
        let segments = self.points_W_m.len() - 1;
        let range_m = |i: usize| {
            let path = Guide::Segment { ends_W_m: self.ends(i) };
            (p_W_m - path.nearest_point(p_W_m)).norm()
        };
        let nearer = |best: (usize, f64), i: usize| {
            let range_m = range_m(i);
            if range_m < best.1 { (i, range_m) } else { best }
        };
        let Some(last) = last.filter(|last| *last < segments) else {
            return (1..segments).fold((0, range_m(0)), nearer).0;
        };
        let mut best = (last, range_m(last));
        for _ in 0..segments {
            let (here, _) = best;
            best = self.neighbours(here).fold(best, nearer);
            if best.0 == here {
                break;
            }
        }
        best.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::{Tool, ToolMotion};

    const TICK_S: f64 = 1e-3;
    const STIFFNESS: f64 = 1000.0;

    /// There and back: two strands 20 mm apart, joined at x = 100 mm.
    fn hairpin(radius_m: f64) -> Corridor {
        let points = [[0.0, 0.0], [0.05, 0.0], [0.1, 0.0], [0.1, 0.02], [0.05, 0.02], [0.0, 0.02]];
        let points = points.map(|[x, y]| Vector3::new(x, y, 0.0)).into();
        let material = Material { stiffness_N_per_m: STIFFNESS, ..Material::default() };
        Corridor::new(points, radius_m, material, 0.0).expect("six points")
    }

    struct Walk {
        corridor: Corridor,
        state: SurfaceState,
        tool: Option<Tool>,
    }

    impl Walk {
        fn to(&mut self, x: f64, y: f64) -> Option<(Vector3<f64>, f64)> {
            let motion = ToolMotion { p_WT_m: Vector3::new(x, y, 0.0), ..ToolMotion::default() };
            let tool = Tool::new(&motion, &[], 0.0, TICK_S);
            let tool = self.tool.map_or(tool, |last| tool.after(&last));
            self.tool = Some(tool);
            if self.state.is_clear(1, &tool.points()[0]) {
                return None; // as the scene does it
            }
            let touches = self.corridor.touch(&mut self.state, 1, &tool.points()[0], TICK_S);
            touches.iter().next().map(|touch| (touch.normal_W, touch.depth_m))
        }

        fn straight(&mut self, from: [f64; 2], to: [f64; 2]) -> Option<(Vector3<f64>, f64)> {
            let mut last = None;
            for i in 0..=200 {
                let share = f64::from(i) / 200.0;
                let [x, y] = [0, 1].map(|k| from[k] + share * (to[k] - from[k]));
                last = self.to(x, y);
            }
            last
        }
    }

    fn walk(radius_m: f64) -> Walk {
        Walk { corridor: hairpin(radius_m), state: SurfaceState::default(), tool: None }
    }

    #[test]
    fn within_its_radius_the_tool_is_free_and_beyond_it_is_led_back() {
        let mut walk = walk(0.004);
        assert_eq!(walk.straight([0.01, 0.0], [0.08, 0.003]), None);
        let (normal_W, depth_m) = walk.straight([0.08, 0.003], [0.08, -0.006]).expect("outside");
        assert!((normal_W - Vector3::y()).norm() < 1e-9 && (depth_m - 0.002).abs() < 1e-12);
    }

    #[test]
    fn a_strand_that_passes_close_by_never_takes_over() {
        let mut walk = walk(0.0);
        walk.straight([0.02, 0.0], [0.02, 0.001]);
        // Right up to the other strand: still led back to the first.
        let (normal_W, depth_m) = walk.straight([0.02, 0.001], [0.02, 0.019]).expect("outside");
        assert!((normal_W + Vector3::y()).norm() < 1e-9 && (depth_m - 0.019).abs() < 1e-12);
        // Along the corridor it gets there.
        walk.straight([0.02, 0.019], [0.02, 0.0]);
        walk.straight([0.02, 0.0], [0.1, 0.0]);
        walk.straight([0.1, 0.0], [0.1, 0.02]);
        walk.straight([0.1, 0.02], [0.02, 0.02]);
        let (normal_W, depth_m) = walk.straight([0.02, 0.02], [0.02, 0.015]).expect("outside");
        assert!((normal_W - Vector3::y()).norm() < 1e-9 && (depth_m - 0.005).abs() < 1e-12);
    }

    #[test]
    fn one_that_appears_takes_the_nearest_strand_and_pulls_nobody() {
        let mut walk = walk(0.001);
        assert_eq!(walk.to(0.03, 0.016), None, "what is beyond the radius is given away");
        let (normal_W, depth_m) = walk.straight([0.03, 0.016], [0.03, 0.014]).expect("deeper");
        assert!((normal_W - Vector3::y()).norm() < 1e-9 && (depth_m - 0.002).abs() < 1e-12);
    }

    #[test]
    fn a_repeated_point_is_no_dead_end_in_either_direction() {
        let [a, b, c] = [[0.0, 0.0], [0.05, 0.0], [0.05, 0.05]];
        let points = [a, a, b, b, b, c, c].map(|[x, y]| Vector3::new(x, y, 0.0)).into();
        let material = Material { stiffness_N_per_m: STIFFNESS, ..Material::default() };
        let corridor = Corridor::new(points, 0.004, material, 0.0).expect("seven points");
        let mut walk = Walk { corridor, state: SurfaceState::default(), tool: None };
        for (from, to) in [(a, b), (b, c), (c, b), (b, a)] {
            for share in 1..=10 {
                let [x, y] = [0, 1].map(|k| from[k] + f64::from(share) / 10.0 * (to[k] - from[k]));
                assert_eq!(walk.straight(from, [x, y]), None, "free at {x} {y}");
            }
        }
    }

    #[test]
    fn a_corridor_has_two_to_sixty_four_points() {
        for (count, fits) in [(0, false), (1, false), (2, true), (64, true), (65, false)] {
            let points = vec![Vector3::zeros(); count].into_boxed_slice();
            let corridor = Corridor::new(points, 0.0, Material::default(), 0.0);
            assert_eq!(corridor.is_some(), fits, "{count}");
        }
    }
}

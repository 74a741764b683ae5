//! Touches that push the same way become one wall of the plane, and the strongest are kept.
//!
//! In B, at H. A wall's `normal` is the wrench of a unit force: its translation part has
//! length 1, and on a device with three freedoms its third part is the moment of that force
//! about H. Touches whose normals agree are one wall with the sum of their forces: a law that
//! saw them as two would split its brakes between them. Derived here.

use crate::actuation::WallDemand;
use crate::environment::{MAX_CONSTRAINTS, MAX_TOUCHES};
use crate::notation::PlaneVector;

/// Normals that differ by less are the same: an angle of 0.06 deg, and lever arms by this
/// share of the device's length. A hundred newtons then miss by a tenth of one.
const COINCIDENT: f64 = 1e-3;

/// A touch that is stiffer by this factor is clearly stiffer.
const CLEARLY: f64 = 3.0;

/// The walls of one tick, as they are put together.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Walls {
    walls: [Wall; MAX_TOUCHES],
    count: usize,
}

/// One wall and what it is made of.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Wall {
    /// Wrench of a unit force of the first touch.
    direction: PlaneVector,
    /// Sum of the wrenches asked for.
    wrench: PlaneVector,
    /// Sum of the forces asked for, newtons.
    pub asked_N: f64,
    /// Depth of its stiffest touch, of those about as stiff the deepest, metres: padding before
    /// a wall is not where the wall is.
    depth_m: f64,
    /// Of that touch, N/m.
    stiffness_N_per_m: f64,
    /// Force along it after clipping, newtons; 0 for a wall that found no room.
    pub force_N: f64,
}

impl Walls {
    /// Adds a touch that asks for `force_N` along a direction; the number of its wall.
    pub fn add(
        &mut self,
        direction: &PlaneVector,
        force_N: f64,
        depth_m: f64,
        moment_length_m: f64,
    ) -> usize {
        let same = |wall: &Wall| {
            let apart = wall.direction - direction;
            apart.xy().norm() <= COINCIDENT && apart.z.abs() <= COINCIDENT * moment_length_m
        };
        let found = self.walls[..self.count].iter().position(same);
        // There are as many places as touches.
        let place = found.unwrap_or(self.count.min(MAX_TOUCHES - 1));
        if found.is_none() {
            self.walls[place] = Wall { direction: *direction, ..Wall::default() };
            self.count = place + 1;
        }
        let wall = &mut self.walls[place];
        wall.wrench += direction * force_N;
        wall.asked_N += force_N;
        let stiffness_N_per_m = force_N / depth_m.max(f64::MIN_POSITIVE);
        if stiffness_N_per_m > CLEARLY * wall.stiffness_N_per_m {
            (wall.depth_m, wall.stiffness_N_per_m) = (depth_m, stiffness_N_per_m);
        } else if CLEARLY * stiffness_N_per_m > wall.stiffness_N_per_m {
            wall.depth_m = wall.depth_m.max(depth_m);
        }
        place
    }

    /// The wall of this number.
    pub fn get(&self, place: usize) -> &Wall {
        &self.walls[place]
    }

    /// Clips each wall to what can be asked along its normal and hands out the strongest, in the
    /// order they were found. Tells how many there are, whether something was clipped, and
    /// whether something was left out.
    pub fn clip(
        &mut self,
        most_along: impl Fn(&PlaneVector) -> f64,
        demands: &mut [WallDemand; MAX_CONSTRAINTS],
    ) -> (usize, bool, bool) {
        let walls = &mut self.walls[..self.count];
        let mut by_force: [usize; MAX_TOUCHES] = std::array::from_fn(|i| i);
        let by_force = &mut by_force[..walls.len()];
        by_force.sort_unstable_by(|a, b| walls[*b].asked_N.total_cmp(&walls[*a].asked_N));
        let kept = &mut by_force[..walls.len().min(MAX_CONSTRAINTS)];
        kept.sort_unstable();
        let mut clipped = false;
        for (demand, place) in demands.iter_mut().zip(kept.iter()) {
            let wall = &mut walls[*place];
            let length = wall.wrench.xy().norm();
            let normal = if length > 0.0 { wall.wrench / length } else { wall.direction };
            let most_N = most_along(&normal);
            clipped |= length > most_N;
            wall.force_N = length.min(most_N);
            *demand = WallDemand { normal, force_N: wall.force_N, depth_m: wall.depth_m };
        }
        (kept.len(), clipped, walls.len() > MAX_CONSTRAINTS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_depth_is_that_of_the_stiff_touch_behind_padding() {
        for stiff_first in [true, false] {
            let mut walls = Walls::default();
            let mut touches = [(10.0, 1e-6), (10.0, 5e-3)];
            if !stiff_first {
                touches.reverse();
            }
            for (force_N, depth_m) in touches {
                walls.add(&towards(0.0, 0.0), force_N, depth_m, 0.1);
            }
            let (demands, _, _) = clipped(&mut walls, 100.0);
            assert_eq!((demands[0].force_N, demands[0].depth_m), (20.0, 1e-6));
        }
    }

    /// A wall that leads out at this angle, by a force on this arm.
    fn towards(angle_rad: f64, arm_m: f64) -> PlaneVector {
        PlaneVector::new(angle_rad.cos(), angle_rad.sin(), arm_m)
    }

    fn clipped(walls: &mut Walls, most_N: f64) -> (Vec<WallDemand>, bool, bool) {
        let mut demands = [WallDemand::default(); MAX_CONSTRAINTS];
        let (count, clipped, crowded) = walls.clip(|_| most_N, &mut demands);
        (demands[..count].to_vec(), clipped, crowded)
    }

    #[test]
    fn what_pushes_the_same_way_is_one_wall_with_the_sum() {
        let mut walls = Walls::default();
        let places = [(0.3, 5.0), (0.3004, 7.0), (0.302, 1.0)]
            .map(|(angle, force_N)| walls.add(&towards(angle, 0.0), force_N, force_N * 1e-4, 1.0));
        assert_eq!(places, [0, 0, 1]);
        let (demands, clipped, crowded) = clipped(&mut walls, 1e9);
        assert!(!clipped && !crowded && demands.len() == 2);
        let sum = 5.0 * towards(0.3, 0.0) + 7.0 * towards(0.3004, 0.0);
        assert!((demands[0].normal * demands[0].force_N - sum).norm() < 1e-12);
        assert!((demands[0].normal.xy().norm() - 1.0).abs() < 1e-12);
        assert_eq!(demands[0].depth_m, 7e-4);
    }

    #[test]
    fn the_same_way_on_another_arm_is_another_wall() {
        let mut walls = Walls::default();
        let on = |walls: &mut Walls, arm_m| walls.add(&towards(0.3, arm_m), 1.0, 0.0, 0.5);
        assert_eq!([0.05, -0.05, 0.0502].map(|arm_m| on(&mut walls, arm_m)), [0, 1, 0]);
    }

    #[test]
    fn the_four_strongest_are_kept_in_their_order_and_the_rest_is_told() {
        let mut walls = Walls::default();
        for (i, force_N) in [3.0, 9.0, 1.0, 8.0, 2.0, 7.0].into_iter().enumerate() {
            walls.add(&towards(i as f64, 0.0), force_N, 0.0, 1.0);
        }
        let (demands, clipped, crowded) = clipped(&mut walls, 8.0);
        let forces: Vec<f64> = demands.iter().map(|demand| demand.force_N).collect();
        assert!(crowded && clipped);
        for (force_N, expected_N) in forces.iter().zip([3.0, 8.0, 8.0, 7.0]) {
            assert!((force_N - expected_N).abs() < 1e-12, "{forces:?}");
        }
        assert_eq!((walls.get(2).force_N, walls.get(4).force_N), (0.0, 0.0));
    }
}

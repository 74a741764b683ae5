//! The largest circle in the workspace of a linkage, found on a lattice.
//!
//! The centre is the reachable place of the lattice that is furthest from every place beyond
//! reach; the radius is that distance, good to one step of the lattice. Places in singular
//! postures inside the workspace are reached: only the edge of reach bounds the circle. The
//! lattice's own border counts as the edge, so it must hold the workspace. The closed form
//! for a symmetric five-bar is in [`super::symmetric`].

use crate::mechanism::{KinematicsError, Mechanism};

use super::grid::Raster;

/// A circle in B.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circle {
    /// Its centre.
    pub centre_m: [f64; 2],
    /// Its radius.
    pub radius_m: f64,
}

/// The largest circle of the reachable places of a lattice; `None` where nothing is reached.
pub fn largest_circle(mechanism: &dyn Mechanism, raster: &Raster) -> Option<Circle> {
    let [columns, rows] = raster.counts();
    let reached = |i: usize, j: usize| {
        let posture = mechanism.posture_at(&raster.place(i, j));
        matches!(posture, Ok(_) | Err(KinematicsError::Singular { .. }))
    };
    // One row of places beyond reach around the lattice.
    let width = columns + 2;
    let mut inside = vec![false; width * (rows + 2)];
    for j in 0..rows {
        for i in 0..columns {
            inside[(j + 1) * width + i + 1] = reached(i, j);
        }
    }
    let (place, steps) = furthest_from_edge(&inside, width)?;
    let centre = raster.place(place % width - 1, place / width - 1);
    Some(Circle { centre_m: [centre.x, centre.y], radius_m: steps * raster.step_m })
}

/// The place of the mask furthest from its edge, and that distance in steps. Ties go to the
/// first place.
fn furthest_from_edge(inside: &[bool], width: usize) -> Option<(usize, f64)> {
    let squared = squared_distances(inside, width);
    let mut best: Option<(usize, f64)> = None;
    for (place, &distance) in squared.iter().enumerate() {
        if distance > best.map_or(0.0, |(_, most)| most) {
            best = Some((place, distance));
        }
    }
    best.map(|(place, squared)| (place, squared.sqrt()))
}

/// Squared distance of each place to the nearest one outside, exactly: along the columns by two
/// sweeps, then along each row the lower envelope by trying.
fn squared_distances(inside: &[bool], width: usize) -> Vec<f64> {
    let rows = inside.len() / width;
    let mut vertical = vec![0usize; inside.len()];
    for place in width..inside.len() {
        if inside[place] {
            vertical[place] = vertical[place - width] + 1;
        }
    }
    for place in (0..inside.len() - width).rev() {
        vertical[place] = vertical[place].min(vertical[place + width] + 1);
    }
    let mut squared = vec![0.0; inside.len()];
    for j in 0..rows {
        let row = &vertical[j * width..(j + 1) * width];
        for i in 0..width {
            let mut least = row[i] * row[i];
            // Nothing further than the best so far can be nearer.
            for step in 1..width {
                if step * step >= least {
                    break;
                }
                for k in [i.checked_sub(step), Some(i + step)].into_iter().flatten() {
                    if let Some(&up) = row.get(k) {
                        least = least.min(step * step + up * up);
                    }
                }
            }
            squared[j * width + i] = least as f64;
        }
    }
    squared
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::DeviceDefinition;
    use crate::mechanism::{Inertia, TwoLink, TwoLinkParameters};
    use rand::{Rng, SeedableRng};

    #[test]
    fn an_annulus_holds_a_circle_of_half_its_width() {
        let lengths = TwoLinkParameters { l1_m: 0.41, l2_m: 0.19, elbow: 1 };
        let arm = TwoLink::new(lengths, Inertia::default()).unwrap();
        let (least_m, most_m) = arm.reach_m();
        let raster = Raster { x_m: [-0.7, 0.7], y_m: [-0.7, 0.7], step_m: 0.01, phi_rad: 0.0 };
        let circle = largest_circle(&arm, &raster).unwrap();
        assert!((circle.radius_m - 0.5 * (most_m - least_m)).abs() < 0.01, "{circle:?}");
        let [x, y] = circle.centre_m;
        assert!((x.hypot(y) - 0.5 * (most_m + least_m)).abs() < 0.01, "{circle:?}");
    }

    #[test]
    fn distances_to_the_edge_are_those_of_brute_force() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let (width, rows) = (23, 17);
        let inside: Vec<bool> = (0..width * rows)
            .map(|k| {
                let border = k % width == 0
                    || k % width == width - 1
                    || k < width
                    || k >= width * (rows - 1);
                !border && rng.random_bool(0.9)
            })
            .collect();
        let found = squared_distances(&inside, width);
        for (a, found) in found.iter().enumerate() {
            let to = |b: usize| {
                let (dx, dy) = ((a % width).abs_diff(b % width), (a / width).abs_diff(b / width));
                (dx * dx + dy * dy) as f64
            };
            let outside = (0..inside.len()).filter(|&b| !inside[b]);
            assert_eq!(*found, outside.map(to).fold(f64::MAX, f64::min), "{a}");
        }
    }

    #[test]
    fn what_reaches_nothing_holds_no_circle() {
        let device = DeviceDefinition::load("two-link").unwrap();
        let raster = Raster { x_m: [1.0, 1.2], y_m: [1.0, 1.2], step_m: 0.1, phi_rad: 0.0 };
        assert_eq!(largest_circle(device.mechanism.as_ref(), &raster), None);
    }
}

//! Linkages that tests of several modules share: the published designs and random ones.

use rand::Rng;

use super::{FiveBar, FiveBarParameters, Inertia, Mechanism};
use crate::notation::PlaneVector;

/// Cho 2005 optimised and unoptimised (Table I), and a design with crossed tendons
/// (`devices/cho-2005-crossed.toml`).
pub(crate) const CHO: [FiveBarParameters; 3] = [
    cho([0.300, 0.200, 0.124, 0.291, 0.300], [0.781, 0.100], 1),
    cho([0.3; 5], [0.1, 0.1], 1),
    cho([0.3, 0.1763, 0.1, 0.2105, 0.3], [0.2927, 1.0], -1),
];

const fn cho(l_m: [f64; 5], [k3, k4]: [f64; 2], tendons: i32) -> FiveBarParameters {
    FiveBarParameters { l_m, k3, k4, lever: -1, tendons, elbow: 1, branch: 1 }
}

/// A random design in a random working mode, and a handle position somewhere inside its
/// reach whose three sines are at least `margin`.
pub(crate) fn random_five_bar(rng: &mut impl Rng, margin: f64) -> (FiveBar, PlaneVector) {
    loop {
        let mut sign = || if rng.random() { 1 } else { -1 };
        let [lever, tendons, elbow, branch] = [sign(), sign(), sign(), sign()];
        let parameters = FiveBarParameters {
            l_m: std::array::from_fn(|_| rng.random_range(0.05..0.5)),
            k3: rng.random_range(0.1..3.0),
            k4: rng.random_range(0.1..3.0),
            lever,
            tendons,
            elbow,
            branch,
        };
        let Ok(device) = FiveBar::new(parameters, Inertia::default()) else {
            continue;
        };
        let (least_m, most_m) = device.reach_m();
        let r_m = rng.random_range(least_m..=most_m);
        let bearing_rad = rng.random_range(-3.2..3.2_f64);
        let p_BH = PlaneVector::new(r_m * bearing_rad.cos(), r_m * bearing_rad.sin(), 0.0);
        let Ok(posture) = device.posture_at(&p_BH) else {
            continue;
        };
        let phi = device.link_angles_rad(&posture);
        let sines = [(2, 0), (3, 1), (3, 2)].map(|(a, b): (usize, usize)| (phi[a] - phi[b]).sin());
        if sines.iter().all(|sine| sine.abs() >= margin) {
            return (device, p_BH);
        }
    }
}

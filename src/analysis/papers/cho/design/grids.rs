//! GP_a and GP_f of both devices of Cho 2005 under every grid that was thought of.
//!
//! A grid is a weighting of radii (see the parent). The last one is any weighting at all.

use super::{GridRow, HISTOGRAM, TABLE_I};
use crate::analysis::design::local::ray_indices;
use crate::config::DeviceDefinition;
use crate::notation::PlaneVector;

pub(super) fn off_percent(means: [f64; 2], device: usize) -> f64 {
    let off = |i: usize| means[i] / TABLE_I[device][i] - 1.0;
    100.0 * (0.5 * (off(0) * off(0) + off(1) * off(1))).sqrt()
}

/// P_a and P_f of both designs at a radius.
#[derive(Clone, Copy, Debug)]
pub(super) struct AtRadius {
    r_m: f64,
    /// `None`: not within reach.
    of: [Option<[f64; 2]>; 2],
    /// phi1 - phi2 of both devices.
    opening_rad: [f64; 2],
}

pub(super) fn at_radius(devices: &[DeviceDefinition; 2], r_m: f64) -> AtRadius {
    let place = PlaneVector::new(r_m, 0.0, 0.0);
    let postures = [0, 1].map(|k| devices[k].mechanism.posture_at(&place).ok());
    let of = postures.map(|posture| {
        let rays = ray_indices(&posture?.reference, 4)?;
        Some([rays.P_a, rays.P_f])
    });
    let opening_rad = postures.map(|posture| {
        posture.map_or(f64::NAN, |posture| posture.shaft_rad[0] - posture.shaft_rad[1])
    });
    AtRadius { r_m, of, opening_rad }
}

/// Means under weights of radii.
fn means(places: &[(AtRadius, f64)]) -> ([[f64; 2]; 2], f64) {
    let mut sums = [[0.0; 3]; 2];
    let mut within = 0.0;
    for (place, weight) in places {
        for (sum, found) in sums.iter_mut().zip(place.of) {
            let Some([P_a, P_f]) = found else { continue };
            *sum = [sum[0] + weight * P_a, sum[1] + weight * P_f, sum[2] + weight];
        }
        if let Some([_, P_f]) = place.of[1] {
            within += weight * f64::from(u8::from((50.0..=60.0).contains(&P_f.to_degrees())));
        }
    }
    (sums.map(|[a, f, all]| [a / all, f / all]), HISTOGRAM[1] * within / sums[1][2])
}

fn row(name: String, places: &[(AtRadius, f64)]) -> GridRow {
    let (means, at_50_60) = means(places);
    GridRow { name, means, at_50_60 }
}

/// Every grid that is tried.
pub(super) fn grids(devices: &[DeviceDefinition; 2], fine: &[AtRadius]) -> Vec<GridRow> {
    let last = fine.len() - 1;
    let rim = |k: usize| if k == 0 || k == last { 0.5 } else { 1.0 };
    let powered = |power: i32| -> Vec<(AtRadius, f64)> {
        fine.iter().enumerate().map(|(k, at)| (*at, rim(k) * at.r_m.powi(power))).collect()
    };
    let circles = |count: usize| -> Vec<(AtRadius, f64)> {
        let r_m = |k: usize| 0.2 + 0.3 * k as f64 / (count - 1) as f64;
        (0..count).map(|k| (at_radius(devices, r_m(k)), 1.0)).collect()
    };
    let by_area = |from_m: f64, to_m: f64| -> Vec<(AtRadius, f64)> {
        let r_m = |k: i32| from_m + (to_m - from_m) * f64::from(k) / 400.0;
        (0..=400).map(|k| (at_radius(devices, r_m(k)), r_m(k))).collect()
    };
    let lattice = |step_m: f64| -> Vec<(AtRadius, f64)> {
        let count = (0.5 / step_m) as i32 + 1;
        let all = (0..=count).flat_map(|i| (-count..=count).map(move |j| (i, j)));
        let radii = all.map(|(i, j)| step_m * f64::from(i).hypot(f64::from(j)));
        let inside = radii.filter(|r_m| (0.2 - 1e-9..=0.5 + 1e-9).contains(r_m));
        inside.map(|r_m| (at_radius(devices, r_m), 1.0)).collect()
    };
    let half = lattice(0.01);
    let mut found = vec![
        row("area-uniform, r 0.2 to 0.5 m (weight r)".into(), &powered(1)),
        row("polar, 31 circles x 123 = 3813 places of equal weight".into(), &circles(31)),
        row("radial, every radius alike".into(), &powered(0)),
        row("polar, 41 circles x 93 = 3813".into(), &circles(41)),
        row("polar, 93 circles x 41 = 3813".into(), &circles(93)),
        row(format!("lattice of 10 mm, half annulus ({} places)", half.len()), &half),
    ];
    for (from_m, to_m) in [(0.25, 0.5), (0.3, 0.5), (0.2, 0.55), (0.3, 0.45)] {
        let name = format!("area-uniform, r {from_m} to {to_m} m");
        found.push(row(name, &by_area(from_m, to_m)));
    }
    found.push(in_joint_angles(fine));
    for power in [2, 3, 5, 8] {
        found.push(row(format!("weight r^{power}"), &powered(power)));
    }
    found
}

/// Equal steps of both base joints: each device has its own density of radii.
fn in_joint_angles(fine: &[AtRadius]) -> GridRow {
    let of_device = |k: usize| {
        let steps = fine.windows(2).map(|two| {
            let turned = two[1].opening_rad[k] - two[0].opening_rad[k];
            (two[0], turned.abs())
        });
        means(&steps.collect::<Vec<_>>())
    };
    let (before, after) = (of_device(0), of_device(1));
    GridRow {
        name: "equal steps of both base joints, r 0.2 to 0.5 m".into(),
        means: [before.0[0], after.0[1]],
        at_50_60: after.1,
    }
}

/// The weight r^n that comes nearest to one design's means.
pub(super) fn best_exponent(fine: &[AtRadius], device: usize) -> [f64; 2] {
    let off = |n: f64| {
        let weighted: Vec<_> = fine.iter().map(|at| (*at, at.r_m.powf(n))).collect();
        off_percent(means(&weighted).0[device], device)
    };
    let tried = (0..=120).map(|k| 0.1 * f64::from(k)).map(|n| [n, off(n)]);
    tried.fold([0.0, f64::INFINITY], |best, one| if one[1] < best[1] { one } else { best })
}

/// The nearest point of the convex hull of the radii to the five published numbers.
pub(super) fn any_weighting(fine: &[AtRadius]) -> (f64, [f64; 6]) {
    const STEPS: usize = 20_000;
    let aim = [TABLE_I[0][0], TABLE_I[0][1], TABLE_I[1][0], TABLE_I[1][1]];
    let share = HISTOGRAM[0] / HISTOGRAM[1];
    let points: Vec<(f64, [f64; 5])> = fine
        .iter()
        .step_by(4)
        .filter_map(|at| {
            let [before, after] = [at.of[0]?, at.of[1]?];
            let all = [before[0], before[1], after[0], after[1]];
            let within = f64::from(u8::from((50.0..=60.0).contains(&after[1].to_degrees())));
            let relative = |k: usize| if k < 4 { all[k] / aim[k] - 1.0 } else { within - share };
            Some((at.r_m, std::array::from_fn(relative)))
        })
        .collect();
    let dot = |a: &[f64; 5], b: &[f64; 5]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut weights = vec![0.0f64; points.len()];
    let Some((_, first)) = points.first() else { return (f64::NAN, [0.0; 6]) };
    weights[0] = 1.0;
    let mut at = *first;
    for _ in 0..STEPS {
        let slopes: Vec<f64> = points.iter().map(|(_, point)| dot(point, &at)).collect();
        let by = |a: &usize, b: &usize| slopes[*a].total_cmp(&slopes[*b]);
        let towards = (0..points.len()).min_by(by).unwrap_or(0);
        let away = (0..points.len()).filter(|k| weights[*k] > 0.0).max_by(by).unwrap_or(0);
        let own = dot(&at, &at);
        if own - slopes[towards] < 1e-14 {
            break;
        }
        let forward = own - slopes[towards] >= slopes[away] - own;
        let (k, sign, most) = if forward {
            (towards, 1.0, 1.0)
        } else {
            (away, -1.0, weights[away] / (1.0 - weights[away]).max(1e-12))
        };
        let way: [f64; 5] = std::array::from_fn(|i| sign * (points[k].1[i] - at[i]));
        let step = (-dot(&at, &way) / dot(&way, &way).max(1e-300)).clamp(0.0, most);
        at = std::array::from_fn(|i| at[i] + step * way[i]);
        weights.iter_mut().for_each(|weight| *weight *= 1.0 - sign * step);
        weights[k] = (weights[k] + sign * step).max(0.0);
    }
    let mut bands = [0.0; 6];
    for ((r_m, _), weight) in points.iter().zip(&weights) {
        bands[(((r_m - 0.2) / 0.05) as usize).min(5)] += weight;
    }
    (dot(&at, &at).sqrt(), bands)
}

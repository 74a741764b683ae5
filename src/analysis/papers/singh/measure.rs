//! What this run computes for the page of Singh et al.
//!
//! Centimetres where nothing is said. The search is that of [`crate::analysis::design::symmetric`];
//! this adds other grids, the conditions by brute force, and the figures that the paper's
//! sentences ask for. The middle of the workspace is that of the inscribed circle; its edge is
//! what lies within a centimetre of a leg stretched or folded.

use std::f64::consts::{PI, TAU};

use super::brute::{Brute, brute};
use crate::analysis::design::local::{ForceEllipse, ellipse};
use crate::analysis::design::symmetric::{
    Candidate, Conditions, CountGrid, Lengths, Reach, search, search_space, table_1,
};
use crate::mechanism::{Mechanism, ParameterError, SymmetricFiveBar};
use crate::notation::PlaneVector;

/// Of Table 1.
pub const OPTIMUM: Lengths = Lengths { a1: 10.0, a2: 15.0, a3: 3.0 };
const M_PER_CM: f64 = 0.01;

/// What a grid finds.
#[derive(Clone, Debug)]
pub struct Winner {
    /// The grid, in words.
    pub grid: String,
    /// Fewest places with K of 5 or more.
    pub best: Candidate,
    /// The paper's optimum there.
    pub published: Candidate,
    /// Its place in the order, from 1.
    pub rank: usize,
}

/// Condition numbers on the axis of symmetry.
#[derive(Clone, Debug)]
pub struct Axis {
    /// Height and K; `None` beyond reach.
    pub places: Vec<(f64, Option<f64>)>,
    /// K(y = 3) / K(y = 18), where both are there.
    pub ratio_3_18: Option<f64>,
    /// Height and value of the largest K / K(18) below 18.
    pub largest: [f64; 2],
    /// Heights at which the ratio is 1.5.
    pub at_1_5: Vec<f64>,
}

/// Forces per newton metre, mean over directions and in the worst one.
#[derive(Clone, Copy, Debug, Default)]
pub struct Force {
    /// Within 3 cm of the middle.
    pub middle: [f64; 2],
    /// At the edge.
    pub edge: [f64; 2],
}

/// All figures of the page.
#[derive(Clone, Debug)]
pub struct Singh {
    /// Table 1 under the stated grid, best first.
    pub found: Vec<Candidate>,
    /// Other grids.
    pub winners: Vec<Winner>,
    /// The best of Table 1 by share of the workspace, with that share in per cent.
    pub by_share: (Lengths, f64),
    /// Mean places with K >= 5 for a3 = 3, 4, 5.
    pub bases: [f64; 3],
    /// Those that the optimum meets.
    pub conditions: Conditions,
    /// Designs of Table 1 that meet (a).
    pub meeting_a: usize,
    /// Random linkages.
    pub brute: Brute,
    /// Share of places with K < 5 at 0.9 to 1.7 mean lengths, per cent: the optimum, the least and
    /// the most of Table 1.
    pub annulus: [f64; 3],
    /// Share of the places with K >= 5 that lie at the edge, per cent.
    pub at_edge: f64,
    /// Largest K of an interior place of the half-turn grid.
    pub largest_condition: f64,
    /// Radius and height of the inscribed circle, and its height by the printed formula.
    pub circle: [f64; 3],
    /// On the axis.
    pub axis: Axis,
    /// Over the workspace.
    pub force: Force,
    /// Postures for one place, places for one pair of shafts.
    pub solutions: [usize; 2],
    /// Torque of each motor for 12 N along the axis, least and most over y = 10 to 20, N m.
    pub needle_Nm: [f64; 2],
    /// Largest K over y = 10 to 20 on the axis.
    pub needle_condition: f64,
    /// K in centimetres over K in metres, largest deviation from 1.
    pub scale: f64,
}

/// Computes everything.
pub fn measure() -> Result<Singh, ParameterError> {
    let linkage = OPTIMUM.linkage(M_PER_CM)?;
    let designs = table_1();
    let found = search(&designs, &CountGrid::STATED);
    let half = CountGrid::Arcs { step: 1.0, rays: 73, span_rad: PI };
    let places = conditioned(&OPTIMUM, &half);
    let bad: Vec<_> = places.iter().filter(|(_, K)| *K >= 5.0).collect();
    let edge = bad.iter().filter(|(at, _)| edge_cm(&OPTIMUM, *at) < 1.0).count();
    let shares = designs.iter().map(|lengths| annulus_percent(lengths, &half));
    let ends = shares.fold((100.0f64, 0.0f64), |(least, most), s| (least.min(s), most.max(s)));
    let inscribed = linkage.inscribed_circle();
    let cm = |m: Option<f64>| m.map_or(f64::NAN, |m| m / M_PER_CM);
    let mean_of = |a3: f64| {
        let base = found.iter().filter(|one| one.lengths.a3 == a3);
        base.clone().map(|one| one.counts.above_5() as f64).sum::<f64>() / base.count() as f64
    };
    Ok(Singh {
        winners: winners(),
        by_share: best_by_share(&designs),
        bases: [3.0, 4.0, 5.0].map(mean_of),
        conditions: OPTIMUM.conditions(),
        meeting_a: designs.iter().filter(|lengths| lengths.conditions().a).count(),
        brute: brute(),
        annulus: [annulus_percent(&OPTIMUM, &half), ends.0, ends.1],
        at_edge: 100.0 * edge as f64 / bad.len().max(1) as f64,
        largest_condition: places.iter().map(|(_, K)| *K).fold(0.0, f64::max),
        circle: [inscribed.radius_m / M_PER_CM, cm(inscribed.y_m), cm(inscribed.y_as_printed_m)],
        axis: axis(),
        force: force(&linkage, &places, cm(inscribed.y_m)),
        solutions: solutions(&linkage),
        needle_Nm: needle(&linkage),
        needle_condition: (100..=200)
            .filter_map(|y| condition_at([0.0, 0.1 * f64::from(y)]))
            .fold(0.0, f64::max),
        scale: scale(&places),
        found,
    })
}

/// Interior places of a grid with their condition numbers.
fn conditioned(lengths: &Lengths, grid: &CountGrid) -> Vec<([f64; 2], f64)> {
    let inside = |at| match lengths.reach(at) {
        Reach::Interior { condition } => Some((at, condition)),
        _ => None,
    };
    grid.places(lengths).into_iter().filter_map(inside).collect()
}

/// The search of Table 1 on several grids.
pub fn winners() -> Vec<Winner> {
    let designs = table_1();
    let grids = [
        CountGrid::STATED,
        CountGrid::Arcs { step: 1.0, rays: 37, span_rad: PI },
        CountGrid::Arcs { step: 0.5, rays: 73, span_rad: TAU },
        CountGrid::Arcs { step: 0.5, rays: 145, span_rad: TAU },
        CountGrid::Arcs { step: 0.25, rays: 289, span_rad: TAU },
        CountGrid::Lattice { step: 0.5 },
        CountGrid::Lattice { step: 0.25 },
    ];
    let winner = |grid: CountGrid| {
        let found = search(&designs, &grid);
        let place = found.iter().position(|one| one.lengths == OPTIMUM).unwrap_or(0);
        Winner { grid: grid.to_string(), best: found[0], published: found[place], rank: place + 1 }
    };
    grids.into_iter().map(winner).collect()
}

impl Winner {
    /// Share of the interior places with K of 5 or more, per cent.
    pub fn percent(one: &Candidate) -> f64 {
        100.0 * one.counts.above_5() as f64 / one.counts.interior().max(1) as f64
    }
}

/// The best of some designs by the share of the workspace with K >= 5, on a fine grid.
pub fn best_by_share(designs: &[Lengths]) -> (Lengths, f64) {
    let found = search(designs, &CountGrid::Arcs { step: 0.5, rays: 145, span_rad: TAU });
    let best = found.iter().min_by(|a, b| Winner::percent(a).total_cmp(&Winner::percent(b)));
    best.map_or((OPTIMUM, f64::NAN), |one| (one.lengths, Winner::percent(one)))
}

/// Table 1 with half centimetres, by share.
pub fn finest_by_share() -> (Lengths, f64) {
    best_by_share(&search_space([9.0, 12.0], [11.0, 15.0], [3.0, 5.0], 0.5))
}

/// How far a place is from the border of reach: how much a leg could still stretch or fold.
fn edge_cm(lengths: &Lengths, [x, y]: [f64; 2]) -> f64 {
    let legs = [-lengths.a3, lengths.a3].map(|base| (x - base).hypot(y));
    let left = |d: f64| (lengths.a1 + lengths.a2 - d).min(d - (lengths.a1 - lengths.a2).abs());
    legs.into_iter().map(left).fold(f64::INFINITY, f64::min)
}

fn annulus_percent(lengths: &Lengths, grid: &CountGrid) -> f64 {
    let mean = (lengths.a1 + lengths.a2 + lengths.a3) / 3.0;
    let within = |at: &[f64; 2]| (0.9..=1.7).contains(&(at[0].hypot(at[1]) / mean));
    let inside = conditioned(lengths, grid).into_iter().filter(|(at, _)| within(at));
    let (good, all) =
        inside.fold((0, 0), |(good, all), (_, K)| (good + i32::from(K < 5.0), all + 1));
    100.0 * f64::from(good) / f64::from(all.max(1))
}

fn condition_at(at: [f64; 2]) -> Option<f64> {
    match OPTIMUM.reach(at) {
        Reach::Interior { condition } => Some(condition),
        _ => None,
    }
}

fn axis() -> Axis {
    let at = |y: f64| condition_at([0.0, y]);
    let at_18 = at(18.0).unwrap_or(f64::NAN);
    let ratios: Vec<[f64; 2]> = (300..1800)
        .map(|k| 0.01 * f64::from(k))
        .filter_map(|y| Some([y, at(y)? / at_18]))
        .collect();
    let largest = ratios.iter().copied().fold([0.0; 2], |a, b| if b[1] > a[1] { b } else { a });
    let crossed = ratios.windows(2).filter(|two| (two[0][1] - 1.5) * (two[1][1] - 1.5) <= 0.0);
    let heights = [3.0, 5.0, 7.0, 7.5, 8.0, 10.0, 12.0, 14.0, 16.0, 18.0, 20.0, 22.0, 24.0];
    Axis {
        places: heights.map(|y| (y, at(y))).to_vec(),
        ratio_3_18: at(3.0).map(|K| K / at_18),
        at_1_5: crossed.map(|two| two[0][0]).collect(),
        largest,
    }
}

fn ellipse_at(linkage: &SymmetricFiveBar, at: [f64; 2]) -> Option<ForceEllipse> {
    let place = PlaneVector::new(M_PER_CM * at[0], M_PER_CM * at[1], 0.0);
    Some(ellipse(&linkage.posture_at(&place).ok()?.reference, 2))
}

fn force(linkage: &SymmetricFiveBar, places: &[([f64; 2], f64)], middle: f64) -> Force {
    let over = |within: &dyn Fn([f64; 2]) -> bool| {
        let chosen = places.iter().map(|(at, _)| *at).filter(|at| within(*at));
        let mut sums = [0.0; 3];
        for found in chosen.filter_map(|at| ellipse_at(linkage, at)) {
            let [long, short] = found.semi_axes;
            // The mean radius of an ellipse by 64 directions.
            let radius = (0..64).map(|k| {
                let (sin, cos) = (TAU * f64::from(k) / 64.0).sin_cos();
                1.0 / (cos / long).hypot(sin / short)
            });
            let mean = radius.sum::<f64>() / 64.0;
            sums = [sums[0] + mean, sums[1] + short, sums[2] + 1.0];
        }
        [sums[0] / sums[2], sums[1] / sums[2]]
    };
    Force {
        middle: over(&|[x, y]| x.hypot(y - middle) < 3.0),
        edge: over(&|at| edge_cm(&OPTIMUM, at) < 1.0),
    }
}

fn solutions(linkage: &SymmetricFiveBar) -> [usize; 2] {
    let place = PlaneVector::new(0.02, 0.15, 0.0);
    let modes = linkage.working_mode().all();
    let inverse = modes
        .filter_map(|mode| linkage.in_working_mode(&mode))
        .filter(|other| other.posture_at(&place).is_ok())
        .count();
    let Ok(posture) = linkage.posture_at(&place) else { return [inverse, 0] };
    let shafts = [posture.shaft_rad[0], posture.shaft_rad[1]];
    let both = [1, -1].map(|side| linkage.forward(shafts, side));
    let mut found: Vec<PlaneVector> = both.into_iter().flatten().collect();
    found.dedup_by(|a, b| (a.xy() - b.xy()).norm() < 1e-9);
    [inverse, found.len()]
}

fn needle(linkage: &SymmetricFiveBar) -> [f64; 2] {
    let torque = |k: i32| {
        let place = PlaneVector::new(0.0, 0.1 + 1e-3 * f64::from(k), 0.0);
        let R = linkage.posture_at(&place).ok()?.reference.fixed_view::<2, 2>(0, 0).into_owned();
        Some((R.try_inverse()? * nalgebra::Vector2::new(0.0, 12.0)).amax())
    };
    let all = (0..=100).filter_map(torque);
    let (least, most) = all.fold((f64::INFINITY, 0.0f64), |(l, m), t| (l.min(t), m.max(t)));
    [least, most]
}

fn scale(places: &[([f64; 2], f64)]) -> f64 {
    let Lengths { a1, a2, a3 } = OPTIMUM;
    let small = Lengths { a1: 0.01 * a1, a2: 0.01 * a2, a3: 0.01 * a3 };
    let off = |(at, K): &([f64; 2], f64)| match small.reach([0.01 * at[0], 0.01 * at[1]]) {
        Reach::Interior { condition } if *K < 100.0 => (condition / K - 1.0).abs(),
        _ => 0.0,
    };
    places.iter().map(off).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_figures_are_those_of_another_implementation() {
        let singh = measure().unwrap();
        assert_eq!((singh.found[0].lengths, singh.found[0].counts.above_5()), (OPTIMUM, 106));
        assert_eq!(singh.winners[0].rank, 1);
        assert!(singh.winners.iter().any(|one| one.rank > 1), "the winner moves");
        assert!((singh.circle[1] - 14.70).abs() < 0.01 && (singh.circle[2] - 9.89).abs() < 0.01);
        assert!(
            (singh.needle_Nm[0] - 0.72).abs() < 0.01 && (singh.needle_Nm[1] - 0.89).abs() < 0.01
        );
        assert!((singh.needle_condition - 1.62).abs() < 0.01, "{}", singh.needle_condition);
        assert_eq!(singh.solutions, [4, 2]);
        assert!(singh.scale < 1e-9, "{}", singh.scale);
        assert_eq!(singh.axis.ratio_3_18, None);
        assert!((singh.axis.largest[1] - 1.60).abs() < 0.01, "{:?}", singh.axis);
    }
}

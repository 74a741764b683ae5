//! The conditions of Singh et al., section 3.4.3, against brute force over random linkages.
//!
//! Normalised lengths; both driven links in every direction of a grid, polished where B1 and B2
//! come near each other.

use std::f64::consts::TAU;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::analysis::design::symmetric::Lengths;

/// The conditions of section 3.4.3 against brute force over random lengths.
#[derive(Clone, Copy, Debug, Default)]
pub struct Brute {
    /// How many linkages.
    pub linkages: usize,
    /// Linkages with r3 > r1, and those of them in which B1 and B2 meet.
    pub a: [usize; 2],
    /// Linkages with r2 > r1 + r3, and those of them that can put B1, C, B2 in line.
    pub b: [usize; 2],
    /// Linkages with (b) that break (c) or (d).
    pub b_without_cd: usize,
}

pub(super) fn brute() -> Brute {
    const LINKAGES: usize = 500;
    const STEPS: i32 = 90;
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut found = Brute { linkages: LINKAGES, ..Brute::default() };
    let turns = || (0..STEPS).map(|k| TAU * f64::from(k) / f64::from(STEPS));
    for _ in 0..LINKAGES {
        let mut length = || rng.random_range(0.1..3.0);
        let lengths = Lengths { a1: length(), a2: length(), a3: length() };
        let [r1, r2, r3] = lengths.normalised();
        let met = lengths.conditions();
        let between = |[a, b]: [f64; 2]| {
            let ((s1, c1), (s2, c2)) = (a.sin_cos(), b.sin_cos());
            (r1 * (c2 - c1) + 2.0 * r3).hypot(r1 * (s2 - s1))
        };
        let (mut nearest, mut most) = ([0.0; 2], 0.0f64);
        for a in turns() {
            for b in turns() {
                most = most.max(between([a, b]));
                if between([a, b]) < between(nearest) {
                    nearest = [a, b];
                }
            }
        }
        found.a[0] += usize::from(met.a);
        found.a[1] += usize::from(met.a && polished(&between, nearest) < 1e-6);
        found.b[0] += usize::from(met.b);
        found.b[1] += usize::from(met.b && most >= 2.0 * r2);
        found.b_without_cd += usize::from(met.b && !(met.c && met.d));
    }
    found
}

/// Least value around a place of a grid: steps along the axes that halve where none helps.
fn polished(of: &dyn Fn([f64; 2]) -> f64, mut at: [f64; 2]) -> f64 {
    let mut step = 0.1;
    while step > 1e-9 {
        let around = [[step, 0.0], [-step, 0.0], [0.0, step], [0.0, -step]];
        let tried = around.map(|[a, b]| [at[0] + a, at[1] + b]);
        match tried.into_iter().find(|next| of(*next) < of(at)) {
            Some(next) => at = next,
            None => step *= 0.5,
        }
    }
    of(at)
}

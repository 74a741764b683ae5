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
    /// Linkages with (a) to (d), and those of them with a combined singularity.
    pub met: [usize; 2],
    /// The same of all others.
    pub broken: [usize; 2],
    /// Figure 4, the driven links parallel and turned together.
    pub parallel: Parallel,
}

/// The motion of Figure 4: |det A| is that of the distal links, |det B| the product of both
/// legs', each over the lengths in it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Parallel {
    /// Largest |det A| of the motion: C is free across all along where it is zero.
    pub most_direct: f64,
    /// |det B| with the driven links along the base.
    pub inverse_along_base: f64,
    /// Largest |det B| of the motion.
    pub most_inverse: f64,
}

impl Parallel {
    /// Both vanish somewhere on the way.
    pub fn combined(&self) -> bool {
        self.most_direct < VANISHED && self.inverse_along_base < VANISHED
    }
}

/// The design of the page's Figure 4: r2 = r3, which breaks (d).
pub const FIGURE_4: Lengths = Lengths { a1: 8.0, a2: 5.0, a3: 5.0 };

/// A determinant over its lengths that is zero but for rounding.
const VANISHED: f64 = 1e-9;

pub(super) fn brute() -> Brute {
    const LINKAGES: usize = 500;
    const STEPS: i32 = 90;
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut found = Brute { linkages: LINKAGES, parallel: parallel(&FIGURE_4), ..Brute::default() };
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
        let meet = polished(&between, nearest) < 1e-6;
        found.a[0] += usize::from(met.a);
        found.a[1] += usize::from(met.a && meet);
        found.b[0] += usize::from(met.b);
        found.b[1] += usize::from(met.b && most >= 2.0 * r2);
        found.b_without_cd += usize::from(met.b && !(met.c && met.d));
        let all_met = met.a && met.b && met.c && met.d;
        let side = if all_met { &mut found.met } else { &mut found.broken };
        side[0] += 1;
        // Where B1 and B2 meet, C goes round them and comes to lie along a driven link.
        side[1] += usize::from(meet || leg_and_distal_in_line([r1, r2, r3]));
    }
    found
}

/// A posture has O1, B1, C and B2 in one line: the leg and the distal links are singular
/// together. By symmetry the other leg can then, too.
fn leg_and_distal_in_line([r1, r2, r3]: [f64; 3]) -> bool {
    const STEPS: i32 = 3600;
    // Along the driven link B2 is two distal links beyond B1, or before it; it has to be r1 from
    // O2. That changes continuously with the angle.
    [r1 + 2.0 * r2, r1 - 2.0 * r2].into_iter().any(|along| {
        let off = |k: i32| {
            let (sin, cos) = (TAU * f64::from(k) / f64::from(STEPS)).sin_cos();
            (along * cos - 2.0 * r3).hypot(along * sin) - r1
        };
        let all = || (0..STEPS).map(off);
        let (least, most) = (all().fold(f64::INFINITY, f64::min), all().fold(-r1, f64::max));
        least <= VANISHED && most >= -VANISHED
    })
}

/// Both determinants while both driven links turn together by a whole turn, C between B1 and B2.
fn parallel(lengths: &Lengths) -> Parallel {
    let Lengths { a1, a2, a3 } = *lengths;
    let at = |angle_rad: f64| {
        let (sin, cos) = angle_rad.sin_cos();
        let driven = [a1 * cos, a1 * sin];
        let joints = [-a3, a3].map(|base| [base + driven[0], driven[1]]);
        // Half way between the joints, and as far across as the distal links are too long.
        let across = (a2 * a2 - a3 * a3).max(0.0).sqrt();
        let distal = joints.map(|[x, y]| [driven[0] - x, driven[1] + across - y]);
        let cross = |p: [f64; 2], q: [f64; 2]| p[0] * q[1] - p[1] * q[0];
        let direct = cross(distal[0], distal[1]).abs() / (a2 * a2);
        let legs = distal.map(|distal| (cross(driven, distal) / (a1 * a2)).abs());
        [direct, legs[0] * legs[1]]
    };
    let all = (0..360).map(|deg| at(f64::from(deg).to_radians()));
    let [most_direct, most_inverse] =
        all.fold([0.0f64; 2], |most, one| [most[0].max(one[0]), most[1].max(one[1])]);
    Parallel { most_direct, most_inverse, inverse_along_base: at(0.0)[1] }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parallel_motion_is_singular_where_the_distal_links_span_the_base_and_not_elsewhere() {
        let found = parallel(&FIGURE_4);
        assert!(found.combined() && found.most_inverse > 0.9, "{found:?}");
        let longer = parallel(&Lengths { a2: 6.0, ..FIGURE_4 });
        assert!(!longer.combined() && longer.most_direct > 0.5, "{longer:?}");
    }

    /// O1, B1, C, B2 of (8, 5, 5) lie along the base; (10, 15, 3) is far from it.
    #[test]
    fn a_leg_in_line_with_both_distal_links_is_found_where_there_is_one() {
        assert!(leg_and_distal_in_line([8.0, 5.0, 5.0]));
        assert!(!leg_and_distal_in_line([10.0, 15.0, 3.0]));
    }
}

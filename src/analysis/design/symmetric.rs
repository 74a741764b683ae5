//! The discrete search of Singh, Saha & Manivannan over symmetric five-bars, and its indices.
//!
//! ```text
//! O1 = (-a3, 0)    O2 = (a3, 0)    B_i = O_i + a1 u(theta_i)    |C - B_i| = a2
//! theta_i = bearing of C from O_i + s_i acos(.)          working mode (s1, s2) = (+1, -1)
//! J: velocity of C -> joint rates, row i = (C - B_i) / ((B_i - O_i) x (C - B_i))
//! ```
//!
//! a3 is half the base. Any unit of length: K = sigma_max / sigma_min of J has none. A place
//! is an *edge* where the cosine of a leg is within 1e-9 of +-1 (the border of reach, K
//! infinite), *interior* where both legs have more; edges are told apart because a place of a
//! round grid lies on them by rounding only. Kept beside the linkage itself, which refuses
//! near-singular postures that have to be counted here; a test compares the two.
//! Source: Singh et al., Eq 5, sections 3.4, 4.1 and 5, with r_MIC's height mended.

use std::f64::consts::PI;

use super::local::ConditionClass;
use crate::mechanism::{Inertia, ParameterError, SymmetricFiveBar, SymmetricFiveBarParameters};

/// How near to +-1 a cosine is an edge.
const EDGE: f64 = 1e-9;

/// Lengths of a symmetric five-bar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lengths {
    /// Driven links.
    pub a1: f64,
    /// Links to the handle.
    pub a2: f64,
    /// Half of the base.
    pub a3: f64,
}

/// What is at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reach {
    /// No posture.
    Beyond,
    /// The border of reach.
    Edge,
    /// A posture with this condition number.
    Interior {
        /// K.
        condition: f64,
    },
}

/// Which places a search counts, in the unit of the lengths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CountGrid {
    /// Arcs about O from |a1 - a2| to a1 + a2.
    Arcs {
        /// Between arcs.
        step: f64,
        /// Rays from 0 to `span_rad`, both ends counted.
        rays: usize,
        /// A turn, or half of it.
        span_rad: f64,
    },
    /// A lattice about O of the half-plane y >= 0.
    Lattice {
        /// Between neighbours.
        step: f64,
    },
}

/// Places of a design by what is there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Per class of condition number, interior places only.
    pub classes: [usize; 4],
    /// On the border of reach.
    pub edge: usize,
}

/// One design of a search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Its lengths.
    pub lengths: Lengths,
    /// Its places.
    pub counts: Counts,
}

/// The five conditions of section 3.4.3 on the normalised lengths; true = met.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Conditions {
    /// (a) r3 > r1: B1 and B2 never meet.
    pub a: bool,
    /// (b) r2 > r1 + r3: B1, C, B2 are never in line.
    pub b: bool,
    /// (c) r3 < r1 + r2: the whole chain is never in line.
    pub c: bool,
    /// (d) r2 != r3.
    pub d: bool,
    /// (e) r1 + r2 + r3 = 3 with 0 < r1, r2 < 3 and 0 < r3 < 1.5.
    pub e: bool,
}

impl CountGrid {
    /// The grid under which the published optimum is the minimum: arcs every 1 (cm), 73 rays
    /// over the full turn, the first of them counted twice.
    pub const STATED: Self = Self::Arcs { step: 1.0, rays: 73, span_rad: 2.0 * PI };

    /// All of its places for a design.
    pub fn places(&self, lengths: &Lengths) -> Vec<[f64; 2]> {
        let Lengths { a1, a2, a3 } = *lengths;
        let least = (a1 - a2).abs();
        let steps = |length: f64, step: f64| (length / step + 1e-9).floor() as usize;
        match *self {
            Self::Arcs { step, rays, span_rad } => {
                let arcs = steps(a1 + a2 - least, step);
                let on_arc = move |k: usize| {
                    let r = least + step * k as f64;
                    (0..rays).map(move |ray| {
                        let angle = span_rad * ray as f64 / (rays.max(2) - 1) as f64;
                        [r * angle.cos(), r * angle.sin()]
                    })
                };
                (0..=arcs).flat_map(on_arc).collect()
            }
            Self::Lattice { step } => {
                let (far, high) =
                    (steps(a1 + a2 + a3, step) as i32 + 1, steps(a1 + a2, step) as i32 + 1);
                let row = move |j: i32| {
                    (-far..=far).map(move |i| [step * f64::from(i), step * f64::from(j)])
                };
                (0..=high).flat_map(row).collect()
            }
        }
    }
}

impl std::fmt::Display for CountGrid {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Arcs { step, rays, span_rad } => write!(
                f,
                "arcs about O every {step} cm from |a1 - a2| to a1 + a2, {rays} rays over 0 to \
                 {:.0} deg",
                span_rad.to_degrees()
            ),
            Self::Lattice { step } => write!(f, "lattice of {step} cm about O, y >= 0"),
        }
    }
}

impl Counts {
    /// Interior places.
    pub fn interior(&self) -> usize {
        self.classes.iter().sum()
    }

    /// The paper's measure: interior places with K of 5 or more.
    pub fn above_5(&self) -> usize {
        self.interior() - self.classes[0]
    }
}

impl Lengths {
    /// What the handle finds at a place, in the working mode (+1, -1).
    pub fn reach(&self, at: [f64; 2]) -> Reach {
        let Some(rows) = self.rows(at) else { return Reach::Beyond };
        let [Some(first), Some(second)] = rows else { return Reach::Edge };
        Reach::Interior { condition: condition([first, second]) }
    }

    /// Rows of J: `None` beyond reach, an empty row for a leg at its border.
    fn rows(&self, [x, y]: [f64; 2]) -> Option<[Option<[f64; 2]>; 2]> {
        let mut rows = [None; 2];
        for (row, (base, sign)) in rows.iter_mut().zip([(-self.a3, 1.0), (self.a3, -1.0)]) {
            let (dx, distance) = (x - base, (x - base).hypot(y));
            let cosine = (self.a1 * self.a1 + distance * distance - self.a2 * self.a2)
                / (2.0 * self.a1 * distance);
            let within = cosine.abs() <= 1.0 + EDGE;
            if !within {
                return None;
            }
            if cosine.abs() < 1.0 - EDGE {
                let theta = y.atan2(dx) + sign * cosine.acos();
                let link = [self.a1 * theta.cos(), self.a1 * theta.sin()];
                let far = [dx - link[0], y - link[1]];
                let area = link[0] * far[1] - link[1] * far[0];
                *row = Some([far[0] / area, far[1] / area]);
            }
        }
        Some(rows)
    }

    /// J at an interior place.
    pub fn jacobian(&self, at: [f64; 2]) -> Option<[[f64; 2]; 2]> {
        let [first, second] = self.rows(at)?;
        Some([first?, second?])
    }

    /// Places of a grid by class.
    pub fn count(&self, grid: &CountGrid) -> Counts {
        let mut counts = Counts::default();
        for at in grid.places(self) {
            match self.reach(at) {
                Reach::Beyond => {}
                Reach::Edge => counts.edge += 1,
                Reach::Interior { condition } => {
                    counts.classes[ConditionClass::of(condition) as usize] += 1;
                }
            }
        }
        counts
    }

    /// Radius of the largest circle on the axis; its place is the linkage's to say.
    pub fn inscribed_radius(&self) -> f64 {
        self.a1.min(self.a2)
    }

    /// The linkage of these lengths in the paper's working mode.
    pub fn linkage(&self, m_per_unit: f64) -> Result<SymmetricFiveBar, ParameterError> {
        let [a1_m, a2_m, a3_m] = [self.a1, self.a2, self.a3].map(|length| length * m_per_unit);
        let modes = SymmetricFiveBarParameters { a1_m, a2_m, a3_m, s1: 1, s2: -1, assembly: 1 };
        SymmetricFiveBar::new(modes, Inertia::default())
    }

    /// r1, r2, r3: lengths over their mean.
    pub fn normalised(&self) -> [f64; 3] {
        let mean = (self.a1 + self.a2 + self.a3) / 3.0;
        [self.a1 / mean, self.a2 / mean, self.a3 / mean]
    }

    /// Which of the paper's conditions hold.
    pub fn conditions(&self) -> Conditions {
        let [r1, r2, r3] = self.normalised();
        let between = |r: f64, most: f64| r > 0.0 && r < most;
        let sum = (r1 + r2 + r3 - 3.0).abs() < 1e-12;
        Conditions {
            a: r3 > r1,
            b: r2 > r1 + r3,
            c: r3 < r1 + r2,
            d: r2 != r3,
            e: sum && between(r1, 3.0) && between(r2, 3.0) && between(r3, 1.5),
        }
    }
}

/// sigma_max / sigma_min of a 2x2 matrix.
fn condition([a, b]: [[f64; 2]; 2]) -> f64 {
    let squares: f64 = a.iter().chain(&b).map(|entry| entry * entry).sum();
    let det = (a[0] * b[1] - a[1] * b[0]).abs();
    // sigma1 +- sigma2 from sigma1^2 + sigma2^2 and sigma1 sigma2.
    let (sum, difference) = ((squares + 2.0 * det).sqrt(), (squares - 2.0 * det).max(0.0).sqrt());
    let largest = 0.5 * (sum + difference);
    if det > 0.0 { largest * largest / det } else { f64::INFINITY }
}

/// The designs of Table 1, in the order a1, a2, a3: a1 9-12, a2 11-15, a3 3-5 cm by 1 cm.
pub fn table_1() -> Vec<Lengths> {
    search_space([9.0, 12.0], [11.0, 15.0], [3.0, 5.0], 1.0)
}

/// Every design of a box of lengths, by equal steps.
pub fn search_space(a1: [f64; 2], a2: [f64; 2], a3: [f64; 2], step: f64) -> Vec<Lengths> {
    let values = |[from, to]: [f64; 2]| {
        let count = ((to - from) / step + 1e-9).floor() as usize;
        (0..=count).map(move |k| from + step * k as f64)
    };
    let mut all = Vec::new();
    for a1 in values(a1) {
        for a2 in values(a2) {
            all.extend(values(a3).map(|a3| Lengths { a1, a2, a3 }));
        }
    }
    all
}

/// Counts every design; the best, with the fewest places of K >= 5, first; of equals the one
/// with the larger inscribed circle, as the paper chooses.
pub fn search(designs: &[Lengths], grid: &CountGrid) -> Vec<Candidate> {
    let counted = |&lengths: &Lengths| Candidate { lengths, counts: lengths.count(grid) };
    let mut found: Vec<Candidate> = designs.iter().map(counted).collect();
    found.sort_by(|a, b| {
        let circle = |c: &Candidate| c.lengths.inscribed_radius();
        (a.counts.above_5().cmp(&b.counts.above_5())).then(circle(b).total_cmp(&circle(a)))
    });
    found
}

#[cfg(test)]
mod tests {
    use super::super::local::LocalIndices;
    use super::*;
    use crate::mechanism::Mechanism;
    use crate::notation::{ActuatorVector, PlaneVector};

    const OPTIMUM: Lengths = Lengths { a1: 10.0, a2: 15.0, a3: 3.0 };

    #[test]
    fn the_published_optimum_is_the_minimum_of_the_stated_grid() {
        let found = search(&table_1(), &CountGrid::STATED);
        assert_eq!(found.len(), 60);
        assert_eq!((found[0].lengths, found[0].counts.above_5()), (OPTIMUM, 106));
        let mut second: Vec<_> = found[1..4]
            .iter()
            .map(|c| ([c.lengths.a1, c.lengths.a2, c.lengths.a3], c.counts.above_5()))
            .collect();
        second.sort_by(|a, b| a.0[0].total_cmp(&b.0[0]));
        let expected =
            [([9.0, 14.0, 3.0], 108), ([10.0, 14.0, 3.0], 108), ([11.0, 15.0, 3.0], 108)];
        assert_eq!(second, expected);
        assert!(found[4].counts.above_5() > 108);
    }

    #[test]
    fn joint_rates_are_those_of_finite_differences() {
        let theta = |[x, y]: [f64; 2]| {
            let leg = |base: f64, sign: f64| {
                let d = (x - base).hypot(y);
                y.atan2(x - base) + sign * ((100.0 + d * d - 225.0) / (20.0 * d)).acos()
            };
            [leg(-3.0, 1.0), leg(3.0, -1.0)]
        };
        for at in [[0.0, 12.0], [4.0, 9.0], [-5.0, 15.0], [2.0, -14.0]] {
            let J = OPTIMUM.jacobian(at).unwrap();
            for axis in 0..2 {
                let mut ahead = at;
                let mut behind = at;
                ahead[axis] += 1e-5;
                behind[axis] -= 1e-5;
                for (leg, row) in J.iter().enumerate() {
                    let rate = (theta(ahead)[leg] - theta(behind)[leg]) / 2e-5;
                    assert!((rate - row[axis]).abs() < 1e-8, "{at:?} {leg} {axis}");
                }
            }
        }
    }

    #[test]
    fn condition_numbers_of_known_matrices() {
        assert_eq!(condition([[3.0, 0.0], [0.0, 0.5]]), 6.0);
        assert_eq!(condition([[1.0, 2.0], [2.0, 4.0]]), f64::INFINITY);
        assert!((condition([[1.0, -1.0], [1.0, 1.0]]) - 1.0).abs() < 1e-7);
    }

    #[test]
    fn the_linkage_itself_has_the_same_condition_numbers() {
        let linkage = OPTIMUM.linkage(0.01).unwrap();
        let mut compared = 0;
        for at in CountGrid::STATED.places(&OPTIMUM) {
            let place = PlaneVector::new(0.01 * at[0], 0.01 * at[1], 0.0);
            let Ok(posture) = linkage.posture_at(&place) else { continue };
            let found = LocalIndices::of(&linkage, &ActuatorVector::repeat(1.0), &posture);
            let Reach::Interior { condition } = OPTIMUM.reach(at) else { continue };
            assert!((found.condition / condition - 1.0).abs() < 1e-6, "{at:?} {condition}");
            compared += 1;
        }
        assert!(compared > 1000, "{compared}");
    }

    #[test]
    fn the_optimum_breaks_its_own_first_condition() {
        let met = OPTIMUM.conditions();
        assert!(!met.a && met.b && met.c && met.d && met.e, "{met:?}");
        let all_break_it = table_1().iter().all(|lengths| !lengths.conditions().a);
        assert!(all_break_it, "the whole of Table 1 has r3 < r1");
    }

    #[test]
    fn the_handle_reaches_no_place_three_above_the_base() {
        assert_eq!(OPTIMUM.reach([0.0, 3.0]), Reach::Beyond);
        let K = |y: f64| match OPTIMUM.reach([0.0, y]) {
            Reach::Interior { condition } => condition,
            other => panic!("{y}: {other:?}"),
        };
        // The ratio of 1.5 is passed twice, with 1.60 at most between.
        let ratio = |y: f64| K(y) / K(18.0);
        let found = [5.0, 7.5, 10.0, 12.0].map(ratio);
        let expected = [1.35, 1.60, 1.50, 1.34];
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 6e-3), "{found:?}");
    }

    #[test]
    fn places_on_the_border_are_told_apart() {
        assert_eq!(OPTIMUM.reach([22.0, 0.0]), Reach::Edge); // 25 from O1
        assert!(matches!(OPTIMUM.reach([21.99, 0.0]), Reach::Interior { .. }));
        assert_eq!(OPTIMUM.reach([22.01, 0.0]), Reach::Beyond);
        assert_eq!(OPTIMUM.reach([f64::NAN, 0.0]), Reach::Beyond);
    }
}

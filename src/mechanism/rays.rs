//! The rays of a plane device: 2n directions that its n actuators can pull or push along.
//!
//! Ray i+ is column i of the reference matrix, i- its opposite. In counter-clockwise order
//! from ray 1+ the angles between neighbours are the betas of Cho 2005: small ones mean that
//! any force lies near a ray. P_a = sum beta^2, P_f = max beta, over all 2n (Cho's eight).
//! Rays in line give beta = 0. Magnitudes play no part, nor does the third freedom.
//! Source: Cho 2005, Eq 4 and 16 (rays), 6 (P_a), 8 (P_f).

use std::{cmp::Ordering, f64::consts::PI, fmt};

use crate::notation::{MAX_ACTUATORS, ReferenceMatrix};

/// Most rays a device can have.
pub const MAX_RAYS: usize = 2 * MAX_ACTUATORS;

/// One actuator, one way round.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ray {
    /// Counted from zero.
    pub actuator: usize,
    /// True for the force of positive torque.
    pub positive: bool,
}

impl Ray {
    fn opposite(self) -> Self {
        Self { positive: !self.positive, ..self }
    }
}

impl fmt::Display for Ray {
    /// As in the papers: "1+" is positive torque of the first actuator.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}", self.actuator + 1, if self.positive { '+' } else { '-' })
    }
}

/// All rays of a posture in order. Fixed size, no allocation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rays {
    count: usize,
    order: [Ray; MAX_RAYS],
    beta_rad: [f64; MAX_RAYS],
}

impl Rays {
    /// Sorts the first `actuators` columns of the reference matrix. `None` when there is none
    /// or more than [`MAX_ACTUATORS`], or when a column has no direction in the plane.
    pub fn of(reference: &ReferenceMatrix, actuators: usize) -> Option<Self> {
        let mut half = [(0.0, Ray::default()); MAX_ACTUATORS];
        let half = half.get_mut(..actuators).filter(|half| !half.is_empty())?;
        let first_rad = angle_of(reference, 0)?;
        for (actuator, slot) in half.iter_mut().enumerate() {
            *slot = in_first_half(angle_of(reference, actuator)? - first_rad, actuator);
        }
        half.sort_unstable_by(by_angle);
        Some(Self::around(half))
    }

    /// The rays counter-clockwise from ray 1+.
    pub fn order(&self) -> &[Ray] {
        &self.order[..self.count]
    }

    /// Angle from each ray of [`Rays::order`] to the next, radians; they sum to a full turn.
    pub fn betas_rad(&self) -> &[f64] {
        &self.beta_rad[..self.count]
    }

    /// Sum of the squares of all betas, rad^2; at least 2 pi^2 / n, when all are equal.
    pub fn P_a(&self) -> f64 {
        self.betas_rad().iter().map(|beta| beta * beta).sum()
    }

    /// Largest beta, rad; at least pi / n.
    pub fn P_f(&self) -> f64 {
        self.betas_rad().iter().fold(0.0, |largest, &beta| largest.max(beta))
    }

    /// The half turn twice: opposite rays follow each other in the same order.
    fn around(half: &[(f64, Ray)]) -> Self {
        let n = half.len();
        let mut rays =
            Self { count: 2 * n, order: [Ray::default(); MAX_RAYS], beta_rad: [0.0; MAX_RAYS] };
        for (i, &(angle_rad, ray)) in half.iter().enumerate() {
            let next_rad = half.get(i + 1).map_or(PI, |next| next.0);
            for (slot, ray) in [(i, ray), (i + n, ray.opposite())] {
                rays.order[slot] = ray;
                rays.beta_rad[slot] = next_rad - angle_rad;
            }
        }
        rays
    }
}

/// Direction of a column in the plane, unless it is zero or not a number.
fn angle_of(reference: &ReferenceMatrix, actuator: usize) -> Option<f64> {
    let (x, y) = (reference[(0, actuator)], reference[(1, actuator)]);
    let directed = x.is_finite() && y.is_finite() && (x != 0.0 || y != 0.0);
    directed.then(|| y.atan2(x))
}

/// Of the two rays of an actuator the one within half a turn counter-clockwise of ray 1+;
/// an angle that rounding brings to exactly pi stays there, as the last. Adding zero turns
/// -0 into 0: they would be told apart in sorting.
fn in_first_half(from_first_rad: f64, actuator: usize) -> (f64, Ray) {
    let turn_rad = from_first_rad.rem_euclid(2.0 * PI) + 0.0;
    if turn_rad < PI {
        (turn_rad, Ray { actuator, positive: true })
    } else {
        ((turn_rad - PI).min(PI), Ray { actuator, positive: false })
    }
}

/// By angle, then by actuator, so that rays in line keep their order and 1+ stays first.
fn by_angle(a: &(f64, Ray), b: &(f64, Ray)) -> Ordering {
    a.0.total_cmp(&b.0).then(a.1.actuator.cmp(&b.1.actuator))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mechanism::{FiveBar, FiveBarParameters, Inertia, Mechanism, fixtures};
    use crate::notation::PlaneVector;
    use proptest::{num::f64::ANY, prelude::*};

    fn five_bar_rays(parameters: FiveBarParameters, r_m: f64) -> Rays {
        let device = FiveBar::new(parameters, Inertia::default()).expect("valid parameters");
        let posture = device.posture_at(&PlaneVector::new(r_m, 0.0, 0.0)).expect("reachable");
        Rays::of(&posture.reference, device.actuators()).expect("rays")
    }

    /// Smallest and largest beta over the paper's workspace, degrees.
    fn extremes_deg(parameters: FiveBarParameters) -> (f64, f64) {
        (0..=30).fold((f64::INFINITY, 0.0), |(least, most), step| {
            let rays = five_bar_rays(parameters, 0.2 + 0.01 * f64::from(step));
            let betas_deg = || rays.betas_rad().iter().map(|beta| beta.to_degrees());
            (betas_deg().fold(least, f64::min), betas_deg().fold(most, f64::max))
        })
    }

    #[test]
    fn the_betas_of_both_published_designs_have_the_published_extremes() {
        let [optimised, unoptimised, _] = fixtures::CHO;
        let (least, most) = extremes_deg(unoptimised);
        assert!((least - 3.999).abs() < 5e-4 && (most - 112.885).abs() < 5e-4, "{least} {most}");
        let (least, most) = extremes_deg(optimised);
        assert!((least - 21.20).abs() < 5e-3 && (most - 79.65).abs() < 5e-3, "{least} {most}");
    }

    #[test]
    fn the_largest_beta_of_the_optimised_device_follows_the_known_curve() {
        let known_deg = [79.7, 66.9, 56.9, 48.4, 53.5, 60.2, 62.7];
        for (i, known_deg) in known_deg.into_iter().enumerate() {
            let rays = five_bar_rays(fixtures::CHO[0], 0.2 + 0.05 * i as f64);
            assert!((rays.P_f().to_degrees() - known_deg).abs() < 0.05);
        }
    }

    #[test]
    fn equal_links_have_the_betas_of_the_closed_form() {
        for k in [0.1, 0.4, 0.8] {
            for r_m in [0.2, 0.33, 0.5] {
                let psi = 2.0 * f64::acos(r_m / 0.6);
                let a = f64::atan((psi / 2.0).tan() / (2.0 / k - 1.0));
                let mut expected = [PI - psi, psi / 2.0 - a, 2.0 * a, psi / 2.0 - a];
                expected.sort_by(f64::total_cmp);
                let parameters = FiveBarParameters { k3: k, k4: k, ..fixtures::CHO[1] };
                let rays = five_bar_rays(parameters, r_m);
                let mut betas = [0.0; 4];
                betas.copy_from_slice(&rays.betas_rad()[..4]);
                betas.sort_by(f64::total_cmp);
                for (beta, expected) in betas.into_iter().zip(expected) {
                    assert!((beta - expected).abs() < 1e-12, "k {k}, r {r_m}: {beta} {expected}");
                }
            }
        }
    }

    #[test]
    fn rays_in_line_are_no_angle_apart_and_keep_their_order() {
        let mut reference = ReferenceMatrix::zeros();
        for (i, (x, y)) in [(1.0, 1.0), (3.0, 3.0), (-2.0, -2.0), (0.0, 1.0)].iter().enumerate() {
            reference[(0, i)] = *x;
            reference[(1, i)] = *y;
        }
        let rays = Rays::of(&reference, 4).expect("rays");
        let names: Vec<_> = rays.order().iter().map(Ray::to_string).collect();
        assert_eq!(names, ["1+", "2+", "3-", "4+", "1-", "2-", "3+", "4-"]);
        assert_eq!(rays.betas_rad()[..2], [0.0, 0.0]);
        assert!((rays.P_f() - 0.75 * PI).abs() < 1e-15);
    }

    #[test]
    fn columns_without_a_direction_give_no_rays() {
        let mut reference = ReferenceMatrix::identity();
        assert_eq!(Rays::of(&reference, 0), None);
        assert_eq!(Rays::of(&reference, 7), None);
        assert_eq!(Rays::of(&reference, 3), None);
        reference[(0, 1)] = f64::NAN;
        assert_eq!(Rays::of(&reference, 2), None);
    }

    proptest! {
        #[test]
        fn betas_go_once_around_whatever_the_columns(
            entries in proptest::array::uniform12(ANY), actuators in 1..=MAX_ACTUATORS,
        ) {
            let mut reference = ReferenceMatrix::zeros();
            for (i, x) in entries.into_iter().enumerate() {
                reference[(i % 2, i / 2)] = x;
            }
            if let Some(rays) = Rays::of(&reference, actuators) {
                prop_assert_eq!(rays.order()[0], Ray { actuator: 0, positive: true });
                prop_assert!(rays.betas_rad().iter().all(|&beta| beta >= 0.0));
                prop_assert!((rays.betas_rad().iter().sum::<f64>() - 2.0 * PI).abs() < 1e-12);
                prop_assert!(rays.P_f() >= PI / actuators as f64 - 1e-12);
                prop_assert!(rays.P_a() >= 2.0 * PI * PI / actuators as f64 - 1e-12);
            }
        }
    }
}

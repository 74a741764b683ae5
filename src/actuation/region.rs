//! Regions of a desired force and the papers' gamma (Cho 2005, section 3.1).
//!
//! A region judges *direction* only; that torques are limited shows elsewhere. The rays that
//! count are the reference forces that the bounds allow now, `+R_i` where a positive torque
//! is possible and `-R_i` where a negative one is.

use serde::{Deserialize, Serialize};

use super::{Bounds, Capability, nearest_in_box};
use crate::notation::{ActuatorVector, MAX_ACTUATORS, PlaneVector};

/// Two directions closer than this are the same.
const SAME_RAD: f64 = 1e-12;

/// How much of a desired direction can be given.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Region {
    /// All of it: it lies between available reference forces.
    Full,
    /// Its nearest available neighbour.
    Approximate,
    /// It would need energy from brakes (`F . v > 0`), or nothing available helps.
    NotDisplayable,
}

impl Region {
    /// Every region, for tables and metrics.
    pub const ALL: [Self; 3] = [Self::Full, Self::Approximate, Self::NotDisplayable];

    /// The name used in metrics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Full => "full",
            Self::Approximate => "approximate",
            Self::NotDisplayable => "not_displayable",
        }
    }
}

/// A region with its angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Classification {
    /// The region.
    pub region: Region,
    /// Angle from the desired force to the nearest available one: zero when `Full`, `None`
    /// when nothing is available or the request is not displayable.
    pub gamma_rad: Option<f64>,
}

/// Region of `desired` for a handle moving with `velocity`; `None` at rest or when nothing
/// is desired.
pub fn classify(
    capability: &Capability,
    desired: &PlaneVector,
    velocity: &PlaneVector,
) -> Option<Classification> {
    if velocity.norm() == 0.0 || desired.norm() == 0.0 || !desired.iter().all(|f| f.is_finite()) {
        return None;
    }
    let not_displayable = Classification { region: Region::NotDisplayable, gamma_rad: None };
    if capability.is_passive() && desired.dot(velocity) > 0.0 {
        return Some(not_displayable);
    }
    let gamma_rad = if capability.freedoms == 2 {
        Bracket::around(capability, desired).map(|bracket| bracket.gamma_rad())
    } else {
        nearest_direction_rad(capability, desired)
    };
    Some(match gamma_rad {
        None => not_displayable,
        Some(gamma) if gamma <= SAME_RAD => {
            Classification { region: Region::Full, gamma_rad: Some(0.0) }
        }
        gamma_rad => Classification { region: Region::Approximate, gamma_rad },
    })
}

/// Angle between two wrenches, radians in [0, pi]; `None` where one has no direction.
pub fn approximation_angle(desired: &PlaneVector, given: &PlaneVector) -> Option<f64> {
    let (a, b) = (desired.norm(), given.norm());
    if !(a > 0.0 && b > 0.0 && a.is_finite() && b.is_finite()) {
        return None;
    }
    let (a, b) = (desired / a, given / b);
    // Kahan's form: exact near 0 and pi, where acos is not.
    Some(2.0 * (a - b).norm().atan2((a + b).norm()))
}

/// An available reference force next to a desired one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbour {
    /// Which actuator.
    pub actuator: usize,
    /// The sign of its torque.
    pub sign: f64,
    /// Angle from the desired force, in [0, 2 pi).
    pub angle_rad: f64,
}

/// The available reference forces on both sides of a desired force in the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bracket {
    /// The first one counter-clockwise.
    pub left: Neighbour,
    /// The first one clockwise.
    pub right: Neighbour,
}

impl Bracket {
    /// The neighbours of `desired`; `None` when nothing is available.
    pub fn around(capability: &Capability, desired: &PlaneVector) -> Option<Self> {
        let mut bracket: Option<Self> = None;
        available(capability, |actuator, sign, [x, y]| {
            let cross = desired.x * y - desired.y * x;
            let left_rad = turn(cross.atan2(desired.x * x + desired.y * y));
            let right_rad = turn(-left_rad);
            let near = |angle_rad| Neighbour { actuator, sign, angle_rad };
            let known =
                bracket.get_or_insert(Self { left: near(left_rad), right: near(right_rad) });
            if left_rad < known.left.angle_rad {
                known.left = near(left_rad);
            }
            if right_rad < known.right.angle_rad {
                known.right = near(right_rad);
            }
        });
        bracket
    }

    /// True when the desired force is a sum of the two with coefficients not negative.
    pub fn encloses(&self) -> bool {
        self.left.angle_rad + self.right.angle_rad < std::f64::consts::PI - SAME_RAD
            || self.nearest().angle_rad <= SAME_RAD
    }

    /// The nearer of the two.
    pub fn nearest(&self) -> Neighbour {
        if self.left.angle_rad <= self.right.angle_rad { self.left } else { self.right }
    }

    /// The papers' gamma: zero inside, else the angle to the nearer neighbour.
    pub fn gamma_rad(&self) -> f64 {
        if self.encloses() { 0.0 } else { self.nearest().angle_rad }
    }
}

/// Tells the reference forces that the bounds allow now: whose, which sign, x and y.
pub(super) fn available(capability: &Capability, mut tell: impl FnMut(usize, f64, [f64; 2])) {
    for actuator in 0..capability.actuators.min(MAX_ACTUATORS) {
        let ray = capability.reference.column(actuator);
        for (sign, possible) in [
            (1.0, capability.bounds.upper_Nm[actuator] > 0.0),
            (-1.0, capability.bounds.lower_Nm[actuator] < 0.0),
        ] {
            if possible && ray.x.hypot(ray.y) > 0.0 {
                tell(actuator, sign, [sign * ray.x, sign * ray.y]);
            }
        }
    }
}

/// An angle in [0, 2 pi).
pub(super) fn turn(angle_rad: f64) -> f64 {
    let turned = angle_rad.rem_euclid(std::f64::consts::TAU);
    if turned >= std::f64::consts::TAU - SAME_RAD { 0.0 } else { turned }
}

/// With three freedoms: the nearest direction of the cone, by least squares without limits.
fn nearest_direction_rad(capability: &Capability, desired: &PlaneVector) -> Option<f64> {
    const UNLIMITED: f64 = 1e9;
    let open = |bound: f64| {
        if bound == 0.0 { 0.0 } else { bound.signum() * UNLIMITED }
    };
    let Bounds { lower_Nm, upper_Nm } = capability.bounds;
    let mut matrix = capability.reference;
    matrix.row_mut(2).scale_mut(1.0 / capability.moment_length_m);
    let mut direction = *desired;
    direction.z /= capability.moment_length_m;
    direction /= direction.norm();
    let torque: ActuatorVector = nearest_in_box(
        &matrix,
        &direction,
        &lower_Nm.map(open),
        &upper_Nm.map(open),
        capability.actuators,
    );
    let given = matrix * torque;
    if (given - direction).norm() < 1e-9 {
        return Some(0.0);
    }
    approximation_angle(&direction, &given)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actuation::{ActuatorKind, ShaftMotion};
    use crate::notation::ReferenceMatrix;

    /// Two brakes along x and y, both turning backward: +x and +y are available.
    fn corner() -> Capability {
        let mut reference = ReferenceMatrix::zeros();
        reference[(0, 0)] = 2.0;
        reference[(1, 1)] = 5.0;
        let kinds = [ActuatorKind::Brake; MAX_ACTUATORS];
        let motion = [ShaftMotion::Backward; MAX_ACTUATORS];
        let bounds = Bounds::given(&kinds, &ActuatorVector::repeat(1.0), &motion);
        Capability { reference, freedoms: 2, actuators: 2, kinds, bounds, moment_length_m: 1.0 }
    }

    fn region_of(x: f64, y: f64) -> Option<Classification> {
        classify(&corner(), &PlaneVector::new(x, y, 0.0), &PlaneVector::new(-0.1, -0.1, 0.0))
    }

    #[test]
    fn directions_between_the_rays_are_full_whatever_their_size() {
        for (x, y) in [(1.0, 1.0), (1e6, 1e-3), (1.0, 0.0), (0.0, 3.0)] {
            let found = region_of(x, y).unwrap();
            assert_eq!((found.region, found.gamma_rad), (Region::Full, Some(0.0)), "{x} {y}");
        }
    }

    #[test]
    fn beside_the_rays_it_is_approximate_by_the_angle_to_the_nearest() {
        let found = region_of(1.0, -0.5).unwrap();
        assert_eq!(found.region, Region::Approximate);
        assert!((found.gamma_rad.unwrap() - 0.5f64.atan()).abs() < 1e-12);
    }

    #[test]
    fn along_the_motion_it_is_not_displayable() {
        let found = region_of(-1.0, -0.5).unwrap();
        assert_eq!((found.region, found.gamma_rad), (Region::NotDisplayable, None));
    }

    #[test]
    fn at_rest_or_without_a_wish_there_is_no_region() {
        assert!(region_of(0.0, 0.0).is_none());
        assert!(classify(&corner(), &PlaneVector::x(), &PlaneVector::zeros()).is_none());
    }

    #[test]
    fn the_angle_between_forces_is_exact_near_zero_and_pi() {
        let x = PlaneVector::x();
        let tilted = PlaneVector::new(1.0, 1e-9, 0.0);
        assert!((approximation_angle(&x, &tilted).unwrap() - 1e-9).abs() < 1e-15);
        assert!((approximation_angle(&x, &-x).unwrap() - std::f64::consts::PI).abs() < 1e-12);
        assert_eq!(approximation_angle(&x, &PlaneVector::zeros()), None);
    }
}

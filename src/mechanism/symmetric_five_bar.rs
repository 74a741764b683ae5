//! `symmetric-five-bar`: the five-bar on two ground pivots of Singh, Saha & Manivannan.
//!
//! ```text
//! O1 = (-a3, 0)    O2 = (a3, 0)              a3 is *half* the base; origin of B between them
//! B_i = O_i + a1 u(theta_i)                  the driven links; theta_i are the two shafts
//! C = B_1 + a2 u(chi_1) = B_2 + a2 u(chi_2)  the handle; its phi is told as chi_1
//! ```
//!
//! A *working mode* is a pair of elbow signs: s_i = +1 where link i lies counter-clockwise of
//! the line from O_i to the handle. An *assembly* is the side of C: +1 where C lies
//! counter-clockwise of the line from B_1 to B_2. Two shafts define a posture up to its
//! assembly, and no shaft is redundant: closure is always zero. A posture is regular where
//! |sin| of both elbows and of the angle B_1 C B_2 have [`super::LEAST_MARGIN`]. Collisions of
//! links are not modelled. Source: Singh et al., Eq 1-5 (forward kinematics by circles, for
//! Eq 3-4 divide by zero where B_1 and B_2 are level) and section 5 (inscribed circle).

use nalgebra::{Matrix2, Vector2};
use std::f64::consts::PI;
use std::sync::Arc;

use super::{
    Inertia, KinematicsError, Mechanism, Outline, ParameterError, Posture, WorkingMode,
    geometry::{
        arm_angles, arm_rates, bearing, cross, direction, finite_point, lean, require_margin,
        swing, usable_angles, wrap,
    },
    inertia::LinkMotion,
    kind::{Form, Key, Kind, shared},
    parameters::{LENGTH_M, require_range, require_sign},
};
use crate::notation::{ActuatorVector, PlaneVector, ReferenceMatrix};

#[cfg(test)]
mod tests;

/// A symmetric five-bar in a device file.
pub(super) const KIND: Kind = Kind {
    name: "symmetric-five-bar",
    keys: &[
        Key { name: "a1_m", form: Form::Number(LENGTH_M) },
        Key { name: "a2_m", form: Form::Number(LENGTH_M) },
        Key { name: "a3_m", form: Form::Number(LENGTH_M) },
        Key { name: "s1", form: Form::Sign(1) },
        Key { name: "s2", form: Form::Sign(-1) },
        Key { name: "assembly", form: Form::Sign(1) },
    ],
    build: |described| {
        let parameters = SymmetricFiveBarParameters {
            a1_m: described.number("a1_m"),
            a2_m: described.number("a2_m"),
            a3_m: described.number("a3_m"),
            s1: described.sign("s1"),
            s2: described.sign("s2"),
            assembly: described.sign("assembly"),
        };
        Ok(shared(SymmetricFiveBar::new(parameters, described.inertia()?)?))
    },
};

/// What a symmetric five-bar is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SymmetricFiveBarParameters {
    /// The driven links, 0.001 to 10 m.
    pub a1_m: f64,
    /// The distal links, 0.001 to 10 m.
    pub a2_m: f64,
    /// Half the distance between the pivots, 0.001 to 10 m, less than a1 + a2.
    pub a3_m: f64,
    /// Elbow of the leg on O1; +1 in the paper's working mode.
    pub s1: i32,
    /// Elbow of the leg on O2; -1 in the paper's working mode.
    pub s2: i32,
    /// Side of C that shafts are read with where both sides are in the working mode.
    pub assembly: i32,
}

/// The Jacobians of a posture: `J_p v = J_theta theta'` (Eq 5 before it is solved).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SymmetricFiveBarJacobians {
    /// Rows C - B_i, m.
    pub J_p: Matrix2<f64>,
    /// Diagonal of J_theta, m^2.
    pub J_theta: Vector2<f64>,
    /// `J_theta^-1 J_p`: handle velocity to shaft rates, rad/m. `F = J^T tau`, so `R = J^T`.
    pub J: Matrix2<f64>,
}

/// The largest circle about a point of the symmetry axis between the bounds of the workspace.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InscribedCircle {
    /// Its radius, m.
    pub radius_m: f64,
    /// Its centre on the y axis, m; `None`: the pivots are too far apart for one.
    pub y_m: Option<f64>,
    /// The centre as the paper prints it, m: too near by a third in the paper's optimum.
    pub y_as_printed_m: Option<f64>,
}

/// A symmetric five-bar in one working mode.
#[derive(Clone, Copy, Debug)]
pub struct SymmetricFiveBar {
    /// (a1, a2)
    leg_m: [f64; 2],
    a3_m: f64,
    elbows: [f64; 2],
    assembly: f64,
    inertia: Inertia<4>,
}

/// Absolute angles (driven, distal) of both legs.
type LegAngles = [[f64; 2]; 2];

impl SymmetricFiveBar {
    /// Checks the parameters. `inertia.links` are the driven links on O1 and O2, then the
    /// distal ones on B1 and B2, whose centres are measured towards the handle.
    #[expect(clippy::disallowed_methods, reason = "parameters are checked before the first tick")]
    pub fn new(
        parameters: SymmetricFiveBarParameters,
        inertia: Inertia<4>,
    ) -> Result<Self, ParameterError> {
        let SymmetricFiveBarParameters { a1_m, a2_m, a3_m, s1, s2, assembly } = parameters;
        for (field, length_m) in [("a1_m", a1_m), ("a2_m", a2_m), ("a3_m", a3_m)] {
            require_range(field, length_m, &LENGTH_M)?;
        }
        if a3_m >= a1_m + a2_m {
            let (field, most) = ("a3_m".to_owned(), a1_m + a2_m);
            return Err(ParameterError::CannotClose { field, value: a3_m, most });
        }
        inertia.check()?;
        Ok(Self {
            leg_m: [a1_m, a2_m],
            a3_m,
            elbows: [require_sign("s1", s1)?, require_sign("s2", s2)?],
            assembly: require_sign("assembly", assembly)?,
            inertia,
        })
    }

    /// Position of the handle from the shafts and the side of C, any number by its sign.
    /// Singular only where the distal links are in line.
    pub fn forward(
        &self,
        theta_rad: [f64; 2],
        assembly: i32,
    ) -> Result<PlaneVector, KinematicsError> {
        let theta_rad = usable_angles::<2>(&theta_rad)?;
        let [plus, minus] = self.assemblies(theta_rad.into())?;
        let legs = if assembly >= 0 { plus } else { minus };
        require_margin(&[(legs[1][1] - legs[0][1]).sin()])?;
        Ok(self.handle(legs.map(|leg| leg.map(direction))))
    }

    /// The side of C in a posture, as [`SymmetricFiveBar::forward`] wants it.
    pub fn assembly(&self, posture: &Posture) -> i32 {
        let [BC_1_m, BC_2_m] = self.distal_m(posture);
        if cross(BC_1_m, BC_2_m) >= 0.0 { 1 } else { -1 }
    }

    /// The Jacobians of a posture of this device, for analysis.
    pub fn jacobians(&self, posture: &Posture) -> SymmetricFiveBarJacobians {
        let distal_m = self.distal_m(posture);
        let driven_m = |i: usize| self.leg_m[0] * direction(posture.shaft_rad[i]);
        let J_p = Matrix2::from_rows(&distal_m.map(|BC_m| BC_m.transpose()));
        let J_theta = Vector2::from_fn(|i, _| cross(driven_m(i), distal_m[i]));
        let J = Matrix2::from_fn(|i, j| J_p[(i, j)] / J_theta[i]);
        SymmetricFiveBarJacobians { J_p, J_theta, J }
    }

    /// The inscribed circle of section 5. It touches |a1 - a2| and a1 + a2 about both pivots,
    /// so its centre is max(a1, a2) from each.
    pub fn inscribed_circle(&self) -> InscribedCircle {
        let [a1, a2] = self.leg_m;
        let height = |hypotenuse: f64, base: f64| {
            let squared = (hypotenuse - base) * (hypotenuse + base);
            (squared >= 0.0).then(|| squared.sqrt())
        };
        InscribedCircle {
            radius_m: a1.min(a2),
            y_m: height(a1.max(a2), self.a3_m),
            y_as_printed_m: height(a1.min(a2), 0.5 * self.a3_m),
        }
    }

    /// O_1 or O_2.
    fn pivot_m(&self, leg: usize) -> Vector2<f64> {
        Vector2::new(if leg == 0 { -self.a3_m } else { self.a3_m }, 0.0)
    }

    /// C - B_1 and C - B_2 in a posture.
    fn distal_m(&self, posture: &Posture) -> [Vector2<f64>; 2] {
        [0, 1].map(|i| {
            let driven_m = self.leg_m[0] * direction(posture.shaft_rad[i]);
            posture.p_BH.xy() - self.pivot_m(i) - driven_m
        })
    }

    /// Both ways to close the loop: C counter-clockwise of the line from B_1 to B_2, and
    /// clockwise.
    fn assemblies(&self, theta: [f64; 2]) -> Result<[LegAngles; 2], KinematicsError> {
        let [a1, a2] = self.leg_m;
        let [B_1_m, B_2_m] = [0, 1].map(|i| self.pivot_m(i) + a1 * direction(theta[i]));
        let line_m = B_2_m - B_1_m;
        let at_B = lean(a2, a2, line_m.x.hypot(line_m.y))?;
        let line = bearing(line_m);
        Ok([1.0, -1.0].map(|side| {
            [[theta[0], wrap(line + side * at_B)], [theta[1], wrap(line + PI - side * at_B)]]
        }))
    }

    /// How many of the legs bend as the working mode says.
    fn in_mode(&self, legs: LegAngles) -> usize {
        let bends = |(leg, elbow): (&[f64; 2], &f64)| elbow * (leg[1] - leg[0]).sin() <= 0.0;
        legs.iter().zip(&self.elbows).filter(|&one| bends(one)).count()
    }

    fn handle(&self, u: [[Vector2<f64>; 2]; 2]) -> PlaneVector {
        let [a1, a2] = self.leg_m;
        let p_m = self.pivot_m(0) + a1 * u[0][0] + a2 * u[0][1];
        PlaneVector::new(p_m.x, p_m.y, bearing(u[0][1]))
    }

    fn posture(&self, legs: LegAngles) -> Result<Posture, KinematicsError> {
        let u = legs.map(|leg| leg.map(direction));
        let margin = require_margin(&[
            cross(u[0][0], u[0][1]),
            cross(u[1][0], u[1][1]),
            cross(u[0][1], u[1][1]),
        ])?;
        let w = u.map(|along| arm_rates(self.leg_m, along));
        let mut reference = ReferenceMatrix::zeros();
        for (i, [driven, _]) in w.iter().enumerate() {
            reference.fixed_view_mut::<2, 1>(0, i).copy_from(driven);
        }
        let driven = |i: usize| LinkMotion::at_base(u[i][0], w[i][0]);
        let distal = |i: usize| LinkMotion {
            joint: swing(self.leg_m[0], u[i][0], w[i][0]),
            along: u[i][1],
            rate_per_m: w[i][1],
        };
        let motions = [driven(0), driven(1), distal(0), distal(1)];
        let mut shaft_rad = ActuatorVector::zeros();
        (shaft_rad[0], shaft_rad[1]) = (legs[0][0], legs[1][0]);
        Ok(Posture {
            p_BH: self.handle(u),
            shaft_rad,
            reference,
            inertia: self.inertia.at_handle(&motions, &reference),
            closure_rad: ActuatorVector::zeros(),
            margin,
        })
    }
}

impl Mechanism for SymmetricFiveBar {
    fn name(&self) -> &'static str {
        KIND.name
    }

    fn freedoms(&self) -> usize {
        2
    }

    fn actuators(&self) -> usize {
        2
    }

    fn posture_at(&self, p_BH: &PlaneVector) -> Result<Posture, KinematicsError> {
        let p_m = finite_point(p_BH)?;
        let leg = |i: usize| arm_angles(p_m - self.pivot_m(i), self.leg_m, self.elbows[i]);
        self.posture([leg(0)?, leg(1)?])
    }

    /// Of the two sides of C the one in the working mode; where both are, or neither is, the
    /// one that the parameter `assembly` says.
    fn posture_from_shafts(&self, shaft_rad: &ActuatorVector) -> Result<Posture, KinematicsError> {
        let theta_rad = usable_angles::<2>(shaft_rad.as_slice())?;
        let [plus, minus] = self.assemblies(theta_rad.into())?;
        let [first, second] = if self.assembly > 0.0 { [plus, minus] } else { [minus, plus] };
        self.posture(if self.in_mode(first) >= self.in_mode(second) { first } else { second })
    }

    fn outline(&self, posture: &Posture, out: &mut Outline) -> usize {
        let P_m = [posture.p_BH.x, posture.p_BH.y];
        for i in [0, 1] {
            let O_m = self.pivot_m(i);
            let B_m = (O_m + self.leg_m[0] * direction(posture.shaft_rad[i])).into();
            out[i] = (O_m.into(), B_m);
            out[2 + i] = (B_m, P_m);
        }
        4
    }

    /// The widest ring about O that lies wholly within the reach of both legs: at distance r
    /// from O a pivot is between |r - a3| and r + a3 away. Where there is no such ring, the distances that can be reached on the symmetry axis.
    fn reach_m(&self) -> (f64, f64) {
        let ([a1, a2], a3) = (self.leg_m, self.a3_m);
        let (hole_m, span_m) = ((a1 - a2).abs(), a1 + a2);
        let ring_m = (hole_m + a3, span_m - a3);
        let disc_m = (0.0, (a3 - hole_m).min(span_m - a3));
        let widest = if ring_m.1 - ring_m.0 >= disc_m.1 { ring_m } else { disc_m };
        if widest.1 > widest.0 {
            return widest;
        }
        let on_axis_m = |leg_m: f64| (leg_m * leg_m - a3 * a3).max(0.0).sqrt();
        (on_axis_m(hole_m), on_axis_m(span_m))
    }

    fn inertia_varies(&self) -> bool {
        self.inertia.varies()
    }

    fn working_mode(&self) -> WorkingMode {
        WorkingMode::of(&self.elbows.map(|sign| sign as i32))
    }

    fn in_working_mode(&self, mode: &WorkingMode) -> Option<Arc<dyn Mechanism>> {
        Some(shared(Self { elbows: mode.signs()?.map(f64::from), ..*self }))
    }
}

//! `five-bar`: the coaxial five-bar of Cho, Song & Kim 2005 with its four tendon-driven brakes.
//!
//! ```text
//! E = l1 u(phi1)                C = l2 u(phi2)                O = origin of B
//! D = E + s l3 u(phi3) = C + l4 u(phi4)        s: the lever, -1 points away from the handle
//! P = E + l5 u(phi3)                           link 5 is one body with link 3
//! theta3 = phi3 - phi1,  theta4 = phi4 - phi2           in (-pi, pi]
//! thB1 = phi1,  thB2 = phi2,  thB3 = theta3 / k3 + c phi1,  thB4 = theta4 / k4 + c phi2
//! ```
//!
//! All four brakes sit at the base; their angles thB are the shafts (c: tendons, +1 straight,
//! -1 crossed). Shafts 1 and 2 define a posture up to the side of D; shafts 3 and 4 choose it,
//! and what they disagree by is the closure. A posture is regular where |sin| of theta3, of
//! theta4 and of phi4 - phi3 (the angle at D) all have [`super::LEAST_MARGIN`]; det J is
//! l1 l5 l2 sin theta3 sin theta4 / (s l3 sin(phi4 - phi3)). Stops, collisions of
//! links and slack tendons are not modelled.
//! Source: Cho 2005, Eq 10-16; closing of the loop and rates derived here.

use nalgebra::{Matrix2, Matrix4x2, RowVector2, Vector2, Vector4};
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
    parameters::{LENGTH_M, RATIO, require_closable, require_range, require_sign},
};
use crate::notation::{ActuatorVector, PlaneVector, ReferenceMatrix};

#[cfg(test)]
mod tests;

/// A coaxial five-bar in a device file.
pub(super) const KIND: Kind = Kind {
    name: "five-bar",
    keys: &[
        Key { name: "l_m", form: Form::Numbers(5, LENGTH_M) },
        Key { name: "k3", form: Form::Number(RATIO) },
        Key { name: "k4", form: Form::Number(RATIO) },
        Key { name: "lever", form: Form::Sign(-1) },
        Key { name: "tendons", form: Form::Word("straight", "crossed") },
        Key { name: "elbow", form: Form::Sign(1) },
        Key { name: "branch", form: Form::Sign(1) },
    ],
    build: |described| {
        let parameters = FiveBarParameters {
            l_m: described.numbers("l_m"),
            k3: described.number("k3"),
            k4: described.number("k4"),
            lever: described.sign("lever"),
            tendons: described.sign("tendons"),
            elbow: described.sign("elbow"),
            branch: described.sign("branch"),
        };
        Ok(shared(FiveBar::new(parameters, described.inertia()?)?))
    },
};

/// What a coaxial five-bar is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FiveBarParameters {
    /// l1 to l5, each 0.001 to 10 m.
    pub l_m: [f64; 5],
    /// theta3 per angle of brake 3 with the base joint at rest, 0.001 to 100.
    pub k3: f64,
    /// theta4 per angle of brake 4 with the base joint at rest, 0.001 to 100.
    pub k4: f64,
    /// s: +1 where the lever l3 points at the handle, -1 away from it (the paper's).
    pub lever: i32,
    /// c: +1 straight tendons (the paper's), -1 crossed ones.
    pub tendons: i32,
    /// e: +1 where link 1 is counter-clockwise of the handle (the paper's), -1 clockwise.
    pub elbow: i32,
    /// b: +1 where link 2 lies on the same side of O-D as link 1 of O-P (the paper's), -1 other.
    pub branch: i32,
}

/// The Jacobians of a posture by the joint angles (theta1, theta2), all in radians and metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FiveBarJacobians {
    /// dP, 2x2.
    pub J: Matrix2<f64>,
    /// d(theta1..theta4), 4x2.
    pub JG: Matrix4x2<f64>,
    /// d(thB1..thB4), 4x2: `R = J^-T JB^T`.
    pub JB: Matrix4x2<f64>,
}

/// A coaxial five-bar in one working mode.
#[derive(Clone, Copy, Debug)]
pub struct FiveBar {
    l_m: [f64; 5],
    /// (k3, k4)
    ratios: [f64; 2],
    lever: f64,
    tendons: f64,
    elbow: f64,
    branch: f64,
    inertia: Inertia<4>,
}

/// Absolute angles of links 1 to 4.
type LinkAngles = [f64; 4];

impl FiveBar {
    /// Checks the parameters. `inertia.links` are link 1 and link 2 (about the base), the body
    /// of links 3 and 5 (about E, its centre measured towards the handle), link 4 (about C).
    #[expect(clippy::disallowed_macros, reason = "parameters are checked before the first tick")]
    pub fn new(parameters: FiveBarParameters, inertia: Inertia<4>) -> Result<Self, ParameterError> {
        let FiveBarParameters { l_m, k3, k4, lever, tendons, elbow, branch } = parameters;
        for (i, &length_m) in l_m.iter().enumerate() {
            require_range(format!("l_m[{i}]"), length_m, &LENGTH_M)?;
        }
        require_closable(&l_m, &[0, 1, 2, 3])?;
        require_range("k3", k3, &RATIO)?;
        require_range("k4", k4, &RATIO)?;
        inertia.check()?;
        Ok(Self {
            l_m,
            ratios: [k3, k4],
            lever: require_sign("lever", lever)?,
            tendons: require_sign("tendons", tendons)?,
            elbow: require_sign("elbow", elbow)?,
            branch: require_sign("branch", branch)?,
            inertia,
        })
    }

    /// Pose of the handle from the first two link angles and the side of D: `assembly` is the
    /// sign of cross(C - E, D - E), and any number counts by its sign. Singular only where
    /// lever and link 4 are in line; the arm itself may be stretched.
    pub fn forward(
        &self,
        phi1_rad: f64,
        phi2_rad: f64,
        assembly: i32,
    ) -> Result<PlaneVector, KinematicsError> {
        let base_rad = usable_angles::<2>(&[phi1_rad, phi2_rad])?;
        let [plus, minus] = self.assemblies(base_rad.into())?;
        let phi = if assembly >= 0 { plus } else { minus };
        require_margin(&[(phi[3] - phi[2]).sin()])?;
        Ok(self.handle(phi, [direction(phi[0]), direction(phi[2])]))
    }

    /// phi1 to phi4 of a posture of this device, in (-pi, pi].
    pub fn link_angles_rad(&self, posture: &Posture) -> [f64; 4] {
        let [phi1, phi2, phi3] = [posture.shaft_rad[0], posture.shaft_rad[1], posture.p_BH.z];
        let [_, _, C_m, D_m] = self.joints([phi1, phi2, phi3]);
        [wrap(phi1), wrap(phi2), phi3, bearing(D_m - C_m)]
    }

    /// The side of D in a posture, as [`FiveBar::forward`] wants it.
    pub fn assembly(&self, posture: &Posture) -> i32 {
        let phi3 = posture.p_BH.z;
        let [_, E_m, C_m, D_m] = self.joints([posture.shaft_rad[0], posture.shaft_rad[1], phi3]);
        if cross(C_m - E_m, D_m - E_m) >= 0.0 { 1 } else { -1 }
    }

    /// The Jacobians of a posture of this device, for analysis: a tick needs only R, which
    /// [`Posture`] has from the inverse path, without dividing by the sine at D.
    pub fn jacobians(&self, posture: &Posture) -> FiveBarJacobians {
        let [l1, l2, l3, l4, l5] = self.l_m;
        let phi = self.link_angles_rad(posture);
        let sin = |to: usize, from: usize| (phi[to - 1] - phi[from - 1]).sin();
        let phi3_rates =
            RowVector2::new(-l1 * sin(4, 1), l2 * sin(4, 2)) / (self.lever * l3 * sin(4, 3));
        let phi4_rates = RowVector2::new(-l1 * sin(3, 1), l2 * sin(3, 2)) / (l4 * sin(4, 3));
        let (first, second) = (RowVector2::new(1.0, 0.0), RowVector2::new(0.0, 1.0));
        let mut J = swing(l5, direction(phi[2]), phi3_rates.transpose());
        J += swing(l1, direction(phi[0]), first.transpose());
        let (theta3, theta4) = (phi3_rates - first, phi4_rates - second);
        let brake3 = theta3 / self.ratios[0] + self.tendons * first;
        let brake4 = theta4 / self.ratios[1] + self.tendons * second;
        FiveBarJacobians {
            J,
            JG: Matrix4x2::from_rows(&[first, second, theta3, theta4]),
            JB: Matrix4x2::from_rows(&[first, second, brake3, brake4]),
        }
    }

    /// O, E, C, D for phi1, phi2, phi3, metres.
    fn joints(&self, [phi1, phi2, phi3]: [f64; 3]) -> [Vector2<f64>; 4] {
        let [l1, l2, l3, _, _] = self.l_m;
        let E_m = l1 * direction(phi1);
        let D_m = E_m + self.lever * l3 * direction(phi3);
        [Vector2::zeros(), E_m, l2 * direction(phi2), D_m]
    }

    /// Both ways to close the loop: D counter-clockwise of the line from E to C, and clockwise.
    fn assemblies(&self, [phi1, phi2]: [f64; 2]) -> Result<[LinkAngles; 2], KinematicsError> {
        let [l1, l2, l3, l4, _] = self.l_m;
        let EC_m = l2 * direction(phi2) - l1 * direction(phi1);
        let distance_m = EC_m.x.hypot(EC_m.y);
        let at_E = lean(l3, l4, distance_m)?;
        let at_C = lean(l4, l3, distance_m)?;
        let (line, reversed) = (bearing(EC_m), if self.lever > 0.0 { 0.0 } else { PI });
        Ok([1.0, -1.0].map(|side| {
            [phi1, phi2, wrap(line + side * at_E + reversed), wrap(line + PI - side * at_C)]
        }))
    }

    /// Given minus computed angle of shafts 3 and 4; a whole turn of a link is the same link.
    fn closure(&self, given: &Vector4<f64>, phi: LinkAngles) -> Vector2<f64> {
        Vector2::from_fn(|i, _| {
            let theta = self.ratios[i] * (given[i + 2] - self.tendons * given[i]);
            wrap(theta - (phi[i + 2] - phi[i])) / self.ratios[i]
        })
    }

    fn shafts(&self, phi: LinkAngles) -> ActuatorVector {
        let driven = |i: usize| wrap(phi[i + 2] - phi[i]) / self.ratios[i] + self.tendons * phi[i];
        ActuatorVector::from_column_slice(&[phi[0], phi[1], driven(0), driven(1), 0.0, 0.0])
    }

    fn handle(&self, phi: LinkAngles, [u1, u3]: [Vector2<f64>; 2]) -> PlaneVector {
        let p_m = self.l_m[0] * u1 + self.l_m[4] * u3;
        PlaneVector::new(p_m.x, p_m.y, wrap(phi[2]))
    }

    /// Rates of the four links per unit handle velocity, rad/m: the arm 1-5 carries the
    /// handle, its lever carries D, and D carries the arm 2-4.
    fn link_rates(&self, u: [Vector2<f64>; 4]) -> [Vector2<f64>; 4] {
        let [l1, l2, l3, l4, l5] = self.l_m;
        let [w1, w3] = arm_rates([l1, l5], [u[0], u[2]]);
        let D = swing(l1, u[0], w1) + swing(self.lever * l3, u[2], w3);
        let [w2, w4] = arm_rates([l2, l4], [u[1], u[3]]).map(|per_D| D.tr_mul(&per_D));
        [w1, w2, w3, w4]
    }

    /// Column i of R is the rate of shaft i per unit handle velocity, by duality.
    fn reference(&self, w: [Vector2<f64>; 4]) -> ReferenceMatrix {
        let driven = |i: usize| (w[i + 2] - w[i]) / self.ratios[i] + self.tendons * w[i];
        let mut reference = ReferenceMatrix::zeros();
        for (i, column) in [w[0], w[1], driven(0), driven(1)].iter().enumerate() {
            reference.fixed_view_mut::<2, 1>(0, i).copy_from(column);
        }
        reference
    }

    fn posture(&self, phi: LinkAngles) -> Result<Posture, KinematicsError> {
        let u = phi.map(direction);
        let margin = require_margin(&[cross(u[0], u[2]), cross(u[1], u[3]), cross(u[2], u[3])])?;
        let w = self.link_rates(u);
        let reference = self.reference(w);
        let link = |joint, i: usize| LinkMotion { joint, along: u[i], rate_per_m: w[i] };
        let motions = [
            LinkMotion::at_base(u[0], w[0]),
            LinkMotion::at_base(u[1], w[1]),
            link(swing(self.l_m[0], u[0], w[0]), 2),
            link(swing(self.l_m[1], u[1], w[1]), 3),
        ];
        Ok(Posture {
            p_BH: self.handle(phi, [u[0], u[2]]),
            shaft_rad: self.shafts(phi),
            reference,
            inertia: self.inertia.at_handle(&motions, &reference),
            closure_rad: ActuatorVector::zeros(),
            margin,
        })
    }
}

impl Mechanism for FiveBar {
    fn name(&self) -> &'static str {
        KIND.name
    }

    fn freedoms(&self) -> usize {
        2
    }

    fn actuators(&self) -> usize {
        4
    }

    fn posture_at(&self, p_BH: &PlaneVector) -> Result<Posture, KinematicsError> {
        let [l1, l2, l3, l4, l5] = self.l_m;
        let [phi1, phi3] = arm_angles(finite_point(p_BH)?, [l1, l5], self.elbow)?;
        let D_m = l1 * direction(phi1) + self.lever * l3 * direction(phi3);
        let [phi2, phi4] = arm_angles(D_m, [l2, l4], self.elbow * self.branch)?;
        self.posture([phi1, phi2, phi3, phi4])
    }

    fn posture_from_shafts(&self, shaft_rad: &ActuatorVector) -> Result<Posture, KinematicsError> {
        let given = usable_angles::<4>(shaft_rad.as_slice())?;
        let [plus, minus] = self.assemblies([given[0], given[1]])?;
        let (closure_plus, closure_minus) =
            (self.closure(&given, plus), self.closure(&given, minus));
        let (phi, closure) = if closure_plus.norm_squared() <= closure_minus.norm_squared() {
            (plus, closure_plus)
        } else {
            (minus, closure_minus)
        };
        let mut posture = self.posture(phi)?;
        posture.closure_rad.fixed_rows_mut::<2>(2).copy_from(&closure);
        posture.shaft_rad.fixed_rows_mut::<4>(0).copy_from(&given);
        posture.shaft_rad -= posture.closure_rad;
        Ok(posture)
    }

    fn outline(&self, posture: &Posture, out: &mut Outline) -> usize {
        let [phi1, phi2, phi3] = [posture.shaft_rad[0], posture.shaft_rad[1], posture.p_BH.z];
        let [O_m, E_m, C_m, D_m] = self.joints([phi1, phi2, phi3]).map(Into::into);
        let P_m = [posture.p_BH.x, posture.p_BH.y];
        let segments = [(O_m, E_m), (E_m, P_m), (E_m, D_m), (O_m, C_m), (C_m, D_m)];
        out[..segments.len()].copy_from_slice(&segments);
        segments.len()
    }

    /// D must stay where links 2 and 4 reach it, which bounds theta3, which bounds |P|.
    fn reach_m(&self) -> (f64, f64) {
        let [l1, l2, l3, l4, l5] = self.l_m;
        let cosine_at = |OD_m: f64| {
            let cosine = (OD_m * OD_m - l1 * l1 - l3 * l3) / (2.0 * l1 * l3);
            self.lever * cosine.clamp(-1.0, 1.0)
        };
        let handle_m =
            |OD_m: f64| (l1 * l1 + l5 * l5 + 2.0 * l1 * l5 * cosine_at(OD_m)).max(0.0).sqrt();
        let (a_m, b_m) = (handle_m((l2 - l4).abs()), handle_m(l2 + l4));
        (a_m.min(b_m), a_m.max(b_m))
    }

    fn inertia_varies(&self) -> bool {
        self.inertia.varies()
    }

    /// Elbow and branch.
    fn working_mode(&self) -> WorkingMode {
        WorkingMode::of(&[self.elbow as i32, self.branch as i32])
    }

    fn in_working_mode(&self, mode: &WorkingMode) -> Option<Arc<dyn Mechanism>> {
        let [elbow, branch] = mode.signs()?.map(f64::from);
        Some(shared(Self { elbow, branch, ..*self }))
    }
}

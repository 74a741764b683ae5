//! `three-rrr`: the redundant planar 3-RRR of Kim, Chung, Yi & Suh 2003, six motors for x, y, phi.
//!
//! ```text
//! b_i = -R u(psi_i)                              bases, psi = 30, 150, 270 deg
//! e_i = b_i + l1 u(t_i1)                         elbows
//! c_i = e_i + l2 u(t_i1 + t_i2) = p - l3 u(phi + psi_i)      the plate's joints
//! ```
//!
//! The origin of B is the *centre of the base circle*; the paper has it at base 1, which is
//! (-R sqrt3 / 2, -R / 2) here. p is the centre of the plate and H. Shafts, in order: t11 t12
//! t21 t22 t31 t32, the odd ones at the base, the even ones floating in the elbows and measured
//! against link 1. Three freedoms, six shafts: a posture from shafts fits the plate to its
//! three joints (least squares: centre on the mean, turn by Procrustes), and every shaft's
//! closure is what it was given minus what the fitted plate needs. A posture is regular where
//! |sin t_i2| has [`super::LEAST_MARGIN`] in every chain: with six shafts nothing else is
//! singular. Collisions of links are not modelled.
//! Source: Kim 2003, Eq 2-9. Eq 2 is misprinted (its three plate joints coincide); the offsets
//! psi mend it. Fit, reach and rates derived here.

use nalgebra::{Matrix2x3, Vector2, Vector3};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_6, PI};

use super::{
    Inertia, KinematicsError, Mechanism, Outline, ParameterError, Posture, WorkingMode,
    geometry::{
        arm_angles, arm_rates, cross, direction, finite_point, require_margin, swing, turned,
        usable_angles, wrap,
    },
    inertia::LinkMotion,
    kind::{Form, Key, Kind, shared},
    parameters::{LENGTH_M, require_range, require_sign},
};
use crate::notation::{ActuatorVector, PlaneVector, ReferenceMatrix};
use crate::units::Range;

mod jacobians;
#[cfg(test)]
mod tests;

pub use jacobians::ThreeRrrJacobians;

/// Where the chains stand around the base, and their joints around the plate.
pub const PSI_RAD: [f64; 3] = [FRAC_PI_6, 5.0 * FRAC_PI_6, 3.0 * FRAC_PI_2];

/// Turn of the plate to either side.
const TURN_RAD: Range = Range::new(0.01, PI, "rad");

/// A 3-RRR in a device file.
pub(super) const KIND: Kind = Kind {
    name: "three-rrr",
    keys: &[
        Key { name: "base_m", form: Form::Number(LENGTH_M) },
        Key { name: "l_m", form: Form::Numbers(3, LENGTH_M) },
        Key { name: "turn_rad", form: Form::Usually(0.5, TURN_RAD) },
        Key { name: "elbow1", form: Form::Sign(1) },
        Key { name: "elbow2", form: Form::Sign(1) },
        Key { name: "elbow3", form: Form::Sign(1) },
    ],
    build: |described| {
        let parameters = ThreeRrrParameters {
            base_m: described.number("base_m"),
            l_m: described.numbers("l_m"),
            turn_rad: described.number("turn_rad"),
            elbows: ["elbow1", "elbow2", "elbow3"].map(|key| described.sign(key)),
        };
        Ok(shared(ThreeRrr::new(parameters, described.inertia()?)?))
    },
};

/// What a 3-RRR is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThreeRrrParameters {
    /// R: radius of the circle that the bases stand on, 0.001 to 10 m.
    pub base_m: f64,
    /// l1, l2 of every chain and l3, the radius of the plate, each 0.001 to 10 m.
    pub l_m: [f64; 3],
    /// The plate is meant to turn this far to either side of phi = 0, 0.01 to pi rad.
    pub turn_rad: f64,
    /// Sign of t2 of each chain.
    pub elbows: [i32; 3],
}

/// A 3-RRR in one working mode.
#[derive(Clone, Copy, Debug)]
pub struct ThreeRrr {
    parameters: ThreeRrrParameters,
    reach_m: (f64, f64),
    inertia: Inertia<6>,
}

/// Absolute angles of the two links of every chain.
type ChainAngles = [[f64; 2]; 3];

impl ThreeRrr {
    /// Checks the parameters. `inertia.links` are links 1 (about the base) and 2 (about the
    /// elbow) of chain 1, then of chains 2 and 3; the handle's mass and moment of inertia are
    /// the plate's.
    #[expect(clippy::disallowed_macros, reason = "parameters are checked before the first tick")]
    #[expect(clippy::disallowed_methods, reason = "parameters are checked before the first tick")]
    pub fn new(
        parameters: ThreeRrrParameters,
        inertia: Inertia<6>,
    ) -> Result<Self, ParameterError> {
        require_range("base_m", parameters.base_m, &LENGTH_M)?;
        for (i, &length_m) in parameters.l_m.iter().enumerate() {
            require_range(format!("l_m[{i}]"), length_m, &LENGTH_M)?;
        }
        require_range("turn_rad", parameters.turn_rad, &TURN_RAD)?;
        for (field, sign) in ["elbow1", "elbow2", "elbow3"].into_iter().zip(parameters.elbows) {
            require_sign(field, sign)?;
        }
        inertia.check()?;
        let reach_m = reach(&parameters).ok_or_else(|| ParameterError::NoWorkspace {
            field: "turn_rad".to_owned(),
            value: parameters.turn_rad,
        })?;
        Ok(Self { parameters, reach_m, inertia })
    }

    /// t_i1, t_i2, t_i3 of every chain in a posture, in (-pi, pi]; t_i3 turns the plate
    /// against link 2, so the three add up to phi + psi_i.
    pub fn joint_angles_rad(&self, posture: &Posture) -> [[f64; 3]; 3] {
        [0, 1, 2].map(|i| {
            let [t1, t2] = [posture.shaft_rad[2 * i], posture.shaft_rad[2 * i + 1]];
            [wrap(t1), wrap(t2), wrap(posture.p_BH.z + PSI_RAD[i] - t1 - t2)]
        })
    }

    fn base_m(&self, chain: usize) -> Vector2<f64> {
        -self.parameters.base_m * direction(PSI_RAD[chain])
    }

    /// c_i of a pose of the plate.
    fn plate_joint_m(&self, p_m: Vector2<f64>, phi_rad: f64, chain: usize) -> Vector2<f64> {
        p_m - self.parameters.l_m[2] * direction(phi_rad + PSI_RAD[chain])
    }

    /// The links that carry the plate at a pose, each elbow bent by the sign of its t2.
    fn chains(
        &self,
        p_m: Vector2<f64>,
        phi_rad: f64,
        elbows: [f64; 3],
    ) -> Result<ChainAngles, KinematicsError> {
        let [l1, l2, _] = self.parameters.l_m;
        let mut chains = ChainAngles::default();
        for (i, links) in chains.iter_mut().enumerate() {
            let span_m = self.plate_joint_m(p_m, phi_rad, i) - self.base_m(i);
            // Bent by a positive t2, link 1 lies clockwise of the line that it spans.
            *links = arm_angles(span_m, [l1, l2], -elbows[i])?;
        }
        Ok(chains)
    }

    /// The pose of the plate whose joints are nearest to `joints_m`.
    fn fitted(&self, joints_m: [Vector2<f64>; 3]) -> Result<(Vector2<f64>, f64), KinematicsError> {
        let l3 = self.parameters.l_m[2];
        let p_m = joints_m.iter().sum::<Vector2<f64>>() / 3.0;
        let (mut sine, mut cosine) = (0.0, 0.0);
        for (joint_m, psi) in joints_m.iter().zip(PSI_RAD) {
            let (at_rest, now) = (-direction(psi), (joint_m - p_m) / l3);
            sine += cross(at_rest, now) / 3.0;
            cosine += at_rest.dot(&now) / 3.0;
        }
        // 1 on a plate's own joints; 0 where every turn fits as badly as any other.
        require_margin(&[sine.hypot(cosine)])?;
        Ok((p_m, sine.atan2(cosine)))
    }

    fn posture(
        &self,
        p_m: Vector2<f64>,
        phi_rad: f64,
        chains: ChainAngles,
    ) -> Result<Posture, KinematicsError> {
        let [l1, l2, l3] = self.parameters.l_m;
        let u = chains.map(|links| links.map(direction));
        let margin = require_margin(&u.map(|[first, second]| cross(first, second)))?;
        let mut motions = [LinkMotion::at_base(u[0][0], Vector3::zeros()); 6];
        let mut reference = ReferenceMatrix::zeros();
        let mut shaft_rad = ActuatorVector::zeros();
        for (i, [along_1, along_2]) in u.into_iter().enumerate() {
            let plate = -l3 * turned(direction(phi_rad + PSI_RAD[i]));
            // Velocity of c_i per unit twist of the plate.
            let c = Matrix2x3::new(1.0, 0.0, plate.x, 0.0, 1.0, plate.y);
            let [w_1, w_2] = arm_rates([l1, l2], [along_1, along_2]).map(|per_c| c.tr_mul(&per_c));
            reference.set_column(2 * i, &w_1);
            reference.set_column(2 * i + 1, &(w_2 - w_1));
            motions[2 * i] = LinkMotion::at_base(along_1, w_1);
            let joint = swing(l1, along_1, w_1);
            motions[2 * i + 1] = LinkMotion { joint, along: along_2, rate_per_m: w_2 };
            shaft_rad[2 * i] = chains[i][0];
            shaft_rad[2 * i + 1] = wrap(chains[i][1] - chains[i][0]);
        }
        Ok(Posture {
            p_BH: PlaneVector::new(p_m.x, p_m.y, wrap(phi_rad)),
            shaft_rad,
            reference,
            inertia: self.inertia.at_handle(&motions, &reference),
            closure_rad: ActuatorVector::zeros(),
            margin,
        })
    }
}

/// The distances of H from O at which every bearing and every turn within the limit is within
/// reach of all chains.
///
/// A chain spans |p + R u(psi) - l3 u(psi + phi)|: the way p, and a way of length
/// D(phi) = |R - l3 u(phi)|, whatever the chain. Over all bearings that is |D - r| to D + r,
/// and D grows from |R - l3| at phi = 0 to its value at the limit. So either r stays below
/// every D (a disc) or above every D (a ring); where links 1 and 2 are equal the border
/// between the two is a place where they fold onto each other.
fn reach(parameters: &ThreeRrrParameters) -> Option<(f64, f64)> {
    let ThreeRrrParameters { base_m, l_m: [l1, l2, l3], turn_rad, .. } = *parameters;
    let (hole_m, span_m) = ((l1 - l2).abs(), l1 + l2);
    let nearest_m = (base_m - l3).abs();
    let furthest_m = (Vector2::new(base_m, 0.0) - l3 * direction(turn_rad)).norm();
    let disc_m = (0.0, (nearest_m - hole_m).min(span_m - furthest_m));
    let ring_m = (furthest_m + hole_m, span_m - furthest_m);
    let widest = if disc_m.1 >= ring_m.1 - ring_m.0 { disc_m } else { ring_m };
    (widest.1 > widest.0).then_some(widest)
}

impl Mechanism for ThreeRrr {
    fn name(&self) -> &'static str {
        KIND.name
    }

    fn freedoms(&self) -> usize {
        3
    }

    fn actuators(&self) -> usize {
        6
    }

    fn posture_at(&self, p_BH: &PlaneVector) -> Result<Posture, KinematicsError> {
        let p_m = finite_point(p_BH)?;
        usable_angles::<1>(&[p_BH.z])?;
        let elbows = self.parameters.elbows.map(f64::from);
        self.posture(p_m, p_BH.z, self.chains(p_m, p_BH.z, elbows)?)
    }

    fn posture_from_shafts(&self, shaft_rad: &ActuatorVector) -> Result<Posture, KinematicsError> {
        let given = usable_angles::<6>(shaft_rad.as_slice())?;
        let [l1, l2, _] = self.parameters.l_m;
        let joints_m = [0, 1, 2].map(|i| {
            let (t1, t2) = (given[2 * i], given[2 * i + 1]);
            self.base_m(i) + l1 * direction(t1) + l2 * direction(t1 + t2)
        });
        let (p_m, phi_rad) = self.fitted(joints_m)?;
        let elbows = [0, 1, 2].map(|i| given[2 * i + 1].sin().signum());
        let mut posture = self.posture(p_m, phi_rad, self.chains(p_m, phi_rad, elbows)?)?;
        posture.closure_rad = (given - posture.shaft_rad).map(wrap);
        posture.shaft_rad = given - posture.closure_rad;
        Ok(posture)
    }

    fn outline(&self, posture: &Posture, out: &mut Outline) -> usize {
        let [l1, ..] = self.parameters.l_m;
        let joint_m = |i| self.plate_joint_m(posture.p_BH.xy(), posture.p_BH.z, i);
        for i in [0, 1, 2] {
            let base_m = self.base_m(i);
            let elbow_m = (base_m + l1 * direction(posture.shaft_rad[2 * i])).into();
            out[3 * i] = (base_m.into(), elbow_m);
            out[3 * i + 1] = (elbow_m, joint_m(i).into());
            out[3 * i + 2] = (joint_m(i).into(), joint_m((i + 1) % 3).into());
        }
        9
    }

    fn reach_m(&self) -> (f64, f64) {
        self.reach_m
    }

    fn turn_rad(&self) -> f64 {
        self.parameters.turn_rad
    }

    fn inertia_varies(&self) -> bool {
        self.inertia.varies()
    }

    fn working_mode(&self) -> WorkingMode {
        WorkingMode::of(&self.parameters.elbows)
    }

    fn in_working_mode(&self, mode: &WorkingMode) -> Option<std::sync::Arc<dyn Mechanism>> {
        let parameters = ThreeRrrParameters { elbows: mode.signs()?, ..self.parameters };
        Some(shared(Self { parameters, ..*self }))
    }
}

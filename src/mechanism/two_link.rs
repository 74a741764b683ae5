//! `two-link`: a serial arm of two links, one actuator in each joint.
//!
//! Shaft 1 turns link 1 against the base, shaft 2 link 2 against link 1 (the angles are
//! *relative*), so `J = dP/dq` and `R = J^-T`, 2x2. With E the elbow, P the handle:
//!
//! ```text
//! E = l1 u(q1)      P = E + l2 u(q1 + q2)      phi of the handle = q1 + q2
//! ```
//!
//! `elbow` = +1 puts link 1 counter-clockwise of the line to the handle, where q2 < 0; -1 is
//! the posture (45, 90) deg of Cho 2005, Figures 1-3. The margin to a singular posture is
//! |sin q2|. No shaft is redundant, so closure is always zero.

use nalgebra::{Matrix2, Vector2};
use std::sync::Arc;

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

/// A serial arm in a device file.
pub(super) const KIND: Kind = Kind {
    name: "two-link",
    keys: &[
        Key { name: "l1_m", form: Form::Number(LENGTH_M) },
        Key { name: "l2_m", form: Form::Number(LENGTH_M) },
        Key { name: "elbow", form: Form::Sign(1) },
    ],
    build: |described| {
        let parameters = TwoLinkParameters {
            l1_m: described.number("l1_m"),
            l2_m: described.number("l2_m"),
            elbow: described.sign("elbow"),
        };
        Ok(shared(TwoLink::new(parameters, described.inertia()?)?))
    },
};

/// What a serial arm is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwoLinkParameters {
    /// Base to elbow, 0.001 to 10 m.
    pub l1_m: f64,
    /// Elbow to handle, 0.001 to 10 m.
    pub l2_m: f64,
    /// Side of the elbow that [`Mechanism::posture_at`] chooses, +1 or -1.
    pub elbow: i32,
}

/// A serial arm.
#[derive(Clone, Copy, Debug)]
pub struct TwoLink {
    lengths_m: [f64; 2],
    elbow: f64,
    inertia: Inertia<2>,
}

impl TwoLink {
    /// Checks the parameters; `inertia.links` are link 1 (about the base) and link 2 (about
    /// the elbow).
    pub fn new(parameters: TwoLinkParameters, inertia: Inertia<2>) -> Result<Self, ParameterError> {
        let lengths_m = [parameters.l1_m, parameters.l2_m];
        for (field, length_m) in ["l1_m", "l2_m"].into_iter().zip(lengths_m) {
            require_range(field, length_m, &LENGTH_M)?;
        }
        inertia.check()?;
        Ok(Self { lengths_m, elbow: require_sign("elbow", parameters.elbow)?, inertia })
    }

    /// `J = dP/dq`, m/rad.
    pub fn jacobian(&self, posture: &Posture) -> Matrix2<f64> {
        let [q1, q2] = [posture.shaft_rad[0], posture.shaft_rad[1]];
        let elbow_m = self.lengths_m[0] * direction(q1);
        let forearm_m = self.lengths_m[1] * direction(q1 + q2);
        Matrix2::from_columns(&[turned(elbow_m + forearm_m), turned(forearm_m)])
    }

    fn posture(&self, [q1, q2]: [f64; 2]) -> Result<Posture, KinematicsError> {
        let [l1_m, l2_m] = self.lengths_m;
        let along = [direction(q1), direction(q1 + q2)];
        let margin = require_margin(&[cross(along[0], along[1])])?;
        let rates = arm_rates(self.lengths_m, along);
        let handle_m = l1_m * along[0] + l2_m * along[1];
        let mut shaft_rad = ActuatorVector::zeros();
        shaft_rad.fixed_rows_mut::<2>(0).copy_from(&Vector2::new(q1, q2));
        let mut reference = ReferenceMatrix::zeros();
        let columns = Matrix2::from_columns(&[rates[0], rates[1] - rates[0]]);
        reference.fixed_view_mut::<2, 2>(0, 0).copy_from(&columns);
        let elbow = swing(l1_m, along[0], rates[0]);
        let motions = [
            LinkMotion::at_base(along[0], rates[0]),
            LinkMotion { joint: elbow, along: along[1], rate_per_m: rates[1] },
        ];
        Ok(Posture {
            p_BH: PlaneVector::new(handle_m.x, handle_m.y, wrap(q1 + q2)),
            shaft_rad,
            reference,
            inertia: self.inertia.at_handle(&motions, &reference),
            closure_rad: ActuatorVector::zeros(),
            margin,
        })
    }
}

impl Mechanism for TwoLink {
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
        let [phi1, phi2] = arm_angles(finite_point(p_BH)?, self.lengths_m, self.elbow)?;
        self.posture([phi1, wrap(phi2 - phi1)])
    }

    fn posture_from_shafts(&self, shaft_rad: &ActuatorVector) -> Result<Posture, KinematicsError> {
        self.posture(usable_angles::<2>(shaft_rad.as_slice())?.into())
    }

    fn outline(&self, posture: &Posture, out: &mut Outline) -> usize {
        let elbow_m = self.lengths_m[0] * direction(posture.shaft_rad[0]);
        out[0] = ([0.0; 2], elbow_m.into());
        out[1] = (elbow_m.into(), [posture.p_BH.x, posture.p_BH.y]);
        2
    }

    fn reach_m(&self) -> (f64, f64) {
        let [l1_m, l2_m] = self.lengths_m;
        ((l1_m - l2_m).abs(), l1_m + l2_m)
    }

    fn inertia_varies(&self) -> bool {
        self.inertia.varies()
    }

    fn working_mode(&self) -> WorkingMode {
        WorkingMode::of(&[self.elbow as i32])
    }

    fn in_working_mode(&self, mode: &WorkingMode) -> Option<Arc<dyn Mechanism>> {
        let [elbow] = mode.signs()?.map(f64::from);
        Some(shared(Self { elbow, ..*self }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::{num::f64::ANY, prelude::*};
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

    fn arm(l1_m: f64, l2_m: f64, elbow: i32) -> TwoLink {
        let parameters = TwoLinkParameters { l1_m, l2_m, elbow };
        TwoLink::new(parameters, Inertia::default()).expect("valid parameters")
    }

    fn shafts(q1: f64, q2: f64) -> ActuatorVector {
        ActuatorVector::from_column_slice(&[q1, q2, 0.0, 0.0, 0.0, 0.0])
    }

    #[test]
    fn the_arm_of_the_first_figures_bends_as_in_the_paper() {
        let posture = arm(0.3, 0.3, -1).posture_at(&PlaneVector::new(0.0, 0.18_f64.sqrt(), 0.0));
        let posture = posture.expect("reachable");
        let expected = shafts(FRAC_PI_4, FRAC_PI_2);
        assert!((posture.shaft_rad - expected).norm() < 1e-12);
        assert!((posture.p_BH.z - 0.75 * PI).abs() < 1e-12);
    }

    #[test]
    fn parameters_out_of_range_are_refused_by_name() {
        let build = |l1_m, l2_m, elbow| {
            let parameters = TwoLinkParameters { l1_m, l2_m, elbow };
            TwoLink::new(parameters, Inertia::default()).map(drop).map_err(|e| e.to_string())
        };
        assert_eq!(build(0.3, -1.0, 1), Err("l2_m = -1: allowed is 0.001 to 10 m".into()));
        assert_eq!(build(f64::NAN, 0.3, 1), Err("l1_m = NaN: allowed is 0.001 to 10 m".into()));
        assert_eq!(build(0.3, 0.3, 0), Err("elbow = 0: allowed is -1 or +1".into()));
    }

    #[test]
    fn a_stretched_arm_is_singular_and_a_far_handle_unreachable() {
        let arm = arm(0.3, 0.2, 1);
        let straight = arm.posture_from_shafts(&shafts(0.4, 0.0));
        assert!(matches!(straight, Err(KinematicsError::Singular { .. })));
        for x in [0.5, 0.1] {
            let edge = arm.posture_at(&PlaneVector::new(x, 0.0, 0.0));
            assert!(matches!(edge, Err(KinematicsError::Singular { .. })), "{edge:?}");
        }
        for x in [0.51, 0.09, 0.0, 1e300] {
            let beyond = arm.posture_at(&PlaneVector::new(x, 0.0, 0.0));
            assert!(matches!(beyond, Err(KinematicsError::Unreachable { .. })), "{beyond:?}");
        }
    }

    proptest! {
        #[test]
        fn reference_forces_and_jacobian_equal_finite_differences(
            l1 in 0.1..1.0_f64, l2 in 0.1..1.0_f64, q1 in -9.0..9.0, bend in 0.2..2.9_f64, up: bool,
        ) {
            const STEP: f64 = 1e-6;
            let q2 = if up { bend } else { -bend };
            let arm = arm(l1, l2, 1);
            let at = |a, b| arm.posture_from_shafts(&shafts(a, b)).expect("regular");
            let posture = at(q1, q2);
            let slope = |d1: f64, d2: f64| {
                (at(q1 + d1, q2 + d2).p_BH - at(q1 - d1, q2 - d2).p_BH).xy() / (2.0 * STEP)
            };
            let numeric = Matrix2::from_columns(&[slope(STEP, 0.0), slope(0.0, STEP)]);
            prop_assert!((arm.jacobian(&posture) - numeric).norm() < 1e-8);
            let R = posture.reference.fixed_view::<2, 2>(0, 0);
            prop_assert!((numeric.transpose() * R - Matrix2::identity()).norm() < 1e-6);
        }

        #[test]
        fn inverse_then_forward_is_the_same_posture(
            l1 in 0.1..1.0_f64, l2 in 0.1..1.0_f64, s in 0.02..0.98_f64, bearing_rad in -PI..PI, up: bool,
        ) {
            let arm = arm(l1, l2, if up { 1 } else { -1 });
            let (least, most) = arm.reach_m();
            let p_m = (least + s * (most - least)) * direction(bearing_rad);
            let there = arm.posture_at(&PlaneVector::new(p_m.x, p_m.y, 0.0))?;
            let back = arm.posture_from_shafts(&there.shaft_rad)?;
            prop_assert!((back.p_BH.xy() - p_m).norm() < 1e-12);
            prop_assert_eq!(there, back);
        }

        #[test]
        fn no_input_makes_nan(a in ANY, b in ANY) {
            let arm = arm(0.3, 0.3, 1);
            let answers = [
                arm.posture_at(&PlaneVector::new(a, b, f64::NAN)),
                arm.posture_from_shafts(&shafts(a, b)),
            ];
            for posture in answers.into_iter().flatten() {
                prop_assert!(posture.p_BH.iter().chain(&posture.reference).all(|x| x.is_finite()));
                prop_assert!(posture.shaft_rad.iter().all(|x| x.is_finite()));
            }
        }
    }
}

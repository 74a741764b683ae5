//! The Jacobians of the 3-RRR as the paper writes them, for analysis.
//!
//! A tick needs only R, which a posture has without them. Angles in radians, lengths in
//! metres; the third row of a twist is the plate's turning rate, so no matrix here has one
//! unit. Source: Kim 2003, Eq 3-9, with the misprints of Eq 6, 7 and 9 mended.

use nalgebra::{Matrix3, Matrix6, Matrix6x3, Vector2};

use super::{PSI_RAD, ThreeRrr};
use crate::mechanism::Posture;
use crate::mechanism::geometry::{direction, turned};

/// The Jacobians of a posture. u is the plate's twist (x, y, phi), phi_i the joints of chain i,
/// a the three base joints, A all six actuated ones in the order of the shafts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThreeRrrJacobians {
    /// Of every chain, `u = iG_phi phi_i'`: the velocity of the plate per joint rate.
    pub iG_phi: [Matrix3<f64>; 3],
    /// `A d' = B a'`, with d the six joints that are not at the base, chain by chain: what
    /// closes the loops (Eq 6). Singular where the base joints alone do not move the plate.
    pub A: Matrix6<f64>,
    /// See `A`.
    pub B: Matrix6x3<f64>,
    /// `u = Ga_u a'`; `None` where the base joints alone do not define the plate.
    pub Ga_u: Option<Matrix3<f64>>,
    /// `A' = Gu_A u`, 6x3, so `T_u = Gu_A^T T_A`: rows 1 and 2 of every chain's inverse, which
    /// exist where `A` has no inverse.
    pub Gu_A: Matrix6x3<f64>,
}

impl ThreeRrr {
    /// The Jacobians of a posture of this device.
    pub fn jacobians(&self, posture: &Posture) -> ThreeRrrJacobians {
        let iG_phi = [0, 1, 2].map(|chain| self.chain(posture, chain));
        let (mut A, mut B) = (Matrix6::zeros(), Matrix6x3::zeros());
        for (row, (chain, next)) in [(0, (0, 1)), (3, (1, 2))] {
            let distal = |chain: usize| iG_phi[chain].fixed_columns::<2>(1).into_owned();
            A.fixed_view_mut::<3, 2>(row, 2 * chain).copy_from(&distal(chain));
            A.fixed_view_mut::<3, 2>(row, 2 * next).copy_from(&-distal(next));
            B.fixed_view_mut::<3, 1>(row, chain).copy_from(&-iG_phi[chain].column(0));
            B.fixed_view_mut::<3, 1>(row, next).copy_from(&iG_phi[next].column(0));
        }
        let mut Gu_A = Matrix6x3::zeros();
        for (i, matrix) in iG_phi.iter().enumerate() {
            // Regular with the posture: its determinant is l1 l2 sin t2.
            if let Some(inverse) = matrix.try_inverse() {
                Gu_A.fixed_rows_mut::<2>(2 * i).copy_from(&inverse.fixed_rows::<2>(0));
            }
        }
        let base = Matrix3::from_fn(|i, j| Gu_A[(2 * i, j)]);
        ThreeRrrJacobians { iG_phi, A, B, Ga_u: base.try_inverse(), Gu_A }
    }

    /// Each joint turns the plate about itself.
    fn chain(&self, posture: &Posture, chain: usize) -> Matrix3<f64> {
        let p_m = posture.p_BH.xy();
        let base_m = self.base_m(chain);
        let elbow_m = base_m + self.parameters.l_m[0] * direction(posture.shaft_rad[2 * chain]);
        let plate_m = self.parameters.l_m[2] * direction(posture.p_BH.z + PSI_RAD[chain]);
        let about = |arm_m: Vector2<f64>| turned(arm_m).push(1.0);
        Matrix3::from_columns(&[about(p_m - base_m), about(p_m - elbow_m), about(plate_m)])
    }
}

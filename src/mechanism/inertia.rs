//! What the moving parts weigh, and the inertia that the hand feels at the handle.
//!
//! Kinetic energy is `v^T M v / 2` with v the handle's velocity in B, so
//!
//! ```text
//! M = m_H I + sum over links (J_c^T m J_c + w^T I_c w) + R diag(I_shaft) R^T
//! ```
//!
//! where J_c is the velocity of a link's centre of mass and w its turning rate per unit handle
//! velocity; R^T gives the shafts' rates, and `m_H I` ends with the handle's moment of inertia
//! where its turn is a freedom. With two freedoms the third row and column are zero. Gravity and Coriolis forces are
//! not modelled: the plane is level and hands are slow.

use nalgebra::{SMatrix, SVector, Vector2};

use super::{
    geometry::swing,
    parameters::{ParameterError, require_range},
};
use crate::notation::{ActuatorVector, HandleInertia, ReferenceMatrix};
use crate::units::Range;

/// One rigid link.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LinkInertia {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Distance of the centre of mass from the link's proximal joint along the link, m;
    /// negative for a counterweight.
    pub centre_m: f64,
    /// Moment of inertia about the centre of mass, kg m^2.
    pub inertia_kg_m2: f64,
}

/// Everything that moves on a linkage of `N` rigid links.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inertia<const N: usize> {
    /// Mass at the handle, kg. Never zero, so that M can be inverted.
    pub handle_mass_kg: f64,
    /// Moment of inertia of the handle about H, kg m^2: felt where the handle's turn is a
    /// freedom, and never zero for the same reason.
    pub handle_inertia_kg_m2: f64,
    /// The links, in the order that the linkage states.
    pub links: [LinkInertia; N],
    /// Moment of inertia that turns with each actuator's shaft, kg m^2.
    pub shaft_inertia_kg_m2: ActuatorVector,
}

/// How one link moves: all a link contributes to the inertia besides its own numbers.
#[derive(Clone, Copy, Debug)]
pub(super) struct LinkMotion<const FREEDOMS: usize> {
    /// Velocity of the proximal joint per unit handle velocity.
    pub(super) joint: SMatrix<f64, 2, FREEDOMS>,
    /// Direction of the link, away from that joint.
    pub(super) along: Vector2<f64>,
    /// Turning rate per unit handle velocity: rad/m, and rad/rad for the handle's turn.
    pub(super) rate_per_m: SVector<f64, FREEDOMS>,
}

impl<const FREEDOMS: usize> LinkMotion<FREEDOMS> {
    /// A link about a joint that stands still.
    pub(super) fn at_base(along: Vector2<f64>, rate_per_m: SVector<f64, FREEDOMS>) -> Self {
        Self { joint: SMatrix::zeros(), along, rate_per_m }
    }
}

impl<const N: usize> Default for Inertia<N> {
    /// Half a kilogram in the hand on massless links, as the simulated devices have.
    fn default() -> Self {
        Self {
            handle_mass_kg: 0.5,
            handle_inertia_kg_m2: 1e-3,
            links: [LinkInertia::default(); N],
            shaft_inertia_kg_m2: ActuatorVector::zeros(),
        }
    }
}

impl<const N: usize> Inertia<N> {
    /// Refuses a number that no part has.
    #[expect(clippy::disallowed_macros, reason = "parameters are checked before the first tick")]
    pub(super) fn check(&self) -> Result<(), ParameterError> {
        require_range("handle_mass_kg", self.handle_mass_kg, &Range::new(1e-3, 100.0, "kg"))?;
        let plate = Range::new(1e-6, 100.0, "kg m^2");
        require_range("handle_inertia_kg_m2", self.handle_inertia_kg_m2, &plate)?;
        for (i, link) in self.links.iter().enumerate() {
            let field = |name| format!("links[{i}].{name}");
            require_range(field("mass_kg"), link.mass_kg, &Range::new(0.0, 100.0, "kg"))?;
            require_range(field("centre_m"), link.centre_m, &Range::new(-10.0, 10.0, "m"))?;
            require_range(
                field("inertia_kg_m2"),
                link.inertia_kg_m2,
                &Range::new(0.0, 100.0, "kg m^2"),
            )?;
        }
        for (i, &inertia_kg_m2) in self.shaft_inertia_kg_m2.iter().enumerate() {
            let field = format!("shaft_inertia_kg_m2[{i}]");
            require_range(field, inertia_kg_m2, &Range::new(0.0, 100.0, "kg m^2"))?;
        }
        Ok(())
    }

    /// True where anything but the handle has inertia.
    pub(super) fn varies(&self) -> bool {
        self.links.iter().any(|link| link.mass_kg > 0.0 || link.inertia_kg_m2 > 0.0)
            || self.shaft_inertia_kg_m2.iter().any(|&inertia| inertia > 0.0)
    }

    /// M of a posture, in as many rows and columns as there are freedoms.
    pub(super) fn at_handle<const FREEDOMS: usize>(
        &self,
        motions: &[LinkMotion<FREEDOMS>; N],
        reference: &ReferenceMatrix,
    ) -> HandleInertia {
        let mut of_links =
            SMatrix::<f64, FREEDOMS, FREEDOMS>::from_diagonal(&SVector::from_fn(|i, _| {
                if i < 2 { self.handle_mass_kg } else { self.handle_inertia_kg_m2 }
            }));
        for (link, motion) in self.links.iter().zip(motions) {
            let centre = motion.joint + swing(link.centre_m, motion.along, motion.rate_per_m);
            of_links += link.mass_kg * centre.transpose() * centre
                + link.inertia_kg_m2 * motion.rate_per_m * motion.rate_per_m.transpose();
        }
        let mut inertia = HandleInertia::zeros();
        inertia.fixed_view_mut::<FREEDOMS, FREEDOMS>(0, 0).copy_from(&of_links);
        for (shaft, &inertia_kg_m2) in reference.column_iter().zip(&self.shaft_inertia_kg_m2) {
            inertia += inertia_kg_m2 * shaft * shaft.transpose();
        }
        inertia
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mechanism::{FiveBar, Mechanism, TwoLink, TwoLinkParameters, fixtures};
    use crate::notation::PlaneVector;

    const STEP_S: f64 = 1e-6;

    fn weights<const N: usize>(shafts: usize) -> Inertia<N> {
        let link = |i: usize| LinkInertia {
            mass_kg: 0.1 + 0.07 * i as f64,
            centre_m: 0.04 + 0.03 * i as f64,
            inertia_kg_m2: 1e-3 * (1.0 + i as f64),
        };
        let mut shaft_inertia_kg_m2 = ActuatorVector::zeros();
        for i in 0..shafts {
            shaft_inertia_kg_m2[i] = 1e-5 * (2.0 + i as f64);
        }
        let usual = Inertia::<N>::default();
        Inertia {
            handle_mass_kg: 0.3,
            links: std::array::from_fn(link),
            shaft_inertia_kg_m2,
            ..usual
        }
    }

    /// Kinetic energy of a motion through `p_m` at `v_m_s`, from where the drawn segments
    /// `links` are shortly before and after: no Jacobian takes part.
    fn energy_J<const N: usize>(
        device: &dyn Mechanism,
        inertia: &Inertia<N>,
        links: [usize; N],
        (p_m, v_m_s): (PlaneVector, PlaneVector),
    ) -> f64 {
        let snapshot = |t_s: f64| {
            let posture = device.posture_at(&(p_m + t_s * v_m_s)).expect("a regular posture");
            let mut outline = Default::default();
            device.outline(&posture, &mut outline);
            (posture.shaft_rad, outline)
        };
        let ((shafts_0, before), (shafts_1, after)) = (snapshot(-STEP_S), snapshot(STEP_S));
        let rate = |change: f64| change / (2.0 * STEP_S);
        let mut energy_J = 0.5 * inertia.handle_mass_kg * v_m_s.norm_squared();
        for (link, segment) in inertia.links.iter().zip(links) {
            let place = |(from, to): ([f64; 2], [f64; 2])| {
                let (from, to) = (Vector2::from(from), Vector2::from(to));
                let along = (to - from).normalize();
                (from + link.centre_m * along, along)
            };
            let ((c_0, u_0), (c_1, u_1)) = (place(before[segment]), place(after[segment]));
            let turn_rad = crate::mechanism::geometry::cross(u_0, u_1).asin();
            energy_J += 0.5 * link.mass_kg * rate((c_1 - c_0).norm()).powi(2)
                + 0.5 * link.inertia_kg_m2 * rate(turn_rad).powi(2);
        }
        for i in 0..device.actuators() {
            let turn_rad = shafts_1[i] - shafts_0[i];
            energy_J += 0.5 * inertia.shaft_inertia_kg_m2[i] * rate(turn_rad).powi(2);
        }
        energy_J
    }

    fn agrees<const N: usize>(device: &dyn Mechanism, inertia: &Inertia<N>, links: [usize; N]) {
        for (x, y, v_x, v_y) in
            [(0.1, 0.3, 0.2, -0.1), (0.3, 0.25, -0.4, 0.3), (0.25, -0.2, 0.0, 0.5)]
        {
            let motion = (PlaneVector::new(x, y, 0.0), PlaneVector::new(v_x, v_y, 0.0));
            let M = device.posture_at(&motion.0).expect("a regular posture").inertia;
            let of_matrix = 0.5 * (motion.1.transpose() * M * motion.1)[0];
            let of_motion = energy_J(device, inertia, links, motion);
            assert!((of_matrix / of_motion - 1.0).abs() < 1e-6, "{of_matrix} {of_motion}");
            assert_eq!((M.row(2).norm(), M.column(2).norm()), (0.0, 0.0));
        }
    }

    #[test]
    fn kinetic_energy_at_the_handle_is_that_of_the_parts() {
        let (four, two) = (weights::<4>(4), weights::<2>(2));
        for parameters in fixtures::CHO {
            let device = FiveBar::new(parameters, four).expect("valid parameters");
            assert!(device.inertia_varies());
            agrees(&device, &four, [0, 3, 1, 4]);
        }
        let arm = TwoLinkParameters { l1_m: 0.3, l2_m: 0.25, elbow: -1 };
        let device = TwoLink::new(arm, two).expect("valid parameters");
        agrees(&device, &two, [0, 1]);
    }

    #[test]
    fn by_default_the_hand_feels_half_a_kilogram_everywhere() {
        let device = FiveBar::new(fixtures::CHO[0], Inertia::default()).expect("valid");
        let posture = device.posture_at(&PlaneVector::new(0.3, 0.1, 0.0)).expect("reachable");
        assert!(!device.inertia_varies());
        assert_eq!(posture.inertia, HandleInertia::from_diagonal(&[0.5, 0.5, 0.0].into()));
    }

    #[test]
    fn weights_that_no_part_has_are_refused_by_name() {
        let mut inertia = Inertia::<2>::default();
        inertia.links[1].mass_kg = f64::NAN;
        let error = inertia.check().expect_err("not a mass");
        assert_eq!(error.to_string(), "links[1].mass_kg = NaN: allowed is 0 to 100 kg");
        assert!(Inertia::<2> { handle_mass_kg: 0.0, ..Default::default() }.check().is_err());
    }
}

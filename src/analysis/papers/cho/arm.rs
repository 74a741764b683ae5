//! Figures 1 to 4 of Cho 2005 on a two-link arm with two brakes: passive sets, force
//! approximation, friction cones and one-brake paths, Eq 3 and Eq 5.
//!
//! The paper numbers passive sets by the signs of the joint rates: set 1 has both positive and
//! so the rays 1- and 2-, set 2 the rays 1+ and 2-, set 3 1+ and 2+, set 4 1- and 2+.

use std::f64::consts::{FRAC_PI_2, PI};

use super::{ChoError, along};
use crate::actuation::{Region, classify, literal_Nm};
use crate::analysis::design::cones::{
    approximation_rad, friction_cone, one_brake_paths, passive_set_of, passive_sets,
};
use crate::analysis::manipulability::shaft_motion;
use crate::config::DeviceDefinition;
use crate::mechanism::Posture;
use crate::notation::ActuatorVector;

/// Directions of the three desired forces that are tried in Figure 2: in the fully displayable
/// region, in the approximation region, in the active region. The paper gives none.
pub(super) const DESIRED_DEG: [f64; 3] = [110.0, 60.0, -60.0];

/// What this run finds of Figures 1 to 4.
#[derive(Clone, Debug)]
pub struct Arm {
    /// Rays of the four passive sets and their widths.
    pub sets: Vec<(String, f64)>,
    /// Largest difference between Eq 3 and the linkage's own reference forces, 1/m.
    pub eq3_off: f64,
    /// Regions of the three desired forces of Figure 2.
    pub regions: [Option<Region>; 3],
    /// Approximation angle of the second of them.
    pub gamma_deg: f64,
    /// Passive set of the motion along -y.
    pub set_of_motion: String,
    /// Directions of the hand tried for Figure 3, and how many inside the cone leave a path out
    /// of the wall, and how many outside leave none.
    pub hands: [usize; 3],
    /// The passive set in which the cone of the figure's desired force lies, and the force's own.
    pub cone: [String; 2],
    /// Largest error of Eq 5 over all motions, two brakes.
    pub eq5_two: f64,
    /// Smallest error of Eq 5 over all motions of the five-bar, four brakes.
    pub eq5_four: f64,
    /// P_a of four equal angles, and of 2 pi/3 and pi/3 twice, in pi^2.
    pub P_a: [f64; 2],
    /// Eq 1b as printed: torque of a stuck brake that nobody commands, over the hand's.
    pub uncommanded: f64,
}

/// The arm of Figures 1 and 2: equal links at (45, 90) degrees.
pub fn figure_1() -> Result<(DeviceDefinition, Posture), ChoError> {
    at(45.0, 90.0)
}

/// A posture in which Figure 3's sentences hold: it needs link 2 and the handle to lean right of y.
pub fn figure_3() -> Result<(DeviceDefinition, Posture), ChoError> {
    at(30.0, 45.0)
}

fn at(theta1_deg: f64, theta2_deg: f64) -> Result<(DeviceDefinition, Posture), ChoError> {
    let device = DeviceDefinition::load("two-link")?;
    let mut shafts = ActuatorVector::zeros();
    (shafts[0], shafts[1]) = (theta1_deg.to_radians(), theta2_deg.to_radians());
    let posture = device.mechanism.posture_from_shafts(&shafts)?;
    Ok((device, posture))
}

pub(super) fn measure() -> Result<Arm, ChoError> {
    let (device, posture) = figure_1()?;
    let R = &posture.reference;
    let down_rad = -FRAC_PI_2;
    let capability = device.capability(&posture, &shaft_motion(R, Some(down_rad)));
    let judged =
        DESIRED_DEG.map(|deg| classify(&capability, &along(deg.to_radians()), &along(down_rad)));
    let gamma_rad = judged[1].and_then(|found| found.gamma_rad).unwrap_or(f64::NAN);
    let names = |rays: &[crate::mechanism::Ray]| {
        rays.iter().map(|ray| format!("R{ray}")).collect::<Vec<_>>().join(" ")
    };
    let sets = passive_sets(R, 2);
    let (hands, cone) = hands()?;
    let equal = 4.0 * FRAC_PI_2.powi(2);
    let uneven = 2.0 * (2.0 * PI / 3.0).powi(2) + 2.0 * (PI / 3.0).powi(2);
    Ok(Arm {
        sets: sets.iter().map(|set| (names(&set.rays), set.cone.width_rad.to_degrees())).collect(),
        eq3_off: eq3_off(&posture),
        regions: judged.map(|found| found.map(|found| found.region)),
        gamma_deg: gamma_rad.to_degrees(),
        set_of_motion: passive_set_of(R, 2, down_rad).map_or_else(String::new, |s| names(&s.rays)),
        hands,
        cone,
        eq5_two: eq5(R, 2).1,
        eq5_four: eq5(&five_bar()?.reference, 4).0,
        P_a: [equal, uneven].map(|P_a| P_a / (PI * PI)),
        uncommanded: literal_Nm(0.0, 0.0, 1.5, 1e-3).abs() / 1.5,
    })
}

/// Eq 3 beside the linkage: columns of J^-T.
fn eq3_off(posture: &Posture) -> f64 {
    let l = 0.3;
    let [q1, q12] = [posture.shaft_rad[0], posture.shaft_rad[0] + posture.shaft_rad[1]];
    let scale = 1.0 / (l * l * posture.shaft_rad[1].sin());
    let printed = [
        [l * q12.cos(), l * q12.sin()],
        [-l * q1.cos() - l * q12.cos(), -l * q1.sin() - l * q12.sin()],
    ];
    let off = |i: usize, row: usize| (scale * printed[i][row] - posture.reference[(row, i)]).abs();
    (0..2)
        .flat_map(|i| (0..2).map(move |row| (i, row)))
        .map(|(i, row)| off(i, row))
        .fold(0.0, f64::max)
}

fn five_bar() -> Result<Posture, ChoError> {
    let device = DeviceDefinition::load("cho-2005")?;
    Ok(device.mechanism.posture_at(&crate::notation::PlaneVector::new(0.3, 0.1, 0.0))?)
}

/// Smallest and largest |gamma1 + gamma2 - (width of the neighbouring set)| over all motions.
fn eq5(reference: &crate::notation::ReferenceMatrix, brakes: usize) -> (f64, f64) {
    let sets = passive_sets(reference, brakes);
    let errors = (0..360).filter_map(|step| {
        let motion_rad = (f64::from(step) + 0.5).to_radians() - PI;
        let set = passive_set_of(reference, brakes, motion_rad)?;
        let own = sets.iter().position(|other| other.rays == set.rays)?;
        let neighbour = &sets[(own + 1) % sets.len()];
        let [before, after] = approximation_rad(&set, motion_rad);
        Some((before + after - neighbour.cone.width_rad).abs())
    });
    errors.fold((f64::INFINITY, 0.0), |(least, most), off| (least.min(off), most.max(off)))
}

/// Figure 3: the hand in every direction against a wall whose normal is y.
fn hands() -> Result<([usize; 3], [String; 2]), ChoError> {
    let (_, posture) = figure_3()?;
    let R = &posture.reference;
    let Some(cone) = friction_cone(R, &[0, 1], FRAC_PI_2) else {
        return Ok(([0; 3], Default::default()));
    };
    let paths = one_brake_paths(R, 2);
    let mut found = [0; 3];
    for step in 0..720 {
        let hand_rad = (0.5 * f64::from(step) + 0.05).to_radians() - PI;
        // A path is taken the way that the hand pushes along it.
        let out = paths.iter().any(|path| {
            let way = along(path.plus_rad);
            way.dot(&along(hand_rad)) * way.y > 0.0
        });
        found[0] += 1;
        found[1] += usize::from(cone.holds(hand_rad) && out);
        found[2] += usize::from(!cone.holds(hand_rad) && !out);
    }
    let number = |a: crate::mechanism::Ray, b: crate::mechanism::Ray| {
        match (a.positive, b.positive) {
            (false, false) => "1",
            (true, true) => "3",
            _ => "2 or 4",
        }
        .to_owned()
    };
    let own = cone.opposite();
    Ok((found, [number(cone.from, cone.to), number(own.from, own.to)]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_arm_is_the_one_of_the_figures() {
        let arm = measure().unwrap();
        assert!(arm.eq3_off < 1e-12 && arm.eq5_two < 1e-12 && arm.eq5_four > 0.1, "{arm:?}");
        let kinds = [Region::Full, Region::Approximate, Region::NotDisplayable].map(Some);
        assert_eq!(arm.regions, kinds);
        assert!((arm.gamma_deg - 30.0).abs() < 1e-9);
        assert_eq!(arm.hands, [720, 0, 0]);
        assert_eq!(arm.cone, ["1", "3"]);
        assert!((arm.P_a[0] - 1.0).abs() < 1e-12 && (arm.P_a[1] - 10.0 / 9.0).abs() < 1e-12);
        assert_eq!(arm.uncommanded, 1.0, "Eq 1b as printed holds without a command");
    }
}

//! The study of Kim, Chung, Yi & Suh 2003: how six motors share what three freedoms ask.
//!
//! A box in the hand is pressed into an elastic frame (Figures 2 and 3); the torques of each
//! scheme follow from the wrench (Figures 4 to 7). Beyond the paper: how often each scheme
//! keeps to the limits where it could, over random poses and wrenches up to what the motors can
//! give and beyond, with the exact bounded solution as the reference; how fine a force is with
//! coarse motors alone and with fine ones beside them; and how well conditioned the device is on
//! three motors and on six. SI units; wrenches at the plate's centre in B. The same seed gives
//! the same study.

use std::f64::consts::{PI, TAU};

use nalgebra::{Matrix3, Vector2};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::actuation::{
    Bounds, Capability, Distribution, ShaftMotion, approximation_angle, in_steps, least_norm,
    optimal_weighted,
};
use crate::config::{ConfigError, DeviceDefinition};
use crate::notation::{ActuatorVector, MAX_ACTUATORS, PlaneVector};

/// Motors at the base; the others float.
pub const BASE: [usize; 3] = [0, 2, 4];

/// Length that makes moments comparable with forces before a condition number is taken: that of
/// a link.
pub const LENGTH_M: f64 = 0.1;

/// Direction of the push in the paper's Figure 3.
pub const PUSH_RAD: f64 = 351.0 * PI / 180.0;

/// What is studied.
#[derive(Clone, Debug)]
pub struct Study {
    /// Device; one of three freedoms and six motors.
    pub device: String,
    /// Poses for each share of what the motors can give.
    pub poses: usize,
    /// Of poses and wrenches.
    pub seed: u64,
    /// Largest torque of the base and of the floating motors, N m.
    pub limits_Nm: [f64; 2],
    /// Weight of the floating motors' torques; that of the base ones is 1.
    pub floating_weight: f64,
    /// Steps of torque of the base and of the floating motors, N m.
    pub steps_Nm: [f64; 2],
}

impl Default for Study {
    fn default() -> Self {
        Self {
            device: "kim-2003".to_owned(),
            poses: 1000,
            seed: 1,
            limits_Nm: [2.0, 0.4],
            floating_weight: 3.0,
            steps_Nm: [0.05, 0.001],
        }
    }
}

/// Why there is no study.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// There is no such device.
    #[error(transparent)]
    Device(#[from] ConfigError),
    /// It is not one of three freedoms and six actuators.
    #[error("device = {0:?}: this study needs three freedoms and six actuators, as kim-2003 has")]
    Linkage(String),
    /// The handle cannot be there.
    #[error("the plate cannot be there: {0}")]
    Pose(#[from] crate::mechanism::KinematicsError),
}

/// A way to share a wrench.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scheme {
    /// Eq 22.
    LeastNorm,
    /// Eq 23.
    Weighted,
    /// Eq 26-31: one floating motor at its limit.
    NullSpace,
    /// The worst motor of all, again and again.
    NullSpaceIterated,
    /// The exact bounded solution.
    Exact,
}

impl Scheme {
    /// Every scheme, the published ones first.
    pub const ALL: [Self; 5] =
        [Self::LeastNorm, Self::Weighted, Self::NullSpace, Self::NullSpaceIterated, Self::Exact];

    /// As the strategies are called.
    pub fn name(self) -> &'static str {
        match self {
            Self::LeastNorm => "least-norm",
            Self::Weighted => "weighted",
            Self::NullSpace => "null-space",
            Self::NullSpaceIterated => "null-space-iterated",
            Self::Exact => "exact",
        }
    }

    /// Torques for a wrench, beyond the limits where the scheme does not know better.
    pub fn torque_Nm(
        self,
        capability: &Capability,
        wrench: &PlaneVector,
        weight: &ActuatorVector,
    ) -> ActuatorVector {
        let of = |all: fn(&Distribution, &Capability, &ActuatorVector) -> ActuatorVector| {
            Distribution::of(capability, wrench, weight)
                .map_or_else(ActuatorVector::zeros, |found| all(&found, capability, weight))
        };
        match self {
            Self::LeastNorm => least_norm(capability, wrench),
            Self::Weighted => of(|found, _, _| found.weighted_Nm),
            Self::NullSpace => {
                of(|found, device, weight| found.null_space(device, weight).torque_Nm)
            }
            Self::NullSpaceIterated => {
                of(|found, device, _| found.null_space_iterated(device).torque_Nm)
            }
            Self::Exact => optimal_weighted(capability, wrench, weight).torque_Nm,
        }
    }
}

/// A device with the limits and weights of a study.
#[derive(Debug)]
pub struct Rig {
    definition: DeviceDefinition,
    limits_Nm: ActuatorVector,
    /// What a torque counts.
    pub weight: ActuatorVector,
}

impl Rig {
    /// The device of a study.
    pub fn new(study: &Study) -> Result<Self, StudyError> {
        Self::of(DeviceDefinition::load(&study.device)?, study)
    }

    /// A device that is not in a file, with the limits and weights of a study.
    pub fn of(definition: DeviceDefinition, study: &Study) -> Result<Self, StudyError> {
        if definition.mechanism.freedoms() != 3 || definition.mechanism.actuators() != MAX_ACTUATORS
        {
            return Err(StudyError::Linkage(study.device.clone()));
        }
        let of = |[base, floating]: [f64; 2]| {
            ActuatorVector::from_fn(|i, _| if BASE.contains(&i) { base } else { floating })
        };
        let (limits_Nm, weight) = (of(study.limits_Nm), of([1.0, study.floating_weight]));
        Ok(Self { definition, limits_Nm, weight })
    }

    /// What the motors can do at a pose.
    pub fn at(&self, p_BH: &PlaneVector) -> Result<Capability, StudyError> {
        let posture = self.definition.mechanism.posture_at(p_BH)?;
        let rest = [ShaftMotion::Rest; MAX_ACTUATORS];
        let mut capability = self.definition.capability(&posture, &rest);
        capability.bounds = Bounds::given(&capability.kinds, &self.limits_Nm, &rest);
        Ok(capability)
    }

    /// A pose anywhere in the reach.
    pub fn anywhere(&self, rng: &mut ChaCha8Rng) -> PlaneVector {
        let (_, reach_m) = self.definition.mechanism.reach_m();
        let r_m = reach_m * rng.random_range(0.0f64..1.0).sqrt();
        let bearing_rad: f64 = rng.random_range(-PI..PI);
        let turn_rad = self.definition.mechanism.turn_rad();
        let phi_rad = rng.random_range(-turn_rad..=turn_rad);
        PlaneVector::new(r_m * bearing_rad.cos(), r_m * bearing_rad.sin(), phi_rad)
    }
}

/// One moment of the push.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    /// Since the push began.
    pub t_s: f64,
    /// What the frame puts on the plate.
    pub wrench: PlaneVector,
    /// Torques of each scheme, in the order of [`Scheme::ALL`].
    pub torque_Nm: [ActuatorVector; 5],
}

/// Where Figures 3 to 7 are taken: the paper does not say; a pose where they happen.
pub fn pushed_pose() -> PlaneVector {
    // (0.1452, 0.073, 0.03) from base 1 of a device with R = 0.2 m.
    PlaneVector::new(0.1452 - 0.1 * 3f64.sqrt(), 0.073 - 0.1, 0.03)
}

/// The corners of the box from the plate's centre, metres.
pub const BOX_M: [[f64; 2]; 4] = [[0.015, 0.01], [-0.015, 0.01], [-0.015, -0.01], [0.015, -0.01]];

/// Stiffness of the frame at each corner.
const FRAME_N_PER_M: f64 = 1000.0;

/// Force in the middle of the push.
const PEAK_N: f64 = 20.0;

/// The box is pressed flat into a wall of the frame, which stands across the push, and back:
/// a half-sine of 20 N in a second. `tilt_rad` turns the box beforehand, so that one corner meets
/// the wall first and a moment is felt.
pub fn push(rig: &Rig, tilt_rad: f64) -> Result<Vec<Moment>, StudyError> {
    const STEPS: i32 = 200;
    let pose = pushed_pose();
    let capability = rig.at(&pose)?;
    let along = Vector2::new(PUSH_RAD.cos(), PUSH_RAD.sin());
    let corners = BOX_M.map(|[x, y]| {
        let (sin, cos) = (PUSH_RAD + tilt_rad).sin_cos();
        Vector2::new(cos * x - sin * y, sin * x + cos * y)
    });
    let furthest_m = corners.iter().map(|corner| corner.dot(&along)).fold(0.0, f64::max);
    let touching = corners.iter().filter(|corner| corner.dot(&along) > furthest_m - 1e-9).count();
    let most_m = PEAK_N / (FRAME_N_PER_M * touching as f64);
    let moment = |step: i32| {
        let t_s = f64::from(step) / f64::from(STEPS);
        let advance_m = most_m * (PI * t_s).sin();
        let mut wrench = PlaneVector::zeros();
        for corner in corners {
            let depth_m = corner.dot(&along) + advance_m - furthest_m;
            // What the frame does to the box is against the push.
            let force = -along * (FRAME_N_PER_M * depth_m.max(0.0));
            wrench += PlaneVector::new(force.x, force.y, corner.perp(&force));
        }
        let torque_Nm =
            Scheme::ALL.map(|scheme| scheme.torque_Nm(&capability, &wrench, &rig.weight));
        Moment { t_s, wrench, torque_Nm }
    };
    Ok((0..=STEPS).map(moment).collect())
}

/// What became of the poses of one share of the motors' range.
#[derive(Clone, Debug)]
pub struct Level {
    /// Share of the largest force in the direction asked, from and to.
    pub share: [f64; 2],
    /// How many were tried.
    pub poses: usize,
    /// How many can be given within the limits.
    pub feasible: usize,
    /// Within the limits, by scheme.
    pub solved: [usize; 5],
    /// Weighted norm over that of the exact solution, mean over the solved ones.
    pub norm_ratio: [f64; 5],
    /// Error of the force once the torques are clipped, mean over all, newtons.
    pub error_N: [f64; 5],
    /// Angle of the clipped force to the one asked, mean over all, radians.
    pub angle_rad: [f64; 5],
}

/// Shares of the range that are looked at; beyond 1 nothing can be given whole.
pub const SHARES: [[f64; 2]; 5] =
    [[0.3, 0.5], [0.5, 0.7], [0.7, 0.85], [0.85, 0.999], [1.001, 1.5]];

/// Random poses and pure forces in every share.
pub fn failures(rig: &Rig, study: &Study) -> Result<Vec<Level>, StudyError> {
    let mut rng = ChaCha8Rng::seed_from_u64(study.seed);
    SHARES.iter().map(|share| level(rig, *share, study.poses, &mut rng)).collect()
}

fn level(
    rig: &Rig,
    share: [f64; 2],
    poses: usize,
    rng: &mut ChaCha8Rng,
) -> Result<Level, StudyError> {
    let nothing = [0.0; 5];
    let mut level = Level {
        share,
        poses,
        feasible: 0,
        solved: [0; 5],
        norm_ratio: nothing,
        error_N: nothing,
        angle_rad: nothing,
    };
    let norm = |torque: &ActuatorVector| torque.component_mul(torque).dot(&rig.weight).sqrt();
    for _ in 0..poses {
        let capability = rig.at(&rig.anywhere(rng))?;
        let bearing_rad = rng.random_range(0.0..TAU);
        let direction = PlaneVector::new(bearing_rad.cos(), bearing_rad.sin(), 0.0);
        let asked = rng.random_range(share[0]..share[1]) * capability.range_N(&direction);
        let wrench = direction * asked;
        let exact = optimal_weighted(&capability, &wrench, &rig.weight);
        level.feasible += usize::from((exact.wrench - wrench).norm() < 1e-9 * asked.max(1.0));
        for (k, scheme) in Scheme::ALL.into_iter().enumerate() {
            let torque_Nm = scheme.torque_Nm(&capability, &wrench, &rig.weight);
            let clipped = capability.allocation(capability.bounds.clamp(&torque_Nm));
            let error_N = (clipped.wrench - wrench).xy().norm();
            level.error_N[k] += error_N / poses as f64;
            let angle_rad = approximation_angle(&wrench, &clipped.wrench).unwrap_or(PI);
            level.angle_rad[k] += angle_rad / poses as f64;
            if (clipped.wrench - wrench).norm() < 1e-7 * asked.max(1.0) {
                level.solved[k] += 1;
                level.norm_ratio[k] += norm(&torque_Nm) / norm(&exact.torque_Nm);
            }
        }
    }
    for (ratio, solved) in level.norm_ratio.iter_mut().zip(level.solved) {
        *ratio /= solved.max(1) as f64;
    }
    Ok(level)
}

/// How fine a force is.
#[derive(Clone, Debug)]
pub struct Resolution {
    /// Who drives.
    pub motors: &'static str,
    /// Error of the force, mean, 95 of 100 and largest, newtons.
    pub error_N: [f64; 3],
    /// Largest force in the worst direction, mean over the poses, newtons.
    pub range_N: f64,
    /// Every error, in order.
    pub errors_N: Vec<f64>,
}

/// How torques are rounded to their steps, in words: [`in_steps`].
pub const ROUNDING: &str = "The motors with the coarser step are rounded first, together, each up \
                            or down so that the finer ones have least to do; these carry what is \
                            left, within a few coarse steps.";

/// Who drives, what the largest force is measured by, and how the set is called.
const SETS: [(&str, Drives, Drives); 4] = [
    ("base motors alone", is_base, is_floating),
    ("floating motors alone", is_floating, is_floating),
    ("both", any, is_floating),
    ("both, larger forces", any, any),
];

type Drives = fn(usize) -> bool;

fn is_base(i: usize) -> bool {
    BASE.contains(&i)
}

fn is_floating(i: usize) -> bool {
    !is_base(i)
}

fn any(_: usize) -> bool {
    true
}

/// The same motors, of which only some can give torque.
fn only(all: &Capability, drives: Drives) -> Capability {
    let mut some = *all;
    for i in (0..MAX_ACTUATORS).filter(|i| !drives(*i)) {
        (some.bounds.lower_Nm[i], some.bounds.upper_Nm[i]) = (0.0, 0.0);
    }
    some
}

/// Forces up to half of what the floating motors alone can give, by the base motors alone, by
/// the floating ones alone, and by both; by both also up to half of what both can give.
pub fn resolutions(rig: &Rig, study: &Study) -> Result<Vec<Resolution>, StudyError> {
    let [coarse, fine] = study.steps_Nm;
    let steps = ActuatorVector::from_fn(|i, _| if is_base(i) { coarse } else { fine });
    let mut found = Vec::new();
    for (motors, drives, reach) in SETS {
        let mut rng = ChaCha8Rng::seed_from_u64(study.seed.wrapping_add(1));
        let (mut errors_N, mut range_N) = (Vec::new(), 0.0);
        for _ in 0..study.poses {
            let all = rig.at(&rig.anywhere(&mut rng))?;
            let bearing_rad = rng.random_range(0.0..TAU);
            let direction = PlaneVector::new(bearing_rad.cos(), bearing_rad.sin(), 0.0);
            let most_N = only(&all, reach).range_N(&direction);
            let wanted = direction * (rng.random_range(0.0..0.5) * most_N);
            let driven = only(&all, drives);
            let exact = optimal_weighted(&driven, &wanted, &rig.weight).torque_Nm;
            let given = in_steps(&driven, &wanted, &exact, &steps, &rig.weight);
            errors_N.push((given.wrench - wanted).xy().norm());
            range_N += worst_N(&driven) / study.poses as f64;
        }
        errors_N.sort_by(f64::total_cmp);
        let mean_N = errors_N.iter().fold(0.0, |sum, N| sum + N) / errors_N.len().max(1) as f64;
        let at = |share: f64| {
            let last = errors_N.len().saturating_sub(1) as f64;
            errors_N.get((share * last) as usize).copied().unwrap_or(0.0)
        };
        let error_N = [mean_N, at(0.95), at(1.0)];
        found.push(Resolution { motors, error_N, range_N, errors_N });
    }
    Ok(found)
}

fn worst_N(capability: &Capability) -> f64 {
    let range = |k: i32| {
        let angle_rad = PI * f64::from(k) / 36.0;
        capability.range_N(&PlaneVector::new(angle_rad.cos(), angle_rad.sin(), 0.0))
    };
    (0..36).map(range).fold(f64::INFINITY, f64::min)
}

/// Condition numbers at one pose, moments on [`LENGTH_M`].
#[derive(Clone, Copy, Debug)]
pub struct Condition {
    /// Where.
    pub p_BH: PlaneVector,
    /// On the three base motors.
    pub three: f64,
    /// On all six.
    pub six: f64,
}

/// At random poses.
pub fn conditions(rig: &Rig, study: &Study) -> Result<Vec<Condition>, StudyError> {
    let mut rng = ChaCha8Rng::seed_from_u64(study.seed.wrapping_add(2));
    (0..study.poses).map(|_| condition(rig, rig.anywhere(&mut rng))).collect()
}

/// On a square lattice of places with the plate turned by `phi_rad`; places beyond the reach are
/// left out.
pub fn condition_map(rig: &Rig, phi_rad: f64, step_m: f64) -> Vec<Condition> {
    let (_, reach_m) = rig.definition.mechanism.reach_m();
    let count = (1.75 * reach_m / step_m) as i32;
    let places = (-count..=count).flat_map(|i| (-count..=count).map(move |j| (i, j)));
    let place = |(i, j)| PlaneVector::new(step_m * f64::from(i), step_m * f64::from(j), phi_rad);
    places.filter_map(|ij| condition(rig, place(ij)).ok()).collect()
}

fn condition(rig: &Rig, p_BH: PlaneVector) -> Result<Condition, StudyError> {
    let mut R = rig.at(&p_BH)?.reference;
    R.row_mut(2).unscale_mut(LENGTH_M);
    let three = Matrix3::from_fn(|i, j| R[(i, BASE[j])]);
    let ratio = |values: nalgebra::Vector3<f64>| values.max() / values.min();
    let six = ratio(R.svd(false, false).singular_values);
    Ok(Condition { p_BH, three: ratio(three.svd(false, false).singular_values), six })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn small() -> (Study, Rig) {
        let study = Study { poses: 150, ..Study::default() };
        let rig = Rig::new(&study).unwrap();
        (study, rig)
    }

    fn peak_Nm(push: &[Moment], scheme: usize, motor: usize) -> f64 {
        push.iter().map(|moment| moment.torque_Nm[scheme][motor].abs()).fold(0.0, f64::max)
    }

    /// Figures 4 to 7 in kind, with the numbers of the reference case: weights spare a floating
    /// motor, the limit holds another one.
    #[test]
    fn the_story_of_the_figures_is_the_papers() {
        let (_, rig) = small();
        let flat = push(&rig, 0.0).unwrap();
        let most_N = flat.iter().map(|moment| moment.wrench.xy().norm()).fold(0.0, f64::max);
        assert!((most_N - 20.0).abs() < 1e-9 && flat[100].wrench.z.abs() < 1e-9, "{most_N}");
        let floating = |scheme| [1, 3, 5].map(|motor| peak_Nm(&flat, scheme, motor));
        let (least, weighted, limited) = (floating(0), floating(1), floating(2));
        assert!((least[0] - 0.539).abs() < 5e-4 && (weighted[0] - 0.359).abs() < 5e-4, "{least:?}");
        assert!((least[1] - 0.760).abs() < 5e-4 && (weighted[1] - 0.475).abs() < 5e-4);
        assert!((limited[1] - 0.4).abs() < 1e-9 && limited.iter().all(|torque| *torque < 0.4001));
    }

    #[test]
    fn a_box_that_meets_the_frame_by_a_corner_is_felt_as_a_moment() {
        let (_, rig) = small();
        let tilted = push(&rig, 0.2).unwrap();
        let most_Nm = tilted.iter().map(|moment| moment.wrench.z.abs()).fold(0.0, f64::max);
        assert!((0.05..0.4).contains(&most_Nm), "{most_Nm}");
    }

    #[test]
    fn every_scheme_fails_where_the_published_ones_do_and_the_exact_one_never() {
        let (study, rig) = small();
        let levels = failures(&rig, &study).unwrap();
        for level in &levels[..4] {
            assert_eq!(level.feasible, level.poses, "{level:?}");
            assert_eq!(level.solved[4], level.poses, "{level:?}");
            assert!(level.solved[2] <= level.solved[3] && level.solved[1] <= level.solved[2]);
            assert!(level.norm_ratio[3] < 1.2, "{level:?}");
        }
        let full = &levels[3];
        assert!(
            full.solved[2] < full.poses / 2 && full.solved[3] > 9 * full.poses / 10,
            "{full:?}"
        );
        let beyond = &levels[4];
        assert_eq!((beyond.feasible, beyond.solved), (0, [0; 5]));
        assert!(beyond.error_N[4] > 0.0 && beyond.error_N[4] <= beyond.error_N[1]);
    }

    #[test]
    fn fine_motors_beside_coarse_ones_make_a_strong_force_fine() {
        let (study, rig) = small();
        let [base, floating, both, wide] = resolutions(&rig, &study).unwrap().try_into().unwrap();
        assert!(base.error_N[0] > 10.0 * both.error_N[0], "{:?} {:?}", base.error_N, both.error_N);
        assert!(both.range_N > 2.0 * floating.range_N, "{} {}", both.range_N, floating.range_N);
        // Stronger forces leave the floating motors less room; they still help.
        assert!(base.error_N[0] > 2.0 * wide.error_N[0], "{:?} {:?}", base.error_N, wide.error_N);
        assert!(wide.errors_N != both.errors_N && wide.range_N == both.range_N);
    }

    /// Kim 2003's claim: three motors are singular inside the workspace, six are not.
    #[test]
    fn six_motors_are_well_conditioned_where_three_are_singular() {
        let (study, rig) = small();
        let found = conditions(&rig, &Study { poses: 2000, ..study }).unwrap();
        let worst = |of: fn(&Condition) -> f64| found.iter().map(of).fold(0.0, f64::max);
        let (three, six) = (worst(|found| found.three), worst(|found| found.six));
        assert!((1.5..60.0).contains(&six), "{six}");
        assert!(three > 100.0, "{three}");
        assert!(condition_map(&rig, 0.0, 0.01).len() > 50);
    }

    #[test]
    fn another_linkage_is_refused_by_name() {
        let study = Study { device: "cho-2005".to_owned(), ..Study::default() };
        let error = Rig::new(&study).unwrap_err().to_string();
        assert!(error.contains("cho-2005") && error.contains("six"), "{error}");
    }
}

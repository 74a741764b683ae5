//! What this run computes for the page of Kim et al. 2003.
//!
//! SI units; wrenches at the plate's centre. The study itself is
//! [`crate::analysis::experiment::force_distribution`]; this adds what the paper's sentences
//! ask beyond it: how Eq 2 as printed behaves, whether the pose of the figures is a special one,
//! and what the radius of the base circle, which the paper does not give, changes.

use std::f64::consts::{FRAC_PI_6, PI, TAU};

use nalgebra::{Matrix3, SMatrix, Vector2, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::analysis::design::mobility::mobility_of;
use crate::analysis::experiment::force_distribution::{
    Condition, LENGTH_M, Level, Moment, Resolution, Rig, Scheme, Study, StudyError, conditions,
    failures, push, resolutions,
};
use crate::config::DeviceDefinition;
use crate::mechanism::{Inertia, PSI_RAD, ThreeRrr, ThreeRrrParameters};
use crate::notation::{MAX_ACTUATORS, PlaneVector};

/// The box is turned by this much where it is to meet the frame by a corner.
pub const TILT_RAD: f64 = 0.2;

/// Force of the pushes that are tried at random poses: that of the figures.
const PUSH_N: f64 = 20.0;

/// Radii of the base circle that are tried.
const RADII_M: [f64; 3] = [0.15, 0.2, 0.25];

/// Smallest over largest singular value of the map from torques to wrenches, over random poses.
#[derive(Clone, Copy, Debug)]
pub struct Ranks {
    /// Poses in which both are there.
    pub poses: usize,
    /// Eq 2 as printed, largest.
    pub printed: f64,
    /// With the plate's joints apart, smallest.
    pub mended: f64,
}

/// The figures' push at random poses and in random directions.
#[derive(Clone, Copy, Debug, Default)]
pub struct Story {
    /// How many pushes.
    pub pushes: usize,
    /// The largest floating torque is less with weights than without.
    pub lowered: usize,
    /// A floating motor beyond its limit without weights.
    pub over_least_norm: usize,
    /// One is beyond its limit with weights, too.
    pub over_weighted: usize,
    /// Of those the one-joint null space brings every motor within its limits.
    pub mended_once: usize,
    /// Of those the exact solution does.
    pub mended_exactly: usize,
}

/// Condition numbers with one radius of the base circle.
#[derive(Clone, Copy, Debug)]
pub struct Spread {
    /// Of the base circle.
    pub radius_m: f64,
    /// On three motors: median and largest.
    pub three: [f64; 2],
    /// On six: median and largest.
    pub six: [f64; 2],
}

/// All figures of the page.
#[derive(Clone, Debug)]
pub struct Kim {
    /// What was studied.
    pub study: Study,
    /// By Eq 1.
    pub mobility: i64,
    /// Actuators that it has.
    pub actuators: usize,
    /// Of the printed and the mended Eq 2.
    pub ranks: Ranks,
    /// The flat push and the one by a corner.
    pub pushes: [Vec<Moment>; 2],
    /// Largest torque of every motor under every scheme of the flat push.
    pub peak_Nm: [[f64; MAX_ACTUATORS]; 5],
    /// Norm of all torques in the middle of the flat push, by scheme.
    pub norm_Nm: [f64; 5],
    /// Largest moment that is felt where a corner meets the frame first.
    pub moment_Nm: f64,
    /// At random poses.
    pub story: Story,
    /// Keeping to the limits, by share of the range.
    pub levels: Vec<Level>,
    /// Base motors alone, floating alone, both, both over their own range.
    pub resolutions: Vec<Resolution>,
    /// At random poses, for each radius of the base circle.
    pub spreads: Vec<Spread>,
}

/// Computes everything with so many random poses for each count.
pub fn measure(poses: usize) -> Result<Kim, StudyError> {
    let study = Study { poses, ..Study::default() };
    let rig = Rig::new(&study)?;
    let pushes = [push(&rig, 0.0)?, push(&rig, TILT_RAD)?];
    let flat = &pushes[0];
    let peak = |scheme: usize, motor: usize| {
        flat.iter().map(|moment| moment.torque_Nm[scheme][motor].abs()).fold(0.0, f64::max)
    };
    let peak_Nm = std::array::from_fn(|k| std::array::from_fn(|motor| peak(k, motor)));
    let norm_Nm = flat[flat.len() / 2].torque_Nm.map(|torque_Nm| torque_Nm.norm());
    let moment_Nm = pushes[1].iter().map(|moment| moment.wrench.z.abs()).fold(0.0, f64::max);
    Ok(Kim {
        mobility: mobility_of("three-rrr").unwrap_or_default(),
        actuators: MAX_ACTUATORS,
        ranks: ranks(study.seed, poses),
        peak_Nm,
        norm_Nm,
        moment_Nm,
        story: story(&rig, &study)?,
        levels: failures(&rig, &study)?,
        resolutions: resolutions(&rig, &study)?,
        spreads: spreads(&study)?,
        pushes,
        study,
    })
}

/// Torques of a chain to wrenches at the plate: rows 1 and 2 of the inverse of its Jacobian, with
/// its plate joint at `joint` from the plate's centre.
fn chain_rows(
    base: Vector2<f64>,
    p: Vector2<f64>,
    joint: Vector2<f64>,
) -> Option<[Vector3<f64>; 2]> {
    const LINK_M: f64 = 0.1;
    let reach = p + joint - base;
    let half = 0.5 * reach.norm() / LINK_M;
    let lean = (half < 1.0).then(|| half.acos())?;
    let at = reach.y.atan2(reach.x) - lean;
    let elbow = base + LINK_M * Vector2::new(at.cos(), at.sin());
    let column = |from: Vector2<f64>| {
        let arm = p - from;
        Vector3::new(-arm.y, arm.x, 1.0)
    };
    let G = Matrix3::from_columns(&[column(base), column(elbow), column(p + joint)]);
    let inverse = G.try_inverse()?;
    Some([0, 1].map(|row| inverse.row(row).transpose()))
}

/// Smallest over largest singular value with these plate offsets.
fn ratio(p: Vector2<f64>, phi_rad: f64, offsets_rad: [f64; 3]) -> Option<f64> {
    const BASE_M: f64 = 0.15;
    let mut map = SMatrix::<f64, 3, 6>::zeros();
    for (i, offset_rad) in offsets_rad.into_iter().enumerate() {
        let (sin, cos) = (FRAC_PI_6 + TAU * i as f64 / 3.0).sin_cos();
        let turned = phi_rad + offset_rad;
        let joint = -0.1 * Vector2::new(turned.cos(), turned.sin());
        let rows = chain_rows(-BASE_M * Vector2::new(cos, sin), p, joint)?;
        for (k, row) in rows.into_iter().enumerate() {
            let wrench = Vector3::new(row.x, row.y, row.z / LENGTH_M);
            map.set_column(2 * i + k, &wrench);
        }
    }
    let values = map.singular_values();
    Some(values.min() / values.max())
}

/// Eq 2 as printed has no offsets: all chains end in the same joint of the plate.
fn ranks(seed: u64, poses: usize) -> Ranks {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut found = Ranks { poses: 0, printed: 0.0, mended: f64::INFINITY };
    for _ in 0..poses {
        let mut any = || Vector2::from_fn(|_, _| rng.random_range(-0.02..0.02));
        let place = any();
        let phi_rad = rng.random_range(-0.3..0.3f64);
        // The common joint, not the plate's centre, has to be within reach.
        let centre = place + 0.1 * Vector2::new(phi_rad.cos(), phi_rad.sin());
        let both = ratio(centre, phi_rad, [0.0; 3]).zip(ratio(place, phi_rad, PSI_RAD));
        if let Some((printed, mended)) = both {
            found.poses += 1;
            found.printed = found.printed.max(printed);
            found.mended = found.mended.min(mended);
        }
    }
    found
}

fn story(rig: &Rig, study: &Study) -> Result<Story, StudyError> {
    let mut rng = ChaCha8Rng::seed_from_u64(study.seed + 3);
    let mut found = Story { pushes: study.poses, ..Story::default() };
    let floating = |torque: &crate::notation::ActuatorVector| {
        [1, 3, 5].into_iter().map(|i| torque[i].abs()).fold(0.0, f64::max)
    };
    for _ in 0..study.poses {
        let capability = rig.at(&rig.anywhere(&mut rng))?;
        let bearing_rad: f64 = rng.random_range(-PI..PI);
        let wrench = PlaneVector::new(bearing_rad.cos(), bearing_rad.sin(), 0.0) * PUSH_N;
        let torque = |scheme: Scheme| scheme.torque_Nm(&capability, &wrench, &rig.weight);
        let within = |scheme: Scheme| {
            let torque_Nm = torque(scheme);
            let clipped = capability.allocation(capability.bounds.clamp(&torque_Nm));
            (clipped.wrench - wrench).norm() < 1e-7 * PUSH_N
        };
        let [least, weighted] = [Scheme::LeastNorm, Scheme::Weighted].map(|s| floating(&torque(s)));
        let limit_Nm = study.limits_Nm[1] + 1e-9;
        found.lowered += usize::from(weighted < least);
        found.over_least_norm += usize::from(least > limit_Nm);
        if weighted > limit_Nm {
            found.over_weighted += 1;
            found.mended_once += usize::from(within(Scheme::NullSpace));
            found.mended_exactly += usize::from(within(Scheme::Exact));
        }
    }
    Ok(found)
}

/// Condition numbers with base circles of several radii.
fn spreads(study: &Study) -> Result<Vec<Spread>, StudyError> {
    RADII_M.into_iter().map(|radius_m| spread(study, radius_m)).collect()
}

fn spread(study: &Study, radius_m: f64) -> Result<Spread, StudyError> {
    let mut definition = DeviceDefinition::load(&study.device)?;
    let parameters = ThreeRrrParameters {
        base_m: radius_m,
        l_m: [0.1; 3],
        turn_rad: definition.mechanism.turn_rad(),
        elbows: [1; 3],
    };
    if let Ok(device) = ThreeRrr::new(parameters, Inertia::default()) {
        definition.mechanism = std::sync::Arc::new(device);
    }
    let rig = Rig::of(definition, study)?;
    let found = conditions(&rig, study)?;
    let ends = |of: fn(&Condition) -> f64| {
        let mut all: Vec<f64> = found.iter().map(of).collect();
        all.sort_by(f64::total_cmp);
        [all[all.len() / 2], all[all.len() - 1]]
    };
    Ok(Spread { radius_m, three: ends(|one| one.three), six: ends(|one| one.six) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equation_2_as_printed_loses_a_rank_everywhere_and_the_mended_one_nowhere() {
        let Ranks { poses, printed, mended } = ranks(1, 300);
        assert!(poses == 300 && printed < 1e-10, "{poses} {printed}");
        assert!((0.005..0.5).contains(&mended), "{mended}");
    }

    #[test]
    fn the_rows_of_a_chain_are_those_of_the_linkage() {
        let parameters =
            ThreeRrrParameters { base_m: 0.15, l_m: [0.1; 3], turn_rad: 0.5, elbows: [1; 3] };
        let device = ThreeRrr::new(parameters, Inertia::default()).unwrap();
        let pose = PlaneVector::new(0.01, -0.015, 0.2);
        let posture = crate::mechanism::Mechanism::posture_at(&device, &pose).unwrap();
        let joint_rad = 0.2 + PSI_RAD[0];
        let joint = -0.1 * Vector2::new(joint_rad.cos(), joint_rad.sin());
        let base = -0.15 * Vector2::new(PSI_RAD[0].cos(), PSI_RAD[0].sin());
        let rows = chain_rows(base, pose.xy(), joint).unwrap();
        for (k, row) in rows.into_iter().enumerate() {
            assert!((row - posture.reference.column(k)).norm() < 1e-9, "{row} {k}");
        }
    }
}

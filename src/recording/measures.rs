//! One run as moments in the device's plane, and the figures of how it went.
//!
//! Everything is taken from reports, the recorded run's and the simulated ones' alike, so that
//! they can be set side by side; only the force that really was at the handle is known of a
//! simulated one alone. Vectors are in B, the tool at T.

use nalgebra::{Vector2, Vector3};

use crate::analysis::smoothness::{STUCK_M_PER_S, largest_step, root_mean, squared_jerks};
use crate::control::Plan;
use crate::notation::PlaneVector;
use crate::proto::{RecordReport, Region};

/// A tool that leaves a surface for fewer ticks than this is still at it: under a law that
/// chatters it jumps.
const SHORTEST_LEAVE: usize = 50;

/// One tick of a run.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    /// Since the beginning.
    pub time_s: f64,
    /// Tool point.
    pub p_m: Vector2<f64>,
    /// Its velocity.
    pub v_m_per_s: Vector2<f64>,
    /// What the hand does, where it is measured.
    pub hand_N: Option<Vector2<f64>>,
    /// What was asked, raw.
    pub asked_N: Vector2<f64>,
    /// What the law chose.
    pub given_N: Vector2<f64>,
    /// What the actuators did to the handle, where it is known.
    pub truth_N: Option<Vector2<f64>>,
    /// Out of the surfaces; `None`: nothing is touched.
    pub normal: Option<Vector2<f64>>,
    /// Of the deepest surface.
    pub depth_m: f64,
    /// Between what was asked and what the law chose.
    pub angle_rad: Option<f64>,
    /// Of the request.
    pub region: Region,
}

/// Figures of a run, all but the first of the time in which a surface is touched; `None` where
/// nothing ever is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Measures {
    /// How long that is.
    pub touching_s: f64,
    /// Part of it below 1 mm/s along the surface.
    pub stuck_share: Option<f64>,
    /// Deepest.
    pub penetration_mm: Option<f64>,
    /// What the hand pulls along the surface; `None`: not measured.
    pub along_mean_N: Option<f64>,
    /// Largest.
    pub along_max_N: Option<f64>,
    /// Mean, where it is defined.
    pub angle_mean_deg: Option<f64>,
    /// Of the tool point.
    pub jerk_rms_m_per_s3: Option<f64>,
    /// Largest change, in one tick, of what the law chose.
    pub chosen_step_N: Option<f64>,
    /// Of the force at the handle; `None`: not known.
    pub step_N: Option<f64>,
}

impl Moment {
    /// A report in the plane of `plan`; `None` for one that has not its numbers.
    pub(super) fn of(report: &RecordReport, plan: &Plan, time_s: f64) -> Option<Self> {
        let in_plane = |numbers: &[f64]| -> Option<Vector2<f64>> {
            let &[x, y, z, ..] = numbers else { return None };
            Some(plan.W_to_plane(&Vector3::new(x, y, z)).0.xy())
        };
        let &[x, y, z] = report.position_m.as_slice() else { return None };
        let at = Vector3::new(x, y, z) - plan.mount.p_WB_m;
        let &[px, py, pz] = report.proxy_m.as_slice() else { return None };
        let out = Vector3::new(px - x, py - y, pz - z);
        let touching = !report.contacts.is_empty();
        let normal = plan.W_to_plane(&out).0.xy().try_normalize(1e-12).filter(|_| touching);
        let depths_m = report.contacts.iter().filter_map(|contact| contact.depth_m);
        Some(Self {
            time_s,
            p_m: plan.W_to_plane(&at).0.xy(),
            v_m_per_s: in_plane(&report.velocity_m_per_s)?,
            hand_N: in_plane(&report.hand),
            asked_N: in_plane(&report.requested)?,
            given_N: in_plane(&report.achievable)?,
            truth_N: None,
            normal,
            depth_m: depths_m.fold(0.0, f64::max),
            angle_rad: report.approximation_angle_rad,
            region: report.region(),
        })
    }
}

fn padded(v: &Vector2<f64>) -> PlaneVector {
    PlaneVector::new(v.x, v.y, 0.0)
}

/// The figures of a run whose moments are `tick_s` apart.
pub fn measure(moments: &[Moment], tick_s: f64) -> Measures {
    let mut figures = Measures::default();
    let (mut touching, mut stuck) = (0, 0);
    let (mut along_N, mut angles_rad, mut jerks) = (Vec::new(), Vec::new(), Vec::new());
    let mut steps_N = Vec::new();
    for stretch in stretches(moments) {
        touching += stretch.len();
        let mut last = None;
        for moment in stretch {
            last = moment.normal.or(last);
            let Some(normal) = last else { continue };
            let tangent = Vector2::new(-normal.y, normal.x);
            stuck += usize::from(moment.v_m_per_s.dot(&tangent).abs() < STUCK_M_PER_S);
            along_N.extend(moment.hand_N.map(|hand_N| hand_N.dot(&tangent).abs()));
            angles_rad.extend(moment.angle_rad);
            let depth_mm = 1e3 * moment.depth_m;
            figures.penetration_mm =
                Some(figures.penetration_mm.map_or(depth_mm, |most_mm| most_mm.max(depth_mm)));
        }
        let of = |read: fn(&Moment) -> Vector2<f64>| -> Vec<PlaneVector> {
            stretch.iter().map(|moment| padded(&read(moment))).collect()
        };
        jerks.extend(squared_jerks(&of(|moment| moment.v_m_per_s), tick_s));
        let chosen_N = largest_step(&of(|moment| moment.given_N));
        figures.chosen_step_N =
            Some(figures.chosen_step_N.map_or(chosen_N, |most_N| most_N.max(chosen_N)));
        let truth_N: Vec<_> =
            stretch.iter().filter_map(|m| m.truth_N.as_ref().map(padded)).collect();
        steps_N.extend((!truth_N.is_empty()).then(|| largest_step(&truth_N)));
    }
    figures.touching_s = touching as f64 * tick_s;
    figures.stuck_share = (touching > 0).then(|| stuck as f64 / touching as f64);
    figures.along_mean_N = mean(&along_N);
    figures.along_max_N = along_N.iter().copied().reduce(f64::max);
    figures.angle_mean_deg = mean(&angles_rad).map(f64::to_degrees);
    // A touch may be too short to have one.
    figures.jerk_rms_m_per_s3 = (!jerks.is_empty()).then(|| root_mean(&jerks));
    figures.step_N = steps_N.into_iter().reduce(f64::max);
    figures
}

fn mean(all: &[f64]) -> Option<f64> {
    (!all.is_empty()).then(|| all.iter().fold(0.0, |sum, one| sum + one) / all.len() as f64)
}

/// Where something is touched; each begins with a touch.
fn stretches(moments: &[Moment]) -> impl Iterator<Item = &[Moment]> {
    let mut rest = moments;
    std::iter::from_fn(move || {
        let begin = rest.iter().position(|moment| moment.normal.is_some())?;
        rest = &rest[begin..];
        let free = |some: &[Moment]| some.iter().all(|moment| moment.normal.is_none());
        let end = rest.windows(SHORTEST_LEAVE).position(free).unwrap_or(rest.len());
        let (stretch, after) = rest.split_at(end);
        rest = after;
        Some(stretch)
    })
}

//! Which States a receiver can do without: it would feel and see the same.
//!
//! What is rendered is sent again when it has left the share `k` of what was sent last (Weber's
//! law: Hinterseer et al. 2008, IEEE 1918.1.1), the pose when it has left where the receiver
//! takes it to be, going on with the velocity that it was sent. Whatever is not a matter of
//! degree, a touch above all, is sent at once; and something every 20 ms, for those who lost the
//! last. All of it in the device's world and time.

use nalgebra::{UnitQuaternion, Vector3};

use crate::control::{ContactResult, Mode, RenderedSource, Report};
use crate::environment::MAX_TOUCHES;
use crate::units::{FieldError, Range};

use super::Quality;
use crate::proto::SessionState;

/// `k`: below, noise alone is sent; above, everybody feels it.
const SHARE: Range = Range::new(0.01, 0.5, "(share)");

/// What is weaker counts as this much: the noise of a sensor (0.05 N rms each way in the
/// simulated one) is no news at a share of a tenth.
pub(super) const LEAST_FORCE_N: f64 = 2.5;

/// Half a millimetre and half a degree.
const POSE_M: f64 = 0.5e-3;
const POSE_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;

/// Something is sent at least as often.
const HEARTBEAT_NS: u64 = 20_000_000;

/// What one receiver was sent last.
#[derive(Clone, Copy, Debug)]
pub(super) struct Deadband {
    share: f64,
    sent: Option<Sent>,
}

/// What is not a matter of degree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Marks {
    pub session: SessionState,
    pub quality: Quality,
    pub newest_event: u64,
    mode: Mode,
    stuck: bool,
    buttons: u32,
    scene_revision: u64,
    source: RenderedSource,
    touches: [Option<(bool, u32, bool)>; MAX_TOUCHES],
}

#[derive(Clone, Copy, Debug)]
struct Sent {
    time_ns: u64,
    p_m: Vector3<f64>,
    q: UnitQuaternion<f64>,
    v_m_per_s: Vector3<f64>,
    omega_rad_per_s: Vector3<f64>,
    force_N: Vector3<f64>,
    marks: Marks,
}

impl Deadband {
    /// What a Hello asks for; 0: every State is sent.
    pub fn agree(share: f32) -> Result<Option<Self>, FieldError> {
        if share == 0.0 {
            return Ok(None);
        }
        let share = SHARE.check("deadband", share.into())?;
        Ok(Some(Self { share, sent: None }))
    }

    /// True when this State is to be sent, and taken as sent then. `wider`: times the share and
    /// the bounds of the pose, on a bad path.
    pub fn due(&mut self, report: &Report, marks: Marks, wider: f64) -> bool {
        let due = self.sent.is_none_or(|sent| sent.is_left(report, &marks, self.share, wider));
        if due {
            self.sent = Some(Sent::of(report, marks));
        }
        due
    }
}

impl Marks {
    /// Of a report, beside what is the session's own.
    pub fn of(report: &Report, session: SessionState, quality: Quality, newest_event: u64) -> Self {
        let mut touches = [None; MAX_TOUCHES];
        for (place, contact) in touches.iter_mut().zip(report.contacts()) {
            let ContactResult { source, id, sticking, .. } = *contact;
            *place = Some((source == crate::environment::Source::Scene, id, sticking));
        }
        Self {
            session,
            quality,
            newest_event,
            mode: report.mode,
            stuck: report.stuck,
            buttons: report.buttons,
            scene_revision: report.scene_revision,
            source: report.rendered_source,
            touches,
        }
    }
}

/// What is felt, or else what is given.
fn force_N(report: &Report) -> Vector3<f64> {
    let unknown = report.rendered_source == RenderedSource::Unknown;
    if unknown { report.achievable.force_N } else { report.rendered.force_N }
}

impl Sent {
    fn of(report: &Report, marks: Marks) -> Self {
        Self {
            time_ns: report.time_ns,
            p_m: report.p_WT_m,
            q: report.q_WT,
            v_m_per_s: report.v_WT_m_per_s,
            omega_rad_per_s: report.omega_WT_rad_per_s,
            force_N: force_N(report),
            marks,
        }
    }

    /// Whether a receiver that has this would be wrong by now.
    fn is_left(&self, report: &Report, marks: &Marks, share: f64, wider: f64) -> bool {
        let since_ns = report.time_ns.saturating_sub(self.time_ns);
        if since_ns >= HEARTBEAT_NS || *marks != self.marks {
            return true;
        }
        let since_s = since_ns as f64 * 1e-9;
        let away_m = (report.p_WT_m - self.p_m - self.v_m_per_s * since_s).norm();
        let turned = UnitQuaternion::from_scaled_axis(self.omega_rad_per_s * since_s) * self.q;
        let away_rad = turned.angle_to(&report.q_WT);
        let changed_N = (force_N(report) - self.force_N).norm();
        let most_N = share * self.force_N.norm().max(LEAST_FORCE_N);
        let within =
            changed_N <= wider * most_N && away_m <= wider * POSE_M && away_rad <= wider * POSE_RAD;
        // What is not a number is not within.
        !within
    }
}

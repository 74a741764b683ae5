//! Which States a receiver can do without: it would feel and see the same.
//!
//! What is rendered is sent again when it has left the share `k` of what was sent last (Weber's
//! law: Hinterseer et al. 2008, IEEE 1918.1.1), the pose when it has left where the receiver
//! takes it to be, going on with the velocity that it was sent. Whatever is not a matter of
//! degree, a touch above all, is sent at once; and something every 20 ms, for those who lost the
//! last. All of it in the device's world and time.

use nalgebra::{UnitQuaternion, Vector3};

use crate::control::{ContactResult, Mode, RenderedSource, Report, Wrench};
use crate::environment::MAX_TOUCHES;
use crate::units::{FieldError, Range};

use super::Quality;
use crate::proto::SessionState;

/// `k`: below, noise alone is sent; above, everybody feels it.
const SHARE: Range = Range::new(0.01, 0.5, "(share)");

/// What is weaker counts as this much: the noise of a sensor (0.05 N rms each way in the
/// simulated one) is no news at a share of a tenth.
pub(super) const LEAST_FORCE_N: f64 = 2.5;

/// The same of a moment: that force at a lever of a tenth of a metre.
const LEAST_MOMENT_NM: f64 = 0.1 * LEAST_FORCE_N;

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
    wrench: Wrench,
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
fn wrench(report: &Report) -> Wrench {
    let unknown = report.rendered_source == RenderedSource::Unknown;
    if unknown { report.achievable } else { report.rendered }
}

/// Whether it is within this share of what was sent.
fn is_near(now: &Vector3<f64>, sent: &Vector3<f64>, share: f64, least: f64) -> bool {
    (now - sent).norm() <= share * sent.norm().max(least)
}

impl Sent {
    fn of(report: &Report, marks: Marks) -> Self {
        Self {
            time_ns: report.time_ns,
            p_m: report.p_WT_m,
            q: report.q_WT,
            v_m_per_s: report.v_WT_m_per_s,
            omega_rad_per_s: report.omega_WT_rad_per_s,
            wrench: wrench(report),
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
        let (now, sent, share) = (wrench(report), &self.wrench, wider * share);
        let within = is_near(&now.force_N, &sent.force_N, share, LEAST_FORCE_N)
            && is_near(&now.moment_Nm, &sent.moment_Nm, share, LEAST_MOMENT_NM)
            && away_m <= wider * POSE_M
            && away_rad <= wider * POSE_RAD;
        // What is not a number is not within.
        !within
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report() -> Report {
        Report {
            time_ns: 1_000_000,
            rendered_source: RenderedSource::Measured,
            ..Report::default()
        }
    }

    /// Whether this is news for who was sent the report as it was.
    fn is_news(wider: f64, before: &Report, now: &Report) -> bool {
        let mut deadband = Deadband::agree(0.1).unwrap().unwrap();
        let marks = Marks::of(before, SessionState::Commanding, Quality::Good, 0);
        assert!(deadband.due(before, marks, wider), "the first");
        assert!(!deadband.due(before, marks, wider), "the same again");
        deadband.due(now, marks, wider)
    }

    #[test]
    fn each_bound_is_kept_and_as_many_times_as_wide_on_a_path_that_is_slowed() {
        let mut before = report();
        before.rendered.force_N.x = 30.0;
        before.rendered.moment_Nm.z = 2.0;
        type Change = fn(&mut Report, f64);
        let changes: [(&str, Change); 4] = [
            ("force, a tenth of 30 N", |report, part| report.rendered.force_N.y += 3.0 * part),
            ("moment, a tenth of 2 N m", |report, part| report.rendered.moment_Nm.x += 0.2 * part),
            ("half a millimetre", |report, part| report.p_WT_m.x += 0.5e-3 * part),
            ("half a degree", |report, part| report.q_WT = turned(0.5 * part)),
        ];
        for (what, change) in changes {
            for wider in [1.0, 2.0, 4.0] {
                let at = |part: f64| {
                    let mut now = before;
                    change(&mut now, wider * part);
                    is_news(wider, &before, &now)
                };
                assert!(at(1.01) && !at(0.99), "{what}, {wider} times as wide");
            }
        }
    }

    fn turned(degrees: f64) -> UnitQuaternion<f64> {
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), degrees.to_radians())
    }

    #[test]
    fn what_is_weak_counts_as_the_noise_of_a_sensor() {
        let before = report();
        let with = |force_N: f64, moment_Nm: f64| {
            let mut now = before;
            now.rendered.force_N.x = force_N;
            now.rendered.moment_Nm.z = moment_Nm;
            is_news(1.0, &before, &now)
        };
        assert!(!with(0.24, 0.024) && with(0.26, 0.0) && with(0.0, 0.026));
        assert!(with(f64::NAN, 0.0), "what is not a number is told");
    }
}

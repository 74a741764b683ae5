//! What a controller's command is still worth: fresh, fading, or gone; and the clutch.
//!
//! ```text
//!          newer command             time-to-live over, released, or clutched
//!   Gone ────────────────▶ Fresh ─────────────────────────────────▶ Fading ──▶ Gone
//!                            ▲             newer command               │ ramp over
//!                            └─────────────────────────────────────────┘
//! ```
//!
//! Time-to-live alone decides when a force goes. While it fades, the *sum* of what the
//! controller asks is capped by the sum that it had, falling to zero along the ramp: a
//! stiffness that faded would keep a stiff wall until the very end and then drop it.
//!
//! A clutch fades everything that is rendered along the same ramp, the resident scene too,
//! and keeps it away for as long as the clutched command is fresh. Whoever comes back, from
//! a fade or from a clutch, is told of it: its surfaces have to begin anew, so that the
//! force does not step back up.

use serde::{Deserialize, Serialize};

use super::Setpoint;

/// How much of the controller's command, and of everything, is rendered.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Authority {
    command: Phase,
    /// Of everything that is rendered.
    clutch: Phase,
}

impl Default for Authority {
    fn default() -> Self {
        Self { command: Phase::Gone, clutch: Phase::Fresh }
    }
}

/// A force that may be there.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
enum Phase {
    /// None of it.
    Gone,
    /// All of it.
    Fresh,
    /// At most this force, and less every tick; along the ramp that was set when it began, so
    /// that a longer one set meanwhile does not raise it.
    Fading { since_ns: u64, force_N: f64, ramp_ns: u64 },
}

/// What became of the command in one tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Change {
    /// It has just run out by itself.
    pub ran_out: bool,
    /// A newer one took over from one that was fading.
    pub returned: bool,
    /// A clutch has just ended.
    pub declutched: bool,
}

/// Forces of the last tick, from which a fade begins; sums of lengths, newtons.
#[derive(Clone, Copy, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct Before {
    /// What the controller asked, after clipping.
    pub controller_N: f64,
    /// What everybody asked, after clipping.
    pub total_N: f64,
}

impl Authority {
    /// One tick on.
    pub fn advance(
        &mut self,
        setpoint: &Setpoint,
        now_ns: u64,
        ramp_ns: u64,
        before: Before,
    ) -> Change {
        let clutched = setpoint.clutched && setpoint.is_fresh(now_ns);
        let declutched = self.is_clutched() && !clutched;
        self.clutch.step(!clutched, now_ns, ramp_ns, before.total_N);
        let was = self.command;
        let live = setpoint.is_rendered(now_ns);
        self.command.step(live, now_ns, ramp_ns, before.controller_N);
        Change {
            ran_out: was == Phase::Fresh && !live && !setpoint.released && !clutched,
            returned: live && matches!(was, Phase::Fading { .. }),
            declutched,
        }
    }

    /// Most that the controller may ask in sum now, newtons.
    pub fn cap_N(&self, now_ns: u64) -> f64 {
        self.command.cap_N(now_ns)
    }

    /// Most that everybody may ask in sum now, newtons; endless where nothing is clutched.
    pub fn clutch_cap_N(&self, now_ns: u64) -> f64 {
        self.clutch.cap_N(now_ns)
    }

    /// True while it fades because the controller fell silent or let go.
    pub fn is_fading(&self) -> bool {
        matches!(self.command, Phase::Fading { .. }) && !self.is_clutched()
    }

    /// True while a clutch keeps everything away, or fades it.
    pub fn is_clutched(&self) -> bool {
        self.clutch != Phase::Fresh
    }
}

impl Phase {
    fn step(&mut self, live: bool, now_ns: u64, ramp_ns: u64, force_N: f64) {
        if live {
            *self = Self::Fresh;
        } else if *self == Self::Fresh {
            *self = Self::Fading { since_ns: now_ns, force_N, ramp_ns };
        }
        if let Self::Fading { since_ns, ramp_ns, .. } = *self
            && now_ns.saturating_sub(since_ns) >= ramp_ns
        {
            *self = Self::Gone;
        }
    }

    fn cap_N(self, now_ns: u64) -> f64 {
        match self {
            Self::Gone => 0.0,
            Self::Fresh => f64::INFINITY,
            Self::Fading { since_ns, force_N, ramp_ns } => {
                let share = now_ns.saturating_sub(since_ns) as f64 / ramp_ns.max(1) as f64;
                force_N * (1.0 - share).clamp(0.0, 1.0)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;
    const RAMP: u64 = 50 * MS;
    const NOTHING: Change = Change { ran_out: false, returned: false, declutched: false };

    fn command(received_ns: u64) -> Setpoint {
        let mut setpoint = Setpoint::NONE;
        (setpoint.epoch, setpoint.seq) = (1, 1);
        (setpoint.received_ns, setpoint.ttl_ns) = (received_ns, 100 * MS);
        setpoint
    }

    fn before(controller_N: f64, total_N: f64) -> Before {
        Before { controller_N, total_N }
    }

    #[test]
    fn a_command_counts_until_its_time_to_live_then_fades_then_is_gone() {
        let mut authority = Authority::default();
        assert_eq!(authority.advance(&command(0), 100 * MS, RAMP, before(0.0, 0.0)), NOTHING);
        assert_eq!(authority.cap_N(100 * MS), f64::INFINITY);
        let change = authority.advance(&command(0), 101 * MS, RAMP, before(10.0, 12.0));
        assert!(change.ran_out, "it says so, once");
        assert_eq!(authority.advance(&command(0), 126 * MS, RAMP, before(99.0, 99.0)), NOTHING);
        assert!((authority.cap_N(126 * MS) - 5.0).abs() < 1e-9 && authority.is_fading());
        assert_eq!(authority.clutch_cap_N(126 * MS), f64::INFINITY, "the scene stays");
        authority.advance(&command(0), 151 * MS, RAMP, before(99.0, 99.0));
        assert_eq!((authority.is_fading(), authority.cap_N(151 * MS)), (false, 0.0));
    }

    #[test]
    fn a_newer_command_takes_over_from_a_fading_one_and_says_so() {
        let mut authority = Authority::default();
        authority.advance(&command(0), 0, RAMP, before(0.0, 0.0));
        authority.advance(&command(0), 101 * MS, RAMP, before(10.0, 10.0));
        let change = authority.advance(&command(102 * MS), 103 * MS, RAMP, before(9.0, 9.0));
        assert_eq!(change, Change { returned: true, ..NOTHING });
        assert_eq!(authority.cap_N(103 * MS), f64::INFINITY);
        let change = authority.advance(&command(103 * MS), 104 * MS, RAMP, before(0.0, 0.0));
        assert_eq!(change, NOTHING);
    }

    #[test]
    fn letting_go_on_purpose_fades_without_complaint() {
        let mut authority = Authority::default();
        authority.advance(&command(0), 0, RAMP, before(0.0, 0.0));
        let mut released = command(0);
        released.released = true;
        assert_eq!(authority.advance(&released, MS, RAMP, before(10.0, 10.0)), NOTHING);
        assert!(authority.is_fading());
    }

    #[test]
    fn a_clutch_fades_everything_and_ends_with_its_command() {
        let mut authority = Authority::default();
        authority.advance(&command(0), 0, RAMP, before(0.0, 0.0));
        let mut clutched = command(MS);
        clutched.clutched = true;
        assert_eq!(authority.advance(&clutched, MS, RAMP, before(3.0, 10.0)), NOTHING);
        assert!(authority.is_clutched() && !authority.is_fading());
        assert!((authority.clutch_cap_N(26 * MS) - 5.0).abs() < 1e-9);
        authority.advance(&clutched, 60 * MS, RAMP, before(0.0, 0.0));
        assert_eq!(authority.clutch_cap_N(60 * MS), 0.0);
        let change = authority.advance(&clutched, 102 * MS, RAMP, before(0.0, 0.0));
        assert_eq!(change, Change { declutched: true, ..NOTHING }, "nothing of it ran out");
        assert!(!authority.is_clutched());
        assert_eq!(authority.cap_N(102 * MS), 0.0);
    }

    #[test]
    fn a_ramp_that_is_set_while_something_fades_does_not_raise_what_is_left() {
        let mut authority = Authority::default();
        authority.advance(&command(0), 0, RAMP, before(0.0, 0.0));
        let mut clutched = command(0);
        clutched.clutched = true;
        clutched.ttl_ns = 10_000 * MS;
        let mut last = (f64::INFINITY, f64::INFINITY);
        for ms in 1..=1_001 {
            let ramp_ns = if ms < 900 { 1_000 * MS } else { 10_000 * MS };
            authority.advance(&clutched, ms * MS, ramp_ns, before(5.0, 10.0));
            let caps = (authority.cap_N(ms * MS), authority.clutch_cap_N(ms * MS));
            assert!(caps.0 <= last.0 && caps.1 <= last.1, "{last:?} to {caps:?} at {ms} ms");
            last = caps;
        }
        assert_eq!(last, (0.0, 0.0), "over when the first ramp is");
    }

    #[test]
    fn without_a_command_there_is_nothing() {
        let mut authority = Authority::default();
        assert_eq!(authority.advance(&Setpoint::NONE, 5 * MS, RAMP, before(0.0, 0.0)), NOTHING);
        assert_eq!(authority.cap_N(5 * MS), 0.0);
        assert!(!authority.is_clutched());
    }
}

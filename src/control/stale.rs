//! What a controller's command is still worth: fresh, fading, or gone.
//!
//! ```text
//!          newer command             time-to-live over, or released
//!   Gone ────────────────▶ Fresh ─────────────────────────────────▶ Fading ──▶ Gone
//!                            ▲             newer command               │ ramp over
//!                            └─────────────────────────────────────────┘
//! ```
//!
//! Time-to-live alone decides when a force goes. While it fades, what the controller's
//! contacts may ask is capped by the force they had, falling to zero along the ramp: a
//! stiffness that faded would keep a stiff wall until the very end and then drop it.

use super::Setpoint;

/// How much of the controller's command is rendered.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum Authority {
    /// Nothing.
    #[default]
    Gone,
    /// All of it.
    Fresh,
    /// At most this force, and less every tick.
    Fading {
        /// When it began.
        since_ns: u64,
        /// The force then.
        force_N: f64,
    },
}

impl Authority {
    /// One tick on. `force_N` is what the controller's contacts asked in the last tick, after
    /// the force limit. Returns true when the command has just run out by itself.
    pub fn advance(
        &mut self,
        setpoint: &Setpoint,
        now_ns: u64,
        ramp_ns: u64,
        force_N: f64,
    ) -> bool {
        if setpoint.is_fresh(now_ns) {
            *self = Self::Fresh;
            return false;
        }
        let ran_out = *self == Self::Fresh;
        if ran_out {
            *self = Self::Fading { since_ns: now_ns, force_N };
        }
        if matches!(*self, Self::Fading { since_ns, .. } if now_ns.saturating_sub(since_ns) >= ramp_ns)
        {
            *self = Self::Gone;
        }
        ran_out && !setpoint.released
    }

    /// Most that the controller's contacts may ask now, newtons.
    pub fn cap_N(&self, now_ns: u64, ramp_ns: u64) -> f64 {
        match *self {
            Self::Gone => 0.0,
            Self::Fresh => f64::INFINITY,
            Self::Fading { since_ns, force_N } => {
                let share = now_ns.saturating_sub(since_ns) as f64 / ramp_ns.max(1) as f64;
                force_N * (1.0 - share).clamp(0.0, 1.0)
            }
        }
    }

    /// True while it fades.
    pub fn is_fading(&self) -> bool {
        matches!(self, Self::Fading { .. })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;
    const RAMP: u64 = 50 * MS;

    fn command(received_ns: u64) -> Setpoint {
        let mut setpoint = Setpoint::NONE;
        (setpoint.epoch, setpoint.seq) = (1, 1);
        (setpoint.received_ns, setpoint.ttl_ns) = (received_ns, 100 * MS);
        setpoint
    }

    #[test]
    fn a_command_counts_until_its_time_to_live_then_fades_then_is_gone() {
        let mut authority = Authority::default();
        assert!(!authority.advance(&command(0), 100 * MS, RAMP, 0.0));
        assert_eq!(authority.cap_N(100 * MS, RAMP), f64::INFINITY);
        assert!(authority.advance(&command(0), 101 * MS, RAMP, 10.0), "it says so, once");
        assert!(!authority.advance(&command(0), 126 * MS, RAMP, 99.0));
        assert!((authority.cap_N(126 * MS, RAMP) - 5.0).abs() < 1e-9);
        authority.advance(&command(0), 151 * MS, RAMP, 99.0);
        assert_eq!((authority, authority.cap_N(151 * MS, RAMP)), (Authority::Gone, 0.0));
    }

    #[test]
    fn a_newer_command_takes_over_from_a_fading_one() {
        let mut authority = Authority::Fading { since_ns: 0, force_N: 10.0 };
        assert!(!authority.advance(&command(10 * MS), 11 * MS, RAMP, 3.0));
        assert_eq!(authority, Authority::Fresh);
    }

    #[test]
    fn letting_go_on_purpose_fades_without_complaint() {
        let mut authority = Authority::Fresh;
        let mut released = command(0);
        released.released = true;
        assert!(!authority.advance(&released, MS, RAMP, 10.0));
        assert!(authority.is_fading());
    }

    #[test]
    fn without_a_command_there_is_nothing() {
        let mut authority = Authority::default();
        assert!(!authority.advance(&Setpoint::NONE, 5 * MS, RAMP, 0.0));
        assert_eq!(authority.cap_N(5 * MS, RAMP), 0.0);
    }
}

//! Whether a client is still there, and whether a controller still commands.
//!
//! ```text
//!            first command               20 intervals or 500 ms without one
//!  ┌──────┐ ─────────────▶ ┌────────────┐ ───────────────▶ ┌────────────┐
//!  │ Idle │                │ Commanding │                  │ Monitoring │
//!  └──────┘                └────────────┘ ◀─────────────── └────────────┘
//!                                            next command
//! ```
//!
//! An observer is always Monitoring; a hand commands by its targets. Commanding is judged by
//! the interval that the client itself announced, so that a 72 Hz headset is not late. When
//! a *force* goes is decided by its time-to-live alone, in `control`; that of a wrench is no
//! longer than Commanding lasts. A session from which nothing at all was heard for
//! [`SILENCE_NS`] has ended.

use super::Role;
use crate::proto::SessionState;

/// A session this quiet is closed.
pub(super) const SILENCE_NS: u64 = 2_000_000_000;

/// Missed commands in a row that end Commanding.
const MISSED_COMMANDS: u64 = 20;

/// The longest time without a command that is still Commanding.
const MISSED_AT_MOST_NS: u64 = 500_000_000;

/// What was heard, and when.
#[derive(Debug)]
pub(super) struct Liveness {
    role: Role,
    late_after_ns: u64,
    commanded_ns: Option<u64>,
}

impl Liveness {
    /// Of a client that announced to command every `interval_ns`.
    pub fn new(role: Role, interval_ns: u64) -> Self {
        let late_after_ns = interval_ns.saturating_mul(MISSED_COMMANDS).min(MISSED_AT_MOST_NS);
        Self { role, late_after_ns, commanded_ns: None }
    }

    /// How long a session commands without a command.
    pub fn late_after_ns(&self) -> u64 {
        self.late_after_ns
    }

    /// Another one commands from now on.
    pub fn demote(&mut self) {
        self.role = Role::Observer;
    }

    /// A command was accepted.
    pub fn commanded(&mut self, now_ns: u64) {
        self.commanded_ns = Some(now_ns);
    }

    /// The state at a moment.
    pub fn state(&self, now_ns: u64) -> SessionState {
        match (self.role, self.commanded_ns) {
            (Role::Observer, _) => SessionState::Monitoring,
            (Role::Controller | Role::Hand, None) => SessionState::Idle,
            (Role::Controller | Role::Hand, Some(commanded_ns)) => {
                if now_ns.saturating_sub(commanded_ns) > self.late_after_ns {
                    SessionState::Monitoring
                } else {
                    SessionState::Commanding
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn state_after(interval_ns: u64, quiet_ns: u64) -> SessionState {
        let mut liveness = Liveness::new(Role::Controller, interval_ns);
        liveness.commanded(7 * MS);
        liveness.state(7 * MS + quiet_ns)
    }

    #[test]
    fn twenty_missed_commands_end_commanding_and_one_brings_it_back() {
        let mut liveness = Liveness::new(Role::Controller, MS);
        assert_eq!(liveness.state(0), SessionState::Idle);
        liveness.commanded(0);
        assert_eq!(liveness.state(20 * MS), SessionState::Commanding);
        assert_eq!(liveness.state(20 * MS + 1), SessionState::Monitoring);
        liveness.commanded(30 * MS);
        assert_eq!(liveness.state(30 * MS), SessionState::Commanding);
    }

    #[test]
    fn a_72_hz_client_is_judged_by_its_own_interval() {
        let interval_ns = 13_889_000;
        assert_eq!(state_after(interval_ns, 250 * MS), SessionState::Commanding);
        assert_eq!(state_after(interval_ns, 278 * MS), SessionState::Monitoring);
    }

    #[test]
    fn half_a_second_is_the_longest_patience() {
        assert_eq!(state_after(50 * MS, 500 * MS), SessionState::Commanding);
        assert_eq!(state_after(50 * MS, 501 * MS), SessionState::Monitoring);
    }

    #[test]
    fn an_observer_always_monitors() {
        let liveness = Liveness::new(Role::Observer, MS);
        assert_eq!(liveness.state(0), SessionState::Monitoring);
    }
}

//! After Enable the force grows from nothing: enabling inside a field or a wall is no blow.
//!
//! What is granted after clipping is scaled by a share that goes from 0 to 1 along the ramp. It
//! begins with the first tick that renders, and anew with every Enable. A device that is opened
//! enabled (nobody holds it yet) has no ramp. Letting go is never delayed.

use serde::{Deserialize, Serialize};

use super::Mode;

/// How much of the force is given.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum Activation {
    /// All of it.
    #[default]
    Full,
    /// The next tick is the first one.
    Begins,
    /// It grows since then.
    Growing { since_ns: u64 },
}

impl Activation {
    /// The mode has changed to this one.
    pub fn enter(&mut self, mode: Mode) {
        *self = if mode == Mode::Enabled { Self::Begins } else { Self::Full };
    }

    /// The share of the force in the tick at `now_ns`.
    pub fn share(&mut self, now_ns: u64, ramp_ns: u64) -> f64 {
        if *self == Self::Begins {
            *self = Self::Growing { since_ns: now_ns };
        }
        match *self {
            Self::Growing { since_ns } if now_ns.saturating_sub(since_ns) < ramp_ns => {
                now_ns.saturating_sub(since_ns) as f64 / ramp_ns as f64
            }
            _ => {
                *self = Self::Full;
                1.0
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_share_grows_from_nothing_to_all_and_begins_anew_with_every_enable() {
        let mut activation = Activation::default();
        assert_eq!(activation.share(7, 100), 1.0, "opened enabled");
        for begin in [1_000, 5_000] {
            activation.enter(Mode::Enabled);
            let shares = [0, 25, 50, 99, 100, 1_000].map(|t| activation.share(begin + t, 100));
            assert_eq!(shares, [0.0, 0.25, 0.5, 0.99, 1.0, 1.0]);
            activation.enter(Mode::Disabled);
            assert_eq!(activation, Activation::Full);
        }
        activation.enter(Mode::Enabled);
        assert_eq!(activation.share(9, 0), 1.0, "without a ramp at once");
    }
}

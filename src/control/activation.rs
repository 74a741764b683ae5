//! The force grows from nothing after Enable, and from what it was after a gain or a force limit
//! is raised: neither is a blow to a hand that is inside a field or a wall.
//!
//! What is granted after clipping is scaled by a share that goes to 1 along the ramp. After
//! Enable it begins at 0, with the first tick that renders; a device that is opened enabled
//! (nobody holds it yet) has no ramp. After a raise it begins at the share that grants what was
//! granted in the tick before. The ramp is the one that was set when the growth began; a growth
//! under way is never made shorter. Letting go is never delayed.

use serde::{Deserialize, Serialize};

use super::{Guards, Mode};

/// How much of the force is given.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Activation {
    growth: Growth,
    /// Settings of the last tick that asked: one that is larger now was raised.
    gain: f64,
    limit_N: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
enum Growth {
    /// All of it.
    Full,
    /// The next tick is the first one.
    Begins,
    /// It grows since then, from this share.
    Growing { since_ns: u64, ramp_ns: u64, from: f64 },
}

/// What a tick asks, to tell whether it is more than before because of a setting.
#[derive(Clone, Copy, Debug)]
pub struct Asked<'a> {
    /// Sum granted in the tick before, newtons.
    pub last_N: f64,
    /// Sum asked now, after clipping and before it is scaled, newtons.
    pub now_N: f64,
    /// The settings now.
    pub guards: &'a Guards,
}

impl Default for Activation {
    fn default() -> Self {
        // Nothing is larger than these, so the first tick's settings are not a raise.
        Self { growth: Growth::Full, gain: f64::INFINITY, limit_N: f64::INFINITY }
    }
}

impl Activation {
    /// The mode has changed to this one.
    pub fn enter(&mut self, mode: Mode) {
        self.growth = if mode == Mode::Enabled { Growth::Begins } else { Growth::Full };
    }

    /// The share of the force in the tick at `now_ns`.
    pub fn share(&mut self, now_ns: u64, ramp_ns: u64) -> f64 {
        if self.growth == Growth::Begins {
            self.growth = Growth::Growing { since_ns: now_ns, ramp_ns, from: 0.0 };
        }
        if let Growth::Growing { since_ns, ramp_ns, from } = self.growth {
            let elapsed_ns = now_ns.saturating_sub(since_ns);
            let share = from + elapsed_ns as f64 / ramp_ns.max(1) as f64;
            if elapsed_ns < ramp_ns && share < 1.0 {
                return share;
            }
        }
        self.growth = Growth::Full;
        1.0
    }

    /// The share that is given after all, which is less than `share` where a setting was raised
    /// while something is felt.
    pub fn settle(&mut self, mode: Mode, share: f64, asked: &Asked, now_ns: u64) -> f64 {
        let Guards { force_gain, force_limit_N, activation_ramp_ns, .. } = *asked.guards;
        // A raise makes nothing larger than the inverse of this.
        let kept = kept(self.gain, force_gain) * kept(self.limit_N, force_limit_N);
        (self.gain, self.limit_N) = (force_gain, force_limit_N);
        if mode != Mode::Enabled || kept >= 1.0 || asked.now_N <= asked.last_N {
            return share;
        }
        let from = (asked.last_N / asked.now_N).max(share * kept).min(share);
        let ramp_ns = match self.growth {
            Growth::Growing { ramp_ns, .. } => ramp_ns.max(activation_ramp_ns),
            _ => activation_ramp_ns,
        };
        if ramp_ns == 0 || from >= 1.0 {
            return share;
        }
        self.growth = Growth::Growing { since_ns: now_ns, ramp_ns, from };
        from
    }
}

/// What is left of the new value at the old one.
fn kept(old: f64, new: f64) -> f64 {
    if old >= new { 1.0 } else { old / new }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(guards: &Guards, last_N: f64, now_N: f64) -> Asked<'_> {
        Asked { last_N, now_N, guards }
    }

    #[test]
    fn the_share_grows_from_nothing_to_all_and_begins_anew_with_every_enable() {
        let mut activation = Activation::default();
        assert_eq!(activation.share(7, 100), 1.0, "opened enabled");
        for begin in [1_000, 5_000] {
            activation.enter(Mode::Enabled);
            let shares = [0, 25, 50, 99, 100, 1_000].map(|t| activation.share(begin + t, 100));
            assert_eq!(shares, [0.0, 0.25, 0.5, 0.99, 1.0, 1.0]);
            activation.enter(Mode::Disabled);
            assert_eq!(activation, Activation::default());
        }
        activation.enter(Mode::Enabled);
        assert_eq!(activation.share(9, 0), 1.0, "without a ramp at once");
    }

    #[test]
    fn a_ramp_that_is_set_during_a_growth_is_for_the_next_one() {
        let mut activation = Activation::default();
        activation.enter(Mode::Enabled);
        activation.share(0, 100);
        assert_eq!(activation.share(5, 0), 0.05);
        assert_eq!(activation.share(50, 1_000), 0.5);
        assert_eq!(activation.share(100, 1_000), 1.0);
    }

    #[test]
    fn a_raise_goes_on_from_what_was_granted_and_never_makes_a_growth_shorter() {
        let mut activation = Activation::default();
        activation.enter(Mode::Enabled);
        let mut guards = Guards { activation_ramp_ns: 100, ..Guards::default() };
        guards.force_gain = 0.5;
        let share = activation.share(0, 100);
        assert_eq!(activation.settle(Mode::Enabled, share, &asked(&guards, 0.0, 6.0), 0), 0.0);
        let share = activation.share(50, 100);
        guards.force_gain = 1.0;
        guards.activation_ramp_ns = 0;
        assert_eq!(activation.settle(Mode::Enabled, share, &asked(&guards, 3.0, 12.0), 50), 0.25);
        assert_eq!([75, 100, 125].map(|t| activation.share(t, 0)), [0.5, 0.75, 1.0]);
        // Less than was granted is let go at once; nothing was raised.
        guards.force_gain = 0.1;
        assert_eq!(activation.settle(Mode::Enabled, 1.0, &asked(&guards, 12.0, 1.2), 126), 1.0);
    }

    #[test]
    fn a_small_raise_takes_no_more_away_than_it_adds() {
        let mut activation = Activation::default();
        let mut guards = Guards { force_gain: 0.8, ..Guards::default() };
        assert_eq!(activation.settle(Mode::Enabled, 1.0, &asked(&guards, 0.0, 9.0), 0), 1.0);
        guards.force_gain = 1.0;
        let share = activation.settle(Mode::Enabled, 1.0, &asked(&guards, 0.0, 9.0), 1);
        assert_eq!(share, 0.8, "a wall that is entered in this very tick is there");
    }
}

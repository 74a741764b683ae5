//! What real brakes do besides holding: torque that stays behind its command, and free play.
//!
//! *Hysteresis* is a play operator: what a brake can hold follows its command only once that has
//! moved by half the width, so that it is less on the way up and more on the way down, and a
//! brake that is released keeps a remainder. The width is a share of the largest torque. *Backlash*
//! lies between shaft and brake: within the play the shaft turns freely, and the brake acts only
//! where it is taken along, one way at either end. Both leave a set of torques around zero, so
//! the plant stays passive. Derived here; encoders and drag are on the shaft's side.

use serde::{Deserialize, Serialize};

use crate::notation::ActuatorVector;

/// What is imperfect about each brake; all zero by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Imperfections {
    /// Width of the hysteresis as a share of the largest torque.
    pub hysteresis: ActuatorVector,
    /// Free play between shaft and brake, from end to end, radians.
    pub backlash_rad: ActuatorVector,
}

/// Where brakes are within their hysteresis and play.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Slack {
    /// What each brake can hold now.
    held_Nm: ActuatorVector,
    /// The shaft ahead of the middle of the play.
    ahead_rad: ActuatorVector,
}

impl Slack {
    /// Capacities that follow what the brakes have reached of their commands.
    pub fn follow(
        &mut self,
        imperfections: &Imperfections,
        reached_Nm: &ActuatorVector,
        max_torque_Nm: &ActuatorVector,
    ) {
        for i in 0..self.held_Nm.len() {
            let half_Nm = 0.5 * imperfections.hysteresis[i] * max_torque_Nm[i];
            let (least_Nm, most_Nm) = (reached_Nm[i] - half_Nm, reached_Nm[i] + half_Nm);
            self.held_Nm[i] = self.held_Nm[i].max(least_Nm).min(most_Nm).max(0.0);
        }
    }

    /// What a brake can hold.
    pub fn held_Nm(&self, i: usize) -> f64 {
        self.held_Nm[i]
    }

    /// Which ways brake i can act on a shaft that is about to turn by `turn_rad`: against
    /// turning on, against turning back.
    pub fn engages(&self, imperfections: &Imperfections, i: usize, turn_rad: f64) -> [bool; 2] {
        let half_rad = 0.5 * imperfections.backlash_rad[i];
        if half_rad <= 0.0 {
            return [true; 2];
        }
        let ahead_rad = self.ahead_rad[i] + turn_rad;
        [ahead_rad >= half_rad, ahead_rad <= -half_rad]
    }

    /// The shafts have turned; brakes at the end of their play are taken along.
    pub fn turn(&mut self, imperfections: &Imperfections, turn_rad: &ActuatorVector) {
        for i in 0..turn_rad.len() {
            let half_rad = 0.5 * imperfections.backlash_rad[i].max(0.0);
            self.ahead_rad[i] = (self.ahead_rad[i] + turn_rad[i]).max(-half_rad).min(half_rad);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn torque_stays_behind_its_command_by_half_the_width_each_way() {
        let imperfections =
            Imperfections { hysteresis: ActuatorVector::repeat(0.1), ..Default::default() };
        let most_Nm = ActuatorVector::repeat(20.0);
        let mut slack = Slack::default();
        let mut told = |reached_Nm: f64| {
            slack.follow(&imperfections, &ActuatorVector::repeat(reached_Nm), &most_Nm);
            slack.held_Nm(2)
        };
        let path = [0.5, 5.0, 10.0, 9.5, 8.0, 0.0, 0.5, 3.0].map(&mut told);
        assert_eq!(path, [0.0, 4.0, 9.0, 9.0, 9.0, 1.0, 1.0, 2.0]);
    }

    #[test]
    fn within_its_play_a_shaft_is_free_and_at_either_end_held_one_way() {
        let imperfections =
            Imperfections { backlash_rad: ActuatorVector::repeat(0.02), ..Default::default() };
        let mut slack = Slack::default();
        assert_eq!(slack.engages(&imperfections, 0, 0.005), [false, false]);
        assert_eq!(slack.engages(&imperfections, 0, 0.015), [true, false]);
        slack.turn(&imperfections, &ActuatorVector::repeat(0.5));
        assert_eq!(slack.engages(&imperfections, 0, 0.001), [true, false]);
        assert_eq!(slack.engages(&imperfections, 0, -0.001), [false, false]);
        assert_eq!(slack.engages(&imperfections, 0, -0.021), [false, true]);
        assert_eq!(slack.engages(&Imperfections::default(), 0, 0.0), [true, true]);
    }
}

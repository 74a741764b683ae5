//! `random`: a smooth force without a plan, and a weak spring that keeps it in the workspace.
//!
//! Each axis is white noise through two equal low-pass filters (an Ornstein-Uhlenbeck process
//! smoothed once more, so that the force has no corners), sampled exactly for any time step.

use nalgebra::Vector2;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use super::{Grip, Handle, MIDDLE_M};

/// How strong and how fast the hand wanders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RandomProgram {
    /// Where the weak spring pulls, metres.
    pub home_m: [f64; 2],
    /// Force per axis before the second filter, rms, newtons.
    pub force_rms_N: f64,
    /// Time constant of both filters, seconds.
    pub correlation_s: f64,
    /// The weak spring; its limit is the limit of the whole force.
    pub grip: Grip,
}

impl Default for RandomProgram {
    fn default() -> Self {
        Self {
            home_m: MIDDLE_M,
            force_rms_N: 4.0,
            correlation_s: 0.1,
            grip: Grip { stiffness_N_per_m: 40.0, damping_N_s_per_m: 4.0, max_N: 15.0 },
        }
    }
}

impl RandomProgram {
    pub(super) fn scaled(self, scale: f64) -> Self {
        Self {
            home_m: self.home_m.map(|m| scale * m),
            force_rms_N: scale * self.force_rms_N,
            ..self
        }
    }
}

/// A hand that wanders.
#[derive(Clone, Debug)]
pub(super) struct RandomPull {
    program: RandomProgram,
    rough_N: Vector2<f64>,
    smooth_N: Vector2<f64>,
}

impl RandomPull {
    pub(super) fn new(program: RandomProgram) -> Self {
        Self { program, rough_N: Vector2::zeros(), smooth_N: Vector2::zeros() }
    }

    pub(super) fn act(&mut self, handle: &Handle, rng: &mut ChaCha8Rng) -> Vector2<f64> {
        let RandomProgram { home_m, force_rms_N, correlation_s, grip } = self.program;
        let keep = (-handle.dt_s / correlation_s).exp();
        let fresh_N = force_rms_N * (1.0 - keep * keep).max(0.0).sqrt();
        let mut noise = || rng.sample::<f64, _>(StandardNormal);
        self.rough_N = keep * self.rough_N + fresh_N * Vector2::new(noise(), noise());
        self.smooth_N = self.rough_N + keep * (self.smooth_N - self.rough_N);
        let home_N = grip.pull(Vector2::from(home_m) - handle.p_m, -handle.v_m_per_s);
        (self.smooth_N + home_N).cap_magnitude(grip.max_N)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{DT_S, PointMass};
    use super::super::{Hand, HandProgram};
    use crate::notation::PlaneVector;
    use nalgebra::Vector2;

    fn path(seed: u64, seconds: f64) -> Vec<(Vector2<f64>, Vector2<f64>)> {
        let program: HandProgram = "random".parse().expect("a name");
        let home_m = program.start_m();
        let mut hand = Hand::new(program, &PlaneVector::new(home_m[0], home_m[1], 0.0), seed);
        let mut handle = PointMass::at(home_m);
        (0..(seconds / DT_S) as usize)
            .map(|_| {
                let force_N = handle.step(&mut hand, |_, _| ()).F_hand_BH_N.xy();
                (handle.p_m, force_N)
            })
            .collect()
    }

    #[test]
    fn its_force_and_a_free_handles_path_are_bounded() {
        let (mut furthest_m, mut strongest_N, mut fastest_N) = (0.0_f64, 0.0_f64, 0.0_f64);
        let path = path(3, 600.0);
        for pair in path.windows(2) {
            furthest_m = furthest_m.max((pair[1].0 - path[0].0).norm());
            strongest_N = strongest_N.max(pair[1].1.norm());
            fastest_N = fastest_N.max((pair[1].1 - pair[0].1).norm());
        }
        assert!((0.05..0.30).contains(&furthest_m), "{furthest_m}");
        assert!((5.0..=15.0).contains(&strongest_N), "{strongest_N}");
        assert!(fastest_N < 0.2, "no steps of force: {fastest_N} N in half a millisecond");
    }

    #[test]
    fn a_seed_is_a_path() {
        assert_eq!(path(7, 2.0), path(7, 2.0));
        assert_ne!(path(7, 2.0), path(8, 2.0));
    }
}

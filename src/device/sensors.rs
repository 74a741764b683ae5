//! The sensors of the simulated device: what encoders and a force sensor make of the truth.
//!
//! An encoder counts whole steps of its shaft, `floor(angle * counts / 2 pi)`, over any number
//! of turns; the plant hands over continuous angles. The force sensor adds to each axis of
//! the plane its own white noise, and along +x a constant bias: +x is the way the
//! experiment's hand presses, so there a bias does the most harm to a law that trusts it.
//! The same seed gives the same noise, bit for bit. No delay and no drift are modelled.

use std::f64::consts::TAU;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use crate::control::Sample;
use crate::notation::{ActuatorVector, MAX_ACTUATORS, PlaneVector};

/// How well the hand's force is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForceSensor {
    /// White noise on each of x and y, newtons rms.
    pub noise_rms_N: f64,
    /// Added to x, newtons.
    pub bias_N: f64,
}

impl Default for ForceSensor {
    fn default() -> Self {
        Self { noise_rms_N: 0.05, bias_N: 0.1 }
    }
}

/// All sensors of a device.
#[derive(Clone, Debug)]
pub struct Sensors {
    counts_per_rad: ActuatorVector,
    /// What is counted where the encoders say zero.
    zero: [i64; MAX_ACTUATORS],
    force_sensor: Option<ForceSensor>,
    rng: ChaCha8Rng,
}

impl Sensors {
    /// Encoders with that many counts per turn of their shafts, and perhaps a force sensor.
    pub fn new(
        counts_per_revolution: &ActuatorVector,
        force_sensor: Option<ForceSensor>,
        seed: u64,
    ) -> Self {
        Self {
            counts_per_rad: counts_per_revolution / TAU,
            zero: [0; MAX_ACTUATORS],
            force_sensor,
            rng: ChaCha8Rng::seed_from_u64(seed),
        }
    }

    /// The encoders are incremental ones that were switched on here.
    pub fn count_from(&mut self, shaft_rad: &ActuatorVector) {
        self.zero = self.counts(shaft_rad);
    }

    fn counts(&self, shaft_rad: &ActuatorVector) -> [i64; MAX_ACTUATORS] {
        let counts = shaft_rad.component_mul(&self.counts_per_rad);
        // The cast saturates, and takes what is not a number as zero.
        std::array::from_fn(|i| (counts[i].floor() as i64).saturating_sub(self.zero[i]))
    }

    /// What is read where the shafts are at `shaft_rad` and the hand pulls with
    /// `F_hand_BH_N`. Does not allocate.
    pub fn read(
        &mut self,
        shaft_rad: &ActuatorVector,
        F_hand_BH_N: &PlaneVector,
        buttons: u32,
    ) -> Sample {
        Sample {
            counts: self.counts(shaft_rad),
            F_hand_BH_N: self.force_sensor.map(|sensor| {
                let mut noise = || sensor.noise_rms_N * self.rng.sample::<f64, _>(StandardNormal);
                F_hand_BH_N + PlaneVector::new(sensor.bias_N + noise(), noise(), 0.0)
            }),
            buttons,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COUNTS: f64 = 65_536.0;

    fn sensors(force_sensor: Option<ForceSensor>, seed: u64) -> Sensors {
        Sensors::new(&ActuatorVector::repeat(COUNTS), force_sensor, seed)
    }

    #[test]
    fn an_encoder_steps_once_per_count_on_both_sides_of_zero() {
        let count_rad = TAU / COUNTS;
        let mut sensors = sensors(None, 0);
        for (counts, expected) in [
            (0.5, 0),
            (0.999, 0),
            (1.001, 1),
            (-0.001, -1),
            (-1.5, -2),
            (3.0 * COUNTS + 7.5, 196_615),
            (f64::NAN, 0),
            (f64::INFINITY, i64::MAX),
        ] {
            let shaft_rad = ActuatorVector::repeat(counts * count_rad);
            let sample = sensors.read(&shaft_rad, &PlaneVector::zeros(), 0);
            assert_eq!(sample.counts, [expected; MAX_ACTUATORS], "{counts}");
            assert_eq!(sample.F_hand_BH_N, None);
        }
    }

    #[test]
    fn the_force_sensor_has_the_noise_and_bias_it_states() {
        let sensor = ForceSensor { noise_rms_N: 0.2, bias_N: -0.5 };
        let mut sensors = sensors(Some(sensor), 5);
        let F_hand_BH_N = PlaneVector::new(3.0, -4.0, 0.0);
        let errors_N: Vec<PlaneVector> = (0..100_000)
            .filter_map(|_| {
                let sample = sensors.read(&ActuatorVector::zeros(), &F_hand_BH_N, 0);
                Some(sample.F_hand_BH_N? - F_hand_BH_N)
            })
            .collect();
        assert_eq!(errors_N.len(), 100_000);
        let count = errors_N.len() as f64;
        let mean_N: PlaneVector = errors_N.iter().sum::<PlaneVector>() / count;
        // Five standard errors of a mean of 100,000.
        assert!((mean_N - PlaneVector::new(-0.5, 0.0, 0.0)).amax() < 5.0 * 0.2 / count.sqrt());
        for axis in 0..2 {
            let square =
                errors_N.iter().map(|error_N| (error_N[axis] - mean_N[axis]).powi(2)).sum::<f64>();
            let rms_N = (square / count).sqrt();
            assert!((rms_N / 0.2 - 1.0).abs() < 0.02, "{rms_N}");
        }
        assert!(errors_N.iter().all(|error_N| error_N.z == 0.0));
    }
}

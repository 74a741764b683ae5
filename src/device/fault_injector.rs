//! A device that fails on schedule, around any other device.
//!
//! A schedule is a list of episodes, counted in reads; it is data, so a test states exactly
//! what goes wrong when, and [`episodes`] draws one from a seed. The device inside is asked
//! whatever happens, as real hardware keeps moving while nobody understands it; only a
//! disconnected one is left alone.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::Device;
use crate::control::{ActuatorCommands, DeviceError, Sample};
use crate::notation::{MAX_ACTUATORS, PlaneVector};

/// One thing that goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Injection {
    /// Reads fail with this error; writes too when the device is disconnected.
    Error(DeviceError),
    /// The force sensor answers NaN; without one nothing changes.
    NanForce,
    /// One encoder repeats what it last said.
    StuckEncoder(usize),
    /// The whole sample is the last good one.
    FrozenSample,
}

impl Injection {
    /// One of each kind.
    pub const ALL: [Self; 6] = [
        Self::Error(DeviceError::Timeout),
        Self::Error(DeviceError::Disconnected),
        Self::Error(DeviceError::Malformed),
        Self::NanForce,
        Self::StuckEncoder(0),
        Self::FrozenSample,
    ];
}

/// One thing that goes wrong for some reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Episode {
    /// The first read that it strikes; the first of all is 0.
    pub first_read: u64,
    /// How many reads it lasts.
    pub reads: u64,
    /// What it is.
    pub injection: Injection,
}

/// A schedule of `count` episodes drawn from `seed`: each of 1 to `longest` reads, 1 to
/// `longest_gap` good reads before each, never two at once.
pub fn episodes(seed: u64, count: usize, longest: u64, longest_gap: u64) -> Vec<Episode> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut next_read = 0;
    let mut draw = |_| {
        let first_read = next_read + rng.random_range(1..=longest_gap.max(1));
        let reads = rng.random_range(1..=longest.max(1));
        next_read = first_read + reads;
        let injection = match Injection::ALL[rng.random_range(0..Injection::ALL.len())] {
            Injection::StuckEncoder(_) => {
                Injection::StuckEncoder(rng.random_range(0..MAX_ACTUATORS))
            }
            other => other,
        };
        Episode { first_read, reads, injection }
    };
    (0..count).map(&mut draw).collect()
}

/// A device with a schedule of faults.
#[derive(Debug)]
pub struct FaultInjector<D> {
    device: D,
    schedule: Vec<Episode>,
    reads: u64,
    last_good: Sample,
    disconnected: bool,
}

impl<D: Device> FaultInjector<D> {
    /// `device`, failing as `schedule` says; of episodes that overlap the first counts.
    pub fn new(device: D, schedule: Vec<Episode>) -> Self {
        Self { device, schedule, reads: 0, last_good: Sample::default(), disconnected: false }
    }

    /// The device inside.
    pub fn inner(&self) -> &D {
        &self.device
    }

    fn injection_at(&self, read: u64) -> Option<Injection> {
        self.schedule
            .iter()
            .find(|episode| {
                read.checked_sub(episode.first_read).is_some_and(|into| into < episode.reads)
            })
            .map(|episode| episode.injection)
    }
}

impl<D: Device> Device for FaultInjector<D> {
    fn read(&mut self, now_ns: u64) -> Result<Sample, DeviceError> {
        let injection = self.injection_at(self.reads);
        self.reads += 1;
        self.disconnected = injection == Some(Injection::Error(DeviceError::Disconnected));
        if self.disconnected {
            return Err(DeviceError::Disconnected);
        }
        let mut sample = self.device.read(now_ns)?;
        match injection {
            Some(Injection::Error(error)) => return Err(error),
            Some(Injection::NanForce) => {
                let not_a_number = PlaneVector::repeat(f64::NAN);
                sample.F_hand_BH_N = sample.F_hand_BH_N.map(|_| not_a_number);
            }
            Some(Injection::StuckEncoder(i)) => {
                if let Some(counts) = sample.counts.get_mut(i) {
                    *counts = self.last_good.counts[i];
                }
            }
            Some(Injection::FrozenSample) => sample = self.last_good,
            None => self.last_good = sample,
        }
        Ok(sample)
    }

    fn write(&mut self, commands: &ActuatorCommands) -> Result<(), DeviceError> {
        if self.disconnected {
            return Err(DeviceError::Disconnected);
        }
        self.device.write(commands)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::RELEASED;

    /// Counts its reads on every encoder and in the force, and its writes.
    #[derive(Default)]
    struct Counting {
        reads: i64,
        writes: u32,
    }

    impl Device for Counting {
        fn read(&mut self, _: u64) -> Result<Sample, DeviceError> {
            self.reads += 1;
            Ok(Sample {
                counts: [self.reads; MAX_ACTUATORS],
                F_hand_BH_N: Some(PlaneVector::repeat(self.reads as f64)),
                buttons: 0,
            })
        }

        fn write(&mut self, _: &ActuatorCommands) -> Result<(), DeviceError> {
            self.writes += 1;
            Ok(())
        }
    }

    /// The answers to six reads with `injection` on the third and fourth.
    fn answers(injection: Injection) -> Vec<Result<Sample, DeviceError>> {
        let episode = Episode { first_read: 2, reads: 2, injection };
        let mut device = FaultInjector::new(Counting::default(), vec![episode]);
        (0..6).map(|now_ns| device.read(now_ns)).collect()
    }

    #[test]
    fn each_kind_strikes_exactly_when_scheduled() {
        for injection in Injection::ALL {
            let answers = answers(injection);
            for (read, answer) in answers.iter().enumerate() {
                let struck = read == 2 || read == 3;
                let asked = match injection {
                    Injection::Error(DeviceError::Disconnected) if read > 3 => read as i64 - 1,
                    _ => read as i64 + 1,
                };
                match (struck, injection, answer) {
                    (false, _, Ok(sample)) => assert_eq!(sample.counts, [asked; MAX_ACTUATORS]),
                    (true, Injection::Error(error), answer) => assert_eq!(*answer, Err(error)),
                    (true, Injection::NanForce, Ok(sample)) => {
                        assert!(sample.F_hand_BH_N.is_some_and(|force| force.x.is_nan()));
                    }
                    (true, Injection::StuckEncoder(_), Ok(sample)) => {
                        assert_eq!(sample.counts[..2], [2, asked]);
                    }
                    (true, Injection::FrozenSample, Ok(sample)) => {
                        assert_eq!(Ok(*sample), answers[1]);
                    }
                    _ => panic!("{injection:?} at {read}: {answer:?}"),
                }
            }
        }
    }

    #[test]
    fn a_disconnected_device_takes_no_command() {
        let episode = Episode {
            first_read: 0,
            reads: 1,
            injection: Injection::Error(DeviceError::Disconnected),
        };
        let mut device = FaultInjector::new(Counting::default(), vec![episode]);
        assert_eq!(device.read(0), Err(DeviceError::Disconnected));
        assert_eq!(device.write(&RELEASED), Err(DeviceError::Disconnected));
        assert!(device.read(1).is_ok());
        assert_eq!(device.write(&RELEASED), Ok(()));
        assert_eq!(device.inner().writes, 1);
    }

    #[test]
    fn a_seed_is_a_schedule_without_overlaps() {
        let schedule = episodes(4, 100, 20, 50);
        assert_eq!(schedule, episodes(4, 100, 20, 50));
        assert_ne!(schedule, episodes(5, 100, 20, 50));
        for pair in schedule.windows(2) {
            assert!(pair[0].first_read + pair[0].reads < pair[1].first_read);
        }
    }
}

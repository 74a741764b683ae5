//! How good a session's path is, and what may be commanded over it.
//!
//! | quality   | loss at most | variation of one-way delay at most | what it is good for |
//! |-----------|--------------|------------------------------------|---------------------|
//! | EXCELLENT | 1 %          | 1 ms                               | everything          |
//! | GOOD      | 6 %          | 5 ms                               | wrench, force field |
//! | FAIR      | 30 %         | 30 ms                              | contacts            |
//! | POOR      | more         | more                               | contacts that come late |
//!
//! A fresh session is GOOD on trust until [`TRUSTED`] of its datagrams were judged. After
//! that a bound that is passed counts at once; the way back needs [`HYSTERESIS`] of the
//! bounds of the better quality. Measured by [`Path`].

use super::path::Path;
use crate::proto;

/// Loss, and variation in nanoseconds, that each quality allows.
const TABLE: [(Quality, f64, f64); 3] =
    [(Quality::Excellent, 0.01, 1e6), (Quality::Good, 0.06, 5e6), (Quality::Fair, 0.30, 30e6)];

/// Part of a bound within which a better quality is believed.
const HYSTERESIS: f64 = 0.7;

/// Datagrams judged before the quality is.
const TRUSTED: u32 = 128;

/// How good a path is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Quality {
    /// Local models still stand, and come late.
    Poor,
    /// Good for local models.
    Fair,
    /// Good for direct forces.
    Good,
    /// As on one machine.
    Excellent,
}

/// What a wrench and a force field need. Contacts need nothing: they are rendered locally,
/// whatever the network does.
pub(super) const FOR_FORCES: Quality = Quality::Good;

impl Quality {
    /// Every quality, for tables of metrics.
    pub const ALL: [Self; 4] = [Self::Poor, Self::Fair, Self::Good, Self::Excellent];

    /// The name used in metrics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Poor => "poor",
            Self::Fair => "fair",
            Self::Good => "good",
            Self::Excellent => "excellent",
        }
    }
}

impl From<Quality> for proto::Quality {
    fn from(quality: Quality) -> Self {
        match quality {
            Quality::Poor => Self::Poor,
            Quality::Fair => Self::Fair,
            Quality::Good => Self::Good,
            Quality::Excellent => Self::Excellent,
        }
    }
}

/// The quality of one session as its datagrams come.
#[derive(Clone, Copy, Debug)]
pub(super) struct Judge {
    path: Path,
    quality: Quality,
}

impl Judge {
    /// Of a session that nothing is known of.
    pub fn new() -> Self {
        Self { path: Path::default(), quality: Quality::Good }
    }

    /// A numbered datagram came, sent at `sent_ns` of the client's clock (0: it has none).
    pub fn take(&mut self, seq: u64, sent_ns: u64, now_ns: u64) {
        self.path.take(seq, sent_ns, now_ns);
        if self.path.settled() >= TRUSTED {
            let earned = self.within(HYSTERESIS);
            self.quality = self.quality.max(earned).min(self.within(1.0));
        }
    }

    /// The quality now.
    pub fn quality(&self) -> Quality {
        self.quality
    }

    /// What it is judged by.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The best quality whose bounds are kept to this part.
    fn within(&self, part: f64) -> Quality {
        let (loss, variation_ns) = (self.path.loss(), self.path.variation_ns());
        let kept = TABLE.iter().find(|(_, most_loss, most_variation_ns)| {
            loss <= most_loss * part && variation_ns <= most_variation_ns * part
        });
        kept.map_or(Quality::Poor, |(quality, ..)| *quality)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const MS: u64 = 1_000_000;

    /// Datagrams of one kind of path, 1 kHz; the judge goes on from where it was.
    struct Run {
        judge: Judge,
        rng: ChaCha8Rng,
        seq: u64,
    }

    impl Run {
        fn new(seed: u64) -> Self {
            Self { judge: Judge::new(), rng: ChaCha8Rng::seed_from_u64(seed), seq: 0 }
        }

        fn on(&mut self, count: u64, loss: f64, jitter_ns: u64) -> Vec<Quality> {
            let mut seen = Vec::new();
            for _ in 0..count {
                self.seq += 1;
                let delay_ns = 20 * MS + self.rng.random_range(0..=jitter_ns);
                if !self.rng.random_bool(loss) {
                    self.judge.take(self.seq, self.seq * MS, self.seq * MS + delay_ns);
                }
                seen.push(self.judge.quality());
            }
            seen
        }
    }

    #[test]
    fn each_path_gets_its_row_of_the_table() {
        // Uniform jitter varies by a third of its range.
        for (loss, jitter_ms, expected) in [
            (0.0, 0.0, Quality::Excellent),
            (0.0, 2.0, Quality::Excellent),
            (0.03, 2.0, Quality::Good),
            (0.0, 9.0, Quality::Good),
            (0.2, 2.0, Quality::Fair),
            (0.02, 45.0, Quality::Fair),
            (0.6, 2.0, Quality::Poor),
            (0.0, 180.0, Quality::Poor),
        ] {
            for seed in 0..4 {
                let seen = Run::new(seed).on(4000, loss, (jitter_ms * MS as f64) as u64);
                let settled = &seen[1000..];
                let share = settled.iter().filter(|quality| **quality == expected).count();
                assert!(share * 10 > settled.len() * 9, "{loss} {jitter_ms}: {expected:?}");
            }
        }
    }

    #[test]
    fn a_fresh_session_is_good_and_a_bad_one_is_soon_found_out() {
        let mut run = Run::new(1);
        assert_eq!(run.judge.quality(), Quality::Good);
        let seen = run.on(300, 0.8, 0);
        assert_eq!((seen[0], seen[299]), (Quality::Good, Quality::Poor));
    }

    #[test]
    fn at_a_bound_the_quality_does_not_flicker_and_it_comes_back() {
        let mut run = Run::new(3);
        let seen = run.on(20_000, 0.06, 0);
        let changes = seen.windows(2).filter(|pair| pair[0] != pair[1]).count();
        assert!(changes < 40, "{changes} changes in 20 s");
        assert_eq!(run.on(2000, 0.0, 0).last(), Some(&Quality::Excellent));
    }

    #[test]
    fn the_table_gets_worse_row_by_row() {
        for pair in TABLE.windows(2) {
            assert!(pair[0].0 > pair[1].0 && pair[0].1 < pair[1].1 && pair[0].2 < pair[1].2);
        }
        for quality in Quality::ALL {
            let name = proto::Quality::from(quality).as_str_name().to_lowercase();
            assert_eq!(name, format!("quality_{}", quality.name()));
        }
    }
}

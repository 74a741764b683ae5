//! How fast State may go to one client: slower where the path loses it or lets it wait.
//!
//! A stream that never slows down takes the path from everybody else, its own commands first.
//! Ten times a second a Pong tells how much of what was sent has come, and how long it took. A
//! loss of more than a tenth, or a way that has grown by 25 ms, for a second: half of the States,
//! then a quarter, with a deadband twice and four times as wide. Five good seconds: back, one
//! step; each time that this proves too early the next wait is twice as long. Pongs that do not
//! come say nothing: liveness judges them.

use super::ping::PING_EVERY_NS;

/// Pongs that are looked at together: a second.
const WINDOW: usize = 10;

/// Pings whose Pongs may still come.
const IN_FLIGHT: usize = 16;

/// More than this share lost is bad; less than half of it is good.
const BAD_LOSS: f64 = 0.10;

/// Grown by more than this over the shortest of late is bad; by less than half of it, good.
const BAD_GROWTH_NS: u64 = 25_000_000;

/// Steps down: 1000, 500, 250 Hz.
const SLOWEST: u32 = 2;

/// Pongs of a good path before a step up, and the most that this grows to: 5 s and 80 s.
const PATIENCE: u32 = 5_000_000_000_u64.div_euclid(PING_EVERY_NS) as u32;
const MOST_PATIENCE: u32 = 16 * PATIENCE;

/// Windows over which the shortest round trip is remembered: a path may become longer for good.
const MEMORY_WINDOWS: u32 = 30;

/// One Pong.
#[derive(Clone, Copy, Debug, Default)]
struct Look {
    sent: u64,
    received: u64,
}

/// The pace of one session.
#[derive(Debug)]
pub(super) struct Pace {
    /// States sent until now.
    sent: u64,
    /// The same when a Ping left, by its number.
    when_pinged: [(u64, u64); IN_FLIGHT],
    /// The first Pong of the window, and how many followed it.
    first: Option<Look>,
    pongs: usize,
    /// Of the window's Pongs; the shortest of the last windows, and of those before.
    shortest_ns: [u64; 2],
    least_in_window_ns: u64,
    windows: u32,
    steps: u32,
    good_pongs: u32,
    patience: u32,
    /// It went up a step and has not proved good yet.
    on_trial: bool,
}

impl Pace {
    /// As fast as was asked for.
    pub fn new() -> Self {
        Self {
            sent: 0,
            when_pinged: [(0, 0); IN_FLIGHT],
            first: None,
            pongs: 0,
            shortest_ns: [u64::MAX; 2],
            least_in_window_ns: u64::MAX,
            windows: 0,
            steps: 0,
            good_pongs: 0,
            patience: PATIENCE,
            on_trial: false,
        }
    }

    /// Every how many of the States that were asked for one is sent: 1, 2 or 4. A deadband is as
    /// many times as wide.
    pub fn slowed_by(&self) -> u32 {
        1 << self.steps
    }

    /// A State went out.
    pub fn state_sent(&mut self) {
        self.sent += 1;
    }

    /// A Ping went out.
    pub fn pinged(&mut self, seq: u64) {
        self.when_pinged[(seq % IN_FLIGHT as u64) as usize] = (seq, self.sent);
    }

    /// Its Pong came, with how many States the client has got; one that does not count them
    /// says 0, and its way alone is judged.
    pub fn ponged(&mut self, seq: u64, states_received: u64, rtt_ns: u64) {
        let (pinged, sent) = self.when_pinged[(seq % IN_FLIGHT as u64) as usize];
        if pinged != seq {
            return;
        }
        let look = Look { sent, received: states_received };
        self.least_in_window_ns = self.least_in_window_ns.min(rtt_ns);
        let Some(first) = self.first else {
            (self.first, self.pongs) = (Some(look), 0);
            return;
        };
        self.pongs += 1;
        if self.pongs >= WINDOW {
            let least_ns = std::mem::replace(&mut self.least_in_window_ns, u64::MAX);
            let growth_ns = self.growth_ns(least_ns);
            self.judge(loss(&first, &look), growth_ns);
            (self.first, self.pongs) = (Some(look), 0);
        }
    }

    /// By how much even the luckiest of a window took longer than it can: what waits on the way.
    fn growth_ns(&mut self, least_in_window_ns: u64) -> u64 {
        self.windows += 1;
        if self.windows.is_multiple_of(MEMORY_WINDOWS) {
            self.shortest_ns = [u64::MAX, self.shortest_ns[0]];
        }
        self.shortest_ns[0] = self.shortest_ns[0].min(least_in_window_ns);
        least_in_window_ns - self.shortest_ns[0].min(self.shortest_ns[1])
    }

    fn judge(&mut self, loss: f64, growth_ns: u64) {
        if loss > BAD_LOSS || growth_ns > BAD_GROWTH_NS {
            if std::mem::take(&mut self.on_trial) {
                self.patience = (2 * self.patience).min(MOST_PATIENCE);
            }
            self.steps = (self.steps + 1).min(SLOWEST);
            self.good_pongs = 0;
        } else if loss < 0.5 * BAD_LOSS && growth_ns < BAD_GROWTH_NS / 2 {
            self.good_pongs += WINDOW as u32;
            if self.good_pongs >= self.patience {
                self.good_pongs = 0;
                if self.steps > 0 {
                    (self.steps, self.on_trial) = (self.steps - 1, true);
                } else {
                    (self.patience, self.on_trial) = (PATIENCE, false);
                }
            }
        } else {
            self.good_pongs = 0;
        }
    }
}

/// Share of the States between two Pings that had not come by their Pongs.
fn loss(first: &Look, last: &Look) -> f64 {
    let sent = last.sent.saturating_sub(first.sent);
    let received = last.received.saturating_sub(first.received);
    if sent == 0 || last.received == 0 {
        return 0.0;
    }
    1.0 - (received as f64 / sent as f64).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// Seconds of a path that loses this share and takes this long; States a second.
    struct Path {
        pace: Pace,
        seq: u64,
        received: f64,
    }

    impl Path {
        fn new() -> Self {
            Self { pace: Pace::new(), seq: 0, received: 0.0 }
        }

        fn run(&mut self, seconds: u64, loss: f64, rtt_ms: u64) -> Vec<u32> {
            let mut paces = Vec::new();
            for _ in 0..seconds {
                for _ in 0..10 {
                    let states = 100 / self.pace.slowed_by();
                    (0..states).for_each(|_| self.pace.state_sent());
                    self.received += f64::from(states) * (1.0 - loss);
                    self.seq += 1;
                    self.pace.pinged(self.seq);
                    self.pace.ponged(self.seq, self.received as u64, rtt_ms * MS);
                }
                paces.push(self.pace.slowed_by());
            }
            paces
        }
    }

    #[test]
    fn a_little_loss_is_borne_and_much_of_it_slows_the_stream_step_by_step() {
        let mut path = Path::new();
        assert!(path.run(30, 0.05, 60).iter().all(|pace| *pace == 1));
        let paces = path.run(10, 0.3, 60);
        assert_eq!(paces.iter().max(), Some(&4));
        assert!(paces.windows(2).all(|pair| pair[1] <= 2 * pair[0]), "{paces:?}");
        assert!(paces.iter().position(|pace| *pace == 4).unwrap() <= 3, "{paces:?}");
    }

    #[test]
    fn growing_delay_slows_it_and_a_long_path_does_not() {
        let mut path = Path::new();
        assert!(path.run(20, 0.0, 200).iter().all(|pace| *pace == 1), "it is as long as ever");
        assert_eq!(path.run(3, 0.0, 240).last(), Some(&4), "40 ms wait on the way");
        assert_eq!(path.run(12, 0.0, 200).last(), Some(&1), "and wait no more");
    }

    #[test]
    fn it_recovers_and_is_slower_to_trust_a_path_that_went_bad_again() {
        let mut path = Path::new();
        path.run(3, 0.3, 20);
        let paces = path.run(12, 0.0, 20);
        let back = paces.iter().position(|pace| *pace == 1).unwrap();
        assert!((8..=11).contains(&back), "two steps of five seconds: {paces:?}");
        path.run(3, 0.3, 20);
        let paces = path.run(30, 0.0, 20);
        let back = paces.iter().position(|pace| *pace == 1).unwrap();
        assert!(back > 15, "it was too early: {paces:?}");
    }

    #[test]
    fn a_client_that_counts_nothing_and_pongs_of_no_ping_change_nothing() {
        let mut pace = Pace::new();
        for seq in 1..500 {
            (0..100).for_each(|_| pace.state_sent());
            pace.pinged(seq);
            pace.ponged(seq, 0, 20 * MS);
            pace.ponged(seq + 7, 1, 900 * MS);
            pace.ponged(u64::MAX, u64::MAX, u64::MAX);
        }
        assert_eq!(pace.slowed_by(), 1);
    }
}

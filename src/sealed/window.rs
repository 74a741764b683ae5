//! Which numbers were used already (RFC 6479): a ring of bits that is cleared block by block as
//! the newest number goes on, and never shifted.

/// Bits of a block.
const BLOCK: u64 = u64::BITS as u64;

/// Blocks of the ring, one of them being filled: 2048 numbers behind the newest are remembered,
/// two seconds of a stream at 1 kHz.
const BLOCKS: u64 = 33;

/// Numbers that may come this far behind the newest.
const WINDOW: u64 = (BLOCKS - 1) * BLOCK;

/// The numbers seen of one sender, who counts from 1.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReplayWindow {
    newest: u64,
    blocks: [u64; BLOCKS as usize],
}

impl Default for ReplayWindow {
    fn default() -> Self {
        Self { newest: 0, blocks: [0; BLOCKS as usize] }
    }
}

impl ReplayWindow {
    /// It was not taken before. What is too old to tell counts as taken.
    pub fn is_new(&self, number: u64) -> bool {
        if number == 0 || self.newest.saturating_sub(number) >= WINDOW {
            return false;
        }
        number > self.newest || self.blocks[place(number)] & bit(number) == 0
    }

    /// Takes it. Only of what is authentic: a forged number must not move the window.
    pub fn take(&mut self, number: u64) {
        if number > self.newest {
            let passed = (number / BLOCK - self.newest / BLOCK).min(BLOCKS);
            for block in 1..=passed {
                self.blocks[place((self.newest / BLOCK + block) * BLOCK)] = 0;
            }
            // Where the whole ring was passed all of it is clear, this block too.
            self.newest = number;
        }
        self.blocks[place(number)] |= bit(number);
    }
}

fn place(number: u64) -> usize {
    (number / BLOCK % BLOCKS) as usize
}

fn bit(number: u64) -> u64 {
    1 << (number % BLOCK)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::HashSet;

    /// Offers it as an opener does.
    fn offer(window: &mut ReplayWindow, number: u64) -> bool {
        let new = window.is_new(number);
        if new {
            window.take(number);
        }
        new
    }

    #[test]
    fn each_number_is_taken_once_and_the_old_not_at_all() {
        let mut window = ReplayWindow::default();
        assert!(!offer(&mut window, 0));
        assert!(offer(&mut window, 1) && !offer(&mut window, 1));
        assert!(offer(&mut window, WINDOW));
        assert!(offer(&mut window, WINDOW + 5) && !offer(&mut window, 5), "just too old");
        assert!(offer(&mut window, 6), "just not");
        assert!(offer(&mut window, u64::MAX) && !offer(&mut window, u64::MAX));
        assert!(!offer(&mut window, WINDOW + 6));
    }

    #[test]
    fn the_last_of_all_numbers_has_a_window_as_any_other() {
        let mut window = ReplayWindow::default();
        assert!(offer(&mut window, u64::MAX));
        assert!(offer(&mut window, u64::MAX - WINDOW + 1) && offer(&mut window, u64::MAX - 1));
        assert!(!offer(&mut window, u64::MAX - WINDOW) && !offer(&mut window, u64::MAX - 1));
    }

    proptest! {
        #[test]
        fn it_agrees_with_a_set_of_all_numbers(
            steps in proptest::collection::vec((-3000_i64..3000, any::<bool>()), 1..400),
            begin in 1_u64..10_000,
        ) {
            let (mut window, mut seen, mut newest) =
                (ReplayWindow::default(), HashSet::new(), 0);
            let mut at = begin;
            for (step, far) in steps {
                at = at.saturating_add_signed(if far { step } else { step % 70 }).max(1);
                let expected = at + WINDOW > newest && seen.insert(at);
                prop_assert_eq!(offer(&mut window, at), expected, "{} after {}", at, newest);
                newest = newest.max(at);
            }
        }
    }
}

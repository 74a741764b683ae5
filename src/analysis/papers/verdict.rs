//! Conclusions of a paper, each with a rule in words and a verdict that was computed by it.
//!
//! A rule is one or two conditions on figures of a run: all hold, some hold, none holds. The
//! condition that must hold for "confirmed in part" may be stated on its own.

use std::fmt;

/// What becomes of a conclusion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The rule holds.
    Confirmed,
    /// A part of it holds.
    InPart,
    /// It does not hold.
    NotConfirmed,
    /// There is nothing here to judge it by.
    NotTestable,
}

impl Verdict {
    /// Every verdict, for tables.
    pub const ALL: [Self; 4] =
        [Self::Confirmed, Self::InPart, Self::NotConfirmed, Self::NotTestable];

    /// Confirmed where all conditions hold, in part where one of them does.
    pub fn of(conditions: &[bool]) -> Self {
        let held = conditions.iter().filter(|held| **held).count();
        match held {
            0 => Self::NotConfirmed,
            _ if held == conditions.len() => Self::Confirmed,
            _ => Self::InPart,
        }
    }

    /// As in the pages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Confirmed => "confirmed",
            Self::InPart => "confirmed in part",
            Self::NotConfirmed => "not confirmed",
            Self::NotTestable => "not testable here",
        }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// One conclusion of a paper.
#[derive(Clone, Debug)]
pub struct Conclusion {
    /// Where the paper has it.
    pub source: &'static str,
    /// In at most twelve words.
    pub words: &'static str,
    /// How the verdict follows from the figures.
    pub rule: &'static str,
    /// What follows.
    pub verdict: Verdict,
    /// The figures.
    pub figures: String,
}

impl Conclusion {
    /// A conclusion that is judged by conditions.
    pub fn judged(
        (source, words): (&'static str, &'static str),
        rule: &'static str,
        conditions: &[bool],
        figures: String,
    ) -> Self {
        Self { source, words, rule, verdict: Verdict::of(conditions), figures }
    }

    /// A conclusion that cannot be judged here, and why.
    pub fn not_testable(source: &'static str, words: &'static str, why: &'static str) -> Self {
        Self { source, words, rule: why, verdict: Verdict::NotTestable, figures: "-".to_owned() }
    }
}

/// What tests of all papers ask of their conclusions.
#[cfg(test)]
pub(super) fn well_formed(conclusions: &[Conclusion]) {
    for one in conclusions {
        assert!(one.words.split_whitespace().count() <= 12, "{:?}", one.words);
        assert!(!one.rule.is_empty() && !one.source.is_empty(), "{one:?}");
        assert!(!one.figures.contains("NaN") && !one.figures.contains("inf"), "{one:?}");
    }
}

/// The verdict on the conclusion that begins with these words.
#[cfg(test)]
pub(super) fn verdict_on(conclusions: &[Conclusion], begins: &str) -> Verdict {
    let found = conclusions.iter().find(|one| one.words.starts_with(begins));
    found.unwrap_or_else(|| panic!("no conclusion begins with {begins:?}")).verdict
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_some_or_none_of_the_conditions_make_the_verdict() {
        assert_eq!(Verdict::of(&[true, true]), Verdict::Confirmed);
        assert_eq!(Verdict::of(&[true, false]), Verdict::InPart);
        assert_eq!(Verdict::of(&[false, false]), Verdict::NotConfirmed);
    }
}

//! Strategies by name: the rules that turn a desired force into torques.
//!
//! Which rule runs when is told in [`allocate`](super::allocate).

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// A rule that turns a desired force into torques.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Strategy {
    /// The wall law where there is a wall, else the optimum.
    #[default]
    Auto,
    /// The nearest achievable force.
    Optimal,
    /// Cho 2005: the exact pair, else the nearest reference force.
    NearestReference,
    /// Cho 2005: the one brake whose path leads out of the wall, with the mended condition.
    Coercive,
    /// The same as printed; it may lead into the wall.
    CoerciveLiteral,
    /// One brake whose locking leads out of the wall, by looking a tick ahead.
    PredictedVelocity,
    /// One brake that slips at the pressing force.
    Sliding,
    /// Swanson and Book: brakes steer the velocity across the wall.
    PathFollowing,
    /// Kim 2003: the torques of least norm, clipped to the limits.
    LeastNorm,
    /// Kim 2003: those of least weighted norm, clipped.
    Weighted,
    /// Kim 2003: one floating actuator at its limit, the rest spread; clipped.
    NullSpace,
    /// The same for as many actuators as there are to spare; clipped.
    NullSpaceIterated,
}

impl Strategy {
    /// Every strategy, for tables and help.
    pub const ALL: [Self; 12] = [
        Self::Auto,
        Self::Optimal,
        Self::NearestReference,
        Self::Coercive,
        Self::CoerciveLiteral,
        Self::PredictedVelocity,
        Self::Sliding,
        Self::PathFollowing,
        Self::LeastNorm,
        Self::Weighted,
        Self::NullSpace,
        Self::NullSpaceIterated,
    ];

    /// Those that know what a wall is.
    pub const WALL_LAWS: [Self; 5] = [
        Self::Coercive,
        Self::CoerciveLiteral,
        Self::PredictedVelocity,
        Self::Sliding,
        Self::PathFollowing,
    ];

    /// The name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Optimal => "optimal",
            Self::NearestReference => "nearest-reference",
            Self::Coercive => "coercive",
            Self::CoerciveLiteral => "coercive-literal",
            Self::PredictedVelocity => "predicted-velocity",
            Self::Sliding => "sliding",
            Self::PathFollowing => "path-following",
            Self::LeastNorm => "least-norm",
            Self::Weighted => "weighted",
            Self::NullSpace => "null-space",
            Self::NullSpaceIterated => "null-space-iterated",
        }
    }
}

impl fmt::Display for Strategy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// A name that is no strategy.
#[derive(Clone, Debug, PartialEq, Eq)]
#[allow(clippy::disallowed_types, reason = "made where a name is read, never in a tick")]
pub struct StrategyError(pub String);

impl fmt::Display for StrategyError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "no strategy `{}`: one of ", self.0)?;
        for (i, strategy) in Strategy::ALL.iter().enumerate() {
            write!(f, "{}{strategy}", if i > 0 { ", " } else { "" })?;
        }
        Ok(())
    }
}

impl std::error::Error for StrategyError {}

impl FromStr for Strategy {
    type Err = StrategyError;

    #[expect(clippy::disallowed_methods, reason = "reads what somebody wrote, never in a tick")]
    fn from_str(name: &str) -> Result<Self, Self::Err> {
        let found = Self::ALL.into_iter().find(|strategy| strategy.name() == name);
        found.ok_or_else(|| StrategyError(name.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_as_they_are_written() {
        for strategy in Strategy::ALL {
            assert_eq!(strategy.to_string().parse(), Ok(strategy));
        }
        let error = "best".parse::<Strategy>().unwrap_err().to_string();
        assert!(error.contains("best") && error.contains("null-space-iterated"));
    }
}

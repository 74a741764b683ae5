//! The enums of control, actuation and environment as the contract names them.
//!
//! One match per enum, so that a new variant does not compile until it has its name on the
//! wire. The other direction does not exist: none of these is ever read from a client.

use crate::actuation::{Region, Strategy};
use crate::control::{Fault, Limit, Mode, RenderedSource};
use crate::environment::Source;
use crate::proto;

/// Ids from here on are object slots of the resident scene, those below are contacts of
/// the controller: the slot is what is left without this bit.
pub const SCENE_ID: u32 = 1 << 31;

/// A surface as State and Event name it.
pub fn surface_id(source: Source, id: u32) -> u32 {
    match source {
        Source::Scene => SCENE_ID | id,
        Source::Controller => id & !SCENE_ID,
    }
}

impl From<Mode> for proto::Mode {
    fn from(mode: Mode) -> Self {
        match mode {
            Mode::Disabled => Self::Disabled,
            Mode::Enabled => Self::Enabled,
            Mode::Stopped => Self::Stopped,
            Mode::Fault => Self::Fault,
        }
    }
}

impl From<Region> for proto::Region {
    fn from(region: Region) -> Self {
        match region {
            Region::Full => Self::Full,
            Region::Approximate => Self::Approximate,
            Region::NotDisplayable => Self::NotDisplayable,
        }
    }
}

impl From<Strategy> for proto::Strategy {
    fn from(strategy: Strategy) -> Self {
        match strategy {
            Strategy::Auto => Self::Auto,
            Strategy::Optimal => Self::Optimal,
            Strategy::NearestReference => Self::NearestReference,
            Strategy::PredictedVelocity => Self::PredictedVelocity,
            Strategy::Sliding => Self::Sliding,
            Strategy::PathFollowing => Self::PathFollowing,
            Strategy::Coercive => Self::Coercive,
            Strategy::CoerciveLiteral => Self::CoerciveLiteral,
            Strategy::LeastNorm => Self::LeastNorm,
            Strategy::Weighted => Self::Weighted,
            Strategy::NullSpace => Self::NullSpace,
            Strategy::NullSpaceIterated => Self::NullSpaceIterated,
        }
    }
}

impl From<RenderedSource> for proto::RenderedSource {
    fn from(source: RenderedSource) -> Self {
        match source {
            RenderedSource::Measured => Self::Measured,
            RenderedSource::Modelled => Self::Modelled,
            RenderedSource::Unknown => Self::Unknown,
        }
    }
}

impl From<Limit> for proto::Limit {
    fn from(limit: Limit) -> Self {
        match limit {
            Limit::Torque => Self::Torque,
            Limit::Force => Self::Force,
            Limit::Slew => Self::Slew,
            Limit::Stale => Self::Stale,
            Limit::Freedom => Self::Freedom,
            Limit::Constraints => Self::Constraints,
            Limit::Clutch => Self::Clutch,
            Limit::Activation => Self::Activation,
            Limit::Stiffness => Self::Stiffness,
            Limit::Passivity => Self::Passivity,
        }
    }
}

impl From<Fault> for proto::Fault {
    fn from(fault: Fault) -> Self {
        match fault {
            Fault::Device => Self::Device,
            Fault::NotFinite => Self::NotFinite,
            Fault::Unreachable => Self::Unreachable,
            Fault::Singular => Self::Singular,
            Fault::Closure => Self::Closure,
            Fault::Overrun => Self::Overrun,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Limits;

    #[test]
    fn limit_n_of_the_contract_is_bit_n_minus_one() {
        for limit in Limit::ALL {
            let mut limits = Limits::default();
            limits.set(limit, true);
            assert_eq!(limits.bits(), 1 << (proto::Limit::from(limit) as u32 - 1));
        }
    }

    #[test]
    fn names_on_the_wire_are_the_names_in_the_crate() {
        for limit in Limit::ALL {
            let name = proto::Limit::from(limit).as_str_name().to_lowercase();
            assert_eq!(name, format!("limit_{}", limit.name()));
        }
        for fault in Fault::ALL {
            let name = proto::Fault::from(fault).as_str_name().to_lowercase();
            assert_eq!(name, format!("fault_{}", fault.name()));
        }
        let names = [
            proto::Mode::from(Mode::Stopped).as_str_name(),
            proto::Region::from(Region::NotDisplayable).as_str_name(),
            proto::Strategy::from(Strategy::PredictedVelocity).as_str_name(),
            proto::RenderedSource::from(RenderedSource::Modelled).as_str_name(),
        ];
        assert_eq!(
            names,
            [
                "MODE_STOPPED",
                "REGION_NOT_DISPLAYABLE",
                "STRATEGY_PREDICTED_VELOCITY",
                "RENDERED_SOURCE_MODELLED"
            ]
        );
    }

    #[test]
    fn a_contact_and_an_object_of_the_same_number_are_told_apart() {
        assert_eq!(surface_id(Source::Controller, 3), 3);
        assert_eq!(surface_id(Source::Scene, 3), 0x8000_0003);
    }
}

//! The tables `[mechanism]` and `[inertia]` of a device file, as the linkages take them.
//!
//! Which keys `[mechanism]` has is the business of its kind in [`crate::mechanism`]; so are
//! the ranges of everything here.

use std::collections::BTreeMap;

use serde::Deserialize;

use super::device_file::{ActuatorLayout, per_actuator};
use crate::mechanism::{self, LinkInertia, Value, Weights};
use crate::units::FieldError;

/// `[mechanism]`: `kind` and the keys of that kind.
pub(super) type MechanismLayout = BTreeMap<String, Value>;

/// `[inertia]`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct InertiaLayout {
    pub handle_mass_kg: f64,
    pub handle_inertia_kg_m2: Option<f64>,
    pub links: Vec<LinkLayout>,
}

impl Default for InertiaLayout {
    fn default() -> Self {
        Self { handle_mass_kg: 0.5, handle_inertia_kg_m2: None, links: Vec::new() }
    }
}

/// One entry of `links`.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LinkLayout {
    pub mass_kg: f64,
    pub centre_m: f64,
    pub inertia_kg_m2: f64,
}

/// The linkage that the tables describe together.
pub(super) fn build(
    mechanism: &MechanismLayout,
    inertia: &InertiaLayout,
    actuators: &[ActuatorLayout],
) -> Result<mechanism::Built, FieldError> {
    let link = |&LinkLayout { mass_kg, centre_m, inertia_kg_m2 }: &LinkLayout| LinkInertia {
        mass_kg,
        centre_m,
        inertia_kg_m2,
    };
    let weights = Weights {
        handle_mass_kg: inertia.handle_mass_kg,
        handle_inertia_kg_m2: inertia.handle_inertia_kg_m2,
        links: inertia.links.iter().map(link).collect(),
        shaft_inertia_kg_m2: per_actuator(actuators, 0.0, |one| one.shaft_inertia_kg_m2),
    };
    mechanism::build(mechanism, &weights)
}

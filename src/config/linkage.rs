//! The tables `[mechanism]` and `[inertia]` of a device file, and the linkage they describe.
//!
//! The ranges of a linkage's parameters belong to [`crate::mechanism`] and are not repeated
//! here; its refusals come out under the key that their author wrote. One table has the keys
//! of every kind of linkage, so that a key of another kind is named as such.

use std::sync::Arc;

use serde::Deserialize;

use super::device_file::{ActuatorLayout, per_actuator, quoted};
use crate::mechanism::{
    FiveBar, FiveBarParameters, Inertia, LinkInertia, Mechanism, ParameterError, TwoLink,
    TwoLinkParameters,
};
use crate::units::{FieldError, Range};

/// `[mechanism]`: the keys of every kind of linkage; a check asks for those of its kind.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MechanismLayout {
    pub kind: String,
    pub l_m: Option<[f64; 5]>,
    pub k3: Option<f64>,
    pub k4: Option<f64>,
    pub lever: Option<i32>,
    pub tendons: Option<String>,
    pub branch: Option<i32>,
    pub l1_m: Option<f64>,
    pub l2_m: Option<f64>,
    pub elbow: Option<i32>,
}

/// `[inertia]`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct InertiaLayout {
    pub handle_mass_kg: f64,
    pub links: Vec<LinkLayout>,
}

impl Default for InertiaLayout {
    fn default() -> Self {
        Self { handle_mass_kg: 0.5, links: Vec::new() }
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

/// A linkage with the numbers that it was built from.
pub(super) type BuiltMechanism = (Arc<dyn Mechanism>, Vec<(String, f64)>);

impl MechanismLayout {
    /// The linkage that the tables describe together.
    pub fn build(
        &self,
        inertia: &InertiaLayout,
        actuators: &[ActuatorLayout],
    ) -> Result<BuiltMechanism, FieldError> {
        match self.kind.as_str() {
            "five-bar" => {
                self.refuse_keys_of("two-link", &[("l1_m", &self.l1_m), ("l2_m", &self.l2_m)])?;
                self.five_bar(inertia, actuators)
            }
            "two-link" => {
                let l_m = self.l_m.map(|l_m| l_m[0]);
                let signs = [self.lever, self.branch].map(|sign| sign.map(f64::from));
                let tendons = self.tendons.as_ref().map(|_| 0.0);
                let others: [(&str, &Option<f64>); 6] = [
                    ("l_m", &l_m),
                    ("k3", &self.k3),
                    ("k4", &self.k4),
                    ("lever", &signs[0]),
                    ("branch", &signs[1]),
                    ("tendons", &tendons),
                ];
                self.refuse_keys_of("five-bar", &others)?;
                self.two_link(inertia, actuators)
            }
            other => Err(FieldError::new(
                "mechanism.kind",
                quoted(other),
                "must be \"two-link\" or \"five-bar\"",
            )),
        }
    }

    fn five_bar(
        &self,
        inertia: &InertiaLayout,
        actuators: &[ActuatorLayout],
    ) -> Result<BuiltMechanism, FieldError> {
        let tendons = match self.tendons.as_deref() {
            None | Some("straight") => 1,
            Some("crossed") => -1,
            Some(other) => {
                let allowed = "must be \"straight\" or \"crossed\"";
                return Err(FieldError::new("mechanism.tendons", quoted(other), allowed));
            }
        };
        let parameters = FiveBarParameters {
            l_m: required("mechanism.l_m", self.l_m)?,
            k3: required("mechanism.k3", self.k3)?,
            k4: required("mechanism.k4", self.k4)?,
            lever: self.lever.unwrap_or(-1),
            tendons,
            elbow: self.elbow.unwrap_or(1),
            branch: self.branch.unwrap_or(1),
        };
        let device = FiveBar::new(parameters, inertia.build(actuators)?).map_err(located)?;
        let lengths = (1..).zip(parameters.l_m).map(|(i, l_m)| (format!("l{i}_m"), l_m));
        let signs = [
            ("lever", parameters.lever),
            ("tendons", parameters.tendons),
            ("elbow", parameters.elbow),
            ("branch", parameters.branch),
        ];
        let named = lengths
            .chain([("k3".to_owned(), parameters.k3), ("k4".to_owned(), parameters.k4)])
            .chain(signs.map(|(name, sign)| (name.to_owned(), f64::from(sign))));
        Ok((Arc::new(device), named.collect()))
    }

    fn two_link(
        &self,
        inertia: &InertiaLayout,
        actuators: &[ActuatorLayout],
    ) -> Result<BuiltMechanism, FieldError> {
        let parameters = TwoLinkParameters {
            l1_m: required("mechanism.l1_m", self.l1_m)?,
            l2_m: required("mechanism.l2_m", self.l2_m)?,
            elbow: self.elbow.unwrap_or(1),
        };
        let device = TwoLink::new(parameters, inertia.build(actuators)?).map_err(located)?;
        let TwoLinkParameters { l1_m, l2_m, elbow } = parameters;
        let named = [("l1_m", l1_m), ("l2_m", l2_m), ("elbow", f64::from(elbow))];
        Ok((Arc::new(device), named.map(|(name, value)| (name.to_owned(), value)).to_vec()))
    }

    fn refuse_keys_of(&self, kind: &str, keys: &[(&str, &Option<f64>)]) -> Result<(), FieldError> {
        for (key, value) in keys {
            if value.is_some() {
                let allowed = format!("is a key of kind {kind:?}, not of {:?}", self.kind);
                return Err(FieldError::new(format!("mechanism.{key}"), "(set)", allowed));
            }
        }
        Ok(())
    }
}

impl InertiaLayout {
    /// What moves on a linkage of `N` links; no `links` at all are massless ones.
    fn build<const N: usize>(
        &self,
        actuators: &[ActuatorLayout],
    ) -> Result<Inertia<N>, FieldError> {
        if !self.links.is_empty() && self.links.len() != N {
            let allowed = format!("must be none or {N} entries");
            return Err(FieldError::new(
                "inertia.links",
                format!("{} entries", self.links.len()),
                allowed,
            ));
        }
        let link = |i: usize| {
            self.links.get(i).map_or(LinkInertia::default(), |link| LinkInertia {
                mass_kg: link.mass_kg,
                centre_m: link.centre_m,
                inertia_kg_m2: link.inertia_kg_m2,
            })
        };
        Ok(Inertia {
            handle_mass_kg: self.handle_mass_kg,
            links: std::array::from_fn(link),
            shaft_inertia_kg_m2: per_actuator(actuators, 0.0, |one| one.shaft_inertia_kg_m2),
        })
    }
}

fn required<T>(field: &str, value: Option<T>) -> Result<T, FieldError> {
    value.ok_or_else(|| FieldError::new(field, "(missing)", "this kind of mechanism needs it"))
}

/// A refusal of the linkage, under the key that its author wrote.
fn located(error: ParameterError) -> FieldError {
    match error {
        ParameterError::OutOfRange { field, value, least, most, unit } => {
            let range = Range::new(least, most, unit);
            FieldError::new(key_of(&field), value, format!("must be a number in {range}"))
        }
        ParameterError::NotASign { field, value } => {
            FieldError::new(key_of(field), value, "must be -1 or 1")
        }
        ParameterError::CannotClose { field, value, most } => {
            let allowed = format!(
                "must be less than {most} m, the other links together, or the loop cannot close"
            );
            FieldError::new(key_of(&field), value, allowed)
        }
    }
}

/// Where a parameter of a linkage stands in the file.
fn key_of(parameter: &str) -> String {
    match parameter.strip_prefix("shaft_inertia_kg_m2") {
        Some(index) => format!("actuators{index}.shaft_inertia_kg_m2"),
        None if parameter.starts_with("links") || parameter.starts_with("handle_mass") => {
            format!("inertia.{parameter}")
        }
        None => format!("mechanism.{parameter}"),
    }
}

//! Designs as lists of numbers: the variables of a braked five-bar within bounds, and back.
//!
//! As in Cho 2005, Eq 18, the lengths are those of links 1 to 4 over l5, which stays what the
//! given device has; the variables here are the lengths in metres and the two ratios. Signs
//! (lever, tendons, elbow, branch) are those of the given device: they are its class.

use crate::mechanism::{FiveBar, FiveBarParameters, Inertia, ParameterError};
use crate::units::{FieldError, Range};

/// l1, l2, l3, l4, k3, k4.
pub const VARIABLES: usize = 6;

/// Names of the variables, in order.
pub const NAMES: [&str; VARIABLES] = ["l1_m", "l2_m", "l3_m", "l4_m", "k3", "k4"];

/// Variables, metres and radians per radian.
pub type Variables = [f64; VARIABLES];

/// What a design may be (Cho 2005, Eq 19 and 20).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DesignBounds {
    /// Least and most length of links 1 to 4.
    pub l_m: [f64; 2],
    /// Least and most ratio.
    pub k: [f64; 2],
}

impl Default for DesignBounds {
    /// Those under which the published design was found.
    fn default() -> Self {
        Self { l_m: [0.1, 0.3], k: [0.1, 1.0] }
    }
}

impl DesignBounds {
    /// Refuses bounds that no linkage can have.
    pub fn check(&self) -> Result<(), FieldError> {
        let ranges = [
            ("l", self.l_m, Range::new(1e-3, 10.0, "m")),
            ("k", self.k, Range::new(1e-3, 100.0, "rad/rad")),
        ];
        for (name, [least, most], allowed) in ranges {
            allowed.check(&format!("{name}[0]"), least)?;
            allowed.check(&format!("{name}[1]"), most)?;
            if most <= least {
                let allowed = format!("must be larger than {name}[0]");
                return Err(FieldError::new(format!("{name}[1]"), most, allowed));
            }
        }
        Ok(())
    }

    /// Least and most of each variable.
    pub fn of_variables(&self) -> [[f64; 2]; VARIABLES] {
        [self.l_m, self.l_m, self.l_m, self.l_m, self.k, self.k]
    }

    /// The variables at these shares of their ranges.
    pub fn at(&self, shares: &[f64]) -> Variables {
        let bounds = self.of_variables();
        std::array::from_fn(|i| bounds[i][0] + shares[i] * (bounds[i][1] - bounds[i][0]))
    }

    /// The shares of their ranges that variables are at.
    pub fn shares(&self, variables: &Variables) -> Vec<f64> {
        let ranged = self.of_variables().into_iter().zip(variables);
        ranged.map(|([least, most], value)| (value - least) / (most - least)).collect()
    }
}

/// The five-bar that a device's named parameters describe; `None`: it is no five-bar.
pub fn five_bar_of(parameters: &[(String, f64)]) -> Option<FiveBarParameters> {
    let value = |name: &str| parameters.iter().find(|(own, _)| own == name).map(|(_, v)| *v);
    let sign = |name: &str| value(name).map(|v| if v < 0.0 { -1 } else { 1 });
    Some(FiveBarParameters {
        l_m: [value("l1_m")?, value("l2_m")?, value("l3_m")?, value("l4_m")?, value("l5_m")?],
        k3: value("k3")?,
        k4: value("k4")?,
        lever: sign("lever")?,
        tendons: sign("tendons")?,
        elbow: sign("elbow")?,
        branch: sign("branch")?,
    })
}

/// The variables of a five-bar.
pub fn variables_of(parameters: &FiveBarParameters) -> Variables {
    let [l1, l2, l3, l4, _] = parameters.l_m;
    [l1, l2, l3, l4, parameters.k3, parameters.k4]
}

/// A five-bar of the same class with other variables.
pub fn with_variables(class: &FiveBarParameters, variables: &Variables) -> FiveBarParameters {
    let [l1, l2, l3, l4, k3, k4] = *variables;
    FiveBarParameters { l_m: [l1, l2, l3, l4, class.l_m[4]], k3, k4, ..*class }
}

/// The linkage itself, with massless links: indices of direction do not see mass.
pub fn build(parameters: &FiveBarParameters) -> Result<FiveBar, ParameterError> {
    FiveBar::new(*parameters, Inertia::default())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::DeviceDefinition;
    use crate::mechanism::fixtures;

    #[test]
    fn a_device_is_read_back_as_the_five_bar_that_it_is() {
        for (name, expected) in
            ["cho-2005", "cho-2005-unoptimised", "cho-2005-crossed"].into_iter().zip(fixtures::CHO)
        {
            let device = DeviceDefinition::load(name).unwrap();
            assert_eq!(five_bar_of(&device.parameters), Some(expected), "{name}");
        }
        let other = DeviceDefinition::load("two-link").unwrap();
        assert_eq!(five_bar_of(&other.parameters), None);
    }

    #[test]
    fn variables_and_shares_go_there_and_back() {
        let bounds = DesignBounds::default();
        let variables = variables_of(&fixtures::CHO[0]);
        assert_eq!(with_variables(&fixtures::CHO[0], &variables), fixtures::CHO[0]);
        let back = bounds.at(&bounds.shares(&variables));
        assert!(back.iter().zip(variables).all(|(a, b)| (a - b).abs() < 1e-15), "{back:?}");
    }

    #[test]
    fn bounds_that_no_linkage_has_are_refused() {
        let refused = |l_m, k| DesignBounds { l_m, k }.check().unwrap_err().to_string();
        assert!(refused([0.3, 0.1], [0.1, 1.0]).starts_with("l[1] = 0.1"));
        assert!(refused([0.1, 0.3], [0.0, 1.0]).starts_with("k[0] = 0"));
        assert!(refused([0.1, f64::NAN], [0.1, 1.0]).starts_with("l[1] = NaN"));
    }
}

//! What a credential allows.

use std::fmt;
use std::str::FromStr;

use crate::units::FieldError;

/// What its holder may do; each includes those before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Grant {
    /// Watch and read.
    Observer,
    /// Command a device as well. Pulling the handle of a simulated device counts: it moves
    /// what others feel.
    Controller,
    /// Decide about the device and about others as well.
    Operator,
}

impl Grant {
    /// From the least to the most.
    pub const ALL: [Self; 3] = [Self::Observer, Self::Controller, Self::Operator];

    /// Its name on the command line, in files and as a label of metrics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Observer => "observer",
            Self::Controller => "controller",
            Self::Operator => "operator",
        }
    }

    /// The grant of a name; `field` is where it was found.
    pub fn parse(field: &str, name: &str) -> Result<Self, FieldError> {
        let found = Self::ALL.into_iter().find(|grant| grant.name() == name);
        found.ok_or_else(|| {
            let shown: String = name.chars().take(32).collect();
            let allowed = "must be \"observer\", \"controller\" or \"operator\"";
            FieldError::new(field, format!("{shown:?}"), allowed)
        })
    }
}

impl fmt::Display for Grant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Grant {
    type Err = FieldError;

    fn from_str(name: &str) -> Result<Self, FieldError> {
        Self::parse("role", name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_includes_those_before_it_and_is_known_by_its_name() {
        assert!(Grant::Observer < Grant::Controller && Grant::Controller < Grant::Operator);
        for grant in Grant::ALL {
            assert_eq!(grant.name().parse(), Ok(grant));
        }
        for wrong in ["", "Operator", "operator ", "root"] {
            let said = wrong.parse::<Grant>().unwrap_err().to_string();
            assert!(said.starts_with("role = ") && said.contains("observer"), "{said}");
        }
    }
}

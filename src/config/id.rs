//! Identifiers of devices, scene objects and actuators: one rule for all of them.
//!
//! 1 to 63 of `a-z`, `0-9` and `-`, beginning with a letter: fit for a resource name, a file
//! name on any system, a metric label and a shell, without quoting.

use std::fmt;

use crate::units::FieldError;

/// Longest identifier.
const LONGEST: usize = 63;

/// A checked identifier.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Id(String);

impl Id {
    /// The identifier in `text`; `field` is where it was found.
    pub fn parse(field: &str, text: &str) -> Result<Self, FieldError> {
        let begins = text.starts_with(|c: char| c.is_ascii_lowercase());
        let inside = |b: u8| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-';
        if begins && text.len() <= LONGEST && text.bytes().all(inside) {
            return Ok(Self(text.to_owned()));
        }
        let shown: String = text.chars().take(LONGEST + 1).collect();
        let allowed = "must be 1 to 63 of a-z, 0-9 and \"-\", beginning with a letter";
        Err(FieldError::new(field, format!("{shown:?}"), allowed))
    }

    /// The identifier as text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for Id {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identifiers_follow_the_rule() {
        let longest = "a".repeat(63);
        for good in ["a", "wall", "cho-2005", "a--", &longest] {
            assert_eq!(Id::parse("id", good).unwrap().as_str(), good);
        }
        let too_long = "a".repeat(64);
        for bad in ["", "-a", "2a", "A", "a_b", "a/b", "..", "a\n", "é", &too_long] {
            let error = Id::parse("object_id", bad).unwrap_err();
            assert_eq!(error.field, "object_id", "{bad:?}");
        }
    }
}

//! How values look on a terminal.

use std::time::Duration;

use crate::proto::{Limit, Mode, Region, Strategy, Vector3};

/// A day: longer runs are for `serve`.
const LONGEST_S: f64 = 86_400.0;

/// A vector with its unit.
pub fn vector(v: Option<&Vector3>, digits: usize) -> String {
    match v {
        None => "unknown".into(),
        Some(v) => format!("({:.digits$}, {:.digits$}, {:.digits$})", v.x, v.y, v.z),
    }
}

/// Length of a vector.
pub fn norm(v: &Vector3) -> f64 {
    (v.x * v.x + v.y * v.y + v.z * v.z).sqrt()
}

/// `MODE_ENABLED` as `enabled`, and so on for every enum of the contract.
pub fn word(name: &str, prefix: &str) -> String {
    name.strip_prefix(prefix).unwrap_or(name).to_lowercase().replace('_', "-")
}

/// A mode in a word.
pub fn mode(mode: Mode) -> String {
    word(mode.as_str_name(), "MODE_")
}

/// A region in words.
pub fn region(region: Region) -> String {
    match region {
        Region::Unspecified => "none (at rest, or nothing asked)".into(),
        region => word(region.as_str_name(), "REGION_"),
    }
}

/// A law in a word.
pub fn law(law: Strategy) -> String {
    match law {
        Strategy::Unspecified => "none".into(),
        law => word(law.as_str_name(), "STRATEGY_"),
    }
}

/// Limits in words.
pub fn limits(limits: impl Iterator<Item = Limit>) -> String {
    let words: Vec<_> = limits.map(|limit| word(limit.as_str_name(), "LIMIT_")).collect();
    if words.is_empty() { "none".into() } else { words.join(", ") }
}

/// How long a command runs, seconds.
pub fn parse_seconds(text: &str) -> Result<Duration, String> {
    let seconds = text.parse().ok().filter(|s: &f64| *s > 0.0 && *s <= LONGEST_S);
    let duration = seconds.and_then(|s| Duration::try_from_secs_f64(s).ok());
    let duration = duration.filter(|duration| !duration.is_zero());
    duration.ok_or_else(|| format!("must be more than 0, at most {LONGEST_S} s"))
}

/// Three numbers as people write them: `0.3,0,0`.
pub fn parse_vector(text: &str) -> Result<Vector3, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[x, y, z]) => Ok(Vector3 { x, y, z }),
        _ => Err("must be three numbers with commas between, as in 0.3,0,0".into()),
    }
}

/// The resource name of the device that somebody named; empty: the only one.
pub fn device_resource(name: Option<&str>) -> String {
    name.map_or_else(String::new, |name| {
        format!("devices/{}", name.strip_prefix("devices/").unwrap_or(name))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_is_positive_and_at_most_a_day() {
        assert_eq!(parse_seconds("1.5"), Ok(Duration::from_millis(1500)));
        for wrong in ["0", "-1", "nan", "inf", "86401", "soon", "1e-300"] {
            assert!(parse_seconds(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn three_numbers_are_a_vector_and_nothing_else_is() {
        assert_eq!(parse_vector("0.3, 0,-1e-3"), Ok(Vector3 { x: 0.3, y: 0.0, z: -1e-3 }));
        for wrong in ["", "1,2", "1,2,3,4", "a,b,c"] {
            assert!(parse_vector(wrong).is_err(), "{wrong}");
        }
    }
}

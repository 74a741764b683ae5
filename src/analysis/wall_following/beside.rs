//! What a course has beside its walls: a soft force, or a soft layer before a stiff wall.
//!
//! Directions are those of the first leg: along it the way that the hand goes, out of its wall.
//! A field and a force that a controller streams are the same to the law, which is given the sum
//! of what is soft. None of it counts as wall when depth is measured.

use std::fmt;
use std::str::FromStr;

use nalgebra::{Vector2, Vector3};

use super::course::Leg;
use crate::environment::{Element, Material, Shape, Surface};

/// Thickness of the padding.
const PADDING_M: f64 = 0.005;

/// Stronger is a fight with the hand, not something beside a wall.
const STRONGEST_N: f64 = 50.0;
const THICKEST_N_S_PER_M: f64 = 200.0;
const STIFFEST_N_PER_M: f64 = 1e6;

/// What there is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Beside {
    /// Walls alone.
    #[default]
    Nothing,
    /// The same force everywhere, newtons along the first leg; negative: against the hand.
    Along(f64),
    /// The same force everywhere, newtons out of the first wall; negative: into it.
    Out(f64),
    /// A viscous field, N s/m.
    Viscous(f64),
    /// A layer before the first wall, N/m.
    Padding(f64),
}

impl Beside {
    /// As elements of a scene.
    pub fn elements(&self, first: &Leg) -> Vec<Element> {
        let place = first.at(0.0);
        let in_space = |v: Vector2<f64>| Vector3::new(v.x, v.y, 0.0);
        let force = |v: Vector2<f64>| vec![Element::ConstantField { force_W_N: in_space(v) }];
        match *self {
            Self::Nothing => Vec::new(),
            Self::Along(N) => force(place.tangent * N),
            Self::Out(N) => force(place.normal * N),
            Self::Viscous(damping_Ns_per_m) => vec![Element::ViscousField { damping_Ns_per_m }],
            Self::Padding(stiffness_N_per_m) => {
                let shape = Shape::HalfSpace {
                    point_W_m: in_space(place.p_m + place.normal * PADDING_M),
                    normal_W: in_space(place.normal),
                };
                let material = Material { stiffness_N_per_m, ..Material::default() };
                vec![Element::Surface(Surface { shape, material, hollow: false, blend_s: 0.0 })]
            }
        }
    }
}

impl fmt::Display for Beside {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nothing => f.write_str("nothing"),
            Self::Along(N) => write!(f, "along:{N}"),
            Self::Out(N) => write!(f, "out:{N}"),
            Self::Viscous(damping) => write!(f, "viscous:{damping}"),
            Self::Padding(stiffness) => write!(f, "padding:{stiffness}"),
        }
    }
}

/// Words that are nothing beside a wall.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{0}` cannot stand beside a wall: nothing, along:N or out:N with -50 to 50 N, viscous:D with \
     0 to 200 N s/m, padding:K with 1 to 1e6 N/m"
)]
pub struct UnknownBeside(pub String);

impl FromStr for Beside {
    type Err = UnknownBeside;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let unknown = || UnknownBeside(text.to_owned());
        if text == "nothing" {
            return Ok(Self::Nothing);
        }
        let (name, number) = text.split_once(':').ok_or_else(unknown)?;
        let number: f64 = number.parse().map_err(|_| unknown())?;
        let within = |least: f64, most: f64| (least..=most).contains(&number);
        match name {
            "along" if within(-STRONGEST_N, STRONGEST_N) => Ok(Self::Along(number)),
            "out" if within(-STRONGEST_N, STRONGEST_N) => Ok(Self::Out(number)),
            "viscous" if within(0.0, THICKEST_N_S_PER_M) => Ok(Self::Viscous(number)),
            "padding" if within(1.0, STIFFEST_N_PER_M) => Ok(Self::Padding(number)),
            _ => Err(unknown()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_and_rubbish_is_refused_with_the_ranges() {
        for text in ["nothing", "along:-3", "out:2.5", "viscous:20", "padding:2000"] {
            assert_eq!(text.parse::<Beside>().unwrap().to_string(), text);
        }
        for text in ["", "along", "along:", "along:nan", "out:51", "viscous:-1", "padding:0", "x:1"]
        {
            let error = text.parse::<Beside>().unwrap_err().to_string();
            assert!(error.contains("0 to 200 N s/m") && error.contains(text), "{error}");
        }
    }
}

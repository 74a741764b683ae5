//! `hapticd ctl manipulability`: what the actuators can do at a place of the handle.

use clap::Args;
use serde_json::json;

use super::ctl::plain;
use super::format;
use crate::client::Devices;
use crate::proto::{GetManipulabilityRequest, Manipulability, Vector3};

/// Lengths of the bars, in characters, of the strongest direction.
const BAR: f64 = 30.0;

/// What the actuators can do where the handle is, or would be
#[derive(Debug, Args)]
#[command(
    name = "manipulability",
    after_help = "Examples:
  hapticd ctl manipulability
  hapticd ctl manipulability --at 0.3,0.1 --motion 90
  hapticd ctl manipulability --directions 72 --json

Places and angles are those of the device's plane; angles in degrees, counter-clockwise from
its x (radians with --json)."
)]
pub struct ShowManipulability {
    /// Where the handle would be; without it, where it is
    #[arg(long, value_name = "X,Y", value_parser = parse_place, allow_hyphen_values = true)]
    at: Option<Vector3>,
    /// Which way it would move, degrees
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    motion: Option<f64>,
    /// Directions of force, at most 360
    #[arg(long, value_name = "N", default_value_t = 36)]
    directions: u32,
}

fn parse_place(text: &str) -> Result<Vector3, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[x, y]) => Ok(Vector3 { x, y, z: 0.0 }),
        _ => Err("must be two numbers with a comma between, as in 0.3,0.1".into()),
    }
}

impl ShowManipulability {
    /// Asks and prints.
    pub async fn run(
        self,
        devices: &mut Devices,
        name: String,
        as_json: bool,
    ) -> anyhow::Result<()> {
        let request = GetManipulabilityRequest {
            name,
            handle_m: self.at,
            motion_rad: self.motion.map(f64::to_radians),
            directions: self.directions,
        };
        let found = devices.get_manipulability(request).await.map_err(plain)?.into_inner();
        if as_json {
            say!("{}", to_json(&found));
        } else {
            print(&found);
        }
        Ok(())
    }
}

fn print(found: &Manipulability) {
    let at = found.handle_m.unwrap_or_default();
    let motion = match found.motion_rad {
        Some(rad) => format!("moving to {:.1} deg", rad.to_degrees()),
        None => "at rest".into(),
    };
    say!("{}: handle at ({:.4}, {:.4}) m, {motion}", found.name, at.x, at.y);
    for force in &found.reference_forces {
        let per_nm = force.per_nm.unwrap_or_default();
        let angle_deg = per_nm.y.atan2(per_nm.x).to_degrees();
        let size = per_nm.x.hypot(per_nm.y);
        say!("  {:<12} {size:>7.3} N per N m at {angle_deg:>7.1} deg", force.actuator);
    }
    let list = |values: &[f64]| {
        values.iter().map(|value| format!("{value:.2}")).collect::<Vec<_>>().join(", ")
    };
    say!(
        "  singular values {} N per N m; with the largest torques {} N, condition {:.2}",
        list(&found.singular_values),
        list(&found.weighted_singular_values_n),
        found.condition
    );
    for sector in &found.sectors {
        say!(
            "  {:>7.1} to {:>7.1} deg  {}",
            sector.from_rad.to_degrees(),
            sector.to_rad.to_degrees(),
            format::region(sector.region())
        );
    }
    let most_N = found.largest.iter().map(|force| force.range_n).fold(0.0, f64::max);
    say!("  largest force   now   whatever moves");
    for force in &found.largest {
        let bar = "#".repeat((BAR * force.now_n / most_N.max(1e-9)).round() as usize);
        let angle_deg = force.angle_rad.to_degrees();
        say!("  {angle_deg:>7.1} deg {:>8.1} N {:>8.1} N  {bar}", force.now_n, force.range_n);
    }
}

fn to_json(found: &Manipulability) -> serde_json::Value {
    let at = found.handle_m.unwrap_or_default();
    let references = found.reference_forces.iter().map(|force| {
        let per_nm = force.per_nm.unwrap_or_default();
        json!({ "actuator": force.actuator, "per_nm": [per_nm.x, per_nm.y, per_nm.z] })
    });
    let sectors = found.sectors.iter().map(|sector| {
        let region = format::word(sector.region().as_str_name(), "REGION_");
        json!({ "from_rad": sector.from_rad, "to_rad": sector.to_rad, "region": region })
    });
    let largest = found.largest.iter().map(
        |force| json!({ "angle_rad": force.angle_rad, "now_n": force.now_n, "range_n": force.range_n }),
    );
    json!({
        "name": found.name,
        "handle_m": [at.x, at.y],
        "motion_rad": found.motion_rad,
        "reference_forces": references.collect::<Vec<_>>(),
        "singular_values": found.singular_values,
        "weighted_singular_values_n": found.weighted_singular_values_n,
        "condition": found.condition,
        "p_a": found.p_a,
        "p_f": found.p_f,
        "sectors": sectors.collect::<Vec<_>>(),
        "largest": largest.collect::<Vec<_>>(),
    })
}

//! `hapticd design compare`: the indices of several devices side by side.

use std::io::Write;

use clap::Args;
use serde_json::json;

use super::arguments::{GridKind, Output, Workspace, distinct};
use super::pictures::{histogram, largest_betas_deg};
use super::table;
use crate::analysis::design::GlobalIndices;
use crate::config::DeviceDefinition;
use crate::plot::Figure;

/// The indices of several devices side by side, over one kind of grid
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd design compare cho-2005-unoptimised cho-2005 cho-2005-crossed
  hapticd design compare cho-2005 mine.toml --grid polar --json
  hapticd design compare cho-2005-unoptimised cho-2005 --csv table.csv --out histogram.svg

With --out: the histograms of the largest beta.")]
pub struct Compare {
    /// Built-in devices or device files
    #[arg(value_name = "NAME|FILE", required = true, num_args = 1..=12)]
    devices: Vec<String>,
    /// The kind of grid
    #[arg(long, value_enum, default_value = "area")]
    grid: GridKind,
    #[command(flatten)]
    workspace: Workspace,
    #[command(flatten)]
    output: Output,
}

/// Means over a part of a grid compare with nothing else.
fn warn(name: &str, indices: &GlobalIndices) {
    if let Some(words) = missing(indices) {
        let _ =
            writeln!(std::io::stderr(), "hapticd: {name} {words}; --r and --grid choose others");
    }
}

/// What a device misses of its grid, in words; `None`: nothing.
fn missing(indices: &GlobalIndices) -> Option<String> {
    let GlobalIndices { places, unreachable, singular, .. } = *indices;
    match unreachable + singular {
        0 => None,
        missed if missed < places => Some(format!(
            "misses {missed} of {places} places, and its figures are those of the rest"
        )),
        _ if singular > 0 => Some(format!("has figures for none of {places} places")),
        _ => Some(format!("reaches none of {places} places and has no figures")),
    }
}

impl Compare {
    /// Computes, prints, and writes.
    pub fn run(self) -> anyhow::Result<()> {
        let loaded: Result<Vec<_>, _> =
            distinct(self.devices).iter().map(|name| DeviceDefinition::load(name)).collect();
        let devices = loaded?;
        let names: Vec<String> =
            devices.iter().map(|device| device.name.as_str().to_owned()).collect();
        let mut found = Vec::new();
        for device in &devices {
            let grid = self.workspace.grid(device, self.grid)?;
            let torque_Nm = &device.actuators.max_torque_Nm;
            found.push((GlobalIndices::over(device.mechanism.as_ref(), torque_Nm, &grid), grid));
        }
        let indices: Vec<GlobalIndices> =
            found.iter().map(|(indices, _)| indices.clone()).collect();
        for (name, indices) in names.iter().zip(&indices) {
            warn(name, indices);
        }
        if self.output.json {
            let all = names.iter().zip(&indices).map(|(name, indices)| {
                let mut object = table::object(indices);
                object["device"] = json!(name);
                object
            });
            say!("{}", json!({ "devices": all.collect::<Vec<_>>() }));
        } else {
            for (name, indices) in names.iter().zip(&indices) {
                say!("{name}: {}", indices.grid);
            }
            let heads: String = names.iter().map(|name| format!(" {name:>22}")).collect();
            say!("{:<34}{heads}", "");
            table::text(&indices).iter().for_each(|line| say!("{line}"));
        }
        self.output.table(|| table::csv(&names, &indices))?;
        self.output.picture(|| {
            let betas = devices.iter().zip(&found).map(|(device, (_, grid))| {
                (device.name.as_str(), largest_betas_deg(device.mechanism.as_ref(), grid))
            });
            Figure::single(histogram("Largest beta over the workspace", &betas.collect::<Vec<_>>()))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::design::{Annulus, Grid};

    #[test]
    fn a_device_that_reaches_nothing_has_no_rest() {
        let words = |name: &str, radii_m: [f64; 2]| {
            let device = DeviceDefinition::load(name).unwrap();
            let grid = Grid::Annulus(Annulus::polar(radii_m[0], radii_m[1]));
            let torque_Nm = &device.actuators.max_torque_Nm;
            missing(&GlobalIndices::over(device.mechanism.as_ref(), torque_Nm, &grid))
        };
        assert_eq!(words("cho-2005", [0.2, 0.5]), None);
        let none = words("kim-2003", [0.2, 0.5]).unwrap();
        assert!(none.contains("reaches none of 3813") && !none.contains("rest"), "{none}");
        let some = words("kim-2003", [0.01, 0.5]).unwrap();
        assert!(some.contains("the rest"), "{some}");
    }
}

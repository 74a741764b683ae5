//! `hapticd design compare`: the indices of several devices side by side.

use std::io::Write;

use clap::Args;
use serde_json::json;

use super::arguments::{GridKind, Output, Workspace};
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
    let missed = indices.unreachable + indices.singular;
    if missed > 0 {
        let _ = writeln!(
            std::io::stderr(),
            "hapticd: {name} misses {missed} of {} places, and its figures are those of the rest; \
             --r and --grid choose others",
            indices.places
        );
    }
}

impl Compare {
    /// Computes, prints, and writes.
    pub fn run(self) -> anyhow::Result<()> {
        let loaded: Result<Vec<_>, _> =
            self.devices.iter().map(|name| DeviceDefinition::load(name)).collect();
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

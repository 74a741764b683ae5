//! `hapticd design`: what a device's linkage can do, drawn and compared, and better ones.
//!
//! Numbers are those of [`crate::analysis::design`]; these commands read arguments, print,
//! and write files. Places and angles are those of the device's plane.

mod arguments;
mod compare;
mod ellipses;
mod found_file;
mod indices;
mod map;
mod optimize;
mod pictures;
mod regions;
mod synthesis;
mod table;

pub(super) use arguments::{distinct, progress_bar};
pub(super) use map::class_series;
pub(super) use optimize::front_panel;
pub(super) use pictures::{
    GAP, circles, ellipse_outline, fan, histogram, largest_betas_deg, linkage, place_panel,
};
pub(super) use synthesis::circle_panel;

use clap::{Args, Subcommand};

/// What a device's linkage can do: indices, maps, regions, and better designs
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd design indices --device cho-2005
  hapticd design map --device cho-2005 --quantity worst-force --out map.svg
  hapticd design regions --at 0.3,0.1 --motion -90 --out regions.png
  hapticd design ellipses --out ellipses.svg
  hapticd design optimize --device cho-2005 --seed 1 --json
  hapticd design compare cho-2005-unoptimised cho-2005 cho-2005-crossed")]
pub struct Design {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Indices(indices::Indices),
    Map(map::Map),
    Regions(regions::Regions),
    Ellipses(ellipses::Ellipses),
    Optimize(optimize::Optimize),
    Compare(compare::Compare),
}

impl Design {
    /// Runs the command.
    pub fn run(self) -> anyhow::Result<()> {
        match self.command {
            Command::Indices(command) => command.run(),
            Command::Map(command) => command.run(),
            Command::Regions(command) => command.run(),
            Command::Ellipses(command) => command.run(),
            Command::Optimize(command) => command.run(),
            Command::Compare(command) => command.run(),
        }
    }
}

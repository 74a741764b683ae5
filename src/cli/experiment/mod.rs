//! `hapticd experiment`: studies of the papers done again, each a report with tables and pictures.

mod exec_law;
mod force_distribution;
mod optimisation;
mod paper_pictures;
mod papers;
mod report;
mod synthesis;
mod wall_following;

use clap::{Args, Subcommand};

/// Do a study of the papers again and write its report
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd experiment wall-following --quick
  hapticd experiment wall-following --device cho-2005 --law sliding --course corner --json
  hapticd experiment force-distribution --out force-distribution
  hapticd experiment optimisation --out optimisation
  hapticd experiment synthesis --out synthesis --json
  hapticd experiment papers --out docs/papers")]
pub struct Experiment {
    #[command(subcommand)]
    study: Study,
}

#[derive(Debug, Subcommand)]
enum Study {
    WallFollowing(wall_following::WallFollowing),
    ForceDistribution(force_distribution::ForceDistribution),
    Optimisation(optimisation::Optimisation),
    Synthesis(synthesis::Synthesis),
    Papers(papers::Papers),
}

impl Experiment {
    /// Runs it.
    pub fn run(self) -> anyhow::Result<()> {
        match self.study {
            Study::WallFollowing(study) => study.run(),
            Study::ForceDistribution(study) => study.run(),
            Study::Optimisation(study) => study.run(),
            Study::Synthesis(study) => study.run(),
            Study::Papers(study) => study.run(),
        }
    }
}

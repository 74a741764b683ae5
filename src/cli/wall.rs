//! `hapticd ctl wall`: the short way for half-spaces of the resident scene.

use crate::client::Authorized;
use clap::{Args, Subcommand};

use super::format::parse_vector;
use super::object::Objects;
use super::object_fields::{self, KindName, Numbers, parse_numbers};
use crate::proto::Vector3;
use crate::proto::scene_service_client::SceneServiceClient;

/// Walls of the resident scene; they are kept on disk
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd ctl wall add table --point 0,0.4,0 --normal=0,-1,0 --stiffness 5000
  hapticd ctl wall set table --point 0,0.35,0
  hapticd ctl wall list
  hapticd ctl wall rm table
Other shapes, paths and fields:  hapticd ctl object")]
pub struct WallCommand {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Add a wall; it needs --point and --normal
    #[command(after_help = "Example:
  hapticd ctl wall add table --point 0,0.4,0 --normal=0,-1,0 --stiffness 5000")]
    Add {
        /// a-z, 0-9 and "-", beginning with a letter
        name: String,
        #[command(flatten)]
        fields: Fields,
    },
    /// Change what is given, keep the rest
    #[command(after_help = "Examples:
  hapticd ctl wall set table --stiffness 20000
  hapticd ctl wall set table --point 0,0.35,0")]
    Set {
        /// Which wall
        name: String,
        #[command(flatten)]
        fields: Fields,
    },
    /// Show one wall
    #[command(after_help = "Example:
  hapticd ctl wall get table")]
    Get {
        /// Which wall
        name: String,
    },
    /// Show all objects of the scene
    #[command(after_help = "Example:
  hapticd ctl wall list")]
    List,
    /// Remove a wall
    #[command(after_help = "Example:
  hapticd ctl wall rm table")]
    Rm {
        /// Which wall
        name: String,
    },
}

#[derive(Debug, Args)]
struct Fields {
    /// Any point of its surface, metres in W; a new wall needs it
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    point: Option<Vector3>,
    /// Direction out of the wall; a new wall needs it
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    normal: Option<Vector3>,
    /// N/m (1000 if a new wall does not say)
    #[arg(long, value_name = "N/m", value_parser = parse_numbers, allow_hyphen_values = true)]
    stiffness: Option<Numbers>,
    /// N s/m
    #[arg(long, value_name = "N s/m", value_parser = parse_numbers, allow_hyphen_values = true)]
    damping: Option<Numbers>,
    /// Coulomb coefficient
    #[arg(long, value_name = "MU", allow_negative_numbers = true)]
    friction: Option<f64>,
    /// A sheet, felt from the side on which the tool is
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true")]
    hollow: Option<bool>,
}

impl From<Fields> for object_fields::Fields {
    fn from(fields: Fields) -> Self {
        let mut all = Self::default();
        (all.point, all.normal, all.hollow) = (fields.point, fields.normal, fields.hollow);
        (all.stiffness, all.damping) = (fields.stiffness, fields.damping);
        all.friction = fields.friction;
        all
    }
}

impl WallCommand {
    /// Does it and prints the wall as the server has it then.
    pub async fn run(
        self,
        scenes: &mut SceneServiceClient<Authorized>,
        device: &str,
        as_json: bool,
    ) -> anyhow::Result<()> {
        let mut objects = Objects::new(scenes, device, as_json);
        objects.only_walls = true;
        match self.action {
            Action::Add { name, fields } => {
                objects.add(name, KindName::HalfSpace, fields.into()).await
            }
            Action::Set { name, fields } => objects.set(&name, fields.into()).await,
            Action::Get { name } => objects.get(&name).await,
            Action::List => objects.list().await,
            Action::Rm { name } => objects.remove(&name).await,
        }
    }
}

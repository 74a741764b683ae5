//! `hapticd design indices`: the indices of one place, or of the whole workspace.

use clap::Args;
use serde_json::{Value, json};

use super::arguments::{GridKind, Output, Workspace, check_place, furthest_m, parse_place};
use super::pictures::{histogram, largest_betas_deg, place_panel};
use super::table;
use crate::analysis::design::inscribed::{Circle, largest_circle};
use crate::analysis::design::mobility::mobility_of;
use crate::analysis::design::{GlobalIndices, LocalIndices, Raster, moment_length_m};
use crate::config::DeviceDefinition;
use crate::mechanism::{Mechanism, Posture, Rays};
use crate::notation::PlaneVector;
use crate::plot::Figure;

/// Indices of one place (--at) or of the whole workspace, each with its grid
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd design indices --device cho-2005
  hapticd design indices --device cho-2005 --grid polar --json
  hapticd design indices --device cho-2005 --at 0.3,0.1
  hapticd design indices --device mine.toml --x -0.2,0.2 --y 0.05,0.25 --csv indices.csv

With --out: the histogram of the largest beta, or the rays and the ellipse of the place.")]
pub struct Indices {
    /// Built-in device or device file
    #[arg(long, value_name = "NAME|FILE", default_value = "cho-2005")]
    device: String,
    /// One place of the handle
    #[arg(long, value_name = "X,Y[,PHI]", value_parser = parse_place, allow_hyphen_values = true,
        conflicts_with_all = ["grid", "r", "x", "y", "step", "phi"])]
    at: Option<PlaneVector>,
    /// One grid instead of all that suit the device
    #[arg(long, value_enum)]
    grid: Option<GridKind>,
    #[command(flatten)]
    workspace: Workspace,
    #[command(flatten)]
    output: Output,
}

impl Indices {
    /// Computes and prints.
    pub fn run(self) -> anyhow::Result<()> {
        let device = DeviceDefinition::load(&self.device)?;
        match self.at {
            Some(place) => self.one_place(&device, &place),
            None => self.whole_workspace(&device),
        }
    }

    fn whole_workspace(&self, device: &DeviceDefinition) -> anyhow::Result<()> {
        let mechanism = device.mechanism.as_ref();
        let torque_Nm = &device.actuators.max_torque_Nm;
        let grids = self.workspace.grids(device, self.grid)?;
        let over = |grid| GlobalIndices::over(mechanism, torque_Nm, grid);
        let found: Vec<GlobalIndices> = grids.iter().map(over).collect();
        let everywhere = around(mechanism, self.workspace.phi_rad(device)?);
        let circle = largest_circle(mechanism, &everywhere);
        let account = Account { device, circle, resolution_m: everywhere.step_m, found: &found };
        if self.output.json {
            say!("{}", account.json());
        } else {
            account.print();
        }
        let names: Vec<String> = (1..=found.len()).map(|i| format!("grid_{i}")).collect();
        self.output.table(|| table::csv(&names, &found))?;
        self.output.picture(|| {
            let betas = largest_betas_deg(mechanism, &grids[0]);
            Figure::single(histogram(
                "Largest beta over the workspace",
                &[(device.name.as_str(), betas)],
            ))
        })
    }

    fn one_place(&self, device: &DeviceDefinition, place: &PlaneVector) -> anyhow::Result<()> {
        check_place(place, device)?;
        let mechanism = device.mechanism.as_ref();
        let posture = mechanism.posture_at(place)?;
        let found = LocalIndices::of(mechanism, &device.actuators.max_torque_Nm, &posture);
        let rays = Rays::of(&posture.reference, mechanism.actuators());
        if self.output.json {
            say!("{}", local_json(device, &posture, &found, rays.as_ref()));
        } else {
            say_local(device, &posture, &found, rays.as_ref());
        }
        self.output.table(|| local_csv(&found))?;
        self.output.picture(|| Figure::single(place_panel(device, &posture, None, None)))
    }
}

/// What is told of a whole workspace.
struct Account<'a> {
    device: &'a DeviceDefinition,
    circle: Option<Circle>,
    resolution_m: f64,
    found: &'a [GlobalIndices],
}

impl Account<'_> {
    fn json(&self) -> Value {
        let mechanism = self.device.mechanism.as_ref();
        let circle = self.circle.map(|circle| {
            json!({ "centre_m": circle.centre_m, "radius_m": circle.radius_m,
                        "resolution_m": self.resolution_m })
        });
        json!({
            "device": self.device.name.as_str(),
            "mechanism": mechanism.name(),
            "mobility": mobility_of(mechanism.name()),
            "actuators": mechanism.actuators(),
            "reach_m": mechanism.reach_m(),
            "moment_length_m": moment_length_m(mechanism),
            "largest_circle": circle,
            "workspaces": self.found.iter().map(table::object).collect::<Vec<_>>(),
        })
    }

    fn print(&self) {
        let mechanism = self.device.mechanism.as_ref();
        say!(
            "{}: {} of mobility {}, {} actuators",
            self.device.name,
            mechanism.name(),
            mobility_of(mechanism.name()).map_or("?".into(), |m| m.to_string()),
            mechanism.actuators()
        );
        if let Some(circle) = self.circle {
            let [x, y] = circle.centre_m;
            say!(
                "largest circle in reach: radius {:.3} m about ({x:.3}, {y:.3}), to {:.3} m",
                circle.radius_m,
                self.resolution_m
            );
        }
        say_moments(mechanism);
        for (i, indices) in self.found.iter().enumerate() {
            say!("grid {}: {}", i + 1, indices.grid);
        }
        let heads: String =
            (1..=self.found.len()).map(|i| format!(" {:>22}", format!("grid {i}"))).collect();
        say!("{:<34}{heads}", "");
        table::text(self.found).iter().for_each(|line| say!("{line}"));
    }
}

/// What the figures of a device that turns its handle mean.
fn say_moments(mechanism: &dyn Mechanism) {
    if let Some(length_m) = moment_length_m(mechanism) {
        say!(
            "K, Yoshikawa and worst force: moments over {length_m:.4} m; rays, GP and ellipses: \
             forces alone"
        );
    }
}

/// A lattice that holds all that the linkage reaches, two hundred places across.
fn around(mechanism: &dyn Mechanism, phi_rad: f64) -> Raster {
    let far_m = 1.02 * furthest_m(mechanism, phi_rad);
    Raster { x_m: [-far_m, far_m], y_m: [-far_m, far_m], step_m: far_m / 100.0, phi_rad }
}

fn local_rows(found: &LocalIndices) -> Vec<(&'static str, f64)> {
    let rays = found.rays;
    let of_rays = |f: fn(crate::analysis::design::RayIndices) -> f64| rays.map_or(f64::NAN, f);
    let [long, short] = found.ellipse.semi_axes;
    let [least_kg, most_kg] = found.inertia_kg;
    vec![
        ("p_a", of_rays(|rays| rays.P_a)),
        ("p_f", of_rays(|rays| rays.P_f)),
        ("beta_min_deg", of_rays(|rays| rays.least_beta_rad.to_degrees())),
        ("beta_max_deg", of_rays(|rays| rays.P_f.to_degrees())),
        ("condition", found.condition),
        ("yoshikawa", found.yoshikawa),
        ("worst_force_N", found.worst_force_N),
        ("ellipse_long_N_per_Nm", long),
        ("ellipse_short_N_per_Nm", short),
        ("ellipse_angle_deg", found.ellipse.angle_rad.to_degrees()),
        ("inertia_min_kg", least_kg),
        ("inertia_max_kg", most_kg),
    ]
}

fn local_json(
    device: &DeviceDefinition,
    posture: &Posture,
    found: &LocalIndices,
    rays: Option<&Rays>,
) -> Value {
    let mut all: serde_json::Map<String, Value> =
        local_rows(found).into_iter().map(|(key, value)| (key.to_owned(), json!(value))).collect();
    all.insert("device".into(), json!(device.name.as_str()));
    all.insert("at_m".into(), json!([posture.p_BH.x, posture.p_BH.y]));
    all.insert("phi_rad".into(), json!(posture.p_BH.z));
    all.insert("moment_length_m".into(), json!(moment_length_m(device.mechanism.as_ref())));
    all.insert("class".into(), json!(found.class().label()));
    let order = rays.map(|rays| rays.order().iter().map(ToString::to_string).collect::<Vec<_>>());
    all.insert("order".into(), json!(order));
    all.insert("betas_rad".into(), json!(rays.map(Rays::betas_rad)));
    all.into()
}

fn local_csv(found: &LocalIndices) -> String {
    let lines = local_rows(found).into_iter().map(|(key, value)| format!("{key},{value}\n"));
    format!("index,value\n{}", lines.collect::<String>())
}

fn say_local(
    device: &DeviceDefinition,
    posture: &Posture,
    found: &LocalIndices,
    rays: Option<&Rays>,
) {
    let p = posture.p_BH;
    say!("{}: handle at ({:.4}, {:.4}) m, {:.1} deg", device.name, p.x, p.y, p.z.to_degrees());
    say_moments(device.mechanism.as_ref());
    if let Some(rays) = rays {
        let around: Vec<String> = (rays.order().iter().zip(rays.betas_rad()))
            .map(|(ray, beta)| format!("{ray} {:.1}", beta.to_degrees()))
            .collect();
        say!("rays and degrees to the next: {}", around.join(", "));
    }
    for (key, value) in local_rows(found) {
        say!("{key:<26} {}", table::number(value));
    }
    say!("{:<26} {}", "class", found.class().label());
}

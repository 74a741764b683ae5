//! `hapticd design ellipses`: force ellipses over the workspace.

use clap::Args;
use serde_json::json;

use super::arguments::{Output, Workspace};
use super::pictures::{GAP, circles, ellipse_outline, linkage, sparse};
use crate::analysis::design::local::{ForceEllipse, ellipse};
use crate::analysis::design::{Grid, turns_about_base};
use crate::config::DeviceDefinition;
use crate::notation::PlaneVector;
use crate::plot::{Axis, Colour, Figure, Legend, Marks, Panel, Series};

/// Force ellipses over the workspace: forces whose torques have a norm of 1 N m
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd design ellipses --device cho-2005 --out ellipses.svg
  hapticd design ellipses --device two-link --r 0.15,0.55 --step 0.1 --csv ellipses.csv
  hapticd design ellipses --device mine.toml --x -0.2,0.2 --y 0.05,0.25 --step 0.02 --json")]
pub struct Ellipses {
    /// Built-in device or device file
    #[arg(long, value_name = "NAME|FILE", default_value = "cho-2005")]
    device: String,
    #[command(flatten)]
    workspace: Workspace,
    #[command(flatten)]
    output: Output,
}

impl Ellipses {
    /// Computes, prints, and writes.
    pub fn run(self) -> anyhow::Result<()> {
        let device = DeviceDefinition::load(&self.device)?;
        let mechanism = device.mechanism.as_ref();
        let round = turns_about_base(mechanism) && !self.workspace.is_flat();
        // A round grid does not ask for the angle, which has to fit the device all the same.
        self.workspace.phi_rad(&device)?;
        let grid = if round {
            sparse(self.workspace.radii_m(), 4, 16)
        } else {
            Grid::Raster(self.workspace.raster(&device, 14)?)
        };
        grid.check()?;
        let found: Vec<(PlaneVector, ForceEllipse)> = (grid.places())
            .filter(|place| self.workspace.holds(&device, &place.p_BH))
            .filter_map(|place| {
                let posture = mechanism.posture_at(&place.p_BH).ok()?;
                Some((posture.p_BH, ellipse(&posture.reference, mechanism.actuators())))
            })
            .collect();
        anyhow::ensure!(
            !found.is_empty(),
            "{}: the handle reaches no place of {grid}",
            device.name
        );
        if self.output.json {
            let all = found.iter().map(|(p, ellipse)| {
                json!({
                "at_m": [p.x, p.y],
                    "semi_axes_N_per_Nm": ellipse.semi_axes,
                    "angle_rad": ellipse.angle_rad })
            });
            say!(
                "{}",
                json!({ "device": device.name.as_str(), "grid": grid.to_string(),
                "ellipses": all.collect::<Vec<_>>() })
            );
        } else {
            let ratio = |e: &ForceEllipse| e.semi_axes[1] / e.semi_axes[0];
            let worst = found.iter().map(|(_, e)| ratio(e)).fold(f64::INFINITY, f64::min);
            let best = found.iter().map(|(_, e)| ratio(e)).fold(0.0, f64::max);
            say!(
                "{}: {} ellipses, axis ratio {worst:.3} to {best:.3} ({grid})",
                device.name,
                found.len()
            );
        }
        self.output.table(|| csv(&found))?;
        self.output.picture(|| Figure {
            panel_px: (680, 640),
            ..Figure::single(self.panel(&device, &found))
        })
    }

    /// Room for the legend below a round workspace.
    fn upward(&self, device: &DeviceDefinition) -> Axis {
        let far_m = self.workspace.radii_m()[1];
        if turns_about_base(device.mechanism.as_ref()) && !self.workspace.is_flat() {
            Axis::between("y [m]", -1.5 * far_m, 1.15 * far_m)
        } else {
            Axis::new("y [m]")
        }
    }

    fn panel(&self, device: &DeviceDefinition, found: &[(PlaneVector, ForceEllipse)]) -> Panel {
        let longest = found.iter().map(|(_, ellipse)| ellipse.semi_axes[0]).fold(0.0, f64::max);
        let scale = 0.5 * spacing_m(found) / longest;
        let outline = found.iter().flat_map(|(p, ellipse)| {
            ellipse_outline(*ellipse, [p.x, p.y], scale).into_iter().chain([GAP])
        });
        let unit = format!("force per 1 N m of torque ({:.3} m for 10 N)", 10.0 * scale);
        let mut series = vec![Series::new(unit, Colour::Blue, Marks::Line(outline.collect()))];
        if turns_about_base(device.mechanism.as_ref()) {
            series.push(Series::unnamed(Colour::LightGrey, circles(self.workspace.radii_m())));
        }
        let [x, y] = device.start_m;
        if let Ok(posture) = device.mechanism.posture_at(&PlaneVector::new(x, y, 0.0)) {
            series.push(Series::new("linkage", Colour::Grey, linkage(device, &posture)));
        }
        Panel {
            title: format!("{}: force ellipses", device.name),
            x: Axis::new("x [m]"),
            y: self.upward(device),
            equal: true,
            legend: Legend::LowerLeft,
            series,
        }
    }
}

/// The distance that most neighbours keep: the median of each one's nearest.
fn spacing_m(found: &[(PlaneVector, ForceEllipse)]) -> f64 {
    let nearest = |i: usize| {
        let others = found.iter().enumerate().filter(|(k, _)| *k != i);
        others.map(|(_, (p, _))| (p - found[i].0).xy().norm()).fold(f64::INFINITY, f64::min)
    };
    let mut all: Vec<f64> = (0..found.len()).map(nearest).collect();
    all.sort_by(f64::total_cmp);
    all.get(all.len() / 2).copied().filter(|m| m.is_finite()).unwrap_or(0.1)
}

fn csv(found: &[(PlaneVector, ForceEllipse)]) -> String {
    let line = |(p, ellipse): &(PlaneVector, ForceEllipse)| {
        let [long, short] = ellipse.semi_axes;
        format!("{},{},{long},{short},{}\n", p.x, p.y, ellipse.angle_rad.to_degrees())
    };
    let lines: String = found.iter().map(line).collect();
    format!("x_m,y_m,long_N_per_Nm,short_N_per_Nm,angle_deg\n{lines}")
}

//! `hapticd design map`: one index over the workspace, as a picture or a table.

use std::collections::BTreeMap;

use clap::{Args, ValueEnum};
use serde_json::json;

use super::arguments::{Output, Workspace};
use super::pictures::CLASS_SIGNS;
use crate::analysis::design::{ConditionClass, LocalIndices, Raster};
use crate::config::DeviceDefinition;
use crate::notation::PlaneVector;
use crate::plot::{Axis, Colour, Figure, Marks, Panel, Series};

/// What to draw.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Quantity {
    /// Condition number K
    Condition,
    /// The four classes of K, as signs
    Class,
    /// Sum of the squared angles between neighbouring rays
    #[value(name = "p-a")]
    PA,
    /// Largest angle between neighbouring rays
    #[value(name = "p-f")]
    PF,
    /// Smallest angle between neighbouring rays
    LeastBeta,
    /// Force possible in every direction
    WorstForce,
    /// Most inertia felt in any direction
    Inertia,
    /// Yoshikawa's measure
    Yoshikawa,
}

/// One index over the workspace; the table holds all of them
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd design map --device cho-2005 --quantity p-f --out map.svg
  hapticd design map --device cho-2005 --quantity class --step 0.02 --out classes.png
  hapticd design map --device mine.toml --quantity worst-force --csv map.csv
  hapticd design map --device two-link --quantity condition --r 0.1,0.55 --json")]
pub struct Map {
    /// Built-in device or device file
    #[arg(long, value_name = "NAME|FILE", default_value = "cho-2005")]
    device: String,
    /// What to draw and to sum up
    #[arg(long, value_enum, default_value = "condition")]
    quantity: Quantity,
    #[command(flatten)]
    workspace: Workspace,
    #[command(flatten)]
    output: Output,
}

/// A place with its indices; `None`: singular.
type Sample = (PlaneVector, Option<LocalIndices>);

impl Quantity {
    fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }

    fn label(self) -> &'static str {
        match self {
            Self::Condition | Self::Class => "condition number K",
            Self::PA => "P_a [rad^2]",
            Self::PF => "P_f, largest beta [deg]",
            Self::LeastBeta => "smallest beta [deg]",
            Self::WorstForce => "worst-direction force [N]",
            Self::Inertia => "most inertia felt [kg]",
            Self::Yoshikawa => "Yoshikawa measure [m^2/rad^2]",
        }
    }

    fn of(self, found: &LocalIndices) -> f64 {
        let rays = found.rays;
        match self {
            Self::Condition | Self::Class => found.condition,
            Self::PA => rays.map_or(f64::NAN, |rays| rays.P_a),
            Self::PF => rays.map_or(f64::NAN, |rays| rays.P_f.to_degrees()),
            Self::LeastBeta => rays.map_or(f64::NAN, |rays| rays.least_beta_rad.to_degrees()),
            Self::WorstForce => found.worst_force_N,
            Self::Inertia => found.inertia_kg[1],
            Self::Yoshikawa => found.yoshikawa,
        }
    }
}

impl Map {
    /// Computes, prints, and writes.
    pub fn run(self) -> anyhow::Result<()> {
        let device = DeviceDefinition::load(&self.device)?;
        let across = if self.quantity == Quantity::Class { 40 } else { 120 };
        let raster = self.workspace.raster(&device, across)?;
        let samples = self.samples(&device, &raster);
        let values: Vec<f64> = (samples.iter())
            .filter_map(|(_, found)| Some(self.quantity.of(found.as_ref()?)))
            .filter(|value| value.is_finite())
            .collect();
        anyhow::ensure!(
            !values.is_empty(),
            "{}: the handle reaches no place of {}",
            device.name,
            crate::analysis::design::Grid::Raster(raster)
        );
        let (least, most) = values
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, m), v| (l.min(*v), m.max(*v)));
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let classes = ConditionClass::ALL.map(|class| (class.label(), count(&samples, class)));
        let grid = crate::analysis::design::Grid::Raster(raster).to_string();
        if self.output.json {
            let cells = samples.iter().map(|(p, found)| {
                json!([p.x, p.y, found.as_ref().map(|found| self.quantity.of(found))])
            });
            say!(
                "{}",
                json!({
                    "device": device.name.as_str(),
                    "quantity": self.quantity.name(),
                    "unit": self.quantity.label(),
                    "grid": grid, "least": least, "most": most, "mean": mean,
                    "classes": BTreeMap::from(classes),
                    "cells": cells.collect::<Vec<_>>(),
                })
            );
        } else {
            say!("{}: {} over {grid}", device.name, self.quantity.label());
            say!(
                "{} places reached, least {least:.4}, mean {mean:.4}, most {most:.4}",
                samples.len()
            );
            let told: Vec<_> = classes.iter().map(|(name, n)| format!("{name}: {n}")).collect();
            say!("{}", told.join(", "));
        }
        self.output.table(|| csv(&samples))?;
        self.output.picture(|| Figure::single(self.panel(&device, &raster, &samples)))
    }

    fn samples(&self, device: &DeviceDefinition, raster: &Raster) -> Vec<Sample> {
        let mechanism = device.mechanism.as_ref();
        let [columns, rows] = raster.counts();
        let places = (0..rows).flat_map(|j| (0..columns).map(move |i| raster.place(i, j)));
        let inside = places.filter(|place| self.workspace.holds(device, place));
        let sample = |place: PlaneVector| match mechanism.posture_at(&place) {
            Ok(posture) => {
                let found = LocalIndices::of(mechanism, &device.actuators.max_torque_Nm, &posture);
                Some((place, Some(found)))
            }
            Err(crate::mechanism::KinematicsError::Singular { .. }) => Some((place, None)),
            Err(_) => None,
        };
        inside.filter_map(sample).collect()
    }

    fn panel(&self, device: &DeviceDefinition, raster: &Raster, samples: &[Sample]) -> Panel {
        let series = if self.quantity == Quantity::Class {
            let places =
                |(p, found): &Sample| ([p.x, p.y], found.map_or(f64::INFINITY, |f| f.condition));
            class_series(&samples.iter().map(places).collect::<Vec<_>>())
        } else {
            let half_m = 0.5 * raster.step_m;
            let cell = |(p, found): &Sample| {
                let value = self.quantity.of(found.as_ref()?);
                Some(([p.x - half_m, p.y - half_m], [p.x + half_m, p.y + half_m], value))
            };
            let cells: Vec<_> = samples.iter().filter_map(cell).collect();
            let logarithmic = matches!(self.quantity, Quantity::Condition | Quantity::WorstForce);
            let label = self.quantity.label().to_owned();
            let marks = Marks::Cells { cells, label, range: None, logarithmic };
            vec![Series::unnamed(Colour::Black, marks)]
        };
        Panel {
            title: format!("{}: {}", device.name, self.quantity.label()),
            x: Axis::new("x [m]"),
            y: Axis::new("y [m]"),
            equal: true,
            series,
            ..Panel::default()
        }
    }
}

/// One series of signs for each class that there is.
pub fn class_series(places: &[([f64; 2], f64)]) -> Vec<Series> {
    let series = |(class, (sign, colour)): (ConditionClass, _)| {
        let inside = places.iter().filter(|(_, K)| ConditionClass::of(*K) == class);
        let points: Vec<_> = inside.map(|(at, _)| *at).collect();
        (!points.is_empty())
            .then(|| Series::new(class.label(), colour, Marks::Points(sign, points)))
    };
    ConditionClass::ALL.into_iter().zip(CLASS_SIGNS).filter_map(series).collect()
}

fn count(samples: &[Sample], class: ConditionClass) -> usize {
    let of = |(_, found): &&Sample| found.map_or(ConditionClass::Above100, |f| f.class()) == class;
    samples.iter().filter(of).count()
}

fn csv(samples: &[Sample]) -> String {
    const ALL: [Quantity; 7] = [
        Quantity::Condition,
        Quantity::PA,
        Quantity::PF,
        Quantity::LeastBeta,
        Quantity::WorstForce,
        Quantity::Inertia,
        Quantity::Yoshikawa,
    ];
    let mut text =
        "x_m,y_m,condition,p_a_rad2,p_f_deg,least_beta_deg,worst_force_N,inertia_kg,yoshikawa\n"
            .to_owned();
    for (p, found) in samples {
        let values =
            ALL.map(|quantity| found.as_ref().map_or(f64::NAN, |found| quantity.of(found)));
        let values: Vec<_> = values.iter().map(ToString::to_string).collect();
        text += &format!("{},{},{}\n", p.x, p.y, values.join(","));
    }
    text
}

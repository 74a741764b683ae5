//! `hapticd design regions`: rays, regions, passive sets and friction cones at one place.

use clap::Args;
use serde_json::{Value, json};

use super::arguments::{Output, check_place, parse_angle, parse_place};
use super::pictures::place_panel;
use super::table::quoted;
use crate::actuation::Region;
use crate::analysis::design::cones::{
    Cone, approximation_rad, direction_of, friction_cone, one_brake_paths, passive_set_of,
    passive_sets, regions,
};
use crate::analysis::manipulability::{manipulability, shaft_motion};
use crate::config::DeviceDefinition;
use crate::mechanism::{Posture, Ray};
use crate::notation::PlaneVector;
use crate::plot::Figure;

/// Rays, regions, passive sets and friction cones at one place
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd design regions --at 0.3,0.1
  hapticd design regions --at 0.3,0.1 --motion -90 --out regions.svg
  hapticd design regions --at 0.3,0.1 --motion -90 --desired 180 --json
  hapticd design regions --device two-link --at 0,0.42 --motion -90 --desired 110 --out fig2.png

Angles in degrees, counter-clockwise from x of the device's plane (radians with --json).")]
pub struct Regions {
    /// Built-in device or device file
    #[arg(long, value_name = "NAME|FILE", default_value = "cho-2005")]
    device: String,
    /// Where the handle is; without it, where its simulation begins
    #[arg(long, value_name = "X,Y[,PHI]", value_parser = parse_place, allow_hyphen_values = true)]
    at: Option<PlaneVector>,
    /// Which way the handle moves
    #[arg(long, value_name = "DEG", value_parser = parse_angle, allow_hyphen_values = true)]
    motion: Option<f64>,
    /// Which way a force is desired
    #[arg(long, value_name = "DEG", value_parser = parse_angle, allow_hyphen_values = true)]
    desired: Option<f64>,
    #[command(flatten)]
    output: Output,
}

impl Regions {
    /// Computes and prints.
    pub fn run(self) -> anyhow::Result<()> {
        let device = DeviceDefinition::load(&self.device)?;
        let [x, y] = device.start_m;
        let place = self.at.unwrap_or_else(|| PlaneVector::new(x, y, 0.0));
        check_place(&place, &device)?;
        let posture = device.mechanism.posture_at(&place)?;
        let found = self.account(&device, &posture);
        if self.output.json {
            say!("{found}");
        } else {
            self.print(&device, &posture);
        }
        self.output.table(|| csv(&device, &posture))?;
        self.output.picture(|| {
            let panel = place_panel(&device, &posture, self.motion, self.desired);
            Figure { panel_px: (640, 620), ..Figure::single(panel) }
        })
    }

    fn account(&self, device: &DeviceDefinition, posture: &Posture) -> Value {
        let (R, n) = (&posture.reference, device.mechanism.actuators());
        let all: Vec<usize> = (0..n).collect();
        let cone = |cone: &Cone| {
            json!({ "from": cone.from.to_string(), "to": cone.to.to_string(),
                    "from_rad": cone.from_rad, "width_rad": cone.width_rad })
        };
        let names = |rays: &[Ray]| rays.iter().map(ToString::to_string).collect::<Vec<_>>();
        let rays = regions(R, n).into_iter().map(|region| {
            let force = R.column(region.from.actuator).xy().norm();
            json!({ "ray": region.from.to_string(), "angle_rad": region.from_rad,
                    "N_per_Nm": force })
        });
        let motion = self.motion.map(|motion_rad| {
            let set = passive_set_of(R, n, motion_rad);
            json!({
                "angle_rad": motion_rad,
                "passive_set": set.as_ref().map(|set| names(&set.rays)),
                "approximation_rad": set.as_ref().map(|set| approximation_rad(set, motion_rad)),
                "sectors": self.sectors(device, posture, motion_rad).into_iter()
                    .map(|(from, to, region)| json!({ "from_rad": from, "to_rad": to,
                        "region": region.name() }))
                    .collect::<Vec<_>>(),
            })
        });
        json!({
            "device": device.name.as_str(),
            "at_m": [posture.p_BH.x, posture.p_BH.y],
            "rays": rays.collect::<Vec<_>>(),
            "regions": regions(R, n).iter().map(cone).collect::<Vec<_>>(),
            "passive_sets": passive_sets(R, n).iter().map(|set| json!({
                "rays": names(&set.rays), "cone": cone(&set.cone) })).collect::<Vec<_>>(),
            "one_brake_paths": one_brake_paths(R, n).iter().map(|path| json!({
                "brake": path.brake + 1, "plus_rad": path.plus_rad })).collect::<Vec<_>>(),
            "motion": motion,
            "friction_cone": self.desired.and_then(|desired| friction_cone(R, &all, desired))
                .as_ref().map(cone),
        })
    }

    fn sectors(
        &self,
        device: &DeviceDefinition,
        posture: &Posture,
        motion_rad: f64,
    ) -> Vec<(f64, f64, Region)> {
        let motion = shaft_motion(&posture.reference, Some(motion_rad));
        let capability = device.capability(posture, &motion);
        let account =
            manipulability(&capability, &device.actuators.max_torque_Nm, Some(motion_rad), 1);
        account
            .sectors
            .iter()
            .map(|sector| (sector.from_rad, sector.to_rad, sector.region))
            .collect()
    }

    fn print(&self, device: &DeviceDefinition, posture: &Posture) {
        let (R, n) = (&posture.reference, device.mechanism.actuators());
        let p = posture.p_BH;
        say!("{}: handle at ({:.4}, {:.4}) m", device.name, p.x, p.y);
        say!("ray   direction   N per N m   to the next ray");
        for region in regions(R, n) {
            let force = R.column(region.from.actuator).xy().norm();
            let (at, width) = (region.from_rad.to_degrees(), region.width_rad.to_degrees());
            say!(
                "R{:<4} {at:>8.2} deg {force:>8.3}   {width:>8.2} deg to R{}",
                region.from,
                region.to
            );
        }
        say!("passive sets, each of {} neighbouring regions:", n.saturating_sub(1));
        for set in passive_sets(R, n) {
            say!("  {:<28} {:>7.2} deg wide", joined(&set.rays), set.cone.width_rad.to_degrees());
        }
        for path in one_brake_paths(R, n) {
            say!(
                "brake {} locked: Q+ goes to {:>7.2} deg",
                path.brake + 1,
                path.plus_rad.to_degrees()
            );
        }
        if let Some(motion_rad) = self.motion {
            self.print_motion(device, posture, motion_rad);
        }
        if let Some(desired_rad) = self.desired {
            let all: Vec<usize> = (0..n).collect();
            match friction_cone(R, &all, desired_rad) {
                Some(cone) => say!(
                    "pseudo friction cone of a force to {:.1} deg: R{} to R{}, {:.2} to {:.2} deg",
                    desired_rad.to_degrees(),
                    cone.from,
                    cone.to,
                    cone.from_rad.to_degrees(),
                    (cone.from_rad + cone.width_rad).to_degrees()
                ),
                None => say!("there is no pseudo friction cone"),
            }
        }
    }

    fn print_motion(&self, device: &DeviceDefinition, posture: &Posture, motion_rad: f64) {
        let (R, n) = (&posture.reference, device.mechanism.actuators());
        match passive_set_of(R, n, motion_rad) {
            Some(set) => {
                let [before, after] = approximation_rad(&set, motion_rad).map(f64::to_degrees);
                say!(
                    "moving to {:.1} deg: passive set {}, {before:.2} deg and {after:.2} deg \
                     beside it approximate",
                    motion_rad.to_degrees(),
                    joined(&set.rays)
                );
            }
            None => say!("moving to {:.1} deg: a brake does not turn", motion_rad.to_degrees()),
        }
        for (from, to, region) in self.sectors(device, posture, motion_rad) {
            say!("  {:>8.2} to {:>8.2} deg: {}", from.to_degrees(), to.to_degrees(), region.name());
        }
    }
}

fn joined(rays: &[Ray]) -> String {
    rays.iter().map(|ray| format!("R{ray}")).collect::<Vec<_>>().join(" ")
}

fn csv(device: &DeviceDefinition, posture: &Posture) -> String {
    let (R, n) = (&posture.reference, device.mechanism.actuators());
    let line = |region: &Cone| {
        let ray = region.from;
        let force = R.column(ray.actuator).xy().norm();
        let angle_deg = direction_of(R, ray).to_degrees();
        format!(
            "{},{angle_deg},{force},{}\n",
            quoted(&ray.to_string()),
            region.width_rad.to_degrees()
        )
    };
    let lines: String = regions(R, n).iter().map(line).collect();
    format!("ray,direction_deg,N_per_Nm,beta_to_next_deg\n{lines}")
}

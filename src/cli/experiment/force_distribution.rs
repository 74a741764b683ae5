//! `hapticd experiment force-distribution`: Kim, Chung, Yi & Suh 2003 done again.
//!
//! Figures 2 and 3 (the box and the push), 4 to 7 (torques), and beyond the paper: failures of
//! each scheme, resolution with coarse and fine motors, condition on three and on six motors.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::report::Report;
use crate::analysis::design::mobility::mobility_of;
use crate::analysis::experiment::force_distribution::{
    BOX_M, Condition, LENGTH_M, Level, Moment, PUSH_RAD, ROUNDING, Resolution, Rig, Scheme, Study,
    condition_map, conditions, failures, push, pushed_pose, resolutions,
};
use crate::plot::{Axis, Colour, Figure, Legend, Marks, Panel, Series};
use crate::units::Range;

/// The box is turned by this much where it is to meet the frame by a corner.
const TILT_RAD: f64 = 0.2;

const TORQUE: Range = Range::new(1e-3, 100.0, "N m");
const STEP: Range = Range::new(1e-6, 1.0, "N m");
const WEIGHT: Range = Range::new(1.0, 1e3, "(no unit)");

/// Kim et al. 2003: how six motors share a wrench, their limits, steps and conditions
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd experiment force-distribution --out force-distribution
  hapticd experiment force-distribution --poses 5000 --seed 7 --json
  hapticd experiment force-distribution --limits 2,0.4 --weight 10 --steps 0.1,0.002")]
pub struct ForceDistribution {
    /// Device of three freedoms and six actuators, by name or file
    #[arg(long, value_name = "NAME|FILE", default_value = "kim-2003")]
    device: String,
    /// Random poses for each share of the motors' range
    #[arg(long, value_name = "N", default_value_t = 2000, value_parser = clap::value_parser!(u32).range(10..=1_000_000))]
    poses: u32,
    /// Of poses and wrenches
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Largest torque of base and floating motors, N m
    #[arg(
        long,
        value_name = "BASE,FLOATING",
        value_delimiter = ',',
        default_value = "2,0.4",
        num_args = 1
    )]
    limits: Vec<f64>,
    /// Weight of the floating motors' torques; that of the base ones is 1
    #[arg(long, value_name = "W", default_value_t = 3.0)]
    weight: f64,
    /// Steps of torque of base and floating motors, N m
    #[arg(
        long,
        value_name = "BASE,FLOATING",
        value_delimiter = ',',
        default_value = "0.05,0.001",
        num_args = 1
    )]
    steps: Vec<f64>,
    /// Folder for report.md and the pictures
    #[arg(long, value_name = "DIR", default_value = "force-distribution")]
    out: PathBuf,
    /// Print the figures as one JSON object, and nothing else, on stdout
    #[arg(long)]
    json: bool,
}

impl ForceDistribution {
    /// Does it, and writes the report.
    pub fn run(self) -> anyhow::Result<()> {
        let study = self.study()?;
        let rig = Rig::new(&study)?;
        let pushes = [push(&rig, 0.0)?, push(&rig, TILT_RAD)?];
        let levels = failures(&rig, &study)?;
        let finenesses = resolutions(&rig, &study)?;
        let spread = conditions(&rig, &study)?;
        let mut report = Report::begin(
            &self.out,
            "Force distribution on a redundant 3-RRR (Kim, Chung, Yi and Suh 2003)",
        )?;
        setting(&mut report, &study);
        figures(&mut report, &pushes, study.limits_Nm[1])?;
        tell_failures(&mut report, &levels);
        tell_resolutions(&mut report, &study, &finenesses)?;
        tell_conditions(&mut report, &rig, &spread)?;
        let path = report.finish()?;
        if self.json {
            let folder = path.display().to_string();
            say!("{}", to_json(&study, &folder, &pushes, &levels, &finenesses, &spread));
        } else {
            say!("{}", path.display());
        }
        Ok(())
    }

    fn study(&self) -> anyhow::Result<Study> {
        let pair = |field: &str, values: &[f64], range: &Range| -> anyhow::Result<[f64; 2]> {
            let pair: [f64; 2] = values.try_into().map_err(|_| {
                anyhow::anyhow!("{field} has {} numbers: it takes two, BASE,FLOATING", values.len())
            })?;
            for value in pair {
                range.check(field, value)?;
            }
            Ok(pair)
        };
        WEIGHT.check("--weight", self.weight)?;
        Ok(Study {
            device: self.device.clone(),
            poses: self.poses as usize,
            seed: self.seed,
            limits_Nm: pair("--limits", &self.limits, &TORQUE)?,
            floating_weight: self.weight,
            steps_Nm: pair("--steps", &self.steps, &STEP)?,
        })
    }
}

fn setting(report: &mut Report, study: &Study) {
    let [base, floating] = study.limits_Nm;
    report.say(&format!(
        "Device `{}`: mobility {} by Eq 1 (8 links, 9 joints of one freedom, in the plane), six \
         motors, three to spare. Base motors up to {base} N m, floating ones up to {floating} N m \
         with weight {} (Eq 25: only K2/K1 acts); {} poses for each line of a table, seed {}. \
         The paper gives no radius of the base circle, no pose and no limits of the base motors: \
         these are ours, chosen so that what its Figures 4 to 7 show happens.",
        study.device,
        mobility_of("three-rrr").unwrap_or_default(),
        study.floating_weight,
        study.poses,
        study.seed,
    ));
}

fn series(push: &[Moment], label: &str, colour: Colour, of: impl Fn(&Moment) -> f64) -> Series {
    let line = push.iter().map(|moment| [moment.t_s, of(moment)]).collect();
    Series::new(label, colour, Marks::Line(line))
}

fn against_time(title: &str, label: &str, series: Vec<Series>) -> Panel {
    Panel {
        title: title.into(),
        x: Axis::new("t [s]"),
        y: Axis::new(label),
        series,
        ..Panel::default()
    }
}

/// Torques of two motors of a chain under a scheme.
fn torques(
    title: &str,
    push: &[Moment],
    scheme: usize,
    chain: usize,
    limit_Nm: Option<f64>,
) -> Panel {
    let motor = |i: usize| move |moment: &Moment| moment.torque_Nm[scheme][i];
    let (base, floating) = (2 * chain, 2 * chain + 1);
    let names = [format!("base, chain {}", chain + 1), format!("floating, chain {}", chain + 1)];
    let mut panel = against_time(
        title,
        "torque [N m]",
        vec![
            series(push, &names[0], Colour::Blue, motor(base)),
            series(push, &names[1], Colour::Vermilion, motor(floating)),
        ],
    );
    if let Some(limit_Nm) = limit_Nm {
        let end_s = push.last().map_or(1.0, |moment| moment.t_s);
        let sign = push[push.len() / 2].torque_Nm[scheme][floating].signum();
        let line = vec![[0.0, sign * limit_Nm], [end_s, sign * limit_Nm]];
        panel.series.push(Series::new(
            "limit of the floating one",
            Colour::Grey,
            Marks::Dashed(line),
        ));
    }
    // One range for all schemes, with room for the legend.
    let shown = push.iter().flat_map(|moment| &moment.torque_Nm[..3]);
    let largest_Nm = shown.map(|torque_Nm| torque_Nm.rows(0, 4).amax());
    let most_Nm = largest_Nm.fold(limit_Nm.unwrap_or(0.0), f64::max);
    panel.y.range = Some([-1.1 * most_Nm, 1.7 * most_Nm]);
    panel
}

fn peak_Nm(push: &[Moment], scheme: usize, motor: usize) -> f64 {
    push.iter().map(|moment| moment.torque_Nm[scheme][motor].abs()).fold(0.0, f64::max)
}

fn figures(report: &mut Report, pushes: &[Vec<Moment>; 2], limit_Nm: f64) -> anyhow::Result<()> {
    let [flat, _] = pushes;
    report.heading("The box in its frame (Figures 2 and 3)");
    report.say(&format!(
        "The pose is ({:.4}, {:.4}, {:.2}) from the centre of the base circle. The box is pressed \
         into a wall of 1 kN/m at each corner that stands across the push, at 351 degrees, flat \
         and turned by {TILT_RAD} rad; where one corner meets the wall first, a moment is felt, \
         which a device touched at a single point never feels.",
        pushed_pose().x,
        pushed_pose().y,
        pushed_pose().z,
    ));
    report.picture(
        "box-and-push",
        "The box in the frame, and what is felt of the push: as Figures 2 and 3",
        &push_picture(pushes),
    )?;
    report.heading("Torques (Figures 4 to 7)");
    report.picture(
        "torques",
        "Torques for the flat push: least norm (as Figure 4), weighted (5), another chain \
         weighted (6), and with the floating motor at its limit (7)",
        &torque_picture(flat, limit_Nm),
    )?;
    let rows = Scheme::ALL.iter().enumerate().map(|(scheme, name)| {
        let peaks = (0..6).map(|motor| format!("{:.3}", peak_Nm(flat, scheme, motor)));
        std::iter::once(name.name().to_owned()).chain(peaks).collect()
    });
    report.say("Largest torques of the flat push, N m:");
    report.table(
        &["scheme", "base 1", "floating 1", "base 2", "floating 2", "base 3", "floating 3"],
        &rows.collect::<Vec<_>>(),
    );
    Ok(())
}

/// Figures 2 and 3: the box in the frame, the force, the moment.
pub(super) fn push_picture([flat, tilted]: &[Vec<Moment>; 2]) -> Figure {
    Figure {
        columns: 3,
        panel_px: (420, 380),
        panels: vec![
            frame_panel(),
            against_time(
                "Flat push",
                "force [N]",
                vec![series(flat, "force", Colour::Blue, |moment| moment.wrench.xy().norm())],
            ),
            against_time(
                "Moment about the handle",
                "moment [N m]",
                vec![
                    series(flat, "flat", Colour::Blue, |moment| moment.wrench.z),
                    series(tilted, "by a corner", Colour::Vermilion, |moment| moment.wrench.z),
                ],
            ),
        ],
        ..Figure::default()
    }
}

/// Figures 4 to 7: a base and a floating motor under three schemes.
pub(super) fn torque_picture(flat: &[Moment], limit_Nm: f64) -> Figure {
    Figure {
        columns: 2,
        panel_px: (520, 360),
        panels: vec![
            torques("Least norm (Eq 22)", flat, 0, 0, None),
            torques("Weighted (Eq 23)", flat, 1, 0, None),
            torques("Weighted, chain 2", flat, 1, 1, Some(limit_Nm)),
            torques("Null space (Eq 26-31), chain 2", flat, 2, 1, Some(limit_Nm)),
        ],
        ..Figure::default()
    }
}

/// The box against the wall of the frame, millimetres from the plate's centre.
fn frame_panel() -> Panel {
    let turned = |[x, y]: [f64; 2], by_rad: f64| {
        let (sin, cos) = by_rad.sin_cos();
        [1e3 * (cos * x - sin * y), 1e3 * (sin * x + cos * y)]
    };
    let outline = |by_rad: f64| BOX_M.map(|corner| turned(corner, by_rad)).to_vec();
    let frame = [[0.025, 0.02], [-0.025, 0.02], [-0.025, -0.02], [0.025, -0.02], [0.025, 0.02]];
    let frame = frame.map(|corner| turned(corner, PUSH_RAD)).to_vec();
    let arrow = [[0.0, 0.0], turned([0.022, 0.0], PUSH_RAD)];
    Panel {
        title: "Box and elastic frame".into(),
        x: Axis::new("x [mm]"),
        // The legend stands below the frame.
        y: Axis::between("y [mm]", -44.0, 26.0),
        equal: true,
        legend: Legend::LowerLeft,
        series: vec![
            Series::new("frame", Colour::Black, Marks::Line(frame)),
            Series::new("box", Colour::Blue, Marks::Area(outline(PUSH_RAD))),
            Series::new(
                "box, turned",
                Colour::Vermilion,
                Marks::Area(outline(PUSH_RAD + TILT_RAD)),
            ),
            Series::new("push", Colour::Green, Marks::Arrows(vec![arrow])),
        ],
    }
}

fn percent(part: usize, of: usize) -> String {
    format!("{:.1}", 100.0 * part as f64 / of.max(1) as f64)
}

fn tell_failures(report: &mut Report, levels: &[Level]) {
    report.heading("How often each scheme keeps to the limits");
    report.say(
        "Random poses and pure forces, up to what the motors can give in that direction and \
         beyond. Solved: within the limits and exact, per cent of all; the norm is weighted, \
         beside that of the exact solution.",
    );
    let mut head = vec!["share of the range", "feasible %"];
    head.extend(Scheme::ALL.map(Scheme::name));
    let share = |level: &Level| format!("{:.2} to {:.2}", level.share[0], level.share[1]);
    let rows = levels.iter().map(|level| {
        let solved = level.solved.iter().map(|solved| percent(*solved, level.poses));
        [share(level), percent(level.feasible, level.poses)].into_iter().chain(solved).collect()
    });
    report.table(&head, &rows.collect::<Vec<_>>());
    report.say("Mean norm beside the exact one, where solved:");
    let mut head = vec!["share of the range"];
    head.extend(Scheme::ALL.map(Scheme::name));
    let rows = levels.iter().filter(|level| level.feasible > 0).map(|level| {
        let ratio = |(solved, ratio): (&usize, &f64)| {
            if *solved > 0 { format!("{ratio:.3}") } else { "none".to_owned() }
        };
        let ratios = level.solved.iter().zip(&level.norm_ratio).map(ratio);
        std::iter::once(share(level)).chain(ratios).collect()
    });
    report.table(&head, &rows.collect::<Vec<_>>());
    report.say(
        "What is felt once the torques are clipped, mean error of the force in newtons and of \
         its direction in degrees. A wrench that cannot be given is told as such by the exact \
         solution alone, which gives the nearest one.",
    );
    let rows = levels.iter().map(|level| {
        let felt = level.error_N.iter().zip(level.angle_rad);
        let felt = felt.map(|(error, angle)| format!("{error:.2} N, {:.1}", angle.to_degrees()));
        std::iter::once(share(level)).chain(felt).collect()
    });
    report.table(&head, &rows.collect::<Vec<_>>());
}

fn tell_resolutions(
    report: &mut Report,
    study: &Study,
    found: &[Resolution],
) -> anyhow::Result<()> {
    let [base, floating] = study.steps_Nm;
    report.heading("Coarse and fine");
    report.say(&format!(
        "Torque comes in steps: {base} N m at the base, {floating} N m in the floating motors. \
         Forces are up to half of what the floating motors can give alone, in the last row up to \
         half of what both sets can. {ROUNDING}",
    ));
    let rows = found.iter().map(|set| {
        let errors = set.error_N.map(|error| format!("{error:.4}"));
        let range = format!("{:.1}", set.range_N);
        [set.motors.to_owned()].into_iter().chain(errors).chain([range]).collect()
    });
    report.table(
        &["motors", "error, mean [N]", "95 of 100 [N]", "largest [N]", "worst-direction force [N]"],
        &rows.collect::<Vec<_>>(),
    );
    report.picture("resolution", "How fine a force is, by who drives", &resolution_picture(found))
}

/// Share of the forces by error, for each set of motors.
pub(super) fn resolution_picture(found: &[Resolution]) -> Figure {
    let share = |errors: &[f64]| -> Vec<[f64; 2]> {
        let count = errors.len() as f64;
        let point = |(i, error): (usize, &f64)| [error.max(1e-6), (i + 1) as f64 / count];
        errors.iter().enumerate().map(point).collect()
    };
    let lines = found
        .iter()
        .enumerate()
        .map(|(i, set)| Series::new(set.motors, Colour::of(i), Marks::Line(share(&set.errors_N))));
    let panel = Panel {
        title: "Error of the force".into(),
        x: Axis::logarithmic("error [N]"),
        y: Axis::between("share of the forces [1]", 0.0, 1.0),
        legend: Legend::UpperLeft,
        series: lines.collect(),
        ..Panel::default()
    };
    Figure::single(panel)
}

/// A larger condition number is that of a posture near a singular one.
const SINGULAR: f64 = 100.0;

fn tell_conditions(report: &mut Report, rig: &Rig, spread: &[Condition]) -> anyhow::Result<()> {
    report.heading("Three motors against six");
    let worst = |of: fn(&Condition) -> f64| spread.iter().map(of).fold(0.0, f64::max);
    let middle = |of: fn(&Condition) -> f64| {
        let mut values: Vec<f64> = spread.iter().map(of).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
    };
    report.say(&format!(
        "Condition number of the map from torques to wrenches, moments on {LENGTH_M} m, over {} \
         random poses: with the three base motors median {:.1}, largest {:.0}; with all six median \
         {:.1}, largest {:.1}. {}",
        spread.len(),
        middle(|found| found.three),
        worst(|found| found.three),
        middle(|found| found.six),
        worst(|found| found.six),
        if worst(|found| found.six) <= SINGULAR {
            "No pose is near a singular one with all six, as the paper says of its workspace."
        } else {
            "Some pose is near a singular one even with all six, other than the paper says of its \
             workspace."
        },
    ));
    report.picture(
        "conditions",
        "Condition number at phi = 0 on the three base motors and on all six; 100 and more is \
         the lightest colour",
        &condition_picture(rig),
    )
}

/// Condition number at phi = 0 on three motors and on six.
pub(super) fn condition_picture(rig: &Rig) -> Figure {
    let step_m = 0.0025;
    let map = condition_map(rig, 0.0, step_m);
    let panel = |title: &str, of: fn(&Condition) -> f64| {
        let half = 0.5 * step_m;
        let cell = |found: &Condition| {
            let (x, y) = (found.p_BH.x, found.p_BH.y);
            ([x - half, y - half], [x + half, y + half], of(found))
        };
        let marks = Marks::Cells {
            cells: map.iter().map(cell).collect(),
            label: "condition number [1]".into(),
            range: Some([1.0, 100.0]),
            logarithmic: true,
        };
        Panel {
            title: title.into(),
            x: Axis::new("x [m]"),
            y: Axis::new("y [m]"),
            equal: true,
            series: vec![Series::unnamed(Colour::Black, marks)],
            ..Panel::default()
        }
    };
    Figure {
        columns: 2,
        panel_px: (560, 460),
        panels: vec![
            panel("Three base motors", |found| found.three),
            panel("All six motors", |found| found.six),
        ],
        ..Figure::default()
    }
}

fn to_json(
    study: &Study,
    report: &str,
    [flat, _]: &[Vec<Moment>; 2],
    levels: &[Level],
    finenesses: &[Resolution],
    spread: &[Condition],
) -> serde_json::Value {
    let by_scheme = |of: &dyn Fn(usize) -> serde_json::Value| -> serde_json::Value {
        let entry = |(k, scheme): (usize, &Scheme)| (scheme.name().to_owned(), of(k));
        Scheme::ALL.iter().enumerate().map(entry).collect::<serde_json::Map<_, _>>().into()
    };
    let worst = |of: fn(&Condition) -> f64| spread.iter().map(of).fold(0.0, f64::max);
    json!({
        "report": report,
        "device": study.device,
        "poses": study.poses,
        "seed": study.seed,
        "peak_torque_nm": by_scheme(&|k| {
            (0..6).map(|motor| peak_Nm(flat, k, motor)).collect::<Vec<_>>().into()
        }),
        "levels": levels.iter().map(|level| json!({
            "share": level.share,
            "poses": level.poses,
            "feasible": level.feasible,
            "solved": by_scheme(&|k| level.solved[k].into()),
            "norm_ratio": by_scheme(&|k| level.norm_ratio[k].into()),
            "error_n": by_scheme(&|k| level.error_N[k].into()),
        })).collect::<Vec<_>>(),
        "resolution": finenesses.iter().map(|set| json!({
            "motors": set.motors,
            "error_mean_n": set.error_N[0],
            "error_p95_n": set.error_N[1],
            "error_max_n": set.error_N[2],
        })).collect::<Vec<_>>(),
        "condition_max": { "three": worst(|found| found.three), "six": worst(|found| found.six) },
    })
}

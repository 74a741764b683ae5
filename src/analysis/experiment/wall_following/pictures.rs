//! The pictures of the study: Figures 13 to 15 of Cho 2005, from hapticd's own runs.
//!
//! Paths and time series of a few laws on the paper's wall, and eight snapshots of the
//! reference forces along it, on any braked device of two freedoms. In B.

use crate::actuation::Strategy;
use crate::analysis::wall_following::{
    CourseKind, Experiment, ExperimentError, HandSettings, Moment, run_with,
};
use crate::config::DeviceDefinition;
use crate::notation::PlaneVector;
use crate::plot::{Axis, Colour, Figure, Legend, Marks, Panel, Series, Sign};

/// A picture under its name, without an ending.
pub type Named = (String, Figure);

/// The laws that are drawn beside each other.
const DRAWN: [Strategy; 4] = [
    Strategy::NearestReference,
    Strategy::PredictedVelocity,
    Strategy::PathFollowing,
    Strategy::Sliding,
];

/// One point in so many milliseconds.
const THINNED: usize = 5;

/// One slide, moment by moment.
#[derive(Clone, Debug)]
struct Run {
    law: Strategy,
    moments: Vec<Moment>,
}

/// All pictures of a device on the paper's wall, with the sensor and this lag.
pub fn pictures(
    device: &str,
    hand: HandSettings,
    lag_s: f64,
) -> Result<Vec<Named>, ExperimentError> {
    pictures_of(&DRAWN, device, hand, lag_s)
}

/// The same under other laws.
pub fn pictures_of(
    laws: &[Strategy],
    device: &str,
    hand: HandSettings,
    lag_s: f64,
) -> Result<Vec<Named>, ExperimentError> {
    let definition = DeviceDefinition::load(device)?;
    let name = definition.name.to_string();
    let runs = laws
        .iter()
        .map(|&law| {
            let experiment = Experiment {
                device: device.to_owned(),
                strategy: law,
                course: CourseKind::Straight,
                hand,
                lag_s: Some(lag_s),
                ..Experiment::default()
            };
            let mut moments = Vec::new();
            run_with(&experiment, None, |moment| moments.push(*moment))?;
            Ok(Run { law, moments })
        })
        .collect::<Result<Vec<_>, ExperimentError>>()?;
    Ok(vec![
        (format!("fig13-path-{name}"), paths(&name, &runs)),
        (format!("fig14-time-{name}"), time_series(&name, &runs)),
        (format!("fig15-snapshots-{name}"), snapshots(&definition, &runs)),
    ])
}

fn line(run: &Run, x: impl Fn(&Moment) -> f64, y: impl Fn(&Moment) -> f64) -> Marks {
    Marks::Line(run.moments.iter().step_by(THINNED).map(|m| [x(m), y(m)]).collect())
}

/// Where the wall is along x.
fn surface_m(moment: &Moment) -> f64 {
    moment.p_BH.x - moment.depth_m
}

/// Figure 13: the path, and enlarged across the wall.
fn paths(name: &str, runs: &[Run]) -> Figure {
    let wall_m = runs.iter().find_map(|run| run.moments.first()).map_or(0.3, surface_m);
    let of = |x: fn(&Moment) -> f64| -> Vec<Series> {
        let drawn = runs.iter().enumerate();
        drawn
            .map(|(i, run)| Series::new(run.law.name(), Colour::of(i), line(run, x, |m| m.p_BH.y)))
            .collect()
    };
    let wall = Marks::Dashed(vec![[wall_m, -0.2], [wall_m, 0.4]]);
    let mut path = of(|m| m.p_BH.x);
    path.insert(0, Series::new("wall", Colour::Grey, wall));
    let mut near = of(|m| 1e3 * m.depth_m);
    let surface = Marks::Dashed(vec![[0.0, -0.2], [0.0, 0.4]]);
    near.insert(0, Series::new("wall", Colour::Grey, surface));
    Figure {
        title: format!("{name}: path of the handle (Cho 2005, Fig. 13)"),
        columns: 2,
        panel_px: (520, 520),
        panels: vec![
            Panel {
                x: Axis::new("x [m]"),
                y: Axis::between("y [m]", -0.2, 0.4),
                legend: Legend::UpperRight,
                series: path,
                ..Panel::default()
            },
            Panel {
                title: "enlarged".into(),
                x: Axis::between("penetration [mm]", -1.0, 3.0),
                y: Axis::between("y [m]", -0.2, 0.4),
                legend: Legend::LowerRight,
                series: near,
                ..Panel::default()
            },
        ],
    }
}

/// Figure 14: hand force along the wall, approximation angle and leading brake over time.
fn time_series(name: &str, runs: &[Run]) -> Figure {
    let ends = runs.iter().filter_map(|run| run.moments.last());
    let end_s = ends.map(|moment| moment.t_s).fold(1.0, f64::max);
    let panel = |label: &str, y: fn(&Moment) -> f64, range: Option<[f64; 2]>, legend| Panel {
        // The legend stands behind the end.
        x: Axis::between("time [s]", 0.0, 1.25 * end_s),
        y: Axis { label: label.into(), range, ..Axis::default() },
        legend,
        series: runs
            .iter()
            .enumerate()
            .map(|(i, run)| Series::new(run.law.name(), Colour::of(i), line(run, |m| m.t_s, y)))
            .collect(),
        ..Panel::default()
    };
    let pull = |m: &Moment| sliding(m, -m.F_hand_BH_N.y);
    let gamma = |m: &Moment| sliding(m, m.gamma_rad.map_or(f64::NAN, f64::to_degrees));
    let leading = |m: &Moment| sliding(m, m.leading.map_or(f64::NAN, |i| i as f64 + 1.0));
    Figure {
        title: format!("{name}: the slide over time (Cho 2005, Fig. 14)"),
        columns: 1,
        panel_px: (900, 260),
        panels: vec![
            panel("hand force along the wall [N]", pull, None, Legend::UpperRight),
            panel("gamma [deg]", gamma, Some([0.0, 95.0]), Legend::UpperRight),
            panel("brake that leads", leading, Some([0.5, 4.5]), Legend::UpperRight),
        ],
    }
}

/// A gap where the hand does not slide.
fn sliding(moment: &Moment, value: f64) -> f64 {
    if moment.sliding { value } else { f64::NAN }
}

/// Figure 15: the reference forces at eight places of the slide, with the hand's force and the
/// force that a wall would give.
fn snapshots(definition: &DeviceDefinition, runs: &[Run]) -> Figure {
    let slide = runs.last().map(|run| run.moments.as_slice()).unwrap_or_default();
    let moments: Vec<&Moment> = slide.iter().filter(|moment| moment.sliding).collect();
    let count = moments.len();
    let panels = (0..8).filter_map(|k| {
        let moment = moments.get(count * (2 * k + 1) / 16)?;
        Some(snapshot(definition, k + 1, moment))
    });
    Figure {
        title: format!(
            "{}: reference forces along the wall (Cho 2005, Fig. 15), hand as under sliding",
            definition.name
        ),
        columns: 4,
        panel_px: (440, 330),
        panels: panels.collect(),
    }
}

fn snapshot(definition: &DeviceDefinition, number: usize, moment: &Moment) -> Panel {
    let posture = definition.mechanism.posture_at(&moment.p_BH).ok();
    let reference = posture.map(|posture| posture.reference).unwrap_or_default();
    let mut series = Vec::new();
    for i in 0..definition.mechanism.actuators() {
        let ray = reference.column(i).xy();
        let Some(unit) = ray.try_normalize(1e-12) else { continue };
        let both = vec![[[0.0, 0.0], unit.into()], [[0.0, 0.0], (-unit).into()]];
        let colour = Colour::of(i);
        let label = format!("R{}", i + 1);
        series.push(Series::new(label, colour, Marks::Arrows(both)));
        let at = unit * 1.12;
        let signs = vec![([at.x, at.y], "+".to_owned()), ([-at.x, -at.y], "-".to_owned())];
        series.push(Series::unnamed(colour, Marks::Text(signs)));
    }
    let hand = scaled(&moment.F_hand_BH_N);
    let wall = -moment.F_hand_BH_N.dot(&moment.normal);
    let desired = scaled(&(moment.normal * wall.max(0.0)));
    let arrow = |to: [f64; 2]| Marks::Arrows(vec![[[0.0, 0.0], to]]);
    series.push(Series::new("hand", Colour::Black, arrow(hand)));
    series.push(Series::new("desired", Colour::Grey, arrow(desired)));
    series.push(Series::unnamed(Colour::Black, Marks::Points(Sign::Dot, vec![[0.0, 0.0]])));
    Panel {
        title: format!("P{number}: y = {:.3} m", moment.p_BH.y),
        // The legend stands beside the rays.
        x: Axis::between("x", -1.4, 2.8),
        y: Axis::between("y", -1.4, 1.4),
        equal: true,
        legend: Legend::UpperRight,
        series,
    }
}

/// A force in a picture of unit vectors: 15 newtons are one.
fn scaled(force_N: &PlaneVector) -> [f64; 2] {
    [force_N.x / 15.0, force_N.y / 15.0]
}

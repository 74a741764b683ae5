//! The pictures of the page of Cho 2005.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

use super::Pictures;
use crate::actuation::Strategy;
use crate::analysis::experiment::wall_following::pictures::pictures_of;
use crate::analysis::papers::cho::{Cho, DEVICES, PLACES_M, figure_1, figure_3};
use crate::analysis::wall_following::HandSettings;
use crate::cli::design::{linkage, place_panel};
use crate::cli::experiment::optimisation::{
    front_picture, histograms, published, rays_over_workspace,
};
use crate::config::DeviceDefinition;
use crate::mechanism::Posture;
use crate::notation::PlaneVector;
use crate::plot::{Axis, Colour, Figure, Legend, Marks, Panel, Series, Sign};

/// Lag of the brakes in Figures 13 and 14: the device's own.
const LAG_S: f64 = 0.002;

/// All of them.
pub fn cho(found: &Cho) -> anyhow::Result<Pictures> {
    let mut all = vec![
        ("cho-2005-fig-1", one_place(first()?)),
        ("cho-2005-fig-2", one_place(second()?)),
        ("cho-2005-fig-3", one_place(third()?)),
        ("cho-2005-fig-4", one_place(fourth()?)),
        ("cho-2005-fig-5-7", linkages()?),
        ("cho-2005-fig-6", coupled()),
        ("cho-2005-fig-8", one_place(eighth()?)),
        ("cho-2005-fig-9", histograms(&published()?)),
        ("cho-2005-fig-10", rays_over_workspace(&published()?[1])),
        ("cho-2005-fig-11", one_place(eleventh(found)?)),
        ("cho-2005-fig-15", snapshots(found)?),
        (
            "cho-2005-fronts",
            front_picture(
                &found.designs.straight.front,
                &found.designs.crossed.front,
                found.designs.published,
            ),
        ),
    ];
    let laws = [
        Strategy::NearestReference,
        Strategy::Coercive,
        Strategy::PredictedVelocity,
        Strategy::Sliding,
    ];
    for (name, mut figure) in pictures_of(&laws, DEVICES[1], HandSettings::default(), LAG_S)? {
        if name.starts_with("fig13") {
            figure.panels.iter_mut().skip(1).for_each(within);
            all.push(("cho-2005-fig-13", figure));
        } else if name.starts_with("fig14") {
            all.push(("cho-2005-fig-14", figure));
        }
    }
    Ok(all)
}

/// Lines end where the axis does instead of running along its end.
fn within(panel: &mut Panel) {
    let Some([from, to]) = panel.x.range else { return };
    for series in &mut panel.series {
        let Marks::Line(points) = &mut series.marks else { continue };
        for [x, _] in points.iter_mut().filter(|[x, _]| !(from..=to).contains(x)) {
            *x = f64::NAN;
        }
    }
}

/// Directions at a place, the legend below them.
fn one_place(mut panel: Panel) -> Figure {
    panel.y = Axis::between("direction, y", -2.75, 1.75);
    Figure { panel_px: (560, 690), ..Figure::single(panel) }
}

/// An arrow from the middle with a word at its end.
fn arrow(panel: &mut Panel, colour: Colour, word: &str, angle_rad: f64, length: f64) {
    let (sin, cos) = angle_rad.sin_cos();
    let to = [length * cos, length * sin];
    panel.series.push(Series::unnamed(colour, Marks::Arrows(vec![[[0.0, 0.0], to]])));
    let at = [to[0] + 0.06 * cos.signum() - if cos < 0.0 { 0.26 } else { 0.0 }, to[1] + 0.05 * sin];
    panel.series.push(Series::unnamed(colour, Marks::Text(vec![(at, word.to_owned())])));
}

/// Without what this figure is not about.
fn without(panel: &mut Panel, names: &[&str]) {
    panel
        .series
        .retain(|series| series.label.as_deref().is_none_or(|label| !names.contains(&label)));
}

fn first() -> anyhow::Result<Panel> {
    let (device, posture) = figure_1()?;
    let mut panel = place_panel(&device, &posture, None, None);
    panel.title = "Two-link arm at (45, 90) degrees: four passive FMEs".into();
    without(&mut panel, &["force ellipse"]);
    // Numbered by the signs of the joint rates, as in the paper's (a).
    let words = [(22.5, "FME 1"), (112.5, "FME 2"), (202.5, "FME 3"), (292.5, "FME 4")];
    let words = words.map(|(deg, word)| {
        let (sin, cos) = f64::to_radians(deg).sin_cos();
        ([0.62 * cos - 0.16, 0.62 * sin + 0.04], word.to_owned())
    });
    panel.series.push(Series::unnamed(Colour::Blue, Marks::Text(words.into())));
    Ok(panel)
}

fn second() -> anyhow::Result<Panel> {
    let (device, posture) = figure_1()?;
    let mut panel = place_panel(&device, &posture, Some(-FRAC_PI_2), None);
    panel.title = "Moving along -y: three desired forces".into();
    without(&mut panel, &["force ellipse", "one-brake paths"]);
    panel.series.retain(|series| !is_path_name(series));
    for (word, deg) in [("F_d1", 110.0), ("F_d2", 60.0), ("F_d3", -60.0)] {
        arrow(&mut panel, Colour::Orange, word, f64::to_radians(deg), 0.8);
    }
    Ok(panel)
}

/// The words that name one-brake paths.
fn is_path_name(series: &Series) -> bool {
    matches!(&series.marks, Marks::Text(words) if words.iter().all(|(_, word)| word.starts_with('Q')))
}

fn third() -> anyhow::Result<Panel> {
    let (device, posture) = figure_3()?;
    let mut panel = place_panel(&device, &posture, None, Some(FRAC_PI_2));
    panel.title = "A wall with normal y, arm at (30, 45) degrees".into();
    without(&mut panel, &["force ellipse"]);
    let wall = Marks::Line(vec![[-1.7, 0.0], [1.7, 0.0]]);
    panel.series.push(Series::new("wall", Colour::Grey, wall));
    arrow(&mut panel, Colour::Blue, "F_ha", (-30f64).to_radians(), 0.9);
    arrow(&mut panel, Colour::Blue, "F_hb", 200f64.to_radians(), 0.9);
    Ok(panel)
}

fn fourth() -> anyhow::Result<Panel> {
    let (device, posture) = figure_1()?;
    let motion_rad = -3.0 * FRAC_PI_4 + 1.3;
    let mut panel = place_panel(&device, &posture, Some(motion_rad), None);
    panel.title = "Forces that resist the motion lie between a and -a".into();
    without(&mut panel, &["force ellipse", "one-brake paths"]);
    panel.series.retain(|series| !is_path_name(series));
    let (sin, cos) = (motion_rad + FRAC_PI_2).sin_cos();
    let line = Marks::Dashed(vec![[-1.5 * cos, -1.5 * sin], [1.5 * cos, 1.5 * sin]]);
    panel.series.push(Series::new("a, -a: normal to the motion", Colour::Blue, line));
    Ok(panel)
}

fn linkages() -> anyhow::Result<Figure> {
    let panel = |name: &str, title: &str| -> anyhow::Result<Panel> {
        let device = DeviceDefinition::load(name)?;
        let posture = device.mechanism.posture_at(&PlaneVector::new(0.3, 0.1, 0.0))?;
        let handle = Marks::Points(Sign::Circle, vec![[0.3, 0.1]]);
        Ok(Panel {
            title: title.into(),
            x: Axis::between("x [m]", -0.3, 0.45),
            y: Axis::between("y [m]", -0.1, 0.65),
            equal: true,
            legend: Legend::UpperRight,
            series: vec![
                Series::new("links", Colour::Black, linkage(&device, &posture)),
                Series::new("base", Colour::Blue, Marks::Points(Sign::Square, vec![[0.0, 0.0]])),
                Series::new("handle P", Colour::Vermilion, handle),
            ],
        })
    };
    let panels =
        vec![panel(DEVICES[0], "Before (all l 0.3 m)")?, panel(DEVICES[1], "After (Table I)")?];
    Ok(Figure { columns: 2, panel_px: (460, 460), panels, title: String::new() })
}

/// Figure 6: links 2 and 4 after each of the two steps.
fn coupled() -> Figure {
    let at = |phi2_deg: f64, phi4_deg: f64| {
        let unit = |deg: f64| deg.to_radians().sin_cos();
        let ((s2, c2), (s4, c4)) = (unit(phi2_deg), unit(phi4_deg));
        vec![[0.0, 0.0], [0.2 * c2, 0.2 * s2], [0.2 * c2 + 0.291 * c4, 0.2 * s2 + 0.291 * s4]]
    };
    let steps = [
        ("at the beginning: theta4 = 0", 0.0, 0.0),
        ("brake 4 to 45 deg, brake 2 locked: theta4 = 45 deg", 0.0, 45.0),
        ("link 2 to 90 deg, brake 4 locked: theta4 = -45 deg", 90.0, 45.0),
    ];
    let mut series = Vec::new();
    for (i, (name, phi2, phi4)) in steps.into_iter().enumerate() {
        let line = at(phi2, phi4);
        series.push(Series::new(name, Colour::of(i), Marks::Line(line.clone())));
        series.push(Series::unnamed(Colour::of(i), Marks::Points(Sign::Dot, line)));
    }
    let panel = Panel {
        title: "Links 2 and 4, k2 = k4 = 1".into(),
        x: Axis::between("x [m]", -0.1, 0.55),
        y: Axis::between("y [m]", -0.08, 0.57),
        equal: true,
        legend: Legend::UpperRight,
        series,
    };
    Figure { panel_px: (560, 520), ..Figure::single(panel) }
}

fn on_wall(name: &str, y_m: f64) -> anyhow::Result<(DeviceDefinition, Posture)> {
    let device = DeviceDefinition::load(name)?;
    let posture = device.mechanism.posture_at(&PlaneVector::new(0.3, y_m, 0.0))?;
    Ok((device, posture))
}

fn eighth() -> anyhow::Result<Panel> {
    let (device, posture) = on_wall(DEVICES[1], 0.1)?;
    // A motion that turns all shafts backwards: against it R1+ to R4+ are available.
    let turns = |motion: &f64| {
        let way = PlaneVector::new(motion.cos(), motion.sin(), 0.0);
        posture.reference.tr_mul(&way).iter().take(4).all(|rate| *rate < 0.0)
    };
    let all: Vec<f64> = (0..360).map(|deg| f64::from(deg).to_radians()).filter(turns).collect();
    let motion_rad = all.get(all.len() / 2).copied();
    let mut panel = place_panel(&device, &posture, motion_rad, None);
    panel.title = "cho-2005 at (0.3, 0.1) m: all shafts turn backwards".into();
    without(&mut panel, &["force ellipse", "one-brake paths"]);
    panel.series.retain(|series| !is_path_name(series));
    Ok(panel)
}

fn eleventh(found: &Cho) -> anyhow::Result<Panel> {
    let (device, posture) = on_wall(DEVICES[1], PLACES_M[0])?;
    let mut panel = place_panel(&device, &posture, Some(-FRAC_PI_2), Some(PI));
    panel.title = format!("On the paper's wall at y = {} m", PLACES_M[0]);
    without(&mut panel, &["force ellipse"]);
    let wall = Marks::Line(vec![[0.0, -1.7], [0.0, 1.7]]);
    panel.series.push(Series::new("wall", Colour::Grey, wall));
    let hand = found.wall.hands_N[0];
    arrow(&mut panel, Colour::Blue, "hand", hand.y.atan2(hand.x), 0.9);
    Ok(panel)
}

/// Figure 15: both devices at four places with the same hand.
fn snapshots(found: &Cho) -> anyhow::Result<Figure> {
    let mut panels = Vec::new();
    for (row, (name, called)) in
        [(DEVICES[1], "optimised"), (DEVICES[0], "unoptimised")].into_iter().enumerate()
    {
        for (k, y_m) in PLACES_M.into_iter().enumerate() {
            let (device, posture) = on_wall(name, y_m)?;
            let mut panel = place_panel(&device, &posture, None, Some(PI));
            without(&mut panel, &["force ellipse", "one-brake paths"]);
            panel.series.retain(|series| !is_path_name(series));
            let hand = found.wall.hands_N[k];
            arrow(&mut panel, Colour::Blue, "", hand.y.atan2(hand.x), 0.9);
            let letter = ["a", "b", "c", "d", "e", "f", "g", "h"][4 * row + k];
            panel.title = format!("({letter}) {called}, y = {y_m:.2} m");
            panel.series.iter_mut().for_each(|series| series.label = None);
            short_names(&mut panel);
            panels.push(panel);
        }
    }
    Ok(Figure { columns: 4, panel_px: (400, 390), panels, title: String::new() })
}

/// Names of rays without their forces; those of R4 further out, as R3 may lie beside it.
fn short_names(panel: &mut Panel) {
    for series in &mut panel.series {
        let Marks::Text(words) = &mut series.marks else { continue };
        for (at, word) in words.iter_mut().filter(|(_, word)| word.starts_with('R')) {
            // Where the word's middle was meant to be.
            let middle = [at[0] + 0.16, at[1] - 0.04];
            let scale = if word.starts_with("R4") { 1.15 } else { 0.95 };
            *at = [scale * middle[0] - 0.12, scale * middle[1] + 0.06];
            word.truncate(word.find(' ').unwrap_or(word.len()));
        }
    }
}

//! Pieces of pictures that several commands draw: histograms, rays at a place, linkages.

use std::f64::consts::TAU;

use crate::analysis::design::cones::{
    OneBrakePath, direction_of, friction_cone, one_brake_paths, passive_set_of, regions,
};
use crate::analysis::design::local::{ellipse, ray_indices};
use crate::analysis::design::{Annulus, Grid, turns_about_base};
use crate::config::DeviceDefinition;
use crate::mechanism::{Mechanism, Posture, Ray};
use crate::notation::ReferenceMatrix;
use crate::plot::{Axis, Colour, Legend, Marks, Panel, Series, Sign};

/// Between the points of a line that was drawn in pieces.
pub const GAP: [f64; 2] = [f64::NAN, f64::NAN];

/// Width of a histogram's bars, degrees.
const BIN_DEG: f64 = 5.0;

/// Largest beta in degrees and weight, for every reached place of a grid.
pub fn largest_betas_deg(mechanism: &dyn Mechanism, grid: &Grid) -> Vec<(f64, f64)> {
    let walked = match grid {
        Grid::Annulus(annulus) if turns_about_base(mechanism) => Grid::Annulus(annulus.folded()),
        _ => *grid,
    };
    let beta = |place: crate::analysis::design::Place| {
        let posture = mechanism.posture_at(&place.p_BH).ok()?;
        let rays = ray_indices(&posture.reference, mechanism.actuators())?;
        Some((rays.P_f.to_degrees(), place.weight))
    };
    walked.places().filter_map(beta).collect()
}

/// Shares of the workspace by largest beta, one outline for each of several designs.
pub fn histogram(title: &str, designs: &[(&str, Vec<(f64, f64)>)]) -> Panel {
    let bins = (180.0 / BIN_DEG) as usize;
    let least = |betas: &[(f64, f64)]| betas.iter().map(|(deg, _)| *deg).fold(180.0, f64::min);
    let from_deg = designs.iter().map(|(_, betas)| least(betas)).fold(180.0, f64::min);
    let from_deg = (from_deg / 10.0).floor() * 10.0;
    let mut series = Vec::new();
    for (i, (name, betas)) in designs.iter().enumerate() {
        let all: f64 = betas.iter().map(|(_, weight)| weight).sum();
        let mut shares = vec![0.0; bins];
        for (deg, weight) in betas {
            shares[((deg / BIN_DEG) as usize).min(bins - 1)] += 100.0 * weight / all;
        }
        let filled = shares.iter().rposition(|share| *share > 0.0).map_or(0, |last| last + 1);
        let begin = ((from_deg / BIN_DEG) as usize).min(filled);
        let edges: Vec<f64> = (begin..=filled).map(|k| BIN_DEG * k as f64).collect();
        let marks = if designs.len() == 1 {
            Marks::Bars(edges, shares[begin..filled].to_vec())
        } else {
            Marks::Line(steps(&edges, &shares[begin..filled]))
        };
        series.push(Series::new(*name, Colour::of(i), marks));
    }
    Panel {
        title: title.into(),
        x: Axis::new("largest beta at a place [deg]"),
        y: Axis::new("share of the workspace [%]"),
        series,
        ..Panel::default()
    }
}

/// The outline of bars that stand side by side.
fn steps(edges: &[f64], heights: &[f64]) -> Vec<[f64; 2]> {
    let mut outline = vec![[edges.first().copied().unwrap_or_default(), 0.0]];
    for (edge, height) in edges.windows(2).zip(heights) {
        outline.extend([[edge[0], *height], [edge[1], *height]]);
    }
    outline.push([edges.last().copied().unwrap_or_default(), 0.0]);
    outline
}

/// The linkage in a posture, as a line with gaps.
pub fn linkage(device: &DeviceDefinition, posture: &Posture) -> Marks {
    let mut segments = Default::default();
    let count = device.mechanism.outline(posture, &mut segments);
    Marks::Line(segments[..count].iter().flat_map(|(from, to)| [*from, *to, GAP]).collect())
}

/// Both rays of each actuator through a place, of this length, as one line per actuator.
pub fn fan(reference: &ReferenceMatrix, actuator: usize, at: [f64; 2], half: f64) -> Vec<[f64; 2]> {
    let angle_rad = direction_of(reference, Ray { actuator, positive: true });
    let end =
        |sign: f64| [at[0] + sign * half * angle_rad.cos(), at[1] + sign * half * angle_rad.sin()];
    vec![end(-1.0), end(1.0), GAP]
}

/// A wedge from the middle, as an outline.
fn wedge(from_rad: f64, width_rad: f64, radius: f64) -> Vec<[f64; 2]> {
    let pieces = (width_rad / 0.05).ceil().max(1.0) as usize;
    let arc = (0..=pieces).map(|k| polar(from_rad + width_rad * k as f64 / pieces as f64, radius));
    std::iter::once([0.0, 0.0]).chain(arc).collect()
}

fn polar(angle_rad: f64, radius: f64) -> [f64; 2] {
    [radius * angle_rad.cos(), radius * angle_rad.sin()]
}

/// Directions at one place: rays, ellipse, one-brake paths, and with a motion or a desired
/// force the passive set and the friction cone. Rays and the longer semi-axis have length 1.
pub fn place_panel(
    device: &DeviceDefinition,
    posture: &Posture,
    motion_rad: Option<f64>,
    desired_rad: Option<f64>,
) -> Panel {
    let (reference, n) = (&posture.reference, device.mechanism.actuators());
    let mut series = Vec::new();
    let all: Vec<usize> = (0..n).collect();
    if let Some(set) = motion_rad.and_then(|motion| passive_set_of(reference, n, motion)) {
        let area = wedge(set.cone.from_rad, set.cone.width_rad, 1.1);
        series.push(Series::new("passive set of the motion", Colour::Green, Marks::Area(area)));
    }
    if let Some(cone) = desired_rad.and_then(|desired| friction_cone(reference, &all, desired)) {
        let area = wedge(cone.from_rad, cone.width_rad, 1.1);
        series.push(Series::new("pseudo friction cone", Colour::Vermilion, Marks::Area(area)));
    }
    let paths = one_brake_paths(reference, n);
    let dashes =
        paths.iter().flat_map(|path| [polar(path.plus_rad, -1.1), polar(path.plus_rad, 1.42), GAP]);
    if motion_rad.is_some() || desired_rad.is_some() {
        series.push(Series::new("one-brake paths", Colour::Grey, Marks::Dashed(dashes.collect())));
        let word = |path: &OneBrakePath| {
            let [x, y] = polar(path.plus_rad, 1.5);
            ([x - 0.07, y + 0.04], format!("Q{}+", path.brake + 1))
        };
        let words = paths.iter().map(word);
        series.push(Series::unnamed(Colour::Grey, Marks::Text(words.collect())));
    }
    series.extend(rays_of(reference, n));
    let found = ellipse(reference, n);
    let outline = ellipse_outline(found, [0.0, 0.0], 1.0 / found.semi_axes[0]);
    series.push(Series::new("force ellipse", Colour::Blue, Marks::Line(outline)));
    for (angle_rad, name, colour) in
        [(motion_rad, "motion", Colour::Purple), (desired_rad, "desired force", Colour::Orange)]
    {
        if let Some(angle_rad) = angle_rad {
            let arrow = Marks::Arrows(vec![[[0.0, 0.0], polar(angle_rad, 0.85)]]);
            series.push(Series::new(name, colour, arrow));
        }
    }
    let p = posture.p_BH;
    Panel {
        title: format!("{} at ({:.3}, {:.3}) m", device.name, p.x, p.y),
        x: Axis::between("direction, x", -1.75, 1.75),
        y: Axis::between("direction, y", -1.75, 1.75),
        equal: true,
        legend: Legend::LowerRight,
        series,
    }
}

/// Arrows of equal length: the strong ones would hide where the weak ones point.
fn rays_of(reference: &ReferenceMatrix, actuators: usize) -> [Series; 2] {
    let all: Vec<Ray> = regions(reference, actuators).iter().map(|region| region.from).collect();
    let arrow = |ray: &Ray| [[0.0, 0.0], polar(direction_of(reference, *ray), 1.0)];
    let name = |ray: &Ray| {
        let [x, y] = polar(direction_of(reference, *ray), 1.28);
        let force = reference.column(ray.actuator).xy().norm();
        ([x - 0.16, y + 0.04], format!("R{ray} {force:.1}"))
    };
    let arrows = Marks::Arrows(all.iter().map(arrow).collect());
    [
        Series::new("reference forces [N per N m]", Colour::Black, arrows),
        Series::unnamed(Colour::Black, Marks::Text(all.iter().map(name).collect())),
    ]
}

/// The outline of a force ellipse about a place, `scale` long per newton (per newton metre).
pub fn ellipse_outline(
    ellipse: crate::analysis::design::local::ForceEllipse,
    [x, y]: [f64; 2],
    scale: f64,
) -> Vec<[f64; 2]> {
    let [long, short] = ellipse.semi_axes.map(|axis| axis * scale);
    let (sin, cos) = ellipse.angle_rad.sin_cos();
    let point = |k: i32| {
        let (b, a) = (TAU * f64::from(k) / 48.0).sin_cos();
        [x + long * a * cos - short * b * sin, y + long * a * sin + short * b * cos]
    };
    (0..=48).map(point).collect()
}

/// The border of an annulus, both circles, as a line with a gap.
pub fn circles([least_m, most_m]: [f64; 2]) -> Marks {
    let circle = |r: f64| (0..=180).map(move |k| polar(TAU * f64::from(k) / 180.0, r));
    Marks::Line(circle(least_m).chain([GAP]).chain(circle(most_m)).collect())
}

/// Signs of the four classes of condition number, as Singh et al. draw them.
pub const CLASS_SIGNS: [(Sign, Colour); 4] = [
    (Sign::Plus, Colour::Blue),
    (Sign::Asterisk, Colour::Orange),
    (Sign::Square, Colour::Vermilion),
    (Sign::Diamond, Colour::Black),
];

/// The usual annulus of a picture's rays and ellipses: few radii, places that do not overlap.
pub fn sparse(radii_m: [f64; 2], radii: usize, bearings: usize) -> Grid {
    Grid::Annulus(Annulus { radii, bearings, ..Annulus::polar(radii_m[0], radii_m[1]) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_of_a_histogram_are_those_of_the_weights() {
        let panel = histogram("t", &[("a", vec![(52.0, 3.0), (53.0, 1.0), (61.0, 4.0)])]);
        let Marks::Bars(edges, heights) = &panel.series[0].marks else { panic!("bars") };
        assert_eq!(
            (edges.as_slice(), heights.as_slice()),
            (&[50.0, 55.0, 60.0, 65.0][..], &[50.0, 0.0, 50.0][..])
        );
        let empty = histogram("t", &[("a", vec![]), ("b", vec![(10.0, 1.0)])]);
        assert_eq!(empty.series.len(), 2);
    }

    #[test]
    fn the_outline_of_an_ellipse_has_its_axes() {
        let found =
            crate::analysis::design::local::ForceEllipse { semi_axes: [4.0, 1.0], angle_rad: 0.3 };
        let outline = ellipse_outline(found, [1.0, 2.0], 0.5);
        let far = outline.iter().map(|[x, y]| (x - 1.0).hypot(y - 2.0));
        let (least, most) = far.fold((9.0f64, 0.0f64), |(l, m), r| (l.min(r), m.max(r)));
        assert!((least - 0.5).abs() < 1e-12 && (most - 2.0).abs() < 1e-12);
    }
}

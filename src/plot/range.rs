//! What part of the numbers an axis shows, and the powers of ten of a logarithmic one.

use super::{Axis, Marks, Panel};

/// Air on both sides of what there is, as a share of it.
const AIR: f64 = 0.04;

/// Where places lie on an axis: themselves, or their powers of ten.
pub(super) fn on_axis(axis: &Axis, value: f64) -> Option<f64> {
    scaled(axis.logarithmic, value)
}

/// A number, or its power of ten; `None` where it is no number to be drawn.
pub(super) fn scaled(logarithmic: bool, value: f64) -> Option<f64> {
    let value = if logarithmic { value.log10() } else { value };
    value.is_finite().then_some(value)
}

/// A place on both axes.
pub(super) fn place(panel: &Panel, [x, y]: [f64; 2]) -> Option<(f64, f64)> {
    Some((on_axis(&panel.x, x)?, on_axis(&panel.y, y)?))
}

/// What both axes of a panel show, for axes of so many pixels.
pub(super) fn shown(panel: &Panel, (width_px, height_px): (f64, f64)) -> [[f64; 2]; 2] {
    let mut all = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
    for series in &panel.series {
        for point in places(&series.marks) {
            let on = [on_axis(&panel.x, point[0]), on_axis(&panel.y, point[1])];
            for (range, value) in all.iter_mut().zip(on) {
                if let Some(value) = value {
                    *range = [range[0].min(value), range[1].max(value)];
                }
            }
        }
    }
    let [x, y] = [chosen(&panel.x, all[0]), chosen(&panel.y, all[1])];
    if panel.equal { equalled([x, y], [width_px, height_px]) } else { [x, y] }
}

fn places(marks: &Marks) -> Vec<[f64; 2]> {
    match marks {
        Marks::Line(points) | Marks::Dashed(points) | Marks::Area(points) => points.clone(),
        Marks::Points(_, points) => points.clone(),
        Marks::Arrows(arrows) => arrows.iter().flatten().copied().collect(),
        Marks::Bars(edges, heights) => {
            let heights = heights.iter().copied().chain([0.0]);
            edges.iter().copied().zip(heights).map(Into::into).chain([[f64::NAN, 0.0]]).collect()
        }
        Marks::Cells { cells, .. } => cells.iter().flat_map(|cell| [cell.0, cell.1]).collect(),
        Marks::Text(words) => words.iter().map(|(place, _)| *place).collect(),
    }
}

/// What was asked for, or all that there is and some air; never empty.
fn chosen(axis: &Axis, [least, most]: [f64; 2]) -> [f64; 2] {
    if let Some([from, to]) = axis.range {
        let (from, to) = (on_axis(axis, from), on_axis(axis, to));
        if let (Some(from), Some(to)) = (from, to)
            && from < to
        {
            return [from, to];
        }
    }
    if least > most {
        return [0.0, 1.0];
    }
    let size = most - least;
    let air = if size > 0.0 { AIR * size } else { 0.5 * most.abs().max(1.0) };
    [least - air, most + air]
}

/// The smaller scale of both, around the same middles.
fn equalled(ranges: [[f64; 2]; 2], px: [f64; 2]) -> [[f64; 2]; 2] {
    let per_px = |i: usize| (ranges[i][1] - ranges[i][0]) / px[i].max(1.0);
    let per_px = per_px(0).max(per_px(1));
    [0, 1].map(|i| {
        let middle = 0.5 * (ranges[i][0] + ranges[i][1]);
        let half = 0.5 * per_px * px[i].max(1.0);
        [middle - half, middle + half]
    })
}

/// A number beside an axis that is `span` long, as short as it can be; what is left of rounding
/// is zero.
pub(super) fn tick_label(logarithmic: bool, value: f64, span: f64) -> String {
    let value = if value.abs() < 1e-9 * span { 0.0 } else { value };
    let value = if logarithmic { two_digits(10f64.powf(value)) } else { value };
    if value != 0.0 && !(1e-3..1e5).contains(&value.abs()) {
        let text = format!("{value:.1e}");
        return text.replace(".0e", "e");
    }
    let text = format!("{value:.4}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// Ticks between powers of ten lie where they lie: two digits tell enough.
fn two_digits(value: f64) -> f64 {
    let unit = 10f64.powf(value.log10().floor() - 1.0);
    (value / unit).round() * unit
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plot::{Colour, Series};

    #[test]
    fn an_equal_panel_has_the_same_scale_both_ways_and_shows_everything() {
        let line = Marks::Line(vec![[-1.0, 0.0], [3.0, 1.0]]);
        let series = vec![Series::unnamed(Colour::Blue, line)];
        let panel = Panel { equal: true, series, ..Panel::default() };
        let [x, y] = shown(&panel, (300.0, 200.0));
        assert!(((x[1] - x[0]) / 300.0 - (y[1] - y[0]) / 200.0).abs() < 1e-12);
        assert!(x[0] < -1.0 && x[1] > 3.0 && y[0] < 0.0 && y[1] > 1.0);
    }

    #[test]
    fn numbers_beside_axes_are_short() {
        for (value, text) in [
            (0.30000000000000004, "0.3"),
            (-0.0, "0"),
            (1e7, "1e7"),
            (2.5e-5, "2.5e-5"),
            (12.0, "12"),
            (-5.6e-17, "0"),
        ] {
            assert_eq!(tick_label(false, value, 1.0), text);
        }
        assert_eq!(tick_label(true, 2.0, 1.0), "100");
        assert_eq!(tick_label(true, 3.2, 1.0), "1600");
        assert_eq!(tick_label(true, -2.4, 1.0), "0.004");
    }

    #[test]
    fn bars_stand_on_zero() {
        let bars = Marks::Bars(vec![0.0, 1.0, 2.0], vec![5.0, 7.0]);
        let panel = Panel { series: vec![Series::unnamed(Colour::Blue, bars)], ..Panel::default() };
        let [x, y] = shown(&panel, (100.0, 100.0));
        assert!(x[0] < 0.0 && x[1] > 2.0 && y[0] < 0.0 && y[0] > -1.0 && y[1] > 7.0);
    }
}

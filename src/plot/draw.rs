//! A [`Figure`] on a canvas of the drawing library: axes, marks, legend, bar of colours.
//!
//! Everything is measured in pixels of the SVG and multiplied by the canvas's scale.

use std::error::Error;
use std::path::Path;
use std::sync::Once;

use plotters::backend::BitMapBackend;
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};

use super::range::{on_axis, place, scaled, shown, tick_label};
use super::sign::SignAt;
use super::{Colour, Figure, Legend, Marks, Panel, PictureError, Series, Sign};

const FONT: &str = "sans-serif";
const TITLE_PX: f64 = 18.0;
const CAPTION_PX: f64 = 15.0;
const LABEL_PX: f64 = 12.0;
const TICK_PX: f64 = 5.0;
const MARGIN_PX: f64 = 10.0;
const X_LABELS_PX: f64 = 42.0;
const Y_LABELS_PX: f64 = 60.0;
/// Width of a bar of colours with its numbers.
const COLOUR_BAR_PX: f64 = 86.0;
const PNG_SCALE: f64 = 2.0;
/// The drawing library knows whole pixels only, which bend a small circle.
const SVG_SCALE: f64 = 8.0;

type Canvas<'a, DB> = DrawingArea<DB, Shift>;
type Chart<'a, DB> = ChartContext<'a, DB, Cartesian2d<RangedCoordf64, RangedCoordf64>>;
type Drawn<DB> = Result<(), DrawingAreaErrorKind<<DB as DrawingBackend>::ErrorType>>;

pub(super) fn svg(figure: &Figure) -> Result<String, PictureError> {
    fonts();
    let mut text = String::new();
    let drawn = size_px(figure, SVG_SCALE);
    let canvas = SVGBackend::with_string(&mut text, drawn).into_drawing_area();
    draw(&canvas, figure, SVG_SCALE).and_then(|()| canvas.present()).map_err(told)?;
    drop(canvas);
    let size = |(width, height)| format!("width=\"{width}\" height=\"{height}\"");
    Ok(text.replacen(&size(drawn), &size(size_px(figure, 1.0)), 1))
}

pub(super) fn png(figure: &Figure, path: &Path) -> Result<(), PictureError> {
    fonts();
    let canvas = BitMapBackend::new(path, size_px(figure, PNG_SCALE)).into_drawing_area();
    draw(&canvas, figure, PNG_SCALE).and_then(|()| canvas.present()).map_err(told)
}

fn told<E: Error + Send + Sync>(error: DrawingAreaErrorKind<E>) -> PictureError {
    PictureError::Draw(error.to_string())
}

/// The fonts are known to the whole process, once.
fn fonts() {
    static KNOWN: Once = Once::new();
    KNOWN.call_once(|| {
        // Both are fonts: they are part of the program.
        let _ = register_font(FONT, FontStyle::Normal, dejavu::sans::regular());
        let _ = register_font(FONT, FontStyle::Bold, dejavu::sans::bold());
    });
}

fn columns(figure: &Figure) -> usize {
    figure.columns.clamp(1, figure.panels.len().max(1))
}

fn title_px(figure: &Figure) -> f64 {
    if figure.title.is_empty() { 0.0 } else { 2.0 * TITLE_PX }
}

fn size_px(figure: &Figure, scale: f64) -> (u32, u32) {
    let columns = columns(figure);
    let rows = figure.panels.len().div_ceil(columns).max(1);
    let (width, height) = figure.panel_px;
    let all = |count: usize, each: u32| f64::from(each) * count as f64;
    let height = all(rows, height) + title_px(figure);
    ((scale * all(columns, width)) as u32, (scale * height) as u32)
}

fn draw<DB: DrawingBackend>(canvas: &Canvas<DB>, figure: &Figure, scale: f64) -> Drawn<DB> {
    canvas.fill(&WHITE)?;
    let top = (scale * title_px(figure)) as u32;
    let (head, body) = canvas.split_vertically(top);
    if !figure.title.is_empty() {
        let style = (FONT, scale * TITLE_PX).into_font().style(FontStyle::Bold).color(&BLACK);
        let at = ((scale * 2.0 * MARGIN_PX) as i32, (scale * MARGIN_PX) as i32);
        head.draw(&plotters::element::Text::new(figure.title.as_str(), at, style))?;
    }
    let columns = columns(figure);
    let rows = figure.panels.len().div_ceil(columns).max(1);
    for (place, panel) in body.split_evenly((rows, columns)).iter().zip(&figure.panels) {
        draw_panel(place, panel, scale)?;
    }
    Ok(())
}

fn draw_panel<DB: DrawingBackend>(canvas: &Canvas<DB>, panel: &Panel, scale: f64) -> Drawn<DB> {
    let bar = panel.series.iter().find_map(|series| ColourBar::of(&series.marks));
    let (width, height) = canvas.dim_in_pixel();
    let bar_px = if bar.is_some() { (scale * COLOUR_BAR_PX) as u32 } else { 0 };
    let (axes, right) = canvas.split_horizontally(width.saturating_sub(bar_px));
    let caption_px = if panel.title.is_empty() { 0.0 } else { 1.6 * CAPTION_PX };
    let inner = (
        f64::from(width - bar_px) - scale * (2.0 * MARGIN_PX + Y_LABELS_PX),
        f64::from(height) - scale * (2.0 * MARGIN_PX + X_LABELS_PX + caption_px),
    );
    let [x, y] = shown(panel, inner);
    let mut builder = ChartBuilder::on(&axes);
    builder
        .margin((scale * MARGIN_PX) as u32)
        .x_label_area_size((scale * X_LABELS_PX) as u32)
        .y_label_area_size((scale * Y_LABELS_PX) as u32);
    if !panel.title.is_empty() {
        builder.caption(&panel.title, (FONT, scale * CAPTION_PX));
    }
    let mut chart = builder.build_cartesian_2d(x[0]..x[1], y[0]..y[1])?;
    draw_axes(&mut chart, panel, scale)?;
    let mut named = false;
    for series in &panel.series {
        draw_series(&mut chart, panel, series, bar.as_ref(), scale)?;
        named |= series.label.is_some();
    }
    if named {
        draw_legend(&mut chart, panel.legend, scale)?;
    }
    bar.map_or(Ok(()), |bar| bar.draw(&right, scale))
}

fn draw_axes<'a, DB: DrawingBackend + 'a>(
    chart: &mut Chart<'a, DB>,
    panel: &Panel,
    scale: f64,
) -> Drawn<DB> {
    let number = |logarithmic, along: std::ops::Range<f64>| {
        move |value: &f64| tick_label(logarithmic, *value, along.end - along.start)
    };
    let x_number = number(panel.x.logarithmic, chart.x_range());
    let y_number = number(panel.y.logarithmic, chart.y_range());
    chart
        .configure_mesh()
        .x_labels(7)
        .y_labels(7)
        .max_light_lines(0)
        .bold_line_style(BLACK.mix(0.12).stroke_width(scale as u32))
        .axis_style(BLACK.stroke_width(scale as u32))
        .label_style((FONT, scale * LABEL_PX))
        .axis_desc_style((FONT, scale * LABEL_PX))
        .x_desc(panel.x.label.as_str())
        .y_desc(panel.y.label.as_str())
        .x_label_formatter(&x_number)
        .y_label_formatter(&y_number)
        .set_all_tick_mark_size((scale * TICK_PX) as u32)
        .draw()
}

fn draw_legend<'a, DB: DrawingBackend + 'a>(
    chart: &mut Chart<'a, DB>,
    legend: Legend,
    scale: f64,
) -> Drawn<DB> {
    let corner = match legend {
        Legend::UpperRight => SeriesLabelPosition::UpperRight,
        Legend::UpperLeft => SeriesLabelPosition::UpperLeft,
        Legend::LowerRight => SeriesLabelPosition::LowerRight,
        Legend::LowerLeft => SeriesLabelPosition::LowerLeft,
    };
    chart
        .configure_series_labels()
        .position(corner)
        .margin((scale * 6.0) as u32)
        .legend_area_size((scale * 26.0) as u32)
        .background_style(WHITE.mix(0.85))
        .border_style(BLACK.mix(0.3).stroke_width(scale as u32))
        .label_font((FONT, scale * LABEL_PX))
        .draw()
}

fn draw_series<'a, DB: DrawingBackend + 'a>(
    chart: &mut Chart<'a, DB>,
    panel: &Panel,
    series: &Series,
    bar: Option<&ColourBar>,
    scale: f64,
) -> Drawn<DB> {
    let colour = rgb(series.colour);
    let thick = colour.stroke_width((1.6 * scale).round() as u32);
    match &series.marks {
        Marks::Line(points) => {
            let runs = runs(panel, points);
            chart.draw_series(runs.into_iter().map(|run| PathElement::new(run, thick)))?;
        }
        Marks::Dashed(points) => {
            let (dash, gap) = ((6.0 * scale) as u32, (4.0 * scale) as u32);
            for run in runs(panel, points) {
                chart.draw_series(DashedLineSeries::new(run, dash, gap, thick))?;
            }
        }
        Marks::Points(sign, points) => {
            let places = points.iter().filter_map(|point| place(panel, *point));
            chart.draw_series(places.map(|at| sign_at(at, *sign, colour, scale)))?;
        }
        Marks::Arrows(arrows) => {
            for arrow in arrows {
                draw_arrow(chart, panel, arrow, thick, scale)?;
            }
        }
        Marks::Area(points) => {
            let corners: Vec<_> = points.iter().filter_map(|point| place(panel, *point)).collect();
            let closed: Vec<_> = corners.iter().chain(corners.first()).copied().collect();
            chart.draw_series([Polygon::new(corners, colour.mix(0.15))])?;
            chart.draw_series([PathElement::new(closed, thick)])?;
        }
        Marks::Bars(edges, heights) => {
            let foot = chart.y_range().start;
            let bars = edges.windows(2).zip(heights).filter_map(|(edge, height)| {
                // Powers of ten have no zero to stand on: bars begin where the axis does.
                let foot = if panel.y.logarithmic { foot } else { 0.0 };
                let from = (on_axis(&panel.x, edge[0])?, foot);
                let to = place(panel, [edge[1], *height])?;
                Some(Rectangle::new([from, to], colour.mix(0.6).filled()))
            });
            chart.draw_series(bars)?;
        }
        Marks::Cells { cells, .. } => {
            let Some(bar) = bar else { return Ok(()) };
            let drawn = cells.iter().filter_map(|(from, to, value)| {
                let corners = [place(panel, *from)?, place(panel, *to)?];
                Some(Rectangle::new(corners, bar.colour(*value)?.filled()))
            });
            chart.draw_series(drawn)?;
        }
        Marks::Text(words) => {
            let drawn = words.iter().filter_map(|(at, words)| {
                let style = (FONT, scale * LABEL_PX).into_font().color(&colour);
                Some(plotters::element::Text::new(words.clone(), place(panel, *at)?, style))
            });
            chart.draw_series(drawn)?;
        }
    }
    name_series(chart, series, scale)
}

/// An entry of the legend: a series without a point, and the sign that stands for it.
fn name_series<'a, DB: DrawingBackend + 'a>(
    chart: &mut Chart<'a, DB>,
    series: &Series,
    scale: f64,
) -> Drawn<DB> {
    let Some(label) = &series.label else { return Ok(()) };
    let colour = rgb(series.colour);
    let sign = match &series.marks {
        Marks::Points(sign, _) => Some(*sign),
        Marks::Area(_) | Marks::Bars(..) | Marks::Cells { .. } => Some(Sign::Square),
        _ => None,
    };
    let dashed = matches!(series.marks, Marks::Dashed(_));
    let nothing: Vec<PathElement<(f64, f64)>> = Vec::new();
    let entry = chart.draw_series(nothing)?;
    entry.label(label.as_str());
    match sign {
        Some(sign) => {
            entry.legend(move |(x, y)| sign_at((x + (12.0 * scale) as i32, y), sign, colour, scale))
        }
        None => {
            let length = (22.0 * scale) as i32;
            let thick = colour.stroke_width((2.0 * scale) as u32);
            let gap = if dashed { (4.0 * scale) as u32 } else { 0 };
            let dash = (6.0 * scale) as u32;
            entry.legend(move |(x, y)| {
                let line = vec![(x, y), (x + length, y)];
                DashedPathElement::new(line, dash, gap, thick)
            })
        }
    };
    Ok(())
}

/// Stretches of points without a gap.
fn runs(panel: &Panel, points: &[[f64; 2]]) -> Vec<Vec<(f64, f64)>> {
    let places: Vec<_> = points.iter().map(|point| place(panel, *point)).collect();
    let runs = places.split(Option::is_none).map(|run| run.iter().flatten().copied().collect());
    runs.filter(|run: &Vec<_>| run.len() > 1).collect()
}

fn sign_at<C>(at: C, sign: Sign, colour: RGBColor, scale: f64) -> SignAt<C> {
    SignAt { at, sign, colour, half_px: 3.0 * scale }
}

/// A line with a head whose size does not depend on the axes.
fn draw_arrow<'a, DB: DrawingBackend + 'a>(
    chart: &mut Chart<'a, DB>,
    panel: &Panel,
    [from, to]: &[[f64; 2]; 2],
    pen: ShapeStyle,
    scale: f64,
) -> Drawn<DB> {
    let (Some(from), Some(to)) = (place(panel, *from), place(panel, *to)) else { return Ok(()) };
    chart.draw_series([PathElement::new(vec![from, to], pen)])?;
    let (a, b) = (chart.backend_coord(&from), chart.backend_coord(&to));
    let along = (f64::from(b.0 - a.0), f64::from(b.1 - a.1));
    let length = along.0.hypot(along.1);
    if length < 1.0 {
        return Ok(());
    }
    let (back, aside) = (7.0 * scale / length, 3.0 * scale / length);
    let corner = |side: f64| {
        let x = -back * along.0 - side * aside * along.1;
        let y = -back * along.1 + side * aside * along.0;
        (x.round() as i32, y.round() as i32)
    };
    let head = Polygon::new(vec![(0, 0), corner(1.0), corner(-1.0)], pen.color);
    chart.draw_series([EmptyElement::at(to) + head])?;
    Ok(())
}

/// The colours of a map's values.
struct ColourBar<'a> {
    label: &'a str,
    range: [f64; 2],
    logarithmic: bool,
}

impl<'a> ColourBar<'a> {
    fn of(marks: &'a Marks) -> Option<Self> {
        let Marks::Cells { cells, label, range, logarithmic } = marks else { return None };
        let on = |value: &f64| scaled(*logarithmic, *value);
        let values = || cells.iter().filter_map(|(_, _, value)| on(value));
        let all =
            [values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max)];
        let asked = range.and_then(|[least, most]| Some([on(&least)?, on(&most)?]));
        let range = asked.unwrap_or(all);
        let range = if range[0] < range[1] { range } else { [0.0, 1.0] };
        Some(Self { label, range, logarithmic: *logarithmic })
    }

    fn colour(&self, value: f64) -> Option<RGBColor> {
        let value = scaled(self.logarithmic, value)?;
        let [least, most] = self.range;
        Some(ViridisRGB.get_color_normalized(value.clamp(least, most), least, most))
    }

    fn draw<DB: DrawingBackend>(&self, canvas: &Canvas<DB>, scale: f64) -> Drawn<DB> {
        const STEPS: u32 = 64;
        let axis = super::Axis { logarithmic: false, ..super::Axis::default() };
        let [least, most] = self.range;
        let mut chart = ChartBuilder::on(canvas)
            .margin_top((scale * 2.6 * CAPTION_PX) as u32)
            .margin_bottom((scale * (MARGIN_PX + X_LABELS_PX)) as u32)
            .margin_right((scale * 8.0) as u32)
            .y_label_area_size((scale * Y_LABELS_PX) as u32)
            .build_cartesian_2d(0.0..1.0, least..most)?;
        let number = |value: &f64| tick_label(self.logarithmic, *value, most - least);
        chart
            .configure_mesh()
            .disable_mesh()
            .disable_x_axis()
            .y_labels(7)
            .label_style((FONT, scale * LABEL_PX))
            .axis_desc_style((FONT, scale * LABEL_PX))
            .y_desc(self.label)
            .y_label_formatter(&number)
            .draw()?;
        let step = (most - least) / f64::from(STEPS);
        let boxes = (0..STEPS).filter_map(|k| {
            let from = on_axis(&axis, least + step * f64::from(k))?;
            let colour = ViridisRGB.get_color_normalized(from + 0.5 * step, least, most);
            Some(Rectangle::new([(0.0, from), (1.0, from + step)], colour.filled()))
        });
        chart.draw_series(boxes)?;
        Ok(())
    }
}

fn rgb(colour: Colour) -> RGBColor {
    match colour {
        Colour::Black => RGBColor(0, 0, 0),
        Colour::Orange => RGBColor(230, 159, 0),
        Colour::SkyBlue => RGBColor(86, 180, 233),
        Colour::Green => RGBColor(0, 158, 115),
        Colour::Yellow => RGBColor(240, 228, 66),
        Colour::Blue => RGBColor(0, 114, 178),
        Colour::Vermilion => RGBColor(213, 94, 0),
        Colour::Purple => RGBColor(204, 121, 167),
        Colour::Grey => RGBColor(110, 110, 110),
        Colour::LightGrey => RGBColor(200, 200, 200),
    }
}

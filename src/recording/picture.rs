//! A comparison as one SVG picture: the way in the plane, and for each run forces, angle, region.
//!
//! ```text
//! ┌───────────┐ ┌ recorded ─────────────────┐
//! │ way, with │ │ forces                    │
//! │ surfaces  │ │ approximation angle       │
//! │           │ │ region, as a strip        │
//! └───────────┘ └ ... and so for each run ──┘
//! ```
//!
//! Surfaces are drawn where their distance changes its sign, so that any shape can be. Forces
//! are drawn as the least and the greatest of each column of pixels: a spike of one tick is
//! seen. Written by hand: it is a few hundred lines of polylines.

use std::fmt::Write;

use nalgebra::{Vector2, Vector3};

use super::compare::{Comparison, Run};
use super::measures::Moment;
use crate::control::Plan;
use crate::environment::{Element, Shape};
use crate::proto::Region;

const WIDTH: f64 = 1500.0;
const MARGIN: f64 = 30.0;
/// Side of the square of the way.
const WAY: f64 = 520.0;
const LEFT: f64 = MARGIN + WAY + 90.0;
const FORCE_HEIGHT: f64 = 130.0;
const ANGLE_HEIGHT: f64 = 60.0;
const STRIP_HEIGHT: f64 = 12.0;
const ROW: f64 = 290.0;
const TOP: f64 = 50.0;

/// Cells on a side, where surfaces are looked for.
const CELLS: usize = 160;

/// Distinct for people who see colours in another way too (Okabe and Ito).
const COLOURS: [&str; 3] = ["#000000", "#0072b2", "#d55e00"];
const ASKED: &str = "#cccccc";
const HAND: &str = "#009e73";

/// The picture.
pub fn draw(comparison: &Comparison) -> String {
    let rows = comparison.runs.len() as f64;
    let height = (TOP + rows * ROW + 20.0).max(TOP + WAY + 150.0);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" height=\"{height}\" font-family=\"sans-serif\" font-size=\"13\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
    );
    text(
        &mut svg,
        (MARGIN, 26.0),
        "start",
        &format!("{}: the same hand under two laws", comparison.device),
        18,
    );
    draw_way(&mut svg, comparison);
    let scale = Scale::of(comparison);
    for (i, run) in comparison.runs.iter().enumerate() {
        draw_run(&mut svg, run, TOP + i as f64 * ROW, &scale, COLOURS[i % COLOURS.len()]);
    }
    svg.push_str("</svg>\n");
    svg
}

fn text(svg: &mut String, (x, y): (f64, f64), anchor: &str, words: &str, size: u32) {
    let words = words.replace('&', "&amp;").replace('<', "&lt;");
    // Writing into a String cannot fail.
    let _ = writeln!(
        svg,
        "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" font-size=\"{size}\">{words}</text>"
    );
}

fn line(svg: &mut String, points: &[(f64, f64)], colour: &str, width: f64, more: &str) {
    if points.len() < 2 {
        return;
    }
    let list: String = points.iter().map(|(x, y)| format!("{x:.1},{y:.1} ")).collect();
    let _ = writeln!(
        svg,
        "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\" {more}/>",
        list.trim_end()
    );
}

fn frame(svg: &mut String, (x, y): (f64, f64), (width, height): (f64, f64)) {
    let _ = writeln!(
        svg,
        "<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" fill=\"none\" stroke=\"#444\"/>"
    );
}

/// 1, 2 or 5 times a power of ten, about a fifth of `range`.
fn nice(range: f64) -> f64 {
    let rough = (range / 5.0).max(1e-9);
    let power = 10_f64.powf(rough.log10().floor());
    let best = [1.0, 2.0, 5.0, 10.0].into_iter().find(|step| step * power >= rough);
    best.unwrap_or(10.0) * power
}

/// Multiples of a nice step within a range.
fn marks(low: f64, high: f64) -> impl Iterator<Item = f64> {
    let step = nice(high - low);
    let first = (low / step).ceil();
    (0..64).map(move |i| (first + f64::from(i)) * step).take_while(move |mark| *mark <= high + 1e-9)
}

/// The view of the plane: a square around all ways.
struct View {
    low_m: Vector2<f64>,
    side_m: f64,
}

impl View {
    fn of(comparison: &Comparison) -> Self {
        let (low, high) = comparison.extent_m();
        if !(high - low).iter().all(|side| side.is_finite()) {
            return Self { low_m: Vector2::repeat(-0.5), side_m: 1.0 };
        }
        let side_m = (high - low).amax().max(1e-3) * 1.2;
        Self { low_m: (low + high) / 2.0 - Vector2::repeat(side_m / 2.0), side_m }
    }

    fn pixel(&self, p_m: &Vector2<f64>) -> (f64, f64) {
        let at = (p_m - self.low_m) / self.side_m * WAY;
        (MARGIN + 20.0 + at.x, TOP + WAY - at.y)
    }
}

fn draw_way(svg: &mut String, comparison: &Comparison) {
    let view = View::of(comparison);
    let (left, bottom) = (MARGIN + 20.0, TOP + WAY);
    let _ = writeln!(
        svg,
        "<clipPath id=\"way\"><rect x=\"{left}\" y=\"{TOP}\" width=\"{WAY}\" height=\"{WAY}\"/></clipPath>"
    );
    for shape in shapes(comparison) {
        draw_surface(svg, &view, &comparison.plan, &shape);
    }
    frame(svg, (left, TOP), (WAY, WAY));
    for mark in marks(view.low_m.x, view.low_m.x + view.side_m) {
        let (x, _) = view.pixel(&Vector2::new(mark, 0.0));
        line(svg, &[(x, bottom), (x, bottom + 5.0)], "#444", 1.0, "");
        text(svg, (x, bottom + 19.0), "middle", &format!("{:.0}", 1e3 * mark), 12);
    }
    for mark in marks(view.low_m.y, view.low_m.y + view.side_m) {
        let (_, y) = view.pixel(&Vector2::new(0.0, mark));
        line(svg, &[(left - 5.0, y), (left, y)], "#444", 1.0, "");
        text(svg, (left - 8.0, y + 4.0), "end", &format!("{:.0}", 1e3 * mark), 12);
    }
    text(
        svg,
        (left + WAY / 2.0, bottom + 38.0),
        "middle",
        "way of the tool in the device's plane, mm; surfaces shaded",
        13,
    );
    for (i, run) in comparison.runs.iter().enumerate() {
        let colour = COLOURS[i % COLOURS.len()];
        // Each thinner than the one below it, so that all are seen where they coincide.
        let width = 5.0 - 1.8 * i as f64;
        line(
            svg,
            &way(&view, &run.moments),
            colour,
            width,
            "clip-path=\"url(#way)\" stroke-opacity=\"0.8\" stroke-linejoin=\"round\"",
        );
        let y = bottom + 64.0 + 20.0 * i as f64;
        line(svg, &[(left, y - 4.0), (left + 30.0, y - 4.0)], colour, width, "");
        text(svg, (left + 38.0, y), "start", &run.name, 13);
    }
}

/// The way without steps too short to be seen.
fn way(view: &View, moments: &[Moment]) -> Vec<(f64, f64)> {
    let mut points: Vec<(f64, f64)> = Vec::new();
    for point in moments.iter().map(|moment| view.pixel(&moment.p_m)) {
        let far = |last: &(f64, f64)| (last.0 - point.0).hypot(last.1 - point.1) > 0.4;
        if points.last().is_none_or(far) {
            points.push(point);
        }
    }
    points
}

fn shapes(comparison: &Comparison) -> Vec<Shape> {
    let scene = comparison.plan.scene.iter().filter_map(|item| match &item.element {
        Element::Surface(surface) => Some(surface.shape),
        _ => None,
    });
    let contacts = comparison.setpoint.iter().flat_map(|setpoint| setpoint.contacts());
    scene.chain(contacts.map(|contact| contact.surface.shape)).collect()
}

/// Shades the cells whose middles are inside, row by row.
fn draw_surface(svg: &mut String, view: &View, plan: &Plan, shape: &Shape) {
    let cell_m = view.side_m / CELLS as f64;
    let inside = |column: usize, row: usize| {
        let at = Vector2::new(column as f64 + 0.5, row as f64 + 0.5) * cell_m + view.low_m;
        let offset_B_m = plan.tool.offset_B_m;
        let in_B = Vector3::new(at.x, at.y, offset_B_m.z);
        shape.nearest(&(plan.mount.p_WB_m + plan.mount.q_WB * in_B)).distance_m < 0.0
    };
    let cell = WAY / CELLS as f64;
    let mut path = String::new();
    for row in 0..CELLS {
        let mut column = 0;
        while column < CELLS {
            let begin = column;
            while column < CELLS && inside(column, row) {
                column += 1;
            }
            if column > begin {
                let corner = Vector2::new(begin as f64, row as f64 + 1.0) * cell_m + view.low_m;
                let ((x, y), width) = (view.pixel(&corner), cell * (column - begin) as f64);
                let _ = write!(path, "M{x:.1} {y:.1}h{width:.1}v{cell:.2}h-{width:.1}z");
            }
            column += 1;
        }
    }
    let _ = writeln!(svg, "<path d=\"{path}\" fill=\"#e6dfc8\"/>");
}

/// Axes that all runs share.
struct Scale {
    seconds: f64,
    newtons: f64,
    degrees: f64,
}

impl Scale {
    fn of(comparison: &Comparison) -> Self {
        let all = || comparison.runs.iter().flat_map(|run| &run.moments);
        let most = |read: fn(&Moment) -> f64| all().map(read).fold(0.0, f64::max);
        let hand_N = most(|moment| moment.hand_N.map_or(0.0, |force_N| force_N.norm()));
        // A wall asks for hundreds of newtons; what matters is of the size of the hand's.
        let chosen_N = most(|moment| moment.given_N.norm());
        let degrees = most(|moment| moment.angle_rad.unwrap_or(0.0)).to_degrees();
        let newtons = if hand_N > 0.0 { chosen_N.min(4.0 * hand_N).max(hand_N) } else { chosen_N };
        Self {
            seconds: most(|moment| moment.time_s).max(1e-3),
            newtons: 1.05 * newtons.max(1.0),
            degrees: degrees.clamp(10.0, 180.0),
        }
    }

    fn x(&self, time_s: f64) -> f64 {
        LEFT + time_s / self.seconds * (WIDTH - LEFT - MARGIN)
    }
}

fn draw_run(svg: &mut String, run: &Run, top: f64, scale: &Scale, colour: &str) {
    let forces = top + 22.0;
    text(svg, (LEFT, top + 14.0), "start", &run.name, 15);
    let legend = [
        ("asked (at the top: more)", ASKED),
        ("chosen by the law", colour),
        ("hand, measured", HAND),
    ];
    for (i, (name, colour)) in legend.into_iter().enumerate() {
        let x = WIDTH - MARGIN - 500.0 + 185.0 * i as f64;
        line(svg, &[(x, top + 10.0), (x + 18.0, top + 10.0)], colour, 3.0, "");
        text(svg, (x + 23.0, top + 14.0), "start", name, 12);
    }
    let force = |read: fn(&Moment) -> Option<f64>| Chart {
        top: forces,
        height: FORCE_HEIGHT,
        most: scale.newtons,
        read,
    };
    force(|moment| Some(moment.asked_N.norm())).draw(svg, run, scale, ASKED, 1.0);
    force(|moment| Some(moment.given_N.norm())).draw(svg, run, scale, colour, 1.3);
    force(|moment| Some(moment.hand_N?.norm())).draw(svg, run, scale, HAND, 1.3);
    axis(svg, forces, FORCE_HEIGHT, scale.newtons, "force, N");
    let angles = forces + FORCE_HEIGHT + 12.0;
    let angle = Chart {
        top: angles,
        height: ANGLE_HEIGHT,
        most: scale.degrees,
        read: |moment| Some(moment.angle_rad?.to_degrees()),
    };
    angle.draw(svg, run, scale, colour, 1.0);
    axis(svg, angles, ANGLE_HEIGHT, scale.degrees, "angle, deg");
    draw_strip(svg, run, angles + ANGLE_HEIGHT + 4.0, scale);
}

fn axis(svg: &mut String, top: f64, height: f64, most: f64, name: &str) {
    frame(svg, (LEFT, top), (WIDTH - LEFT - MARGIN, height));
    let few = if height < 100.0 { 2.0 } else { 1.0 };
    for mark in marks(0.0, most * few).filter(|mark| *mark <= most) {
        let y = top + height - mark / most * height;
        line(svg, &[(LEFT - 4.0, y), (LEFT, y)], "#444", 1.0, "");
        text(svg, (LEFT - 7.0, y + 4.0), "end", &format!("{}", (mark * 1e3).round() / 1e3), 11);
    }
    let (x, y) = (LEFT - 42.0, top + height / 2.0);
    let _ = writeln!(
        svg,
        "<text transform=\"translate({x:.1},{y:.1}) rotate(-90)\" text-anchor=\"middle\" font-size=\"12\">{name}</text>"
    );
}

/// A number over time.
struct Chart {
    top: f64,
    height: f64,
    most: f64,
    read: fn(&Moment) -> Option<f64>,
}

impl Chart {
    /// The least and the greatest of each column of pixels, broken where there is none.
    fn draw(&self, svg: &mut String, run: &Run, scale: &Scale, colour: &str, width: f64) {
        let y = |value: f64| self.top + self.height * (1.0 - (value / self.most).clamp(0.0, 1.0));
        let mut points = Vec::new();
        let mut column: Option<(f64, f64, f64)> = None;
        for moment in &run.moments {
            let x = scale.x(moment.time_s).round();
            let value = (self.read)(moment);
            column = match (column, value) {
                (Some((at, low, high)), Some(value)) if at == x => {
                    Some((at, low.min(value), high.max(value)))
                }
                (before, value) => {
                    flush(&mut points, before, y);
                    if value.is_none() {
                        line(svg, &points, colour, width, "");
                        points.clear();
                    }
                    value.map(|value| (x, value, value))
                }
            };
        }
        flush(&mut points, column, y);
        line(svg, &points, colour, width, "");
    }
}

fn flush(points: &mut Vec<(f64, f64)>, column: Option<(f64, f64, f64)>, y: impl Fn(f64) -> f64) {
    if let Some((x, low, high)) = column {
        points.extend([(x, y(low)), (x, y(high))]);
    }
}

fn colour_of(region: Region) -> Option<(&'static str, &'static str)> {
    match region {
        Region::Unspecified => None,
        Region::Full => Some(("#009e73", "full")),
        Region::Approximate => Some(("#f0c440", "approximate")),
        Region::NotDisplayable => Some(("#cc3311", "not displayable")),
    }
}

fn draw_strip(svg: &mut String, run: &Run, top: f64, scale: &Scale) {
    let mut begin = 0;
    for end in 1..=run.moments.len() {
        let region = run.moments[begin].region;
        if run.moments.get(end).is_some_and(|moment| moment.region == region) {
            continue;
        }
        if let Some((colour, _)) = colour_of(region) {
            let from = scale.x(run.moments[begin].time_s);
            let to = scale.x(run.moments[end.min(run.moments.len() - 1)].time_s);
            let width = (to - from).max(0.3);
            let _ = writeln!(
                svg,
                "<rect x=\"{from:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{STRIP_HEIGHT}\" fill=\"{colour}\"/>"
            );
        }
        begin = end;
    }
    text(svg, (LEFT - 7.0, top + 10.0), "end", "region", 12);
    for mark in marks(0.0, scale.seconds) {
        let seconds = format!("{}", (mark * 1e3).round() / 1e3);
        text(svg, (scale.x(mark), top + STRIP_HEIGHT + 14.0), "middle", &seconds, 11);
    }
    let mut x = WIDTH - MARGIN - 330.0;
    let below = top + STRIP_HEIGHT + 27.0;
    text(svg, (LEFT, below + 1.0), "start", "time, s", 11);
    for region in [Region::Full, Region::Approximate, Region::NotDisplayable] {
        let Some((colour, name)) = colour_of(region) else { continue };
        let y = below - 9.0;
        let _ = writeln!(
            svg,
            "<rect x=\"{x}\" y=\"{y}\" width=\"12\" height=\"10\" fill=\"{colour}\"/>"
        );
        text(svg, (x + 17.0, below), "start", name, 11);
        x += 110.0;
    }
}

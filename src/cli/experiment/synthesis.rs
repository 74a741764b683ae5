//! `hapticd experiment synthesis`: Singh, Saha & Manivannan done again.
//!
//! Table 1 under one stated grid and under finer ones, the five conditions, and the Figures:
//! 2 and 3 (singularities), 5 (map of classes), 6 and 7 (the search), 8 and 9 (ellipses).
//! Lengths in centimetres, as the paper has them.

use std::f64::consts::PI;
use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::report::Report;
use crate::analysis::design::local::{ForceEllipse, ellipse};
use crate::analysis::design::symmetric::{Candidate, CountGrid, Lengths, Reach, search, table_1};
use crate::analysis::papers::singh::{OPTIMUM, Winner, best_by_share, finest_by_share, winners};
use crate::cli::design::{GAP, circle_panel, class_series, ellipse_outline};
use crate::mechanism::{Mechanism, SymmetricFiveBar};
use crate::notation::PlaneVector;
use crate::plot::{Axis, Colour, Figure, Legend, Marks, Panel, Series, Sign};

const M_PER_CM: f64 = 0.01;

/// Singh, Saha & Manivannan: the search of Table 1, its conditions, maps and ellipses
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd experiment synthesis --out synthesis
  hapticd experiment synthesis --out synthesis --json")]
pub struct Synthesis {
    /// Folder for report.md and the pictures
    #[arg(long, value_name = "DIR", default_value = "synthesis")]
    out: PathBuf,
    /// Print the figures as one JSON object, and nothing else, on stdout
    #[arg(long)]
    json: bool,
}

impl Synthesis {
    /// Counts, draws, and writes the report.
    pub fn run(self) -> anyhow::Result<()> {
        let mut report = Report::begin(
            &self.out,
            "Synthesis of the symmetric five-bar (Singh, Saha and Manivannan)",
        )?;
        let found = search(&table_1(), &CountGrid::STATED);
        let linkage = OPTIMUM.linkage(M_PER_CM)?;
        singularities(&mut report)?;
        conditions(&mut report);
        map_of_classes(&mut report)?;
        searches(&mut report, &found)?;
        circle(&mut report, &linkage);
        ellipses(&mut report, &linkage)?;
        let path = report.finish()?;
        if self.json {
            let Candidate { lengths, counts } = found[0];
            say!(
                "{}",
                json!({ "report": path.display().to_string(),
                "optimum_cm": [lengths.a1, lengths.a2, lengths.a3],
                "points_above_5": counts.above_5(), "grid": CountGrid::STATED.to_string() })
            );
        } else {
            say!("{}", path.display());
        }
        Ok(())
    }
}

pub(super) fn axes(title: &str) -> Panel {
    Panel {
        title: title.into(),
        x: Axis::new("x [cm]"),
        y: Axis::new("y [cm]"),
        equal: true,
        ..Panel::default()
    }
}

fn round(centre: [f64; 2], radius: f64) -> Vec<[f64; 2]> {
    let point = |k: i32| {
        let (sin, cos) = (f64::from(k) * PI / 90.0).sin_cos();
        [centre[0] + radius * cos, centre[1] + radius * sin]
    };
    (0..=180).map(point).collect()
}

/// Base, driven links, distal links as one line with its joints.
pub(super) fn chain(joints: [[f64; 2]; 5]) -> [Series; 2] {
    [
        Series::new("linkage", Colour::Black, Marks::Line(joints.to_vec())),
        Series::unnamed(Colour::Black, Marks::Points(Sign::Circle, joints.to_vec())),
    ]
}

fn singularities(report: &mut Report) -> anyhow::Result<()> {
    report.heading("Singularities (Figures 2 and 3)");
    report.picture(
        "figure-2",
        "Eq 6 to 9: the circles on which a leg is stretched or folded; the workspace lies between.",
        &borders_picture(),
    )?;
    report.picture(
        "figure-3",
        "Direct kinematic singularities: the locked actuators do not hold the handle.",
        &direct_picture(),
    )
}

/// Figure 2: the circles on which a leg is stretched or folded.
pub(super) fn borders_picture() -> Figure {
    let Lengths { a1, a2, a3 } = OPTIMUM;
    let mut borders = axes("Boundary singularities of (10, 15, 3)");
    for (side, name, colour) in [(-1.0, "O1", Colour::Blue), (1.0, "O2", Colour::Vermilion)] {
        let base = [side * a3, 0.0];
        let both = round(base, a1 + a2).into_iter().chain([GAP]).chain(round(base, a2 - a1));
        let label = format!("leg on {name} stretched or folded");
        borders.series.push(Series::new(label, colour, Marks::Line(both.collect())));
        borders.series.push(Series::unnamed(colour, Marks::Points(Sign::Dot, vec![base])));
    }
    borders.legend = Legend::LowerLeft;
    borders.y = Axis::between("y [cm]", -36.0, 28.0);
    Figure { panel_px: (620, 600), ..Figure::single(borders) }
}

/// Figure 3: B1 and B2 meet, and B1, C, B2 in line.
pub(super) fn direct_picture() -> Figure {
    let Lengths { a1, a2, a3 } = OPTIMUM;
    let height = (a1 * a1 - a3 * a3).sqrt();
    let meeting = [0.0, height];
    let handle = [a2 * 0.5, height + a2 * 0.75_f64.sqrt()];
    let mut together = axes("(a) B1 and B2 meet: (10, 15, 3)");
    together.series.push(Series::new(
        "where C may go",
        Colour::SkyBlue,
        Marks::Dashed(round(meeting, a2)),
    ));
    together.series.extend(chain([[-a3, 0.0], meeting, handle, meeting, [a3, 0.0]]));
    // A design that breaks condition (b): distal links in line across the axis.
    let level = (9.0_f64 * 9.0 - 8.0 * 8.0).sqrt();
    let mut in_line = axes("(b) B1, C, B2 in line: (9, 11, 3)");
    in_line.series.extend(chain([
        [-3.0, 0.0],
        [-11.0, level],
        [0.0, level],
        [11.0, level],
        [3.0, 0.0],
    ]));
    in_line.series.push(Series::new(
        "C is free this way",
        Colour::Vermilion,
        Marks::Arrows(vec![[[0.0, level], [0.0, level + 3.0]], [[0.0, level], [0.0, level - 3.0]]]),
    ));
    for panel in [&mut together, &mut in_line] {
        panel.legend = Legend::LowerRight;
    }
    Figure {
        columns: 2,
        panel_px: (460, 440),
        panels: vec![together, in_line],
        title: String::new(),
    }
}

fn conditions(report: &mut Report) {
    report.heading("Conditions (a) to (e)");
    let met = OPTIMUM.conditions();
    let all = table_1();
    let count = |f: fn(&Lengths) -> bool| all.iter().filter(|lengths| f(lengths)).count();
    let rows: [(&str, bool, usize, &str); 5] = [
        ("(a) r3 > r1", met.a, count(|l| l.conditions().a), "keeps B1 and B2 apart"),
        ("(b) r2 > r1 + r3", met.b, count(|l| l.conditions().b), "keeps B1, C, B2 out of line"),
        (
            "(c) r3 < r1 + r2",
            met.c,
            count(|l| l.conditions().c),
            "keeps the whole chain out of line",
        ),
        ("(d) r2 != r3", met.d, count(|l| l.conditions().d), "combined singularity"),
        (
            "(e) r1 + r2 + r3 = 3, each in its range",
            met.e,
            count(|l| l.conditions().e),
            "by normalisation",
        ),
    ];
    let rows = rows.map(|(name, met, count, what)| {
        let met = if met { "met" } else { "**not met**" };
        vec![name.to_owned(), what.to_owned(), met.to_owned(), format!("{count} of {}", all.len())]
    });
    report.table(
        &["condition", "what it is for", "(10, 15, 3)", "designs of Table 1 that meet it"],
        &rows,
    );
    let [r1, r2, r3] = OPTIMUM.normalised();
    report.say(&format!(
        "The published optimum has r1 = {r1:.3}, r2 = {r2:.3}, r3 = {r3:.3}: it breaks condition \
         (a), and so does every design of Table 1, whose half base is at most 5 cm and whose \
         driven links are at least 9 cm. B1 and B2 can meet (Figure 3 a); in the working mode \
         used here (elbows outward) no place of the grid is there."
    ));
}

/// Places of a grid with their condition numbers.
fn conditioned(lengths: &Lengths, grid: &CountGrid) -> Vec<([f64; 2], f64)> {
    let places = grid.places(lengths).into_iter();
    let inside = places.filter_map(|at| match lengths.reach(at) {
        Reach::Interior { condition } => Some((at, condition)),
        Reach::Edge => Some((at, f64::INFINITY)),
        Reach::Beyond => None,
    });
    inside.collect()
}

fn upper_half() -> Vec<([f64; 2], f64)> {
    conditioned(&OPTIMUM, &CountGrid::Arcs { step: 1.0, rays: 73, span_rad: PI })
}

/// Figure 5: the classes of the condition number.
pub(super) fn classes_picture() -> Figure {
    let mut panel = axes("Condition number over the upper half of the workspace, (10, 15, 3)");
    panel.series = class_series(&upper_half());
    panel.y = Axis::between("y [cm]", -1.5, 34.0);
    Figure { panel_px: (820, 620), ..Figure::single(panel) }
}

fn map_of_classes(report: &mut Report) -> anyhow::Result<()> {
    report.heading("Map of the condition number (Figure 5)");
    let places = upper_half();
    report.picture(
        "figure-5",
        "The four classes of the condition number, with the paper's signs.",
        &classes_picture(),
    )?;
    let mean = 28.0 / 3.0;
    let within = |(at, _): &&([f64; 2], f64)| (0.9..=1.7).contains(&(at[0].hypot(at[1]) / mean));
    let inside: Vec<_> = places.iter().filter(within).collect();
    let good = inside.iter().filter(|(_, K)| *K < 5.0).count();
    report.say(&format!(
        "The paper calls the annulus of 0.9 to 1.7 mean lengths its dexterous workspace (there \
         for unstated lengths): of the {} places of this map in it, {good} have K < 5 ({:.1} %).",
        inside.len(),
        100.0 * good as f64 / inside.len() as f64
    ));
    Ok(())
}

fn searches(report: &mut Report, found: &[Candidate]) -> anyhow::Result<()> {
    report.heading("The search (Table 1, Figures 6 and 7)");
    report.say(&format!(
        "Measure: interior places with K of 5 or more, fewest first. Grid: {}; the first ray is \
         counted twice, as 0 and 360 deg. Among equals the larger inscribed circle wins.",
        CountGrid::STATED
    ));
    let row = |one: &Candidate| {
        let Lengths { a1, a2, a3 } = one.lengths;
        vec![
            format!("({a1}, {a2}, {a3})"),
            one.counts.above_5().to_string(),
            one.counts.interior().to_string(),
            format!("{}", one.lengths.inscribed_radius()),
        ]
    };
    report.table(
        &[
            "(a1, a2, a3) [cm]",
            "places with K >= 5",
            "interior places",
            "radius of the inscribed circle [cm]",
        ],
        &found.iter().take(6).map(row).collect::<Vec<_>>(),
    );
    let best = found[0];
    report.say(&format!(
        "The paper's optimum {} the minimum of this grid. The paper's Figure 7 has (9, 14, 3) \
         as its equal, which here has two places more.",
        if best.lengths == OPTIMUM { "is" } else { "is not" }
    ));
    report.picture(
        "figure-6-7",
        "Left: Figure 6. Right: Figure 7, by the size of the workspace.",
        &search_picture(found),
    )?;
    finer(report);
    Ok(())
}

/// Figures 6 and 7: every design, by its base and by its inscribed circle.
pub(super) fn search_picture(found: &[Candidate]) -> Figure {
    let panels = vec![base_panel(found), circle_panel(found)];
    Figure { columns: 2, panel_px: (480, 400), panels, title: String::new() }
}

/// Every design over its half base.
fn base_panel(found: &[Candidate]) -> Panel {
    let base = |a3: f64| found.iter().filter(move |one| one.lengths.a3 == a3);
    let mut bases = Panel {
        title: "Badly conditioned places by half base".into(),
        x: Axis::between("a3, half of the base [cm]", 2.5, 5.5),
        y: Axis::new("interior places with K >= 5"),
        legend: Legend::UpperRight,
        ..Panel::default()
    };
    let all: Vec<_> =
        found.iter().map(|one| [one.lengths.a3, one.counts.above_5() as f64]).collect();
    let mean = |a3: f64| {
        base(a3).map(|one| one.counts.above_5() as f64).sum::<f64>() / base(a3).count() as f64
    };
    bases.series.push(Series::new("one design", Colour::Blue, Marks::Points(Sign::Circle, all)));
    let means = [3.0, 4.0, 5.0].map(|a3| [a3, mean(a3)]).to_vec();
    bases.series.push(Series::new("mean of 20 designs", Colour::Vermilion, Marks::Line(means)));
    bases
}

fn finer(report: &mut Report) {
    report.say("The winner is one of this grid. The same search on others:");
    let rows = winners().into_iter().map(|one| {
        let Lengths { a1, a2, a3 } = one.best.lengths;
        vec![
            one.grid.clone(),
            format!("({a1}, {a2}, {a3})"),
            one.best.counts.above_5().to_string(),
            format!("{:.1} %", Winner::percent(&one.best)),
            format!(
                "{} of 60, {} places, {:.1} %",
                one.rank,
                one.published.counts.above_5(),
                Winner::percent(&one.published)
            ),
        ]
    });
    report.table(
        &["grid", "winner", "places with K >= 5", "share", "(10, 15, 3)"],
        &rows.collect::<Vec<_>>(),
    );
    let (by_share, percent) = best_by_share(&table_1());
    let (finest, fine_percent) = finest_by_share();
    report.say(&format!(
        "A count of places favours small workspaces. By the *share* of the workspace with K >= 5 \
         (arcs every 0.5 cm, 145 rays) the best of Table 1 is ({}, {}, {}) with {percent:.1} %, \
         and with half centimetres ({}, {}, {}) with {fine_percent:.1} %.",
        by_share.a1, by_share.a2, by_share.a3, finest.a1, finest.a2, finest.a3
    ));
}

fn circle(report: &mut Report, linkage: &SymmetricFiveBar) {
    report.heading("The inscribed circle");
    let circle = linkage.inscribed_circle();
    let cm = |m: Option<f64>| m.map_or("-".into(), |m| format!("{:.2} cm", m / M_PER_CM));
    report.say(&format!(
        "Radius {:.2} cm. Its centre must be max(a1, a2) from both pivots, {} above the base; \
         the formula as printed gives {}, where the circle would cross the inner border.",
        circle.radius_m / M_PER_CM,
        cm(circle.y_m),
        cm(circle.y_as_printed_m)
    ));
}

fn axis_condition(y: f64) -> Option<f64> {
    match OPTIMUM.reach([0.0, y]) {
        Reach::Interior { condition } => Some(condition),
        _ => None,
    }
}

fn ellipse_at(linkage: &SymmetricFiveBar, at: [f64; 2]) -> Option<ForceEllipse> {
    let place = PlaneVector::new(M_PER_CM * at[0], M_PER_CM * at[1], 0.0);
    Some(ellipse(&linkage.posture_at(&place).ok()?.reference, 2))
}

fn ellipses(report: &mut Report, linkage: &SymmetricFiveBar) -> anyhow::Result<()> {
    report.heading("Ellipses (Figures 8 and 9)");
    let rows: Vec<_> = [3.0, 5.0, 7.0, 7.5, 8.0, 10.0, 12.0, 14.0, 16.0, 18.0, 20.0, 22.0, 24.0]
        .iter()
        .map(|&y| match (axis_condition(y), axis_condition(18.0)) {
            (Some(K), Some(at_18)) => {
                vec![format!("{y}"), format!("{K:.3}"), format!("{:.2}", K / at_18)]
            }
            _ => vec![format!("{y}"), "beyond reach".into(), "-".into()],
        })
        .collect();
    report.table(&["y on the axis [cm]", "K", "K / K(y = 18)"], &rows);
    report.say(
        "\"The condition number at y = 3 is 1.5 times that at y = 18\": (0, 3) cannot be \
         reached, because folded legs still span 5 cm from each pivot, which is 4 cm up the \
         axis. From there the ratio rises to 1.60 at y = 7.5 and falls through 1.50 at y = 10.",
    );
    report.picture(
        "figure-8-9",
        "Forces at the handle whose torques have a norm of 1 N m (f = J^T tau, as Eq 10 must \
         read).",
        &ellipses_picture(linkage),
    )
}

/// Figures 8 and 9: force ellipses on the axis and over the workspace.
pub(super) fn ellipses_picture(linkage: &SymmetricFiveBar) -> Figure {
    let panels = vec![shapes_on_axis(linkage), shapes_over_workspace(linkage)];
    Figure { columns: 2, panel_px: (560, 520), panels, title: String::new() }
}

fn shapes_on_axis(linkage: &SymmetricFiveBar) -> Panel {
    let mut shapes = Panel {
        title: "Figure 8: force ellipses on the axis".into(),
        x: Axis::new("f_x per 1 N m [N]"),
        y: Axis::new("f_y per 1 N m [N]"),
        equal: true,
        ..Panel::default()
    };
    for (i, y) in [7.0, 12.0, 18.0].into_iter().enumerate() {
        if let Some(found) = ellipse_at(linkage, [0.0, y]) {
            let outline = ellipse_outline(found, [0.0, 0.0], 1.0);
            shapes.series.push(Series::new(
                format!("y = {y} cm"),
                Colour::of(i),
                Marks::Line(outline),
            ));
        }
    }
    shapes
}

fn shapes_over_workspace(linkage: &SymmetricFiveBar) -> Panel {
    let mut over = axes("Figure 9: force ellipses over the workspace");
    let scale: f64 = 0.07;
    let places =
        (-11..=11).flat_map(|i| (2..=12).map(move |j| [2.0 * f64::from(i), 2.0 * f64::from(j)]));
    let drawn = places.filter(
        |at| matches!(OPTIMUM.reach(*at), Reach::Interior { condition } if condition < 100.0),
    );
    let outlines =
        drawn.filter_map(|at| Some((at, ellipse_at(linkage, at)?))).flat_map(|(at, found)| {
            // Near the border one axis grows without end; what is longer than the spacing is
            // shrunk whole, so that its shape stays what it is.
            let longest = found.semi_axes[0].max(found.semi_axes[1]);
            ellipse_outline(found, at, scale.min(1.0 / longest)).into_iter().chain([GAP])
        });
    let label = format!("1 cm = {:.1} N per N m, larger ones shrunk to it", 1.0 / scale);
    over.series.push(Series::new(label, Colour::Blue, Marks::Line(outlines.collect())));
    over.legend = Legend::LowerLeft;
    over.y = Axis::between("y [cm]", -2.0, 27.0);
    over
}

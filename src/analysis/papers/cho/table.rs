//! The wall-following table: all laws on all courses, as CSV, and what a person reads of it.
//!
//! The best law of a cell is the one whose worst figure, measured in the bars of [`Bars`], is
//! least, among those that hold the wall and bring every seed to the end of the course.

use crate::actuation::Strategy;
use crate::analysis::experiment::wall_following::report::{COLUMNS, Value, values};
use crate::analysis::experiment::wall_following::{Law, Row, Study};
use crate::analysis::wall_following::{Beside, CourseKind, HandSettings};

/// The paper's law: its coercive rule, with the condition that it lacks as printed.
pub const PAPERS_LAW: Strategy = Strategy::Coercive;

/// Courses of the table: the wall at three angles, a corner, a circle.
const COURSES: [CourseKind; 5] = [
    CourseKind::Straight,
    CourseKind::StraightTurned,
    CourseKind::StraightSlanted,
    CourseKind::Corner,
    CourseKind::Hollow,
];

/// What a good slide has at most.
pub struct Bars;

impl Bars {
    /// Mean hand force over that under a perfect law, less one.
    pub const RATIO: f64 = 0.08;
    /// Deepest penetration, mm.
    pub const DEPTH_MM: f64 = 0.3;
    /// What goes deeper than this does not hold a wall, mm.
    pub const HOLDS_MM: f64 = 5.0;
    /// rms jerk, m/s^3.
    pub const JERK: f64 = 40.0;
    /// Switches per second.
    pub const SWITCHES: f64 = 3.0;
}

/// The grid of the table.
pub fn study(quick: bool) -> Study {
    let all = Strategy::ALL.into_iter().filter(|law| *law != Strategy::Auto);
    let few = [
        Strategy::NearestReference,
        Strategy::CoerciveLiteral,
        Strategy::Coercive,
        Strategy::PredictedVelocity,
        Strategy::PathFollowing,
        Strategy::Sliding,
    ];
    let laws: Vec<Strategy> = if quick { few.to_vec() } else { all.collect() };
    Study {
        devices: ["cho-2005", "cho-2005-unoptimised"].map(str::to_owned).to_vec(),
        laws: laws.into_iter().map(Law::BuiltIn).collect(),
        courses: if quick {
            vec![CourseKind::Straight, CourseKind::Corner, CourseKind::Hollow]
        } else {
            COURSES.to_vec()
        },
        lags_s: if quick { vec![0.0, 0.03] } else { vec![0.0, 0.01, 0.03] },
        sensors: vec![true, false],
        counts: if quick { vec![65_536.0] } else { vec![65_536.0, 4_096.0] },
        seeds: if quick { vec![1] } else { vec![1, 2, 3] },
        hand: HandSettings::default(),
        beside: Beside::default(),
        stiffness_N_per_m: 1e7,
    }
}

/// How a slide does: its worst figure in bars; infinite where a seed did not arrive or the wall
/// did not hold.
pub fn score(row: &Row) -> f64 {
    if row.arrived < row.runs || row.figures.penetration_mm > Bars::HOLDS_MM {
        return f64::INFINITY;
    }
    let f = &row.figures;
    let ratio = row.ratio().map_or(0.0, |ratio| (ratio - 1.0) / Bars::RATIO);
    let all = [
        f.penetration_mm / Bars::DEPTH_MM,
        f.jerk_rms_m_per_s3 / Bars::JERK,
        f.switches_per_s / Bars::SWITCHES,
    ];
    all.into_iter().fold(ratio, f64::max)
}

/// Rows of the same cell but for the law.
pub(super) fn cells(rows: &[Row]) -> impl Iterator<Item = &[Row]> {
    rows.chunk_by(|a, b| {
        let key = |row: &Row| {
            let cell = &row.cell;
            (cell.course.name(), cell.sensor, cell.counts.to_bits(), cell.lag_s.to_bits())
        };
        a.cell.device == b.cell.device && key(a) == key(b)
    })
}

pub(super) fn best(rows: &[Row]) -> Option<&Row> {
    let holding = rows.iter().filter(|row| score(row).is_finite());
    holding.min_by(|a, b| score(a).total_cmp(&score(b)))
}

/// A row of the table by its cell; sensor, 65,536 counts.
pub(super) fn find<'a>(
    rows: &'a [Row],
    device: &str,
    course: CourseKind,
    law: Strategy,
    lag_s: f64,
) -> Option<&'a Row> {
    rows.iter().find(|row| {
        let cell = &row.cell;
        cell.device == device
            && (cell.course, cell.sensor, cell.counts) == (course, true, 65_536.0)
            && cell.law == Law::BuiltIn(law)
            && cell.lag_s == lag_s
    })
}

/// Cells in which the best law is this one, and all cells that a law passes.
pub(super) fn wins(rows: &[Row], law: Strategy) -> [usize; 2] {
    let mut found = [0; 2];
    for best in cells(rows).filter_map(best) {
        found[1] += 1;
        found[0] += usize::from(best.cell.law == Law::BuiltIn(law));
    }
    found
}

/// The whole table; numbers to five digits.
pub fn csv(study: &Study, rows: &[Row]) -> String {
    let mut text = COLUMNS.join(",") + "\n";
    for row in rows {
        let fields = values(study, row).map(|value| match value {
            Value::Text(name) => name,
            Value::Number(number) => rounded(number),
            Value::Flag(flag) => flag.to_string(),
        });
        text += &(fields.join(",") + "\n");
    }
    text
}

/// Five digits, without zeros that say nothing.
fn rounded(number: f64) -> String {
    if number == 0.0 || !number.is_finite() {
        return if number.is_finite() { "0".to_owned() } else { String::new() };
    }
    let digits = (4.0 - number.abs().log10().floor()).clamp(0.0, 6.0) as usize;
    let text = format!("{number:.digits$}");
    let trimmed =
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if trimmed == "-0" { "0".to_owned() } else { trimmed.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::experiment::wall_following::Cell;
    use crate::analysis::wall_following::{Figures, Perfect};

    fn row(law: Strategy, arrived: usize, penetration_mm: f64) -> Row {
        let cell = Cell {
            device: "cho-2005".into(),
            course: CourseKind::Straight,
            sensor: true,
            counts: 65_536.0,
            lag_s: 0.0,
            law: Law::BuiltIn(law),
        };
        let figures = Figures { penetration_mm, slide_s: 5.0, ..Figures::default() };
        Row { cell, figures, arrived, runs: 3, perfect: Perfect::default() }
    }

    #[test]
    fn the_best_law_is_the_one_that_arrives_and_has_the_least_worst_figure() {
        let rows = [
            row(Strategy::Coercive, 3, 0.6),
            row(Strategy::Sliding, 3, 0.15),
            row(Strategy::Optimal, 2, 0.0),
        ];
        let found = best(&rows).unwrap();
        assert_eq!(found.cell.law, Law::BuiltIn(Strategy::Sliding));
        assert!((score(found) - 0.5).abs() < 1e-12 && (score(&rows[0]) - 2.0).abs() < 1e-12);
        assert_eq!(wins(&rows, Strategy::Sliding), [1, 1]);
        assert!(best(&rows[2..]).is_none());
    }

    #[test]
    fn numbers_of_the_table_have_five_digits() {
        for (number, text) in [
            (65_536.0, "65536"),
            (0.000_123_456, "0.000123"),
            (-1e-9, "0"),
            (12.345_678, "12.346"),
            (0.5, "0.5"),
            (100.0, "100"),
        ] {
            assert_eq!(rounded(number), text);
        }
        let csv = csv(&study(true), &[row(Strategy::Sliding, 3, 0.123_456_789)]);
        assert!(csv.lines().nth(1).unwrap().contains("0.12346"), "{csv}");
    }

    #[test]
    fn the_whole_table_has_about_four_thousand_slides() {
        assert_eq!(study(false).runs(), 3960);
        assert!(study(true).runs() < 200);
    }
}

//! What a person reads of the wall-following table: the best law and the paper's in every cell.

use super::table::{Bars, PAPERS_LAW, best, cells, score};
use crate::analysis::experiment::wall_following::{Law, Row};
use crate::analysis::papers::Page;

/// A law that changes the leading brake more often than this locks and releases it by turns.
const CHATTERS_PER_S: f64 = 100.0;

/// A handle that goes deeper than this was let into the wall.
const LETS_IN_MM: f64 = 1.0;

/// Figures of a law in a cell: stuck, sticks, mm, hand, x bound, gamma, jerk, step, switches.
fn told(row: &Row) -> Vec<String> {
    let f = &row.figures;
    if row.arrived < row.runs {
        let sunk = format!("{:.1}", f.penetration_mm);
        let mut cells = vec![format!("{:.0} %", 100.0 * f.stuck_share()), sunk];
        cells.push(format!("arrives {} of {}", row.arrived, row.runs));
        cells.extend(["-", "-", "-", "-", "-"].map(str::to_owned));
        return cells;
    }
    vec![
        format!("{:.0} % ({})", 100.0 * f.stuck_share(), f.stick_events),
        format!("{:.2}", f.penetration_mm),
        format!("{:.1}, {:.1}", f.hand_mean_N, f.hand_max_N),
        row.ratio().map_or_else(|| "-".to_owned(), |ratio| format!("{ratio:.2}")),
        format!("{:.0}", f.gamma_max_deg),
        format!("{:.0}", f.jerk_rms_m_per_s3),
        format!("{:.1}", f.step_max_N),
        format!("{:.1}", f.switches_per_s),
    ]
}

const HEAD: [&str; 12] = [
    "course",
    "lag ms",
    "sensor",
    "law",
    "stuck (times)",
    "mm",
    "hand N",
    "x bound",
    "gamma",
    "jerk",
    "step N",
    "switches/s",
];

/// A line of a digest; a star where the law keeps all bars.
fn line(row: &Row, what: &str) -> Vec<String> {
    let keeps = if score(row) <= 1.0 { " *" } else { "" };
    let mut line = cell_names(row);
    line.push(format!("{what}`{}`{keeps}", row.cell.law.name()));
    line.extend(told(row));
    line
}

fn cell_names(row: &Row) -> Vec<String> {
    let sensor = if row.cell.sensor { "yes" } else { "no" };
    let lag_ms = format!("{}", 1e3 * row.cell.lag_s);
    vec![row.cell.course.name().to_owned(), lag_ms, sensor.to_owned()]
}

/// The line of a cell that no law passes.
fn none_holds(row: &Row) -> Vec<String> {
    let mut line = cell_names(row);
    line.push("no law holds it with every seed".to_owned());
    line.resize(HEAD.len(), "-".to_owned());
    line
}

/// The best law and the paper's in every cell of a device.
fn digest(page: &mut Page, rows: &[Row], device: &str, counts: f64) {
    let mut lines = Vec::new();
    let chosen = |row: &Row| row.cell.device == device && row.cell.counts == counts;
    for cell in cells(rows).filter(|cell| chosen(&cell[0])) {
        let best = best(cell);
        let own = best.is_some_and(|row| row.cell.law == Law::BuiltIn(PAPERS_LAW));
        lines.push(match best {
            Some(row) => line(row, if own { "**best**, paper " } else { "**best** " }),
            None => none_holds(&cell[0]),
        });
        let paper =
            cell.iter().find(|row| row.cell.law == Law::BuiltIn(PAPERS_LAW)).filter(|_| !own);
        lines.extend(paper.map(|row| line(row, "paper ")));
    }
    page.table(&HEAD, &lines);
}

/// The smaller table: the best law alone.
fn coarse(page: &mut Page, rows: &[Row], device: &str) {
    let chosen = |row: &Row| row.cell.device == device && row.cell.counts == 4_096.0;
    let of = |cell: &[Row]| best(cell).map_or_else(|| none_holds(&cell[0]), |row| line(row, ""));
    let lines: Vec<_> = cells(rows).filter(|cell| chosen(&cell[0])).map(of).collect();
    page.table(&HEAD, &lines);
}

/// The part of the page that the table is.
pub(super) fn write(page: &mut Page, rows: &[Row]) {
    page.heading("The wall-following table");
    let values = |of: fn(&Row) -> String| {
        let mut found: Vec<String> = Vec::new();
        for value in rows.iter().map(of) {
            if !found.contains(&value) {
                found.push(value);
            }
        }
        found
    };
    let laws = values(|row| row.cell.law.name().to_owned()).len();
    let list = |of: fn(&Row) -> String| values(of).join(", ");
    page.say(format!(
        "{laws} laws on {}; courses {} (walls at angles, an inner corner, once round a hollow \
         circle); brake lag {} ms; with and without the hand-force sensor; {} encoder counts; {} \
         seeds: {} rows in [cho-2005-wall-following.csv](cho-2005-wall-following.csv). The hand \
         presses 10 N into a wall of 1e7 N/m and pulls along it at 0.1 m/s with at most 60 N. \
         *stuck*: share of the slide below 1 mm/s, and how often that began; *mm*: deepest \
         penetration; *hand N*: force of the hand along the wall, mean, largest; *x bound*: its mean \
         over that under a perfect law of brakes; *gamma*: largest angle between wall and given \
         force, degrees; *jerk*: rms, m/s^3; *step*: largest change of the brakes' force in 1 ms of the slide. \
         Times and means over the seeds, worst of the largest: a *step* here is the worst of all \
         seeds with the lag of its line.",
        list(|row| format!("`{}`", row.cell.device)),
        list(|row| row.cell.course.name().to_owned()),
        list(|row| format!("{}", 1e3 * row.cell.lag_s)),
        list(|row| format!("{}", row.cell.counts)),
        list(|row| row.runs.to_string()),
        rows.len()
    ));
    below_one(page, rows);
    bound(page, rows);
    page.say(format!(
        "The **best** law is, of those that arrive and go no deeper than {} mm, the one whose worst \
         figure is least, measured in these bars: {:.0} % above the perfect law's hand force, {} \
         mm, jerk {}, {} switches per second; a star: it keeps all of them. The **paper**'s law is its coercive rule with the condition that it \
         lacks (`{PAPERS_LAW}`; as printed it is `coercive-literal` in the CSV).",
        Bars::HOLDS_MM,
        100.0 * Bars::RATIO,
        Bars::DEPTH_MM,
        Bars::JERK,
        Bars::SWITCHES
    ));
    for device in ["cho-2005", "cho-2005-unoptimised"] {
        page.say(format!("**`{device}`, 65,536 counts**"));
        digest(page, rows, device, 65_536.0);
    }
    if rows.iter().any(|row| row.cell.counts == 4_096.0) {
        page.say("**`cho-2005`, 4,096 counts**: the best law of each cell.");
        coarse(page, rows, "cho-2005");
    }
}

/// Why a hand may pull less than under a perfect law.
fn below_one(page: &mut Page, rows: &[Row]) {
    let less = |row: &&Row| row.arrived == row.runs && row.ratio().is_some_and(|x| x < 0.995);
    let below: Vec<&Row> = rows.iter().filter(less).collect();
    let least = below.iter().filter_map(|row| row.ratio()).fold(1.0, f64::min);
    let let_go = |row: &&&Row| {
        row.figures.switches_per_s > CHATTERS_PER_S || row.figures.penetration_mm > LETS_IN_MM
    };
    page.say(format!(
        "*x bound* below 1 is possible and no merit: the perfect law holds the wall in every tick; \
         one that locks and releases brakes, or lets the handle into the wall, can leave it free in \
         between. {} rows that arrive are below 1 (least {least:.2}); in {} of them the leading \
         brake changes more than {CHATTERS_PER_S} times a second or the handle goes deeper than \
         {LETS_IN_MM} mm.",
        below.len(),
        below.iter().filter(let_go).count()
    ));
}

/// What no law can beat.
fn bound(page: &mut Page, rows: &[Row]) {
    page.say(
        "What brakes allow: drag D of one slipping brake at 10 N of press, and the same hand under \
         a perfect law.",
    );
    let mut lines: Vec<Vec<String>> = Vec::new();
    for group in
        rows.chunk_by(|a, b| (&a.cell.device, a.cell.course) == (&b.cell.device, b.cell.course))
    {
        let (cell, perfect) = (&group[0].cell, &group[0].perfect);
        lines.push(vec![
            cell.device.clone(),
            cell.course.name().to_owned(),
            format!("{:.2}, {:.2}", perfect.bound_mean_N, perfect.bound_max_N),
            format!("{:.2}, {:.2}", perfect.hand_mean_N, perfect.hand_max_N),
            format!("{:.2}", perfect.stuck_s),
            format!("{:.0} %", 100.0 * perfect.impossible),
            if perfect.arrived { "yes" } else { "no" }.to_owned(),
        ]);
    }
    page.table(
        &[
            "device",
            "course",
            "D mean, largest [N]",
            "hand mean, largest [N]",
            "stuck [s]",
            "no brake holds",
            "arrives",
        ],
        &lines,
    );
}

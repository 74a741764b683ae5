//! The study in words and numbers: a page of Markdown, and a table for other programs.

use std::fmt::Write;

use crate::analysis::wall_following::Beside;

use super::{Found, IMPACT_SPEEDS_M_PER_S, ImpactRow, Row, Study};

/// Rows of one device on one course.
fn groups(rows: &[Row]) -> impl Iterator<Item = &[Row]> {
    rows.chunk_by(|a, b| (&a.cell.device, a.cell.course) == (&b.cell.device, b.cell.course))
}

/// The whole report.
pub fn markdown(study: &Study, found: &Found) -> String {
    let mut text = String::new();
    let (hand, rows) = (&study.hand, &found.rows[..]);
    let _ = write!(
        text,
        "# Wall following\n\n\
         The experiment of Cho, Song and Kim (2005, section 8) in virtual time, on {} slides. The \
         hand presses {} N into a wall of {:e} N/m and follows a target along it at {} m/s with \
         at most {} N. Seeds: {:?}, for the sensor's noise and the place of the first touch. Every \
         figure is measured on the plant itself.\n\n\
         - **stuck**: seconds of the slide below 1 mm/s, and its share; **sticks**: how often.\n\
         - **mm**: deepest penetration from first contact / while sliding; worst of the seeds.\n\
         - **hand**: force of the hand along the wall, mean / largest, N; **x bound**: that mean \
         over the mean under a perfect law.\n\
         - **gamma**: angle between the wall's normal and what the brakes give, mean / largest, \
         degrees.\n\
         - **jerk**: rms, m/s^3, of the velocity after two moving means of 20 ms; **step**: \
         largest change of the brakes' force in 1 ms, N; **switches**: changes per second of the \
         brake that gives most of the normal force.\n\
         - A law that did not bring every seed to the end of the course has **no** after its \
         name, with the number that arrived; its other figures are those of the way it came.\n\n",
        study.runs(),
        hand.press_N,
        study.stiffness_N_per_m,
        hand.slide_m_per_s,
        hand.grip.max_N,
        study.seeds,
    );
    if !found.is_complete() {
        let [done, all] = found.slides;
        let _ = write!(
            text,
            "**Incomplete**: {done} of {all} slides were done when the study was stopped. Rows \
             may lack seeds, and what was not begun is not here.\n\n"
        );
    }
    if study.beside != Beside::Nothing {
        let _ = write!(text, "Beside the walls: `{}`.\n\n", study.beside);
    }
    bound_table(&mut text, rows);
    impact_table(&mut text, &found.impacts);
    for group in groups(rows) {
        course_table(&mut text, group);
    }
    text
}

/// What no law can beat.
fn bound_table(text: &mut String, rows: &[Row]) {
    text.push_str(
        "## What brakes allow\n\n\
         Holding the wall with slipping brakes costs the hand at least D = N min {q_i > 0}, with \
         q_i = -(r_i . sigma t) / (r_i . n): one slipping brake. A perfect law drags by exactly D. \
         Where no q_i is positive (`impossible`: share of the course) no brake holds the wall \
         while the handle slides, and sticking cannot be avoided by any law.\n\n\
         | device | course | D mean, largest, N | hand mean, largest, N | stuck, s | impossible | \
         arrives |\n|---|---|---|---|---|---|---|\n",
    );
    for group in groups(rows) {
        let Row { cell, perfect, .. } = &group[0];
        let _ = writeln!(
            text,
            "| {} | {} | {:.2}, {:.2} | {:.2}, {:.2} | {:.2} | {:.0} % | {} |",
            cell.device,
            cell.course,
            perfect.bound_mean_N,
            perfect.bound_max_N,
            perfect.hand_mean_N,
            perfect.hand_max_N,
            perfect.stuck_s,
            100.0 * perfect.impossible,
            if perfect.arrived { "yes" } else { "no" },
        );
    }
    text.push('\n');
}

/// What lag makes of an impact.
fn impact_table(text: &mut String, impacts: &[ImpactRow]) {
    let speeds = IMPACT_SPEEDS_M_PER_S.map(|speed| format!("{speed} m/s, mm"));
    let _ = write!(
        text,
        "A wall is known from the first tick in which it is touched. A handle that meets it under \
         the hand's press goes at least this deep, every brake commanded to its utmost from then \
         on: depth beyond this at a corner, an edge or a first touch is the law's.\n\n\
         | device | lag ms | {} |\n|---|---|---|---|---|\n",
        speeds.join(" | ")
    );
    for ImpactRow { device, lag_s, least_depth_m } in impacts {
        let depths = least_depth_m.map(|m| m.map_or("-".into(), |m| format!("{:.2}", 1e3 * m)));
        let _ = writeln!(text, "| {device} | {} | {} |", 1e3 * lag_s, depths.join(" | "));
    }
    text.push('\n');
}

fn course_table(text: &mut String, group: &[Row]) {
    let cell = &group[0].cell;
    let _ = write!(
        text,
        "## {}, {}\n\n\
         | law | sensor | counts | lag ms | stuck | sticks | mm | hand | x bound | gamma | jerk | \
         step | switches |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
        cell.device, cell.course
    );
    for row in group {
        let (cell, f) = (&row.cell, &row.figures);
        let failed = if row.arrived < row.runs {
            format!(" **no** ({} of {})", row.arrived, row.runs)
        } else {
            String::new()
        };
        let ratio = row.ratio().filter(|_| row.arrived == row.runs);
        let _ = writeln!(
            text,
            "| `{}`{failed} | {} | {} | {} | {:.2} ({:.0} %) | {} | {:.2} / {:.2} | {:.1} / {:.1} \
             | {} | {:.0} / {:.0} | {:.0} | {:.1} | {:.1} |",
            cell.law.name(),
            if cell.sensor { "yes" } else { "no" },
            cell.counts,
            1e3 * cell.lag_s,
            f.stuck_s,
            100.0 * f.stuck_share(),
            f.stick_events,
            f.penetration_mm,
            f.sliding_mm,
            f.hand_mean_N,
            f.hand_max_N,
            ratio.map_or("-".into(), |ratio| format!("{ratio:.2}")),
            f.gamma_mean_deg,
            f.gamma_max_deg,
            f.jerk_rms_m_per_s3,
            f.step_max_N,
            f.switches_per_s,
        );
    }
    text.push('\n');
}

/// Names of the columns, each with its unit.
pub const COLUMNS: [&str; 27] = [
    "device",
    "course",
    "law",
    "sensor",
    "counts",
    "lag_ms",
    "runs",
    "seeds",
    "arrived",
    "slide_s",
    "stuck_s",
    "stuck_share",
    "stick_events",
    "penetration_mm",
    "sliding_penetration_mm",
    "hand_mean_N",
    "hand_max_N",
    "perfect_hand_mean_N",
    "perfect_hand_max_N",
    "perfect_stuck_s",
    "bound_mean_N",
    "bound_max_N",
    "gamma_mean_deg",
    "gamma_max_deg",
    "jerk_rms_m_per_s3",
    "step_max_N",
    "switches_per_s",
];

/// One value of a row.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// A name.
    Text(String),
    /// A number.
    Number(f64),
    /// Yes or no.
    Flag(bool),
}

/// The values of a row, in the order of [`COLUMNS`].
pub fn values(study: &Study, row: &Row) -> [Value; 27] {
    let (cell, f, perfect) = (&row.cell, &row.figures, &row.perfect);
    let number = Value::Number;
    [
        Value::Text(cell.device.clone()),
        Value::Text(cell.course.name().into()),
        Value::Text(cell.law.name().into()),
        Value::Flag(cell.sensor),
        number(cell.counts),
        number(1e3 * cell.lag_s),
        number(row.runs as f64),
        number(study.seeds.len() as f64),
        number(row.arrived as f64),
        number(f.slide_s),
        number(f.stuck_s),
        number(f.stuck_share()),
        number(f64::from(f.stick_events)),
        number(f.penetration_mm),
        number(f.sliding_mm),
        number(f.hand_mean_N),
        number(f.hand_max_N),
        number(perfect.hand_mean_N),
        number(perfect.hand_max_N),
        number(perfect.stuck_s),
        number(perfect.bound_mean_N),
        number(perfect.bound_max_N),
        number(f.gamma_mean_deg),
        number(f.gamma_max_deg),
        number(f.jerk_rms_m_per_s3),
        number(f.step_max_N),
        number(f.switches_per_s),
    ]
}

/// A header and a line per row; names with commas or quotes are quoted.
pub fn csv(study: &Study, rows: &[Row]) -> String {
    let mut text = COLUMNS.join(",") + "\n";
    for row in rows {
        let fields = values(study, row).map(|value| match value {
            Value::Text(name) if name.contains([',', '"', '\n']) => {
                format!("\"{}\"", name.replace('"', "\"\""))
            }
            Value::Text(name) => name,
            Value::Number(number) => format!("{number}"),
            Value::Flag(flag) => flag.to_string(),
        });
        text += &(fields.join(",") + "\n");
    }
    text
}

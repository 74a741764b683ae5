//! The conclusions of Cho 2005 about its wall: section 8, and what follows from it.

use super::super::table::{PAPERS_LAW, find};
use super::super::wall::{CLOSE_DEG, DESIRED_N, GAMMA_MAX_DEG, desired_N};
use super::super::{Cho, Snapshot};
use crate::actuation::Strategy;
use crate::analysis::experiment::wall_following::Row;
use crate::analysis::papers::Conclusion;
use crate::analysis::wall_following::CourseKind;

pub(super) fn experiment(cho: &Cho) -> Vec<Conclusion> {
    let wall = &cho.wall;
    let along = &wall.along[1];
    let sequence: Vec<&str> = along.stretches.iter().map(|one| one.ray.as_str()).collect();
    let gamma_end = |k: usize| along.stretches.get(k).map_or(f64::NAN, |one| one.gamma_deg[1]);
    let slide = wall.slide(PAPERS_LAW);
    let correlation = slide.map_or(0.0, |slide| slide.correlation);
    let steps_N = slide.map_or([0.0; 2], |slide| slide.steps_N);
    let seen = slide.map_or(0.0, |slide| slide.gamma_max_deg);
    let leaders = slide.map_or("", |slide| slide.leaders.as_str());
    let sliding = wall.slide(Strategy::Sliding).map_or(0.0, |slide| slide.figures.step_max_N);
    let own_N = slide.map(|slide| slide.desired_N);
    let late_N = lagging(cho).map(|row| desired_N(&row.figures));
    vec![
        Conclusion::judged(
            ("Section 8.2", "along the wall R2+, then R1+, then R4+ display"),
            "so by the geometry; and so do the brakes lead in the simulated slide",
            &[sequence == ["R2+", "R1+", "R4+"], leaders == "R2 R1 R4"],
            format!("{}; simulated {leaders}", sequence.join(" ")),
        ),
        Conclusion::judged(
            ("Section 8.2", "a change in the reference force tends to cause abrupt motion"),
            "under the paper's law the brakes' force steps by more than 10 N in 1 ms where the \
             leading brake changes, and by more there than elsewhere",
            &[steps_N[0] > 10.0, steps_N[0] > steps_N[1]],
            format!(
                "{:.0} N at changes, {:.0} N elsewhere; under `sliding` {sliding:.1} N at most (the \
                 slides of Figure 14: lag 2 ms, one seed)",
                steps_N[0], steps_N[1]
            ),
        ),
        Conclusion::judged(
            ("Section 8.2", "F_hy increases as the approximation angle gamma increases"),
            "their correlation (with tan gamma) in the slide under the paper's law is above 0.5; \
             and under `sliding`",
            &[
                correlation > 0.5,
                wall.slide(Strategy::Sliding).is_some_and(|slide| slide.correlation > 0.5),
            ],
            format!(
                "{correlation:.2}; {:.2} under `sliding`",
                wall.slide(Strategy::Sliding).map_or(0.0, |slide| slide.correlation)
            ),
        ),
        Conclusion::judged(
            ("Section 8.2", "maximum 65.8 degrees, just before R1+ changes to R4+"),
            "the largest gamma of the slide is within 10 % of it; the largest of the geometry \
             stands before the change from R1+ to R4+",
            &[
                (seen / GAMMA_MAX_DEG - 1.0).abs() < 0.1,
                gamma_end(1) > gamma_end(0) && gamma_end(1) > gamma_end(2),
            ],
            format!(
                "slide {seen:.1} deg; geometry {:.1} before R1+, {:.1} before R4+, {:.1} at the end",
                gamma_end(0),
                gamma_end(1),
                gamma_end(2)
            ),
        ),
        Conclusion::judged(
            ("Section 8.2", "the desired force is almost 20 kN (at t=2.1 s)"),
            "K times the deepest penetration under the paper's law is within 25 % of it with the \
             device's own lag of 2 ms; it lies between that value and the one with 30 ms",
            &[
                own_N.is_some_and(|N| (N / DESIRED_N - 1.0).abs() <= 0.25),
                own_N.zip(late_N).is_some_and(|(own_N, late_N)| {
                    (own_N.min(late_N)..=own_N.max(late_N)).contains(&DESIRED_N)
                }),
            ],
            format!(
                "{:.1} kN (lag 2 ms), {:.1} kN (30 ms): the 20 kN are 2 mm",
                1e-3 * own_N.unwrap_or(0.0),
                1e-3 * late_N.unwrap_or(0.0)
            ),
        ),
        Conclusion::not_testable(
            "Section 8.1",
            "the 5-bar mechanism was constructed for the experiments (Fig. 12)",
            "hardware; the sensors, 1 kHz and K of that section are simulated",
        ),
    ]
}

fn lagging(cho: &Cho) -> Option<&Row> {
    find(&cho.rows, "cho-2005", CourseKind::Straight, PAPERS_LAW, 0.03)
}

pub(super) fn optimised_wall(cho: &Cho) -> Vec<Conclusion> {
    let wall = &cho.wall;
    let [before, after] = &wall.snapshots;
    let caught = |all: &[Snapshot; 4]| all.iter().filter(|one| one.caught).count();
    let simulated = find(&cho.rows, "cho-2005-unoptimised", CourseKind::Straight, PAPERS_LAW, 0.0);
    let gamma = |one: &Snapshot| one.gamma_deg.unwrap_or(90.0);
    let nearer = (0..4).filter(|k| gamma(&before[*k]) < gamma(&after[*k])).count();
    let apart = before.iter().map(|one| format!("{:.0}", one.r3_r4_deg));
    let near = before.iter().filter(|one| one.r3_r4_deg < CLOSE_DEG).count();
    vec![
        Conclusion::judged(
            ("Section 8.2", "the unoptimized mechanism can no longer move (Fig. 15e)"),
            "at P1 the hand that slides on the optimised device lies in the pseudo friction cone of \
             the unoptimised one; on none of the four places in that of the optimised one; under \
             the paper's law the unoptimised one does not come to the end of the wall",
            &[
                before[0].caught,
                caught(after) == 0,
                simulated.is_some_and(|row| row.arrived < row.runs),
            ],
            format!(
                "in the cone at {} of 4 places, optimised {} of 4; {}",
                caught(before),
                caught(after),
                simulated.map_or_else(
                    || "not simulated".to_owned(),
                    |row| format!("simulated it arrives {} of {} times", row.arrived, row.runs)
                )
            ),
        ),
        Conclusion::judged(
            ("Section 8.2", "unoptimized sometimes shows better force approximation (Fig. 15h)"),
            "at one of the four places or more its gamma is smaller",
            &[nearer > 0],
            format!("{nearer} of 4"),
        ),
        Conclusion::judged(
            ("Section 8.2", "in most cases R3 and R4 are closely positioned, except Fig. 15(g)"),
            "less than 20 degrees apart at three of the four places at least, and on half of the \
             wall; not at P3, which (g) shows",
            &[near >= 3 && wall.along[0].close > 0.5, before[2].r3_r4_deg >= CLOSE_DEG],
            format!(
                "{} deg at P1 to P4; on {:.0} % of the wall (optimised {:.0} %)",
                apart.collect::<Vec<_>>().join(", "),
                100.0 * wall.along[0].close,
                100.0 * wall.along[1].close
            ),
        ),
        Conclusion::judged(
            ("Section 8.2", "no such large cone during the wall-following task"),
            "the widest cone along the wall is less than three quarters of the unoptimised one's",
            &[wall.along[1].cone_deg[0] < 0.75 * wall.along[0].cone_deg[0]],
            format!(
                "{:.0} deg (mean {:.0}) against {:.0} deg (mean {:.0})",
                wall.along[1].cone_deg[0],
                wall.along[1].cone_deg[1],
                wall.along[0].cone_deg[0],
                wall.along[0].cone_deg[1]
            ),
        ),
    ]
}

pub(super) fn closing(cho: &Cho) -> Vec<Conclusion> {
    let wall = &cho.wall;
    let [before, after] = wall.common_drag;
    let row = |device, law, lag_s| find(&cho.rows, device, CourseKind::Straight, law, lag_s);
    let arrives = |device| row(device, PAPERS_LAW, 0.0).is_some_and(|row| row.arrived == row.runs);
    let pull = |device| {
        row(device, Strategy::Sliding, 0.0)
            .filter(|row| row.arrived == row.runs)
            .map(|row| row.figures.hand_mean_N)
    };
    let pulls = ["cho-2005-unoptimised", "cho-2005"].map(pull);
    let told =
        |pull: Option<f64>| pull.map_or("not to the end".to_owned(), |N| format!("{N:.1} N"));
    let along = &wall.along[1];
    let coercive = along.stretches.iter().flat_map(|one| one.gamma_deg).fold(0.0, f64::max);
    let nearest = along.nearest_deg;
    let path = row("cho-2005", Strategy::PathFollowing, 0.0);
    let own = row("cho-2005", PAPERS_LAW, 0.0);
    let ratio = |row: Option<&Row>| row.and_then(Row::ratio).unwrap_or(f64::INFINITY);
    vec![
        Conclusion::judged(
            (
                "Abstract",
                "performance regarding the limitations is greatly improved when optimized",
            ),
            "the paper's law brings the optimised device to the end of the paper's wall and not \
             the unoptimised one; the widest cone along it is less than three quarters",
            &[
                arrives("cho-2005") && !arrives("cho-2005-unoptimised"),
                wall.along[1].cone_deg[0] < 0.75 * wall.along[0].cone_deg[0],
            ],
            format!(
                "arrives: optimised {}, unoptimised {}",
                arrives("cho-2005"),
                arrives("cho-2005-unoptimised")
            ),
        ),
        Conclusion::judged(
            ("Section 9, 3", "the motion requires a weaker hand force input"),
            "the least drag per newton of press is smaller, mean over the places of the wall where \
             both devices can slide; and the hand pulls less on the whole wall under `sliding`",
            &[after < before, pulls[1].unwrap_or(60.0) < pulls[0].unwrap_or(60.0)],
            format!(
                "drag {after:.2} N per N against {before:.2}; pull {} against {}",
                told(pulls[1]),
                told(pulls[0])
            ),
        ),
        Conclusion::judged(
            ("Section 9", "the coercive control sometimes produces a poor force approximation"),
            "by the geometry of the wall its largest gamma is larger than that of the nearest of \
             all eight reference forces, some of which would stick",
            &[coercive > nearest],
            format!("{coercive:.1} deg against {nearest:.1} deg"),
        ),
        Conclusion::judged(
            ("Section 9", "path-following control (ref. 15) should overcome the limitation"),
            "`path-following` arrives and needs less hand force on the paper's wall than the \
             paper's law; its largest step is smaller",
            &[
                path.is_some_and(|row| row.arrived == row.runs) && ratio(path) < ratio(own),
                path.zip(own)
                    .is_some_and(|(path, own)| path.figures.step_max_N < own.figures.step_max_N),
            ],
            format!(
                "{} against {}",
                path.map_or("-".to_owned(), summary),
                own.map_or("-".to_owned(), summary)
            ),
        ),
    ]
}

/// A slide in a few words.
fn summary(row: &Row) -> String {
    if row.arrived < row.runs {
        return format!("does not arrive ({} of {})", row.arrived, row.runs);
    }
    let f = &row.figures;
    format!(
        "hand {:.1} N, {:.2} mm deep, step {:.1} N",
        f.hand_mean_N, f.penetration_mm, f.step_max_N
    )
}

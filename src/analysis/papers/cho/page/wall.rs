//! The page of Cho 2005 from Figure 11 on: the rule and the wall.

use super::super::wall::{DESIRED_N, GAMMA_MAX_DEG};
use super::super::{Cho, PLACES_M, Snapshot};
use crate::actuation::Strategy;
use crate::analysis::papers::Page;
use crate::analysis::papers::page::Compared;

pub(super) fn rule(page: &mut Page, cho: &Cho) {
    let [picks, literal, mended, none] = cho.regions.coercive;
    page.item("Figure 11", "the coercive rule");
    page.picture(
        "cho-2005-fig-11",
        "At y = 0.32 m of the paper's wall (normal -x), moving along -y: brake 2 locked leaves the \
         path Q2 out of the wall, brake 3 leaves Q3 into it.",
    );
    page.say(format!(
        "The rule as printed is incomplete: without also asking phi_R <= pi (>= pi on the other \
         side) {literal} of {picks} random picks lead *into* the wall; with it {mended} do, and in \
         {none} nothing can be picked: the hand pushes within the pseudo friction cone."
    ));
    page.item("Figure 12", "the experimental setup");
    page.say(
        "A photograph of hardware: nothing to compute. Its numbers (encoders on the brakes' axes, \
         force sensor on the handle, 1 kHz, K = 1e7 N/m, wall at x = 0.3 m) are those of the \
         simulation; the brakes' torque and lag and the mass at the handle are not given in the \
         paper and are 20 N m, 2 ms and 0.5 kg here.",
    );
}

pub(super) fn slides(page: &mut Page, cho: &Cho) {
    let wall = &cho.wall;
    page.item("Figure 13", "motion along the surface");
    page.picture(
        "cho-2005-fig-13",
        "Path of the handle under four laws, and enlarged across the wall. Look for kinks where \
         one reference force takes over from another.",
    );
    for (name, along) in ["before", "after"].into_iter().zip(&wall.along) {
        let told = along.stretches.iter().map(|one| {
            if one.ray.is_empty() {
                return format!("none holds ({:.3} to {:.3} m)", one.y_m[0], one.y_m[1]);
            }
            let [from, to] = one.gamma_deg;
            format!(
                "{} ({:.3} to {:.3} m, gamma {from:.1} to {to:.1} deg)",
                one.ray, one.y_m[0], one.y_m[1]
            )
        });
        page.say(format!(
            "Responsible along y from 0.35 to -0.15 m, {name}: {}.",
            told.collect::<Vec<_>>().join(", ")
        ));
    }
    page.item("Figure 14", "hand force, gamma and brakes over time");
    page.picture(
        "cho-2005-fig-14",
        "The hand's force along the wall follows gamma and falls where another brake takes over.",
    );
    let paper = wall.slide(Strategy::Coercive);
    let gamma = paper.map_or(f64::NAN, |slide| slide.gamma_max_deg);
    let change = wall.along[1].stretches.get(1).map_or(f64::NAN, |one| one.gamma_deg[1]);
    let desired = |law| wall.slide(law).map_or(f64::NAN, |slide| slide.desired_N);
    page.compare(&[
        Compared {
            what: "largest gamma of the slide, brake that leads [deg]",
            source: "Section 8.2",
            published: GAMMA_MAX_DEG,
            here: gamma,
            digits: 1,
        },
        Compared {
            what: "gamma just before R1+ gives way to R4+, geometry [deg]",
            source: "Section 8.2",
            published: GAMMA_MAX_DEG,
            here: change,
            digits: 1,
        },
        Compared {
            what: "largest desired force K x penetration [N]",
            source: "Section 8.2, \"almost 20 kN\"",
            published: DESIRED_N,
            here: desired(Strategy::Coercive),
            digits: 0,
        },
    ]);
    let at =
        wall.gamma_max_y_m.map_or("nowhere on the wall".to_owned(), |y| format!("at y = {y:.3} m"));
    let y_m = wall.along[1].stretches.get(1).map_or(f64::NAN, |one| one.y_m[1]);
    page.say(format!(
        "R1+ would be 65.8 degrees off the normal {at}, where R4+ is usable from y = {y_m:.3} m on: \
         the paper's device seems to have changed brakes that much later, as it does when the hand \
         has first to show that it pulls, or when brakes lag. 20 kN are 2 mm of penetration.",
    ));
    let rows = wall.slides.iter().map(|slide| {
        let f = &slide.figures;
        vec![
            format!("`{}`", slide.law),
            format!("{:.2} ({})", f.stuck_s, f.stick_events),
            format!("{:.2}", f.penetration_mm),
            format!("{:.1}, {:.1}", f.hand_mean_N, f.hand_max_N),
            format!("{:.1} ({:.3})", slide.gamma_max_deg, slide.gamma_max_y_m),
            format!("{:.2}", slide.correlation),
            format!("{:.1}, {:.1}", slide.steps_N[0], slide.steps_N[1]),
            format!("{:.0}", f.jerk_rms_m_per_s3),
            slide.leaders.clone(),
        ]
    });
    page.say(
        "*gamma max*: largest angle between the wall's normal and the reference force of the brake \
         that leads, while the handle moves; *hand ~ tan gamma*: correlation of the hand's force \
         along the wall with tan gamma; *step N*: largest change of the brakes' force in 1 ms of \
         this one slide (lag 2 ms, one seed), where the leading brake changes and elsewhere.",
    );
    page.table(
        &[
            "law (lag 2 ms)",
            "stuck s (times)",
            "mm",
            "hand N",
            "gamma max deg (at y m)",
            "hand ~ tan gamma",
            "step N at changes, elsewhere",
            "jerk",
            "leading",
        ],
        &rows.collect::<Vec<_>>(),
    );
}

pub(super) fn snapshots(page: &mut Page, cho: &Cho) {
    let wall = &cho.wall;
    page.item("Figure 15", "optimised and unoptimised at four places");
    page.picture(
        "cho-2005-fig-15",
        "Upper row (a) to (d): optimised at P1 to P4; lower row (e) to (h): unoptimised with the \
         same hand. Tinted: the pseudo friction cone, out of which the hand (blue) must stay; orange: \
         the wall's force.",
    );
    page.say(format!(
        "The paper marks P1 to P4 in a picture; here they stand at y = {:.2}, {:.2}, {:.2}, {:.2} m, \
         with the hand of the slide under `sliding`, which holds the wall: its mean within a \
         centimetre. A hand that slides steadily lies on the edge of the cone; within a degree of it \
         counts as outside.",
        PLACES_M[0], PLACES_M[1], PLACES_M[2], PLACES_M[3]
    ));
    let [before, after] = &wall.snapshots;
    let cells = |one: &Snapshot| {
        vec![
            if one.ray.is_empty() { "none".to_owned() } else { one.ray.clone() },
            one.gamma_deg.map_or("-".to_owned(), |deg| format!("{deg:.1}")),
            format!("{:.1}{}", one.cone_deg, if one.caught { ", **hand in it**" } else { "" }),
            format!("{:.1}", one.r3_r4_deg),
        ]
    };
    let rows = (0..4).map(|k| {
        let hand = wall.hands_N[k];
        let mut row = vec![format!("P{}", k + 1), format!("({:.1}, {:.1})", hand.x, hand.y)];
        row.extend(cells(&after[k]));
        row.extend(cells(&before[k]));
        row
    });
    page.table(
        &[
            "place",
            "hand [N]",
            "(a-d) ray",
            "gamma",
            "cone deg",
            "R3 to R4 deg",
            "(e-h) ray",
            "gamma",
            "cone deg",
            "R3 to R4 deg",
        ],
        &rows.collect::<Vec<_>>(),
    );
}

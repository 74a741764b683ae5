//! The page of Kim et al. 2003.

use super::conclusions::{conclusions, solved_percent};
use super::measure::Kim;
use crate::analysis::experiment::force_distribution::{ROUNDING, Scheme, pushed_pose};
use crate::analysis::papers::Page;
use crate::analysis::papers::page::{Compared, tiny};

/// Everything, in the paper's order.
pub fn page(kim: &Kim) -> Page {
    let mut page = Page::begin(
        "kim-2003",
        "Kim, Chung, Yi and Suh 2003: force distribution on a redundant 3-RRR",
    );
    let [base, floating] = kim.study.limits_Nm;
    page.say(format!(
        "The paper has eight figures and no table. It prints three numbers (links of 0.1 m, \
         chains 120 degrees apart, a limit of 0.4 N m); everything else is in curves whose scales \
         are not legible in the copy at hand. So its figures are compared in kind, with our own \
         numbers. What it does not give was chosen so that what its Figures 4 to 7 show happens: \
         base circle 0.2 m, a pose, a push of 20 N at 351 degrees, base motors of {base} N m, \
         floating ones of {floating} N m with weight {} (only K2/K1 of Eq 25 acts: the common \
         Delta F cancels). {} random poses for every count, seed {}. Done again by `hapticd \
         experiment force-distribution`.",
        kim.study.floating_weight, kim.study.poses, kim.study.seed
    ));
    page.heading("Tables and figures");
    mechanism(&mut page, kim);
    push(&mut page, kim);
    torques(&mut page, kim);
    page.item("Figure 8", "prototype");
    page.say("A photograph of hardware: nothing to compute.");
    reproduction(&mut page, kim);
    past(&mut page, kim);
    page.judge(conclusions(kim));
    page
}

fn mechanism(page: &mut Page, kim: &Kim) {
    page.item("Figure 1", "the 3-DOF parallel device");
    page.picture(
        "kim-2003-fig-1",
        "The linkage in the pose of the push. Three chains of two links from a base circle to a \
         plate; motors at the base and in the elbows.",
    );
    page.compare(&[
        Compared {
            what: "mobility M (Eq 1: 8 links, 9 joints, in the plane)",
            source: "Section 1, 3-DOF",
            published: 3.0,
            here: kim.mobility as f64,
            digits: 0,
        },
        Compared {
            what: "actuators",
            source: "Section 2.1",
            published: 6.0,
            here: kim.actuators as f64,
            digits: 0,
        },
    ]);
    page.say(format!(
        "Eq 2 as printed is degenerate: nothing in it keeps the three joints of the plate apart. \
         Smallest over largest singular value of the map from torques to wrenches, over {} random \
         poses within 20 mm of the centre of a base circle of 0.15 m: {} as printed (rank 2 \
         everywhere), at least {:.3} with the plate's joints at 30, 150 and 270 degrees. The page \
         uses the mended one.",
        kim.ranks.poses,
        tiny(kim.ranks.printed),
        kim.ranks.mended
    ));
}

fn push(page: &mut Page, kim: &Kim) {
    let pose = pushed_pose();
    let peak_N = kim.pushes[0].iter().map(|one| one.wrench.xy().norm()).fold(0.0, f64::max);
    page.item("Figure 2", "the simulator: a box in an elastic frame");
    page.picture(
        "kim-2003-fig-2-3",
        "Left: Figure 2, the box pressed into the frame, flat and by a corner. Middle: Figure 3, \
         the force. Right: the moment, which a single point of contact would never feel.",
    );
    page.item("Figure 3", "the desired force");
    page.say(format!(
        "Middle panel above: a half-sine of {peak_N:.1} N along 351 degrees in a second, at \
         ({:.4}, {:.4}, {:.2}) from the centre of the base circle. Pressed by a corner the box \
         makes a moment of up to {:.3} N m: the third freedom at work.",
        pose.x, pose.y, pose.z, kim.moment_Nm
    ));
}

fn torques(page: &mut Page, kim: &Kim) {
    let peak = |scheme: usize, motor: usize| kim.peak_Nm[scheme][motor];
    page.item("Figure 4", "least norm, a base and a floating motor of one chain");
    page.picture(
        "kim-2003-fig-4-7",
        "As Figures 4 (upper left), 5 (upper right), 6 (lower left) and 7 (lower right).",
    );
    page.say(format!(
        "The floating motor reaches {:.3} N m of its {} N m; the base motor {:.3} of its {} N m.",
        peak(0, 1),
        kim.study.limits_Nm[1],
        peak(0, 0),
        kim.study.limits_Nm[0]
    ));
    page.item("Figure 5", "the same with weights");
    page.say(format!(
        "The floating motor reaches {:.3} N m, its chain's base motor {:.3} N m; largest torque of \
         the base motors of chains 2 and 3 without and with weights: {:.3} to {:.3} and {:.3} to \
         {:.3} N m.",
        peak(1, 1),
        peak(1, 0),
        peak(0, 2),
        peak(1, 2),
        peak(0, 4),
        peak(1, 4)
    ));
    page.item("Figure 6", "another chain with weights, over the limit");
    page.say(format!(
        "In chain 2 the floating motor reaches {:.3} N m ({:.3} without weights).",
        peak(1, 3),
        peak(0, 3)
    ));
    page.item("Figure 7", "null space: the floating motor at its limit");
    page.compare(&[Compared {
        what: "largest torque of the floating motor [N m]",
        source: "Fig. 7, Section 4.2",
        published: 0.4,
        here: peak(2, 3),
        digits: 3,
    }]);
    page.say("Largest torques of all motors in the push, N m:");
    let rows = Scheme::ALL.iter().enumerate().map(|(k, scheme)| {
        let peaks = kim.peak_Nm[k].iter().map(|peak| format!("{peak:.3}"));
        std::iter::once(scheme.name().to_owned()).chain(peaks).collect()
    });
    page.table(
        &["scheme", "base 1", "floating 1", "base 2", "floating 2", "base 3", "floating 3"],
        &rows.collect::<Vec<_>>(),
    );
}

fn reproduction(page: &mut Page, kim: &Kim) {
    let story = &kim.story;
    let percent = |part: usize, of: usize| 100.0 * part as f64 / of.max(1) as f64;
    page.heading("What reproduces, and what does not");
    page.say(format!(
        "* Figures 4 to 7 were matched in one pose (numbers above). At random ones: of {} pushes \
         of 20 N in random directions, {:.0} % take a floating motor beyond {} N m under least \
         norm and {:.0} % under weights; the weights lower the largest floating torque in {:.0} \
         %.\n\
         * \"Without any additional torque saturation\" (Figure 7): of the {} pushes that saturate \
         a motor under weights the one-joint method brings {:.0} % within all limits, where the \
         exact solution brings {:.0} %.\n\
         * Curves cannot be compared point by point: pose, weights, base limits and radius are \
         not given.\n\
         * Misprints met on the way: the second `-2g2` of Eq 6 and 9 is `-2g3` (as printed A has \
         two equal columns); the last entry of Eq 7 is `3phi3`; Eq 18 is missing; in Eq 27 T_max \
         must carry the sign of the saturated torque, or a motor at -0.5 N m is sent to +0.4.",
        story.pushes,
        percent(story.over_least_norm, story.pushes),
        kim.study.limits_Nm[1],
        percent(story.over_weighted, story.pushes),
        percent(story.lowered, story.pushes),
        story.over_weighted,
        percent(story.mended_once, story.over_weighted),
        percent(story.mended_exactly, story.over_weighted),
    ));
    page.say(
        "The radius of the base circle, which the paper does not give: condition number of the map \
         from torques to wrenches (moments on 0.1 m) over random poses, median and largest:",
    );
    let rows = kim.spreads.iter().map(|one| {
        let ends = |[middle, most]: [f64; 2]| format!("{middle:.1}, {most:.0}");
        vec![format!("{} m", one.radius_m), ends(one.three), ends(one.six)]
    });
    page.table(&["radius", "three base motors", "all six motors"], &rows.collect::<Vec<_>>());
    page.picture(
        "kim-2003-conditions",
        "Condition number at phi = 0 on three base motors (left) and on six (right); 100 and more \
         is the lightest colour. The singular curves on the left are inside the workspace.",
    );
}

fn past(page: &mut Page, kim: &Kim) {
    page.heading("Past the paper");
    page.say(
        "**How often each scheme keeps to the limits** where a solution exists, per cent of \
         random poses and pure forces, by share of the largest force in that direction; then its \
         weighted norm beside the exact one's, where it solves.",
    );
    let mut head = vec!["share of the range", "feasible"];
    head.extend(Scheme::ALL.map(Scheme::name));
    let rows = kim.levels.iter().map(|level| {
        let part = |count: usize| format!("{:.1} %", 100.0 * count as f64 / level.poses as f64);
        let share = format!("{:.2} to {:.2}", level.share[0], level.share[1]);
        let cells = level.solved.iter().zip(level.norm_ratio).map(|(&solved, ratio)| {
            if solved > 0 { format!("{} (x {ratio:.3})", part(solved)) } else { part(solved) }
        });
        [share, part(level.feasible)].into_iter().chain(cells).collect()
    });
    page.table(&head, &rows.collect::<Vec<_>>());
    page.say(format!(
        "`null-space-iterated` pins the worst motor again and again, base motors too: {:.1} % \
         against {:.1} % for the published one-joint method. The exact bounded solution keeps \
         {:.1} %, says when a wrench is infeasible, and gives the nearest one then.",
        solved_percent(kim, 3),
        solved_percent(kim, 2),
        solved_percent(kim, 4)
    ));
    let [coarse, fine] = kim.study.steps_Nm;
    page.say(format!(
        "**Coarse and fine**, with steps of {coarse} N m at the base and {fine} N m in the \
         floating motors. {ROUNDING} Forces are up to half of what the floating motors can give in \
         that direction; in the last row up to half of what both sets can give.",
    ));
    let rows = kim.resolutions.iter().map(|set| {
        let errors = set.error_N.map(|error| format!("{error:.4}"));
        let mut row = vec![set.motors.to_owned()];
        row.extend(errors);
        row.push(format!("{:.1}", set.range_N));
        row
    });
    page.table(
        &[
            "motors",
            "error, mean [N]",
            "95 of 100 [N]",
            "largest [N]",
            "force in every direction [N]",
        ],
        &rows.collect::<Vec<_>>(),
    );
    if let [base, floating, both, wide] = &kim.resolutions[..] {
        page.say(format!(
            "Mean error of both sets over that of the floating ones alone: {:.2} for forces that \
             these can give, {:.2} over the larger ones. Force in every direction over that of the \
             base motors alone: {:.2}.",
            both.error_N[0] / floating.error_N[0],
            wide.error_N[0] / floating.error_N[0],
            both.range_N / base.range_N
        ));
    }
    page.picture("kim-2003-resolution", "Share of forces whose error is at most this.");
}

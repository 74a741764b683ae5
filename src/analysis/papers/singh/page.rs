//! The page of Singh et al.

use super::brute::FIGURE_4;
use super::conclusions::conclusions;
use super::measure::{OPTIMUM, Singh, Winner};
use crate::analysis::design::symmetric::{CountGrid, Lengths};
use crate::analysis::papers::Page;
use crate::analysis::papers::page::{Compared, tiny};

/// The paper's other minimum.
const RIVAL: Lengths = Lengths { a1: 9.0, a2: 14.0, a3: 3.0 };

fn named(lengths: &Lengths) -> String {
    format!("({}, {}, {})", lengths.a1, lengths.a2, lengths.a3)
}

/// Everything, in the paper's order.
pub fn page(singh: &Singh) -> Page {
    let mut page = Page::begin(
        "singh",
        "Singh, Saha and Manivannan: synthesis of a two degrees-of-freedom haptic device",
    );
    page.say(
        "One table and ten figures. Numbers are printed in Table 1 and in a few sentences; the \
         figures are compared in kind. Lengths in centimetres; a3 is half of the base. Done again \
         by `hapticd experiment synthesis`.",
    );
    page.heading("Tables and figures");
    kinematics(&mut page, singh);
    map(&mut page, singh);
    search(&mut page, singh);
    ellipses(&mut page, singh);
    reproduction(&mut page, singh);
    past(&mut page, singh);
    page.judge(conclusions(singh));
    page
}

fn kinematics(page: &mut Page, singh: &Singh) {
    page.item("Figure 1", "kinematic diagram");
    page.picture("singh-fig-1", "The linkage of the optimum at (4, 16), elbows outward.");
    page.item("Figure 2", "boundary singularities");
    page.picture(
        "singh-fig-2",
        "Eq 6 to 9: the circles on which a leg is stretched or folded. The workspace lies \
         between them, above and below the base.",
    );
    page.item("Figure 3", "direct kinematic singularities");
    page.picture(
        "singh-fig-3",
        "(a) B1 and B2 meet: C is free on a circle. (b) B1, C, B2 in line: C is free across. (b) \
         needs a design that breaks condition (b).",
    );
    page.item("Figure 4", "combined singularity");
    page.picture(
        "singh-fig-4",
        "A design with r2 = r3 (condition (d) broken): with the driven links parallel C lies \
         between B1 and B2, whatever their angle; with all links along the base no motion is held.",
    );
    let found = &singh.brute.parallel;
    page.say(format!(
        "{}, driven links parallel, over a whole turn, determinants over their lengths: that of \
         the distal links {} at most, that of the legs {:.2} at most and {} along the base, where \
         the singularity is {}.",
        named(&FIGURE_4),
        tiny(found.most_direct),
        found.most_inverse,
        tiny(found.inverse_along_base),
        if found.combined() { "combined" } else { "not combined" }
    ));
    let met = singh.conditions;
    let word = |met: bool| if met { "met" } else { "**broken**" }.to_owned();
    let brute = &singh.brute;
    let none = "-".to_owned();
    page.say(format!(
        "The conditions of section 3.4.3, for (10, 15, 3) and against brute force over {} random \
         linkages:",
        brute.linkages
    ));
    page.table(
        &["condition", "optimum", "brute force"],
        &[
            vec![
                "(a) r3 > r1".into(),
                word(met.a),
                format!("{} of {} linkages with it let B1 and B2 meet", brute.a[1], brute.a[0]),
            ],
            vec![
                "(b) r2 > r1 + r3".into(),
                word(met.b),
                format!("{} of {} with it put B1, C, B2 in line", brute.b[1], brute.b[0]),
            ],
            vec![
                "(c) r3 < r1 + r2".into(),
                word(met.c),
                format!("{} of {} with (b) break (c) or (d)", brute.b_without_cd, brute.b[0]),
            ],
            vec![
                "(d) r2 != r3".into(),
                word(met.d),
                format!(
                    "combined: {} of {} with (a) to (d), {} of {} others",
                    brute.met[1], brute.met[0], brute.broken[1], brute.broken[0]
                ),
            ],
            vec!["(e) r1 + r2 + r3 = 3".into(), word(met.e), none],
        ],
    );
    page.say(format!(
        "Condition (a) is met by {} of the {} designs of Table 1: half bases of 3 to 5 cm cannot \
         exceed driven links of 9 to 12 cm. In the working mode used here (elbows outward) B1 and \
         B2 never meet all the same.",
        singh.meeting_a,
        singh.found.len()
    ));
}

fn map(page: &mut Page, singh: &Singh) {
    page.item("Figure 5", "condition number over the workspace");
    page.picture(
        "singh-fig-5",
        "The four classes with the paper's signs: plus K < 5, asterisk 5 to 10, square 10 to 100, \
         diamond above. The badly conditioned places are rims.",
    );
    let [own, least, most] = singh.annulus;
    page.say(format!(
        "The paper's figure is for lengths that it does not state. Between 0.9 and 1.7 mean \
         lengths {own:.1} % of the places have K < 5 with the optimum's, {least:.1} to {most:.1} \
         % with those of Table 1."
    ));
}

fn search(page: &mut Page, singh: &Singh) {
    let best = singh.found[0];
    let source = "Table 1, optimum";
    let one = |what, published, here| Compared { what, source, published, here, digits: 0 };
    page.item("Table 1", "parameter space and optimum");
    page.compare(&[
        one("a1 [cm], of 9 to 12", 10.0, best.lengths.a1),
        one("a2 [cm], of 11 to 15", 15.0, best.lengths.a2),
        one("a3 [cm], of 3 to 5", 3.0, best.lengths.a3),
    ]);
    page.say(format!(
        "Measure: interior places with K of 5 or more, fewest first; grid: {}, the first ray \
         counted twice. The paper does not state its grid; this is a clear one under which its \
         optimum is the minimum, with {} such places. The first designs:",
        CountGrid::STATED,
        best.counts.above_5()
    ));
    let rows = singh.found.iter().take(6).map(|one| {
        vec![
            named(&one.lengths),
            one.counts.above_5().to_string(),
            one.counts.interior().to_string(),
            format!("{:.1} %", Winner::percent(one)),
            format!("{}", one.lengths.inscribed_radius()),
        ]
    });
    page.table(
        &["(a1, a2, a3) [cm]", "places with K >= 5", "interior", "share", "r_MIC [cm]"],
        &rows.collect::<Vec<_>>(),
    );
    page.item("Figure 6", "performance parameter over base length");
    page.picture(
        "singh-fig-6-7",
        "Left: Figure 6, every design over its half base, and the mean. Right: Figure 7, over the \
         radius of the largest inscribed circle.",
    );
    let [a, b, c] = singh.bases;
    let trend = if a < b && b < c { ": shorter is better" } else { "" };
    page.say(format!("Means {a:.1}, {b:.1}, {c:.1} for a3 = 3, 4, 5 cm{trend}."));
    page.item("Figure 7", "performance parameter over the inscribed circle");
    let count = |lengths| {
        let one = singh.found.iter().find(|one| one.lengths == lengths);
        one.map_or(f64::NAN, |one| one.counts.above_5() as f64)
    };
    page.say(format!(
        "Right panel above. In the paper (9, 14, 3) and (10, 15, 3) are equal; here they have {} \
         and {} places.",
        count(RIVAL),
        count(OPTIMUM)
    ));
    let [radius, height, printed] = singh.circle;
    page.say(format!(
        "The circle's radius is {radius:.0} cm. Its centre must be max(a1, a2) from both pivots: \
         y_MIC = sqrt(max(a1, a2)^2 - a3^2) = {height:.2} cm. The printed formula gives \
         {printed:.2} cm, where the circle would cross the inner border."
    ));
}

fn ellipses(page: &mut Page, singh: &Singh) {
    page.item("Figure 8", "force/torque transformation");
    page.picture(
        "singh-fig-8-9",
        "Left: Figure 8 on the axis, at y = 7, 12 and 18 cm ((0, 3) cannot be reached). Right: \
         Figure 9 over the workspace. Round in the middle, long and thin at the rims.",
    );
    let at_18 = singh.axis.places.iter().find(|(y, _)| *y == 18.0).and_then(|(_, K)| *K);
    let rows = singh.axis.places.iter().map(|(y, K)| match (K, at_18) {
        (Some(K), Some(at_18)) => {
            vec![format!("{y}"), format!("{K:.3}"), format!("{:.2}", K / at_18)]
        }
        _ => vec![format!("{y}"), "beyond reach".into(), "-".into()],
    });
    page.table(&["y on the axis [cm]", "K", "K / K(18)"], &rows.collect::<Vec<_>>());
    page.say(format!(
        "\"1.5 times\" between y = 3 and y = 18 cannot be checked at y = 3: folded legs still span \
         5 cm from each pivot, which is 4 cm up the axis. The ratio grows to {:.2} at y = {:.1}. \
         J of Eq 5 maps the handle's velocity to joint rates, so Eq 10 must read f = J^T tau; as \
         printed, tau = J^T f, forces and torques would change places. (The paper calls Eq 10 \
         \"Eq. 13\".)",
        singh.axis.largest[1], singh.axis.largest[0]
    ));
    page.item("Figure 9", "ellipses over the workspace");
    page.say(format!(
        "Right panel above. For a torque norm of 1 N m, mean over directions and worst direction: \
         {:.1} and {:.1} N within 3 cm of the middle, {:.1} and {:.1} N within 1 cm of the rims.{}",
        singh.force.middle[0],
        singh.force.middle[1],
        singh.force.edge[0],
        singh.force.edge[1],
        if singh.force.edge[0] > singh.force.middle[0] {
            " A leg near its end is strong along itself, so the mean is larger at the rims, not \
             smaller."
        } else {
            ""
        }
    ));
    page.item("Figure 10", "prototype");
    page.say("A photograph of hardware: nothing to compute.");
}

fn reproduction(page: &mut Page, singh: &Singh) {
    page.heading("What reproduces, and what does not");
    page.say(format!("{} On all grids tried:", optimum_told(singh)));
    let rows = singh.winners.iter().map(|one| {
        vec![
            one.grid.clone(),
            named(&one.best.lengths),
            format!("{} ({:.1} %)", one.best.counts.above_5(), Winner::percent(&one.best)),
            format!(
                "number {} with {} ({:.1} %)",
                one.rank,
                one.published.counts.above_5(),
                Winner::percent(&one.published)
            ),
        ]
    });
    page.table(&["grid", "winner", "places with K >= 5", "(10, 15, 3)"], &rows.collect::<Vec<_>>());
    page.say(
        "* Eq 3 and 4 (forward kinematics) fail where their denominator is zero, on the axis among \
         others; circles are intersected instead.\n\
         * (c) and (d) follow from (b): r2 > r1 + r3 makes r3 < r2 and r3 < r1 + r2.",
    );
}

/// What of the optimum and of the tie comes out under the stated grid.
fn optimum_told(singh: &Singh) -> String {
    let [best, second] = [0, 1].map(|place| singh.found[place]);
    let first = if best.lengths == OPTIMUM {
        let lead = second.counts.above_5() - best.counts.above_5();
        format!("* The optimum does, under the grid above, by {lead} places")
    } else {
        format!("* The optimum does not: under the grid above {} wins", named(&best.lengths))
    };
    let rival = singh.found.iter().find(|one| one.lengths == RIVAL);
    let tied = rival.is_some_and(|one| one.counts.above_5() == best.counts.above_5());
    let tie = if tied { "so does the tie" } else { "there is no tie" };
    format!("{first}; {tie} with {}.", named(&RIVAL))
}

fn past(page: &mut Page, singh: &Singh) {
    page.heading("Past the paper");
    let (lengths, percent) = &singh.by_share;
    let [least, most] = singh.needle_Nm;
    page.say(format!(
        "* A count of places favours small workspaces. By the *share* of the workspace with K >= 5 \
         the best of Table 1 is {} with {percent:.1} %.\n\
         * Sized for the needle of the abstract: 12 N along the axis needs {least:.2} to {most:.2} N m \
         per motor over y = 10 to 20 cm, where K is at most {:.2}; the device `singh` has 2 N m.\n\
         * `singh-brakes` is the same linkage with brakes, `hapticd design optimize --device singh` \
         the search as a command, and every working mode and assembly can be served.",
        named(lengths),
        singh.needle_condition
    ));
}

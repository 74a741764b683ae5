//! The page of Cho 2005, in the paper's order.

use super::conclusions::conclusions;
mod wall;

use super::design::{HISTOGRAM, TABLE_I};
use super::regions::PLACE_M;
use super::{Cho, GridRow, digest, past};
use crate::actuation::Region;
use crate::analysis::papers::Page;
use crate::analysis::papers::page::{Compared, tiny};

/// Everything.
pub fn page(cho: &Cho) -> Page {
    let mut page = Page::begin("cho-2005", "Cho, Song and Kim 2005: a haptic device with brakes");
    page.say(
        "One table and fifteen figures. The paper prints numbers in Table I and in sections 6 and \
         8; its figures are compared in kind, with a number that carries the message where there \
         is one. Done again by `hapticd experiment optimisation`, `hapticd experiment \
         wall-following` and `hapticd design regions`.",
    );
    if cho.quick {
        page.say("*A quick run: few laws, courses and starts.*");
    }
    page.heading("Tables and figures");
    arm(&mut page, cho);
    mechanism(&mut page, cho);
    optimisation(&mut page, cho);
    wall::rule(&mut page, cho);
    wall::slides(&mut page, cho);
    wall::snapshots(&mut page, cho);
    past::reproduction(&mut page, cho);
    past::beyond(&mut page, cho);
    page.judge(conclusions(cho));
    digest::write(&mut page, &cho.rows);
    page
}

fn arm(page: &mut Page, cho: &Cho) {
    let arm = &cho.arm;
    page.item("Figure 1", "passive FMEs of a two-link arm");
    page.picture(
        "cho-2005-fig-1",
        "Links of equal length at 45 and 90 degrees: four rays, four sets.",
    );
    let widths: Vec<String> =
        arm.sets.iter().map(|(rays, deg)| format!("{rays}: {deg:.1} deg")).collect();
    page.say(format!(
        "Sets and widths: {}. Eq 3 gives the linkage's own reference forces (difference {} 1/m). Eq 1b \
         as printed is to be mended: a stuck brake that nobody commands holds {:.0} % of the \
         hand's torque, and any torque without limit; used here: at most what is commanded.",
        widths.join("; "),
        tiny(arm.eq3_off),
        100.0 * arm.uncommanded
    ));
    page.item("Figure 2", "force approximation");
    page.picture(
        "cho-2005-fig-2",
        "The same arm moving along -y. F_d1 in the passive set is displayed, F_d2 beside it only \
         approximately, F_d3 on the side of the motion not at all.",
    );
    let names = arm.regions.map(|region| region.map_or("-", Region::name)).join(", ");
    page.say(format!(
        "Passive set of the motion: {} (the paper's FME 2). Classified: {names}; gamma of F_d2 {:.1} \
         degrees (the paper draws the forces without angles: these stand at 110, 60 and -60 \
         degrees).",
        arm.set_of_motion, arm.gamma_deg
    ));
    page.item("Figure 3", "one-brake paths and the pseudo friction cone");
    page.picture(
        "cho-2005-fig-3",
        "A wall below the handle, normal along y. F_ha lies in the pseudo friction cone: every path \
         that it can take leads into the wall. F_hb does not.",
    );
    page.say(format!(
        "The figure's posture is not given. Its sentences (F_d along y in FME 3, Q- into the wall) \
         need link 2 and handle to lean to the right of y; drawn at 30 and 45 degrees. In Figure 1's \
         posture y lies on R2- itself. The desired force is in set {}, its cone is set {}; of {} \
         directions of the hand {} contradict.",
        arm.cone[1],
        arm.cone[0],
        arm.hands[0],
        arm.hands[1] + arm.hands[2]
    ));
    page.item("Figure 4", "velocity, its normals, and the size of approximation");
    page.picture(
        "cho-2005-fig-4",
        "Between a and -a, normal to the velocity, every resisting force lies; what the passive set \
         leaves of it is gamma1 + gamma2.",
    );
    page.say(format!(
        "Eq 5 holds for two brakes (largest error over all motions {} rad). For the five-bar's \
         four it does not (smallest error {:.2} rad): there the gap is the one region that is left. \
         The examples of section 4 give {:.4} and {:.4} pi^2 (paper: 1 and 10/9).",
        tiny(arm.eq5_two),
        arm.eq5_four,
        arm.P_a[0],
        arm.P_a[1]
    ));
}

fn mechanism(page: &mut Page, cho: &Cho) {
    let regions = &cho.regions;
    page.item("Figure 5", "the redundantly actuated five-bar");
    page.picture(
        "cho-2005-fig-5-7",
        "The linkage with the handle at (0.3, 0.1) m: before (left, all links 0.3 m) and after the \
         optimisation. The lever of link 3 points away from the handle.",
    );
    page.item("Figure 6", "coupled motion");
    page.picture(
        "cho-2005-fig-6",
        "Links 2 and 4 after each step, k = 1: link 4 keeps its direction while link 2 turns.",
    );
    page.compare(&[Compared {
        what: "theta4 after both steps [deg]",
        source: "Section 5.1 (there called Figure 7)",
        published: -45.0,
        here: regions.theta4_deg,
        digits: 3,
    }]);
    page.item("Figure 7", "the five-bar to be optimised");
    page.say("See Figure 5, left: l1 to l5 0.3 m, k3 = k4 = 0.1.");
    page.item("Figure 8", "passive FMEs of the five-bar");
    page.picture(
        "cho-2005-fig-8",
        "Reference forces at (0.3, 0.1) m, optimised device: eight regions, and the passive set of \
         a motion in which all brakes turn backwards.",
    );
    page.say(format!(
        "At ({}, {}) m the rays are, clockwise, {}. {} passive sets of three regions. Of the \
         paper's list {} are sets as printed; items 1 to 4 mean R4- where they print R4+, and then \
         all {} are. All shafts backwards (Eq 17): {}. For a force between R1+ and R2+ the cones of \
         brakes {{1,2}}, {{1,4}}, {{2,3}} are {}, {}, {}; what they have in common is {}.",
        PLACE_M[0],
        PLACE_M[1],
        regions.order,
        regions.regions_per_set.len(),
        regions.listed[0],
        regions.listed[1],
        regions.eq17,
        regions.cones[0],
        regions.cones[1],
        regions.cones[2],
        regions.cones[3]
    ));
}

fn optimisation(page: &mut Page, cho: &Cho) {
    let designs = &cho.designs;
    page.item("Table I", "optimisation results");
    let names = ["before", "after"];
    let mut all = Vec::new();
    for k in [0, 1] {
        let published = TABLE_I[k];
        for (i, (what, digits)) in [("GP_a [rad^2]", 3), ("GP_f [rad]", 3)].into_iter().enumerate()
        {
            for grid in &designs.grids[..2] {
                let short = grid.name.split(',').next().unwrap_or_default().to_owned();
                let here = grid.means[k][i];
                all.push((
                    format!("{what}, {}, {short} grid", names[k]),
                    published[i],
                    here,
                    digits,
                ));
            }
        }
        for (i, what) in ["smallest beta [deg]", "largest beta [deg]"].into_iter().enumerate() {
            let what = format!("{what}, {}", names[k]);
            all.push((what, published[2 + i], designs.beta_deg[k][i], 2));
        }
    }
    let compared: Vec<Compared> = all
        .iter()
        .map(|(what, published, here, digits)| Compared {
            what,
            source: "Table I",
            published: *published,
            here: *here,
            digits: *digits,
        })
        .collect();
    page.compare(&compared);
    page.say(
        "The extremes reproduce, so the geometry is the paper's. The means do not under any single \
         plausible grid, and nothing was tuned to fit. P_a and P_f depend on the distance r from \
         the base alone, so a grid is a weighting of radii. Differences: rms of GP_a and GP_f.",
    );
    let rows = designs.grids.iter().map(|grid| {
        let [before, after] = grid.off_percent();
        let [[a, f], [aa, ff]] = grid.means;
        vec![
            grid.name.clone(),
            format!("{a:.3}, {f:.3}"),
            format!("{before:.1} %"),
            format!("{aa:.3}, {ff:.3}"),
            format!("{after:.1} %"),
            format!("{:.0}", grid.at_50_60),
        ]
    });
    let paper = vec![
        "**paper** (not stated)".to_owned(),
        "7.509, 1.614".to_owned(),
        String::new(),
        "5.310, 1.035".to_owned(),
        String::new(),
        "almost 2500".to_owned(),
    ];
    let rows: Vec<_> = std::iter::once(paper).chain(rows).collect();
    page.table(
        &["grid", "before: GP_a, GP_f", "off", "after: GP_a, GP_f", "off", "places at 50-60 deg"],
        &rows,
    );
    let [[n, off], [m, off_after]] = designs.exponents;
    let worst = |grid: &&GridRow| grid.off_percent()[0].max(grid.off_percent()[1]);
    let nearest = designs.grids.iter().min_by(|a, b| worst(a).total_cmp(&worst(b)));
    let nearest = nearest.map_or(String::new(), |grid| {
        let [before, after] = grid.off_percent();
        format!(
            "Nearest to all four means is \"{}\" ({before:.1} and {after:.1} % off), for which the \
             paper gives no reason and under which {:.0} places have 50 to 60 degrees.",
            grid.name, grid.at_50_60
        )
    });
    let (distance, bands) = designs.any;
    let shares = bands.iter().map(|share| format!("{:.0} %", 100.0 * share)).collect::<Vec<_>>();
    page.say(format!(
        "{nearest} Of all weights r^n \"before\" wants n = {n:.1} ({off:.1} % off), \"after\" n = \
         {m:.1} ({off_after:.1} %). Some odd weighting gives all five numbers together (to {:.0e}), \
         for instance {} in bands of 5 cm from 0.2 to 0.5 m: the numbers do not contradict the \
         geometry, but no simple grid gives them.",
        distance.max(1e-4),
        shares.join(", ")
    ));
    page.item("Figure 9", "histogram of the largest beta");
    page.picture(
        "cho-2005-fig-9",
        "Share of the workspace by largest beta, before and after, under two grids: after the \
         optimisation the large angles are gone.",
    );
    let source = "Section 6, \"almost 2500\"";
    let one = |what, here| Compared { what, source, published: HISTOGRAM[0], here, digits: 0 };
    page.compare(&[
        one("places of 3813 at 50 to 60 deg, area-uniform", designs.grids[0].at_50_60),
        one("the same, polar 31 x 123", designs.grids[1].at_50_60),
        one("the same, radial", designs.grids[2].at_50_60),
    ]);
    page.item("Figure 10", "passive FMEs over the workspace");
    page.picture(
        "cho-2005-fig-10",
        "Directions of the reference forces of the optimised device, and a part enlarged as in \
         the paper's (b): evenly spread in the middle, less so at the rims.",
    );
}

//! What of Cho 2005 does not reproduce and why, and what hapticd does past it.

use super::table::{find, wins};
use super::{Cho, table::PAPERS_LAW};
use crate::actuation::Strategy;
use crate::analysis::design::optimise::Design;
use crate::analysis::papers::Page;
use crate::analysis::wall_following::CourseKind;

/// What reproduces, and what does not.
pub(super) fn reproduction(page: &mut Page, cho: &Cho) {
    let [before, after] = cho.wall.common_drag;
    page.heading("What reproduces, and what does not");
    let ends: Vec<f64> = cho.wall.along[1].stretches.iter().map(|one| one.gamma_deg[1]).collect();
    let end = |k: usize| ends.get(k).copied().unwrap_or(f64::NAN);
    let perfect = |device: &str| {
        let row = cho.rows.iter().find(|row| row.cell.device == device);
        row.map_or(f64::NAN, |row| 100.0 * row.perfect.impossible)
    };
    page.say(format!(
        "* Extremes of beta, order of the rays, the sequence R2+ R1+ R4+, the coupled motion, the \
         eight passive sets, the cones: see the verdicts below; they are the geometry, and it is \
         the paper's.\n\
         * GP_a, GP_f and the histogram: not under any simple grid (Table I above).\n\
         * The largest gamma: of its size, and not where the paper has it. By the geometry R2+ is \
         {:.1} degrees off the normal when R1+ takes over, R1+ {:.1} when R4+ does.\n\
         * \"The optimised device needs less hand force\": the least drag is {after:.2} N per \
         newton of press against {before:.2} before, mean over the places that both can follow. \
         What the optimisation gives is the rest: unoptimised, no brake holds the paper's wall \
         against sliding on {:.0} % of it (optimised {:.0} %).\n\
         * Eq 15 (pseudo-inverse, here `least-norm`) with Eq 1a asks brakes for torques of both \
         signs and loses those that would have to push; see the CSV for what is left of it.\n\
         * Misprints: Eq 5 holds for two brakes only; R4+ for R4- in items 1 to 4 of the list of \
         section 5.2; section 5.1 speaks of Figure 7 where it describes Figure 6; section 7 of \
         Figure 8 where it means Figure 11.",
        end(0),
        end(1),
        perfect("cho-2005-unoptimised"),
        perfect("cho-2005"),
    ));
}

fn least(front: &[Design], of: fn(&Design) -> f64) -> Option<&Design> {
    front.iter().min_by(|a, b| of(a).total_cmp(&of(b)))
}

fn told(design: Option<&Design>) -> String {
    design.map_or("-".to_owned(), |one| format!("{:.3} / {:.3}", one.GP_a, one.GP_f))
}

/// What hapticd does past the paper.
pub(super) fn beyond(page: &mut Page, cho: &Cho) {
    page.heading("Past the paper");
    designs(page, cho);
    walls(page, cho);
    let regions = &cho.regions;
    let percent = |[all, some]: [usize; 2]| 100.0 * some as f64 / all.max(1) as f64;
    page.say(format!(
        "**Allocation.** Within torque limits the nearest achievable force is strictly nearer than \
         the paper's rule in {:.0} % of random cases. In the paper's \"active\" region (F . v > 0), \
         where it gives nothing, a resisting force still brings the handle nearer in {:.0} %.",
        percent(regions.allocations),
        percent(regions.active)
    ));
}

fn designs(page: &mut Page, cho: &Cho) {
    let designs = &cho.designs;
    page.say(format!(
        "**Design**, area-uniform means. P_a and P_f see directions only: in the published optimum \
         the strongest reference force is {:.1} to {:.1} times the weakest.",
        designs.strength[0], designs.strength[1]
    ));
    let row = |name: &str, found: Option<&Design>| {
        let parameters = found.map_or("-".to_owned(), |one| {
            let [a, b, c, d, _] = one.parameters.l_m;
            let (k3, k4) = (one.parameters.k3, one.parameters.k4);
            format!("{a:.3} {b:.3} {c:.3} {d:.3}; {k3:.3} {k4:.3}")
        });
        vec![name.to_owned(), told(found), parameters]
    };
    let (straight, crossed) = (&designs.straight, &designs.crossed);
    page.table(
        &["design", "GP_a / GP_f", "l1 l2 l3 l4 [m]; k3 k4"],
        &[
            row("published (Table I)", designs.published.as_ref()),
            row("published method (simplex, penalties) from its start", straight.simplex.as_ref()),
            row("global, least GP_a", least(&straight.front, |one| one.GP_a)),
            row("global, least GP_f", least(&straight.front, |one| one.GP_f)),
            row("crossed tendons, least GP_a", least(&crossed.front, |one| one.GP_a)),
            row("crossed tendons, least GP_f", least(&crossed.front, |one| one.GP_f)),
        ],
    );
    page.picture(
        "cho-2005-fronts",
        "GP_f over GP_a of the best designs by weighted sums: the published class (left) with the \
         published design, and crossed tendons (right).",
    );
}

fn walls(page: &mut Page, cho: &Cho) {
    let laws =
        [PAPERS_LAW, Strategy::PredictedVelocity, Strategy::PathFollowing, Strategy::Sliding];
    let lags = [0.0, 0.03];
    page.say(
        "**The wall law.** Holding a wall with slipping brakes costs the hand at least D = N min \
         {q_i > 0}, q_i = -(r_i . sigma t) / (r_i . n). `sliding` lets one brake slip at exactly the \
         pressing force and hands over to the next before the reference changes, to do away with \
         the abrupt change that the paper leaves open. On the paper's wall, with sensor, 65,536 \
         counts (*mm* and *step N*: the worst of all seeds):",
    );
    let mut rows = Vec::new();
    for law in laws {
        for lag_s in lags {
            let Some(row) = find(&cho.rows, "cho-2005", CourseKind::Straight, law, lag_s) else {
                continue;
            };
            let f = &row.figures;
            rows.push(vec![
                format!("`{law}`"),
                format!("{}", 1e3 * lag_s),
                if row.arrived == row.runs { "yes".to_owned() } else { "no".to_owned() },
                format!("{:.2}", f.penetration_mm),
                row.ratio().map_or("-".to_owned(), |ratio| format!("{ratio:.2}")),
                format!("{:.0}", f.jerk_rms_m_per_s3),
                format!("{:.1}", f.step_max_N),
                format!("{:.1}", f.switches_per_s),
            ]);
        }
    }
    page.table(
        &["law", "lag ms", "arrives", "mm", "hand x bound", "jerk m/s^3", "step N", "switches/s"],
        &rows,
    );
    let [sliding, all] = wins(&cho.rows, Strategy::Sliding);
    page.say(format!(
        "It is the best law in {sliding} of the {all} cells of the CSV below that any law \
         passes."
    ));
}

//! The conclusions of Singh et al., sentence by sentence, judged by a run's figures.

use super::measure::{OPTIMUM, Singh, Winner};
use crate::analysis::design::symmetric::{Candidate, Lengths};
use crate::analysis::papers::Conclusion;
use crate::analysis::papers::page::tiny;

fn count(singh: &Singh, lengths: Lengths) -> usize {
    let one = singh.found.iter().find(|one| one.lengths == lengths);
    one.map_or(usize::MAX, |one| one.counts.above_5())
}

/// Share of bad places of the optimum, of the median and of the worst design of Table 1.
pub(super) fn shares(singh: &Singh) -> [f64; 3] {
    let mut all: Vec<f64> = singh.found.iter().map(Winner::percent).collect();
    all.sort_by(f64::total_cmp);
    let own = singh.found.iter().find(|one| one.lengths == OPTIMUM).map_or(100.0, Winner::percent);
    [own, all[all.len() / 2], all[all.len() - 1]]
}

/// All of them, in the paper's order.
pub fn conclusions(singh: &Singh) -> Vec<Conclusion> {
    let mut all = kinematics(singh);
    all.extend(workspace(singh));
    all.extend(design(singh));
    all.extend(accuracy(singh));
    all.extend([
        Conclusion::not_testable(
            "Section 2",
            "high stiffness; errors in chains do not directly sum",
            "links and joints are rigid and exact here",
        ),
        Conclusion::not_testable(
            "Section 7",
            "a prototype was developed, which functioned appropriately",
            "hardware",
        ),
    ]);
    all
}

fn kinematics(singh: &Singh) -> Vec<Conclusion> {
    let brute = &singh.brute;
    let met = singh.conditions;
    vec![
        Conclusion::judged(
            ("Section 3.1", "four solutions are achieved for the inverse kinematic problem"),
            "four working modes put the handle at (2, 15)",
            &[singh.solutions[0] == 4],
            format!("{}", singh.solutions[0]),
        ),
        Conclusion::judged(
            ("Section 3.2", "two solutions for the forward kinematic problem"),
            "two handle positions for the shafts of that posture (by intersecting circles; Eq 3 \
             and 4 divide by zero on the axis)",
            &[singh.solutions[1] == 2],
            format!("{}", singh.solutions[1]),
        ),
        Conclusion::judged(
            ("Section 3.4.3", "(a) if r3 > r1, B1 B2 will never coincide"),
            "brute force over random linkages with r3 > r1 finds none that makes them meet",
            &[brute.a[0] > 0 && brute.a[1] == 0],
            format!("{} of {}", brute.a[1], brute.a[0]),
        ),
        Conclusion::judged(
            ("Section 3.4.3", "(b) if r2 > r1 + r3, never in a straight line"),
            "brute force over random linkages with r2 > r1 + r3 finds none with B1 C B2 in line",
            &[brute.b[0] > 0 && brute.b[1] == 0],
            format!("{} of {}; the optimum meets it", brute.b[1], brute.b[0]),
        ),
        Conclusion::judged(
            ("Section 3.4.3", "(c) and (d) remove the combined singularity"),
            "both determinants vanish together on the design of Figure 4, which breaks (d), and on \
             no random linkage that meets (a) to (d); (c) and (d) say something that (b) does not: \
             some random linkage meets (b) and breaks one",
            &[
                brute.parallel.combined() && brute.met[0] > 0 && brute.met[1] == 0,
                brute.b_without_cd > 0,
            ],
            format!(
                "with (a) to (d) {} of {} have one, of the others {} of {}; {} of {} with (b) break \
                 (c) or (d)",
                brute.met[1],
                brute.met[0],
                brute.broken[1],
                brute.broken[0],
                brute.b_without_cd,
                brute.b[0]
            ),
        ),
        Conclusion::judged(
            ("Abstract", "singularities were identified to form constraints for an optimization"),
            "the optimum, and at least one design of Table 1, meet condition (a); the optimum \
             meets (b) to (e)",
            &[met.a && singh.meeting_a > 0, met.b && met.c && met.d && met.e],
            format!(
                "(a) met by {} of {} designs of Table 1 and {} by the optimum",
                singh.meeting_a,
                singh.found.len(),
                if met.a { "met" } else { "broken" }
            ),
        ),
    ]
}

fn workspace(singh: &Singh) -> Vec<Conclusion> {
    let [own, least, most] = singh.annulus;
    vec![
        Conclusion::judged(
            ("Section 4.1", "condition number is independent of the scale"),
            "K in metres is K in centimetres to 1e-6",
            &[singh.scale < 1e-6],
            format!("largest deviation {}", tiny(singh.scale)),
        ),
        Conclusion::judged(
            ("Section 4.1", "annulus 0.9 to 1.7 can be our dexterous workspace (K<5)"),
            "at least nine in ten places there have K < 5 with the optimum's lengths, and with \
             every design of Table 1",
            &[own >= 90.0, least >= 90.0],
            format!("{own:.1} % of the optimum; {least:.1} to {most:.1} % over Table 1"),
        ),
        Conclusion::judged(
            ("Section 5", "condition number rises (5 to 1000) along the boundaries"),
            "four in five places with K >= 5 lie within 1 cm of a stretched or folded leg; the \
             largest K of the map is 500 or more",
            &[singh.at_edge >= 80.0, singh.largest_condition >= 500.0],
            format!(
                "{:.0} %, largest K {:.0} (interior places of arcs every 1 cm, 73 rays over 180 \
                 deg)",
                singh.at_edge, singh.largest_condition
            ),
        ),
    ]
}

fn design(singh: &Singh) -> Vec<Conclusion> {
    let rival = Lengths { a1: 9.0, a2: 14.0, a3: 3.0 };
    let (own, other) = (count(singh, OPTIMUM), count(singh, rival));
    let least = singh.found.iter().map(|one| one.counts.above_5()).min().unwrap_or(0);
    let [first, second, third] = singh.bases;
    let wins = singh.winners.iter().filter(|one| one.rank == 1).count();
    let [share, median, worst] = shares(singh);
    let best = |one: &Candidate| {
        let Lengths { a1, a2, a3 } = one.lengths;
        format!("({a1}, {a2}, {a3})")
    };
    vec![
        Conclusion::judged(
            ("Section 5", "we select a3=3 due to the minimum"),
            "mean places with K >= 5 over the designs with a3 = 3 is less than with 4 and with 5, \
             and so is the least",
            &[first < second && first < third, singh.found[0].lengths.a3 == 3.0],
            format!("{first:.0}, {second:.0}, {third:.0} for a3 = 3, 4, 5"),
        ),
        Conclusion::judged(
            ("Section 5.1", "minimum for (9, 14, 3) and (10, 15, 3)"),
            "under the stated grid (10, 15, 3) has the fewest; and (9, 14, 3) has as few",
            &[own == least, other == least],
            format!("{own} and {other}; least {least}"),
        ),
        Conclusion::judged(
            ("Table 1", "optimum (10, 15, 3)"),
            "it is the minimum under the stated grid, and on every other grid tried",
            &[own == least, wins == singh.winners.len()],
            format!(
                "first on {wins} of {} grids; on the finest lattice {} wins and it is number {}",
                singh.winners.len(),
                singh.winners.last().map_or(String::new(), |one| best(&one.best)),
                singh.winners.last().map_or(0, |one| one.rank)
            ),
        ),
        Conclusion::judged(
            ("Section 5.1", "workspace is higher for the latter configuration"),
            "the inscribed circle of (10, 15, 3) is larger than that of (9, 14, 3)",
            &[OPTIMUM.inscribed_radius() > rival.inscribed_radius()],
            format!("{} against {} cm", OPTIMUM.inscribed_radius(), rival.inscribed_radius()),
        ),
        Conclusion::judged(
            ("Abstract", "performance in terms of singularity was greatly improved"),
            "the optimum's share of places with K >= 5 is below half of the median design's of \
             Table 1; below half of the worst one's",
            &[share < 0.5 * median, share < 0.5 * worst],
            format!("{share:.1} % against {median:.1} % (median) and {worst:.1} % (worst)"),
        ),
    ]
}

fn accuracy(singh: &Singh) -> Vec<Conclusion> {
    let axis = &singh.axis;
    let at = axis.at_1_5.iter().map(|y| format!("{y:.1}")).collect::<Vec<_>>().join(" and ");
    let ratio = |k: usize| singh.force.middle[k] / singh.force.edge[k];
    vec![
        Conclusion::judged(
            ("Section 6", "condition numbers at y=3 average 1.5 times those at y=18"),
            "(0, 3) can be reached, and K there over K at (0, 18) is 1.4 to 1.6",
            &[axis.ratio_3_18.is_some_and(|ratio| (1.4..1.6).contains(&ratio))],
            format!(
                "(0, 3) {}; the ratio is 1.5 at y = {at}, at most {:.2} (y = {:.1})",
                if axis.ratio_3_18.is_some() { "is reached" } else { "is beyond reach" },
                axis.largest[1],
                axis.largest[0]
            ),
        ),
        Conclusion::judged(
            ("Section 6", "1.5 times the average force in the centre than at edges"),
            "force for a torque norm of 1 N m within 3 cm of the middle is 1.5 times that within \
             1 cm of the edge: mean over directions, and in the worst direction",
            &[ratio(0) >= 1.5, ratio(1) >= 1.5],
            format!(
                "mean {:.1} and {:.1} N (x {:.2}), worst {:.1} and {:.1} N (x {:.2})",
                singh.force.middle[0],
                singh.force.edge[0],
                ratio(0),
                singh.force.middle[1],
                singh.force.edge[1],
                ratio(1)
            ),
        ),
        Conclusion::not_testable(
            "Abstract",
            "the device is designed to deliver high force",
            "the paper states no force and no motor; see the sizing above",
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::super::measure::measure;
    use super::*;
    use crate::analysis::papers::Verdict::{Confirmed, InPart, NotConfirmed};
    use crate::analysis::papers::verdict::{verdict_on, well_formed};

    #[test]
    fn verdicts_turn_with_their_figures() {
        let singh = measure().unwrap();
        let all = conclusions(&singh);
        well_formed(&all);
        for (begins, verdict) in [
            ("optimum", InPart),
            ("minimum for", InPart),
            ("condition numbers at y=3", NotConfirmed),
            ("singularities were identified", InPart),
            ("(c) and (d)", InPart),
            ("condition number rises", InPart),
            ("four solutions", Confirmed),
        ] {
            assert_eq!(verdict_on(&all, begins), verdict, "{begins}");
        }
        let mut other = singh.clone();
        other.axis.ratio_3_18 = Some(1.5);
        other.winners.iter_mut().for_each(|one| one.rank = 1);
        (other.conditions.a, other.meeting_a) = (true, 1);
        other.brute.b_without_cd = 3;
        other.largest_condition = 700.0;
        other.solutions[0] = 2;
        let turned = conclusions(&other);
        for (begins, verdict) in [
            ("optimum", Confirmed),
            ("condition numbers at y=3", Confirmed),
            ("singularities were identified", Confirmed),
            ("(c) and (d)", Confirmed),
            ("condition number rises", Confirmed),
            ("four solutions", NotConfirmed),
        ] {
            assert_eq!(verdict_on(&turned, begins), verdict, "{begins}");
        }
        (other.brute.met[1], other.brute.b_without_cd) = (1, 0);
        assert_eq!(verdict_on(&conclusions(&other), "(c) and (d)"), NotConfirmed);
    }
}

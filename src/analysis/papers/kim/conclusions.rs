//! The conclusions of Kim et al. 2003, sentence by sentence, judged by a run's figures.

use super::measure::Kim;
use crate::analysis::experiment::force_distribution::{Level, Scheme};
use crate::analysis::papers::Conclusion;

/// A condition number up to this is far from singular.
const FAR: f64 = 100.0;

/// Schemes by their places in [`Scheme::ALL`].
const LEAST: usize = 0;
const WEIGHTED: usize = 1;
const ONCE: usize = 2;
const ITERATED: usize = 3;
const EXACT: usize = 4;

/// Levels in which a solution exists.
fn feasible(kim: &Kim) -> impl Iterator<Item = &Level> {
    kim.levels.iter().filter(|level| level.feasible > 0)
}

/// Share of the feasible wrenches that a scheme keeps within the limits, per cent.
pub(super) fn solved_percent(kim: &Kim, scheme: usize) -> f64 {
    let (solved, all) = feasible(kim)
        .fold((0, 0), |(solved, all), level| (solved + level.solved[scheme], all + level.feasible));
    100.0 * solved as f64 / all.max(1) as f64
}

fn percent(part: usize, of: usize) -> f64 {
    100.0 * part as f64 / of.max(1) as f64
}

/// All of them, in the paper's order.
pub fn conclusions(kim: &Kim) -> Vec<Conclusion> {
    let mut all = device(kim);
    all.extend(schemes(kim));
    all.extend(resolution(kim));
    all.extend([
        Conclusion::not_testable(
            "Introduction",
            "parallel mechanisms provide high stiffness, high accuracy, high payload",
            "links and joints are rigid and exact here",
        ),
        Conclusion::not_testable(
            "Abstract",
            "a wire and gear reduction achieves high force with soft feeling",
            "no gear and no wire is described or modelled",
        ),
        Conclusion::not_testable(
            "Conclusion",
            "experimental verification is being conducted (Fig. 8)",
            "hardware",
        ),
    ]);
    all
}

fn device(kim: &Kim) -> Vec<Conclusion> {
    let worst = |of: fn(&super::Spread) -> f64| kim.spreads.iter().map(of).fold(0.0, f64::max);
    let (three, six) = (worst(|one| one.three[1]), worst(|one| one.six[1]));
    let [base, _, both, _] = &kim.resolutions[..] else { return Vec::new() };
    vec![
        Conclusion::judged(
            ("Section 1", "more actuators than mobility M: redundantly actuated"),
            "Eq 1 gives 3, and there are more actuators than that",
            &[kim.mobility == 3 && kim.actuators as i64 > kim.mobility],
            format!("M = {}, {} actuators", kim.mobility, kim.actuators),
        ),
        Conclusion::judged(
            ("Abstract", "the device is singularity-free in the workspace"),
            "over random poses and base circles of 0.15, 0.2 and 0.25 m the largest condition \
             number with six motors is below 100, where with three it is above",
            &[six < FAR && three > FAR],
            format!("six motors at most {six:.1}, three base motors up to {three:.0}"),
        ),
        Conclusion::judged(
            ("Abstract", "it has an improved force reflection capability"),
            "the force possible in every direction is larger with all six motors than with the \
             base motors alone, mean over random poses",
            &[both.range_N > base.range_N],
            format!("{:.1} N against {:.1} N", both.range_N, base.range_N),
        ),
    ]
}

fn schemes(kim: &Kim) -> Vec<Conclusion> {
    let limit_Nm = kim.study.limits_Nm[1];
    let least = (1..5).all(|scheme| kim.norm_Nm[LEAST] <= kim.norm_Nm[scheme] + 1e-12);
    let peak = |scheme: usize, motor: usize| kim.peak_Nm[scheme][motor];
    let percents = Scheme::ALL
        .iter()
        .enumerate()
        .map(|(k, scheme)| format!("{} {:.1} %", scheme.name(), solved_percent(kim, k)));
    let percents = percents.collect::<Vec<_>>().join(", ");
    let limit = |motor: usize| kim.study.limits_Nm[motor % 2];
    let quiet =
        (0..6).filter(|motor| *motor != 3).all(|motor| peak(ONCE, motor) <= limit(motor) + 1e-9);
    let story = &kim.story;
    let (once, weighted) = (solved_percent(kim, ONCE), solved_percent(kim, WEIGHTED));
    vec![
        Conclusion::judged(
            ("Section 2.3", "the pseudo-inverse (Eq 22) is a minimum norm solution"),
            "no other scheme's torques have a smaller norm in the middle of the push",
            &[least],
            format!(
                "{:.3} N m; weighted {:.3}, null space {:.3}",
                kim.norm_Nm[0], kim.norm_Nm[1], kim.norm_Nm[2]
            ),
        ),
        Conclusion::judged(
            ("Section 4.1", "high torque at the small floating actuator will cause saturation"),
            "under least norm the floating motor of the figures passes its limit; so does one in \
             at least half of the pushes at random poses",
            &[peak(LEAST, 1) > limit_Nm, 2 * story.over_least_norm >= story.pushes],
            format!(
                "{:.3} N m of {limit_Nm}; {:.0} % of {} random pushes",
                peak(LEAST, 1),
                percent(story.over_least_norm, story.pushes),
                story.pushes
            ),
        ),
        Conclusion::judged(
            ("Section 4.1", "weights make the floating torque smaller, enough to avoid saturation"),
            "in the figures' pose the floating torque falls below its limit; at random poses the \
             weights keep more than nine in ten feasible wrenches within the limits",
            &[peak(WEIGHTED, 1) < peak(LEAST, 1) && peak(WEIGHTED, 1) <= limit_Nm, weighted > 90.0],
            format!(
                "{:.3} to {:.3} N m; smaller at {:.0} % of random poses; within the limits: \
                 {percents}",
                peak(LEAST, 1),
                peak(WEIGHTED, 1),
                percent(story.lowered, story.pushes)
            ),
        ),
        Conclusion::judged(
            ("Section 4.2", "even with weights floating actuators still can be saturated"),
            "the floating motor of chain 2 passes its limit under weights",
            &[peak(WEIGHTED, 3) > limit_Nm],
            format!("{:.3} N m of {limit_Nm}", peak(WEIGHTED, 3)),
        ),
        Conclusion::judged(
            ("Section 4.2", "the burden goes to others without any additional torque saturation"),
            "in the figures' pose no other motor passes its limit; at random poses the one-joint \
             null space keeps more than nine in ten feasible wrenches within the limits",
            &[(peak(ONCE, 3) - limit_Nm).abs() < 1e-9 && quiet, once > 90.0],
            format!(
                "{:.3} N m, all others within; of {} random 20 N pushes with a saturated motor it \
                 mends {:.0} %, the exact solution {:.0} %; within the limits {once:.1} %",
                peak(ONCE, 3),
                story.over_weighted,
                percent(story.mended_once, story.over_weighted),
                percent(story.mended_exactly, story.over_weighted),
            ),
        ),
        Conclusion::judged(
            ("Section 4.2", "null space ensures avoidance of saturation with the desired force"),
            "the one-joint null space keeps every feasible wrench within the limits; at least it \
             keeps more of them than weights alone",
            &[once > 99.9, once > weighted],
            format!(
                "{once:.1} % against {weighted:.1} %; iterated {:.1} %, exact {:.1} %",
                solved_percent(kim, ITERATED),
                solved_percent(kim, EXACT)
            ),
        ),
    ]
}

fn resolution(kim: &Kim) -> Vec<Conclusion> {
    let [base, floating, both, wide] = &kim.resolutions[..] else { return Vec::new() };
    let figures = format!(
        "mean error {:.4} N, over their own range {:.4} (base alone {:.4}, floating alone {:.4}); \
         force in every direction {:.1} N ({:.1}, {:.1})",
        both.error_N[0],
        wide.error_N[0],
        base.error_N[0],
        floating.error_N[0],
        both.range_N,
        base.range_N,
        floating.range_N
    );
    let fine = [both, wide].map(|set| set.error_N[0] < 0.1 * base.error_N[0]);
    let strong = both.range_N > 2.0 * floating.range_N;
    vec![
        Conclusion::judged(
            ("Abstract", "two sets of actuators reflect force of high and low resolution"),
            "both sets together are ten times finer than the base motors alone, for forces up to \
             half of what the floating ones can give; and up to half of what both can; they give \
             twice the force of the floating ones alone",
            &[fine[0], fine[1], strong],
            figures.clone(),
        ),
        Conclusion::judged(
            ("Conclusion", "weights with the torque limit allow both resolutions"),
            "as above, all three, by steps: the coarser motors are rounded first, the finer ones \
             carry the rest; weights with the one-joint limit keep nine in ten feasible wrenches in \
             their limits",
            &[fine == [true; 2] && strong, solved_percent(kim, ONCE) > 90.0],
            format!("{figures}; {:.1} %", solved_percent(kim, ONCE)),
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::super::measure::measure;
    use super::*;
    use crate::analysis::papers::Verdict;
    use crate::analysis::papers::verdict::{verdict_on, well_formed};

    #[test]
    fn verdicts_turn_with_their_figures() {
        let kim = measure(150).unwrap();
        let all = conclusions(&kim);
        well_formed(&all);
        assert_eq!(verdict_on(&all, "the device is singularity-free"), Verdict::Confirmed);
        assert_eq!(verdict_on(&all, "the burden goes"), Verdict::InPart);
        let mut other = kim.clone();
        other.spreads[0].six[1] = 5000.0;
        other.peak_Nm[ONCE][1] = 0.5;
        other.peak_Nm[WEIGHTED][3] = 0.3;
        other.norm_Nm[WEIGHTED] = 0.0;
        other.mobility = 7;
        for set in [2, 3] {
            other.resolutions[set].error_N[0] = other.resolutions[0].error_N[0];
        }
        let turned = conclusions(&other);
        for begins in [
            "the device is singularity-free",
            "the burden goes",
            "even with weights",
            "the pseudo-inverse",
            "more actuators",
        ] {
            assert_eq!(verdict_on(&turned, begins), Verdict::NotConfirmed, "{begins}");
        }
        assert_eq!(verdict_on(&turned, "two sets of actuators"), Verdict::InPart);
        for level in &mut other.levels {
            level.solved = [level.feasible; 5];
        }
        assert_eq!(
            verdict_on(&conclusions(&other), "null space ensures"),
            Verdict::InPart,
            "no better than weights"
        );
    }
}

//! The conclusions of Cho 2005, sentence by sentence, judged by a run's figures.

mod wall;

use super::Cho;
use super::design::{HISTOGRAM, TABLE_I};
use super::table::PAPERS_LAW;
use crate::actuation::{Region, Strategy};
use crate::analysis::papers::Conclusion;
use crate::analysis::papers::page::tiny;

/// All of them, in the paper's order.
pub fn conclusions(cho: &Cho) -> Vec<Conclusion> {
    let mut all = limits(cho);
    all.extend(redundancy(cho));
    all.extend(optimisation(cho));
    all.extend(rule(cho));
    all.extend(wall::experiment(cho));
    all.extend(wall::optimised_wall(cho));
    all.extend(wall::closing(cho));
    all
}

fn limits(cho: &Cho) -> Vec<Conclusion> {
    let arm = &cho.arm;
    let kinds = [Region::Full, Region::Approximate, Region::NotDisplayable].map(Some);
    let names = arm.regions.map(|region| region.map_or("-", Region::name)).join(", ");
    vec![
        Conclusion::judged(
            ("Section 3.1", "desired forces are fully displayable, approximated, or not at all"),
            "the three desired forces of Figure 2 are classified so, in this order",
            &[arm.regions == kinds],
            format!("{names}; gamma of the second {:.1} deg", arm.gamma_deg),
        ),
        Conclusion::judged(
            ("Section 3.2", "hand in the pseudo friction cone: it becomes stuck regardless"),
            "of all directions of the hand, none inside the cone leaves a one-brake path out of \
             the wall, and every one outside does",
            &[arm.hands[0] > 0 && arm.hands[1] == 0 && arm.hands[2] == 0],
            format!(
                "{} and {} of {} directions contradict; the cone is set {}, the force in set {}",
                arm.hands[1], arm.hands[2], arm.hands[0], arm.cone[0], arm.cone[1]
            ),
        ),
        Conclusion::judged(
            ("Section 4", "gamma1 + gamma2 equals the size of the neighbouring set (Eq 5)"),
            "it holds for every motion of two brakes; and of the five-bar's four",
            &[arm.eq5_two < 1e-9, arm.eq5_four < 1e-9],
            format!(
                "largest error with two {} rad, smallest with four {:.2} rad",
                tiny(arm.eq5_two),
                arm.eq5_four
            ),
        ),
        Conclusion::judged(
            ("Section 4", "P_a grows as the angles differ: pi^2, 10 pi^2/9"),
            "both examples to 1e-12",
            &[(arm.P_a[0] - 1.0).abs() < 1e-12 && (arm.P_a[1] - 10.0 / 9.0).abs() < 1e-12],
            format!("{:.4} and {:.4} pi^2", arm.P_a[0], arm.P_a[1]),
        ),
    ]
}

fn redundancy(cho: &Cho) -> Vec<Conclusion> {
    let regions = &cho.regions;
    let three = regions.regions_per_set.iter().all(|count| *count == 3);
    vec![
        Conclusion::judged(
            ("Section 5.1", "the configuration is described by theta4 = -45 degrees"),
            "the linkage's own brake 4 stays where it is locked at theta4 = -45 deg",
            &[(regions.theta4_deg + 45.0).abs() < 0.01],
            format!("{:.3} deg", regions.theta4_deg),
        ),
        Conclusion::judged(
            ("Section 9, 1", "passive FME consists of three regions; eight are possible"),
            "eight sets of three neighbouring regions each; and they are those of the paper's list \
             as printed",
            &[regions.regions_per_set.len() == 8 && three, regions.listed[0] == 8],
            format!(
                "{} sets; {} of the list as printed, {} with R4- for R4+ in items 1 to 4",
                regions.regions_per_set.len(),
                regions.listed[0],
                regions.listed[1]
            ),
        ),
        Conclusion::judged(
            ("Section 9, 1", "the cone is the region opposite the desired force"),
            "a hand is in it exactly where it is in the cones of {1,2}, {1,4} and {2,3}, over 3600 \
             directions; and it is R1- - R2- for a force between R1+ and R2+",
            &[regions.common[0] > 0 && regions.common[1] == 0, regions.cones[3] == "R1- - R2-"],
            format!("{}; {} directions disagree", regions.cones[3], regions.common[1]),
        ),
        Conclusion::judged(
            ("Section 5.2", "the cone can be avoided by brakes 1 and 4"),
            "a hand beside the common region is in the cone of {2,3} and not in that of {1,4}",
            &[regions.avoided],
            format!("{} and {}", regions.cones[2], regions.cones[1]),
        ),
    ]
}

fn optimisation(cho: &Cho) -> Vec<Conclusion> {
    let designs = &cho.designs;
    let least = |k: usize| {
        designs
            .straight
            .front
            .iter()
            .map(|one| [one.GP_a, one.GP_f][k])
            .fold(f64::INFINITY, f64::min)
    };
    let own = designs.published.map_or([f64::NAN; 2], |one| [one.GP_a, one.GP_f]);
    let behind = [0, 1].map(|k| 100.0 * (own[k] / least(k) - 1.0));
    let better = |k: usize| designs.grids.iter().all(|grid| grid.means[1][k] < grid.means[0][k]);
    let [before, after] = designs.beta_deg;
    let counts = designs.grids.iter().map(|grid| grid.at_50_60);
    let (low, high) = counts.fold((f64::INFINITY, 0.0f64), |(l, h), n| (l.min(n), h.max(n)));
    let near = |n: f64| (n / HISTOGRAM[0] - 1.0).abs() < 0.1;
    let plausible = &designs.grids[..3];
    vec![
        Conclusion::judged(
            ("Table I", "GP_a and GP_f decrease by the optimization"),
            "both means are less after than before, under every grid tried",
            &[better(0), better(1)],
            format!("{} grids", designs.grids.len()),
        ),
        Conclusion::judged(
            ("Table I", "the design is the optimum of its class"),
            "a global search over the same class finds nothing more than 1 % better in GP_a; \
             nothing more than 1 % better in GP_f",
            &[behind[0] < 1.0, behind[1] < 1.0],
            format!(
                "{:.1} % and {:.1} % behind {:.3} and {:.3}, the least of each alone",
                behind[0],
                behind[1],
                least(0),
                least(1)
            ),
        ),
        Conclusion::judged(
            ("Section 6", "almost 2500 of 3813 points between 50 and 60 degrees"),
            "2250 to 2750 under the area-uniform, the polar or the radial grid; the range of the \
             largest beta is narrower after than before",
            &[
                plausible.iter().any(|grid| near(grid.at_50_60)),
                after[1] - after[0] < before[1] - before[0],
            ],
            format!(
                "{:.0}, {:.0}, {:.0}; {low:.0} to {high:.0} over all grids tried",
                plausible[0].at_50_60, plausible[1].at_50_60, plausible[2].at_50_60
            ),
        ),
        Conclusion::judged(
            (
                "Section 9, 2",
                "reference forces more evenly distributed, displayable region broadened",
            ),
            "smallest beta is larger and largest beta smaller than before; the narrowest passive \
             set is wider",
            &[
                after[0] > before[0] && after[1] < before[1],
                designs.least_set_deg[1] > designs.least_set_deg[0],
            ],
            format!(
                "beta {:.1} to {:.1} deg, was {:.1} to {:.1}; narrowest set {:.0} deg, was {:.0}",
                after[0],
                after[1],
                before[0],
                before[1],
                designs.least_set_deg[1],
                designs.least_set_deg[0]
            ),
        ),
        Conclusion::judged(
            ("Section 9", "maximum angles for approximation and cone significantly decreased"),
            "the largest beta falls by a quarter or more, as published (112.9 to 79.7)",
            &[after[1] < 0.75 * before[1]],
            format!(
                "{:.1} to {:.1} deg; paper {} to {}",
                before[1], after[1], TABLE_I[0][3], TABLE_I[1][3]
            ),
        ),
    ]
}

fn rule(cho: &Cho) -> Vec<Conclusion> {
    let wall = &cho.wall;
    let [picks, literal, mended, none] = cho.regions.coercive;
    let slide = |law| wall.slide(law);
    let nearest = slide(Strategy::NearestReference);
    let coercive = slide(PAPERS_LAW);
    let figures = [nearest, coercive].map(|one| one.map(|one| one.figures).unwrap_or_default());
    let [nearest, coercive] = figures;
    vec![
        Conclusion::judged(
            ("Section 7", "Q3 causes further penetration, Q2 is directed out"),
            "on the stretch of R2+ the path of brake 2 leads out of the wall and that of brake 3 \
             into it",
            &[wall.out == [true, false]],
            format!("brake 2 {}, brake 3 {}", way(wall.out[0]), way(wall.out[1])),
        ),
        Conclusion::judged(
            ("Section 7", "phi_R > phi_d indicates whether a path is directed out"),
            "of random hands that press into walls, no pick as printed leads into the wall; and \
             none with phi_R <= pi required, too",
            &[literal == 0, mended == 0],
            format!(
                "as printed {literal} of {picks} lead in; with the condition {mended}, and in \
                 {none} nothing is picked"
            ),
        ),
        Conclusion::judged(
            ("Abstract", "the coercive scheme avoids unsmooth motion along the wall"),
            "on the paper's wall it is stuck for less than half of the time of the nearest \
             reference force; its rms jerk is at most 40 m/s^3",
            &[
                coercive.stuck_share() < 0.5 * nearest.stuck_share(),
                coercive.jerk_rms_m_per_s3 <= 40.0,
            ],
            format!(
                "stuck {:.0} % against {:.0} %; jerk {:.0} against {:.0} m/s^3",
                100.0 * coercive.stuck_share(),
                100.0 * nearest.stuck_share(),
                coercive.jerk_rms_m_per_s3,
                nearest.jerk_rms_m_per_s3
            ),
        ),
    ]
}

fn way(out: bool) -> &'static str {
    if out { "out" } else { "in" }
}

#[cfg(test)]
mod tests {
    use super::super::wall::GAMMA_MAX_DEG;
    use super::super::{arm, design, regions};
    use super::*;
    use crate::analysis::papers::Verdict::{Confirmed, InPart, NotConfirmed};
    use crate::analysis::papers::verdict::{verdict_on, well_formed};

    /// Everything but the table.
    fn measured() -> Cho {
        Cho {
            quick: true,
            arm: arm::measure().unwrap(),
            regions: regions::measure().unwrap(),
            designs: design::measure(true, &|| ()).unwrap(),
            wall: super::super::wall::measure().unwrap(),
            rows: Vec::new(),
        }
    }

    #[test]
    fn verdicts_turn_with_their_figures() {
        let cho = measured();
        let all = conclusions(&cho);
        well_formed(&all);
        for (begins, verdict) in [
            ("desired forces", Confirmed),
            ("passive FME", InPart),
            ("reference forces more evenly", Confirmed),
            ("Q3 causes", Confirmed),
            ("the motion requires", NotConfirmed),
            ("phi_R > phi_d", InPart),
            ("maximum angles", Confirmed),
        ] {
            assert_eq!(verdict_on(&all, begins), verdict, "{begins}");
        }
        let mut other = cho.clone();
        other.arm.regions[0] = None;
        other.regions.listed[0] = 8;
        other.regions.coercive[1] = 0;
        other.designs.beta_deg[1] = [3.0, 120.0];
        other.wall.out = [false; 2];
        other.wall.common_drag.reverse();
        let turned = conclusions(&other);
        for (begins, verdict) in [
            ("desired forces", NotConfirmed),
            ("passive FME", Confirmed),
            ("reference forces more evenly", InPart),
            ("Q3 causes", NotConfirmed),
            ("the motion requires", InPart),
            ("phi_R > phi_d", Confirmed),
            ("maximum angles", NotConfirmed),
        ] {
            assert_eq!(verdict_on(&turned, begins), verdict, "{begins}");
        }
    }

    #[test]
    fn the_experiment_is_judged_by_its_slides() {
        let mut cho = measured();
        let before = conclusions(&cho);
        assert_eq!(verdict_on(&before, "along the wall R2+"), Confirmed);
        for slide in &mut cho.wall.slides {
            slide.leaders = "R4 R1 R2".into();
            slide.correlation = 0.0;
            slide.steps_N = [1.0, 2.0];
            slide.gamma_max_deg = GAMMA_MAX_DEG;
            slide.desired_N = 1.0;
        }
        let after = conclusions(&cho);
        assert_eq!(verdict_on(&after, "along the wall R2+"), InPart);
        assert_eq!(verdict_on(&after, "F_hy increases"), NotConfirmed);
        assert_eq!(verdict_on(&after, "a change in the reference"), NotConfirmed);
        assert_eq!(verdict_on(&after, "maximum 65.8"), InPart);
        assert_eq!(verdict_on(&after, "the desired force is almost"), NotConfirmed);
    }
}

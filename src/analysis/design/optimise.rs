//! Better five-bars: the published method and a global one, over the same utility function.
//!
//! The utility is `w_a GP_a + w_f GP_f` over the area-uniform mean of an annulus, to be made
//! small; the variables are those of [`super::linkages`], as shares of their ranges.
//!
//! * *simplex*, as Cho 2005 section 6: Nelder & Mead with exterior penalties on the bounds that
//!   grow from round to round. A local method: it ends in the valley where it began.
//! * *global*: from every start a particle swarm within the bounds, then Nelder & Mead from the
//!   best particle.
//!
//! A design that does not close, or does not reach the whole annulus in regular postures, costs
//! more than any that does, and the more the further it is from doing so: both methods find
//! their way back. Starts are independent, each with its own random numbers, so the result
//! depends on the seed and not on how many threads work. The search uses few radii; what is
//! returned was evaluated anew on the fine grid.

use argmin::core::{CostFunction, Error, Executor};
use argmin::solver::neldermead::NelderMead;
use argmin::solver::particleswarm::ParticleSwarm;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::global::means_about_base;
use super::grid::{Annulus, CHO_WORKSPACE_M};
use super::linkages::{DesignBounds, VARIABLES, Variables, build, variables_of, with_variables};
use crate::mechanism::{FiveBarParameters, KinematicsError, Mechanism, ParameterError};

/// More than any mean of P_a or P_f: (2 pi)^2 for each.
const INFEASIBLE: f64 = 100.0;
/// Per metre or share that a design fails by.
const SLOPE: f64 = 100.0;

const PARTICLES: usize = 32;
const SWARM_ROUNDS: u64 = 60;
const POLISH_ROUNDS: u64 = 250;
/// Exterior penalty factors, one after the other.
const PENALTIES: [f64; 5] = [1.0, 10.0, 100.0, 1e3, 1e4];

/// How to search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Nelder & Mead with exterior penalties (the published one).
    Simplex,
    /// Particle swarms, then Nelder & Mead.
    Global,
}

/// What to make small, where, within what.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DesignProblem {
    /// The class: signs, and l5.
    pub class: FiveBarParameters,
    /// Least and most of each variable.
    pub bounds: DesignBounds,
    /// Radii of the workspace.
    pub workspace_m: [f64; 2],
    /// Of GP_a and GP_f.
    pub weights: [f64; 2],
}

/// How much to search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effort {
    /// The method.
    pub method: Method,
    /// Independent starts, at least one.
    pub starts: usize,
    /// Radii of the annulus while searching.
    pub radii: usize,
    /// Of the random numbers.
    pub seed: u64,
}

/// A design with its indices on the fine area-uniform grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Design {
    /// The linkage.
    pub parameters: FiveBarParameters,
    /// Mean P_a, rad^2.
    pub GP_a: f64,
    /// Mean P_f, rad.
    pub GP_f: f64,
}

impl DesignProblem {
    /// The paper's problem for a class, with these weights.
    pub fn published(class: FiveBarParameters, weights: [f64; 2]) -> Self {
        let (bounds, workspace_m) = (DesignBounds::default(), CHO_WORKSPACE_M);
        Self { class, bounds, workspace_m, weights }
    }

    /// The grid of the returned figures.
    pub fn grid(&self) -> Annulus {
        let [least_m, most_m] = self.workspace_m;
        Annulus::area(least_m, most_m)
    }

    /// Weighted mean of the means, or what failing costs: more, whatever the weights.
    pub fn cost(&self, variables: &Variables, radii: usize) -> f64 {
        let device = match build(&with_variables(&self.class, variables)) {
            Ok(device) => device,
            Err(ParameterError::CannotClose { value, most, .. }) => {
                return 3.0 * INFEASIBLE + SLOPE * (value - most);
            }
            Err(_) => return 10.0 * INFEASIBLE,
        };
        let annulus = Annulus { radii, ..self.grid() };
        match means_about_base(&device, annulus) {
            Ok([GP_a, GP_f]) => self.share(0) * GP_a + self.share(1) * GP_f,
            Err((_, KinematicsError::NotFinite)) => 10.0 * INFEASIBLE,
            Err(_) => INFEASIBLE + SLOPE * missed_m(&device, annulus),
        }
    }

    /// A design on the fine grid; `None` where it does not reach all of it.
    pub fn evaluate(&self, variables: &Variables) -> Option<Design> {
        let parameters = with_variables(&self.class, variables);
        let [GP_a, GP_f] = means_about_base(&build(&parameters).ok()?, self.grid()).ok()?;
        Some(Design { parameters, GP_a, GP_f })
    }

    /// A weight over the sum of both.
    fn share(&self, which: usize) -> f64 {
        self.weights[which] / (self.weights[0] + self.weights[1])
    }

    /// The weighted sum of a design.
    pub fn utility(&self, design: &Design) -> f64 {
        self.weights[0] * design.GP_a + self.weights[1] * design.GP_f
    }
}

/// Mean distance by which the places of an annulus are missed, and a share for singular ones.
fn missed_m(device: &dyn Mechanism, annulus: Annulus) -> f64 {
    let short_m = |error| match error {
        KinematicsError::Unreachable { needed_m, min_m, max_m } => {
            1e-3 + (needed_m - max_m).max(min_m - needed_m).max(0.0)
        }
        _ => 1e-3,
    };
    let places = super::grid::Grid::Annulus(annulus.folded()).places();
    let missed = places.filter_map(|place| device.posture_at(&place.p_BH).err()).map(short_m);
    missed.sum::<f64>() / annulus.radii as f64
}

/// The utility of shares, with what leaving the bounds costs; the solvers minimise it.
#[derive(Clone)]
struct Utility<'a> {
    problem: &'a DesignProblem,
    radii: usize,
    /// Exterior penalty; `None`: shares outside are moved to the bounds instead.
    penalty: Option<f64>,
}

impl Utility<'_> {
    fn variables(&self, shares: &[f64]) -> Variables {
        let inside: Vec<f64> = shares.iter().map(|share| share.clamp(0.0, 1.0)).collect();
        self.problem.bounds.at(if self.penalty.is_some() { shares } else { &inside })
    }
}

impl CostFunction for Utility<'_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, shares: &Vec<f64>) -> Result<f64, Error> {
        let outside: f64 = shares.iter().map(|s| (s - s.clamp(0.0, 1.0)).powi(2)).sum();
        let cost = self.problem.cost(&self.variables(shares), self.radii);
        Ok(cost + self.penalty.unwrap_or(1.0) * outside)
    }
}

/// The best design of all starts; `None` where no start led to one that reaches its workspace.
/// `progress` is told of every start that is done.
pub fn optimise(
    problem: &DesignProblem,
    effort: &Effort,
    progress: &(dyn Fn() + Sync),
) -> Option<Design> {
    let starts: Vec<Option<Design>> = (0..effort.starts.max(1) as u64)
        .into_par_iter()
        .map(|start| {
            let found = from_start(problem, effort, start);
            progress();
            found
        })
        .collect();
    best(problem, starts.into_iter().flatten())
}

/// The simplex method from the variables of one given design, as the paper began it.
pub fn simplex_from(
    problem: &DesignProblem,
    start: &FiveBarParameters,
    radii: usize,
) -> Option<Design> {
    finish(problem, simplex(problem, radii, problem.bounds.shares(&variables_of(start))))
}

/// Designs of which none is worse than another in both means, by ascending GP_a: the best of
/// each of `steps` weightings between GP_a alone and GP_f alone, those that are beaten left
/// out. Weighted sums find only the convex part of a front.
pub fn pareto(
    problem: &DesignProblem,
    effort: &Effort,
    steps: usize,
    progress: &(dyn Fn() + Sync),
) -> Vec<Design> {
    let found = |step: usize| {
        let share = step as f64 / (steps.max(2) - 1) as f64;
        let weighted = DesignProblem { weights: [1.0 - share, 4.0 * share], ..*problem };
        optimise(
            &weighted,
            &Effort { seed: effort.seed.wrapping_add(step as u64), ..*effort },
            progress,
        )
    };
    let all: Vec<Design> = (0..steps.max(2)).filter_map(found).collect();
    undominated(all)
}

/// The designs that no other beats in one mean and equals or beats in the other.
pub fn undominated(mut designs: Vec<Design>) -> Vec<Design> {
    designs.sort_by(|a, b| a.GP_a.total_cmp(&b.GP_a).then(a.GP_f.total_cmp(&b.GP_f)));
    let mut least_f = f64::INFINITY;
    designs.retain(|design| {
        let kept = design.GP_f < least_f;
        least_f = least_f.min(design.GP_f);
        kept
    });
    designs
}

fn best(problem: &DesignProblem, designs: impl Iterator<Item = Design>) -> Option<Design> {
    designs.min_by(|a, b| problem.utility(a).total_cmp(&problem.utility(b)))
}

fn from_start(problem: &DesignProblem, effort: &Effort, start: u64) -> Option<Design> {
    let mut random = ChaCha8Rng::seed_from_u64(effort.seed);
    random.set_stream(start);
    let shares = match effort.method {
        Method::Simplex => {
            let shares = (0..VARIABLES).map(|_| random.random()).collect();
            simplex(problem, effort.radii, shares)
        }
        Method::Global => {
            let shares = swarm(problem, effort.radii, random);
            let utility = |radii| Utility { problem, radii, penalty: None };
            // A simplex that has shrunk too early gets a second chance, on a finer grid.
            let first = nelder_mead(utility(effort.radii), shares, 0.08);
            nelder_mead(utility(4 * effort.radii), first, 0.03)
        }
    };
    finish(problem, shares)
}

/// The design at the nearest shares within the bounds.
fn finish(problem: &DesignProblem, shares: Vec<f64>) -> Option<Design> {
    let inside: Vec<f64> = shares.into_iter().map(|share| share.clamp(0.0, 1.0)).collect();
    problem.evaluate(&problem.bounds.at(&inside))
}

/// The published method: each round begins where the one with the smaller penalty ended.
fn simplex(problem: &DesignProblem, radii: usize, start: Vec<f64>) -> Vec<f64> {
    PENALTIES.into_iter().fold(start, |shares, penalty| {
        nelder_mead(Utility { problem, radii, penalty: Some(penalty) }, shares, 0.1)
    })
}

fn nelder_mead(utility: Utility, from: Vec<f64>, edge: f64) -> Vec<f64> {
    let mut corners = vec![from.clone()];
    for i in 0..from.len() {
        let mut corner = from.clone();
        // Into the range, not out of it.
        corner[i] += if corner[i] > 0.5 { -edge } else { edge };
        corners.push(corner);
    }
    let Ok(solver) = NelderMead::new(corners).with_sd_tolerance(1e-9) else { return from };
    let run = Executor::new(utility, solver)
        .configure(|state| state.max_iters(POLISH_ROUNDS))
        .timer(false)
        .run();
    run.ok().and_then(|done| done.state.best_param).unwrap_or(from)
}

fn swarm(problem: &DesignProblem, radii: usize, random: ChaCha8Rng) -> Vec<f64> {
    let utility = Utility { problem, radii, penalty: None };
    let (least, most) = (vec![0.0; VARIABLES], vec![1.0; VARIABLES]);
    let middle = vec![0.5; VARIABLES];
    let solver = ParticleSwarm::new((least, most), PARTICLES).with_rng_generator(random);
    let run = Executor::new(utility, solver)
        .configure(|state| state.max_iters(SWARM_ROUNDS))
        .timer(false)
        .run();
    let found = run.ok().and_then(|done| done.state.best_individual);
    found.map_or(middle, |particle| particle.position)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mechanism::fixtures;

    const CHEAP: Effort = Effort { method: Method::Global, starts: 4, radii: 13, seed: 1 };

    fn quiet() {}

    #[test]
    fn any_seed_finds_a_design_at_least_as_good_as_the_published_one() {
        for seed in [2, 3] {
            let problem = DesignProblem::published(fixtures::CHO[0], [1.0, 10.0]);
            let found = optimise(&problem, &Effort { seed, ..CHEAP }, &quiet).unwrap();
            let published = problem.evaluate(&variables_of(&fixtures::CHO[0])).unwrap();
            assert!(
                found.GP_a <= published.GP_a + 0.02 && found.GP_f < published.GP_f,
                "{found:?}"
            );
            assert!(found.GP_f <= 0.98 && found.GP_f > 0.97, "{found:?}");
            let within = problem.bounds.shares(&variables_of(&found.parameters));
            assert!(within.iter().all(|share| (-1e-12..=1.0 + 1e-12).contains(share)), "{found:?}");
        }
    }

    #[test]
    fn crossed_tendons_are_better_in_both_means() {
        let problem = DesignProblem::published(fixtures::CHO[2], [1.0, 1.0]);
        let found = optimise(&problem, &CHEAP, &quiet).unwrap();
        assert!(found.GP_a <= 5.13 && found.GP_f <= 0.97, "{found:?}");
        assert!(found.GP_a > 5.0 && found.GP_f > 0.9, "{found:?}");
        assert_eq!(found.parameters.tendons, -1);
    }

    #[test]
    fn the_published_method_improves_on_the_papers_start_as_the_paper_did() {
        let problem = DesignProblem::published(fixtures::CHO[0], [1.0, 1.0]);
        let start = problem.evaluate(&variables_of(&fixtures::CHO[1])).unwrap();
        let found = simplex_from(&problem, &fixtures::CHO[1], 31).unwrap();
        assert!(found.GP_a < start.GP_a - 0.5 && found.GP_f < start.GP_f - 0.2, "{found:?}");
    }

    #[test]
    fn the_result_depends_on_the_seed_and_not_on_the_threads() {
        let problem = DesignProblem::published(fixtures::CHO[0], [1.0, 1.0]);
        let effort = Effort { starts: 3, radii: 7, ..CHEAP };
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| optimise(&problem, &effort, &quiet)).unwrap()
        };
        assert_eq!(with(1), with(3));
        let other = optimise(&problem, &Effort { seed: 9, ..effort }, &quiet).unwrap();
        assert_ne!(with(1).parameters, other.parameters);
    }

    #[test]
    fn designs_that_cannot_reach_cost_more_than_any_that_can_and_less_the_nearer_they_are() {
        let problem = DesignProblem::published(fixtures::CHO[0], [1.0, 1.0]);
        let good = problem.cost(&variables_of(&fixtures::CHO[1]), 31);
        let short = |l4: f64| problem.cost(&[0.3, 0.1, 0.25, l4, 0.5, 0.5], 31);
        assert!(good < INFEASIBLE && short(0.2) > INFEASIBLE, "{good} {}", short(0.2));
        assert!(short(0.22) < short(0.2) && short(0.2) < short(0.18));
        let open = problem.cost(&[0.3, 0.09, 0.1, 0.1, 0.5, 0.5], 31);
        assert!(open >= 3.0 * INFEASIBLE, "{open}");
        assert!(problem.evaluate(&[0.3, 0.09, 0.1, 0.1, 0.5, 0.5]).is_none());
    }

    #[test]
    fn a_front_holds_no_design_that_another_beats() {
        let design = |GP_a: f64, GP_f: f64| Design { parameters: fixtures::CHO[0], GP_a, GP_f };
        let kept = undominated(vec![
            design(5.3, 0.9),
            design(5.2, 1.0),
            design(5.4, 0.95),
            design(5.2, 1.1),
        ]);
        assert_eq!(kept, [design(5.2, 1.0), design(5.3, 0.9)]);
    }

    #[test]
    fn weights_count_by_their_ratio_alone() {
        let shares = [0.35, 0.2, 0.6, 0.7, 0.4, 0.5];
        let cost = |weights| {
            let problem = DesignProblem::published(fixtures::CHO[1], weights);
            problem.cost(&problem.bounds.at(&shares), 31)
        };
        assert!((cost([1.0, 10.0]) - cost([100.0, 1000.0])).abs() < 1e-9);
        let best = variables_of(&fixtures::CHO[1]);
        for weights in [[1000.0, 1.0], [0.0, 1000.0]] {
            let problem = DesignProblem::published(fixtures::CHO[1], weights);
            assert!(problem.cost(&best, 31) < INFEASIBLE);
        }
    }
}

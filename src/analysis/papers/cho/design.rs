//! Table I and Figure 9 of Cho 2005: the two means over many grids, and better designs.
//!
//! P_a and P_f of a coaxial five-bar depend on the handle's distance r from the base alone, so a
//! grid is a weighting of radii. The paper does not state its own. Beside plausible ones this
//! looks for *any* weighting, however odd, under which all five published numbers come out
//! together (Frank & Wolfe's method with away steps in the convex hull of the radii).

mod grids;

use super::{ChoError, DEVICES};
use crate::analysis::design::grid::CHO_WORKSPACE_M;
use crate::analysis::design::linkages::{five_bar_of, variables_of};
use crate::analysis::design::optimise::{
    Design, DesignProblem, Effort, Method, optimise, simplex_from, undominated,
};
use crate::analysis::design::{Annulus, GlobalIndices, Grid};
use crate::config::DeviceDefinition;
use crate::mechanism::{FiveBarParameters, Rays};
use crate::notation::{ActuatorVector, PlaneVector};
use grids::{AtRadius, any_weighting, at_radius, best_exponent, grids, off_percent};

/// Table I: GP_a, GP_f, smallest and largest beta in degrees, before and after.
pub(super) const TABLE_I: [[f64; 4]; 2] = [[7.509, 1.614, 4.0, 112.9], [5.310, 1.035, 21.1, 79.7]];
/// Section 6: "almost 2500 out of the 3813 measurement points" at 50 to 60 degrees.
pub(super) const HISTOGRAM: [f64; 2] = [2500.0, 3813.0];

/// Weights of GP_a and GP_f that are searched.
const WEIGHTS: [[f64; 2]; 7] =
    [[1.0, 0.0], [4.0, 1.0], [1.0, 1.0], [1.0, 2.0], [1.0, 4.0], [1.0, 10.0], [0.0, 1.0]];

/// Both means of both designs under a grid.
#[derive(Clone, Debug)]
pub struct GridRow {
    /// The grid, in words.
    pub name: String,
    /// GP_a and GP_f, before and after.
    pub means: [[f64; 2]; 2],
    /// Places of 3813 whose largest beta is 50 to 60 degrees, after.
    pub at_50_60: f64,
}

/// What the searches found in a class.
#[derive(Clone, Debug)]
pub struct Found {
    /// By the published method from the published start, equal weights.
    pub simplex: Option<Design>,
    /// The front of the global searches, GP_a first.
    pub front: Vec<Design>,
}

/// What this run finds of Table I.
#[derive(Clone, Debug)]
pub struct Designs {
    /// Extremes of beta in degrees, before and after.
    pub beta_deg: [[f64; 2]; 2],
    /// Narrowest passive set over the workspace, degrees, before and after.
    pub least_set_deg: [f64; 2],
    /// Grids: area-uniform, polar, radial first.
    pub grids: Vec<GridRow>,
    /// The exponent n of a weight r^n under which a design's means come nearest, and how near
    /// (rms per cent), before and after.
    pub exponents: [[f64; 2]; 2],
    /// How near any weighting comes to all five numbers (relative), and its shares of bands of
    /// radii as wide as 5 cm.
    pub any: (f64, [f64; 6]),
    /// The published design on the area-uniform grid.
    pub published: Option<Design>,
    /// The published class.
    pub straight: Found,
    /// Crossed tendons.
    pub crossed: Found,
    /// Strongest over weakest reference force along the radii, after: least and most.
    pub strength: [f64; 2],
}

impl GridRow {
    /// Root mean square of the relative differences to Table I, per cent: before, after.
    pub fn off_percent(&self) -> [f64; 2] {
        [0, 1].map(|k| off_percent(self.means[k], k))
    }
}

/// Starts of all searches.
pub(super) fn starts(quick: bool) -> u64 {
    2 * WEIGHTS.len() as u64 * starts_each(quick) as u64
}

fn starts_each(quick: bool) -> usize {
    if quick { 1 } else { 6 }
}

pub(super) fn measure(quick: bool, done: &(dyn Fn() + Sync)) -> Result<Designs, ChoError> {
    let devices = [DeviceDefinition::load(DEVICES[0])?, DeviceDefinition::load(DEVICES[1])?];
    let [least_m, most_m] = CHO_WORKSPACE_M;
    let fine: Vec<AtRadius> = (0..=1200)
        .map(|k| at_radius(&devices, least_m + (most_m - least_m) * f64::from(k) / 1200.0))
        .collect();
    let extremes = [0, 1].map(|k| {
        let grid = Grid::Annulus(Annulus::area(least_m, most_m));
        let mechanism = devices[k].mechanism.as_ref();
        let found = GlobalIndices::over(mechanism, &ActuatorVector::repeat(20.0), &grid);
        found.beta_rad.map(f64::to_degrees)
    });
    let parameters = |device: &DeviceDefinition| five_bar_of(&device.parameters);
    let (start, class) = (parameters(&devices[0]), parameters(&devices[1]));
    let crossed = parameters(&DeviceDefinition::load("cho-2005-crossed")?);
    let search = |class: Option<FiveBarParameters>| {
        class.zip(start).map_or(Found { simplex: None, front: Vec::new() }, |(class, start)| {
            let start = FiveBarParameters { tendons: class.tendons, ..start };
            searched(class, start, quick, done)
        })
    };
    let published = class.and_then(|class| {
        DesignProblem::published(class, [1.0, 1.0]).evaluate(&variables_of(&class))
    });
    Ok(Designs {
        beta_deg: extremes,
        least_set_deg: [0, 1].map(|k| least_set_deg(&devices[k])),
        grids: grids(&devices, &fine),
        exponents: [0, 1].map(|k| best_exponent(&fine, k)),
        any: any_weighting(&fine),
        published,
        straight: search(class),
        crossed: search(crossed),
        strength: strength(&devices[1]),
    })
}

fn searched(
    class: FiveBarParameters,
    start: FiveBarParameters,
    quick: bool,
    done: &(dyn Fn() + Sync),
) -> Found {
    let radii = if quick { 13 } else { 31 };
    let effort = Effort { method: Method::Global, starts: starts_each(quick), radii, seed: 1 };
    let problem = |weights| DesignProblem::published(class, weights);
    let front = WEIGHTS.iter().filter_map(|weights| optimise(&problem(*weights), &effort, done));
    Found {
        front: undominated(front.collect()),
        simplex: simplex_from(&problem([1.0, 1.0]), &start, radii),
    }
}

/// Narrowest of the passive sets anywhere: three neighbouring regions.
fn least_set_deg(device: &DeviceDefinition) -> f64 {
    let at = |k: i32| {
        let place = PlaneVector::new(0.2 + 1e-3 * f64::from(k), 0.0, 0.0);
        let posture = device.mechanism.posture_at(&place).ok()?;
        let rays = Rays::of(&posture.reference, 4)?;
        // What three neighbours leave of half a turn is the fourth.
        Some(180.0 - rays.P_f().to_degrees())
    };
    (0..=300).filter_map(at).fold(f64::INFINITY, f64::min)
}

/// |R| of the strongest over the weakest brake, least and most over the radii.
fn strength(device: &DeviceDefinition) -> [f64; 2] {
    let at = |k: i32| {
        let place = PlaneVector::new(0.2 + 1e-3 * f64::from(k), 0.0, 0.0);
        let R = device.mechanism.posture_at(&place).ok()?.reference;
        let norms = (0..4).map(|i| R.column(i).xy().norm());
        let (least, most) = norms.fold((f64::INFINITY, 0.0f64), |(l, m), n| (l.min(n), m.max(n)));
        Some(most / least)
    };
    let all = (0..=300).filter_map(at);
    let (least, most) = all.fold((f64::INFINITY, 0.0f64), |(l, m), s| (l.min(s), m.max(s)));
    [least, most]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extremes_are_the_papers_and_the_means_those_of_another_implementation() {
        let found = measure(true, &|| ()).unwrap();
        for (own, printed) in found.beta_deg.iter().zip(TABLE_I) {
            assert!((own[0] - printed[2]).abs() < 0.11 && (own[1] - printed[3]).abs() < 0.11);
        }
        let expected = [[[6.786, 1.398], [5.237, 1.019]], [[6.610, 1.334], [5.297, 1.042]]];
        for (grid, expected) in found.grids.iter().zip(expected) {
            for (own, expected) in grid.means.iter().flatten().zip(expected.iter().flatten()) {
                assert!((own - expected).abs() < 1.5e-3, "{grid:?}");
            }
        }
        let none_fits = found.grids.iter().all(|grid| {
            let [before, after] = grid.off_percent();
            before > 1.0 || after > 1.0
        });
        assert!(none_fits, "no grid was thought to give both designs' means: {:?}", found.grids);
        assert!(found.any.0 < 1e-3, "{:?}", found.any);
        assert!((found.any.1.iter().sum::<f64>() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn the_searches_are_no_worse_than_the_published_design() {
        let found = measure(true, &|| ()).unwrap();
        let published = found.published.unwrap();
        let best = |front: &[Design], of: fn(&Design) -> f64| {
            front.iter().map(of).fold(f64::INFINITY, f64::min)
        };
        assert!(best(&found.straight.front, |d| d.GP_a) < published.GP_a);
        assert!(best(&found.crossed.front, |d| d.GP_a) < best(&found.straight.front, |d| d.GP_a));
    }
}

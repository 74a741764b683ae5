//! The workspace of a linkage in its working mode: where it reaches, and where it is singular.
//!
//! Marching squares over a grid in B at one turn of the handle, metres. Two curves are
//! followed: the border of what is reachable, whose crossings with the grid are bisected, and
//! inside it the loci where the margin of the posture falls to zero, whose crossings are the
//! ends of a golden-section search. Both come as plain points. Detail finer than a cell is
//! missed; the points themselves are exact to a millionth of one. Derived here; any linkage.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;

use crate::mechanism::{KinematicsError, Mechanism};
use crate::notation::PlaneVector;

/// A margin that a search brings below this is zero there: a search that ends beside a locus,
/// at the end of its edge, stays above it unless it is as near as the search is exact.
const ZERO_MARGIN: f64 = 1e-6;

/// A margin this large at both ends of an edge and in its middle is not zero in between, on a
/// grid of a few dozen cells: margins change by about one over a link's length.
const SAFE_MARGIN: f64 = 0.35;

/// Rays and steps of the search for the furthest place.
const RAYS: usize = 72;
const STEPS: usize = 160;

/// A curve in B.
pub type Curve = Vec<[f64; 2]>;

/// What [`workspace`] found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Workspace {
    /// Closed curves around what is reachable: counter-clockwise around a region, clockwise
    /// around a hole. The last point is joined to the first.
    pub outlines: Vec<Curve>,
    /// Where two links are in line inside the outlines; open, or closed with the first point
    /// repeated.
    pub singular: Vec<Curve>,
}

impl Workspace {
    /// What the outlines enclose, m^2.
    pub fn area_m2(&self) -> f64 {
        self.outlines.iter().map(signed_area_m2).sum()
    }
}

/// The workspace at `phi_rad`, which only a device of three freedoms reads, on a square grid of
/// `cells` to a side (at least 4) that just holds it.
pub fn workspace(mechanism: &dyn Mechanism, phi_rad: f64, cells: usize) -> Workspace {
    let margin = |[x, y]: [f64; 2]| margin_at(mechanism, &PlaneVector::new(x, y, phi_rad));
    let (grid, corners) = surveyed(mechanism, &margin, cells);
    Workspace {
        outlines: grid.outlines(&corners, &margin),
        singular: grid.singular(&corners, &margin),
    }
}

/// The outlines alone, at a tenth of the cost.
pub fn outlines(mechanism: &dyn Mechanism, phi_rad: f64, cells: usize) -> Vec<Curve> {
    let margin = |[x, y]: [f64; 2]| margin_at(mechanism, &PlaneVector::new(x, y, phi_rad));
    let (grid, corners) = surveyed(mechanism, &margin, cells);
    grid.outlines(&corners, &margin)
}

/// The margin at every corner of a grid.
type Survey = Vec<Vec<Option<f64>>>;

fn surveyed(
    mechanism: &dyn Mechanism,
    margin: &impl Fn([f64; 2]) -> Option<f64>,
    cells: usize,
) -> (Grid, Survey) {
    let cells = cells.max(4);
    let half_m = furthest_m(mechanism, margin) * (1.0 + 2.0 / cells as f64);
    let grid = Grid { half_m, cells };
    let row = |row| (0..=cells).map(|column| margin(grid.corner(column, row))).collect();
    let corners = (0..=cells).map(row).collect();
    (grid, corners)
}

/// `None`: out of reach.
fn margin_at(mechanism: &dyn Mechanism, p_BH: &PlaneVector) -> Option<f64> {
    match mechanism.posture_at(p_BH) {
        Ok(posture) => Some(posture.margin),
        Err(KinematicsError::Singular { margin, .. }) => Some(margin),
        Err(_) => None,
    }
}

/// Some distance that nothing beyond is reachable at, from a coarse search that begins well
/// outside of what is reached at every bearing.
fn furthest_m(mechanism: &dyn Mechanism, margin: &impl Fn([f64; 2]) -> Option<f64>) -> f64 {
    let mut search_m = 4.0 * mechanism.reach_m().1;
    let mut found_m = 0.0_f64;
    for _ in 0..4 {
        for ray in 0..RAYS {
            let (sin, cos) = (TAU * ray as f64 / RAYS as f64).sin_cos();
            let outwards = (1..=STEPS).rev().map(|step| search_m * step as f64 / STEPS as f64);
            let reached = |r_m: &f64| margin([r_m * cos, r_m * sin]).is_some();
            found_m =
                found_m.max(outwards.take_while(|r_m| *r_m > found_m).find(reached).unwrap_or(0.0));
        }
        if found_m < search_m {
            break;
        }
        search_m *= 4.0;
    }
    found_m + search_m / STEPS as f64
}

/// An edge of the grid: from a corner to the right of it, or to the one above.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Edge {
    column: usize,
    row: usize,
    upwards: bool,
}

#[derive(Clone, Copy, Debug)]
struct Grid {
    half_m: f64,
    cells: usize,
}

impl Grid {
    fn corner(&self, column: usize, row: usize) -> [f64; 2] {
        [column, row].map(|i| self.half_m * (2.0 * i as f64 / self.cells as f64 - 1.0))
    }

    fn ends(&self, edge: Edge) -> [(usize, usize); 2] {
        let Edge { column, row, upwards } = edge;
        [(column, row), if upwards { (column, row + 1) } else { (column + 1, row) }]
    }

    /// The edges of a cell counter-clockwise from its lower one, each with true where going
    /// round the cell goes along it backwards.
    fn around(column: usize, row: usize) -> [(Edge, bool); 4] {
        let edge = |column, row, upwards| Edge { column, row, upwards };
        [
            (edge(column, row, false), false),
            (edge(column + 1, row, true), false),
            (edge(column, row + 1, false), true),
            (edge(column, row, true), true),
        ]
    }

    fn outlines(&self, corners: &Survey, margin: &impl Fn([f64; 2]) -> Option<f64>) -> Vec<Curve> {
        let inside = |(column, row): (usize, usize)| corners[row][column].is_some();
        // With the reachable on the left a curve goes through a cell from where the way round
        // the cell leaves the reachable to where it comes back.
        let mut next = BTreeMap::new();
        for (column, row) in self.every_cell() {
            let crossed = Self::around(column, row).into_iter().filter_map(|(edge, backwards)| {
                let [from, to] = self.ends(edge).map(inside);
                (from != to).then_some((edge, from != backwards))
            });
            let crossed: Vec<_> = crossed.collect();
            for (i, (edge, leaves)) in crossed.iter().enumerate() {
                if *leaves {
                    next.insert(*edge, crossed[(i + 1) % crossed.len()].0);
                }
            }
        }
        let mut curves = Vec::new();
        while let Some((&first, _)) = next.first_key_value() {
            let mut curve = Curve::new();
            let mut edge = first;
            while let Some(following) = next.remove(&edge) {
                curve.push(self.border(edge, &inside, margin));
                edge = following;
            }
            curves.push(curve);
        }
        curves
    }

    fn every_cell(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let cells = self.cells;
        (0..cells * cells).map(move |i| (i % cells, i / cells))
    }

    /// Where along an edge the reachable ends.
    fn border(
        &self,
        edge: Edge,
        inside: &impl Fn((usize, usize)) -> bool,
        margin: &impl Fn([f64; 2]) -> Option<f64>,
    ) -> [f64; 2] {
        let [a, b] = self.ends(edge);
        let ordered = if inside(a) { [a, b] } else { [b, a] };
        let [mut within, mut beyond] = ordered.map(|(column, row)| self.corner(column, row));
        for _ in 0..30 {
            let middle = between(within, beyond, 0.5);
            if margin(middle).is_some() { within = middle } else { beyond = middle }
        }
        within
    }

    fn singular(&self, corners: &Survey, margin: &impl Fn([f64; 2]) -> Option<f64>) -> Vec<Curve> {
        let mut crossings = BTreeMap::new();
        let mut joined: BTreeMap<Edge, BTreeSet<Edge>> = BTreeMap::new();
        for (column, row) in self.every_cell() {
            let mut found = Vec::new();
            for (edge, _) in Self::around(column, row) {
                let known = crossings.entry(edge);
                if known.or_insert_with(|| self.zero(edge, corners, margin)).is_some() {
                    found.push(edge);
                }
            }
            for pair in found.chunks_exact(2) {
                joined.entry(pair[0]).or_default().insert(pair[1]);
                joined.entry(pair[1]).or_default().insert(pair[0]);
            }
        }
        let mut curves = Vec::new();
        // Open curves from their ends first, then what is left: closed ones.
        for most in [1, 2] {
            while let Some(first) = joined
                .iter()
                .find(|(_, others)| (1..=most).contains(&others.len()))
                .map(|(edge, _)| *edge)
            {
                let way = walk(&mut joined, first);
                curves.push(way.iter().filter_map(|edge| crossings[edge]).collect());
            }
        }
        curves
    }

    /// Where along an edge the margin falls to zero.
    fn zero(
        &self,
        edge: Edge,
        corners: &Survey,
        margin: &impl Fn([f64; 2]) -> Option<f64>,
    ) -> Option<[f64; 2]> {
        let ends = self.ends(edge);
        let [at_a, at_b] = ends.map(|(column, row)| corners[row][column]);
        let [a, b] = ends.map(|(column, row)| self.corner(column, row));
        let least = at_a?.min(at_b?).min(margin(between(a, b, 0.5))?);
        if least > SAFE_MARGIN {
            return None;
        }
        let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..40 {
            let step = golden * (high - low);
            let (left, right) = (high - step, low + step);
            let at = |share| margin(between(a, b, share));
            if at(left)? < at(right)? { high = right } else { low = left }
        }
        let share = 0.5 * (low + high);
        let point = between(a, b, share);
        // A minimum at an end is the way to somewhere else, unless the end is the locus.
        (margin(point)? < ZERO_MARGIN).then_some(point)
    }
}

/// The edges that follow each other from `first` on; what was walked is forgotten.
fn walk(joined: &mut BTreeMap<Edge, BTreeSet<Edge>>, first: Edge) -> Vec<Edge> {
    let (mut way, mut edge) = (vec![first], first);
    while let Some(following) = joined.get_mut(&edge).and_then(BTreeSet::pop_first) {
        if let Some(back) = joined.get_mut(&following) {
            back.remove(&edge);
        }
        way.push(following);
        edge = following;
    }
    joined.retain(|_, others| !others.is_empty());
    way
}

fn between(a: [f64; 2], b: [f64; 2], share: f64) -> [f64; 2] {
    [0, 1].map(|i| a[i] + share * (b[i] - a[i]))
}

fn signed_area_m2(curve: &Curve) -> f64 {
    let ends = curve.iter().zip(curve.iter().cycle().skip(1));
    ends.map(|(a, b)| 0.5 * (a[0] * b[1] - b[0] * a[1])).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::DeviceDefinition;
    use crate::mechanism::{
        Inertia, SymmetricFiveBar, SymmetricFiveBarParameters, TwoLink, TwoLinkParameters,
    };
    use std::f64::consts::PI;

    fn length_m(curve: &Curve) -> f64 {
        curve.windows(2).map(|p| (p[1][0] - p[0][0]).hypot(p[1][1] - p[0][1])).sum()
    }

    #[test]
    fn an_arms_workspace_is_the_ring_that_its_links_span() {
        let arm = TwoLinkParameters { l1_m: 0.3, l2_m: 0.2, elbow: 1 };
        let arm = TwoLink::new(arm, Inertia::default()).unwrap();
        let found = workspace(&arm, 0.0, 60);
        assert_eq!((found.outlines.len(), found.singular.len()), (2, 0));
        for curve in &found.outlines {
            let hole = signed_area_m2(curve) < 0.0;
            for [x, y] in curve {
                let wrong_m = x.hypot(*y) - if hole { 0.1 } else { 0.5 };
                assert!(wrong_m.abs() < 1e-6, "{x} {y}");
            }
        }
        let ring_m2 = PI * (0.25 - 0.01);
        assert!((found.area_m2() / ring_m2 - 1.0).abs() < 0.01, "{}", found.area_m2());
    }

    /// Singh's device with both elbows on one side: B_1 and B_2 meet at (0, +-9.54) cm, and C
    /// is singular 15 cm around there, on the side that the elbows leave to it.
    #[test]
    fn the_loci_of_one_sided_elbows_are_the_arcs_of_coinciding_links() {
        let singh = SymmetricFiveBarParameters {
            a1_m: 0.10,
            a2_m: 0.15,
            a3_m: 0.03,
            s1: 1,
            s2: 1,
            assembly: 1,
        };
        let device = SymmetricFiveBar::new(singh, Inertia::default()).unwrap();
        let found = workspace(&device, 0.0, 80);
        let height_m = (0.1_f64 * 0.1 - 0.03 * 0.03).sqrt();
        assert!(!found.singular.is_empty());
        for [x, y] in found.singular.iter().flatten() {
            let about = |y_m: f64| (x.hypot(y - y_m) - 0.15).abs();
            assert!(about(height_m).min(about(-height_m)) < 1e-6, "{x} {y}");
        }
        let total_m: f64 = found.singular.iter().map(length_m).sum();
        assert!((0.3..1.0).contains(&total_m), "{total_m}");
        let papers = SymmetricFiveBarParameters { s2: -1, ..singh };
        let papers = SymmetricFiveBar::new(papers, Inertia::default()).unwrap();
        let ring = |[x, y]: &[f64; 2]| (0.08..0.22).contains(&x.hypot(*y));
        assert!(!workspace(&papers, 0.0, 80).singular.iter().flatten().any(ring));
    }

    #[test]
    fn what_is_enclosed_is_what_a_count_of_random_places_finds() {
        use rand::{Rng, SeedableRng};
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        for (name, phi_rad) in [("cho-2005", 0.0), ("singh", 0.0), ("kim-2003", 0.3)] {
            let device = DeviceDefinition::load(name).unwrap();
            let mechanism = device.mechanism.as_ref();
            let found = workspace(mechanism, phi_rad, 60);
            let points = found.outlines.iter().flatten();
            let half_m = points.map(|[x, y]| x.abs().max(y.abs())).fold(0.0, f64::max);
            let count = 40_000;
            let hits = (0..count).filter(|_| {
                let mut along = || rng.random_range(-half_m..half_m);
                let p_BH = PlaneVector::new(along(), along(), phi_rad);
                margin_at(mechanism, &p_BH).is_some()
            });
            let counted_m2 = 4.0 * half_m * half_m * hits.count() as f64 / f64::from(count);
            let error = found.area_m2() / counted_m2 - 1.0;
            assert!(error.abs() < 0.03, "{name}: {error}");
        }
    }
}

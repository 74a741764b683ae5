//! The indices of a whole workspace: means, extremes and counts over a named grid.
//!
//! GP_a and GP_f are the means of P_a and P_f (Cho 2005, Eq 7 and 9), the global conditioning
//! index that of 1/K (Gosselin & Angeles 1991). Places that the linkage cannot reach, or only
//! in a singular posture, are counted and take no part in a mean; a condition class has the
//! singular ones. One number without its grid means little, so the grid's name is kept.
//!
//! A linkage that turns as a whole about its base has the same indices all around it: on an
//! annulus one place of each circle stands for all. That is the only shortcut, and a test
//! compares it with the long way.

use super::grid::{Annulus, Grid, Place};
use super::local::{ConditionClass, LocalIndices, RayIndices, ray_indices};
use crate::mechanism::{KinematicsError, Mechanism};
use crate::notation::ActuatorVector;

/// The account of a workspace.
#[derive(Clone, Debug, PartialEq)]
pub struct GlobalIndices {
    /// Which grid, in words.
    pub grid: String,
    /// Places of the grid.
    pub places: usize,
    /// Those that no posture of the working mode reaches.
    pub unreachable: usize,
    /// Those that are reached in a singular posture only.
    pub singular: usize,
    /// Mean P_a, rad^2; not a number where nothing is reached.
    pub GP_a: f64,
    /// Mean P_f, rad.
    pub GP_f: f64,
    /// Smallest and largest angle between neighbouring rays, rad.
    pub beta_rad: [f64; 2],
    /// Share of the reached workspace whose largest beta lies between 50 and 60 degrees.
    pub share_50_60: f64,
    /// Global conditioning index, 0 to 1; a singular place adds nothing.
    pub conditioning: f64,
    /// Largest condition number of a regular place.
    pub worst_condition: f64,
    /// Places of each class of condition number; those beyond reach are in none.
    pub classes: [usize; 4],
    /// Mean of Yoshikawa's measure.
    pub yoshikawa: f64,
    /// Worst-direction force of the worst place, N.
    pub worst_force_N: f64,
    /// Mean worst-direction force, N.
    pub mean_worst_force_N: f64,
    /// Least and most inertia felt anywhere, kg.
    pub inertia_kg: [f64; 2],
}

/// True where a linkage turns as a whole about the origin of B, so that its indices depend on
/// the handle's distance alone.
pub fn turns_about_base(mechanism: &dyn Mechanism) -> bool {
    matches!(mechanism.name(), "five-bar" | "two-link")
}

impl GlobalIndices {
    /// The indices over a grid, by the shortcut where it holds.
    pub fn over(mechanism: &dyn Mechanism, max_torque_Nm: &ActuatorVector, grid: &Grid) -> Self {
        let Grid::Annulus(annulus) = grid else {
            return Self::place_by_place(mechanism, max_torque_Nm, grid);
        };
        if !turns_about_base(mechanism) {
            return Self::place_by_place(mechanism, max_torque_Nm, grid);
        }
        let folded = Grid::Annulus(annulus.folded());
        let mut found = Self::place_by_place(mechanism, max_torque_Nm, &folded);
        found.grid = grid.to_string();
        let counts = [&mut found.places, &mut found.unreachable, &mut found.singular];
        for count in counts.into_iter().chain(&mut found.classes) {
            *count *= annulus.bearings;
        }
        found
    }

    /// The indices over every place of a grid.
    pub fn place_by_place(
        mechanism: &dyn Mechanism,
        max_torque_Nm: &ActuatorVector,
        grid: &Grid,
    ) -> Self {
        let mut sums = Sums::default();
        for place in grid.places() {
            match mechanism.posture_at(&place.p_BH) {
                Ok(posture) => {
                    sums.add(place, &LocalIndices::of(mechanism, max_torque_Nm, &posture));
                }
                Err(error) => sums.miss(place, error),
            }
        }
        sums.finish(grid.to_string())
    }
}

/// GP_a and GP_f alone over an annulus, for a search that asks often; `Err` holds the first
/// refusal and its place. One place of each circle: only for what turns about its base.
pub fn means_about_base(
    mechanism: &dyn Mechanism,
    annulus: Annulus,
) -> Result<[f64; 2], (Place, KinematicsError)> {
    let (mut sums, mut weight) = ([0.0; 2], 0.0);
    for place in Grid::Annulus(annulus.folded()).places() {
        let posture = mechanism.posture_at(&place.p_BH).map_err(|error| (place, error))?;
        let singular = KinematicsError::Singular { margin: 0.0, least: 0.0 };
        let rays = ray_indices(&posture.reference, mechanism.actuators());
        let RayIndices { P_a, P_f, .. } = rays.ok_or((place, singular))?;
        sums = [sums[0] + place.weight * P_a, sums[1] + place.weight * P_f];
        weight += place.weight;
    }
    Ok(sums.map(|sum| sum / weight))
}

/// Sums on the way.
struct Sums {
    places: usize,
    unreachable: usize,
    singular: usize,
    /// Of the places with rays.
    ray_weight: f64,
    /// Of the regular places.
    weight: f64,
    /// Of those, and the singular ones.
    reached_weight: f64,
    sums: [f64; 6],
    beta_rad: [f64; 2],
    worst_condition: f64,
    classes: [usize; 4],
    worst_force_N: f64,
    inertia_kg: [f64; 2],
}

impl Default for Sums {
    fn default() -> Self {
        Self {
            places: 0,
            unreachable: 0,
            singular: 0,
            ray_weight: 0.0,
            weight: 0.0,
            reached_weight: 0.0,
            sums: [0.0; 6],
            beta_rad: [f64::INFINITY, 0.0],
            worst_condition: 0.0,
            classes: [0; 4],
            worst_force_N: f64::INFINITY,
            inertia_kg: [f64::INFINITY, 0.0],
        }
    }
}

impl Sums {
    fn miss(&mut self, place: Place, error: KinematicsError) {
        self.places += 1;
        if let KinematicsError::Singular { .. } = error {
            self.singular += 1;
            self.reached_weight += place.weight;
            self.classes[ConditionClass::Above100 as usize] += 1;
        } else {
            self.unreachable += 1;
        }
    }

    fn add(&mut self, place: Place, found: &LocalIndices) {
        let weight = place.weight;
        self.places += 1;
        self.weight += weight;
        self.reached_weight += weight;
        if let Some(RayIndices { P_a, P_f, least_beta_rad }) = found.rays {
            self.ray_weight += weight;
            self.sums[0] += weight * P_a;
            self.sums[1] += weight * P_f;
            if (50.0..=60.0).contains(&P_f.to_degrees()) {
                self.sums[2] += weight;
            }
            self.beta_rad = [self.beta_rad[0].min(least_beta_rad), self.beta_rad[1].max(P_f)];
        }
        self.sums[3] += weight / found.condition;
        self.sums[4] += weight * found.yoshikawa;
        self.sums[5] += weight * found.worst_force_N;
        if found.condition.is_finite() {
            self.worst_condition = self.worst_condition.max(found.condition);
        }
        self.classes[found.class() as usize] += 1;
        self.worst_force_N = self.worst_force_N.min(found.worst_force_N);
        let [least, most] = found.inertia_kg;
        self.inertia_kg = [self.inertia_kg[0].min(least), self.inertia_kg[1].max(most)];
    }

    fn finish(self, grid: String) -> GlobalIndices {
        let [P_a, P_f, narrow, conditioning, yoshikawa, force_N] = self.sums;
        GlobalIndices {
            grid,
            places: self.places,
            unreachable: self.unreachable,
            singular: self.singular,
            GP_a: P_a / self.ray_weight,
            GP_f: P_f / self.ray_weight,
            beta_rad: self.beta_rad,
            share_50_60: narrow / self.ray_weight,
            conditioning: conditioning / self.reached_weight,
            worst_condition: self.worst_condition,
            classes: self.classes,
            yoshikawa: yoshikawa / self.weight,
            worst_force_N: self.worst_force_N,
            mean_worst_force_N: force_N / self.weight,
            inertia_kg: self.inertia_kg,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::grid::{CHO_WORKSPACE_M, Raster};
    use super::*;
    use crate::config::{BUILT_IN, DeviceDefinition};

    fn device(name: &str) -> DeviceDefinition {
        DeviceDefinition::load(name).unwrap()
    }

    fn over(device: &DeviceDefinition, grid: Grid) -> GlobalIndices {
        let torque_Nm = &device.actuators.max_torque_Nm;
        GlobalIndices::over(device.mechanism.as_ref(), torque_Nm, &grid)
    }

    #[test]
    fn table_one_has_our_means_beside_the_published_extremes() {
        let [a, b] = CHO_WORKSPACE_M;
        for (name, area, polar, beta_deg, share) in [
            ("cho-2005", [5.237, 1.019], [5.297, 1.042], [21.20, 79.65], 0.4429),
            ("cho-2005-unoptimised", [6.786, 1.398], [6.610, 1.334], [3.999, 112.885], 0.1690),
            ("cho-2005-crossed", [5.125, 0.962], [5.105, 0.946], [28.72, 77.70], 0.5784),
        ] {
            let device = device(name);
            let by_area = over(&device, Grid::Annulus(Annulus::area(a, b)));
            let by_polar = over(&device, Grid::Annulus(Annulus::polar(a, b)));
            for (found, expected) in [(&by_area, area), (&by_polar, polar)] {
                assert!((found.GP_a - expected[0]).abs() < 6e-4, "{name}: {found:?}");
                assert!((found.GP_f - expected[1]).abs() < 6e-4, "{name}: {found:?}");
            }
            let found_deg = by_area.beta_rad.map(f64::to_degrees);
            for (found, expected) in found_deg.into_iter().zip(beta_deg) {
                assert!((found - expected).abs() < 6e-3, "{name}: {found_deg:?}");
            }
            assert!((by_area.share_50_60 - share).abs() < 5e-4, "{name}: {by_area:?}");
            assert!(by_polar.grid.contains("3813") && by_polar.places == 3813, "{by_polar:?}");
        }
    }

    #[test]
    fn what_turns_about_its_base_has_the_same_indices_the_long_way_round() {
        let mut turning = 0;
        for (name, _) in BUILT_IN {
            let device = device(name);
            let annulus = Annulus { radii: 7, bearings: 9, ..Annulus::polar(0.22, 0.45) };
            let grid = Grid::Annulus(annulus);
            let mechanism = device.mechanism.as_ref();
            let torque_Nm = &device.actuators.max_torque_Nm;
            let long = GlobalIndices::place_by_place(mechanism, torque_Nm, &grid);
            let folded = Grid::Annulus(annulus.folded());
            let short = GlobalIndices::place_by_place(mechanism, torque_Nm, &folded);
            let numbers = |g: &GlobalIndices| {
                let [least, most] = g.beta_rad;
                [g.GP_a, g.GP_f, least, most, g.conditioning, g.yoshikawa, g.worst_force_N]
            };
            let same =
                numbers(&long).iter().zip(numbers(&short)).all(|(l, s)| (l - s).abs() < 1e-9);
            assert_eq!(same, turns_about_base(mechanism), "{name}");
            if same {
                turning += 1;
                assert_eq!((long.places, short.places), (63, 7));
                assert_eq!(
                    numbers(&GlobalIndices::over(mechanism, torque_Nm, &grid)),
                    numbers(&short)
                );
                let fast = means_about_base(mechanism, annulus).unwrap();
                assert!(
                    (fast[0] - short.GP_a).abs() < 1e-12 && (fast[1] - short.GP_f).abs() < 1e-12
                );
            }
        }
        assert!(turning >= 4, "{turning}");
    }

    #[test]
    fn places_beyond_reach_are_counted_and_spoil_no_mean() {
        let device = device("two-link");
        let raster = Raster { x_m: [-0.7, 0.7], y_m: [-0.7, 0.7], step_m: 0.1, phi_rad: 0.0 };
        let found = over(&device, Grid::Raster(raster));
        assert_eq!(found.places, 225);
        // The base itself is singular, and so are the four places stretched along an axis.
        assert_eq!(found.singular, 5);
        let reached = found.places - found.unreachable - found.singular;
        assert_eq!(found.classes.iter().sum::<usize>(), reached + found.singular);
        assert!(found.GP_a.is_finite() && found.conditioning > 0.0 && found.conditioning < 1.0);
        let nowhere = over(&device, Grid::Annulus(Annulus::area(0.8, 0.9)));
        assert_eq!(nowhere.unreachable, nowhere.places);
        assert!(nowhere.GP_a.is_nan() && nowhere.share_50_60.is_nan());
    }

    #[test]
    fn a_two_link_arm_is_best_conditioned_where_theory_says() {
        // Equal links: 1/K grows with |det J| / trace(J J^T) = sin q2 / (3 + 2 cos q2).
        let device = device("two-link");
        let found = |r_m: f64| {
            let annulus = Annulus { radii: 2, ..Annulus::polar(r_m, r_m + 1e-9) };
            over(&device, Grid::Annulus(annulus)).conditioning
        };
        let best =
            (1..600).map(|i| f64::from(i) * 1e-3).max_by(|a, b| found(*a).total_cmp(&found(*b)));
        let best = best.unwrap();
        // It is largest at cos q2 = -2/3.
        let expected = 0.3 * (2.0 - 4.0 / 3.0_f64).sqrt();
        assert!((best - expected).abs() < 2e-3, "{best} {expected}");
    }
}

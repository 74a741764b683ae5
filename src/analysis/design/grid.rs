//! Named grids of places in a device's plane: a mean over a workspace is a number only
//! together with the grid that it is over.
//!
//! Poses are (x, y, phi) in B, metres and radians; phi matters to devices of three freedoms
//! only. Weights are relative: a mean divides by their sum. The grids know no linkage: places
//! that it cannot reach are found out, and told, by whoever asks it.

use std::f64::consts::TAU;
use std::fmt;

use crate::notation::PlaneVector;
use crate::units::{FieldError, Range};

/// The workspace of Cho 2005, metres from the base.
pub const CHO_WORKSPACE_M: [f64; 2] = [0.2, 0.5];

/// Places that a grid may have at most.
pub const MOST_PLACES: usize = 4_000_000;

const EXTENT: Range = Range::new(-10.0, 10.0, "m");
const RADIUS: Range = Range::new(0.0, 10.0, "m");
const STEP: Range = Range::new(1e-5, 10.0, "m");

/// One place of a grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Pose of the handle.
    pub p_BH: PlaneVector,
    /// How much it counts.
    pub weight: f64,
}

/// How the circles of an annulus are weighted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mean {
    /// Each place counts as the area around it: weight r, trapezoid between the circles.
    Area,
    /// Every place of the grid counts the same, those at the rims too.
    Polar,
    /// Every radius counts the same: weight 1, trapezoid between the circles.
    Radial,
}

/// Circles about the base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Annulus {
    /// Radius of the first circle.
    pub least_m: f64,
    /// Radius of the last one.
    pub most_m: f64,
    /// Circles, at equal distances.
    pub radii: usize,
    /// Places on each, at equal angles from x of B.
    pub bearings: usize,
    /// How they are weighted.
    pub mean: Mean,
    /// Angle of the handle everywhere.
    pub phi_rad: f64,
}

/// A lattice of squares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Raster {
    /// From and to.
    pub x_m: [f64; 2],
    /// From and to.
    pub y_m: [f64; 2],
    /// Between neighbours, along both axes.
    pub step_m: f64,
    /// Angle of the handle everywhere.
    pub phi_rad: f64,
}

/// Any of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Grid {
    /// Circles about the base.
    Annulus(Annulus),
    /// A lattice of squares; every place counts the same.
    Raster(Raster),
}

impl Annulus {
    /// The area-uniform mean, by 6001 radii: a linkage that turns about its base needs one
    /// place on each; [`super::GlobalIndices::over`] sees to that.
    pub fn area(least_m: f64, most_m: f64) -> Self {
        Self { least_m, most_m, radii: 6001, bearings: 120, mean: Mean::Area, phi_rad: 0.0 }
    }

    /// 31 x 123 = 3813 places: as many as Cho 2005 has, who do not say where.
    pub fn polar(least_m: f64, most_m: f64) -> Self {
        Self { least_m, most_m, radii: 31, bearings: 123, mean: Mean::Polar, phi_rad: 0.0 }
    }

    /// Every radius alike, by 6001 radii.
    pub fn radial(least_m: f64, most_m: f64) -> Self {
        Self { mean: Mean::Radial, ..Self::area(least_m, most_m) }
    }

    /// One place on each circle: enough for a linkage that turns about its base.
    pub fn folded(self) -> Self {
        Self { bearings: 1, ..self }
    }

    /// Refuses what is no annulus.
    pub fn check(&self) -> Result<(), FieldError> {
        RADIUS.check("r[0]", self.least_m)?;
        RADIUS.check("r[1]", self.most_m)?;
        if self.most_m <= self.least_m {
            return Err(FieldError::new("r[1]", self.most_m, "must be larger than r[0]"));
        }
        check_count(self.radii.max(2).saturating_mul(self.bearings.max(1)))
    }

    /// The radius of a circle, counted from zero.
    pub fn radius_m(&self, circle: usize) -> f64 {
        let share = circle as f64 / (self.radii.max(2) - 1) as f64;
        self.least_m + (self.most_m - self.least_m) * share
    }

    fn weight(&self, circle: usize) -> f64 {
        let rim = if circle == 0 || circle + 1 == self.radii { 0.5 } else { 1.0 };
        match self.mean {
            Mean::Area => rim * self.radius_m(circle),
            Mean::Polar => 1.0,
            Mean::Radial => rim,
        }
    }

    fn places(self) -> impl Iterator<Item = Place> {
        (0..self.radii).flat_map(move |circle| {
            let (r_m, weight) = (self.radius_m(circle), self.weight(circle));
            (0..self.bearings).map(move |k| {
                let (sin, cos) = (TAU * k as f64 / self.bearings as f64).sin_cos();
                Place { p_BH: PlaneVector::new(r_m * cos, r_m * sin, self.phi_rad), weight }
            })
        })
    }
}

impl Raster {
    /// Places along x and along y; the last may lie before the end.
    pub fn counts(&self) -> [usize; 2] {
        [self.x_m, self.y_m].map(|[from, to]| {
            // A step that divides the length must not miss the end by rounding.
            ((to - from) / self.step_m + 1e-9).floor().clamp(0.0, 1e9) as usize + 1
        })
    }

    /// The place at these steps from the corner.
    pub fn place(&self, i: usize, j: usize) -> PlaneVector {
        let at = |[from, _]: [f64; 2], steps: usize| from + self.step_m * steps as f64;
        PlaneVector::new(at(self.x_m, i), at(self.y_m, j), self.phi_rad)
    }

    /// Refuses what is no lattice.
    pub fn check(&self) -> Result<(), FieldError> {
        for (name, [from, to]) in [("x", self.x_m), ("y", self.y_m)] {
            EXTENT.check(&format!("{name}[0]"), from)?;
            EXTENT.check(&format!("{name}[1]"), to)?;
            if to <= from {
                let allowed = format!("must be larger than {name}[0]");
                return Err(FieldError::new(format!("{name}[1]"), to, allowed));
            }
        }
        STEP.check("step", self.step_m)?;
        let [columns, rows] = self.counts();
        check_count(columns.saturating_mul(rows))
    }

    fn places(self) -> impl Iterator<Item = Place> {
        let [columns, rows] = self.counts();
        (0..rows).flat_map(move |j| {
            (0..columns).map(move |i| Place { p_BH: self.place(i, j), weight: 1.0 })
        })
    }
}

impl Grid {
    /// Refuses numbers that make no grid, or one too fine to walk.
    pub fn check(&self) -> Result<(), FieldError> {
        match self {
            Self::Annulus(annulus) => annulus.check(),
            Self::Raster(raster) => raster.check(),
        }
    }

    /// All of its places.
    pub fn places(&self) -> Box<dyn Iterator<Item = Place>> {
        match *self {
            Self::Annulus(annulus) => Box::new(annulus.places()),
            Self::Raster(raster) => Box::new(raster.places()),
        }
    }
}

fn check_count(places: usize) -> Result<(), FieldError> {
    if places <= MOST_PLACES {
        return Ok(());
    }
    Err(FieldError::new("grid", format!("{places} places"), format!("at most {MOST_PLACES}")))
}

impl fmt::Display for Grid {
    /// The name that stands beside every mean.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Annulus(Annulus { least_m, most_m, radii, bearings, mean, .. }) => match mean {
                Mean::Area => write!(
                    f,
                    "area-uniform, r {least_m} to {most_m} m, {radii} radii x {bearings} bearings \
                     (trapezoid, weight r)"
                ),
                Mean::Radial => write!(
                    f,
                    "radial, r {least_m} to {most_m} m, {radii} radii x {bearings} bearings \
                     (trapezoid, weight 1)"
                ),
                Mean::Polar => write!(
                    f,
                    "polar, r {least_m} to {most_m} m, {radii} x {bearings} = {} places of equal \
                     weight",
                    radii * bearings
                ),
            },
            Self::Raster(Raster { x_m, y_m, step_m, .. }) => write!(
                f,
                "Cartesian, x {} to {} m, y {} to {} m, step {step_m} m",
                x_m[0], x_m[1], y_m[0], y_m[1]
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mean_of(grid: Grid, f: impl Fn(f64) -> f64) -> f64 {
        let (sum, weight) = grid.places().fold((0.0, 0.0), |(sum, all), place| {
            (sum + place.weight * f(place.p_BH.xy().norm()), all + place.weight)
        });
        sum / weight
    }

    #[test]
    fn the_means_of_a_polynomial_are_its_integrals() {
        let [a, b] = CHO_WORKSPACE_M;
        let integral = |power: i32| (b.powi(power + 1) - a.powi(power + 1)) / f64::from(power + 1);
        let area = mean_of(Grid::Annulus(Annulus::area(a, b).folded()), |r| r * r);
        assert!((area - integral(3) / integral(1)).abs() < 1e-8, "{area}");
        let radial = mean_of(Grid::Annulus(Annulus::radial(a, b).folded()), |r| r * r);
        assert!((radial - integral(2) / integral(0)).abs() < 1e-8, "{radial}");
    }

    #[test]
    fn the_polar_grid_has_as_many_places_as_the_paper() {
        let polar = Grid::Annulus(Annulus::polar(0.2, 0.5));
        assert_eq!(polar.places().count(), 3813);
        assert!(polar.to_string().contains("31 x 123 = 3813 places"), "{polar}");
        let r_m: Vec<f64> =
            polar.places().step_by(123).map(|place| place.p_BH.xy().norm()).collect();
        for (k, r_m) in r_m.iter().enumerate() {
            assert!((r_m - (0.2 + 0.01 * k as f64)).abs() < 1e-12);
        }
    }

    #[test]
    fn a_raster_reaches_its_end_and_not_beyond() {
        let raster = Raster { x_m: [-0.1, 0.2], y_m: [0.0, 0.25], step_m: 0.1, phi_rad: 0.3 };
        assert_eq!(raster.counts(), [4, 3]);
        let last = Grid::Raster(raster).places().last().unwrap();
        assert!((last.p_BH - PlaneVector::new(0.2, 0.2, 0.3)).norm() < 1e-12);
    }

    #[test]
    fn rubbish_is_refused_by_name() {
        let refused = |grid: Grid| grid.check().unwrap_err().to_string();
        assert!(refused(Grid::Annulus(Annulus::area(0.5, 0.2))).starts_with("r[1] = 0.2"));
        assert!(refused(Grid::Annulus(Annulus::area(f64::NAN, 0.2))).starts_with("r[0] = NaN"));
        let raster = Raster { x_m: [-1.0, 1.0], y_m: [0.0, 1.0], step_m: 1e-5, phi_rad: 0.0 };
        assert!(refused(Grid::Raster(raster)).contains("at most"));
        let raster = Raster { step_m: f64::INFINITY, ..raster };
        assert!(refused(Grid::Raster(raster)).starts_with("step = inf"));
    }
}

//! Arguments that several design commands share: device, workspace, and where results go.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::{Args, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};

use crate::analysis::design::grid::CHO_WORKSPACE_M;
use crate::analysis::design::{Annulus, Grid, Raster, turns_about_base};
use crate::analysis::workspace::outlines;
use crate::config::DeviceDefinition;
use crate::mechanism::Mechanism;
use crate::notation::PlaneVector;
use crate::plot::Figure;
use crate::units::Range;

/// Which mean to take.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum GridKind {
    /// Every piece of the annulus by its area
    Area,
    /// 31 x 123 = 3813 places of equal weight
    Polar,
    /// Every radius alike
    Radial,
    /// A lattice of squares
    Cartesian,
}

/// The part of the plane that counts.
#[derive(Clone, Debug, Args)]
pub struct Workspace {
    /// Least and most distance from the base, m; without it 0.2,0.5 for linkages that turn
    /// about their base
    #[arg(long, value_name = "LEAST,MOST", value_parser = parse_pair)]
    r: Option<[f64; 2]>,
    /// From and to along x, m; without it as far as the linkage reaches
    #[arg(long, value_name = "FROM,TO", value_parser = parse_pair, allow_hyphen_values = true)]
    x: Option<[f64; 2]>,
    /// From and to along y, m
    #[arg(long, value_name = "FROM,TO", value_parser = parse_pair, allow_hyphen_values = true)]
    y: Option<[f64; 2]>,
    /// Between neighbours of a lattice, m
    #[arg(long, value_name = "M")]
    step: Option<f64>,
    /// Angle of the handle, degrees; for devices of three freedoms
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true)]
    phi: f64,
}

impl Workspace {
    /// The annulus that is asked for, or usual.
    pub fn radii_m(&self) -> [f64; 2] {
        self.r.unwrap_or(CHO_WORKSPACE_M)
    }

    /// True where a lattice is asked for.
    pub fn is_flat(&self) -> bool {
        self.x.is_some() || self.y.is_some() || self.step.is_some()
    }

    /// The grids of a device: those of the kind that is asked for, or all that suit it.
    pub fn grids(
        &self,
        device: &DeviceDefinition,
        kind: Option<GridKind>,
    ) -> anyhow::Result<Vec<Grid>> {
        let round = turns_about_base(device.mechanism.as_ref()) || self.r.is_some();
        let flat = self.is_flat();
        let kinds = match kind {
            Some(kind) => vec![kind],
            None if round && !flat => vec![GridKind::Area, GridKind::Polar, GridKind::Radial],
            None => vec![GridKind::Cartesian],
        };
        kinds.into_iter().map(|kind| self.grid(device, kind)).collect()
    }

    /// One grid of a device.
    pub fn grid(&self, device: &DeviceDefinition, kind: GridKind) -> anyhow::Result<Grid> {
        let [least_m, most_m] = self.radii_m();
        let phi_rad = self.phi_rad(device)?;
        if kind != GridKind::Cartesian {
            self.check_round("a grid of circles about the base", "--grid cartesian")?;
        }
        let annulus = match kind {
            GridKind::Area => Annulus::area(least_m, most_m),
            GridKind::Polar => Annulus::polar(least_m, most_m),
            GridKind::Radial => Annulus::radial(least_m, most_m),
            GridKind::Cartesian => return Ok(Grid::Raster(self.raster(device, 100)?)),
        };
        // What does not turn about its base has to be asked place by place.
        let turning = turns_about_base(device.mechanism.as_ref());
        let radii = if turning || kind == GridKind::Polar { annulus.radii } else { 121 };
        let grid = Grid::Annulus(Annulus { phi_rad, radii, ..annulus });
        grid.check()?;
        Ok(grid)
    }

    /// A lattice over the workspace, about so many places across when no step is asked for.
    pub fn raster(&self, device: &DeviceDefinition, across: usize) -> anyhow::Result<Raster> {
        let far_m = if self.r.is_some() || turns_about_base(device.mechanism.as_ref()) {
            self.radii_m()[1]
        } else {
            furthest_m(device.mechanism.as_ref(), self.phi_rad(device)?)
        };
        let [x_m, y_m] = [self.x, self.y].map(|range| range.unwrap_or([-far_m, far_m]));
        let step_m = self.step.unwrap_or((x_m[1] - x_m[0]).max(y_m[1] - y_m[0]) / across as f64);
        let raster = Raster { x_m, y_m, step_m, phi_rad: self.phi_rad(device)? };
        raster.check()?;
        Ok(raster)
    }

    /// True where a place is in the annulus, for linkages that have one.
    pub fn holds(&self, device: &DeviceDefinition, p_BH: &PlaneVector) -> bool {
        let round = self.r.is_some() || turns_about_base(device.mechanism.as_ref());
        let ([least_m, most_m], r_m) = (self.radii_m(), p_BH.xy().norm());
        !round || (least_m - 1e-9..=most_m + 1e-9).contains(&r_m)
    }

    /// Angle of the handle, for a device that has one.
    pub fn phi_rad(&self, device: &DeviceDefinition) -> anyhow::Result<f64> {
        let phi_deg = Range::new(-360.0, 360.0, "deg").check("phi", self.phi)?;
        check_turn("--phi", phi_deg, device)?;
        Ok(phi_deg.to_radians())
    }

    /// Refuses a lattice where it has no meaning.
    pub fn check_round(&self, what: &str, instead: &str) -> anyhow::Result<()> {
        let given = [self.x.is_some(), self.y.is_some(), self.step.is_some()];
        let named = ["--x", "--y", "--step"].into_iter().zip(given).find(|(_, given)| *given);
        named.map_or(Ok(()), |(name, _)| {
            anyhow::bail!("{name}: {what} has no lattice; give --r, or {instead}")
        })
    }

    /// Options of the workspace that were given, by name.
    pub fn given(&self) -> impl Iterator<Item = &'static str> {
        let all = [
            ("--r", self.r.is_some()),
            ("--x", self.x.is_some()),
            ("--y", self.y.is_some()),
            ("--step", self.step.is_some()),
            ("--phi", self.phi != 0.0),
        ];
        all.into_iter().filter(|(_, given)| *given).map(|(name, _)| name)
    }
}

/// Refuses an angle of a handle that does not turn.
fn check_turn(option: &str, phi: f64, device: &DeviceDefinition) -> anyhow::Result<()> {
    let turns = device.mechanism.freedoms() > 2;
    anyhow::ensure!(
        turns || phi == 0.0,
        "{option}: the handle of {} has no angle of its own; only devices of three freedoms have",
        device.name
    );
    Ok(())
}

/// A place of the handle, its angle only where the device has one.
pub fn check_place(place: &PlaneVector, device: &DeviceDefinition) -> anyhow::Result<()> {
    check_turn("--at X,Y,PHI", place.z, device)
}

/// A list without what was in it before.
pub fn distinct<T: PartialEq>(list: Vec<T>) -> Vec<T> {
    let mut kept: Vec<T> = Vec::with_capacity(list.len());
    for one in list {
        if !kept.contains(&one) {
            kept.push(one);
        }
    }
    kept
}

/// How far along x or y a lattice must go to hold the workspace, rounded up to a centimetre.
pub fn furthest_m(mechanism: &dyn Mechanism, phi_rad: f64) -> f64 {
    let outlines = outlines(mechanism, phi_rad, 32);
    let far_m = outlines.iter().flatten().flatten().fold(0.0_f64, |far, m| far.max(m.abs()));
    if far_m == 0.0 {
        // Nothing is reached at this angle: the lattice will say so wherever it lies.
        return mechanism.reach_m().1;
    }
    // Half a hundredth more, for an outline bulges between its points.
    (far_m * 100.5).ceil() / 100.0
}

/// Where results go.
#[derive(Clone, Debug, Args)]
pub struct Output {
    /// Print one JSON object, and nothing else, on stdout
    #[arg(long)]
    pub json: bool,
    /// Write a table, comma separated
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Write a picture; the name's ending, .svg or .png, tells as what
    #[arg(long, value_name = "FILE", value_parser = parse_picture)]
    pub out: Option<PathBuf>,
}

impl Output {
    /// Writes the picture where one is asked for.
    pub fn picture(&self, figure: impl FnOnce() -> Figure) -> anyhow::Result<()> {
        let Some(path) = &self.out else { return Ok(()) };
        figure().save(path)?;
        written(path);
        Ok(())
    }

    /// Writes the table where one is asked for.
    pub fn table(&self, text: impl FnOnce() -> String) -> anyhow::Result<()> {
        self.csv.as_deref().map_or(Ok(()), |path| write(path, &text()))
    }
}

/// Writes a text file and says so.
pub fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))?;
    written(path);
    Ok(())
}

/// Says so, to whoever still listens.
fn written(path: &Path) {
    let _ = writeln!(std::io::stderr(), "hapticd: {} written", path.display());
}

/// Where a picture goes: refused before any work where its ending is none.
fn parse_picture(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension().and_then(|ending| ending.to_str()) {
        Some("svg" | "png") => Ok(path),
        _ => Err("must end in .svg or .png".into()),
    }
}

/// Two numbers with a comma between.
pub fn parse_pair(text: &str) -> Result<[f64; 2], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[a, b]) if a.is_finite() && b.is_finite() => Ok([a, b]),
        _ => Err("must be two numbers with a comma between, as in 0.2,0.5".into()),
    }
}

/// A place, perhaps with an angle of the handle in degrees.
pub fn parse_place(text: &str) -> Result<PlaneVector, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    let place = match numbers.as_deref() {
        Ok(&[x, y]) => Some(PlaneVector::new(x, y, 0.0)),
        Ok(&[x, y, phi_deg]) => Some(PlaneVector::new(x, y, f64::to_radians(phi_deg))),
        _ => None,
    };
    let usable = place.filter(|place| place.iter().all(|number| number.abs() <= 100.0));
    usable
        .ok_or_else(|| "must be X,Y in metres or X,Y,PHI with PHI in degrees, as in 0.3,0.1".into())
}

/// An angle in degrees, as radians.
pub fn parse_angle(text: &str) -> Result<f64, String> {
    let angle_deg = text.parse().ok().filter(|deg: &f64| deg.abs() <= 360.0);
    angle_deg.map(f64::to_radians).ok_or_else(|| "must be -360 to 360 degrees".into())
}

/// Progress on stderr, seen where that is a terminal.
pub fn progress_bar(steps: u64, what: &'static str) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len} {eta}");
    let bar = ProgressBar::new(steps).with_message(what);
    style.map(|style| bar.clone().with_style(style)).unwrap_or(bar)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lattice_goes_as_far_as_the_furthest_bearing() {
        let far_m =
            |name| furthest_m(DeviceDefinition::load(name).unwrap().mechanism.as_ref(), 0.0);
        // The legs of (10, 15, 3) meet stretched 24.8 cm up the axis.
        assert!((0.2481..0.26).contains(&far_m("singh")), "{}", far_m("singh"));
        assert!((0.6..0.62).contains(&far_m("two-link")), "{}", far_m("two-link"));
    }

    #[test]
    fn what_does_not_apply_is_refused_by_name() {
        let device = |name| DeviceDefinition::load(name).unwrap();
        let workspace = Workspace { r: None, x: None, y: None, step: None, phi: 20.0 };
        let error = workspace.phi_rad(&device("cho-2005")).unwrap_err().to_string();
        assert!(error.contains("--phi") && error.contains("cho-2005"), "{error}");
        assert!((workspace.phi_rad(&device("kim-2003")).unwrap() - 0.349).abs() < 1e-3);
        let flat = Workspace { y: Some([0.0, 0.1]), phi: 0.0, ..workspace };
        let error = flat.grid(&device("cho-2005"), GridKind::Area).unwrap_err().to_string();
        assert!(error.contains("--y") && error.contains("cartesian"), "{error}");
        assert!(flat.grid(&device("cho-2005"), GridKind::Cartesian).is_ok());
        let place = parse_place("0.3,0.1,5").unwrap();
        assert!(check_place(&place, &device("cho-2005")).is_err());
        assert!(check_place(&place, &device("kim-2003")).is_ok());
    }

    #[test]
    fn a_list_keeps_its_order_and_nothing_twice() {
        assert_eq!(distinct(vec![10.0, 0.0, 10.0, 30.0, 0.0]), [10.0, 0.0, 30.0]);
    }

    #[test]
    fn pairs_places_and_angles_are_read_and_rubbish_is_refused() {
        assert_eq!(parse_pair("0.2, 0.5"), Ok([0.2, 0.5]));
        for rubbish in ["", "1", "1,2,3", "nan,1", "1,inf", "a,b"] {
            assert!(parse_pair(rubbish).is_err(), "{rubbish}");
        }
        assert_eq!(parse_place("1,2,180").unwrap().z, std::f64::consts::PI);
        for rubbish in ["1", "1,2,3,4", "nan,0", "0,inf", "1e9,0"] {
            assert!(parse_place(rubbish).is_err(), "{rubbish}");
        }
        assert!(parse_angle("361").is_err() && parse_angle("nan").is_err());
    }
}

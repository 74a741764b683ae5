//! The wall-following study: every law on every course, beside the passive bound.
//!
//! A [`Study`] is a grid of devices, laws, courses, lags, sensors, encoders and seeds. Each
//! [`Row`] is one cell of it over its seeds: means of what is a mean or a time, the worst of
//! what is a largest value. Rows come in the grid's order, whatever thread made them. A study that
//! is stopped keeps what it has: rows of the seeds that were done.

pub mod pictures;
pub mod report;

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;

use crate::actuation::Strategy;
use crate::analysis::wall_following::{
    Beside, CourseKind, Experiment, ExperimentError, Figures, HandSettings, Impact, OwnLaw,
    Perfect, check, course_of, least_depth_m, perfect, run_with,
};
use crate::config::DeviceDefinition;
use crate::notation::PlaneVector;

/// A law of the table.
#[derive(Clone, Debug, PartialEq)]
pub enum Law {
    /// One of hapticd's.
    BuiltIn(Strategy),
    /// A researcher's own, under this name.
    Own(String),
}

impl Law {
    /// The name in tables.
    pub fn name(&self) -> &str {
        match self {
            Self::BuiltIn(strategy) => strategy.name(),
            Self::Own(name) => name,
        }
    }
}

/// What to run.
#[derive(Clone, Debug)]
pub struct Study {
    /// Names or files.
    pub devices: Vec<String>,
    /// All of them against each other.
    pub laws: Vec<Law>,
    /// Where.
    pub courses: Vec<CourseKind>,
    /// Of the brakes.
    pub lags_s: Vec<f64>,
    /// With and without.
    pub sensors: Vec<bool>,
    /// Encoder counts per turn.
    pub counts: Vec<f64>,
    /// One slide for each.
    pub seeds: Vec<u64>,
    /// The hand.
    pub hand: HandSettings,
    /// What there is beside the walls.
    pub beside: Beside,
    /// Of the walls.
    pub stiffness_N_per_m: f64,
}

/// One cell of the grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// Name or file of the device.
    pub device: String,
    /// The course.
    pub course: CourseKind,
    /// The hand's force is measured.
    pub sensor: bool,
    /// Encoder counts per turn.
    pub counts: f64,
    /// Of the brakes.
    pub lag_s: f64,
    /// The law.
    pub law: Law,
}

/// What came of a cell.
#[derive(Clone, Debug)]
pub struct Row {
    /// Which.
    pub cell: Cell,
    /// Over the seeds.
    pub figures: Figures,
    /// Seeds with which the hand came to the end of the course.
    pub arrived: usize,
    /// All that were done: fewer than the study's where it was stopped.
    pub runs: usize,
    /// What no law of brakes can beat there.
    pub perfect: Perfect,
}

impl Row {
    /// Mean force of the hand over that under a perfect law; `None` where none passes.
    pub fn ratio(&self) -> Option<f64> {
        let known = self.perfect.arrived && self.perfect.hand_mean_N > 0.0;
        known.then(|| self.figures.hand_mean_N / self.perfect.hand_mean_N)
    }
}

/// Makes a fresh process, or whatever a researcher's law needs, for one run.
pub type MakeLaw<'a> = dyn Fn(&str) -> Result<Box<dyn OwnLaw>, String> + Sync + 'a;

/// What came of a study.
#[derive(Clone, Debug)]
pub struct Found {
    /// In the grid's order; without the cells that were not begun.
    pub rows: Vec<Row>,
    /// What meeting a wall costs, whatever the law.
    pub impacts: Vec<ImpactRow>,
    /// Slides that were done, and that there were to do.
    pub slides: [usize; 2],
}

/// Speeds of [`ImpactRow`], m/s.
pub const IMPACT_SPEEDS_M_PER_S: [f64; 3] = [0.1, 0.25, 0.5];

/// The least depth of a handle that meets the first wall of the study's first course.
#[derive(Clone, Debug, PartialEq)]
pub struct ImpactRow {
    /// Name or file.
    pub device: String,
    /// Of the brakes.
    pub lag_s: f64,
    /// At each speed; `None`: the brakes never stop it.
    pub least_depth_m: [Option<f64>; 3],
}

impl Found {
    /// Nobody stopped it.
    pub fn is_complete(&self) -> bool {
        self.slides[0] == self.slides[1]
    }
}

/// Why a study has no result.
#[derive(Debug, thiserror::Error)]
#[error("{cell}: {source}")]
pub struct StudyError {
    /// Which of its experiments failed.
    pub cell: String,
    /// Why.
    pub source: Box<ExperimentError>,
}

impl Study {
    /// The cells in the order of the report.
    pub fn cells(&self) -> Vec<Cell> {
        let mut cells = Vec::new();
        for device in &self.devices {
            for &course in &self.courses {
                for &sensor in &self.sensors {
                    for &counts in &self.counts {
                        for &lag_s in &self.lags_s {
                            for law in &self.laws {
                                let (device, law) = (device.clone(), law.clone());
                                cells.push(Cell { device, course, sensor, counts, lag_s, law });
                            }
                        }
                    }
                }
            }
        }
        cells
    }

    /// Slides in all.
    pub fn runs(&self) -> usize {
        self.cells().len() * self.seeds.len()
    }

    /// One slide of a cell.
    pub fn experiment(&self, cell: &Cell, seed: u64) -> Experiment {
        let strategy = match &cell.law {
            Law::BuiltIn(strategy) => *strategy,
            Law::Own(_) => Strategy::Optimal,
        };
        Experiment {
            device: cell.device.clone(),
            strategy,
            course: cell.course,
            hand: self.hand,
            beside: self.beside,
            stiffness_N_per_m: self.stiffness_N_per_m,
            lag_s: Some(cell.lag_s),
            counts: Some(cell.counts),
            sensor: cell.sensor,
            seed,
        }
    }

    /// Runs everything. `done` is called after every slide, from any thread; `stop` ends it.
    pub fn run(
        &self,
        make: &MakeLaw,
        done: &(dyn Fn() + Sync),
        stop: &AtomicBool,
    ) -> Result<Found, StudyError> {
        let (bounds, impacts) = (self.bounds()?, self.impacts()?);
        let cells = self.cells();
        let rows = cells.par_iter().filter_map(|cell| {
            let mut found = Vec::new();
            for &seed in self.seeds.iter().take_while(|_| !stop.load(Ordering::Relaxed)) {
                match self.slide(cell, seed, make) {
                    Ok(figures) => found.push(figures),
                    // A law that was stopped waiting for its answer is no failure.
                    Err(_) if stop.load(Ordering::Relaxed) => break,
                    Err(error) => return Some(Err(error)),
                }
                done();
            }
            if found.is_empty() {
                return None;
            }
            let key = (cell.device.clone(), cell.course.name());
            let perfect = bounds.get(&key).copied().unwrap_or_default();
            let arrived = found.iter().filter(|figures| figures.arrived).count();
            let (figures, runs) = (over(&found), found.len());
            Some(Ok(Row { cell: cell.clone(), figures, arrived, runs, perfect }))
        });
        let rows: Vec<Row> = rows.collect::<Result<_, _>>()?;
        let slides = [rows.iter().map(|row| row.runs).sum(), self.runs()];
        Ok(Found { rows, impacts, slides })
    }

    fn slide(&self, cell: &Cell, seed: u64, make: &MakeLaw) -> Result<Figures, StudyError> {
        let failed = |source: ExperimentError| StudyError {
            cell: cell.to_string(),
            source: Box::new(source),
        };
        let experiment = self.experiment(cell, seed);
        let mut own = match &cell.law {
            Law::BuiltIn(_) => None,
            Law::Own(command) => Some(make(command).map_err(ExperimentError::Law).map_err(failed)?),
        };
        let own = own.as_mut().map(|law| law.as_mut() as &mut dyn OwnLaw);
        run_with(&experiment, own, |_| ()).map_err(failed)
    }

    /// How deep a handle gets into a wall that it meets, at least.
    fn impacts(&self) -> Result<Vec<ImpactRow>, StudyError> {
        let mut rows = Vec::new();
        for device in &self.devices {
            let failed = |source: ExperimentError| StudyError {
                cell: device.clone(),
                source: Box::new(source),
            };
            let definition = DeviceDefinition::load(device).map_err(|e| failed(e.into()))?;
            let Some(&course) = self.courses.first() else { continue };
            let experiment = Experiment { course, ..Experiment::default() };
            let path = course_of(&experiment, &definition).map_err(failed)?;
            let place = path.legs[0].at(0.5 * path.legs[0].length_m());
            let flat = |v: nalgebra::Vector2<f64>| PlaneVector::new(v.x, v.y, 0.0);
            for &lag_s in &self.lags_s {
                let least_depth_m = IMPACT_SPEEDS_M_PER_S.map(|speed_m_per_s| {
                    let (p_BH, normal) = (flat(place.p_m), flat(place.normal));
                    let press_N = self.hand.press_N;
                    let impact = Impact { p_BH, normal, speed_m_per_s, press_N };
                    let max_Nm = &definition.actuators.max_torque_Nm;
                    least_depth_m(definition.mechanism.as_ref(), max_Nm, lag_s, &impact)
                });
                rows.push(ImpactRow { device: device.clone(), lag_s, least_depth_m });
            }
        }
        Ok(rows)
    }

    /// The bound of every device on every course.
    fn bounds(&self) -> Result<BTreeMap<(String, &'static str), Perfect>, StudyError> {
        let mut bounds = BTreeMap::new();
        for device in &self.devices {
            let failed = |source: ExperimentError| StudyError {
                cell: device.clone(),
                source: Box::new(source),
            };
            let definition = DeviceDefinition::load(device).map_err(|e| failed(e.into()))?;
            check(&definition).map_err(failed)?;
            for &course in &self.courses {
                let experiment = Experiment {
                    course,
                    beside: self.beside,
                    stiffness_N_per_m: self.stiffness_N_per_m,
                    ..Experiment::default()
                };
                let path = course_of(&experiment, &definition).map_err(failed)?;
                let found = perfect(&definition, &path, self.hand);
                bounds.insert((device.clone(), course.name()), found);
            }
        }
        Ok(bounds)
    }
}

impl std::fmt::Display for Cell {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let sensor = if self.sensor { "sensor" } else { "no sensor" };
        let Self { device, course, counts, lag_s, law, .. } = self;
        write!(f, "{device}, {course}, {sensor}, {counts} counts, {lag_s} s, {}", law.name())
    }
}

/// Means of times and means, the worst of largest values.
fn over(all: &[Figures]) -> Figures {
    let count = all.len().max(1) as f64;
    let mean = |of: fn(&Figures) -> f64| all.iter().map(of).sum::<f64>() / count;
    let worst = |of: fn(&Figures) -> f64| all.iter().map(of).fold(f64::NEG_INFINITY, f64::max);
    let events: u32 = all.iter().map(|one| one.stick_events).sum();
    Figures {
        arrived: all.iter().all(|one| one.arrived),
        slide_s: mean(|one| one.slide_s),
        stuck_s: mean(|one| one.stuck_s),
        stick_events: (f64::from(events) / count).round() as u32,
        penetration_mm: worst(|one| one.penetration_mm),
        sliding_mm: worst(|one| one.sliding_mm),
        hand_mean_N: mean(|one| one.hand_mean_N),
        hand_max_N: worst(|one| one.hand_max_N),
        gamma_mean_deg: mean(|one| one.gamma_mean_deg),
        gamma_max_deg: worst(|one| one.gamma_max_deg),
        jerk_rms_m_per_s3: mean(|one| one.jerk_rms_m_per_s3),
        step_max_N: worst(|one| one.step_max_N),
        switches_per_s: mean(|one| one.switches_per_s),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicUsize;

    use super::*;

    fn small() -> Study {
        Study {
            devices: vec!["cho-2005".into()],
            laws: vec![Law::BuiltIn(Strategy::Sliding), Law::BuiltIn(Strategy::Optimal)],
            courses: vec![CourseKind::StraightSlanted],
            lags_s: vec![0.0],
            sensors: vec![true],
            counts: vec![65_536.0],
            seeds: vec![1, 2],
            hand: HandSettings::default(),
            beside: Beside::Nothing,
            stiffness_N_per_m: 1e7,
        }
    }

    fn none(_: &str) -> Result<Box<dyn OwnLaw>, String> {
        Err("there is none".into())
    }

    #[test]
    fn a_study_gives_the_same_rows_on_one_thread_and_on_many() {
        let study = small();
        let done = AtomicUsize::new(0);
        let count = || {
            done.fetch_add(1, Ordering::Relaxed);
        };
        let found = study.run(&none, &count, &AtomicBool::new(false)).unwrap();
        assert!(found.is_complete());
        let rows = &found.rows;
        assert_eq!((rows.len(), done.into_inner()), (2, 4));
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let again = one.install(|| study.run(&none, &|| (), &AtomicBool::new(false)).unwrap());
        for (a, b) in rows.iter().zip(&again.rows) {
            assert_eq!((&a.cell, a.figures), (&b.cell, b.figures));
        }
        assert!((1.0..1.2).contains(&rows[0].ratio().unwrap()), "{:?}", rows[0]);
        let text = report::markdown(&study, &found);
        assert!(text.contains("straight-45") && text.contains("| `sliding` |"), "{text}");
        assert_eq!(report::csv(&study, rows).lines().count(), 3);
    }

    #[test]
    fn a_study_can_be_stopped_and_tells_what_failed() {
        let (study, stop) = (small(), AtomicBool::new(false));
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let after_one = || stop.store(true, Ordering::Relaxed);
        let found = one.install(|| study.run(&none, &after_one, &stop)).unwrap();
        assert!(!found.is_complete() && found.slides == [1, 4], "{found:?}");
        assert_eq!((found.rows.len(), found.rows[0].runs), (1, 1));
        let text = report::markdown(&study, &found);
        assert!(text.contains("**Incomplete**: 1 of 4 slides"), "{text}");
        let own = Study { laws: vec![Law::Own("mine".into())], ..small() };
        let failed = own.run(&none, &|| (), &AtomicBool::new(false)).unwrap_err().to_string();
        assert!(failed.contains("there is none") && failed.contains("mine"), "{failed}");
    }
}

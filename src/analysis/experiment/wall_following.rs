//! The wall-following study: every law on every course, beside the passive bound.
//!
//! A [`Study`] is a grid of devices, laws, courses, lags, sensors, encoders and seeds. Each
//! [`Row`] is one cell of it over its seeds: means of what is a mean or a time, the worst of
//! what is a largest value. Rows come in the grid's order, whatever thread made them.

pub mod pictures;
pub mod report;

use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;

use crate::actuation::Strategy;
use crate::analysis::wall_following::{
    Course, CourseKind, Experiment, ExperimentError, Figures, HandSettings, OwnLaw, Perfect,
    perfect, run_with,
};
use crate::config::DeviceDefinition;

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
    /// All seeds.
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

/// Why a study has no result.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// One of its experiments failed.
    #[error("{cell}: {source}")]
    Experiment {
        /// Which.
        cell: String,
        /// Why.
        source: Box<ExperimentError>,
    },
    /// Somebody stopped it.
    #[error("stopped after {done} of {all} runs; nothing was written")]
    Stopped {
        /// Runs that were done.
        done: usize,
        /// Runs in all.
        all: usize,
    },
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
    ) -> Result<Vec<Row>, StudyError> {
        let bounds = self.bounds()?;
        let (cells, all) = (self.cells(), self.runs());
        let finished = Mutex::new(0usize);
        let rows = cells.par_iter().map(|cell| {
            let mut found = Vec::new();
            for &seed in &self.seeds {
                if stop.load(Ordering::Relaxed) {
                    let done = finished.lock().map(|done| *done).unwrap_or_default();
                    return Err(StudyError::Stopped { done, all });
                }
                found.push(self.slide(cell, seed, make)?);
                if let Ok(mut finished) = finished.lock() {
                    *finished += 1;
                }
                done();
            }
            let key = (cell.device.clone(), cell.course.name());
            let perfect = bounds.get(&key).copied().unwrap_or_default();
            let arrived = found.iter().filter(|figures| figures.arrived).count();
            let (figures, runs) = (over(&found), found.len());
            Ok(Row { cell: cell.clone(), figures, arrived, runs, perfect })
        });
        rows.collect()
    }

    fn slide(&self, cell: &Cell, seed: u64, make: &MakeLaw) -> Result<Figures, StudyError> {
        let failed = |source: ExperimentError| StudyError::Experiment {
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

    /// The bound of every device on every course.
    fn bounds(&self) -> Result<BTreeMap<(String, &'static str), Perfect>, StudyError> {
        let mut bounds = BTreeMap::new();
        for device in &self.devices {
            let failed = |error: crate::config::ConfigError| StudyError::Experiment {
                cell: device.clone(),
                source: Box::new(error.into()),
            };
            let definition = DeviceDefinition::load(device).map_err(failed)?;
            let mechanism = definition.mechanism.as_ref();
            for &kind in &self.courses {
                let course = Course::new(kind, self.stiffness_N_per_m, mechanism.reach_m().1);
                let found = perfect(mechanism, &definition.residual_Nm, &course, self.hand);
                bounds.insert((device.clone(), kind.name()), found);
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
        let rows = study.run(&none, &count, &AtomicBool::new(false)).unwrap();
        assert_eq!((rows.len(), done.into_inner()), (2, 4));
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let again = one.install(|| study.run(&none, &|| (), &AtomicBool::new(false)).unwrap());
        for (a, b) in rows.iter().zip(&again) {
            assert_eq!((&a.cell, a.figures), (&b.cell, b.figures));
        }
        assert!((1.0..1.2).contains(&rows[0].ratio().unwrap()), "{:?}", rows[0]);
        let text = report::markdown(&study, &rows);
        assert!(text.contains("straight-45") && text.contains("| `sliding` |"), "{text}");
        assert_eq!(report::csv(&rows).lines().count(), 3);
    }

    #[test]
    fn a_study_can_be_stopped_and_tells_what_failed() {
        let stopped = small().run(&none, &|| (), &AtomicBool::new(true)).unwrap_err().to_string();
        assert!(stopped.contains("of 4 runs"), "{stopped}");
        let own = Study { laws: vec![Law::Own("mine".into())], ..small() };
        let failed = own.run(&none, &|| (), &AtomicBool::new(false)).unwrap_err().to_string();
        assert!(failed.contains("there is none") && failed.contains("mine"), "{failed}");
    }
}

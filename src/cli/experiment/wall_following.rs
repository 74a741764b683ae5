//! `hapticd experiment wall-following`: all laws on all courses beside the passive bound.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Context, ensure};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Map, json};

use super::exec_law::ExecLaw;
use crate::actuation::Strategy;
use crate::analysis::experiment::wall_following::report::{self, COLUMNS, Value};
use crate::analysis::experiment::wall_following::{Found, Law, Study, pictures};
use crate::analysis::wall_following::{Beside, CourseKind, Flesh, HandSettings, OwnLaw};
use crate::cli::design::distinct;

/// Lag of the brakes in the pictures.
const PICTURED_LAG_S: f64 = 0.002;

/// Follow walls with every law, beside what brakes allow (Cho 2005, section 8)
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd experiment wall-following --quick
  hapticd experiment wall-following --device cho-2005 --course corner,hollow --law sliding
  hapticd experiment wall-following --law \"exec:python3 docs/examples/law.py\" --course straight
  hapticd experiment wall-following --quick --law sliding --beside along:-3
  hapticd experiment wall-following --quick --json | jq '.rows[] | [.law, .hand_mean_N]'

Without restrictions: both devices of Cho 2005, all laws, all courses, brake lags of 0, 10 and
30 ms, with and without force sensor, 4,096 and 65,536 counts, three seeds. Time is virtual.")]
pub struct WallFollowing {
    /// Devices by name or file; of two freedoms
    #[arg(
        long,
        value_name = "NAMES",
        value_delimiter = ',',
        default_value = "cho-2005,cho-2005-unoptimised"
    )]
    device: Vec<String>,
    /// Laws by name, or exec:COMMAND for one of your own; repeat for more. Without it: all
    #[arg(long, value_name = "LAW")]
    law: Vec<String>,
    /// Courses: straight, straight+30, straight-45, corner, edge, hollow, ball, corridor.
    /// Without it: all
    #[arg(long, value_name = "NAMES", value_delimiter = ',', allow_hyphen_values = true)]
    course: Vec<CourseKind>,
    /// Lags of the brakes, ms, 0 to 1000
    #[arg(long, value_name = "MS", value_delimiter = ',', default_value = "0,10,30", value_parser = parse_lag_ms)]
    lag_ms: Vec<f64>,
    /// With the force sensor, without, or both
    #[arg(long, value_name = "WHICH", default_value = "both", value_parser = ["yes", "no", "both"])]
    sensor: String,
    /// Encoder counts per turn, 16 to 100,000,000
    #[arg(long, value_name = "N", value_delimiter = ',', default_value = "65536,4096", value_parser = parse_counts)]
    counts: Vec<f64>,
    /// Number of seeds, 1 to 1000
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..=1000))]
    seeds: u64,
    /// Hand: press in newtons, 0.5 to 50
    #[arg(long, value_name = "N", default_value_t = 10.0, value_parser = parse_press_N)]
    press: f64,
    /// Speed with which the hand meets the wall, m/s, 0.005 to 1
    #[arg(long, value_name = "M_PER_S", default_value_t = 0.025, value_parser = parse_speed)]
    approach: f64,
    /// The hand has a mass and a soft palm
    #[arg(long)]
    flesh: bool,
    /// Beside the walls: along:N or out:N (newtons, -50 to 50, of the first wall), viscous:D
    /// (N s/m), padding:K (a soft layer of 5 mm, N/m)
    #[arg(long, value_name = "WHAT", default_value = "nothing", allow_hyphen_values = true)]
    beside: Beside,
    /// One device, the straight wall, a corner and a hollow sphere, one seed: half a minute
    #[arg(long)]
    quick: bool,
    /// An answer of an exec: law may take this long, ms; its first, before which an interpreter
    /// has to start, ten seconds at least
    #[arg(long, value_name = "MS", default_value_t = 1000, value_parser = clap::value_parser!(u64).range(1..=60_000))]
    law_timeout_ms: u64,
    /// Where report.md, figures.csv and the pictures go
    #[arg(long, value_name = "DIR", default_value = "hapticd-wall-following")]
    out: PathBuf,
    /// Print the table as one JSON object, too
    #[arg(long)]
    json: bool,
}

fn parse_within(text: &str, least: f64, most: f64, unit: &str) -> Result<f64, String> {
    let number = text.trim().parse().ok().filter(|number| (least..=most).contains(number));
    number.ok_or_else(|| format!("must be {least} to {most} {unit}"))
}

fn parse_lag_ms(text: &str) -> Result<f64, String> {
    parse_within(text, 0.0, 1000.0, "ms")
}

fn parse_counts(text: &str) -> Result<f64, String> {
    parse_within(text, 16.0, 1e8, "counts").map(f64::round)
}

fn parse_press_N(text: &str) -> Result<f64, String> {
    parse_within(text, 0.5, 50.0, "N")
}

fn parse_speed(text: &str) -> Result<f64, String> {
    parse_within(text, 0.005, 1.0, "m/s")
}

impl WallFollowing {
    /// Runs it, writes the report, prints where it is.
    pub fn run(self) -> anyhow::Result<()> {
        let study = self.study()?;
        std::fs::create_dir_all(&self.out)
            .with_context(|| format!("cannot make {}", self.out.display()))?;
        let stop = stop_on_ctrl_c()?;
        let bar = progress(study.runs() as u64);
        let limit = Duration::from_millis(self.law_timeout_ms);
        let make = |command: &str| {
            let command = command.strip_prefix("exec:").unwrap_or(command);
            ExecLaw::start(command, limit, Arc::clone(&stop))
                .map(|law| Box::new(law) as Box<dyn OwnLaw>)
        };
        let found = study.run(&make, &|| bar.inc(1), &stop);
        bar.finish_and_clear();
        let found = found?;
        let [done, all] = found.slides;
        ensure!(done > 0, "stopped before the first of {all} slides was done");
        let written = self.write(&study, &found)?;
        if self.json {
            say!("{}", to_json(&study, &found));
        } else {
            say!("{done} slides, {} rows", found.rows.len());
            for path in written {
                say!("{}", path.display());
            }
        }
        let out = self.out.display();
        ensure!(done == all, "stopped after {done} of {all} slides; {out} says so");
        Ok(())
    }

    /// The grid, restricted.
    fn study(&self) -> anyhow::Result<Study> {
        let laws: Vec<Law> = if self.law.is_empty() {
            Strategy::ALL
                .into_iter()
                .filter(|law| *law != Strategy::Auto)
                .map(Law::BuiltIn)
                .collect()
        } else {
            self.law.iter().map(|name| parse_law(name)).collect::<anyhow::Result<_>>()?
        };
        let sensors = match self.sensor.as_str() {
            "yes" => vec![true],
            "no" => vec![false],
            _ => vec![true, false],
        };
        let flesh = self.flesh.then(Flesh::default);
        let usual = HandSettings::default();
        let hand =
            HandSettings { press_N: self.press, approach_m_per_s: self.approach, flesh, ..usual };
        let courses =
            if self.course.is_empty() { CourseKind::ALL.into() } else { self.course.clone() };
        let mut study = Study {
            // What is named twice is run once.
            devices: distinct(self.device.clone()),
            laws: distinct(laws),
            courses: distinct(courses),
            lags_s: distinct(self.lag_ms.iter().map(|ms| 1e-3 * ms).collect()),
            sensors,
            counts: distinct(self.counts.clone()),
            seeds: (1..=self.seeds).collect(),
            hand,
            beside: self.beside,
            stiffness_N_per_m: 1e7,
        };
        if self.quick {
            study.devices.truncate(1);
            study.counts.truncate(1);
            study.seeds.truncate(1);
            if self.course.is_empty() {
                study.courses = vec![CourseKind::Straight, CourseKind::Corner, CourseKind::Hollow];
            }
        }
        ensure!(study.runs() > 0, "nothing to run: every list needs at least one entry");
        Ok(study)
    }

    /// Writes everything; the paths.
    fn write(&self, study: &Study, found: &Found) -> anyhow::Result<Vec<PathBuf>> {
        // What took the minutes goes first: a disk that is full loses pictures.
        let table = report::csv(study, &found.rows);
        let mut written = vec![save(&self.out.join("figures.csv"), &table)?];
        let mut text = report::markdown(study, found);
        if study.courses.contains(&CourseKind::Straight) && found.is_complete() {
            text.push_str(
                "## Pictures\n\nOn the straight wall, with the sensor, brake lag 2 ms.\n",
            );
            for device in &study.devices {
                for (name, figure) in pictures::pictures(device, study.hand, PICTURED_LAG_S)? {
                    for ending in ["svg", "png"] {
                        let path = self.out.join(format!("{name}.{ending}"));
                        figure.save(&path)?;
                        written.push(path);
                    }
                    text += &format!("\n![{name}]({name}.png)\n");
                }
            }
        }
        written.push(save(&self.out.join("report.md"), &text)?);
        written.reverse();
        Ok(written)
    }
}

pub(super) fn save(path: &Path, content: &str) -> anyhow::Result<PathBuf> {
    std::fs::write(path, content).with_context(|| format!("cannot write {}", path.display()))?;
    Ok(path.to_owned())
}

fn parse_law(name: &str) -> anyhow::Result<Law> {
    match name.strip_prefix("exec:") {
        Some(command) => {
            ensure!(!command.trim().is_empty(), "--law exec: needs a command, as in exec:./my-law");
            Ok(Law::Own(name.to_owned()))
        }
        None => match name.parse::<Strategy>() {
            Ok(strategy) => Ok(Law::BuiltIn(strategy)),
            Err(error) => Err(anyhow::anyhow!("--law {name}: {error}, or exec:COMMAND")),
        },
    }
}

fn progress(runs: u64) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:30} {pos}/{len} slides, {eta} left");
    let bar = ProgressBar::new(runs);
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}

/// True from the moment that somebody presses Ctrl-C.
pub(super) fn stop_on_ctrl_c() -> anyhow::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let (runtime, told) = (crate::cli::runtime()?, Arc::clone(&stop));
    std::thread::spawn(move || {
        if runtime.block_on(tokio::signal::ctrl_c()).is_ok() {
            told.store(true, Ordering::Relaxed);
        }
    });
    Ok(stop)
}

fn to_json(study: &Study, found: &Found) -> serde_json::Value {
    let rows = found.rows.iter().map(|row| {
        let fields = COLUMNS.iter().zip(report::values(study, row)).map(|(name, value)| {
            let value = match value {
                Value::Text(text) => json!(text),
                Value::Number(number) => json!(number),
                Value::Flag(flag) => json!(flag),
            };
            ((*name).to_owned(), value)
        });
        fields.collect::<Map<_, _>>()
    });
    json!({
        "experiment": "wall-following",
        "complete": found.is_complete(),
        "beside": study.beside.to_string(),
        "seeds": study.seeds,
        "press_N": study.hand.press_N,
        "stiffness_N_per_m": study.stiffness_N_per_m,
        "rows": rows.collect::<Vec<_>>(),
    })
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        study: WallFollowing,
    }

    fn parsed(words: &[&str]) -> Result<WallFollowing, String> {
        let line = Line::try_parse_from([&["wall-following"][..], words].concat());
        line.map(|line| line.study).map_err(|error| error.to_string())
    }

    #[test]
    fn the_whole_grid_is_that_of_the_table_and_can_be_restricted() {
        let all = parsed(&[]).unwrap().study().unwrap();
        let laws = Strategy::ALL.len() - 1;
        assert_eq!(all.runs(), 2 * laws * CourseKind::ALL.len() * 3 * 2 * 2 * 3);
        let quick = parsed(&["--quick", "--law", "sliding", "--law", "exec:x"]).unwrap();
        assert_eq!(quick.study().unwrap().runs(), 2 * 3 * 3 * 2);
        let twice = ["--quick", "--law", "sliding", "--law", "sliding", "--lag-ms", "0,10,0"];
        assert_eq!(parsed(&twice).unwrap().study().unwrap().runs(), 3 * 2 * 2);
        for (words, told) in [
            (["--lag-ms", "-1"], "0 to 1000 ms"),
            (["--counts", "3"], "16 to 100000000 counts"),
            (["--course", "moon"], "one of straight"),
            (["--press", "nan"], "0.5 to 50 N"),
            (["--sensor", "maybe"], "both"),
            (["--beside", "out:99"], "-50 to 50 N"),
        ] {
            let error = parsed(&[format!("{}={}", words[0], words[1]).as_str()]).unwrap_err();
            assert!(error.contains(told), "{words:?}: {error}");
        }
        for (law, told) in [("magic", "exec:COMMAND"), ("exec: ", "needs a command")] {
            let error = parsed(&["--law", law]).unwrap().study().unwrap_err().to_string();
            assert!(error.contains(told), "{law}: {error}");
        }
    }

    #[test]
    fn a_report_has_its_tables_and_pictures() {
        let directory = tempfile::tempdir().unwrap();
        let out = directory.path().join("report");
        let words = ["--quick", "--course", "straight", "--law", "sliding", "--lag-ms", "0"];
        let command = parsed(&words).unwrap();
        let command = WallFollowing { out: out.clone(), ..command };
        command.run().unwrap();
        let report = std::fs::read_to_string(out.join("report.md")).unwrap();
        assert!(report.contains("cho-2005") && report.contains("| `sliding` |"), "{report}");
        for name in ["fig13-path", "fig14-time", "fig15-snapshots"] {
            for ending in ["svg", "png"] {
                let path = out.join(format!("{name}-cho-2005.{ending}"));
                assert!(std::fs::metadata(&path).unwrap().len() > 5_000, "{}", path.display());
            }
        }
        let table = std::fs::read_to_string(out.join("figures.csv")).unwrap();
        assert_eq!(table.lines().count(), 3);
    }
}

//! `hapticd replay`: a recording run again, bit by bit, or under another law.

use std::path::PathBuf;

use anyhow::{Context, bail, ensure};
use clap::Args;
use serde_json::{Value, json};

use crate::actuation::Strategy;
use crate::recording::{
    Comparison, End, Hand, Measures, Recorded, Run, Verdict, compare, draw, replay,
};

/// More gaps than this are counted, not listed.
const GAPS: usize = 5;

/// Run a recording again: is every report the same to the last bit? Or: what would another
/// law have made of the same hand?
#[derive(Debug, Args)]
#[command(after_help = "Exit code 1: a tick differs, or nothing or not all in the file could be
compared: a state, ticks, plans or setpoints are missing, and what is missing is told.

Examples:
  hapticd replay run.hrec
  hapticd replay run.hrec --law predicted-velocity --picture laws.svg")]
pub struct Replay {
    /// A file of `hapticd record`, or a black box
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Compare this law with the recorded one, on a simulated device; names as `ctl strategy`
    #[arg(long, value_name = "NAME")]
    law: Option<Strategy>,
    /// Draw the comparison here, as SVG; must not exist
    #[arg(long, value_name = "FILE", requires = "law")]
    picture: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

impl Replay {
    /// Reads, runs and tells.
    pub fn run(self) -> anyhow::Result<()> {
        let context = || format!("cannot read {}", self.file.display());
        let bytes = std::fs::read(&self.file).with_context(context)?;
        let recorded = Recorded::read(bytes).with_context(context)?;
        match self.law {
            None => self.again(&recorded),
            Some(law) => self.compare(&recorded, law),
        }
    }

    fn again(&self, recorded: &Recorded) -> anyhow::Result<()> {
        let verdict = replay(recorded);
        if self.json {
            say!("{}", verdict_json(recorded, &verdict));
        } else {
            tell(recorded, &verdict);
        }
        match &verdict.difference {
            Some(difference) => bail!("tick {} differs", difference.tick),
            None if verdict.equal == 0 => bail!("nothing compared: no tick could be replayed"),
            None if !verdict.is_bit_equal() => {
                let missing = verdict.ticks - verdict.equal;
                bail!("{missing} of {} ticks could not be compared", verdict.ticks)
            }
            None => Ok(()),
        }
    }

    fn compare(&self, recorded: &Recorded, law: Strategy) -> anyhow::Result<()> {
        let comparison = compare(recorded, law)?;
        if let Some(path) = &self.picture {
            let svg = draw(&comparison);
            let written = std::fs::File::create_new(path)
                .and_then(|mut file| std::io::Write::write_all(&mut file, svg.as_bytes()));
            written.with_context(|| format!("cannot write {}", path.display()))?;
        }
        if self.json {
            say!("{}", comparison_json(&comparison));
        } else {
            print_comparison(&comparison);
            if let Some(path) = &self.picture {
                say!("picture: {}", path.display());
            }
        }
        ensure!(!comparison.runs.is_empty(), "nothing was compared");
        Ok(())
    }
}

fn end_text(end: &End) -> Option<String> {
    match end {
        End::Whole => None,
        End::CutShort { at_byte } => {
            Some(format!("the file was cut short: read up to byte {at_byte}"))
        }
        End::Broken { at_byte, why } => {
            Some(format!("the file is broken at byte {at_byte} ({why}): read up to there"))
        }
    }
}

fn tell(recorded: &Recorded, verdict: &Verdict) {
    let header = &recorded.header;
    say!(
        "{}, hapticd {}, {}: {} ticks",
        header.device,
        header.version,
        header.cause,
        verdict.ticks
    );
    if let Some(text) = end_text(&verdict.end) {
        say!("{text}");
    }
    for gap in verdict.gaps.iter().take(GAPS) {
        say!("from tick {} on it is not exact until the next state: {}", gap.tick, gap.why);
    }
    if verdict.gaps.len() > GAPS {
        say!("and {} gaps more", verdict.gaps.len() - GAPS);
    }
    match &verdict.difference {
        None if verdict.equal == 0 => {
            say!("nothing compared: none of {} ticks could be run again", verdict.ticks);
        }
        None if verdict.is_bit_equal() => {
            say!("bit-equal: every report of all {} ticks", verdict.ticks);
        }
        None => say!(
            "bit-equal: every report of {} ticks; {} could not be run again",
            verdict.equal,
            verdict.ticks - verdict.equal
        ),
        Some(difference) => say!(
            "{} ticks are bit-equal, then tick {} differs in {}:\n  recorded {}\n  replayed {}",
            verdict.equal,
            difference.tick,
            difference.field,
            difference.recorded,
            difference.replayed
        ),
    }
}

fn verdict_json(recorded: &Recorded, verdict: &Verdict) -> Value {
    let difference = verdict.difference.as_ref().map(|d| {
        json!({ "tick": d.tick, "field": d.field, "recorded": d.recorded, "replayed": d.replayed })
    });
    let gaps: Vec<_> =
        verdict.gaps.iter().map(|gap| json!({ "tick": gap.tick, "why": gap.why })).collect();
    json!({
        "device": recorded.header.device,
        "cause": recorded.header.cause,
        "ticks": verdict.ticks,
        "equal": verdict.equal,
        "bit_equal": verdict.is_bit_equal(),
        "difference": difference,
        "gaps": gaps,
        "whole": verdict.end == End::Whole,
        "end": end_text(&verdict.end),
    })
}

/// How a figure is read.
type Figure = fn(&Measures) -> Option<f64>;

/// Rows of the table: name, unit, and how it is read.
const ROWS: [(&str, &str, Figure); 9] = [
    ("touching", "s", |m| Some(m.touching_s)),
    ("stuck share", "%", |m| m.stuck_share.map(|share| 100.0 * share)),
    ("penetration", "mm", |m| m.penetration_mm),
    ("hand along, mean", "N", |m| m.along_mean_N),
    ("hand along, largest", "N", |m| m.along_max_N),
    ("approximation angle", "deg", |m| m.angle_mean_deg),
    ("rms jerk", "m/s3", |m| m.jerk_rms_m_per_s3),
    ("largest step chosen", "N", |m| m.chosen_step_N),
    ("largest step at the handle", "N", |m| m.step_N),
];

fn print_comparison(comparison: &Comparison) {
    match comparison.hand {
        Hand::Follows { stiffness_N_per_m, damping_N_s_per_m } => say!(
            "closed loop: the recorded hand as a spring of {stiffness_N_per_m} N/m and a damper of {damping_N_s_per_m} N s/m pulls a simulated {}",
            comparison.device
        ),
        Hand::Unknown => say!(
            "open loop: the hand force was not measured, so the motion is the recorded one and only what the law answers differs"
        ),
    }
    let heads = comparison.runs.iter().map(|run| format!("{:>32}", run.name)).collect::<String>();
    say!("{:<30}{heads}", "");
    for (name, unit, read) in ROWS {
        let cell = |value: Option<f64>| match value {
            Some(value) => format!("{value:>32.3}"),
            None => format!("{:>32}", "-"),
        };
        let cells: String = comparison.runs.iter().map(|run| cell(read(&run.measures))).collect();
        say!("{:<30}{cells}", format!("{name} [{unit}]"));
    }
}

fn comparison_json(comparison: &Comparison) -> Value {
    let run = |run: &Run| -> Value {
        let rows = ROWS.iter().map(|(name, unit, read)| {
            let key = format!("{name} {unit}").replace(", ", "_").replace([' ', '/'], "_");
            (key.replace('%', "percent"), json!(read(&run.measures)))
        });
        let name = ("name".to_owned(), json!(run.name));
        Value::Object(std::iter::once(name).chain(rows).collect())
    };
    // Two runs may have the same name: the law that is compared may be the recorded one.
    let runs: Vec<_> = comparison.runs.iter().map(run).collect();
    let closed = matches!(comparison.hand, Hand::Follows { .. });
    json!({ "device": comparison.device, "closed_loop": closed, "runs": runs })
}

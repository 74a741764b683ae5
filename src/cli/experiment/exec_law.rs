//! `--law exec:COMMAND`: a researcher's own law as a process, one JSON line each way per tick.
//!
//! The command is run by `sh -c`, one process per slide. Each tick it reads a line
//!
//! ```text
//! {"time_s":..,"tick_s":..,"position_m":[x,y],"velocity_m_per_s":[x,y],
//!  "hand_force_N":[x,y] or null,"reference_N_per_Nm":[[x,y],..],"inertia_kg":[[..],[..]],
//!  "walls":[{"normal":[x,y],"depth_m":..,"force_N":..},..],
//!  "max_torque_Nm":[..],"lag_s":[..]}
//! ```
//!
//! in the device's plane, `reference` and limits one per brake, and answers with a line
//! `{"capacity_Nm":[..]}`, one number from 0 to its limit per brake. It may keep whatever it
//! likes between lines; what it writes on stderr is the user's to see. A process that ends,
//! answers something else or unasked, does not read, or takes too long ends the experiment with
//! what was wrong; then it is killed, with all that it started.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process_group};
use serde::Deserialize;
use serde_json::json;

use crate::analysis::wall_following::{OwnLaw, Seen};
use crate::notation::{ActuatorVector, PlaneVector};

/// An interpreter needs its time before the first answer.
const START: Duration = Duration::from_secs(10);

/// So often it is looked whether somebody wants to stop.
const PATIENCE: Duration = Duration::from_millis(100);

/// No answer is longer, bytes.
const LONGEST: u64 = 65_536;

/// A law in another process.
pub struct ExecLaw {
    command: String,
    child: Child,
    questions: SyncSender<String>,
    lines: Receiver<std::io::Result<String>>,
    limit: Duration,
    stop: Arc<AtomicBool>,
    tick: u64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Answer {
    capacity_Nm: Vec<f64>,
}

impl ExecLaw {
    /// Starts the process; each later answer may take `limit`, and none is waited for once
    /// `stop` is true.
    pub fn start(command: &str, limit: Duration, stop: Arc<AtomicBool>) -> Result<Self, String> {
        let mut child = Command::new("sh")
            .args(["-c", command])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .process_group(0)
            .spawn()
            .map_err(|error| format!("`{command}` cannot be started: {error}"))?;
        let (Some(mut stdin), Some(stdout)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(format!("`{command}` has no pipes"));
        };
        let (sender, lines) = sync_channel(1);
        std::thread::spawn(move || {
            let mut reader = BufReader::new(stdout);
            loop {
                let mut line = String::new();
                let read = std::io::Read::take(&mut reader, LONGEST).read_line(&mut line);
                let ended = !matches!(read, Ok(1..));
                if sender.send(read.map(|_| line)).is_err() || ended {
                    break;
                }
            }
        });
        // A law that does not read must not hold up who asks it.
        let (questions, asked) = sync_channel::<String>(1);
        std::thread::spawn(move || {
            while let Ok(question) = asked.recv() {
                if stdin.write_all(question.as_bytes()).and_then(|()| stdin.flush()).is_err() {
                    break;
                }
            }
        });
        Ok(Self { command: command.to_owned(), child, questions, lines, limit, stop, tick: 0 })
    }

    fn answer(&mut self) -> Result<String, String> {
        let limit = if self.tick == 1 { self.limit.max(START) } else { self.limit };
        let until = Instant::now() + limit;
        let received = loop {
            let left = until.saturating_duration_since(Instant::now());
            match self.lines.recv_timeout(left.min(PATIENCE)) {
                Err(RecvTimeoutError::Timeout) if self.stop.load(Ordering::Relaxed) => {
                    return Err(self.complaint("was not waited for"));
                }
                Err(RecvTimeoutError::Timeout) if left > PATIENCE => {}
                received => break received,
            }
        };
        match received {
            Ok(Ok(line)) if !line.is_empty() => Ok(line),
            Ok(Err(error)) => Err(self.complaint(&format!("wrote no text: {error}"))),
            Err(RecvTimeoutError::Timeout) => {
                Err(self.complaint(&format!("did not answer within {} ms", limit.as_millis())))
            }
            _ => Err(self.ended()),
        }
    }

    /// The process is gone; how.
    fn ended(&mut self) -> String {
        for _ in 0..20 {
            if let Ok(Some(status)) = self.child.try_wait() {
                return self.complaint(&format!("ended ({status})"));
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        self.complaint("closed its output")
    }

    fn complaint(&self, what: &str) -> String {
        format!("`{}` {what}, in tick {}", self.command, self.tick)
    }
}

impl OwnLaw for ExecLaw {
    fn capacities(&mut self, seen: &Seen) -> Result<ActuatorVector, String> {
        self.tick += 1;
        match self.lines.try_recv() {
            Ok(Ok(line)) if !line.is_empty() => {
                return Err(self.complaint(&format!("answered `{}` unasked", told(&line))));
            }
            Ok(_) => return Err(self.ended()),
            Err(_) => {} // nothing yet, as it should be; an end shows in what follows
        }
        match self.questions.try_send(question(seen) + "\n") {
            Ok(()) => {}
            Err(TrySendError::Full(_)) => return Err(self.complaint("does not read its input")),
            Err(TrySendError::Disconnected(_)) => return Err(self.ended()),
        }
        let line = self.answer()?;
        capacities(&line, seen).map_err(|what| self.complaint(&what))
    }
}

impl Drop for ExecLaw {
    fn drop(&mut self) {
        // It has nothing left to do, nor has what it started; who is gone is not there to be ended.
        if let Some(group) = Pid::from_raw(self.child.id().cast_signed()) {
            let _ = kill_process_group(group, Signal::KILL);
        }
        let _ = self.child.wait();
    }
}

/// One tick as a line.
fn question(seen: &Seen) -> String {
    let pair = |v: &PlaneVector| [v.x, v.y];
    let each = |v: &ActuatorVector| v.iter().take(seen.actuators).copied().collect::<Vec<_>>();
    let walls = seen.walls.iter().map(|wall| {
        json!({ "normal": pair(&wall.normal), "depth_m": wall.depth_m, "force_N": wall.force_N })
    });
    let rays = (0..seen.actuators).map(|i| [seen.reference[(0, i)], seen.reference[(1, i)]]);
    let row = |i: usize| [seen.inertia[(i, 0)], seen.inertia[(i, 1)]];
    json!({
        "time_s": seen.time_s,
        "tick_s": seen.tick_s,
        "position_m": pair(&seen.p_BH_m),
        "velocity_m_per_s": pair(&seen.v_BH_m_per_s),
        "hand_force_N": seen.F_hand_BH_N.as_ref().map(pair),
        "reference_N_per_Nm": rays.collect::<Vec<_>>(),
        "inertia_kg": [row(0), row(1)],
        "walls": walls.collect::<Vec<_>>(),
        "max_torque_Nm": each(seen.max_torque_Nm),
        "lag_s": each(seen.lag_s),
    })
    .to_string()
}

/// The beginning of what it said.
fn told(line: &str) -> String {
    line.trim_end().chars().take(80).collect()
}

/// The capacities of an answer, or what is wrong with it.
fn capacities(line: &str, seen: &Seen) -> Result<ActuatorVector, String> {
    let Answer { capacity_Nm } = serde_json::from_str(line).map_err(|error| {
        format!("must answer {{\"capacity_Nm\":[..]}}, not `{}` ({error})", told(line))
    })?;
    if capacity_Nm.len() != seen.actuators {
        let (found, wanted) = (capacity_Nm.len(), seen.actuators);
        return Err(format!("answered {found} capacities: the device has {wanted} brakes"));
    }
    for (i, capacity) in capacity_Nm.iter().enumerate() {
        let most_Nm = seen.max_torque_Nm[i];
        if !(0.0..=most_Nm).contains(capacity) {
            return Err(format!(
                "answered capacity_Nm[{i}] = {capacity}: must be 0 to {most_Nm} N m"
            ));
        }
    }
    Ok(ActuatorVector::from_fn(|i, _| capacity_Nm.get(i).copied().unwrap_or(0.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::wall_following::{Experiment, Figures, run_with};

    const LIMIT: Duration = Duration::from_millis(2_000);

    fn slide(command: &str) -> Result<Figures, String> {
        let mut law = ExecLaw::start(command, LIMIT, Arc::default())?;
        run_with(&Experiment::default(), Some(&mut law), |_| ()).map_err(|error| error.to_string())
    }

    #[test]
    fn the_example_law_in_python_takes_the_hand_to_the_end_of_the_wall() {
        let example = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/examples/law.py");
        let found = slide(&format!("python3 {example}")).unwrap();
        assert!(found.arrived, "{found:?}");
        assert!((0.0..2.0).contains(&found.penetration_mm), "{found:?}");
        assert!((5.0..12.0).contains(&found.hand_mean_N), "{found:?}");
    }

    #[test]
    fn a_law_that_dies_or_talks_rubbish_is_told_what_was_wrong() {
        for (command, told) in [
            ("exit 3", "ended"),
            ("cat", "must answer"),
            ("while read a; do echo hello; done", "not `hello`"),
            ("while read a; do echo '{\"capacity_Nm\":[1]}'; done", "1 capacities"),
            ("while read a; do echo '{\"capacity_Nm\":[1,2,3,-4]}'; done", "capacity_Nm[3] = -4"),
            ("while read a; do echo '{\"capacity_Nm\":[1,2,3,99]}'; done", "0 to 20 N m"),
            ("/no/such/law", "ended"),
            ("yes '{\"capacity_Nm\":[0,0,0,0]}'", "unasked"),
        ] {
            let error = slide(command).unwrap_err();
            assert!(error.contains(told) && error.contains(command), "{command}: {error}");
        }
        // Twice for once: it runs ahead. Where its second answer is late it is the next one's, and
        // soon the law is asked faster than it reads.
        let twice = "while read a; do printf '{\"capacity_Nm\":[0,0,0,0]}\\n%.0s' 1 2; done";
        let error = slide(twice).unwrap_err();
        let told = ["unasked", "does not read its input"];
        assert!(told.iter().any(|told| error.contains(told)), "{error}");
    }

    #[test]
    fn a_law_that_takes_too_long_is_given_up() {
        let slow = "read a; echo '{\"capacity_Nm\":[0,0,0,0]}'; read a; sleep 5";
        let mut law = ExecLaw::start(slow, Duration::from_millis(50), Arc::default()).unwrap();
        let error = run_with(&Experiment::default(), Some(&mut law), |_| ()).unwrap_err();
        assert!(error.to_string().contains("within 50 ms, in tick 2"), "{error}");
    }

    #[test]
    fn nobody_waits_for_a_law_once_it_is_stopped() {
        let stop = Arc::new(AtomicBool::new(true));
        let began = Instant::now();
        let mut law = ExecLaw::start("sleep 600", LIMIT, stop).unwrap();
        let error = run_with(&Experiment::default(), Some(&mut law), |_| ()).unwrap_err();
        assert!(error.to_string().contains("not waited for"), "{error}");
        // The first answer of a law may take ten seconds.
        assert!(began.elapsed() < START, "{:?}", began.elapsed());
    }

    #[test]
    fn what_a_law_started_ends_with_it() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("pid");
        let command = format!("sleep 600 & echo $! >{}; cat >/dev/null", file.display());
        let mut law = ExecLaw::start(&command, LIMIT, Arc::default()).unwrap();
        law.tick = 1; // the time of an interpreter's start is over
        run_with(&Experiment::default(), Some(&mut law), |_| ()).unwrap_err();
        drop(law);
        let started: i32 = std::fs::read_to_string(&file).unwrap().trim().parse().unwrap();
        let gone = || {
            let state = std::fs::read_to_string(format!("/proc/{started}/stat"));
            state.map_or(true, |state| state.contains(") Z "))
        };
        assert!((0..100).any(|_| {
            std::thread::sleep(Duration::from_millis(20));
            gone()
        }));
    }
}

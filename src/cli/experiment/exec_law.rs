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
//! answers something else, or takes too long ends the experiment with what was wrong.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::Duration;

use serde::Deserialize;
use serde_json::json;

use crate::analysis::wall_following::{OwnLaw, Seen};
use crate::notation::{ActuatorVector, PlaneVector};

/// An interpreter needs its time before the first answer.
const START: Duration = Duration::from_secs(10);

/// No answer is longer, bytes.
const LONGEST: u64 = 65_536;

/// A law in another process.
pub struct ExecLaw {
    command: String,
    child: Child,
    stdin: ChildStdin,
    lines: Receiver<std::io::Result<String>>,
    limit: Duration,
    tick: u64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Answer {
    capacity_Nm: Vec<f64>,
}

impl ExecLaw {
    /// Starts the process; each later answer may take `limit`.
    pub fn start(command: &str, limit: Duration) -> Result<Self, String> {
        let mut child = Command::new("sh")
            .args(["-c", command])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|error| format!("`{command}` cannot be started: {error}"))?;
        let (Some(stdin), Some(stdout)) = (child.stdin.take(), child.stdout.take()) else {
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
        Ok(Self { command: command.to_owned(), child, stdin, lines, limit, tick: 0 })
    }

    fn answer(&mut self) -> Result<String, String> {
        let limit = if self.tick == 1 { self.limit.max(START) } else { self.limit };
        match self.lines.recv_timeout(limit) {
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
        let line = question(seen) + "\n";
        if self.stdin.write_all(line.as_bytes()).and_then(|()| self.stdin.flush()).is_err() {
            return Err(self.ended());
        }
        let line = self.answer()?;
        capacities(&line, seen).map_err(|what| self.complaint(&what))
    }
}

impl Drop for ExecLaw {
    fn drop(&mut self) {
        // It has nothing left to do; one that is gone already is not there to be ended.
        let _ = self.child.kill();
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

/// The capacities of an answer, or what is wrong with it.
fn capacities(line: &str, seen: &Seen) -> Result<ActuatorVector, String> {
    let told = || line.trim_end().chars().take(80).collect::<String>();
    let Answer { capacity_Nm } = serde_json::from_str(line).map_err(|error| {
        format!("must answer {{\"capacity_Nm\":[..]}}, not `{}` ({error})", told())
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
        let mut law = ExecLaw::start(command, LIMIT)?;
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
        ] {
            let error = slide(command).unwrap_err();
            assert!(error.contains(told) && error.contains(command), "{command}: {error}");
        }
    }

    #[test]
    fn a_law_that_takes_too_long_is_given_up() {
        let slow = "read a; echo '{\"capacity_Nm\":[0,0,0,0]}'; read a; sleep 5";
        let mut law = ExecLaw::start(slow, Duration::from_millis(50)).unwrap();
        let error = run_with(&Experiment::default(), Some(&mut law), |_| ()).unwrap_err();
        assert!(error.to_string().contains("within 50 ms, in tick 2"), "{error}");
    }
}

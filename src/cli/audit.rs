//! `hapticd audit`: who did what to a server, from its state directory.

use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use serde_json::Value;

use super::serve::Settings;
use crate::app::state_path;
use crate::audit;

/// Show the last lines of a server's audit log: who did what, and when.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd audit
  hapticd audit --lines 100 --state-dir /var/lib/hapticd
  hapticd audit --lines 100000 --json | jq 'select(.what == \"stopped\")'")]
pub struct Audit {
    /// How many lines, 1 to 100000
    #[arg(long, value_name = "N", default_value = "20",
          value_parser = clap::value_parser!(u32).range(1..=100_000), allow_negative_numbers = true)]
    lines: u32,
    /// Configuration file of the server
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Where that server keeps its state
    #[arg(long, value_name = "DIR")]
    state_dir: Option<PathBuf>,
    /// Print the lines as they are in the log: one JSON object each
    #[arg(long)]
    json: bool,
}

impl Audit {
    /// Prints them, oldest first.
    pub fn run(self) -> anyhow::Result<()> {
        let settings =
            Settings { config: self.config, state_dir: self.state_dir, ..Settings::default() };
        let state_dir = state_path(&settings.server_config()?)?;
        let lines = audit::tail(&state_dir, self.lines as usize);
        let context = || format!("cannot read the audit log in {}", state_dir.display());
        let lines = lines.with_context(context)?;
        if lines.is_empty() && !self.json {
            say!("nothing is recorded in {}", state_dir.display());
        }
        for line in lines {
            match serde_json::from_str(&line) {
                Ok(Value::Object(_)) if self.json => say!("{line}"),
                Ok(object @ Value::Object(_)) => say!("{}", in_words(&object)),
                // A crash leaves half a line, at most.
                _ => eprintln!("hapticd: no line of the audit log: {}", line.escape_debug()),
            }
        }
        Ok(())
    }
}

/// What a client calls itself is its own text: no terminal obeys it.
fn in_words(line: &Value) -> String {
    let text = |key: &str| line[key].as_str().unwrap_or_default().escape_debug().to_string();
    let or = |text: String, other: &str| if text.is_empty() { other.to_owned() } else { text };
    let lost = line["lost"].as_u64().map(|lost| format!("{lost} more are missing"));
    let words = format!(
        "{:<24}  {:<19} {:<16} {:<22} {:<20} {}",
        text("time"),
        or(text("what"), "-"),
        or(text("who"), "-"),
        or(text("from"), "-"),
        or(text("device"), "-"),
        lost.unwrap_or_else(|| text("detail")),
    );
    words.trim_end().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_one_line_whatever_is_in_it() {
        let line = serde_json::json!({
            "time": "2025-11-22T09:30:00.125Z", "what": "stopped", "who": "anna\n\u{1b}[2J",
            "detail": "\u{202e}", "more": [1],
        });
        let said = in_words(&line);
        assert!(
            said.starts_with("2025-11-22T09:30:00.125Z  stopped             anna\\n\\u{1b}[2J")
        );
        assert!(said.ends_with("\\u{202e}") && said.lines().count() == 1, "{said}");
        let lost = in_words(&serde_json::json!({ "time": "t", "lost": 7 }));
        assert!(lost.ends_with("7 more are missing"), "{lost}");
    }
}

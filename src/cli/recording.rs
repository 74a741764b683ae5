//! `hapticd ctl recording`: recordings that are on the server.

use std::fs::File;
use std::path::PathBuf;

use crate::client::Authorized;
use anyhow::Context;
use clap::Subcommand;
use serde_json::{Value, json};

use super::ctl::plain;
use super::record::download;
use crate::proto::recording_service_client::RecordingServiceClient;
use crate::proto::{
    DeleteRecordingRequest, GetRecordingRequest, ListRecordingsRequest, Recording,
    StopRecordingRequest,
};

/// Recordings on the server; `hapticd record` makes one
#[derive(Debug, Subcommand)]
#[command(after_help = "Examples:
  hapticd ctl recording list
  hapticd ctl recording stop left-1763800000
  hapticd ctl recording get left-1763800000 run.hrec
  hapticd ctl recording rm left-1763800000")]
pub enum RecordingCommand {
    /// All of them, of every device
    #[command(after_help = "Examples:
  hapticd ctl recording list
  hapticd ctl recording list --json")]
    List,
    /// End one before its time and keep what came
    #[command(after_help = "Example:
  hapticd ctl recording stop left-1763800000")]
    Stop {
        /// As `list` shows it
        #[arg(value_name = "ID")]
        recording: String,
    },
    /// Delete one that is complete
    #[command(after_help = "Example:
  hapticd ctl recording rm left-1763800000")]
    Rm {
        /// As `list` shows it
        #[arg(value_name = "ID")]
        recording: String,
    },
    /// Fetch one that is complete; it stays on the server
    #[command(after_help = "Example:
  hapticd ctl recording get left-1763800000 run.hrec")]
    Get {
        /// As `list` shows it
        #[arg(value_name = "ID")]
        recording: String,
        /// Where it goes; must not exist
        #[arg(value_name = "FILE")]
        file: PathBuf,
    },
}

type Client = RecordingServiceClient<Authorized>;

impl RecordingCommand {
    /// Does it and prints the answer.
    pub async fn run(self, recordings: &mut Client, json: bool) -> anyhow::Result<()> {
        match self {
            Self::List => {
                let listed = recordings.list_recordings(ListRecordingsRequest {}).await;
                print_list(&listed.map_err(plain)?.into_inner().recordings, json);
            }
            Self::Stop { recording } => {
                let request = StopRecordingRequest { name: name_of(&recording) };
                let stopped = recordings.stop_recording(request).await.map_err(plain)?;
                print_one(&stopped.into_inner(), json);
            }
            Self::Rm { recording } => {
                let name = name_of(&recording);
                let request = DeleteRecordingRequest { name: name.clone() };
                recordings.delete_recording(request).await.map_err(plain)?;
                if json {
                    say!("{}", json!({ "name": name, "deleted": true }));
                } else {
                    say!("{name} deleted");
                }
            }
            Self::Get { recording, file } => get(recordings, &recording, file, json).await?,
        }
        Ok(())
    }
}

async fn get(
    recordings: &mut Client,
    recording: &str,
    path: PathBuf,
    as_json: bool,
) -> anyhow::Result<()> {
    let request = GetRecordingRequest { name: name_of(recording) };
    let recording = recordings.get_recording(request).await.map_err(plain)?.into_inner();
    let mut file =
        File::create_new(&path).with_context(|| format!("cannot make {}", path.display()))?;
    let fetched = download(recordings, &recording, &mut file, &path).await;
    // Half a recording would only be in the way.
    fetched
        .inspect_err(|_| drop(std::fs::remove_file(&path)))
        .with_context(|| recording.name.clone())?;
    if as_json {
        say!("{}", json!({ "name": recording.name, "file": path.display().to_string() }));
    } else {
        say!("{} is in {}", recording.name, path.display());
    }
    Ok(())
}

fn name_of(recording: &str) -> String {
    format!("recordings/{}", recording.strip_prefix("recordings/").unwrap_or(recording))
}

fn print_list(recordings: &[Recording], as_json: bool) {
    if as_json {
        let list: Vec<_> = recordings.iter().map(recording_json).collect();
        say!("{}", Value::from(list));
        return;
    }
    if recordings.is_empty() {
        say!("there is no recording");
    }
    recordings.iter().for_each(|recording| say!("{}", line(recording)));
}

fn print_one(recording: &Recording, as_json: bool) {
    if as_json {
        say!("{}", recording_json(recording));
    } else {
        say!("{}", line(recording));
    }
}

fn line(recording: &Recording) -> String {
    let Recording { name, device, complete, seconds, ticks, lost_ticks, bytes, error } = recording;
    // A server does not count what an earlier one has recorded.
    let known = *seconds > 0.0;
    let ticks = if known { format!("{ticks} ticks of {seconds} s") } else { "?".to_owned() };
    let lost = if *lost_ticks > 0 { format!("  {lost_ticks} lost") } else { String::new() };
    let error = if error.is_empty() { String::new() } else { format!("  {error}") };
    let progress = if *complete { "complete" } else { "under way" };
    let mebibytes = *bytes as f64 / 1048576.0;
    format!("{name:<32} {device:<20} {progress:<9} {mebibytes:>8.1} MiB  {ticks}{lost}{error}")
}

fn recording_json(recording: &Recording) -> Value {
    let Recording { name, device, complete, seconds, ticks, lost_ticks, bytes, error } = recording;
    let known = *seconds > 0.0;
    json!({
        "name": name,
        "device": device,
        "complete": complete,
        "seconds": known.then_some(seconds),
        "ticks": known.then_some(ticks),
        "lost_ticks": known.then_some(lost_ticks),
        "bytes": bytes,
        "error": (!error.is_empty()).then_some(error),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_identifier_is_named_with_or_without_its_collection() {
        assert_eq!(name_of("left-17"), "recordings/left-17");
        assert_eq!(name_of("recordings/left-17"), "recordings/left-17");
    }

    #[test]
    fn what_is_not_known_of_an_earlier_servers_recording_is_not_zero() {
        let found = Recording { complete: true, bytes: 5, ..Recording::default() };
        let json = recording_json(&found);
        assert_eq!((&json["ticks"], &json["seconds"]), (&Value::Null, &Value::Null));
        assert!(line(&found).contains('?'), "{}", line(&found));
        let own = Recording { seconds: 1.0, error: "room".into(), ..found };
        assert_eq!(
            (&recording_json(&own)["ticks"], &recording_json(&own)["error"]),
            (&0.into(), &"room".into())
        );
    }
}

//! `hapticd record`: a while of a running device into a file.

use std::fs::File;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::client::Authorized;
use anyhow::{Context, bail, ensure};
use clap::Args;
use serde_json::json;

use super::ctl::plain;
use super::format;
use super::target::Target;
use crate::client::Services;
use crate::proto::recording_service_client::RecordingServiceClient;
use crate::proto::{
    DeleteRecordingRequest, DownloadRecordingRequest, GetRecordingRequest, Recording,
    StartRecordingRequest, StopRecordingRequest,
};

/// Between two looks at how far it is.
const LOOK: Duration = Duration::from_millis(100);

/// For what came until Ctrl-C to be on the server's disk.
const PATIENCE: Duration = Duration::from_secs(60);

type Client = RecordingServiceClient<Authorized>;

/// Record what a running device senses and decides, tick by tick.
#[derive(Debug, Args)]
#[command(after_help = "Ctrl-C ends it early and keeps what came. Exit code 1: nothing came, or
not all that was asked for; what came is kept.

Examples:
  hapticd record --seconds 10 run.hrec
  hapticd replay run.hrec")]
pub struct Record {
    /// Where it goes; must not exist
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// How long, at most 600 s
    #[arg(long, value_name = "N", value_parser = format::parse_seconds)]
    seconds: Duration,
    #[command(flatten)]
    target: Target,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

impl Record {
    /// Records and fetches.
    pub fn run(self) -> anyhow::Result<()> {
        super::runtime()?.block_on(self.act())
    }

    async fn act(self) -> anyhow::Result<()> {
        let (mut services, parent) = self.target.open().await?;
        let mut file = File::create_new(&self.file)
            .with_context(|| format!("cannot make {}", self.file.display()))?;
        let recorded = self.record(&mut services, parent, &mut file).await;
        // A file without a recording in it would only be in the way.
        let recording = recorded.inspect_err(|_| drop(std::fs::remove_file(&self.file)))?;
        // From here on the file is whole, whatever else fails.
        delete(&mut services.recordings, &recording.name).await;
        self.tell(&recording);
        ensure!(
            recording.error.is_empty(),
            "{} is incomplete: {}; what came is in {}",
            recording.name,
            recording.error,
            self.file.display()
        );
        Ok(())
    }

    /// Whatever goes wrong after the server has begun is told with the recording's name: it is
    /// still there.
    async fn record(
        &self,
        services: &mut Services,
        parent: String,
        file: &mut File,
    ) -> anyhow::Result<Recording> {
        let seconds = self.seconds.as_secs_f64();
        let request = StartRecordingRequest { parent, seconds };
        let started = services.recordings.start_recording(request).await.map_err(plain)?;
        let name = started.into_inner().name;
        let recording = self.watch(&mut services.recordings, &name).await;
        let recording = recording.with_context(|| kept_on_server(&name))?;
        if recording.ticks == 0 {
            delete(&mut services.recordings, &name).await;
            match recording.error.as_str() {
                "" => bail!("{name}: no tick was recorded: the device's loop does not turn"),
                error => bail!("{name}: no tick was recorded: {error}"),
            }
        }
        download(&mut services.recordings, &recording, file, &self.file)
            .await
            .with_context(|| kept_on_server(&name))?;
        Ok(recording)
    }

    /// Until it is complete. Ctrl-C ends it early; a second one gives up.
    async fn watch(&self, recordings: &mut Client, name: &str) -> anyhow::Result<Recording> {
        let progress = std::io::stderr().is_terminal() && !self.json;
        let mut stopped_at = None;
        let interrupted = tokio::signal::ctrl_c();
        tokio::pin!(interrupted);
        loop {
            tokio::select! {
                () = tokio::time::sleep(LOOK) => {}
                signal = &mut interrupted => {
                    signal?;
                    interrupted.set(tokio::signal::ctrl_c());
                    ensure!(stopped_at.is_none(), "interrupted");
                    stopped_at = Some(Instant::now());
                    let request = StopRecordingRequest { name: name.to_owned() };
                    recordings.stop_recording(request).await.map_err(plain)?;
                }
            }
            let request = GetRecordingRequest { name: name.to_owned() };
            let recording = recordings.get_recording(request).await.map_err(plain)?.into_inner();
            if progress {
                let (ticks, mebibytes) = (recording.ticks, recording.bytes as f64 / 1048576.0);
                eprint!("\r{ticks} ticks, {mebibytes:.1} MiB of {:?} ", self.seconds);
                let _ = std::io::stderr().flush();
            }
            if recording.complete {
                if progress {
                    eprintln!();
                }
                return Ok(recording);
            }
            let patient = stopped_at.is_none_or(|at: Instant| at.elapsed() < PATIENCE);
            ensure!(patient, "stopped, but not complete within {PATIENCE:?}");
        }
    }

    fn tell(&self, recording: &Recording) {
        let Recording { device, ticks, lost_ticks, bytes, error, .. } = recording;
        let file = self.file.display();
        if self.json {
            say!(
                "{}",
                json!({
                    "file": file.to_string(),
                    "device": device,
                    "ticks": ticks,
                    "lost_ticks": lost_ticks,
                    "bytes": bytes,
                    "complete": error.is_empty(),
                    "error": (!error.is_empty()).then_some(error),
                })
            );
            return;
        }
        let lost = match lost_ticks {
            0 => String::new(),
            lost => format!(", {lost} more were lost because the server's disk was too slow"),
        };
        say!("{file}: {ticks} ticks of {device}, {bytes} bytes{lost}");
    }
}

fn kept_on_server(name: &str) -> String {
    format!("{name}, which stays on the server (hapticd ctl recording)")
}

/// Whoever has the file needs it no more; that it stays is worth a warning, nothing else.
async fn delete(recordings: &mut Client, name: &str) {
    let request = DeleteRecordingRequest { name: name.to_owned() };
    if let Err(status) = recordings.delete_recording(request).await {
        eprintln!("hapticd: warning: {name} stays on the server: {}", plain(status));
    }
}

/// Fetches one that is complete into a file that is open.
pub async fn download(
    recordings: &mut Client,
    recording: &Recording,
    file: &mut File,
    path: &Path,
) -> anyhow::Result<()> {
    let request = DownloadRecordingRequest { name: recording.name.clone() };
    let pieces = recordings.download_recording(request).await.map_err(plain)?;
    let mut pieces = pieces.into_inner();
    let context = || format!("cannot write {}", path.display());
    let mut bytes = 0;
    while let Some(piece) = pieces.message().await.map_err(plain)? {
        file.write_all(&piece.data).with_context(context)?;
        bytes += piece.data.len() as u64;
    }
    // A server that ends closes the stream as if that were all. What a full disk cut short is
    // as long as it is.
    ensure!(
        bytes >= recording.bytes || !recording.error.is_empty(),
        "{bytes} of {} bytes came",
        recording.bytes
    );
    file.sync_all().with_context(context)
}

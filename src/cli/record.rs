//! `hapticd record`: a while of a running device into a file.

use std::fs::File;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, bail};
use clap::Args;
use serde_json::json;

use super::ctl::plain;
use super::format;
use super::target::Target;
use crate::client::Services;
use crate::proto::{
    DeleteRecordingRequest, DownloadRecordingRequest, GetRecordingRequest, Recording,
    StartRecordingRequest, StopRecordingRequest,
};

/// Between two looks at how far it is.
const LOOK: Duration = Duration::from_millis(100);

/// Record what a running device senses and decides, tick by tick.
#[derive(Debug, Args)]
#[command(after_help = "Ctrl-C ends it early and keeps what came.

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
        self.tell(&recording);
        Ok(())
    }

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
        let recording = self.watch(services, &name).await?;
        download(services, &name, file, &self.file).await?;
        services
            .recordings
            .delete_recording(DeleteRecordingRequest { name })
            .await
            .map_err(plain)?;
        if !recording.error.is_empty() {
            eprintln!("hapticd: {}", recording.error);
        }
        if recording.ticks == 0 {
            bail!("no tick was recorded: the device's loop does not turn");
        }
        Ok(recording)
    }

    /// Until it is complete, or until Ctrl-C.
    async fn watch(&self, services: &mut Services, name: &str) -> anyhow::Result<Recording> {
        let progress = std::io::stderr().is_terminal() && !self.json;
        let interrupted = tokio::signal::ctrl_c();
        tokio::pin!(interrupted);
        loop {
            tokio::select! {
                () = tokio::time::sleep(LOOK) => {}
                signal = &mut interrupted => {
                    signal?;
                    let request = StopRecordingRequest { name: name.to_owned() };
                    let stopped = services.recordings.stop_recording(request).await;
                    return Ok(stopped.map_err(plain)?.into_inner());
                }
            }
            let request = GetRecordingRequest { name: name.to_owned() };
            let recording =
                services.recordings.get_recording(request).await.map_err(plain)?.into_inner();
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
        }
    }

    fn tell(&self, recording: &Recording) {
        let Recording { device, ticks, lost_ticks, bytes, .. } = recording;
        let file = self.file.display();
        if self.json {
            say!(
                "{}",
                json!({ "file": file.to_string(), "device": device, "ticks": ticks, "lost_ticks": lost_ticks, "bytes": bytes })
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

async fn download(
    services: &mut Services,
    name: &str,
    file: &mut File,
    path: &Path,
) -> anyhow::Result<()> {
    let request = DownloadRecordingRequest { name: name.to_owned() };
    let pieces = services.recordings.download_recording(request).await.map_err(plain)?;
    let mut pieces = pieces.into_inner();
    let context = || format!("cannot write {}", path.display());
    while let Some(piece) = pieces.message().await.map_err(plain)? {
        file.write_all(&piece.data).with_context(context)?;
    }
    file.sync_all().with_context(context)
}

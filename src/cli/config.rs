//! `hapticd config`: the documented example, and a check of one's own file.

use std::path::PathBuf;

use anyhow::Context;
use clap::Args;

use crate::config::{EXAMPLE, ServerConfig, load_devices};

/// Print a commented configuration, or check one.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd config --example > hapticd.toml
  hapticd config --check hapticd.toml")]
#[group(required = true, multiple = false)]
pub struct Config {
    /// Print every key with its default and meaning
    #[arg(long)]
    example: bool,
    /// Check a file and the devices that it names
    #[arg(long, value_name = "FILE")]
    check: Option<PathBuf>,
}

impl Config {
    /// Prints the example, or `ok`.
    pub fn run(self) -> anyhow::Result<()> {
        let Some(path) = self.check else {
            say!("{}", EXAMPLE.trim_end());
            return Ok(());
        };
        let text = std::fs::read_to_string(&path)
            .with_context(|| format!("cannot read {}", path.display()))?;
        let config = ServerConfig::from_toml(&text, &path.display().to_string())?;
        let devices = load_devices(&config.devices)?;
        let names: Vec<_> =
            devices.iter().map(|device| format!("devices/{}", device.name)).collect();
        say!("ok: {} serves {} on {}", path.display(), names.join(", "), config.listen);
        Ok(())
    }
}

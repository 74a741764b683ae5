//! Logs: for people or as JSON, on stderr, never per packet.

use tracing_subscriber::EnvFilter;

use crate::config::{LogConfig, LogFormat};

/// Starts logging; `HAPTICD_LOG` overrides the configured level, as in
/// `HAPTICD_LOG=hapticd=debug`. A second call changes nothing.
pub fn init(config: &LogConfig) {
    let level = || EnvFilter::new(format!("hapticd={}", config.level.name()));
    let filter = EnvFilter::try_from_env("HAPTICD_LOG").unwrap_or_else(|_| level());
    let builder = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr);
    // Tests and embedding programs may have a subscriber already.
    let _ = match config.format {
        LogFormat::Human => {
            let ansi = std::io::IsTerminal::is_terminal(&std::io::stderr());
            builder.with_target(false).with_ansi(ansi).try_init()
        }
        LogFormat::Json => builder.json().try_init(),
    };
}

//! The commands. Each reads its arguments, calls the parts, and prints; none of them decides
//! anything about forces. Results go to stdout, everything else to stderr.

/// One line on stdout; see [`say_line`].
macro_rules! say {
    ($($text:tt)*) => { $crate::cli::say_line(format_args!($($text)*)) };
}

mod audit;
mod config;
mod ctl;
mod demo;
#[cfg(feature = "design")]
mod design;
mod doctor;
mod events;
#[cfg(feature = "design")]
mod experiment;
mod explain;
mod format;
mod hand;
mod manipulability;
mod netsim;
mod object;
mod object_fields;
mod object_print;
mod pair;
mod ping;
mod qr;
mod record;
mod recording;
mod replay;
mod scene;
mod scene_figures;
mod scene_file;
mod serve;
mod sessions;
mod settings;
mod target;
mod top;
mod view;
mod wall;

use std::io::{ErrorKind, Write};
use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Networked haptic server: renders the best achievable force at 1 kHz, and tells why.
#[derive(Debug, Parser)]
#[command(name = "hapticd", version, after_help = "Begin with:  hapticd demo wall")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Serve(serve::Serve),
    Demo(demo::Demo),
    #[cfg(feature = "design")]
    Design(design::Design),
    #[cfg(feature = "design")]
    Experiment(experiment::Experiment),
    Scene(scene::Scene),
    Ctl(ctl::Ctl),
    Explain(explain::Explain),
    Ping(ping::Ping),
    Netsim(netsim::Netsim),
    Record(record::Record),
    Replay(replay::Replay),
    Top(top::Top),
    Pair(pair::Pair),
    Audit(audit::Audit),
    Doctor(doctor::Doctor),
    Config(config::Config),
}

/// Runs the command line; errors end on stderr with exit code 1.
pub fn run() -> ExitCode {
    let result = match Cli::parse().command {
        Command::Serve(command) => command.run(),
        Command::Demo(command) => command.run(),
        #[cfg(feature = "design")]
        Command::Design(command) => command.run(),
        #[cfg(feature = "design")]
        Command::Experiment(command) => command.run(),
        Command::Scene(command) => command.run(),
        Command::Ctl(command) => command.run(),
        Command::Explain(command) => command.run(),
        Command::Ping(command) => command.run(),
        Command::Netsim(command) => command.run(),
        Command::Record(command) => command.run(),
        Command::Replay(command) => command.run(),
        Command::Top(command) => command.run(),
        Command::Pair(command) => command.run(),
        Command::Audit(command) => command.run(),
        Command::Doctor(command) => command.run(),
        Command::Config(command) => command.run(),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("hapticd: {}", told_once(&error));
            ExitCode::FAILURE
        }
    }
}

/// Writes a line on stdout. Whoever closes the pipe has read enough; anything else that
/// keeps a result from being written ends the program with an error.
fn say_line(line: std::fmt::Arguments<'_>) {
    let mut out = std::io::stdout().lock();
    match writeln!(out, "{line}").and_then(|()| out.flush()) {
        Ok(()) => {}
        Err(error) if error.kind() == ErrorKind::BrokenPipe => std::process::exit(0),
        Err(error) => {
            eprintln!("hapticd: cannot write to stdout: {error}");
            std::process::exit(1);
        }
    }
}

/// An error with its causes; a cause that the text before already tells is left out.
fn told_once(error: &anyhow::Error) -> String {
    error.chain().skip(1).fold(error.to_string(), |told, cause| {
        let cause = cause.to_string();
        if told.contains(&cause) { told } else { format!("{told}: {cause}") }
    })
}

/// A runtime for a command that talks to a server.
fn runtime() -> anyhow::Result<tokio::runtime::Runtime> {
    Ok(tokio::runtime::Builder::new_current_thread().enable_all().build()?)
}

//! What can be held of the house rules, read from the source tree itself.
//!
//! A failure names file, line and rule. Comments and literals are blanked out before code is
//! looked at; test code (files of tests and `#[cfg(test)] mod tests { .. }`, which close a
//! file) may use anything.

mod source;

use std::collections::BTreeSet;
use std::fs;

use source::{Path, SourceFile};

/// The modules from the ground up: code of one names only itself and those above it here.
const LAYERS: &[&str] = &[
    "proto",
    "notation",
    "units",
    "mechanism",
    "environment",
    "actuation",
    "wire",
    "impairment",
    "sealed",
    "link",
    "control",
    "session",
    "device",
    "config",
    "explain",
    "plot",
    "analysis",
    "recording",
    "clock",
    "rt",
    "telemetry",
    "host",
    "archive",
    "utc",
    "credentials",
    "audit",
    "quic",
    "net",
    "client",
    "app",
    "cli",
];

/// Pairs that never meet although their order would let them: `(module, what it never names)`.
const STRANGERS: &[(&str, &str)] = &[
    ("net", "rt"),
    ("client", "net"),
    // The client library builds where there is no Linux and no server.
    ("client", "rt"),
    ("client", "telemetry"),
    ("client", "host"),
    ("client", "credentials"),
    ("client", "audit"),
    ("quic", "rt"),
    ("quic", "telemetry"),
    ("quic", "host"),
];

/// Modules of values and `now` alone.
const PURE: &[&str] = &[
    "mechanism",
    "environment",
    "actuation",
    "wire",
    "impairment",
    "sealed",
    "control",
    "session",
    "explain",
];

/// What belongs to the rim, and the modules that are it.
const NETWORK: &[&str] = &[
    "axum",
    "hyper",
    "quinn",
    "rustls",
    "tokio",
    "tokio_stream",
    "tonic",
    "tonic_health",
    "tonic_prost",
    "tonic_reflection",
    "web_transport_quinn",
];
const NETWORK_MODULES: &[&str] = &["proto", "quic", "net", "client", "app", "cli"];

/// Every Rust file that people write here.
const ALL_CODE: &[&str] =
    &["src", "tests", "benches", "fuzz/src", "fuzz/targets", "fuzz/examples", "build.rs"];

const LONGEST_FILE_LINES: usize = 600;
const PROMISES: u32 = 13;

fn check(rule: &str, broken: Vec<String>) {
    assert!(broken.is_empty(), "{rule}:\n  {}\n", broken.join("\n  "));
}

/// Every path in the code of `src/`, without tests and without the crate root.
fn paths() -> Vec<(SourceFile, Vec<Path>)> {
    let files = source::files(&["src"]);
    let code = files.into_iter().filter(|file| !file.is_test() && !file.module().is_empty());
    code.map(|file| (file.paths(), file)).map(|(paths, file)| (file, paths)).collect()
}

/// Complaints about the paths for which `fault` finds one.
fn complaints(fault: impl Fn(&str, &Path) -> Option<String>) -> Vec<String> {
    let mut broken = Vec::new();
    for (file, paths) in &paths() {
        for path in paths {
            if let Some(fault) = fault(file.module(), path) {
                broken.push(format!("{}: `{path}`: {fault}", file.at(path.line)));
            }
        }
    }
    broken
}

fn layer(module: &str) -> Option<usize> {
    LAYERS.iter().position(|layer| *layer == module)
}

#[test]
fn every_file_says_in_its_first_line_what_it_is() {
    let files = source::files(ALL_CODE);
    let silent = files.iter().filter(|file| !file.text.starts_with("//! "));
    check("the first line is `//!` and a sentence", silent.map(|file| file.at(1)).collect());
}

#[test]
fn every_module_has_its_layer() {
    let files = source::files(&["src"]);
    let modules: BTreeSet<_> =
        files.iter().map(SourceFile::module).filter(|name| !name.is_empty()).collect();
    let unknown = modules.iter().filter(|name| layer(name).is_none());
    check("a module has a place in LAYERS", unknown.map(|name| format!("src/{name}")).collect());
}

#[test]
fn uses_only_point_down() {
    let up = |module: &str, path: &Path| {
        let used = layer(path.crate_module()?)?;
        (used > layer(module)?).then(|| format!("{module} is below {}", LAYERS[used]))
    };
    check("a module uses only what stands above it in LAYERS", complaints(up));
}

#[test]
fn strangers_never_meet() {
    let meet = |module: &str, path: &Path| {
        let used = path.crate_module()?;
        STRANGERS.contains(&(module, used)).then(|| format!("{module} never uses {used}"))
    };
    check("STRANGERS", complaints(meet));
}

#[test]
fn pure_modules_know_no_clock_no_file_no_socket_and_no_log() {
    let impure = |module: &str, path: &Path| {
        let path = path.to_string();
        let roots = ["std::net", "std::fs", "std::thread", "std::process", "std::env", "std::io"];
        let crates = ["tokio", "tracing", "rustix", "metrics", "serialport"];
        let within = |root: &&str| path == **root || path.starts_with(&format!("{root}::"));
        let time = path.starts_with("std::time") && path != "std::time::Duration";
        let clock = within(&"crate::clock");
        let impure = time || clock || roots.iter().chain(&crates).any(within);
        (PURE.contains(&module) && impure).then(|| format!("{module} is pure"))
    };
    check("pure modules know values and `now`", complaints(impure));
}

#[test]
fn the_network_stays_at_the_rim() {
    let inside = |module: &str, path: &Path| {
        let network = NETWORK.contains(&path.parts[0].as_str());
        (network && !NETWORK_MODULES.contains(&module))
            .then(|| format!("only {} may", NETWORK_MODULES.join(", ")))
    };
    check("tokio, tonic, quinn, axum and rustls stay at the rim", complaints(inside));
}

#[test]
fn the_control_law_does_not_know_whether_its_device_is_simulated() {
    let mut broken = Vec::new();
    for file in source::files(&["src/control"]).iter().filter(|file| !file.is_test()) {
        for (line, word) in file.words() {
            if word.to_lowercase().contains("simulat") {
                broken.push(format!("{}: `{word}`", file.at(line)));
            }
        }
    }
    check("one law, many worlds", broken);
}

#[test]
fn no_file_is_too_long() {
    let files = source::files(&["src", "fuzz/src", "fuzz/targets", "fuzz/examples"]);
    let lines = |file: &SourceFile| file.text.lines().count();
    let long = files.iter().filter(|file| lines(file) > LONGEST_FILE_LINES);
    check(
        &format!("a file of src and fuzz has at most {LONGEST_FILE_LINES} lines"),
        long.map(|file| format!("{}: {} lines", file.name, lines(file))).collect(),
    );
}

#[test]
fn nothing_is_left_to_do_in_the_code() {
    // In two pieces, so that this file does not name them.
    let marks = [("TO", "DO"), ("FIX", "ME"), ("todo", "!("), ("unimplemented", "!(")];
    let mut broken = Vec::new();
    for file in source::files(ALL_CODE) {
        for (i, line) in file.text.lines().enumerate() {
            for (head, tail) in marks {
                if line.contains(&format!("{head}{tail}")) {
                    broken.push(format!("{}: {head}{tail}", file.at(i + 1)));
                }
            }
        }
    }
    check("finished, or not there", broken);
}

#[test]
fn every_metric_of_the_table_is_used() {
    let read = |name: &str| source::file(&format!("src/telemetry/{name}.rs"));
    let table = read("table");
    let rows = table.text.lines().enumerate().filter_map(|(i, line)| {
        let (name, rest) = line.strip_prefix("    ")?.split_once(": ")?;
        let row = rest.starts_with("Device ") || rest.starts_with("Server ");
        row.then_some((i + 1, name))
    });
    let rows: Vec<_> = rows.collect();
    assert!(rows.len() > 10, "{}: the rows of the table were not found", table.name);
    let users = [read("metrics"), read("registry"), read("turned_away")];
    let used = |row: &str| users.iter().any(|file| file.words().iter().any(|(_, w)| w == row));
    let idle = rows.iter().filter(|(_, row)| !used(row));
    check(
        "a metric is counted somewhere",
        idle.map(|(line, row)| format!("{}: {row}", table.at(*line))).collect(),
    );
}

#[test]
fn every_promise_has_its_line_in_the_specification() {
    let text = read("SPECIFICATION.md");
    let starts = |line: &str, number: u32| {
        let line = line.trim_start_matches(['|', '#', '*', ' ']);
        line.strip_prefix(&number.to_string())
            .is_some_and(|rest| !rest.starts_with(|c: char| c.is_ascii_digit()))
    };
    let missing = (1..=PROMISES).filter(|n| !text.lines().any(|line| starts(line, *n)));
    check(
        "SPECIFICATION.md has a line that begins with the number of each promise",
        missing.map(|n| format!("promise {n}")).collect(),
    );
}

#[test]
fn the_readme_says_how_to_run_and_how_to_test() {
    let text = read("README.md");
    let commands = ["cargo run --release -- demo wall", "cargo test"];
    let missing = commands.iter().filter(|command| !text.contains(**command));
    check("README.md has the two commands", missing.map(|c| (*c).to_owned()).collect());
}

fn read(name: &str) -> String {
    let path = source::root().join(name);
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{name}: {error}"))
}

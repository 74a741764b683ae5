//! The commands as people type them: help, examples, refusals that help, and JSON.

use std::os::unix::fs::{PermissionsExt, chown};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::Command;

use hapticd::config::BUILT_IN;
use hapticd::proto::scene_object::Kind;
use hapticd::proto::{ConstantField, CreateObjectRequest, SceneObject, Vector3};
use serde_json::Value;

use super::support::{Finished, Rig, config_file, finish, hapticd, run};

/// Keys of `demo --json`.
const FIGURES: [&str; 15] = [
    "ticks",
    "overruns",
    "wakeup_p50_us",
    "wakeup_p99_us",
    "wakeup_p999_us",
    "tick_p99_us",
    "rtt_p50_us",
    "rtt_p99_us",
    "command_lag_one_ratio",
    "commands_lost",
    "penetration_max_mm",
    "force_error_mean_n",
    "approximation_angle_max_deg",
    "stuck_ratio",
    "wall_switches_per_s",
];

/// The one JSON object that a command printed.
fn json(finished: &Finished) -> Value {
    let value: Value = serde_json::from_str(&finished.stdout)
        .unwrap_or_else(|error| panic!("{error}: {finished:?}"));
    assert!(value.is_object(), "{value}");
    value
}

fn number(value: &Value, key: &str) -> f64 {
    value[key].as_f64().unwrap_or_else(|| panic!("{key} in {value}"))
}

/// The commands that a help lists; none where it is that of a command without further ones.
fn commands_of(help: &str) -> Vec<String> {
    let Some((_, rest)) = help.split_once("Commands:") else { return Vec::new() };
    let commands = rest.split_once("Options:").unwrap().0;
    let lines = commands.lines().filter_map(|line| line.strip_prefix("  "));
    let names = lines.filter(|line| !line.starts_with(' '));
    let names = names.map(|line| line.split(' ').next().unwrap().to_owned());
    names.filter(|name| name != "help").collect()
}

#[test]
fn every_commands_help_shows_an_example() {
    let help = run(&["--help"]).ok().stdout;
    assert!(help.contains("hapticd demo wall"), "{help}");
    let mut waiting: Vec<_> = commands_of(&help).into_iter().map(|name| vec![name]).collect();
    let mut seen = Vec::new();
    while let Some(command) = waiting.pop() {
        let words: Vec<_> = command.iter().map(String::as_str).chain(["--help"]).collect();
        let help = run(&words).ok().stdout;
        let name = command.join(" ");
        let example = help.split_once("Example").map_or("", |(_, examples)| examples);
        assert!(example.contains(&format!("  hapticd {name}")), "{name}: {help}");
        waiting.extend(commands_of(&help).into_iter().map(|next| {
            let mut deeper = command.clone();
            deeper.push(next);
            deeper
        }));
        seen.push(name);
    }
    for name in ["serve", "demo wall", "scene wall", "ctl clear-fault", "ctl wall add", "ping"] {
        assert!(seen.iter().any(|seen| seen == name), "{name} is not among {seen:?}");
    }
}

#[test]
fn a_new_wall_without_point_or_normal_is_refused_by_the_field_that_is_missing() {
    let help = run(&["ctl", "wall", "add", "--help"]).ok().stdout;
    assert!(help.contains("it needs --point and --normal"), "{help}");
    let rig = Rig::start();
    let target = rig.target().to_string();
    let add = ["ctl", "--connect", &target, "wall", "add", "table"];
    let refused = |more: &[&str], field| run(&[&add, more].concat()).refused(&[field]);
    refused(&["--normal=0,-1,0"], "half_space.point_m");
    refused(&["--point", "0,0.4,0"], "half_space.normal");
}

#[test]
fn the_example_configuration_passes_its_own_check() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("hapticd.toml");
    std::fs::write(&file, run(&["config", "--example"]).ok().stdout).unwrap();
    let path = file.to_str().unwrap();
    let checked = run(&["config", "--check", path]).ok().stdout;
    assert!(checked.starts_with("ok: ") && checked.contains("devices/cho-2005"), "{checked}");

    std::fs::write(&file, "device = \"cho-2005\"\n[server]\ngrcp_port = 7350\n").unwrap();
    run(&["config", "--check", path]).refused(&[path, ":3:", "server.grcp_port", "grpc_port"]);
    run(&["serve", "--config", path]).refused(&[path, "server.grcp_port"]);
    std::fs::write(&file, "[server]\ngrpc_port = 70000\n").unwrap();
    run(&["config", "--check", path]).refused(&[path, "server.grpc_port = 70000", "0 to 65535"]);
    let missing = folder.path().join("missing.toml");
    run(&["config", "--check", missing.to_str().unwrap()]).refused(&["missing.toml"]);
}

/// `serve` with this device, which has to be refused before anything is kept.
fn serve_refuses_device(device: &str, words: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    let ended = run(&["serve", "--device", device, "--state-dir", state.to_str().unwrap()]);
    ended.refused(words);
    assert!(ended.stdout.is_empty() && !state.exists(), "{ended:?}");
}

#[test]
fn an_unknown_device_is_answered_with_those_there_are() {
    let names = BUILT_IN.map(|(name, _)| name);
    serve_refuses_device("nonsense", &[&["no device \"nonsense\""], &names[..]].concat());
}

#[test]
fn a_device_file_that_cannot_be_is_refused_by_its_field() {
    let (_, text) = BUILT_IN.into_iter().find(|(name, _)| *name == "cho-2005").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mine.toml");
    let path = file.to_str().unwrap();
    for (from, to, words) in [
        ("0.124", "1.124", "mechanism.l_m[2] = 1.124"),
        ("0.124", "-0.124", "mechanism.l_m[2] = -0.124"),
        ("0.124", "nan", "mechanism.l_m[2] = NaN"),
        ("k3 = 0.781", "k3 = 0.781\nk5 = 1.0", "mechanism.k5 = 1: unknown field"),
        (
            "rate_hz = 1000",
            "rate_hz = 99999",
            "control.rate_hz = 99999: must be a number in 100 to 4000 Hz",
        ),
    ] {
        assert!(text.contains(from), "{from}");
        std::fs::write(&file, text.replacen(from, to, 1)).unwrap();
        serve_refuses_device(path, &[path, words]);
    }
}

#[test]
fn beyond_this_machine_somebody_must_have_a_credential() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    let state = state.to_str().unwrap();
    for address in ["0.0.0.0", "::"] {
        let ended = run(&["serve", "--listen", address, "--state-dir", state]);
        ended.refused(&["server.listen", address, "--insecure"]);
    }
}

/// `serve` in a shell that may lock next to no memory and, for root, as somebody else.
fn without_rights(config: &Path) -> Command {
    let mut shell = Command::new("sh");
    shell.args(["-c", "ulimit -l 64 && exec \"$0\" serve --config \"$1\""]);
    shell.arg(hapticd().get_program()).arg(config);
    if rustix::process::geteuid().is_root() {
        shell.uid(65_534).gid(65_534);
    }
    shell
}

#[test]
fn enforced_real_time_refuses_to_start_without_rights() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::set_permissions(folder.path(), PermissionsExt::from_mode(0o755)).unwrap();
    let state = folder.path().join("state");
    std::fs::create_dir(&state).unwrap();
    if rustix::process::geteuid().is_root() {
        chown(&state, Some(65_534), Some(65_534)).unwrap();
    }
    let config = config_file(&state, "realtime = \"enforce\"\n");
    let ended = finish(&mut without_rights(&config));
    if ended.code == Some(126) || ended.code == Some(127) {
        // Nobody else may run a program that lies in root's own folder.
        println!("skipped: the program cannot be run without root's rights: {}", ended.stderr);
        return;
    }
    ended.refused(&["real-time rights denied", "memory (RLIMIT_MEMLOCK is 64 KiB"]);
    assert_eq!(ended.stdout, "", "it does not say that it serves");
    if rustix::process::geteuid().is_root() {
        ended.refused(&["scheduler (SCHED_FIFO 80", "cpu_latency ("]);
    }
}

#[test]
fn a_demo_prints_one_object_with_every_figure() {
    let demo = run(&["demo", "wall", "--seconds", "2", "--json"]).ok();
    assert_eq!(demo.stdout.trim_end().lines().count(), 1, "{demo:?}");
    let figures = json(&demo);
    for key in FIGURES {
        assert!(figures[key].is_number(), "{key} in {figures}");
    }
    let figure = |key| number(&figures, key);
    let between = |key, least: f64, most: f64| {
        assert!((least..=most).contains(&figure(key)), "{key} in {figures}");
    };
    let ticks = figure("ticks");
    // Late ticks are skipped, never made up for: there is no lower bound worth the name.
    between("ticks", 100.0, 2_000.0 + 60_000.0);
    between("overruns", 0.0, ticks * 20.0);
    between("wakeup_p50_us", 0.0, figure("wakeup_p99_us"));
    between("wakeup_p99_us", 0.0, figure("wakeup_p999_us"));
    between("rtt_p50_us", f64::MIN_POSITIVE, figure("rtt_p99_us"));
    between("tick_p99_us", f64::MIN_POSITIVE, 1e6);
    between("command_lag_one_ratio", 0.0, 1.0);
    between("commands_lost", 0.0, ticks * 20.0);
    between("penetration_max_mm", f64::MIN_POSITIVE, 200.0);
    between("force_error_mean_n", 0.0, 2000.0);
    between("approximation_angle_max_deg", 0.0, 125.0);
    between("stuck_ratio", 0.0, 1.0);
    between("wall_switches_per_s", 0.0, 1000.0);
    let regions =
        ["full", "approximate", "not_displayable"].map(|key| number(&figures["regions"], key));
    let displayed: f64 = regions.iter().sum();
    assert!((1.0..=ticks).contains(&displayed), "{figures}");
}

#[test]
fn a_scene_in_a_process_of_its_own_commands_and_says_goodbye() {
    let rig = Rig::start();
    let target = rig.target().to_string();
    let ended = run(&["scene", "wall", "--connect", &target, "--seconds", "1"]).ok();
    assert!(ended.stderr.contains("commanding devices/cho-2005"), "{ended:?}");
    let sent = ended.stderr.split("scene wall: ").last().unwrap().split(' ').next().unwrap();
    let sent: f64 = sent.parse().unwrap();
    let metrics = rig.scrape();
    let applied = metrics.value("hapticd_command_lag_ticks_count{device=\"cho-2005\"}");
    assert!(applied > 0.0 && applied <= sent, "{applied} of {sent}");
    assert_eq!(metrics.value("hapticd_stale_total{device=\"cho-2005\",reason=\"released\"}"), 1.0);
    let nobody = run(&["scene", "wall", "--connect", "127.0.0.1:1", "--seconds", "1"]);
    nobody.refused(&["127.0.0.1:1"]);
}

#[test]
fn ping_measures_round_trips() {
    let rig = Rig::start();
    let ended = run(&["ping", &rig.target().to_string(), "--seconds", "1", "--json"]).ok();
    let all = json(&ended);
    for transport in ["quic", "webtransport", "udp"] {
        let figures = &all[transport];
        let [sent, answered] = ["sent", "answered"].map(|key| number(figures, key));
        assert!(answered >= 1.0 && answered <= sent && sent <= 400.0, "{figures}");
        let times = ["rtt_min_us", "rtt_p50_us", "rtt_p99_us", "rtt_max_us"];
        let times = times.map(|key| number(figures, key));
        assert!(times[0] > 0.0 && times.is_sorted(), "{figures}");
    }
}

#[test]
fn ctl_edits_walls_and_shows_the_state() {
    let rig = Rig::start();
    let target = rig.target().to_string();
    let ctl =
        |arguments: &[&str]| run(&[&["ctl", "--connect", &target, "--json"], arguments].concat());
    let made = json(
        &ctl(&[
            "wall",
            "add",
            "table",
            "--point",
            "0.5,0,0",
            "--normal=-2,0,0",
            "--stiffness",
            "5000",
        ])
        .ok(),
    );
    assert_eq!(made["name"], "devices/cho-2005/scene/objects/table");
    assert_eq!(made["half_space"]["normal"], serde_json::json!([-1.0, 0.0, 0.0]));
    assert_eq!(
        (number(&made["material"], "stiffness_n_per_m"), number(&made, "revision")),
        (5000.0, 2.0)
    );
    let moved = json(&ctl(&["wall", "set", "table", "--point", "0.6,0,0"]).ok());
    assert_eq!(moved["half_space"]["point_m"], serde_json::json!([0.6, 0.0, 0.0]));
    assert_eq!(number(&moved["material"], "stiffness_n_per_m"), 5000.0, "what is not said stays");
    assert_eq!(json(&ctl(&["wall", "get", "table"]).ok()), moved);
    let listed = json(&ctl(&["wall", "list"]).ok());
    assert_eq!(listed, serde_json::json!({ "scene_revision": 3, "objects": [moved] }));
    let state = json(&ctl(&["state"]).ok());
    assert_eq!((&state["mode"], &state["name"]), (&"enabled".into(), &"devices/cho-2005".into()));
    assert_eq!(number(&state, "scene_revision"), 3.0);
    assert_eq!(number(&json(&ctl(&["wall", "rm", "table"]).ok()), "scene_revision"), 4.0);
    let empty = serde_json::json!({ "scene_revision": 4, "objects": [] });
    assert_eq!(json(&ctl(&["wall", "list"]).ok()), empty);

    ctl(&["wall", "rm", "table"]).refused(&["there is no object \"table\""]);
    let sheet = ["wall", "add", "--hollow", "sheet", "--point", "0.5,0,0", "--normal=-1,0,0"];
    let sheet = json(&ctl(&sheet).ok());
    assert_eq!((&sheet["hollow"], &sheet["revision"]), (&true.into(), &5.into()));
    assert_eq!(json(&ctl(&["wall", "set", "sheet", "--hollow=false"]).ok())["hollow"], false);
    rig.run(async {
        let field = ConstantField { force_n: Some(Vector3 { x: 0.0, y: 1.0, z: 0.0 }) };
        let object = SceneObject { kind: Some(Kind::Constant(field)), ..SceneObject::default() };
        let request = CreateObjectRequest {
            parent: "devices/cho-2005/scene".into(),
            object_id: "push".into(),
            object: Some(object),
            scene_revision: 0,
        };
        rig.services().await.scenes.create_object(request).await.unwrap();
    });
    ctl(&["wall", "rm", "push"]).refused(&["objects/push is not a wall", "nothing was removed"]);
    assert_eq!(number(&json(&ctl(&["wall", "list"]).ok()), "scene_revision"), 7.0);
    let negative = ["wall", "add", "bad", "--point", "0,0,0", "--normal=1,0,0", "--stiffness=-1"];
    ctl(&negative).refused(&["object.material.stiffness_n_per_m = -1", "0 to 1000000000 N/m"]);
    assert_eq!(json(&ctl(&["stop"]).ok())["mode"], "stopped");
    ctl(&["enable"]).refused(&["disable the device first"]);
    assert_eq!(json(&ctl(&["disable"]).ok())["mode"], "disabled");
    let described = json(&ctl(&["describe"]).ok());
    assert_eq!(
        (&described["mechanism"], described["actuators"].as_array().unwrap().len()),
        (&"five-bar".into(), 4)
    );
}

//! `ctl object` and `ctl scene` as people type them.

use std::process::Stdio;

use serde_json::{Value, json};

use super::support::{Finished, Rig, finish, hapticd, run};

/// Every kind with what it needs, and what the server then has of it.
const KINDS: [(&str, &[&str], &str); 11] = [
    ("half-space", &["--point", "0.5,0,0", "--normal=-2,0,0", "--hollow"], "half_space"),
    ("sphere", &["--centre", "0,0.5,0", "--radius", "0.02"], "sphere"),
    ("box", &["--centre=-0.5,0,0", "--half-extents", "0.001,0.2,0.2"], "box"),
    ("capsule", &["--ends=-0.1,0.5,0:0.1,0.5,0", "--radius", "0.01"], "capsule"),
    ("corridor", &["--points", "0.2,0,0:0.3,0,0:0.3,0.1,0", "--radius", "0.5"], "corridor"),
    ("guide-point", &["--point", "0.3,0,0", "--radius", "0.5"], "guide"),
    ("guide-line", &["--point", "0.3,0,0", "--direction", "0,0,3", "--radius", "0.5"], "guide"),
    ("guide-plane", &["--point", "0.3,0,0", "--normal", "0,0,3"], "guide"),
    ("constant", &["--force", "0,0.1,0"], "constant"),
    ("viscous", &["--damping", "0.5"], "viscous"),
    (
        "force-field",
        &["--origin", "0.3,0,0", "--stiffness", "2", "--damping", "1,2,3", "--radius", "0.05"],
        "force_field",
    ),
];

struct Ctl {
    target: String,
}

impl Ctl {
    fn of(rig: &Rig) -> Self {
        Self { target: rig.target().to_string() }
    }

    fn run(&self, arguments: &[&str]) -> Finished {
        run(&[&["ctl", "--connect", &self.target], arguments].concat())
    }

    fn json(&self, arguments: &[&str]) -> Value {
        let finished = self.run(&[&["--json"], arguments].concat()).ok();
        serde_json::from_str(&finished.stdout)
            .unwrap_or_else(|error| panic!("{error}: {finished:?}"))
    }

    fn add_every_kind(&self) {
        for (kind, flags, _) in KINDS {
            self.run(&[&["object", "add", kind, kind], flags].concat()).ok();
        }
    }
}

#[test]
fn every_kind_is_added_shown_changed_and_removed() {
    let rig = Rig::start();
    let ctl = Ctl::of(&rig);
    for (kind, flags, key) in KINDS {
        let made = ctl.json(&[&["object", "add", "thing", kind], flags].concat());
        assert_eq!(made["name"], "devices/cho-2005/scene/objects/thing");
        assert!(made[key].is_object(), "{made}");
        let nulls = made.as_object().unwrap().values().filter(|value| value.is_null()).count();
        assert_eq!(nulls, 0, "{made}");
        assert_eq!(ctl.json(&["object", "get", "thing"]), made);
        let words = ctl.run(&["object", "list"]).ok().stdout;
        assert!(words.starts_with("thing: ") && words.contains("1 object, revision"), "{words}");
        ctl.run(&["object", "rm", "thing"]).ok();
    }
    let ball = ["object", "add", "ball", "sphere", "--centre", "0,0.3,0", "--radius", "0.02"];
    let feel = ["--stiffness", "2000", "--friction", "0.3", "--static-friction", "0.5"];
    let velocity = ["--surface-velocity=-0.1,0,0"];
    let made = ctl.json(&[&ball[..], &feel, &velocity].concat());
    let material = json!({
        "stiffness_n_per_m": 2000.0,
        "damping_ns_per_m": 0.0,
        "kinetic_friction": 0.3,
        "static_friction": 0.5,
        "surface_velocity_m_per_s": [-0.1, 0.0, 0.0],
    });
    assert_eq!(made["material"], material);
    let larger = ctl.json(&["object", "set", "ball", "--radius", "0.03"]);
    assert_eq!(larger["sphere"], json!({ "centre_m": [0.0, 0.3, 0.0], "radius_m": 0.03 }));
    assert_eq!(larger["material"], material, "what is not said stays");
}

#[test]
fn what_does_not_fit_or_is_missing_is_refused_by_its_name() {
    let rig = Rig::start();
    let ctl = Ctl::of(&rig);
    ctl.run(&["object", "add", "ball", "sphere", "--centre", "0,0.3,0", "--radius", "0.02"]).ok();
    for (arguments, words) in [
        (&["object", "add", "x", "cube"][..], "half-space"),
        (&["object", "add", "x", "sphere", "--radius", "0.1"], "object.sphere.centre_m = (none)"),
        (&["object", "add", "x", "sphere", "--centre", "0,0,0"], "object.sphere.radius_m = 0"),
        (&["object", "add", "x", "corridor", "--points", "0,0,0"], "corridor.points_m = 1 points"),
        (&["object", "add", "x", "corridor", "--points", "0,0"], "points with colons between"),
        (&["object", "add", "x", "capsule", "--ends", "0,0,0"], "capsule.ends_m = 1 points"),
        (&["object", "add", "x", "guide-line", "--point", "0,0,0"], "guide.line.direction"),
        (
            &["object", "add", "x", "force-field", "--origin", "0,0,0", "--stiffness", "1,2"],
            "force_field.stiffness_n_per_m = 2 numbers",
        ),
        (&["object", "add", "x", "constant", "--force", "nan,0,0"], "constant.force_n.x = NaN"),
        (&["object", "add", "x", "viscous", "--damping", "1", "--hollow"], "object.hollow = true"),
        (&["object", "set", "ball", "--force", "1,0,0"], "--force does not fit a sphere"),
        (&["object", "set", "ball", "--stiffness", "1,2,3"], "--stiffness has 3 numbers"),
        (&["object", "set", "ball", "--friction", "inf"], "material.kinetic_friction = inf"),
        (&["object", "set", "ball", "--static-friction=-1"], "material.static_friction = -1"),
        (&["object", "set", "gone", "--radius", "1"], "there is no object \"gone\""),
        (&["object", "rm", "gone"], "there is no object \"gone\""),
        (&["wall", "set", "ball", "--stiffness", "1"], "objects/ball is not a wall"),
        (&["scene", "load", "/nowhere/scene.toml"], "cannot read /nowhere/scene.toml"),
    ] {
        ctl.run(arguments).refused(&[words]);
    }
    assert_eq!(ctl.json(&["object", "list"])["scene_revision"], 2, "nothing of it was done");
}

#[test]
fn a_scene_that_is_shown_is_loaded_unchanged() {
    let rig = Rig::start();
    let ctl = Ctl::of(&rig);
    ctl.add_every_kind();
    let before = ctl.json(&["scene", "show"]);
    let shown = ctl.run(&["scene", "show"]).ok().stdout;
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("bench.toml");
    let path = file.to_str().unwrap();
    let saved = ctl.json(&["scene", "save", path]);
    assert_eq!(saved, json!({ "scene_revision": 12, "objects": 11 }));
    assert_eq!(std::fs::read_to_string(&file).unwrap().trim_end(), shown.trim_end());

    // Onto itself: the revision of the scene grows, that of no object does.
    assert_eq!(ctl.json(&["scene", "load", path])["scene_revision"], 13);
    let after = ctl.json(&["scene", "show"]);
    assert_eq!((&after["objects"], &after["revision"]), (&before["objects"], &13.into()));

    // From standard input onto another server.
    let other = Rig::start();
    let there = Ctl::of(&other);
    let mut load = hapticd();
    load.args(["ctl", "--connect", &there.target, "scene", "load", "-"]);
    let status = load.stdin(std::fs::File::open(&file).unwrap()).stdout(Stdio::null()).status();
    assert!(status.unwrap().success());
    let again = there.run(&["scene", "show"]).ok().stdout;
    let without_first = |text: &str| text.split_once('\n').unwrap().1.to_owned();
    assert_eq!(without_first(&again), without_first(&shown));

    // The server's own file fits too.
    let own = rig.state_dir().join("devices/cho-2005/scene.toml");
    ctl.run(&["scene", "load", own.to_str().unwrap(), "--revision", "13"]).ok();
    assert_eq!(ctl.json(&["scene", "show"])["objects"], before["objects"]);
    let stale = ctl.run(&["scene", "load", path, "--revision", "13"]);
    stale.refused(&["scene_revision = 13: the scene is at revision 14"]);
}

#[test]
fn a_file_that_is_no_scene_is_refused_by_line_key_and_value_and_changes_nothing() {
    let rig = Rig::start();
    let ctl = Ctl::of(&rig);
    ctl.add_every_kind();
    let before = ctl.json(&["scene", "show"]);
    let shown = ctl.run(&["scene", "show"]).ok().stdout;
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mine.toml");
    for (from, to, words) in [
        ("radius_m = 0.02", "radius_m = -0.02", "sphere.radius_m = -0.02: must be a number in"),
        ("radius_m = 0.02", "radius_mm = 20", "radius_mm"),
        ("id = \"sphere\"", "id = \"box\"", "].id = box: must be unique"),
        ("id = \"sphere\"", "id = \"Sphere\"", "\"Sphere\": must be 1 to 63"),
        ("[object.sphere]", "[object.cylinder]", "cylinder"),
        ("[object.guide.line]", "[object.guide.lines]", "lines"),
        ("damping_ns_per_m = [1.0, 2.0, 3.0]", "damping_ns_per_m = [1.0]", "= 1 numbers"),
        ("force_n = [0.0, 0.1, 0.0]", "force_n = [0.0, nan, 0.0]", "constant.force_n.y = NaN"),
        ("direction = [0.0, 0.0, 1.0]", "direction = [0.0, 0.0, 0.0]", "guide.line.direction = 0"),
    ] {
        assert!(shown.contains(from), "{from} in\n{shown}");
        std::fs::write(&file, shown.replacen(from, to, 1)).unwrap();
        ctl.run(&["scene", "load", file.to_str().unwrap()]).refused(&["mine.toml", words]);
    }
    std::fs::write(&file, [0xff, 0xfe, 0]).unwrap();
    ctl.run(&["scene", "load", file.to_str().unwrap()]).refused(&["cannot read", "mine.toml"]);
    // A pipe from a command that failed is empty: that is no wish for an empty scene.
    std::fs::write(&file, "").unwrap();
    let words = "object = (none): an empty scene says `object = []`";
    ctl.run(&["scene", "load", file.to_str().unwrap()]).refused(&[words]);
    assert_eq!(ctl.json(&["scene", "show"]), before);

    std::fs::write(&file, "object = []").unwrap();
    ctl.run(&["scene", "load", file.to_str().unwrap()]).ok();
    assert!(ctl.run(&["scene", "show"]).ok().stdout.ends_with("revision 13\nobject = []\n"));
}

#[test]
fn a_scene_is_watched() {
    let rig = Rig::start();
    let ctl = Ctl::of(&rig);
    ctl.run(&["object", "add", "air", "viscous", "--damping", "0.5"]).ok();
    let mut watch = hapticd();
    // `head` has read enough after two lines, and that ends the watch.
    let watched = std::thread::scope(|scope| {
        let child = watch.args(["ctl", "--connect", &ctl.target, "scene", "watch"]);
        let mut child = child.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let mut head = std::process::Command::new("head");
        head.args(["-n", "2"]).stdin(child.stdout.take().unwrap()).stdout(Stdio::piped());
        let head = head.spawn().unwrap();
        let reader = scope.spawn(move || head.wait_with_output().unwrap().stdout);
        let mut round = 0;
        while !reader.is_finished() && round < 1000 {
            round += 1;
            let damping = format!("0.{round:04}");
            ctl.run(&["object", "set", "air", "--damping", &damping]).ok();
        }
        let _ = child.kill();
        child.wait().unwrap();
        String::from_utf8(reader.join().unwrap()).unwrap()
    });
    let lines: Vec<_> = watched.lines().collect();
    assert!(lines.len() == 2 && lines[1].ends_with("1 object: air"), "{watched}");
    let help = finish(hapticd().args(["ctl", "scene", "load", "--help"])).ok().stdout;
    assert!(help.contains("hapticd ctl scene load bench.toml --revision 7"), "{help}");
}

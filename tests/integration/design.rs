//! `hapticd design` and the two reports, as their user runs them.

use std::path::Path;

use serde_json::Value;

use super::support::run;

/// What a command prints with `--json`.
fn json(arguments: &[&str]) -> Value {
    let finished = run(&[arguments, &["--json"]].concat()).ok();
    serde_json::from_str(&finished.stdout).unwrap_or_else(|e| panic!("{arguments:?}: {e}"))
}

#[test]
fn an_optimised_device_is_better_than_the_published_one_and_can_be_loaded() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("better.toml");
    let file = file.to_str().unwrap();
    let optimize = ["design", "optimize", "--seed", "5", "--starts", "4"];
    let found = json(&[&optimize[..], &["--write", file]].concat());
    let number = |name: &str| found[name].as_f64().unwrap();
    assert!(number("gp_a") <= 5.31 && number("gp_f") <= 0.98, "{found}");
    assert_eq!(found["bounds"]["l_m"], serde_json::json!([0.1, 0.3]));
    assert!(found["grid"].as_str().unwrap().starts_with("area-uniform, r 0.2 to 0.5 m"));
    let read = json(&["design", "indices", "--device", file, "--grid", "area"]);
    let again = read["workspaces"][0]["gp_a"].as_f64().unwrap();
    assert!((again - number("gp_a")).abs() < 1e-9, "{read}");
}

#[test]
fn pictures_and_tables_are_written_where_they_are_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let begins = |name: &str, with: &[u8]| {
        let content = std::fs::read(Path::new(&at(name))).unwrap();
        assert!(content.starts_with(with), "{name}");
    };
    let (map, csv) = (at("map.png"), at("map.csv"));
    json(&["design", "map", "--quantity", "p-f", "--step", "0.05", "--out", &map, "--csv", &csv]);
    begins("map.png", b"\x89PNG");
    begins("map.csv", b"x_m,y_m,condition");
    let picture = at("regions.svg");
    let regions = ["design", "regions", "--at", "0.3,0.1", "--motion", "-90", "--out", &picture];
    let found = json(&regions);
    begins("regions.svg", b"<svg");
    assert_eq!(found["passive_sets"].as_array().unwrap().len(), 8);
    let compared = json(&["design", "compare", "cho-2005-unoptimised", "cho-2005"]);
    assert_eq!(compared["devices"][1]["device"], "cho-2005");
    assert!(compared["devices"][0]["beta_min_deg"].as_f64().unwrap() < 4.0);
}

#[test]
fn what_cannot_be_designed_is_refused_with_what_is_allowed() {
    for (arguments, words) in [
        (&["design", "optimize", "--l", "0.3,0.1"][..], "l[1] = 0.1: must be larger than l[0]"),
        (&["design", "optimize", "--weights", "0,0"], "must be 0 to 1000 each, and not both 0"),
        (&["design", "optimize", "--r", "0.7,0.9", "--starts", "1"], "no design within these"),
        (&["design", "optimize", "--device", "two-link"], "has no known design problem"),
        (&["design", "indices", "--at", "2,2"], "cannot reach there"),
        (&["design", "indices", "--at", "nan,0"], "must be X,Y in metres"),
        (&["design", "map", "--step", "0"], "step = 0: must be a number in 0.00001 to 10 m"),
        (&["design", "map", "--step", "0.00001"], "at most 4000000"),
        (&["design", "map", "--out", "map.pdf", "--step", "0.1"], "must end in .svg or .png"),
        (&["design", "ellipses", "--x", "3,4", "--y", "3,4"], "reaches no place of"),
        (&["design", "regions", "--motion", "1000"], "-360 to 360 degrees"),
        (&["design", "compare", "no-such-device"], "no-such-device"),
    ] {
        run(arguments).refused(&[words]);
    }
}

#[test]
fn the_synthesis_is_reported_with_its_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report");
    let found = json(&["experiment", "synthesis", "--out", out.to_str().unwrap()]);
    assert_eq!(found["optimum_cm"], serde_json::json!([10.0, 15.0, 3.0]));
    assert_eq!(found["points_above_5"], 106);
    let text = std::fs::read_to_string(out.join("report.md")).unwrap();
    for picture in text.split("](").skip(1).map(|rest| rest.split(')').next().unwrap()) {
        assert!(out.join(picture).exists(), "{picture}");
    }
    assert!(text.matches(".svg)").count() >= 5, "{text}");
}

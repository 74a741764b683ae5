//! `hapticd design optimize` of a symmetric five-bar: the discrete search of Singh et al.

use std::path::Path;

use serde_json::{Value, json};

use super::arguments::{Output, write};
use super::found_file::device_file;
use crate::analysis::design::ConditionClass;
use crate::analysis::design::symmetric::{Candidate, CountGrid, search, table_1};
use crate::config::DeviceDefinition;
use crate::plot::{Axis, Colour, Figure, Legend, Marks, Panel, Series, Sign};

const CM_PER_M: f64 = 100.0;

/// A length of the search in metres. A division: 0.01 is no number of two digits inside, and
/// 7 * 0.01 would print sixteen.
fn metres(cm: f64) -> f64 {
    cm / CM_PER_M
}

/// Counts every design of Table 1 and prints them, the best first.
pub fn run(device: &DeviceDefinition, output: &Output, file: Option<&Path>) -> anyhow::Result<()> {
    let grid = CountGrid::STATED;
    let found = search(&table_1(), &grid);
    let best = found[0];
    if output.json {
        say!(
            "{}",
            json!({
                "device": device.name.as_str(),
                "method": "every design of Singh's Table 1",
                "grid": grid.to_string(),
                "bounds": { "a1_m": [0.09, 0.12], "a2_m": [0.11, 0.15], "a3_m": [0.03, 0.05],
                "step_m": 0.01 },
                "points_above_5": best.counts.above_5(),
                "design": design_json(&best),
                "ranking": found.iter().map(|one| json!({
                    "design": design_json(one),
                "points_above_5": one.counts.above_5() })).collect::<Vec<_>>(),
            })
        );
    } else {
        say!("grid: {grid}; interior places with K of 5 or more, fewest first");
        for one in found.iter().take(8) {
            let lengths = one.lengths;
            let [_, below_10, up_to_100, above] = one.counts.classes;
            say!(
                "a1 {:>2} a2 {:>2} a3 {} cm: {:>3} of {} ({below_10} {}, {up_to_100} {}, {above} \
                 {})",
                lengths.a1,
                lengths.a2,
                lengths.a3,
                one.counts.above_5(),
                one.counts.interior(),
                ConditionClass::ALL[1].label(),
                ConditionClass::ALL[2].label(),
                ConditionClass::ALL[3].label()
            );
        }
    }
    output.table(|| csv(&found))?;
    output.picture(|| Figure::single(circle_panel(&found)))?;
    file.map_or(Ok(()), |path| write(path, &file_of(device, &best)?))
}

fn design_json(one: &Candidate) -> Value {
    let lengths = one.lengths;
    let [a1, a2, a3] = [lengths.a1, lengths.a2, lengths.a3].map(metres);
    json!({ "a1_m": a1, "a2_m": a2, "a3_m": a3 })
}

/// Every design: its count of badly conditioned places over the size of its largest circle.
pub fn circle_panel(found: &[Candidate]) -> Panel {
    let signs = [(3.0, Sign::Dot), (4.0, Sign::Square), (5.0, Sign::Cross)];
    let series = signs.into_iter().enumerate().map(|(i, (a3, sign))| {
        let of_base = found.iter().filter(|one| one.lengths.a3 == a3);
        let points =
            of_base.map(|one| [one.lengths.inscribed_radius(), one.counts.above_5() as f64]);
        Series::new(format!("a3 = {a3} cm"), Colour::of(i), Marks::Points(sign, points.collect()))
    });
    Panel {
        title: "Badly conditioned places by size of the workspace".into(),
        x: Axis::between("radius of the largest inscribed circle [cm]", 8.5, 12.5),
        y: Axis::new("interior places with K >= 5"),
        legend: Legend::UpperLeft,
        series: series.collect(),
        ..Panel::default()
    }
}

fn csv(found: &[Candidate]) -> String {
    let line = |one: &Candidate| {
        let (lengths, counts) = (one.lengths, one.counts);
        let classes = counts.classes.map(|count| count.to_string()).join(",");
        let head = format!("{},{},{}", lengths.a1, lengths.a2, lengths.a3);
        format!("{head},{},{classes},{}\n", counts.above_5(), counts.edge)
    };
    let lines: String = found.iter().map(line).collect();
    format!("a1_cm,a2_cm,a3_cm,above_5,below_5,below_10,up_to_100,above_100,edge\n{lines}")
}

/// The given device with the best lengths.
fn file_of(device: &DeviceDefinition, best: &Candidate) -> anyhow::Result<String> {
    let comment =
        format!("# A symmetric five-bar found by `hapticd design optimize` from {}.", device.name);
    let lengths = best.lengths;
    let lengths_cm = [("a1_m", lengths.a1), ("a2_m", lengths.a2), ("a3_m", lengths.a3)];
    let values = lengths_cm.map(|(key, cm)| (key, metres(cm).into()));
    device_file(device, &comment, None, values)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_design_is_a_device_that_can_be_loaded() {
        let device = DeviceDefinition::load("singh").unwrap();
        let best = search(&table_1(), &CountGrid::STATED)[0];
        let text = file_of(&device, &best).unwrap();
        let read = DeviceDefinition::from_toml("mine", &text, "mine.toml").unwrap();
        let number = |key: &str| read.parameters.iter().find(|(name, _)| name == key).unwrap().1;
        for (key, m) in [("a1_m", 0.10), ("a2_m", 0.15), ("a3_m", 0.03)] {
            assert!((number(key) - m).abs() < 1e-12, "{key}");
        }
        let text = design_json(&best).to_string();
        assert_eq!(text, r#"{"a1_m":0.1,"a2_m":0.15,"a3_m":0.03}"#);
    }
}

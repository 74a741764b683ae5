//! Global indices as rows with names and units, for tables, CSV and JSON alike.

use serde_json::{Map, Value, json};

use crate::analysis::design::{ConditionClass, GlobalIndices};

/// One index of a workspace.
pub struct Row {
    /// Name in JSON and CSV, its unit with it.
    pub key: &'static str,
    /// For people.
    pub label: &'static str,
    /// Not a number where the grid reaches nothing.
    pub value: f64,
}

/// The indices of a workspace, one by one.
pub fn rows(indices: &GlobalIndices) -> Vec<Row> {
    let reached = indices.places > indices.unreachable + indices.singular;
    let row = |key, label, value: f64| {
        let value = if reached { value } else { f64::NAN };
        Row { key, label, value }
    };
    let [least_beta, most_beta] = indices.beta_rad.map(f64::to_degrees);
    let [least_kg, most_kg] = indices.inertia_kg;
    let mut rows = vec![
        row("gp_a", "GP_a, mean P_a [rad^2]", indices.GP_a),
        row("gp_f", "GP_f, mean P_f [rad]", indices.GP_f),
        row("beta_min_deg", "smallest beta [deg]", least_beta),
        row("beta_max_deg", "largest beta [deg]", most_beta),
        row("share_50_60", "share with P_f 50 to 60 deg", indices.share_50_60),
        row("conditioning_index", "global conditioning index", indices.conditioning),
        row("worst_condition", "largest K", indices.worst_condition),
        row("yoshikawa", "mean Yoshikawa measure", indices.yoshikawa),
        row("worst_force_N", "worst-direction force, least [N]", indices.worst_force_N),
        row("mean_worst_force_N", "worst-direction force, mean [N]", indices.mean_worst_force_N),
        row("inertia_min_kg", "least inertia felt [kg]", least_kg),
        row("inertia_max_kg", "most inertia felt [kg]", most_kg),
    ];
    let row = |key, label, value| Row { key, label, value };
    let keys =
        ["places_k_below_5", "places_k_below_10", "places_k_up_to_100", "places_k_above_100"];
    for ((key, class), count) in keys.into_iter().zip(ConditionClass::ALL).zip(indices.classes) {
        rows.push(row(key, class.label(), count as f64));
    }
    rows.push(row("places", "places of the grid", indices.places as f64));
    rows.push(row("places_unreachable", "of these beyond reach", indices.unreachable as f64));
    rows.push(row("places_singular", "of these singular", indices.singular as f64));
    rows
}

/// The rows as an object, the grid's name among them.
pub fn object(indices: &GlobalIndices) -> Value {
    let numbers = rows(indices).into_iter().map(|row| (row.key.to_owned(), json!(row.value)));
    let mut all: Map<String, Value> = numbers.collect();
    all.insert("grid".into(), json!(indices.grid));
    all.into()
}

/// Rows side by side: label, then one number of each column.
pub fn text(columns: &[GlobalIndices]) -> Vec<String> {
    let all: Vec<Vec<Row>> = columns.iter().map(rows).collect();
    let Some(first) = all.first() else { return Vec::new() };
    let line = |i: usize| {
        let numbers: String =
            all.iter().map(|rows| format!(" {:>22}", number(rows[i].value))).collect();
        format!("{:<34}{numbers}", first[i].label)
    };
    (0..first.len()).map(line).collect()
}

/// Rows as comma separated values under these names.
pub fn csv(names: &[String], columns: &[GlobalIndices]) -> String {
    let all: Vec<Vec<Row>> = columns.iter().map(rows).collect();
    let mut text = format!("index,{}\n", names.join(","));
    let grids: Vec<_> = columns.iter().map(|indices| quoted(&indices.grid)).collect();
    text += &format!("grid,{}\n", grids.join(","));
    for i in 0..all.first().map_or(0, Vec::len) {
        let values: Vec<_> = all.iter().map(|rows| rows[i].value.to_string()).collect();
        text += &format!("{},{}\n", all[0][i].key, values.join(","));
    }
    text
}

/// A cell of a table that may hold commas.
pub fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('"', "\"\""))
}

/// Four digits that count, or a dash.
pub fn number(value: f64) -> String {
    match value {
        value if !value.is_finite() => "-".into(),
        value if value == value.round() && value.abs() < 1e9 => format!("{value}"),
        value if value.abs() >= 1e5 || value.abs() < 1e-3 => format!("{value:.3e}"),
        value => format!("{value:.4}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::design::{Annulus, Grid};
    use crate::config::DeviceDefinition;

    #[test]
    fn a_table_has_every_row_for_every_column() {
        let device = DeviceDefinition::load("cho-2005").unwrap();
        let grid = Grid::Annulus(Annulus::polar(0.2, 0.5));
        let torque_Nm = &device.actuators.max_torque_Nm;
        let found = GlobalIndices::over(device.mechanism.as_ref(), torque_Nm, &grid);
        let csv = csv(&["a".into(), "b".into()], &[found.clone(), found.clone()]);
        assert!(csv.starts_with("index,a,b\ngrid,\"polar, r 0.2"), "{csv}");
        let columns =
            |line: &str| line.replace("3813 places of equal weight", "").split(',').count();
        assert!(csv.lines().skip(2).all(|line| columns(line) == 3), "{csv}");
        assert_eq!(text(std::slice::from_ref(&found)).len(), rows(&found).len());
        assert_eq!(object(&found)["places_unreachable"], json!(0.0));
    }

    #[test]
    fn where_nothing_is_reached_there_are_dashes_and_no_figures() {
        let device = DeviceDefinition::load("kim-2003").unwrap();
        let grid = Grid::Annulus(Annulus { radii: 4, bearings: 6, ..Annulus::polar(0.2, 0.5) });
        let torque_Nm = &device.actuators.max_torque_Nm;
        let found = GlobalIndices::over(device.mechanism.as_ref(), torque_Nm, &grid);
        let rows = rows(&found);
        let known = |row: &&Row| row.value.is_finite();
        assert!(rows.iter().filter(known).all(|row| row.key.starts_with("places")));
        assert_eq!((found.places, object(&found)["worst_condition"].is_null()), (24, true));
    }

    #[test]
    fn numbers_are_short_and_no_number_is_a_dash() {
        assert_eq!([number(3813.0), number(f64::NAN), number(1.23456)], ["3813", "-", "1.2346"]);
        assert_eq!(number(1.5e-7), "1.500e-7");
    }
}

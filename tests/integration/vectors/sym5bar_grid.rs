//! `sym5bar-grid.json`: places of each class of condition number over the designs of Table 1.

use hapticd::analysis::design::symmetric::{CountGrid, Lengths};
use serde_json::Value;
use std::f64::consts::PI;

use super::{Case, cases};

#[test]
fn every_sym5bar_grid_case_agrees() {
    for case in cases("sym5bar-grid") {
        let [a1, a2, a3] = ["a1", "a2", "a3"].map(|name| case.number(name));
        let lengths = Lengths { a1, a2, a3 };
        check(&case, &lengths, "polar_full", CountGrid::STATED);
        let half = CountGrid::Arcs { step: 1.0, rays: 37, span_rad: PI };
        check(&case, &lengths, "polar_half", half);
        check(&case, &lengths, "cart_half_0.1", CountGrid::Lattice { step: 0.1 });
    }
}

fn check(case: &Case, lengths: &Lengths, field: &str, grid: CountGrid) {
    let counts = lengths.count(&grid);
    let expected = case.value(field);
    let same = |name: &str, found: usize| {
        assert_eq!(expected[name], Value::from(found), "{}, {name}", case.place(field));
    };
    same("interior", counts.interior());
    same("edge", counts.edge);
    same("K_gt5_interior", counts.above_5());
    same("K_gt5_with_edge", counts.above_5() + counts.edge);
    let classes = Value::from(counts.classes.to_vec());
    assert_eq!(expected["classes_interior"], classes, "{}", case.place(field));
}

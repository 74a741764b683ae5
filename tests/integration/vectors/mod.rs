//! The reference cases of `tests/data/vectors`: one test per file, every case of it.
//!
//! The files hold results of an independent implementation, SI units and radians, matrices
//! row-major, `null` = not defined. Agreement is 1e-9 relative to max(1, largest entry).

mod brake_alloc;
mod coercive;
mod fivebar;
mod force_distribution;
mod gp;
mod karnopp;
mod rrr3;
mod serial2;
mod sym5bar;
mod sym5bar_grid;

use hapticd::actuation::{Classification, Region};
use nalgebra::{Dim, Matrix, RawStorage};
use serde_json::Value;
use std::path::Path;

const TOLERANCE: f64 = 1e-9;

/// One case of a file.
pub struct Case {
    file: &'static str,
    number: usize,
    fields: Value,
}

/// Every case of `tests/data/vectors/NAME.json`; a file without one fails.
pub fn cases(file: &'static str) -> Vec<Case> {
    let Value::Array(cases) = content(file)["cases"].take() else { panic!("{file}: no `cases`") };
    assert!(!cases.is_empty(), "{file}: holds no case");
    let case = |(number, fields)| Case { file, number, fields };
    cases.into_iter().enumerate().map(case).collect()
}

/// A whole file of `tests/data/vectors`.
pub fn content(file: &str) -> Value {
    let path =
        Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/data/vectors/{file}.json"));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    serde_json::from_str(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

impl Case {
    /// Where in the data a failure is.
    pub fn place(&self, field: &str) -> String {
        format!("{}.json, case {}, field {field}", self.file, self.number)
    }

    /// A field as it stands in the file; absent is a failure, `null` is not.
    pub fn value(&self, field: &str) -> &Value {
        self.fields.get(field).unwrap_or_else(|| panic!("{} is missing", self.place(field)))
    }

    /// A number, vector or matrix as a flat list, row by row.
    pub fn numbers(&self, field: &str) -> Vec<f64> {
        let mut flat = Vec::new();
        let numeric = flatten(self.value(field), &mut flat);
        assert!(numeric, "{} holds something else than numbers", self.place(field));
        flat
    }

    /// A vector of known length.
    pub fn array<const N: usize>(&self, field: &str) -> [f64; N] {
        let numbers = self.numbers(field);
        let length = numbers.len();
        numbers.try_into().unwrap_or_else(|_| panic!("{}: {length} numbers", self.place(field)))
    }

    pub fn number(&self, field: &str) -> f64 {
        self.array::<1>(field)[0]
    }

    /// A number that is whole.
    pub fn integer(&self, field: &str) -> i32 {
        let number = self.number(field);
        assert_eq!(number.fract(), 0.0, "{}", self.place(field));
        number as i32
    }

    /// Fails unless `actual` agrees with the field.
    pub fn expect(&self, field: &str, actual: &[f64]) {
        let expected = self.numbers(field);
        assert!(
            close(actual, &expected),
            "{}: {actual:?}, expected {expected:?}",
            self.place(field)
        );
    }

    /// [`Case::expect`] for a matrix, which the file has row by row.
    pub fn expect_matrix<R, C, S>(&self, field: &str, actual: &Matrix<f64, R, C, S>)
    where
        R: Dim,
        C: Dim,
        S: RawStorage<f64, R, C>,
    {
        let rows = actual.row_iter().flat_map(|row| row.iter().copied().collect::<Vec<_>>());
        self.expect(field, &rows.collect::<Vec<_>>());
    }

    /// Fails unless the region (in the files' words) and its angle are those of the case.
    fn expect_region(&self, found: Option<Classification>) {
        let (name, gamma_rad) = match found {
            None => ("rest", None),
            Some(found) => (file_name(found.region), found.gamma_rad),
        };
        let region = self.value("region");
        assert_eq!(region, name, "{}", self.place("region"));
        match gamma_rad.filter(|_| name != "rest") {
            None => assert!(self.value("gamma").is_null(), "{}", self.place("gamma")),
            Some(gamma_rad) => self.expect("gamma", &[gamma_rad]),
        }
    }

    /// Fails unless rays, betas, P_a and P_f are those of the case.
    fn expect_rays(&self, rays: &hapticd::mechanism::Rays) {
        let order: Vec<_> = rays.order().iter().map(|ray| Value::from(ray.to_string())).collect();
        assert_eq!(&Value::from(order), self.value("order"), "{}", self.place("order"));
        self.expect("betas", rays.betas_rad());
        self.expect("P_a", &[rays.P_a()]);
        self.expect("P_f", &[rays.P_f()]);
    }
}

/// The files' word for a region.
fn file_name(region: Region) -> &'static str {
    match region {
        Region::Full => "full",
        Region::Approximate => "approx",
        Region::NotDisplayable => "active",
    }
}

/// Same length, and every entry within the tolerance of the largest one.
pub fn close(actual: &[f64], expected: &[f64]) -> bool {
    let scale = expected.iter().fold(1.0_f64, |most, x| most.max(x.abs()));
    let near = |(a, e): (&f64, &f64)| (a - e).abs() <= TOLERANCE * scale;
    actual.len() == expected.len() && actual.iter().zip(expected).all(near)
}

fn flatten(value: &Value, flat: &mut Vec<f64>) -> bool {
    match value {
        Value::Array(values) => values.iter().all(|value| flatten(value, flat)),
        value => value.as_f64().map(|number| flat.push(number)).is_some(),
    }
}

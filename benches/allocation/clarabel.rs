//! The allocation as a general solver sees it: a quadratic programme within bounds, by Clarabel.
//!
//! `min |R t - F|^2` over `lower <= t <= upper`. The solver is kept from problem to problem and
//! only given new numbers, as a loop would do. It finds the distance; among equals it takes any
//! torques, where `optimal` takes the least. It allocates, and its steps are bounded by a number.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, SupportedConeT};
use hapticd::notation::{ActuatorVector, PlaneVector, ReferenceMatrix};

/// A solver for problems of one size.
pub struct Clarabel {
    solver: DefaultSolver<f64>,
    actuators: usize,
}

impl Clarabel {
    /// For this many actuators.
    pub fn new(actuators: usize) -> Self {
        let settings = DefaultSettingsBuilder::default()
            .verbose(false)
            .presolve_enable(false)
            .build()
            .expect("constant settings are valid");
        let costs = upper_triangle(actuators, |_, _| 1.0);
        let bounds = box_of(actuators);
        let cones = [SupportedConeT::NonnegativeConeT(2 * actuators)];
        let (q, b) = (vec![0.0; actuators], vec![1.0; 2 * actuators]);
        let solver = DefaultSolver::new(&costs, &q, &bounds, &b, &cones, settings);
        Self { solver: solver.expect("a problem of the right sizes"), actuators }
    }

    /// The nearest torques, in the metric of `matrix` and `target`.
    pub fn solve(
        &mut self,
        (matrix, target): &(ReferenceMatrix, PlaneVector),
        (lower_Nm, upper_Nm): (&ActuatorVector, &ActuatorVector),
    ) -> ActuatorVector {
        let costs = matrix.tr_mul(matrix);
        let towards = -matrix.tr_mul(target);
        let count = self.actuators;
        let values: Vec<f64> =
            (0..count).flat_map(|j| (0..=j).map(move |i| costs[(i, j)])).collect();
        let q: Vec<f64> = towards.iter().take(count).copied().collect();
        let upper = upper_Nm.iter().take(count).copied();
        let b: Vec<f64> = upper.chain(lower_Nm.iter().take(count).map(|l| -l)).collect();
        self.solver.update_P(&values).expect("as many numbers as before");
        self.solver.update_q(&q).expect("as many numbers as before");
        self.solver.update_b(&b).expect("as many numbers as before");
        self.solver.solve();
        let found = &self.solver.solution.x;
        ActuatorVector::from_fn(|i, _| found.get(i).copied().unwrap_or(0.0))
    }
}

fn upper_triangle(size: usize, entry: impl Fn(usize, usize) -> f64) -> CscMatrix<f64> {
    let columns: Vec<usize> = (0..=size).map(|j| j * (j + 1) / 2).collect();
    let rows: Vec<usize> = (0..size).flat_map(|j| 0..=j).collect();
    let values = (0..size).flat_map(|j| (0..=j).map(move |i| (i, j)));
    let values = values.map(|(i, j)| entry(i, j)).collect();
    CscMatrix::new(size, size, columns, rows, values)
}

/// Every torque once as it is and once negated.
fn box_of(size: usize) -> CscMatrix<f64> {
    let columns = (0..=size).map(|j| 2 * j).collect();
    let rows = (0..size).flat_map(|j| [j, size + j]).collect();
    let values = (0..size).flat_map(|_| [1.0, -1.0]).collect();
    CscMatrix::new(2 * size, size, columns, rows, values)
}

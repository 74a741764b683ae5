//! The indices of one posture: how evenly, how strongly and how lightly its handle is held.
//!
//! Everything follows from the reference matrix R (a column is the wrench at the handle per
//! unit torque) and the inertia M. Wrenches in newtons; where a device has three freedoms its
//! moments are divided by `moment_length_m` first, because no condition number can be taken of
//! mixed units. Singular values of R are those of `J^-T`: newtons per newton metre.
//!
//! | index | source |
//! |---|---|
//! | betas, P_a, P_f | Cho 2005, Eq 6 and 8 |
//! | K = sigma_max / sigma_min and its classes | Singh et al., section 4.1 |
//! | measure w = sqrt(det J J^T) | Yoshikawa 1985; of redundant actuators 1 / sqrt(det R R^T) |
//! | ellipse | Yoshikawa 1985, Singh et al. section 6 (as f = J^T tau) |
//! | worst-direction force | inradius of the zonotope of all torques; derived here |
//! | reflected inertia | eigenvalues of the upper-left 2x2 of M |
//!
//! Not a substitute for [`crate::analysis::manipulability`], which tells what one motion allows.

use std::f64::consts::PI;

use nalgebra::{Matrix2, SMatrix, SymmetricEigen};

use crate::mechanism::{Mechanism, Posture, Rays};
use crate::notation::{ActuatorVector, MAX_ACTUATORS, PlaneVector, ReferenceMatrix};

/// How well conditioned a posture is, in the classes of Singh et al.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ConditionClass {
    /// K < 5.
    Below5,
    /// 5 <= K < 10.
    Below10,
    /// 10 <= K <= 100.
    UpTo100,
    /// K > 100, singular postures with it.
    Above100,
}

impl ConditionClass {
    /// Best first, as they are counted.
    pub const ALL: [Self; 4] = [Self::Below5, Self::Below10, Self::UpTo100, Self::Above100];

    /// The class of a condition number; what is no number is no good posture.
    pub fn of(condition: f64) -> Self {
        match condition {
            K if K < 5.0 => Self::Below5,
            K if K < 10.0 => Self::Below10,
            K if K <= 100.0 => Self::UpTo100,
            _ => Self::Above100,
        }
    }

    /// Its range.
    pub fn label(self) -> &'static str {
        match self {
            Self::Below5 => "K < 5",
            Self::Below10 => "5 <= K < 10",
            Self::UpTo100 => "10 <= K <= 100",
            Self::Above100 => "K > 100",
        }
    }
}

/// How the rays lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayIndices {
    /// Sum of the squared angles between neighbours, rad^2.
    pub P_a: f64,
    /// Largest angle between neighbours, rad.
    pub P_f: f64,
    /// Smallest angle between neighbours, rad.
    pub least_beta_rad: f64,
}

/// The ellipse of forces in the plane whose torques have a norm of 1 N m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForceEllipse {
    /// Semi-axes, the longer first, N per N m.
    pub semi_axes: [f64; 2],
    /// Direction of the longer one, in (-pi/2, pi/2].
    pub angle_rad: f64,
}

/// The account of one posture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalIndices {
    /// `None` where an actuator has no direction in the plane.
    pub rays: Option<RayIndices>,
    /// K; infinite at a singularity.
    pub condition: f64,
    /// Yoshikawa's measure, m^2/rad^2 (m^3/rad^3 with three freedoms on the moment length).
    pub yoshikawa: f64,
    /// Force that the actuators can give in every direction, acting both ways, N.
    pub worst_force_N: f64,
    /// Least and most inertia felt in a direction of the plane, kg.
    pub inertia_kg: [f64; 2],
    /// What a torque of unit norm can do.
    pub ellipse: ForceEllipse,
}

impl LocalIndices {
    /// The indices of a linkage's posture with these largest torques.
    pub fn of(
        mechanism: &dyn Mechanism,
        max_torque_Nm: &ActuatorVector,
        posture: &Posture,
    ) -> Self {
        let (freedoms, actuators) = (mechanism.freedoms(), mechanism.actuators());
        let length_m = moment_length_m(mechanism).unwrap_or(1.0);
        let columns = columns(&posture.reference, freedoms, actuators, length_m);
        let (condition, product) = singular(&columns, freedoms);
        Self {
            rays: ray_indices(&posture.reference, actuators),
            condition,
            yoshikawa: 1.0 / product,
            worst_force_N: worst_force_N(&columns, max_torque_Nm, freedoms, actuators),
            inertia_kg: ends(&posture.inertia.fixed_view::<2, 2>(0, 0).into_owned()),
            ellipse: ellipse(&posture.reference, actuators),
        }
    }

    /// The class of its condition number.
    pub fn class(&self) -> ConditionClass {
        ConditionClass::of(self.condition)
    }
}

/// What moments are divided by to be compared with forces: the furthest that the handle
/// reaches. `None` where they do not count.
pub fn moment_length_m(mechanism: &dyn Mechanism) -> Option<f64> {
    (mechanism.freedoms() == 3).then(|| mechanism.reach_m().1)
}

/// P_a, P_f and the smallest beta of a reference matrix.
pub fn ray_indices(reference: &ReferenceMatrix, actuators: usize) -> Option<RayIndices> {
    let rays = Rays::of(reference, actuators)?;
    let least_beta_rad = rays.betas_rad().iter().copied().fold(PI, f64::min);
    Some(RayIndices { P_a: rays.P_a(), P_f: rays.P_f(), least_beta_rad })
}

/// The force ellipse of a reference matrix in the plane.
pub fn ellipse(reference: &ReferenceMatrix, actuators: usize) -> ForceEllipse {
    let mut gram = Matrix2::zeros();
    for column in reference.column_iter().take(actuators) {
        gram += column.xy() * column.xy().transpose();
    }
    // The eigenvectors of a symmetric 2x2 in closed form: no sign and no order to sort out.
    let (mean, half) = (0.5 * gram.trace(), 0.5 * (gram[(0, 0)] - gram[(1, 1)]));
    let radius = half.hypot(gram[(0, 1)]);
    let angle_rad = 0.5 * gram[(0, 1)].atan2(half);
    ForceEllipse { semi_axes: [mean + radius, (mean - radius).max(0.0)].map(f64::sqrt), angle_rad }
}

/// The first columns of R, the moments on a length and zero where they do not count.
fn columns(
    reference: &ReferenceMatrix,
    freedoms: usize,
    actuators: usize,
    moment_length_m: f64,
) -> ReferenceMatrix {
    ReferenceMatrix::from_fn(|row, i| match row {
        _ if i >= actuators => 0.0,
        2 if freedoms == 2 => 0.0,
        2 => reference[(2, i)] / moment_length_m,
        _ => reference[(row, i)],
    })
}

/// Condition number, and product of the singular values.
fn singular(columns: &ReferenceMatrix, freedoms: usize) -> (f64, f64) {
    let (most, least, product) = if freedoms == 2 {
        let plane: SMatrix<f64, 2, MAX_ACTUATORS> = columns.fixed_rows::<2>(0).into_owned();
        let values = plane.singular_values();
        (values.max(), values.min(), values.product())
    } else {
        let values = columns.singular_values();
        (values.max(), values.min(), values.product())
    };
    (if least > 1e-12 * most { most / least } else { f64::INFINITY }, product)
}

/// Largest ball of wrenches about zero that the box of torques can give: the nearest facet of
/// their zonotope. In the plane a facet runs along a ray, in space along two of them.
fn worst_force_N(
    columns: &ReferenceMatrix,
    max_torque_Nm: &ActuatorVector,
    freedoms: usize,
    actuators: usize,
) -> f64 {
    let rays: [PlaneVector; MAX_ACTUATORS] =
        std::array::from_fn(|i| columns.column(i) * max_torque_Nm[i]);
    let rays = &rays[..actuators];
    let support_N = |normal: PlaneVector| {
        let normal = normal.try_normalize(1e-12)?;
        Some(rays.iter().map(|ray| ray.dot(&normal).abs()).sum::<f64>())
    };
    let mut worst_N = f64::INFINITY;
    for (i, ray) in rays.iter().enumerate() {
        if freedoms == 2 {
            worst_N =
                support_N(PlaneVector::new(-ray.y, ray.x, 0.0)).map_or(worst_N, |n| n.min(worst_N));
        } else {
            let facets = rays[..i].iter().filter_map(|other| support_N(ray.cross(other)));
            worst_N = facets.fold(worst_N, f64::min);
        }
    }
    // Without a facet the wrenches are a line or a point.
    if worst_N.is_finite() { worst_N } else { 0.0 }
}

/// Least and most of a symmetric matrix's eigenvalues.
fn ends(matrix: &Matrix2<f64>) -> [f64; 2] {
    let values = SymmetricEigen::new(*matrix).eigenvalues;
    [values.min(), values.max()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::manipulability::manipulability;
    use crate::config::{BUILT_IN, DeviceDefinition};
    use crate::mechanism::{FiveBar, Inertia, LinkInertia, fixtures};
    use rand::{Rng, SeedableRng};

    fn direction(angle_rad: f64) -> PlaneVector {
        PlaneVector::new(angle_rad.cos(), angle_rad.sin(), 0.0)
    }

    #[test]
    fn classes_begin_and_end_where_the_paper_says() {
        for (K, class) in [(1.0, 0), (4.999, 0), (5.0, 1), (9.999, 1), (10.0, 2), (100.0, 2)] {
            assert_eq!(ConditionClass::of(K), ConditionClass::ALL[class], "{K}");
        }
        for K in [100.001, f64::INFINITY, f64::NAN] {
            assert_eq!(ConditionClass::of(K), ConditionClass::Above100);
        }
    }

    #[test]
    fn worst_force_and_ellipse_are_the_extremes_over_all_directions() {
        for (name, _) in BUILT_IN {
            let device = DeviceDefinition::load(name).unwrap();
            let mechanism = device.mechanism.as_ref();
            if mechanism.freedoms() != 2 {
                continue;
            }
            let [x, y] = device.start_m;
            let posture = mechanism.posture_at(&PlaneVector::new(x, y, 0.0)).unwrap();
            let torque_Nm = &device.actuators.max_torque_Nm;
            let found = LocalIndices::of(mechanism, torque_Nm, &posture);
            let rest = [crate::actuation::ShaftMotion::Rest; MAX_ACTUATORS];
            let account =
                manipulability(&device.capability(&posture, &rest), torque_Nm, None, 7200);
            let worst_N =
                account.largest.iter().map(|force| force.range_N).fold(f64::MAX, f64::min);
            assert!(
                (0.0..1e-3).contains(&(worst_N / found.worst_force_N - 1.0)),
                "{name} {worst_N}"
            );
            let [most, least] = account.singular_values[..] else { panic!("two") };
            assert!((found.condition / (most / least) - 1.0).abs() < 1e-9, "{name}");
            assert!((found.yoshikawa * most * least - 1.0).abs() < 1e-9);
            assert!((found.ellipse.semi_axes[0] / most - 1.0).abs() < 1e-9);
            assert!((found.ellipse.semi_axes[1] / least - 1.0).abs() < 1e-9);
            let stretch = |angle_rad: f64| posture.reference.tr_mul(&direction(angle_rad)).norm();
            let longest = (0..1800).map(|i| f64::from(i) * 0.1_f64.to_radians() - 0.5 * PI);
            let longest = longest.max_by(|a, b| stretch(*a).total_cmp(&stretch(*b))).unwrap();
            let off_rad = (longest - found.ellipse.angle_rad + 0.5 * PI).rem_euclid(PI) - 0.5 * PI;
            assert!(off_rad.abs() < 2e-3, "{name}: {longest} {}", found.ellipse.angle_rad);
        }
    }

    #[test]
    fn with_three_freedoms_the_worst_wrench_is_found_by_random_search_too() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(4);
        let columns = ReferenceMatrix::from_fn(|_, _| rng.random_range(-1.0..1.0));
        let torque_Nm = ActuatorVector::from_fn(|_, _| rng.random_range(0.5..2.0));
        let exact_N = worst_force_N(&columns, &torque_Nm, 3, 6);
        let support_N = |normal: PlaneVector| {
            (0..6).map(|i| (columns.column(i) * torque_Nm[i]).dot(&normal).abs()).sum::<f64>()
        };
        let mut least_N = f64::INFINITY;
        for _ in 0..200_000 {
            let normal = PlaneVector::from_fn(|_, _| rng.random_range(-1.0..1.0));
            least_N = least_N.min(support_N(normal.normalize()));
        }
        assert!((0.0..0.02).contains(&(least_N / exact_N - 1.0)), "{least_N} {exact_N}");
    }

    #[test]
    fn reflected_inertia_bounds_what_every_direction_feels() {
        let link = LinkInertia { mass_kg: 0.4, centre_m: 0.1, inertia_kg_m2: 2e-3 };
        let inertia = Inertia { links: [link; 4], ..Inertia::default() };
        let device = FiveBar::new(fixtures::CHO[0], inertia).unwrap();
        let posture = device.posture_at(&PlaneVector::new(0.3, 0.1, 0.0)).unwrap();
        let torque_Nm = ActuatorVector::repeat(20.0);
        let [least, most] = LocalIndices::of(&device, &torque_Nm, &posture).inertia_kg;
        let felt = |i: i32| {
            let along = direction(f64::from(i) * 0.001 * PI);
            (along.transpose() * posture.inertia * along)[0]
        };
        let (low, high) =
            (0..1000).map(felt).fold((f64::MAX, 0.0f64), |(l, h), m| (l.min(m), h.max(m)));
        assert!((low / least - 1.0).abs() < 1e-4 && (high / most - 1.0).abs() < 1e-4);
        assert!(most > 1.05 * least, "links make it uneven: {least} {most}");
    }

    #[test]
    fn a_flat_reference_matrix_has_no_force_and_an_infinite_condition() {
        let mut reference = ReferenceMatrix::zeros();
        reference.fixed_view_mut::<1, 4>(0, 0).fill(3.0);
        let flat = columns(&reference, 2, 4, 1.0);
        assert_eq!(singular(&flat, 2).0, f64::INFINITY);
        assert!(worst_force_N(&flat, &ActuatorVector::repeat(1.0), 2, 4) < 1e-9);
        assert_eq!(ellipse(&reference, 4), ForceEllipse { semi_axes: [6.0, 0.0], angle_rad: 0.0 });
        assert_eq!(worst_force_N(&ReferenceMatrix::zeros(), &ActuatorVector::zeros(), 3, 6), 0.0);
    }
}

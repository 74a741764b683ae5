//! The sphere: all points within a radius of a centre. W, metres.

use nalgebra::Vector3;

use super::{Nearest, radial};

/// Distance from the surface, positive outside. From the very centre every direction leads
/// out; one is picked.
pub(super) fn nearest(p_W_m: &Vector3<f64>, centre_W_m: &Vector3<f64>, radius_m: f64) -> Nearest {
    radial(&(p_W_m - centre_W_m), radius_m, Vector3::x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::Shape;
    use crate::environment::shape::tests::{check_against_samples, on_unit_sphere};

    #[test]
    fn its_distance_is_that_of_the_nearest_point_of_the_surface() {
        let (centre_W_m, radius_m) = (Vector3::new(0.02, -0.01, 0.03), 0.08);
        check_against_samples(
            &Shape::Sphere { centre_W_m, radius_m },
            |a, b| centre_W_m + radius_m * on_unit_sphere(a, b),
            |p| (p - centre_W_m).norm() < radius_m,
        );
    }

    #[test]
    fn its_centre_has_a_way_out() {
        let centre = nearest(&Vector3::z(), &Vector3::z(), 0.1);
        assert_eq!((centre.distance_m, centre.normal_W.norm()), (-0.1, 1.0));
    }
}

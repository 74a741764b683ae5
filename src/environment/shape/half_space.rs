//! The half-space: all points behind a plane. W, metres; the normal has length 1.

use nalgebra::Vector3;

use super::Nearest;

/// Distance from the plane, positive on the side that the normal points to.
pub(super) fn nearest(
    p_W_m: &Vector3<f64>,
    point_W_m: &Vector3<f64>,
    normal_W: &Vector3<f64>,
) -> Nearest {
    Nearest { distance_m: (p_W_m - point_W_m).dot(normal_W), normal_W: *normal_W }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::Shape;
    use crate::environment::shape::tests::check_against_samples;

    #[test]
    fn its_distance_is_that_of_the_nearest_point_of_the_plane() {
        let normal_W = Vector3::new(1.0, -2.0, 0.5).normalize();
        let point_W_m = Vector3::new(0.05, 0.02, -0.03);
        let (u, v) = (super::super::across(&normal_W), normal_W);
        let u = u.normalize();
        let v = v.cross(&u);
        let at = |a: f64, b: f64| point_W_m + 0.6 * ((a - 0.5) * u + (b - 0.5) * v);
        let behind = |p: &Vector3<f64>| (p - point_W_m).dot(&normal_W) < 0.0;
        check_against_samples(&Shape::HalfSpace { point_W_m, normal_W }, at, behind);
    }
}

//! The capsule: all points within a radius of the line between two ends. W, metres.

use nalgebra::Vector3;

use super::{Nearest, across, nearest_between, radial};

/// Distance from the surface, positive outside. On the axis some way across leads out.
pub(super) fn nearest(
    p_W_m: &Vector3<f64>,
    ends_W_m: &[Vector3<f64>; 2],
    radius_m: f64,
) -> Nearest {
    let away = p_W_m - nearest_between(ends_W_m, p_W_m);
    radial(&away, radius_m, || across(&(ends_W_m[1] - ends_W_m[0])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::Shape;
    use crate::environment::shape::tests::{check_against_samples, on_unit_sphere};

    const ENDS_W_M: [Vector3<f64>; 2] =
        [Vector3::new(-0.05, 0.02, 0.0), Vector3::new(0.07, -0.01, 0.03)];

    #[test]
    fn its_distance_is_that_of_the_nearest_point_of_the_surface() {
        let radius_m = 0.05;
        let axis = (ENDS_W_M[1] - ENDS_W_M[0]).normalize();
        let u = across(&axis);
        let v = axis.cross(&u);
        // Two thirds of the samples on the caps, one third on the side.
        let on_surface = |a: f64, b: f64| {
            if a < 1.0 / 3.0 {
                let (sin, cos) = (b * std::f64::consts::TAU).sin_cos();
                let foot = ENDS_W_M[0] + 3.0 * a * (ENDS_W_M[1] - ENDS_W_M[0]);
                return foot + radius_m * (cos * u + sin * v);
            }
            let out = on_unit_sphere((a - 1.0 / 3.0) * 1.5, b);
            ENDS_W_M[usize::from(out.dot(&axis) > 0.0)] + radius_m * out
        };
        let inside = |p: &Vector3<f64>| {
            // Independent of the closed form: some ball along the axis holds the point.
            (0..=2000).any(|i| {
                let centre = ENDS_W_M[0].lerp(&ENDS_W_M[1], f64::from(i) / 2000.0);
                (p - centre).norm() < radius_m
            })
        };
        check_against_samples(&Shape::Capsule { ends_W_m: ENDS_W_M, radius_m }, on_surface, inside);
    }

    #[test]
    fn one_without_length_is_a_sphere_and_its_axis_has_a_way_out() {
        let end = Vector3::new(0.1, 0.2, 0.3);
        let p = Vector3::new(0.15, 0.2, 0.3);
        let point = nearest(&p, &[end, end], 0.02);
        assert!((point.distance_m - 0.03).abs() < 1e-15 && point.normal_W.x > 0.999);
        let middle = nearest(&ENDS_W_M[0].lerp(&ENDS_W_M[1], 0.5), &ENDS_W_M, 0.02);
        assert!((middle.distance_m + 0.02).abs() < 1e-12);
        assert!((middle.normal_W.norm() - 1.0).abs() < 1e-12);
        assert!(middle.normal_W.dot(&(ENDS_W_M[1] - ENDS_W_M[0])).abs() < 1e-12);
    }
}

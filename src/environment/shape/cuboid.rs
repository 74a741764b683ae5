//! The box: a rectangular block in any pose. W, metres; `q_WS` turns its own axes into W.
//!
//! Outside, its distance is rounded at edges and corners; inside, it is that of the nearest
//! face, and on a tie the way out is along the earlier axis. From within a hollow one each
//! axis is a wall of its own: in a corner three hold the tool at once.

use nalgebra::{UnitQuaternion, Vector3};

use super::{Faces, MAX_FACES, Nearest};

/// Distance from the surface, positive outside.
pub(super) fn nearest(
    p_W_m: &Vector3<f64>,
    centre_W_m: &Vector3<f64>,
    q_WS: &UnitQuaternion<f64>,
    half_extents_m: &Vector3<f64>,
) -> Nearest {
    let p_S_m = q_WS.inverse_transform_vector(&(p_W_m - centre_W_m));
    let beyond_m = p_S_m.abs() - half_extents_m;
    let out_m = beyond_m.sup(&Vector3::zeros()).zip_map(&p_S_m, f64::copysign);
    let range_m = out_m.norm();
    if range_m > 0.0 {
        return Nearest { distance_m: range_m, normal_W: q_WS * (out_m / range_m) };
    }
    let axis = beyond_m.imax();
    Nearest { distance_m: beyond_m[axis], normal_W: q_WS * outward(axis, p_S_m[axis]) }
}

/// The three walls around the middle of a hollow box, `room_m` away from it.
pub(super) fn inner_faces(
    p_W_m: &Vector3<f64>,
    centre_W_m: &Vector3<f64>,
    q_WS: &UnitQuaternion<f64>,
    room_m: &Vector3<f64>,
) -> Faces {
    let p_S_m = q_WS.inverse_transform_vector(&(p_W_m - centre_W_m));
    Faces {
        normal_W: std::array::from_fn(|axis| -(q_WS * outward(axis, p_S_m[axis]))),
        depth_m: std::array::from_fn(|axis| p_S_m[axis].abs() - room_m[axis]),
        count: MAX_FACES,
    }
}

fn outward(axis: usize, coordinate_m: f64) -> Vector3<f64> {
    Vector3::from_fn(|i, _| if i == axis { 1f64.copysign(coordinate_m) } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::Shape;
    use crate::environment::shape::tests::check_against_samples;

    const HALF_M: Vector3<f64> = Vector3::new(0.06, 0.09, 0.03);

    fn turned() -> UnitQuaternion<f64> {
        UnitQuaternion::from_euler_angles(0.4, -0.7, 1.9)
    }

    /// A point of the surface: the first coordinate also picks one of six faces.
    fn on_surface(a: f64, b: f64) -> Vector3<f64> {
        let face = (a * 6.0).min(5.999);
        let (axis, sign) = (face as usize / 2, [1.0, -1.0][face as usize % 2]);
        let across = [face.fract(), b].map(|share| 2.0 * share - 1.0);
        let mut p = Vector3::zeros();
        p[axis] = sign;
        (p[(axis + 1) % 3], p[(axis + 2) % 3]) = (across[0], across[1]);
        p.component_mul(&HALF_M)
    }

    #[test]
    fn its_distance_is_that_of_the_nearest_point_of_the_surface() {
        let (centre_W_m, q_WS) = (Vector3::new(-0.02, 0.01, 0.02), turned());
        check_against_samples(
            &Shape::Box { centre_W_m, q_WS, half_extents_m: HALF_M },
            |a, b| centre_W_m + q_WS * on_surface(a, b),
            |p| {
                let local = q_WS.inverse() * (p - centre_W_m);
                (0..3).all(|axis| local[axis].abs() < HALF_M[axis])
            },
        );
    }

    /// The nearest point of the room, by clamping, is where the three walls together lead.
    #[test]
    fn from_within_the_walls_together_lead_back_into_the_room() {
        let q_WS = turned();
        for p_S_m in [
            Vector3::new(0.01, 0.02, 0.0),
            Vector3::new(0.07, 0.02, -0.01),
            Vector3::new(-0.07, 0.10, -0.04),
        ] {
            let faces = inner_faces(&(q_WS * p_S_m), &Vector3::zeros(), &q_WS, &HALF_M);
            let back = faces.iter().fold(Vector3::zeros(), |sum, (depth_m, normal_W)| {
                sum + depth_m.max(0.0) * normal_W
            });
            let inside = p_S_m.zip_map(&HALF_M, |x, most| x.clamp(-most, most));
            assert!((q_WS.inverse() * back + p_S_m - inside).norm() < 1e-15);
            let entered = faces.iter().filter(|(depth_m, _)| *depth_m > 0.0).count();
            let beyond = (0..3).filter(|&i| p_S_m[i].abs() > HALF_M[i]).count();
            assert_eq!(entered, beyond);
        }
    }

    #[test]
    fn its_centre_has_a_way_out() {
        let centre = nearest(&Vector3::z(), &Vector3::z(), &turned(), &HALF_M);
        assert_eq!(centre.distance_m, -0.03);
        assert!((centre.normal_W.norm() - 1.0).abs() < 1e-12);
    }
}

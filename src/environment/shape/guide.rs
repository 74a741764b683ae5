//! What the tool is led along: a point, a line, a part of a line, or a plane. W, metres.
//!
//! A guide is felt from every side: beyond its radius the way out of the constraint leads
//! back to it. So its distance is positive *near* it, `radius - range`, and the normal
//! points towards it.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{Nearest, across, nearest_between, radial};

/// The path of a guide.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Guide {
    /// One place.
    Point {
        /// That place.
        point_W_m: Vector3<f64>,
    },
    /// An endless line.
    Line {
        /// Any point of it.
        point_W_m: Vector3<f64>,
        /// Unit vector along it.
        direction_W: Vector3<f64>,
    },
    /// The line between two ends; also the part of a corridor that the tool is in.
    Segment {
        /// The two ends, which may be the same.
        ends_W_m: [Vector3<f64>; 2],
    },
    /// A plane.
    Plane {
        /// Any point of it.
        point_W_m: Vector3<f64>,
        /// Unit vector across it.
        normal_W: Vector3<f64>,
    },
}

impl Guide {
    /// How far inside `radius_m` a point is, and the direction back to the path.
    pub(super) fn nearest(&self, p_W_m: &Vector3<f64>, radius_m: f64) -> Nearest {
        let (_, axis_W) = self.origin_and_axis();
        let range = radial(&(p_W_m - self.nearest_point(p_W_m)), radius_m, || match self {
            Self::Plane { .. } => axis_W,
            _ => across(&axis_W),
        });
        Nearest { distance_m: -range.distance_m, normal_W: -range.normal_W }
    }

    /// The point of the path that is nearest.
    pub fn nearest_point(&self, p_W_m: &Vector3<f64>) -> Vector3<f64> {
        match self {
            Self::Point { point_W_m } => *point_W_m,
            Self::Line { point_W_m, direction_W } => {
                point_W_m + direction_W * (p_W_m - point_W_m).dot(direction_W)
            }
            Self::Segment { ends_W_m } => nearest_between(ends_W_m, p_W_m),
            Self::Plane { point_W_m, normal_W } => {
                p_W_m - normal_W * (p_W_m - point_W_m).dot(normal_W)
            }
        }
    }

    pub(super) fn origin_and_axis(&self) -> (Vector3<f64>, Vector3<f64>) {
        match self {
            Self::Point { point_W_m } => (*point_W_m, Vector3::z()),
            Self::Line { point_W_m, direction_W } => (*point_W_m, *direction_W),
            Self::Segment { ends_W_m: [a, b] } => (*a, b - a),
            Self::Plane { point_W_m, normal_W } => (*point_W_m, *normal_W),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::Shape;
    use crate::environment::shape::tests::{check_gradient, points};

    fn guides() -> [Guide; 4] {
        let point_W_m = Vector3::new(0.01, 0.02, -0.01);
        let direction_W = Vector3::new(1.0, 2.0, -0.5).normalize();
        [
            Guide::Point { point_W_m },
            Guide::Line { point_W_m, direction_W },
            Guide::Segment { ends_W_m: [point_W_m, point_W_m + 0.1 * direction_W] },
            Guide::Plane { point_W_m, normal_W: direction_W },
        ]
    }

    /// Points of a path by brute force: a grid over its own directions.
    fn samples(path: &Guide) -> Vec<Vector3<f64>> {
        let (origin, axis) = path.origin_and_axis();
        let steps =
            |from: f64, to: f64| (0..=400).map(move |i| from + (to - from) * i as f64 / 400.0);
        match path {
            Guide::Point { .. } => vec![origin],
            Guide::Line { .. } => steps(-0.4, 0.4).map(|s| origin + s * axis).collect(),
            Guide::Segment { .. } => steps(0.0, 1.0).map(|s| origin + s * axis).collect(),
            Guide::Plane { .. } => {
                let u = across(&axis);
                let v = axis.cross(&u);
                let across = |a: f64| steps(-0.4, 0.4).map(move |b| origin + a * u + b * v);
                steps(-0.4, 0.4).flat_map(across).collect()
            }
        }
    }

    #[test]
    fn a_guide_is_as_deep_as_its_nearest_point_is_beyond_the_radius() {
        for path in guides() {
            let on_path = samples(&path);
            for p in points(40) {
                let range_m = on_path.iter().map(|q| (p - q).norm()).fold(f64::INFINITY, f64::min);
                let found = path.nearest(&p, 0.05);
                assert!((0.05 - range_m - found.distance_m).abs() < 1e-3, "{path:?}");
                let back = p + found.normal_W * (0.05 - found.distance_m);
                assert!((back - path.nearest_point(&p)).norm() < 1e-9, "it leads to the path");
            }
            check_gradient(&Shape::Guide { path, radius_m: 0.05 });
        }
    }

    #[test]
    fn on_the_path_itself_there_is_a_direction() {
        for path in guides() {
            let (origin, _) = path.origin_and_axis();
            let found = path.nearest(&origin, 0.0);
            assert!(found.distance_m.abs() < 1e-15 && (found.normal_W.norm() - 1.0).abs() < 1e-12);
        }
    }
}

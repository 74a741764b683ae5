//! The courses of the wall-following experiment: what stands in the way, and the hand's path.
//!
//! In B, which is W here: the device is not mounted anywhere else. A course is a list of scene
//! elements and a list of [`Leg`]s, lines and arcs on the surface that the hand slides along,
//! one after the other. Each leg knows, at a distance along it, its place, its tangent and the
//! normal that leads out of the wall; its curvature is positive where the centre lies on the
//! free side (inside a hollow circle). Places suit devices that reach from 0.2 to 0.5 m; for
//! others a course is scaled, turned and moved as a whole ([`Placement`]). A course does not
//! know devices, hands or laws.

use std::fmt;
use std::str::FromStr;

use nalgebra::{UnitQuaternion, Vector2, Vector3};

use super::beside::Beside;
use super::fit::{self, NoRoom};
use crate::environment::{Corridor, Element, Guide, Material, Shape, Surface};
use crate::mechanism::Mechanism;
use crate::notation::PlaneVector;

/// Which course.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum CourseKind {
    /// The paper's wall: x = 0.3 m, from y = 0.35 m down to -0.15 m.
    #[default]
    Straight,
    /// A wall turned by 30 degrees, 0.37 m from the axis.
    StraightTurned,
    /// A wall turned by -45 degrees, 0.25 m from the axis.
    StraightSlanted,
    /// Into the inner corner of two walls, and out along the other.
    Corner,
    /// Along a box, over its edge, and along the next face.
    Edge,
    /// Once round the inside of a hollow sphere.
    Hollow,
    /// Once round the outside of a sphere.
    Ball,
    /// Along the outer side of a corridor with two bends.
    Corridor,
}

impl CourseKind {
    /// Every course.
    pub const ALL: [Self; 8] = [
        Self::Straight,
        Self::StraightTurned,
        Self::StraightSlanted,
        Self::Corner,
        Self::Edge,
        Self::Hollow,
        Self::Ball,
        Self::Corridor,
    ];

    /// The name on command lines and in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Straight => "straight",
            Self::StraightTurned => "straight+30",
            Self::StraightSlanted => "straight-45",
            Self::Corner => "corner",
            Self::Edge => "edge",
            Self::Hollow => "hollow",
            Self::Ball => "ball",
            Self::Corridor => "corridor",
        }
    }
}

impl fmt::Display for CourseKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A name that no course has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "no course `{0}`: one of straight, straight+30, straight-45, corner, edge, hollow, ball, corridor"
)]
pub struct UnknownCourse(pub String);

impl FromStr for CourseKind {
    type Err = UnknownCourse;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        let found = Self::ALL.into_iter().find(|course| course.name() == name);
        found.ok_or_else(|| UnknownCourse(name.to_owned()))
    }
}

/// A part of the hand's path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Leg {
    /// Straight, at a wall that leads out along `normal`.
    Line { from_m: Vector2<f64>, to_m: Vector2<f64>, normal: Vector2<f64> },
    /// Round a centre; the free side is inside or outside.
    Arc { centre_m: Vector2<f64>, radius_m: f64, from_rad: f64, sweep_rad: f64, free_inside: bool },
}

/// One place of a leg.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// On the surface.
    pub p_m: Vector2<f64>,
    /// The way the hand goes.
    pub tangent: Vector2<f64>,
    /// Out of the wall.
    pub normal: Vector2<f64>,
}

impl Leg {
    /// How long it is.
    pub fn length_m(&self) -> f64 {
        match self {
            Self::Line { from_m, to_m, .. } => (to_m - from_m).norm(),
            Self::Arc { radius_m, sweep_rad, .. } => radius_m * sweep_rad.abs(),
        }
    }

    /// One over the radius; positive where the centre is on the free side.
    pub fn curvature_per_m(&self) -> f64 {
        match self {
            Self::Line { .. } => 0.0,
            Self::Arc { radius_m, free_inside, .. } => {
                if *free_inside {
                    1.0 / radius_m
                } else {
                    -1.0 / radius_m
                }
            }
        }
    }

    /// The place at a distance along it, before its beginning and beyond its end too.
    pub fn at(&self, s_m: f64) -> Place {
        match *self {
            Self::Line { from_m, to_m, normal } => {
                let tangent = (to_m - from_m).normalize();
                Place { p_m: from_m + tangent * s_m, tangent, normal }
            }
            Self::Arc { centre_m, radius_m, from_rad, sweep_rad, free_inside } => {
                let at_rad = from_rad + sweep_rad.signum() * s_m / radius_m;
                let out = Vector2::new(at_rad.cos(), at_rad.sin());
                Place {
                    p_m: centre_m + out * radius_m,
                    tangent: Vector2::new(-out.y, out.x) * sweep_rad.signum(),
                    normal: if free_inside { -out } else { out },
                }
            }
        }
    }

    /// How far along it a point is that was last at `near_m`.
    pub fn project(&self, p_m: &Vector2<f64>, near_m: f64) -> f64 {
        match *self {
            Self::Line { from_m, .. } => (p_m - from_m).dot(&self.at(0.0).tangent),
            Self::Arc { centre_m, radius_m, .. } => {
                let Place { p_m: near, tangent, .. } = self.at(near_m);
                let (out, from) = (p_m - centre_m, near - centre_m);
                let turned = (out.dot(&tangent) * radius_m).atan2(out.dot(&from));
                near_m + radius_m * turned
            }
        }
    }

    fn placed(self, placement: &Placement) -> Self {
        match self {
            Self::Line { from_m, to_m, normal } => Self::Line {
                from_m: placement.place(from_m),
                to_m: placement.place(to_m),
                normal: placement.turn(normal),
            },
            Self::Arc { centre_m, radius_m, from_rad, sweep_rad, free_inside } => Self::Arc {
                centre_m: placement.place(centre_m),
                radius_m: radius_m * placement.scale,
                from_rad: from_rad + placement.turn_rad,
                sweep_rad,
                free_inside,
            },
        }
    }
}

/// Where a course stands: scaled and turned about the origin of B, then moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Its size over that in which it is written here.
    pub scale: f64,
    /// Counter-clockwise.
    pub turn_rad: f64,
    /// By how much.
    pub move_m: Vector2<f64>,
}

impl Placement {
    /// As it is written.
    pub const USUAL: Self = Self { scale: 1.0, turn_rad: 0.0, move_m: Vector2::new(0.0, 0.0) };

    fn turn(&self, v: Vector2<f64>) -> Vector2<f64> {
        let (sin, cos) = self.turn_rad.sin_cos();
        Vector2::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y)
    }

    fn place(&self, p_m: Vector2<f64>) -> Vector2<f64> {
        self.turn(p_m) * self.scale + self.move_m
    }
}

/// What stands in the way, and the hand's path along it.
#[derive(Clone, Debug)]
pub struct Course {
    /// The walls.
    pub elements: Vec<Element>,
    /// What is beside them.
    pub beside: Vec<Element>,
    /// The path.
    pub legs: Vec<Leg>,
}

/// The paths and solids of the courses at their full size.
const BALL_AT_M: [f64; 2] = [0.33, 0.1];
const HOLLOW_RADIUS_M: f64 = 0.09;
const BALL_RADIUS_M: f64 = 0.08;
const CORNER_M: [f64; 2] = [0.35, 0.1];
const EDGE_M: [f64; 2] = [0.3, 0.1];
const BENDS_M: [[f64; 2]; 4] = [[0.25, 0.35], [0.35, 0.2], [0.35, 0.0], [0.25, -0.15]];
const CORRIDOR_RADIUS_M: f64 = 0.01;
/// Over the edge of the box the hand goes on for this long.
const OVER_M: f64 = 0.004;

impl Course {
    /// A course of walls as stiff as this, where this device has room for it.
    pub fn on(
        kind: CourseKind,
        stiffness_N_per_m: f64,
        mechanism: &dyn Mechanism,
    ) -> Result<Self, NoRoom> {
        Ok(Self::new(kind, stiffness_N_per_m, &fit::placement(kind, mechanism)?))
    }

    /// The same with something beside the walls.
    pub fn with(mut self, beside: &Beside) -> Self {
        self.beside = beside.elements(&self.legs[0]);
        self
    }

    /// The soft force of fields on a handle, in B.
    pub fn soft_N(&self, p_m: &Vector2<f64>, v_m_per_s: &Vector2<f64>) -> Vector2<f64> {
        let fields = self.beside.iter().filter_map(|element| {
            element.field_at(&flat(*p_m), &flat(*v_m_per_s)).map(|[force_N, _]| force_N.xy())
        });
        fields.sum()
    }

    /// A course of walls as stiff as this, at its place.
    pub fn new(kind: CourseKind, stiffness_N_per_m: f64, placement: &Placement) -> Self {
        let build = Build { placement: *placement, stiffness_N_per_m };
        match kind {
            CourseKind::Straight => build.wall([0.3, 0.35], [0.3, -0.15]),
            CourseKind::StraightTurned => build.wall([0.2, 0.4], [0.4, 0.0535898]),
            CourseKind::StraightSlanted => build.wall([0.48, 0.12], [0.22, -0.14]),
            CourseKind::Corner => build.corner(),
            CourseKind::Edge => build.edge(),
            CourseKind::Hollow => build.round(HOLLOW_RADIUS_M, true),
            CourseKind::Ball => build.round(BALL_RADIUS_M, false),
            CourseKind::Corridor => build.corridor(),
        }
    }

    /// Each wall at a place: its normal and how deep the place is in it, negative outside.
    pub fn walls_at(&self, p_BH: &PlaneVector) -> impl Iterator<Item = (PlaneVector, f64)> {
        let p_W_m = Vector3::new(p_BH.x, p_BH.y, 0.0);
        self.elements.iter().filter_map(move |element| {
            let nearest = match element {
                Element::Surface(surface) => {
                    let mut nearest = surface.shape.nearest(&p_W_m);
                    if surface.hollow {
                        (nearest.distance_m, nearest.normal_W) =
                            (-nearest.distance_m, -nearest.normal_W);
                    }
                    nearest
                }
                Element::Corridor(corridor) => {
                    let ends = corridor.points_W_m().windows(2);
                    let radius_m = corridor.radius_m;
                    let within = ends.map(|pair| {
                        let path = Guide::Segment { ends_W_m: [pair[0], pair[1]] };
                        Shape::Guide { path, radius_m }.nearest(&p_W_m)
                    });
                    within.max_by(|a, b| a.distance_m.total_cmp(&b.distance_m))?
                }
                _ => return None,
            };
            let normal = PlaneVector::new(nearest.normal_W.x, nearest.normal_W.y, 0.0);
            Some((normal, -nearest.distance_m))
        })
    }

    /// How deep a place is in the wall that it is deepest in; negative outside.
    pub fn depth_m(&self, p_BH: &PlaneVector) -> f64 {
        self.walls_at(p_BH).map(|(_, depth_m)| depth_m).fold(f64::NEG_INFINITY, f64::max)
    }

    /// Where the hand begins: this far from the wall, before the beginning of the path.
    pub fn start_m(&self, clearance_m: f64) -> [f64; 2] {
        let Place { p_m, normal, .. } = self.legs[0].at(0.0);
        (p_m + normal * clearance_m).into()
    }
}

/// Courses at a place.
struct Build {
    placement: Placement,
    stiffness_N_per_m: f64,
}

impl Build {
    fn material(&self) -> Material {
        Material { stiffness_N_per_m: self.stiffness_N_per_m, ..Material::default() }
    }

    fn surface(&self, shape: Shape, hollow: bool) -> Element {
        Element::Surface(Surface { shape, material: self.material(), hollow, blend_s: 0.0 })
    }

    fn half_space(&self, point_m: Vector2<f64>, normal: Vector2<f64>) -> Element {
        let point_W_m = flat(self.placement.place(point_m));
        let normal_W = flat(self.placement.turn(normal));
        self.surface(Shape::HalfSpace { point_W_m, normal_W }, false)
    }

    /// A wall on the left of the way from one place to another, free on the right.
    fn wall(&self, from_m: [f64; 2], to_m: [f64; 2]) -> Course {
        let (from_m, to_m) = (Vector2::from(from_m), Vector2::from(to_m));
        let tangent = (to_m - from_m).normalize();
        let normal = Vector2::new(tangent.y, -tangent.x);
        let leg = Leg::Line { from_m, to_m, normal }.placed(&self.placement);
        Course {
            elements: vec![self.half_space(from_m, normal)],
            legs: vec![leg],
            beside: Vec::new(),
        }
    }

    fn corner(&self) -> Course {
        let (corner_m, up, left) = (Vector2::from(CORNER_M), Vector2::y(), -Vector2::x());
        let legs = [
            Leg::Line { from_m: corner_m + 0.2 * up, to_m: corner_m, normal: left },
            Leg::Line { from_m: corner_m, to_m: corner_m + 0.15 * left, normal: up },
        ];
        Course {
            elements: vec![self.half_space(corner_m, left), self.half_space(corner_m, up)],
            legs: legs.map(|leg| leg.placed(&self.placement)).into(),
            beside: Vec::new(),
        }
    }

    fn edge(&self) -> Course {
        let (edge_m, x, y) = (Vector2::from(EDGE_M), Vector2::x(), Vector2::y());
        let half_m = Vector3::new(0.2, 0.2, 0.2);
        let shape = Shape::Box {
            centre_W_m: flat(self.placement.place(edge_m + half_m.xy())),
            q_WS: UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.placement.turn_rad),
            half_extents_m: half_m * self.placement.scale,
        };
        let over_m = OVER_M / self.placement.scale;
        let legs = [
            Leg::Line { from_m: edge_m + 0.25 * y, to_m: edge_m - over_m * y, normal: -x },
            Leg::Line { from_m: edge_m, to_m: edge_m + 0.12 * x, normal: -y },
        ];
        Course {
            elements: vec![self.surface(shape, false)],
            legs: legs.map(|leg| leg.placed(&self.placement)).into(),
            beside: Vec::new(),
        }
    }

    fn round(&self, radius_m: f64, free_inside: bool) -> Course {
        let centre_m = Vector2::from(BALL_AT_M);
        let arc = Leg::Arc {
            centre_m,
            radius_m,
            from_rad: std::f64::consts::PI,
            sweep_rad: std::f64::consts::TAU,
            free_inside,
        };
        let shape = Shape::Sphere {
            centre_W_m: flat(self.placement.place(centre_m)),
            radius_m: radius_m * self.placement.scale,
        };
        Course {
            elements: vec![self.surface(shape, free_inside)],
            legs: vec![arc.placed(&self.placement)],
            beside: Vec::new(),
        }
    }

    fn corridor(&self) -> Course {
        let points = BENDS_M.map(Vector2::from);
        let corridor = Corridor::new(
            points.map(|point| flat(self.placement.place(point))).into(),
            CORRIDOR_RADIUS_M * self.placement.scale,
            self.material(),
            0.0,
        );
        let along = |i: usize| (points[i + 1] - points[i]).normalize();
        // The bends turn clockwise; their outer side is on the left.
        let left = |i: usize| Vector2::new(-along(i).y, along(i).x);
        let mut legs = Vec::new();
        for i in 0..points.len() - 1 {
            let out_m = left(i) * CORRIDOR_RADIUS_M;
            legs.push(Leg::Line {
                from_m: points[i] + out_m,
                to_m: points[i + 1] + out_m,
                normal: -left(i),
            });
            if i + 2 < points.len() {
                let (a, b) = (left(i), left(i + 1));
                legs.push(Leg::Arc {
                    centre_m: points[i + 1],
                    radius_m: CORRIDOR_RADIUS_M,
                    from_rad: a.y.atan2(a.x),
                    sweep_rad: a.perp(&b).atan2(a.dot(&b)),
                    free_inside: true,
                });
            }
        }
        Course {
            elements: corridor.into_iter().map(Element::Corridor).collect(),
            legs: legs.into_iter().map(|leg| leg.placed(&self.placement)).collect(),
            beside: Vec::new(),
        }
    }
}

fn flat(p: Vector2<f64>) -> Vector3<f64> {
    Vector3::new(p.x, p.y, 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at_depth(place: &Place, depth_m: f64) -> PlaneVector {
        let p = place.p_m - place.normal * depth_m;
        PlaneVector::new(p.x, p.y, 0.0)
    }

    /// Legs lie on the surface, their normals lead out, their tangents are the way along.
    #[test]
    fn every_path_lies_on_the_surface_of_its_walls() {
        for kind in CourseKind::ALL {
            assert_eq!(kind.name().parse(), Ok(kind));
            let elsewhere =
                Placement { scale: 0.3, turn_rad: 2.0, move_m: Vector2::new(0.02, -0.1) };
            for placement in [Placement::USUAL, elsewhere] {
                let course = Course::new(kind, 1e7, &placement);
                for (number, leg) in course.legs.iter().enumerate() {
                    let length_m = leg.length_m();
                    for part in [0.02, 0.3, 0.77, 0.97] {
                        let s_m = part * length_m;
                        let place = leg.at(s_m);
                        let ends = kind == CourseKind::Edge && number == 0 && part > 0.9;
                        for depth_m in [1e-4, -1e-4] {
                            let found_m = course.depth_m(&at_depth(&place, depth_m));
                            assert!(ends || (found_m - depth_m).abs() < 1e-9, "{kind} {part}");
                        }
                        let on_m = leg.project(&(place.p_m - 0.003 * place.normal), s_m + 0.002);
                        assert!((on_m - s_m).abs() < 1e-9, "{kind}: {on_m} for {s_m}");
                        let step = (leg.at(s_m + 1e-6).p_m - place.p_m) / 1e-6;
                        assert!((step - place.tangent).norm() < 1e-3, "{kind}");
                        let from_m = (place.p_m - placement.move_m).norm();
                        assert!(from_m < 0.5 * placement.scale + 0.004, "{kind}");
                    }
                }
            }
        }
    }

    #[test]
    fn legs_follow_one_another_and_curvature_is_that_of_the_normal() {
        for kind in CourseKind::ALL.into_iter().filter(|kind| *kind != CourseKind::Edge) {
            let course = Course::new(kind, 1e7, &Placement::USUAL);
            for pair in course.legs.windows(2) {
                let gap = pair[0].at(pair[0].length_m()).p_m - pair[1].at(0.0).p_m;
                assert!(gap.norm() < 1e-12, "{kind}");
            }
            for leg in &course.legs {
                let turn = (leg.at(0.011).normal - leg.at(0.010).normal) / 1e-3;
                let along = -turn.dot(&leg.at(0.0105).tangent);
                assert!((along - leg.curvature_per_m()).abs() < 0.3, "{kind}: {along}");
            }
        }
    }
}

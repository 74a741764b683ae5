//! The flags that describe an object, and how they change one.
//!
//! A flag that is not given changes nothing; one that does not fit the kind of the object is
//! refused here, by its name. Everything else (what is missing, what is out of range) is for
//! the server to refuse, which names the field.

use anyhow::{bail, ensure};
use clap::{Args, ValueEnum};

use super::format::parse_vector;
use crate::proto::guide::Path;
use crate::proto::scene_object::Kind;
use crate::proto::{
    Box, Capsule, ConstantField, Corridor, ForceField, Guide, GuideLine, GuidePlane, GuidePoint,
    HalfSpace, Material, Quaternion, SceneObject, Sphere, Vector3, ViscousField,
};

/// Stiffness of a surface that does not say: hard for brakes, harmless for motors.
const DEFAULT_STIFFNESS_N_PER_M: f64 = 1000.0;

/// The kinds of objects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum KindName {
    HalfSpace,
    Sphere,
    Box,
    Capsule,
    Corridor,
    GuidePoint,
    GuideLine,
    GuidePlane,
    Constant,
    Viscous,
    ForceField,
}

/// Points with colons between.
#[derive(Clone, Debug, PartialEq)]
pub struct Points(Vec<Vector3>);

/// Numbers with commas between.
#[derive(Clone, Debug, PartialEq)]
pub struct Numbers(Vec<f64>);

/// Everything that can be said of an object.
#[derive(Clone, Debug, Default, Args)]
pub struct Fields {
    /// Any point of a half-space or guide, metres in W
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    pub point: Option<Vector3>,
    /// Direction out of a half-space, or across a guide-plane
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    pub normal: Option<Vector3>,
    /// Direction of a guide-line
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    direction: Option<Vector3>,
    /// Centre of a sphere or box, metres in W
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    centre: Option<Vector3>,
    /// Half of the edges of a box, metres
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    half_extents: Option<Vector3>,
    /// Quaternion that turns a box into W
    #[arg(long, value_name = "X,Y,Z,W", value_parser = parse_quaternion, allow_hyphen_values = true)]
    orientation: Option<Quaternion>,
    /// Both ends of a capsule, metres in W
    #[arg(long, value_name = "X,Y,Z:X,Y,Z", value_parser = parse_points, allow_hyphen_values = true)]
    ends: Option<Points>,
    /// The points of a corridor, 2 to 64, metres in W
    #[arg(long, value_name = "X,Y,Z:...", value_parser = parse_points, allow_hyphen_values = true)]
    points: Option<Points>,
    /// Metres; 0 of a corridor or guide: no room, of a force-field: everywhere
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    radius: Option<f64>,
    /// Force of a constant or force-field, newtons in W
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    force: Option<Vector3>,
    /// Moment of a force-field, newton metres in W
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    moment: Option<Vector3>,
    /// Where a force-field has the stated force, metres in W
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    origin: Option<Vector3>,
    /// N/m (1000 if a new surface does not say); of a force-field also 3 numbers (diagonal) or 9
    #[arg(long, value_name = "N/m", value_parser = parse_numbers, allow_hyphen_values = true)]
    pub stiffness: Option<Numbers>,
    /// N s/m; of a force-field also 3 numbers (diagonal) or 9 (row by row)
    #[arg(long, value_name = "N s/m", value_parser = parse_numbers, allow_hyphen_values = true)]
    pub damping: Option<Numbers>,
    /// Coulomb coefficient while the tool slips, and before it if nothing else is said
    #[arg(long, value_name = "MU", allow_negative_numbers = true)]
    pub friction: Option<f64>,
    /// Coulomb coefficient that has to be overcome first
    #[arg(long, value_name = "MU", allow_negative_numbers = true)]
    static_friction: Option<f64>,
    /// Velocity of the surface itself, m/s in W: a conveyor
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    surface_velocity: Option<Vector3>,
    /// A sheet or shell, felt from the side on which the tool is
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true")]
    pub hollow: Option<bool>,
}

impl KindName {
    /// The kind with nothing said of it.
    fn empty(self) -> Kind {
        let guide = |path| Kind::Guide(Guide { radius_m: 0.0, path: Some(path) });
        match self {
            Self::HalfSpace => Kind::HalfSpace(HalfSpace::default()),
            Self::Sphere => Kind::Sphere(Sphere::default()),
            Self::Box => Kind::Box(Box::default()),
            Self::Capsule => Kind::Capsule(Capsule::default()),
            Self::Corridor => Kind::Corridor(Corridor::default()),
            Self::GuidePoint => guide(Path::Point(GuidePoint::default())),
            Self::GuideLine => guide(Path::Line(GuideLine::default())),
            Self::GuidePlane => guide(Path::Plane(GuidePlane::default())),
            Self::Constant => Kind::Constant(ConstantField::default()),
            Self::Viscous => Kind::Viscous(ViscousField::default()),
            Self::ForceField => Kind::ForceField(ForceField::default()),
        }
    }

    /// The kind of an object.
    pub fn of(kind: &Kind) -> Option<Self> {
        Some(match kind {
            Kind::HalfSpace(_) => Self::HalfSpace,
            Kind::Sphere(_) => Self::Sphere,
            Kind::Box(_) => Self::Box,
            Kind::Capsule(_) => Self::Capsule,
            Kind::Corridor(_) => Self::Corridor,
            Kind::Guide(guide) => match guide.path.as_ref()? {
                Path::Point(_) => Self::GuidePoint,
                Path::Line(_) => Self::GuideLine,
                Path::Plane(_) => Self::GuidePlane,
            },
            Kind::Constant(_) => Self::Constant,
            Kind::Viscous(_) => Self::Viscous,
            Kind::ForceField(_) => Self::ForceField,
        })
    }

    /// As it is written on the command line.
    pub fn word(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }
}

impl Fields {
    /// A new object of this kind, without a name.
    pub fn new_object(self, kind: KindName) -> anyhow::Result<SceneObject> {
        let field = matches!(kind, KindName::Constant | KindName::Viscous | KindName::ForceField);
        let stiffness_n_per_m = DEFAULT_STIFFNESS_N_PER_M;
        let material = Material { stiffness_n_per_m, ..Material::default() };
        let mut object = SceneObject {
            kind: Some(kind.empty()),
            material: (!field).then_some(material),
            ..SceneObject::default()
        };
        self.apply(&mut object)?;
        Ok(object)
    }

    /// Changes what is given. What does not fit the object is refused.
    pub fn apply(mut self, object: &mut SceneObject) -> anyhow::Result<()> {
        let Some(kind) = &mut object.kind else { bail!("{} is of an unknown kind", object.name) };
        let word = KindName::of(kind).map_or_else(|| "guide".into(), KindName::word);
        self.apply_to_kind(kind)?;
        if let Some(material) = &mut object.material {
            self.apply_to_material(material)?;
        }
        put(&mut object.hollow, &mut self.hollow);
        match self.first_left() {
            Some(flag) => bail!("--{flag} does not fit a {word}"),
            None => Ok(()),
        }
    }

    fn apply_to_kind(&mut self, kind: &mut Kind) -> anyhow::Result<()> {
        match kind {
            Kind::HalfSpace(wall) => {
                put_some(&mut wall.point_m, &mut self.point);
                put_some(&mut wall.normal, &mut self.normal);
            }
            Kind::Sphere(ball) => {
                put_some(&mut ball.centre_m, &mut self.centre);
                put(&mut ball.radius_m, &mut self.radius);
            }
            Kind::Box(block) => {
                put_some(&mut block.centre_m, &mut self.centre);
                put_some(&mut block.half_extents_m, &mut self.half_extents);
                put_some(&mut block.orientation, &mut self.orientation);
            }
            Kind::Capsule(capsule) => {
                put(&mut capsule.ends_m, &mut self.ends.take().map(|points| points.0));
                put(&mut capsule.radius_m, &mut self.radius);
            }
            Kind::Corridor(corridor) => {
                put(&mut corridor.points_m, &mut self.points.take().map(|points| points.0));
                put(&mut corridor.radius_m, &mut self.radius);
            }
            Kind::Guide(guide) => {
                put(&mut guide.radius_m, &mut self.radius);
                self.apply_to_path(guide.path.as_mut());
            }
            Kind::Constant(field) => put_some(&mut field.force_n, &mut self.force),
            Kind::Viscous(field) => {
                put(&mut field.damping_ns_per_m, &mut one("damping", &mut self.damping)?);
            }
            Kind::ForceField(field) => {
                put_some(&mut field.origin_m, &mut self.origin);
                let wrench = field.wrench.get_or_insert_default();
                put_some(&mut wrench.force_n, &mut self.force);
                put_some(&mut wrench.moment_nm, &mut self.moment);
                put(&mut field.stiffness_n_per_m, &mut matrix(&mut self.stiffness));
                put(&mut field.damping_ns_per_m, &mut matrix(&mut self.damping));
                put(&mut field.radius_m, &mut self.radius);
            }
        }
        Ok(())
    }

    fn apply_to_path(&mut self, path: Option<&mut Path>) {
        match path {
            Some(Path::Point(point)) => put_some(&mut point.point_m, &mut self.point),
            Some(Path::Line(line)) => {
                put_some(&mut line.point_m, &mut self.point);
                put_some(&mut line.direction, &mut self.direction);
            }
            Some(Path::Plane(plane)) => {
                put_some(&mut plane.point_m, &mut self.point);
                put_some(&mut plane.normal, &mut self.normal);
            }
            None => {}
        }
    }

    fn apply_to_material(&mut self, material: &mut Material) -> anyhow::Result<()> {
        put(&mut material.stiffness_n_per_m, &mut one("stiffness", &mut self.stiffness)?);
        put(&mut material.damping_ns_per_m, &mut one("damping", &mut self.damping)?);
        put(&mut material.kinetic_friction, &mut self.friction);
        put_some(&mut material.static_friction, &mut self.static_friction);
        put_some(&mut material.surface_velocity_m_per_s, &mut self.surface_velocity);
        Ok(())
    }

    /// A flag that was given and not taken.
    fn first_left(&self) -> Option<&'static str> {
        let left = [
            ("point", self.point.is_some()),
            ("normal", self.normal.is_some()),
            ("direction", self.direction.is_some()),
            ("centre", self.centre.is_some()),
            ("half-extents", self.half_extents.is_some()),
            ("orientation", self.orientation.is_some()),
            ("ends", self.ends.is_some()),
            ("points", self.points.is_some()),
            ("radius", self.radius.is_some()),
            ("force", self.force.is_some()),
            ("moment", self.moment.is_some()),
            ("origin", self.origin.is_some()),
            ("stiffness", self.stiffness.is_some()),
            ("damping", self.damping.is_some()),
            ("friction", self.friction.is_some()),
            ("static-friction", self.static_friction.is_some()),
            ("surface-velocity", self.surface_velocity.is_some()),
        ];
        left.into_iter().find_map(|(flag, given)| given.then_some(flag))
    }
}

fn put<T>(target: &mut T, given: &mut Option<T>) {
    if let Some(given) = given.take() {
        *target = given;
    }
}

fn put_some<T>(target: &mut Option<T>, given: &mut Option<T>) {
    *target = given.take().or(target.take());
}

fn one(flag: &str, given: &mut Option<Numbers>) -> anyhow::Result<Option<f64>> {
    let Some(Numbers(numbers)) = given.take() else { return Ok(None) };
    ensure!(numbers.len() == 1, "--{flag} has {} numbers: here it takes one", numbers.len());
    Ok(Some(numbers[0]))
}

/// One number is the same in every direction.
fn matrix(given: &mut Option<Numbers>) -> Option<Vec<f64>> {
    given.take().map(|Numbers(numbers)| match numbers.as_slice() {
        [same] => vec![*same; 3],
        _ => numbers,
    })
}

/// Numbers as people write them: `100` or `100,50,0`.
pub fn parse_numbers(text: &str) -> Result<Numbers, String> {
    let numbers: Result<_, _> = text.split(',').map(|part| part.trim().parse()).collect();
    numbers.map(Numbers).map_err(|_| "must be numbers with commas between, as in 100,50,0".into())
}

fn parse_quaternion(text: &str) -> Result<Quaternion, String> {
    match parse_numbers(text) {
        Ok(Numbers(numbers)) if numbers.len() == 4 => {
            let [x, y, z, w] = [0, 1, 2, 3].map(|i| numbers[i]);
            Ok(Quaternion { x, y, z, w })
        }
        _ => Err("must be four numbers with commas between, as in 0,0,0,1".into()),
    }
}

fn parse_points(text: &str) -> Result<Points, String> {
    let points: Result<_, _> = text.split(':').map(parse_vector).collect();
    points.map(Points).map_err(|_| "must be points with colons between, as in 0,0,0:0.1,0,0".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flag_that_does_not_fit_is_refused_by_its_name() {
        let force = Some(Vector3::default());
        let radius = Some(0.1);
        for (kind, fields, flag) in [
            (KindName::Sphere, Fields { force, ..Fields::default() }, "--force"),
            (KindName::HalfSpace, Fields { radius, ..Fields::default() }, "--radius"),
            (KindName::Viscous, Fields { friction: radius, ..Fields::default() }, "--friction"),
            (KindName::GuideLine, Fields { normal: force, ..Fields::default() }, "--normal"),
        ] {
            let refused = fields.new_object(kind).unwrap_err().to_string();
            assert_eq!(refused, format!("{flag} does not fit a {}", kind.word()));
        }
    }

    #[test]
    fn one_stiffness_of_a_field_is_the_same_all_round_and_a_surface_has_only_one() {
        let stiff = |text| Some(parse_numbers(text).unwrap());
        let fields =
            Fields { stiffness: stiff("200"), damping: stiff("1,2,3"), ..Fields::default() };
        let object = fields.clone().new_object(KindName::ForceField).unwrap();
        let Some(Kind::ForceField(field)) = object.kind else { panic!() };
        assert_eq!(field.stiffness_n_per_m, [200.0; 3]);
        assert_eq!(field.damping_ns_per_m, [1.0, 2.0, 3.0]);
        let refused = fields.new_object(KindName::Sphere).unwrap_err().to_string();
        assert_eq!(refused, "--damping has 3 numbers: here it takes one");
    }

    #[test]
    fn points_and_quaternions_are_read_as_they_are_written() {
        let Points(points) = parse_points("0,1,2:-3,4,5").unwrap();
        assert_eq!((points.len(), points[1].x), (2, -3.0));
        for wrong in ["", "1,2", "1,2,3:", "1,2,3;4,5,6"] {
            assert!(parse_points(wrong).is_err(), "{wrong}");
        }
        assert_eq!(parse_quaternion("0,0,1,0").unwrap().z, 1.0);
        assert!(parse_quaternion("0,0,1").is_err());
    }
}

//! What lies around the tool: the nearest surface, and whether the handle can get there.
//!
//! Everything in W, metres. The reach is looked at from a grid of places that the linkage
//! holds, each with the tool as it hangs there; only what is further from all of them than
//! the grid is coarse counts as out of reach. Fields are everywhere and not looked at.

use std::f64::consts::TAU;

use nalgebra::Vector3;

use crate::config::{DeviceDefinition, Scene, Settings};
use crate::environment::{Element, Surface};
use crate::notation::PlaneVector;

/// Places looked at around the circle, and along the radius.
const AROUND: usize = 72;
const ALONG: usize = 12;

/// The surface that is nearest to the tool.
#[derive(Clone, Debug, PartialEq)]
pub struct NearestSurface {
    /// Its name in the scene.
    pub name: String,
    /// From the tool to it; negative inside a solid.
    pub distance_m: f64,
}

/// What is around the tool.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surroundings {
    /// Objects of the scene.
    pub objects: usize,
    /// Fields among them: they act everywhere.
    pub fields: usize,
    /// The nearest surface.
    pub nearest: Option<NearestSurface>,
    /// There are surfaces, and the handle can get to none of them.
    pub out_of_reach: bool,
}

/// The surroundings of a tool at `p_WT_m`.
pub fn surroundings(
    device: &DeviceDefinition,
    settings: &Settings,
    scene: &Scene,
    p_WT_m: &Vector3<f64>,
) -> Surroundings {
    let radius_m = settings.tool.radius_m;
    let surfaces: Vec<(String, Surface)> = surfaces(scene);
    let objects = scene.list().count();
    let nearest = surfaces
        .iter()
        .map(|(name, surface)| NearestSurface {
            name: name.clone(),
            distance_m: distance_m(surface, p_WT_m) - radius_m,
        })
        .min_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
    let (places, coarse_m) = places(device, settings);
    let in_reach = |(_, surface): &(String, Surface)| {
        places.iter().any(|place| distance_m(surface, place) - radius_m <= coarse_m)
    };
    let out_of_reach = !surfaces.is_empty() && !surfaces.iter().any(in_reach);
    Surroundings { objects, fields: objects - surfaces.len(), nearest, out_of_reach }
}

fn surfaces(scene: &Scene) -> Vec<(String, Surface)> {
    let items = scene.items();
    let placed = scene.placed().into_iter().zip(&items);
    placed
        .filter_map(|((_, object), item)| match &item.element {
            Element::Surface(surface) => Some((object.id().to_string(), *surface)),
            _ => None,
        })
        .collect()
}

/// To the surface: a sheet is as near from both of its sides.
fn distance_m(surface: &Surface, p_W_m: &Vector3<f64>) -> f64 {
    let distance_m = surface.shape.nearest(p_W_m).distance_m;
    if surface.hollow { distance_m.abs() } else { distance_m }
}

/// Where the tool can be, and how far apart these places are.
fn places(device: &DeviceDefinition, settings: &Settings) -> (Vec<Vector3<f64>>, f64) {
    let (nearest_m, furthest_m) = device.mechanism.reach_m();
    let (mount, offset_B_m) = (&settings.mount, &settings.tool.offset_B_m);
    let mut places = Vec::new();
    for ring in 0..=ALONG {
        let share = ring as f64 / ALONG as f64;
        let range_m = nearest_m + share * (furthest_m - nearest_m);
        for step in 0..AROUND {
            let (sin, cos) = (TAU * step as f64 / AROUND as f64).sin_cos();
            let p_BH = PlaneVector::new(range_m * cos, range_m * sin, 0.0);
            if device.mechanism.posture_at(&p_BH).is_ok() {
                let at_B_m = Vector3::new(p_BH.x, p_BH.y, 0.0) + offset_B_m;
                places.push(mount.p_WB_m + mount.q_WB * at_B_m);
            }
        }
    }
    let coarse_m = (furthest_m * TAU / AROUND as f64).max((furthest_m - nearest_m) / ALONG as f64);
    (places, coarse_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Id, ObjectKind, SceneObject};
    use crate::environment::Material;

    fn sphere(name: &str, centre_m: Vector3<f64>) -> SceneObject {
        let kind = ObjectKind::Sphere { centre_m, radius_m: 0.02 };
        let id = Id::parse("id", name).unwrap();
        SceneObject::new(id, kind, Some(Material::default()), false).unwrap()
    }

    #[test]
    fn the_nearest_is_named_and_what_no_handle_gets_to_is_out_of_reach() {
        let device = DeviceDefinition::load("cho-2005").unwrap();
        let settings = Settings::of(&device);
        let at_m = Vector3::new(0.3, 0.1, 0.0);
        let mut scene = Scene::default();
        assert_eq!(surroundings(&device, &settings, &scene, &at_m), Surroundings::default());
        scene.create(sphere("moon", Vector3::new(5.0, 0.0, 0.0)), None).unwrap();
        let far = surroundings(&device, &settings, &scene, &at_m);
        assert!(far.out_of_reach && far.nearest.unwrap().name == "moon");
        // Above the plane, too far for a tool that is a point.
        scene.create(sphere("lamp", at_m + Vector3::z() * 0.2), None).unwrap();
        let above = surroundings(&device, &settings, &scene, &at_m);
        assert!(above.out_of_reach, "{above:?}");
        let nearest = above.nearest.unwrap();
        assert_eq!(nearest.name, "lamp");
        assert!((nearest.distance_m - 0.18).abs() < 1e-12);
        scene.create(sphere("ball", at_m + Vector3::x() * 0.03), None).unwrap();
        let near = surroundings(&device, &settings, &scene, &at_m);
        assert!(!near.out_of_reach && near.objects == 3);
        assert!((near.nearest.unwrap().distance_m - 0.01).abs() < 1e-12);
        // A long tool brings the lamp within reach.
        let mut long = settings;
        long.tool.offset_B_m = Vector3::z() * 0.19;
        scene.delete("ball", None).unwrap();
        assert!(!surroundings(&device, &long, &scene, &at_m).out_of_reach);
    }
}

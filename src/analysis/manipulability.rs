//! What the actuators of a posture can do: reference forces, singular values, regions, reach.
//!
//! In the plane B at the handle; angles counter-clockwise from x of B, radians in (-pi, pi]. A
//! column of `R` is the handle wrench per unit torque of an actuator; weighted by the largest
//! torques its singular values are newtons: the semi-axes of the ellipse of forces whose
//! torques, each as a share of its largest, have a norm of 1 (Yoshikawa 1985). On a device
//! with three freedoms moments are taken on the device's length, as everywhere.
//!
//! Regions follow Cho 2005, section 3.1, for one direction of motion. They change only at the
//! available reference forces and at right angles to the motion, so the sectors are exact; so
//! is the largest force in a direction, where the zonotope of the torques in their bounds ends
//! (derived here). A pure function of the posture; for people and services, not for a tick.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use crate::actuation::{Capability, Region, ShaftMotion, classify};
use crate::notation::{ActuatorVector, MAX_ACTUATORS, PlaneVector};

/// Sectors narrower than this are the same boundary twice.
const NARROW_RAD: f64 = 1e-9;

/// The account of one posture.
#[derive(Clone, Debug, PartialEq)]
pub struct Manipulability {
    /// Of `R`, the largest first, one per freedom.
    pub singular_values: Vec<f64>,
    /// Of `R` weighted by the largest torques, newtons.
    pub weighted_singular_values_N: Vec<f64>,
    /// Largest by smallest of the weighted ones; infinite at a singularity.
    pub condition: f64,
    /// Where which directions of force are displayable; empty without a motion.
    pub sectors: Vec<Sector>,
    /// Largest forces, in equal steps from x of B.
    pub largest: Vec<LargestForce>,
}

/// Directions of force of one region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sector {
    /// Where it begins.
    pub from_rad: f64,
    /// Where it ends, counter-clockwise; larger than `from_rad`, perhaps beyond pi.
    pub to_rad: f64,
    /// Its region.
    pub region: Region,
}

/// How strong a force can be in one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LargestForce {
    /// The direction.
    pub angle_rad: f64,
    /// In exactly this direction, with brakes against their rates; without a motion as
    /// `range_N`.
    pub now_N: f64,
    /// With every actuator both ways: whatever moves.
    pub range_N: f64,
}

/// The shafts' motion while the handle moves along `motion_rad`.
pub fn shaft_motion(
    reference: &crate::notation::ReferenceMatrix,
    motion_rad: Option<f64>,
) -> [ShaftMotion; MAX_ACTUATORS] {
    let Some(motion_rad) = motion_rad else { return [ShaftMotion::Rest; MAX_ACTUATORS] };
    let rates = reference.tr_mul(&direction(motion_rad));
    // A shaft that the motion does not turn may be braked both ways.
    let least = 1e-9 * rates.amax();
    std::array::from_fn(|i| ShaftMotion::of(rates[i], least))
}

/// The account of a posture whose actuators can do `capability` while the handle moves along
/// `motion_rad`, with forces in so many directions.
pub fn manipulability(
    capability: &Capability,
    max_torque_Nm: &ActuatorVector,
    motion_rad: Option<f64>,
    directions: usize,
) -> Manipulability {
    let weighted_singular_values_N = singular_values(capability, max_torque_Nm);
    let condition = match weighted_singular_values_N.as_slice() {
        [largest, .., least] if *least > 1e-12 * largest => largest / least,
        _ => f64::INFINITY,
    };
    let largest = |step: usize| {
        let angle_rad = wrapped(TAU * step as f64 / directions as f64);
        let range_N = capability.range_N(&direction(angle_rad));
        LargestForce { angle_rad, now_N: largest_N(capability, angle_rad), range_N }
    };
    Manipulability {
        singular_values: singular_values(capability, &ActuatorVector::repeat(1.0)),
        weighted_singular_values_N,
        condition,
        sectors: motion_rad.map_or_else(Vec::new, |motion_rad| sectors(capability, motion_rad)),
        largest: (0..directions).map(largest).collect(),
    }
}

/// Square roots of the eigenvalues of `R W (R W)^T`, the largest first.
fn singular_values(capability: &Capability, weight: &ActuatorVector) -> Vec<f64> {
    let mut gram = nalgebra::Matrix3::zeros();
    for ray in rays(capability).zip(weight.iter()).map(|(ray, weight)| ray * *weight) {
        gram += ray * ray.transpose();
    }
    let mut values: Vec<f64> = match capability.freedoms {
        2 => gram
            .fixed_view::<2, 2>(0, 0)
            .into_owned()
            .symmetric_eigenvalues()
            .iter()
            .copied()
            .collect(),
        _ => gram.symmetric_eigenvalues().iter().copied().collect(),
    };
    values.sort_by(|a, b| b.total_cmp(a));
    values.into_iter().map(|value| value.max(0.0).sqrt()).collect()
}

/// The columns of `R` as forces: moments on the device's length, zero where they do not count.
fn rays(capability: &Capability) -> impl Iterator<Item = PlaneVector> + '_ {
    (0..capability.actuators.min(MAX_ACTUATORS)).map(|i| {
        let ray = capability.reference.column(i);
        let moment =
            if capability.freedoms == 2 { 0.0 } else { ray.z / capability.moment_length_m };
        PlaneVector::new(ray.x, ray.y, moment)
    })
}

/// Largest multiple of a direction that torques within the bounds give, and nothing beside it.
///
/// The wrenches of all torques within their bounds are a zonotope around that of the bounds'
/// middles, and every normal n bounds it by `h(n) = n . c + sum |r_i . n| half_i`; among the
/// facets' normals is the one that bounds it first.
fn largest_N(capability: &Capability, angle_rad: f64) -> f64 {
    let along = direction(angle_rad);
    let bounds = &capability.bounds;
    let rays: Vec<PlaneVector> = rays(capability).collect();
    let middle: PlaneVector = (rays.iter().enumerate())
        .map(|(i, ray)| ray * (0.5 * (bounds.lower_Nm[i] + bounds.upper_Nm[i])))
        .sum();
    let halves: Vec<PlaneVector> = (rays.iter().enumerate())
        .map(|(i, ray)| ray * (0.5 * (bounds.upper_Nm[i] - bounds.lower_Nm[i])))
        .collect();
    let mut most_N = f64::INFINITY;
    for normal in normals(capability.freedoms, &halves) {
        let Some(normal) = normal.try_normalize(1e-12) else { continue };
        // Both sides of a facet pair; only the one that the direction leaves by bounds it.
        let slope = along.dot(&normal);
        let normal = if slope < 0.0 { -normal } else { normal };
        if slope.abs() > 1e-9 {
            let support_N = normal.dot(&middle)
                + halves.iter().map(|half| half.dot(&normal).abs()).sum::<f64>();
            most_N = most_N.min(support_N.max(0.0) / slope.abs());
        }
    }
    if most_N.is_finite() { most_N } else { 0.0 }
}

/// Normals among which are those of all facets, also where the zonotope is flat.
fn normals(freedoms: usize, rays: &[PlaneVector]) -> Vec<PlaneVector> {
    let mut normals: Vec<PlaneVector> = rays.to_vec();
    for (i, ray) in rays.iter().enumerate() {
        if freedoms == 2 {
            normals.push(PlaneVector::new(-ray.y, ray.x, 0.0));
        } else {
            normals.extend(rays[..i].iter().map(|other| ray.cross(other)));
            let axes = [PlaneVector::x(), PlaneVector::y(), PlaneVector::z()];
            normals.extend(axes.iter().map(|axis| ray.cross(axis)));
        }
    }
    normals
}

/// The regions around the circle, neighbours of the same region joined.
fn sectors(capability: &Capability, motion_rad: f64) -> Vec<Sector> {
    let velocity = direction(motion_rad);
    let mut edges_rad = vec![wrapped(motion_rad + FRAC_PI_2), wrapped(motion_rad - FRAC_PI_2)];
    for ray in rays(capability).filter(|ray| ray.xy().norm() > 0.0) {
        let angle_rad = ray.y.atan2(ray.x);
        edges_rad.extend([angle_rad, wrapped(angle_rad + PI)]);
    }
    edges_rad.sort_by(f64::total_cmp);
    edges_rad.dedup_by(|a, b| *a - *b < NARROW_RAD);
    let mut sectors: Vec<Sector> = Vec::new();
    for (i, &from_rad) in edges_rad.iter().enumerate() {
        let to_rad = edges_rad.get(i + 1).copied().unwrap_or(edges_rad[0] + TAU);
        let within = direction(0.5 * (from_rad + to_rad));
        let Some(found) = classify(capability, &within, &velocity) else { continue };
        match sectors.last_mut() {
            Some(last) if last.region == found.region => last.to_rad = to_rad,
            _ if to_rad - from_rad > NARROW_RAD => {
                sectors.push(Sector { from_rad, to_rad, region: found.region });
            }
            _ => {}
        }
    }
    join_ends(&mut sectors);
    sectors
}

/// The last sector goes on in the first one where both are of one region.
fn join_ends(sectors: &mut Vec<Sector>) {
    if let [first, .., last] = sectors.as_mut_slice()
        && first.region == last.region
    {
        last.to_rad = first.to_rad + TAU;
        sectors.remove(0);
    }
}

fn direction(angle_rad: f64) -> PlaneVector {
    let (sin, cos) = angle_rad.sin_cos();
    PlaneVector::new(cos, sin, 0.0)
}

fn wrapped(angle_rad: f64) -> f64 {
    let turned = (angle_rad + PI).rem_euclid(TAU) - PI;
    if turned == -PI { PI } else { turned }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actuation::optimal;
    use crate::config::DeviceDefinition;

    /// Devices at a few places each, moving in a few directions and at rest.
    fn capabilities() -> Vec<(Capability, ActuatorVector, Option<f64>)> {
        let mut all = Vec::new();
        for name in ["cho-2005", "cho-2005-crossed", "two-link"] {
            let device = DeviceDefinition::load(name).unwrap();
            for (x, y) in [(0.3, 0.1), (0.25, -0.15), (0.285, 0.3)] {
                let posture = device.mechanism.posture_at(&PlaneVector::new(x, y, 0.0)).unwrap();
                for motion_rad in [None, Some(0.3), Some(-2.0), Some(1.7)] {
                    let motion = shaft_motion(&posture.reference, motion_rad);
                    let capability = device.capability(&posture, &motion);
                    all.push((capability, device.actuators.max_torque_Nm, motion_rad));
                }
            }
        }
        all
    }

    #[test]
    fn singular_values_are_the_extremes_over_all_directions() {
        for (capability, max_torque_Nm, motion_rad) in capabilities() {
            let found = manipulability(&capability, &max_torque_Nm, motion_rad, 4);
            for (values, weight) in [
                (&found.singular_values, ActuatorVector::repeat(1.0)),
                (&found.weighted_singular_values_N, max_torque_Nm),
            ] {
                let stretch = |step: i32| {
                    let along = direction(f64::from(step) * PI / 20_000.0);
                    let parts = rays(&capability).zip(weight.iter());
                    parts.map(|(ray, w)| (ray.dot(&along) * w).powi(2)).sum::<f64>().sqrt()
                };
                let (least, most) = (0..20_000)
                    .map(stretch)
                    .fold((f64::INFINITY, 0.0f64), |(least, most), s| (least.min(s), most.max(s)));
                assert!((values[0] / most - 1.0).abs() < 1e-6, "{values:?} {most}");
                assert!((values[1] / least - 1.0).abs() < 1e-6, "{values:?} {least}");
            }
            let [most, least] = found.weighted_singular_values_N[..] else { panic!("two") };
            assert_eq!(found.condition, most / least);
        }
    }

    /// Every vertex of the box of torques; the hull's edges are among the lines between two.
    fn largest_by_vertices_N(capability: &Capability, along: &PlaneVector) -> f64 {
        let n = capability.actuators;
        let bounds = &capability.bounds;
        let vertices: Vec<PlaneVector> = (0..1 << n)
            .map(|mask: usize| {
                (0..n)
                    .map(|i| {
                        let upper = mask & (1 << i) != 0;
                        let torque = if upper { bounds.upper_Nm[i] } else { bounds.lower_Nm[i] };
                        capability.reference.column(i) * torque
                    })
                    .sum()
            })
            .collect();
        let mut most_N = 0.0f64;
        for (k, a) in vertices.iter().enumerate() {
            for b in &vertices[k..] {
                // a + s (b - a) = t along
                let edge = b - a;
                let cross = along.x * edge.y - along.y * edge.x;
                if cross.abs() < 1e-12 {
                    for end in [a, b] {
                        if (along.x * end.y - along.y * end.x).abs() < 1e-9 {
                            most_N = most_N.max(end.xy().dot(&along.xy()));
                        }
                    }
                    continue;
                }
                let t = (a.x * edge.y - a.y * edge.x) / cross;
                let s = (a.x * along.y - a.y * along.x) / cross;
                if (-1e-9..=1.0 + 1e-9).contains(&s) {
                    most_N = most_N.max(t);
                }
            }
        }
        most_N
    }

    #[test]
    fn the_largest_force_is_where_the_hull_of_all_torques_ends() {
        for (capability, max_torque_Nm, motion_rad) in capabilities() {
            for LargestForce { angle_rad, now_N, range_N } in
                manipulability(&capability, &max_torque_Nm, motion_rad, 36).largest
            {
                let along = direction(angle_rad);
                let expected_N = largest_by_vertices_N(&capability, &along);
                assert!(
                    (now_N - expected_N).abs() < 1e-6 * (1.0 + expected_N),
                    "{now_N} {expected_N}"
                );
                assert!(now_N <= range_N * (1.0 + 1e-9), "{now_N} {range_N}");
                if motion_rad.is_none() {
                    assert!((now_N - range_N).abs() < 1e-6 * range_N);
                }
                // The allocator gives all of it, and nothing more.
                if now_N > 1e-3 {
                    let given = optimal(&capability, &(along * (0.999 * now_N)));
                    assert!((given.wrench - along * (0.999 * now_N)).norm() < 1e-6 * now_N);
                }
                let beyond = along * (1.01 * now_N + 0.1);
                let given = optimal(&capability, &beyond);
                // Just beside a ray the nearest force is near.
                assert!((given.wrench - beyond).norm() > 1e-6, "{given:?}");
            }
        }
    }

    #[test]
    fn the_sectors_cover_the_circle_and_say_what_each_direction_is() {
        for (capability, max_torque_Nm, motion_rad) in capabilities() {
            let found = manipulability(&capability, &max_torque_Nm, motion_rad, 1).sectors;
            let Some(motion_rad) = motion_rad else {
                assert!(found.is_empty());
                continue;
            };
            let total_rad: f64 = found.iter().map(|sector| sector.to_rad - sector.from_rad).sum();
            assert!((total_rad - TAU).abs() < 1e-9, "{found:?}");
            for (one, next) in found.iter().zip(found.iter().cycle().skip(1)) {
                assert!((wrapped(one.to_rad - next.from_rad)).abs() < 1e-9);
                assert_ne!(one.region, next.region, "{found:?}");
            }
            for step in 0..720 {
                let angle_rad = wrapped(0.0037 + f64::from(step) * TAU / 720.0);
                let inside = |sector: &&Sector| {
                    (angle_rad - sector.from_rad).rem_euclid(TAU) < sector.to_rad - sector.from_rad
                };
                let sector = found.iter().find(inside).unwrap();
                let direct = classify(&capability, &direction(angle_rad), &direction(motion_rad));
                assert_eq!(direct.unwrap().region, sector.region, "{angle_rad}");
            }
        }
    }

    #[test]
    fn a_posture_without_actuators_or_at_a_singularity_has_no_forces_and_no_nan() {
        let (mut capability, max_torque_Nm, _) = capabilities()[0];
        capability.reference.row_mut(1).fill(0.0);
        let flat = manipulability(&capability, &max_torque_Nm, Some(0.0), 4);
        assert!(flat.condition.is_infinite());
        assert!(flat.largest[0].range_N > 1.0 && flat.largest[1].range_N < 1e-9);
        capability.reference.fill(0.0);
        let none = manipulability(&capability, &max_torque_Nm, Some(0.0), 4);
        assert!(none.largest.iter().all(|force| (force.now_N, force.range_N) == (0.0, 0.0)));
        assert!(none.sectors.iter().all(|sector| sector.region == Region::NotDisplayable));
    }
}

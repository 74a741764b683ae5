//! The paper's wall (Figures 11 and 13 to 15): place by place, and moment by moment.
//!
//! The wall stands at x = 0.3 m, its normal is -x, the hand goes along -y. The reference force
//! "responsible" at a place is the one that the coercive rule takes for a hand that presses and
//! pulls along: the nearest to the normal of those that slip, on the side that leads out.
//! The slides are those of `hapticd experiment wall-following` on the device's own lag, with
//! sensor, seed 1.

use std::f64::consts::PI;

use super::{ChoError, DEVICES, correlation};
use crate::actuation::Strategy;
use crate::analysis::design::cones::friction_cone;
use crate::analysis::wall_following::{Experiment, Figures, Moment, run_with};
use crate::config::DeviceDefinition;
use crate::notation::{PlaneVector, ReferenceMatrix};

/// Places P1 to P4 of Figure 15 along the wall: y. The paper marks them in a picture only; one on
/// the stretch of R2+, two on that of R1+, one on that of R4+.
pub const PLACES_M: [f64; 4] = [0.32, 0.20, 0.10, -0.05];

/// Section 8.2.
pub(super) const GAMMA_MAX_DEG: f64 = 65.8;
/// Section 8.2: |F_d| at t = 2.1 s.
pub(super) const DESIRED_N: f64 = 20_000.0;
/// Section 8.1.
const STIFFNESS_N_PER_M: f64 = 1e7;
/// Two reference forces nearer than this are closely positioned.
pub(super) const CLOSE_DEG: f64 = 20.0;

/// Laws that are watched.
const WATCHED: [Strategy; 5] = [
    Strategy::NearestReference,
    Strategy::CoerciveLiteral,
    Strategy::Coercive,
    Strategy::PredictedVelocity,
    Strategy::Sliding,
];

/// A stretch of the wall with one responsible reference force.
#[derive(Clone, Debug, PartialEq)]
pub struct Stretch {
    /// Whose, with its sign; empty where there is none.
    pub ray: String,
    /// From and to, y.
    pub y_m: [f64; 2],
    /// Its angle to the normal at both ends.
    pub gamma_deg: [f64; 2],
}

/// A device at a place of the wall with a hand.
#[derive(Clone, Debug)]
pub struct Snapshot {
    /// Responsible reference force.
    pub ray: String,
    /// Its angle to the normal; `None`: there is none.
    pub gamma_deg: Option<f64>,
    /// Width of the pseudo friction cone of the wall's force.
    pub cone_deg: f64,
    /// The hand pushes within it, by more than a degree: a hand that slides steadily along a wall
    /// lies on the edge of the cone.
    pub caught: bool,
    /// Angle between the lines of R3 and R4.
    pub r3_r4_deg: f64,
}

/// What the whole wall is for a device.
#[derive(Clone, Debug)]
pub struct AlongWall {
    /// Stretches from y = 0.35 to -0.15 m.
    pub stretches: Vec<Stretch>,
    /// Widest and mean pseudo friction cone, degrees.
    pub cone_deg: [f64; 2],
    /// Largest angle between the normal and the nearest of all eight reference forces.
    pub nearest_deg: f64,
    /// Share of the wall on which R3 and R4 are closely positioned: [`CLOSE_DEG`].
    pub close: f64,
    /// Least drag per newton of press, every millimetre; `None`: no brake holds.
    pub drag: Vec<Option<f64>>,
}

/// A slide that was watched.
#[derive(Clone, Debug)]
pub struct Slide {
    /// Under this law.
    pub law: Strategy,
    /// What came of it.
    pub figures: Figures,
    /// Largest angle between the normal and the reference force of the brake that leads while the
    /// handle moves, and where along the wall.
    pub gamma_max_deg: f64,
    /// y of that place.
    pub gamma_max_y_m: f64,
    /// Correlation of the hand's force along the wall with tan gamma while it slides.
    pub correlation: f64,
    /// Largest change of the brakes' force within 1 ms, where the leading brake changes and
    /// elsewhere, newtons.
    pub steps_N: [f64; 2],
    /// Leading brakes, centimetre by centimetre, without repetition.
    pub leaders: String,
    /// The wall's force that the deepest penetration means.
    pub desired_N: f64,
}

/// What this run finds of sections 7 and 8.
#[derive(Clone, Debug)]
pub struct Wall {
    /// Before and after the optimisation.
    pub along: [AlongWall; 2],
    /// Mean drag per newton of press where both devices have one: before, after.
    pub common_drag: [f64; 2],
    /// y where R1+ would be as far as the page allows off the normal.
    pub gamma_max_y_m: Option<f64>,
    /// Figure 11: paths of brakes 2 and 3 locked lead out of the wall.
    pub out: [bool; 2],
    /// Hands at [`PLACES_M`] on the optimised device under `sliding`, which holds the wall.
    pub hands_N: [PlaneVector; 4],
    /// Figure 15: before and after, at the four places.
    pub snapshots: [[Snapshot; 4]; 2],
    /// On the optimised device.
    pub slides: Vec<Slide>,
}

impl Wall {
    /// The slide under a law.
    pub fn slide(&self, law: Strategy) -> Option<&Slide> {
        self.slides.iter().find(|slide| slide.law == law)
    }
}

pub(super) fn measure() -> Result<Wall, ChoError> {
    let [before, after] = DEVICES.map(DeviceDefinition::load);
    let devices = [before?, after?];
    let along = [along_wall(&devices[0]), along_wall(&devices[1])];
    let both = along[0].drag.iter().zip(&along[1].drag).filter_map(|(a, b)| Some([(*a)?, (*b)?]));
    let both: Vec<[f64; 2]> = both.collect();
    let mean = |k: usize| both.iter().map(|pair| pair[k]).sum::<f64>() / both.len().max(1) as f64;
    let mut slides = Vec::new();
    let mut hands_N = [PlaneVector::zeros(); 4];
    for law in WATCHED {
        let experiment = Experiment { strategy: law, ..Experiment::default() };
        let mut moments = Vec::new();
        let figures = run_with(&experiment, None, |moment| moments.push(*moment))?;
        if law == Strategy::Sliding {
            hands_N = PLACES_M.map(|y| hand_at(&moments, y));
        }
        slides.push(watched(&devices[1], law, figures, &moments));
    }
    let snapshots = [0, 1].map(|k| {
        std::array::from_fn(|place| snapshot(&devices[k], PLACES_M[place], &hands_N[place]))
    });
    Ok(Wall {
        common_drag: [mean(0), mean(1)],
        gamma_max_y_m: r1_off(&devices[1]),
        out: paths_out(&devices[1]),
        along,
        hands_N,
        snapshots,
        slides,
    })
}

fn reference(device: &DeviceDefinition, y_m: f64) -> Option<ReferenceMatrix> {
    let place = PlaneVector::new(0.3, y_m, 0.0);
    Some(device.mechanism.posture_at(&place).ok()?.reference)
}

/// Drag per newton of press of every brake that slips along -y, and the one with the least.
fn responsible(R: &ReferenceMatrix) -> Option<(usize, bool, f64)> {
    let drag = |i: usize| {
        // q = -(r . t) / (r . n) with t = -y and n = -x.
        let q = -R[(1, i)] / R[(0, i)];
        (q > 0.0 && q < 30.0).then_some((i, R[(0, i)] < 0.0, q))
    };
    (0..4).filter_map(drag).min_by(|a, b| a.2.total_cmp(&b.2))
}

/// Angle between the normal and the nearest of all eight reference forces, whether a motion
/// leaves it or its brake would have to be locked.
fn nearest_of_all_deg(R: &ReferenceMatrix) -> f64 {
    let off = |i: usize| R[(1, i)].abs().atan2(R[(0, i)].abs()).to_degrees();
    (0..4).map(off).fold(180.0, f64::min)
}

fn name(found: Option<(usize, bool, f64)>) -> String {
    found.map_or_else(String::new, |(i, positive, _)| {
        format!("R{}{}", i + 1, if positive { '+' } else { '-' })
    })
}

fn r3_r4_deg(R: &ReferenceMatrix) -> f64 {
    let [a, b] = [2, 3].map(|i| R.column(i).xy());
    let apart = a.perp(&b).abs().atan2(a.dot(&b).abs());
    apart.to_degrees()
}

fn cone_deg(R: &ReferenceMatrix) -> f64 {
    friction_cone(R, &[0, 1, 2, 3], PI).map_or(f64::NAN, |cone| cone.width_rad.to_degrees())
}

fn along_wall(device: &DeviceDefinition) -> AlongWall {
    let places = (0..500).map(|k| 0.35 - 1e-3 * f64::from(k));
    let mut stretches: Vec<Stretch> = Vec::new();
    let (mut cones, mut close, mut drag, mut nearest_deg) = (Vec::new(), 0, Vec::new(), 0.0f64);
    for y_m in places {
        let Some(R) = reference(device, y_m) else { continue };
        let found = responsible(&R);
        let (ray, gamma) = (name(found), found.map_or(0.0, |(_, _, q)| q.atan().to_degrees()));
        match stretches.last_mut() {
            Some(last) if last.ray == ray => {
                (last.y_m[1], last.gamma_deg[1]) = (y_m, gamma);
            }
            _ => stretches.push(Stretch { ray, y_m: [y_m; 2], gamma_deg: [gamma; 2] }),
        }
        cones.push(cone_deg(&R));
        nearest_deg = nearest_deg.max(nearest_of_all_deg(&R));
        close += u32::from(r3_r4_deg(&R) < CLOSE_DEG);
        drag.push(found.map(|(_, _, q)| q));
    }
    let widest = cones.iter().copied().fold(0.0, f64::max);
    let mean = cones.iter().sum::<f64>() / cones.len().max(1) as f64;
    let close = f64::from(close) / cones.len().max(1) as f64;
    AlongWall { stretches, cone_deg: [widest, mean], nearest_deg, close, drag }
}

/// How far the handle goes on before R1+ is as far off the normal as the paper reports.
fn r1_off(device: &DeviceDefinition) -> Option<f64> {
    (0..4500).map(|k| 0.3 - 1e-4 * f64::from(k)).find(|y_m| {
        reference(device, *y_m).is_some_and(|R| {
            let off = R[(1, 0)].abs().atan2(-R[(0, 0)]);
            off.to_degrees() >= GAMMA_MAX_DEG
        })
    })
}

/// Figure 11: where R2+ is responsible, the paths that brake 2 and brake 3 leave to a hand that
/// presses into the wall and pulls along -y a little more than the drag of R2+.
fn paths_out(device: &DeviceDefinition) -> [bool; 2] {
    let Some(R) = reference(device, PLACES_M[0]) else { return [false; 2] };
    let pull = responsible(&R).map_or(1.0, |(_, _, q)| 1.2 * q);
    let hand = PlaneVector::new(1.0, -pull, 0.0);
    [1, 2].map(|brake| {
        let ray = R.column(brake);
        let path = PlaneVector::new(-ray.y, ray.x, 0.0);
        path.dot(&hand) * -path.x > 0.0
    })
}

/// Mean hand within a centimetre of a place.
fn hand_at(moments: &[Moment], y_m: f64) -> PlaneVector {
    let near = |moment: &&Moment| moment.sliding && (moment.p_BH.y - y_m).abs() < 0.01;
    let near: Vec<PlaneVector> =
        moments.iter().filter(near).map(|moment| moment.F_hand_BH_N).collect();
    near.iter().sum::<PlaneVector>() / near.len().max(1) as f64
}

/// Largest angle of the leading brake's reference force to the normal, and where.
fn leading_gamma(device: &DeviceDefinition, sliding: &[&Moment]) -> [f64; 2] {
    let mut most = [0.0, f64::NAN];
    for moment in sliding.iter().filter(|moment| moment.v_BH.y < -1e-3) {
        let posture = device.mechanism.posture_at(&moment.p_BH).ok();
        let Some((posture, leading)) = posture.zip(moment.leading) else { continue };
        let ray = posture.reference.column(leading);
        let gamma_deg = ray.y.abs().atan2(ray.x.abs()).to_degrees();
        if gamma_deg > most[0] {
            most = [gamma_deg, moment.p_BH.y];
        }
    }
    most
}

fn snapshot(device: &DeviceDefinition, y_m: f64, hand_N: &PlaneVector) -> Snapshot {
    let R = reference(device, y_m).unwrap_or_default();
    let found = responsible(&R);
    let cone = friction_cone(&R, &[0, 1, 2, 3], PI);
    Snapshot {
        ray: name(found),
        gamma_deg: found.map(|(_, _, q)| q.atan().to_degrees()),
        cone_deg: cone_deg(&R),
        caught: cone.is_some_and(|cone| {
            let hand_rad = hand_N.y.atan2(hand_N.x);
            [-1f64, 1.0].iter().all(|deg| cone.holds(hand_rad + deg.to_radians()))
        }),
        r3_r4_deg: r3_r4_deg(&R),
    }
}

fn watched(
    device: &DeviceDefinition,
    law: Strategy,
    figures: Figures,
    moments: &[Moment],
) -> Slide {
    let sliding: Vec<&Moment> = moments.iter().filter(|moment| moment.sliding).collect();
    let moves = |moment: &&&Moment| moment.v_BH.y < -1e-3;
    let pairs: Vec<[f64; 2]> = sliding
        .iter()
        .filter(moves)
        .filter_map(|moment| Some([-moment.F_hand_BH_N.y, moment.gamma_rad?.min(1.5).tan()]))
        .collect();
    let correlation = correlation(&pairs);
    let [gamma_max_deg, gamma_max_y_m] = leading_gamma(device, &sliding);
    Slide {
        law,
        figures,
        gamma_max_deg,
        gamma_max_y_m,
        correlation,
        steps_N: steps_N(&sliding),
        leaders: leaders(&sliding),
        desired_N: desired_N(&figures),
    }
}

/// The wall's force that the deepest penetration means.
pub(super) fn desired_N(figures: &Figures) -> f64 {
    STIFFNESS_N_PER_M * 1e-3 * figures.penetration_mm.max(0.0)
}

/// Largest change of the brakes' force in a tick of the slide, its first and last one too: where
/// the leading brake changes, and elsewhere.
fn steps_N(sliding: &[&Moment]) -> [f64; 2] {
    let mut most_N = [0.0f64; 2];
    for (k, pair) in sliding.windows(2).enumerate() {
        // The change of brakes may show a tick before or after the force does.
        let near = &sliding[k.saturating_sub(1)..(k + 3).min(sliding.len())];
        let changes = near.windows(2).any(|two| two[0].leading != two[1].leading);
        let step_N = (pair[1].F_BH_N - pair[0].F_BH_N).norm();
        let place = usize::from(!changes);
        most_N[place] = most_N[place].max(step_N);
    }
    most_N
}

/// The brake that leads most often in each centimetre, without repetition.
fn leaders(sliding: &[&Moment]) -> String {
    let mut found: Vec<usize> = Vec::new();
    let centimetre = |moment: &Moment| (100.0 * moment.p_BH.y).floor() as i64;
    for group in sliding.chunk_by(|a, b| centimetre(a) == centimetre(b)) {
        let count = |brake: usize| group.iter().filter(|m| m.leading == Some(brake)).count();
        let most = (0..4).max_by_key(|brake| count(*brake)).unwrap_or(0);
        if group.len() >= 20 && count(most) > 0 && found.last() != Some(&most) {
            found.push(most);
        }
    }
    found.iter().map(|brake| format!("R{}", brake + 1)).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_wall_of_the_paper_has_its_three_stretches() {
        let device = DeviceDefinition::load("cho-2005").unwrap();
        let found = along_wall(&device);
        let names: Vec<&str> = found.stretches.iter().map(|one| one.ray.as_str()).collect();
        assert_eq!(names, ["R2+", "R1+", "R4+"]);
        let [first, second, _] = &found.stretches[..] else { panic!("three") };
        assert!((first.y_m[1] - 0.30).abs() < 5e-3 && (second.y_m[1] - 0.046).abs() < 3e-3);
        assert!((first.gamma_deg[1] - 57.1).abs() < 0.3, "{first:?}");
        assert!((10.0..30.0).contains(&found.nearest_deg), "{}", found.nearest_deg);
        assert!((second.gamma_deg[1] - 50.9).abs() < 0.5, "{second:?}");
        let y_m = r1_off(&device).unwrap();
        assert!(y_m < second.y_m[1], "{y_m}");
        assert_eq!(paths_out(&device), [true, false]);
    }

    #[test]
    fn steps_at_changes_and_elsewhere_are_all_steps_of_the_slide() {
        let device = DeviceDefinition::load("cho-2005").unwrap();
        let experiment = Experiment { strategy: Strategy::Sliding, ..Experiment::default() };
        let mut moments = Vec::new();
        let figures = run_with(&experiment, None, |moment| moments.push(*moment)).unwrap();
        let slide = watched(&device, Strategy::Sliding, figures, &moments);
        let [at_changes_N, elsewhere_N] = slide.steps_N;
        assert!(at_changes_N > 0.0 && elsewhere_N > 0.0, "{slide:?}");
        assert_eq!(at_changes_N.max(elsewhere_N), figures.step_max_N);
    }

    #[test]
    fn the_unoptimised_device_has_wide_cones_and_two_rays_that_nearly_coincide() {
        let device = DeviceDefinition::load("cho-2005-unoptimised").unwrap();
        let found = along_wall(&device);
        assert!(found.cone_deg[0] > 80.0 && found.close > 0.3, "{found:?}");
    }
}

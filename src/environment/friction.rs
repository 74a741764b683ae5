//! Dry friction as a bristle: it bends from an anchor on the surface until it slips.
//!
//! While the bristle sticks, `k stretch <= mu_s N`; beyond that it slips, dragging its anchor
//! so that it keeps pulling with `mu_k N`, until the tool turns back or stops. Forces in W,
//! what the surface does to the tool. The anchor is carried by the surface: by its velocity
//! here, by its pose through [`Bristle::carry`]. With a load of zero it follows the tool.
//!
//! The load N is known only after all requests are clipped, so it is the one of the last tick
//! that bends the bristle; whoever knows it says so by [`Bristle::bear`] on every tick, else
//! it is zero. Source: the idea of the adhesion map of Hayward & Armstrong, "A new
//! computational model of friction applied to haptic rendering" (2000), with two coefficients.

use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::Material;

/// Stiffest bristle. A sampled spring on a motor needs a damping of `K T / 2` to be passive
/// (Colgate): at 1 kHz 2.5 N s/m for this one, which a hand that holds a handle has by itself.
const MAX_BRISTLE_N_PER_M: f64 = 5_000.0;

/// Stiffness of a material's bristle; 0 where nothing rubs, and never less than a number.
pub(super) fn bristle_N_per_m(material: &Material) -> f64 {
    let rubs = material.most_friction() > 0.0;
    if rubs { material.stiffness_N_per_m.min(MAX_BRISTLE_N_PER_M) } else { 0.0 }
}

/// What a surface remembers of its friction.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bristle {
    anchor_W_m: Option<Vector3<f64>>,
    sticks: bool,
    load_N: f64,
    /// Of its material's stiffness.
    share: f64,
}

impl Default for Bristle {
    fn default() -> Self {
        Self { anchor_W_m: None, sticks: false, load_N: 0.0, share: 1.0 }
    }
}

/// The pull of a bristle in one tick.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Pull {
    /// Along the surface, newtons in W.
    pub force_W_N: Vector3<f64>,
    /// It sticks under a load.
    pub sticking: bool,
}

impl Bristle {
    /// One tick of a tool at `p_W_m` on a surface with this normal.
    pub fn pull(
        &mut self,
        p_W_m: &Vector3<f64>,
        normal_W: &Vector3<f64>,
        material: &Material,
        tick_s: f64,
    ) -> Pull {
        let load_N = std::mem::take(&mut self.load_N);
        let slips_at = material.most_friction();
        let stiffness_N_per_m = bristle_N_per_m(material) * self.share;
        if stiffness_N_per_m <= 0.0 {
            *self = Self::default();
            return Pull::default();
        }
        let carried_m = material.surface_velocity_W_m_per_s * tick_s;
        let away_m = self.anchor_W_m.map_or(Vector3::zeros(), |anchor| p_W_m - anchor - carried_m);
        let mut stretch_m = away_m - normal_W * away_m.dot(normal_W);
        let pull_N = stiffness_N_per_m * stretch_m.norm();
        let was_slipping = self.anchor_W_m.is_some() && !self.sticks;
        let most_N = load_N * if was_slipping { material.kinetic_friction } else { slips_at };
        self.sticks = pull_N <= most_N;
        if !self.sticks {
            stretch_m *= material.kinetic_friction * load_N / pull_N;
        }
        if !stretch_m.iter().all(|part| part.is_finite()) {
            *self = Self::default();
            return Pull::default();
        }
        self.anchor_W_m = Some(p_W_m - stretch_m);
        Pull { force_W_N: -stiffness_N_per_m * stretch_m, sticking: self.sticks && load_N > 0.0 }
    }

    /// The load that it will have in the next tick, and the share of its material's stiffness:
    /// what slips slips as before, later.
    pub fn bear(&mut self, load_N: f64, share: f64) {
        (self.load_N, self.share) = (load_N.max(0.0), share);
    }

    /// Moves the anchor with the surface.
    pub fn carry(&mut self, moved: &Isometry3<f64>) {
        self.anchor_W_m = self.anchor_W_m.map(|anchor| (moved * Point3::from(anchor)).coords);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICK_S: f64 = 1e-3;
    const LOAD_N: f64 = 10.0;

    fn rubber() -> Material {
        Material {
            stiffness_N_per_m: 1e6,
            static_friction: 0.8,
            kinetic_friction: 0.5,
            ..Material::default()
        }
    }

    /// Pull along x at each place in turn, on the plane z = 0.
    fn dragged(material: &Material, places_m: impl IntoIterator<Item = f64>) -> Vec<(f64, bool)> {
        let mut bristle = Bristle::default();
        let pull = |x_m: f64| {
            bristle.bear(LOAD_N, 1.0);
            let p = Vector3::new(x_m, 0.0, -1e-4 * x_m);
            let pull = bristle.pull(&p, &Vector3::z(), material, TICK_S);
            assert!(pull.force_W_N.yz().norm() < 1e-12, "along the surface, against the drag");
            (pull.force_W_N.x, pull.sticking)
        };
        places_m.into_iter().map(pull).collect()
    }

    #[test]
    fn it_sticks_like_a_spring_then_slips_with_less() {
        let pulls = dragged(&rubber(), (0..400).map(|i| f64::from(i) * 1e-5));
        let stretch_m = 0.8 * LOAD_N / MAX_BRISTLE_N_PER_M;
        for (i, (force_N, sticks)) in pulls.into_iter().enumerate() {
            let x_m = i as f64 * 1e-5;
            if x_m < stretch_m - 1e-9 {
                assert!(sticks && (force_N + MAX_BRISTLE_N_PER_M * x_m).abs() < 1e-9, "{i}");
            } else if x_m > stretch_m + 1e-9 {
                assert!(!sticks && (force_N + 0.5 * LOAD_N).abs() < 1e-9, "{i}: {force_N}");
            }
        }
    }

    #[test]
    fn it_sticks_again_when_the_drag_turns_back() {
        let there = (0..400).map(|i| f64::from(i) * 1e-5);
        let back = (0..100).map(|i| 400e-5 - f64::from(i) * 1e-5);
        let pulls = dragged(&rubber(), there.chain(back));
        assert!(!pulls[399].1);
        assert!(pulls[402..].iter().all(|(_, sticks)| *sticks));
        let unbent = pulls[402..].windows(2).map(|pair| pair[1].0 - pair[0].0);
        assert!(unbent.into_iter().all(|step_N| (step_N - 0.05).abs() < 1e-9), "no step back");
    }

    #[test]
    fn a_conveyor_drags_a_tool_at_rest_and_spares_one_that_rides() {
        let velocity = Vector3::new(0.2, 0.0, 0.0);
        let belt = Material { surface_velocity_W_m_per_s: velocity, ..rubber() };
        let rests = dragged(&belt, std::iter::repeat_n(0.0, 50));
        assert!((rests[49].0 - 0.5 * LOAD_N).abs() < 1e-9, "{:?}", rests[49]);
        let rides = dragged(&belt, (0..50).map(|i| 0.2 * TICK_S * f64::from(i)));
        assert!(rides.iter().all(|(force_N, sticks)| force_N.abs() < 1e-9 && *sticks));
    }

    #[test]
    fn without_a_load_or_without_friction_it_pulls_nothing() {
        let mut bristle = Bristle::default();
        for x in 0..10 {
            let p = Vector3::new(f64::from(x), 0.0, 0.0);
            let pull = bristle.pull(&p, &Vector3::z(), &rubber(), TICK_S);
            assert_eq!((pull.force_W_N.norm(), pull.sticking), (0.0, false));
        }
        let ice = Material { static_friction: 0.0, kinetic_friction: 0.0, ..rubber() };
        assert!(dragged(&ice, [0.0, 0.1, 0.2]).iter().all(|pull| *pull == (0.0, false)));
    }

    #[test]
    fn the_anchor_moves_with_the_surface() {
        let mut bristle = Bristle::default();
        let pull_at = |bristle: &mut Bristle, y_m: f64| {
            bristle.bear(LOAD_N, 1.0);
            let p = Vector3::new(1.0, y_m, 0.0);
            bristle.pull(&p, &Vector3::z(), &rubber(), TICK_S).force_W_N
        };
        pull_at(&mut bristle, 0.0);
        bristle.carry(&Isometry3::translation(0.0, 1e-3, 0.0));
        let pull = pull_at(&mut bristle, 0.0);
        assert!((pull - Vector3::new(0.0, 5.0, 0.0)).norm() < 1e-9, "{pull}");
    }

    #[test]
    fn what_is_not_a_number_pulls_nothing_and_is_forgotten() {
        let mut bristle = Bristle::default();
        for load_N in [LOAD_N, f64::NAN, f64::INFINITY] {
            for x in [0.0, f64::NAN, f64::INFINITY, 1e300] {
                bristle.bear(load_N, 1.0);
                let p = Vector3::new(x, 0.0, 0.0);
                let pull = bristle.pull(&p, &Vector3::z(), &rubber(), TICK_S);
                assert!(pull.force_W_N.iter().all(|part| part.is_finite()), "{pull:?}");
            }
        }
    }
}

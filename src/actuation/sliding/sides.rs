//! What each brake does at a wall: its grip on the normal, and the drag that comes with it.
//!
//! A brake whose reaction gives the wall one newton along the normal n gives
//! `drag = (r . t) / (r . n)` along the tangent t (n turned a quarter counter-clockwise),
//! whichever way its shaft turns. Against sliding along `sigma t` it costs
//! `q = -sigma drag`: a brake with q > 0 slips there and holds the wall, one with q < 0 would
//! push into it. So the least drag at which brakes can hold a handle that slides under a press
//! of N newtons is `N min { q > 0 }`, with one slipping brake alone: the closed form of a
//! linear programme with one equality (derived here).
//!
//! Capacities are told per newton of press, N m / N.

use super::observer::Body;
use crate::actuation::{ActuatorKind, Capability};
use crate::notation::{ActuatorVector, PlaneVector};

/// A brake that pulls less than this along the normal (cosine) is of no use at the wall.
const LEAST_COSINE: f64 = 0.03;

/// A brake that gives this share of what the strongest gives is never too weak: an impact may
/// ask for more than any of them has.
const STRONG: f64 = 0.5;

/// How many times the press each brake could carry alone where all are locked.
const LOCKED: f64 = 2.0;

/// `n` turned a quarter counter-clockwise.
pub fn tangent_of(normal: &PlaneVector) -> PlaneVector {
    PlaneVector::new(-normal.y, normal.x, 0.0)
}

/// The most that an actuator can be told.
pub fn most_Nm(capability: &Capability, i: usize) -> f64 {
    capability.bounds.upper_Nm[i].max(-capability.bounds.lower_Nm[i])
}

/// All brakes at one wall.
#[derive(Clone, Copy, Debug)]
pub struct Sides {
    pub(super) count: usize,
    usable: [bool; crate::notation::MAX_ACTUATORS],
    /// Force along the tangent for each newton along the normal.
    pub drag: ActuatorVector,
    /// Normal force per torque, with its sign.
    pub grip: ActuatorVector,
    /// Length of each reference force.
    length: ActuatorVector,
}

impl Sides {
    /// The brakes at a wall that is pressed with `force_N`; those too weak for it are no use.
    pub fn of(capability: &Capability, body: &Body, normal: &PlaneVector, force_N: f64) -> Self {
        let tangent = tangent_of(normal);
        let mut sides = Self {
            count: capability.actuators,
            usable: Default::default(),
            drag: ActuatorVector::zeros(),
            grip: ActuatorVector::zeros(),
            length: ActuatorVector::zeros(),
        };
        let grip_N = |i: usize| body.reference.column(i).dot(normal).abs() * most_Nm(capability, i);
        let strongest_N = (0..sides.count).map(grip_N).fold(0.0, f64::max);
        let enough_N = force_N.min(STRONG * strongest_N);
        for i in 0..sides.count {
            let ray = body.reference.column(i);
            sides.grip[i] = ray.dot(normal);
            sides.length[i] = ray.norm();
            let pulls = sides.grip[i].abs() > LEAST_COSINE * sides.length[i];
            let strong = sides.grip[i].abs() * most_Nm(capability, i) >= enough_N;
            let brake = capability.kinds[i] == ActuatorKind::Brake;
            if pulls {
                sides.drag[i] = ray.dot(&tangent) / sides.grip[i];
                sides.usable[i] = brake && strong;
            }
        }
        sides
    }

    /// Drag of brake i, per newton, against sliding in `way`; `None`: it does not hold there.
    pub fn against(&self, i: usize, way: f64) -> Option<f64> {
        let drag = -way * self.drag[i];
        (self.usable[i] && drag > 0.0).then_some(drag)
    }

    /// The brake with the least drag against sliding in `way`.
    pub fn least(&self, way: f64) -> Option<(usize, f64)> {
        let known = (0..self.count).filter_map(|i| Some((i, self.against(i, way)?)));
        known.min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Capacity of brake i alone.
    pub fn alone(&self, i: usize) -> ActuatorVector {
        ActuatorVector::ith(i, 1.0 / self.grip[i].abs())
    }

    /// Capacities of brakes that have these shares of the press.
    pub fn shared(&self, shares: &ActuatorVector) -> ActuatorVector {
        ActuatorVector::from_fn(
            |i, _| {
                if shares[i] > 0.0 { shares[i] / self.grip[i].abs() } else { 0.0 }
            },
        )
    }

    /// The same where they have to drag by `drag` against sliding in `way`, if that is more than
    /// they do: a brake that drags more takes a part, or else one that pushes in is overcome.
    pub fn dragging(&self, shares: &ActuatorVector, way: f64, drag: f64) -> ActuatorVector {
        let carried = self.shared(shares);
        let own = -way * shares.dot(&self.drag);
        if drag <= own {
            return carried;
        }
        let known = (0..self.count).filter_map(|i| Some((i, self.against(i, way)?)));
        let more = known.filter(|(_, q)| *q > drag).min_by(|a, b| a.1.total_cmp(&b.1));
        match (more, self.least(-way)) {
            (Some((i, q)), _) => {
                let part = (drag - own) / (q - own);
                carried * (1.0 - part) + self.alone(i) * part
            }
            (None, Some((j, q))) => {
                let part = (drag - own) / (q + own);
                carried * (1.0 + part) + self.alone(j) * part
            }
            (None, None) => carried,
        }
    }

    /// Capacities that keep a handle at rest until the hand pulls against `soft` newtons along
    /// the tangent for each newton of press; nothing where sliding needs more anyway.
    pub fn braced(&self, soft: f64) -> ActuatorVector {
        let way = -soft.signum();
        match (self.least(way), self.least(-way)) {
            (Some((i, q)), Some((j, back))) if soft.abs() > q => {
                let part = (soft.abs() - q) / (q + back);
                self.alone(i) * (1.0 + part) + self.alone(j) * part
            }
            _ => ActuatorVector::zeros(),
        }
    }

    /// All together, as firmly as press and pull need with a margin: nothing moves.
    pub fn locked(&self, along: f64) -> ActuatorVector {
        let firmly = LOCKED * (1.0 + along.abs());
        ActuatorVector::from_fn(
            |i, _| {
                if self.length[i] > 0.0 { firmly / self.length[i] } else { 0.0 }
            },
        )
    }

    /// Capacities that hold a handle at rest which the hand pulls with `along` newtons along
    /// the tangent for each newton of press: the two brakes on either side of that, split so
    /// that their reaction balances the hand. The other one is at zero exactly where the
    /// handle begins to slide on one alone. Both hold more than they need by `tension` of the
    /// smaller share: a hand that changes its mind within that is not noticed.
    pub fn holding(&self, along: f64, tension: f64) -> ActuatorVector {
        // Against sliding forwards the drag is backwards, and the reverse.
        match (self.least(1.0), self.least(-1.0)) {
            (Some((i, q)), _) if along >= q => self.alone(i),
            (_, Some((j, q))) if -along >= q => self.alone(j),
            (Some((i, ahead)), Some((j, behind))) => {
                let share = (along + behind) / (ahead + behind);
                let more = tension * share.min(1.0 - share);
                self.alone(i) * (share + more) + self.alone(j) * (1.0 - share + more)
            }
            _ => self.locked(along),
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::actuation::{Bounds, ShaftMotion};
    use crate::notation::{HandleInertia, MAX_ACTUATORS, ReferenceMatrix};

    fn any(rng: &mut ChaCha8Rng) -> (Sides, Capability, PlaneVector) {
        let mut reference = ReferenceMatrix::zeros();
        reference.fixed_view_mut::<2, 4>(0, 0).iter_mut().for_each(|entry| {
            *entry = rng.random_range(-5.0..5.0);
        });
        let kinds = [ActuatorKind::Brake; MAX_ACTUATORS];
        let motion = [ShaftMotion::Rest; MAX_ACTUATORS];
        let bounds = Bounds::given(&kinds, &ActuatorVector::repeat(1e6), &motion);
        let (freedoms, actuators, moment_length_m) = (2, 4, 1.0);
        let capability =
            Capability { reference, freedoms, actuators, kinds, bounds, moment_length_m };
        let bearing_rad: f64 = rng.random_range(-3.0..3.0);
        let normal = PlaneVector::new(bearing_rad.cos(), bearing_rad.sin(), 0.0);
        let body = Body::of(&capability, &HandleInertia::identity()).expect("regular");
        (Sides::of(&capability, &body, &normal, 1.0), capability, normal)
    }

    /// Every passive mixture of the brakes' reactions that gives the wall its newton drags at
    /// least as much as the one brake with the least drag.
    #[test]
    fn no_mixture_of_slipping_brakes_drags_less_than_the_best_one_alone() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        for _ in 0..500 {
            let (sides, capability, normal) = any(&mut rng);
            let Some((_, least)) = sides.least(1.0) else { continue };
            let tangent = tangent_of(&normal);
            for _ in 0..200 {
                let mut force = PlaneVector::zeros();
                for i in 0..4 {
                    let ray = capability.reference.column(i);
                    // The handle slides along the tangent: a reaction is against that.
                    let size: f64 = rng.random_range(0.0..1.0);
                    force -= ray * (ray.dot(&tangent).signum() * size.powi(3));
                }
                let gives = force.dot(&normal);
                let cosines_pass = (0..4).all(|i| sides.usable[i]);
                if gives > 1e-3 && cosines_pass {
                    assert!(-force.dot(&tangent) / gives >= least - 1e-9);
                }
            }
        }
    }

    /// Whatever shares the brakes have, with the soft drag they give the wall its newton and the
    /// drag that was asked for.
    #[test]
    fn brakes_drag_as_much_more_as_is_asked_and_hold_the_wall_all_the_same() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut asked = 0;
        for _ in 0..500 {
            let (sides, _, _) = any(&mut rng);
            let way = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
            let (Some((best, least)), Some(_)) = (sides.least(way), sides.least(-way)) else {
                continue;
            };
            asked += 1;
            let shares = ActuatorVector::ith(best, 1.0);
            let drag = least + rng.random_range(-1.0..3.0);
            let capacity = sides.dragging(&shares, way, drag);
            // A slipping brake acts against its own rate: out of the wall where q > 0.
            let (mut out, mut back) = (0.0, 0.0);
            for i in 0..4 {
                let q = -way * sides.drag[i];
                out += capacity[i] * sides.grip[i].abs() * q.signum();
                back += capacity[i] * sides.grip[i].abs() * q.abs();
            }
            assert!((out - 1.0).abs() < 1e-9, "{out}");
            assert!((back - drag.max(least)).abs() < 1e-9, "{back} {drag} {least}");
        }
        assert!(asked > 300, "{asked}");
    }

    #[test]
    fn holding_balances_the_hand_and_gives_the_wall_its_newton() {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut both = 0;
        for _ in 0..500 {
            let (sides, capability, normal) = any(&mut rng);
            let (Some((_, ahead)), Some((_, behind))) = (sides.least(1.0), sides.least(-1.0))
            else {
                continue;
            };
            both += 1;
            let along = rng.random_range(-behind..ahead);
            let capacity = sides.holding(along, 0.0);
            let torque = capacity.zip_map(&sides.grip, |c, grip| c.copysign(grip));
            let reaction = capability.reference * torque;
            assert!((reaction.dot(&normal) - 1.0).abs() < 1e-9);
            assert!((reaction.dot(&tangent_of(&normal)) + along).abs() < 1e-9);
            let (begins, beyond) = (sides.holding(ahead, 0.3), sides.holding(2.0 * ahead, 0.3));
            assert!((begins - beyond).norm() < 1e-9, "one brake alone slips");
        }
        assert!(both > 300, "{both}");
    }
}

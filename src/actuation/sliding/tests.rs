//! The law on a plant of brakes: any wall, any hand, any lag, coarse encoders, a wrong model.
//!
//! The plant is half a kilogram on the reference forces of `cho-2005`, in steps of half a
//! tick, under implicit brakes that follow their commands with a lag; its encoders floor, its
//! sensor has noise and bias. It shares no state with the law.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::actuation::{
    ActuatorKind, Bounds, Outcome, ShaftMotion, Strategy, Wanted, allocate, nearest_in_box,
};
use crate::mechanism::{FiveBar, Inertia, Mechanism, fixtures};
use crate::notation::{HandleInertia, MAX_ACTUATORS};

const TICK_S: f64 = 1e-3;
const MASS_KG: f64 = 0.5;
const MOST_NM: f64 = 20.0;

struct World {
    device: FiveBar,
    normal: PlaneVector,
    /// The wall's surface along its normal.
    surface_m: f64,
    sensor: bool,
    counts: f64,
    /// The plant's lag and strength over what the law believes.
    error: [f64; 2],
    lag_s: f64,
    p: PlaneVector,
    v: PlaneVector,
    reached_Nm: ActuatorVector,
    told_Nm: ActuatorVector,
    state: LawState,
    rng: ChaCha8Rng,
    strategy: Strategy,
}

impl World {
    /// A wall through `at` whose normal points to `bearing_rad`, touched by the handle.
    fn new(at: [f64; 2], bearing_rad: f64) -> Self {
        let device = FiveBar::new(fixtures::CHO[0], Inertia::default()).expect("valid");
        let normal = PlaneVector::new(bearing_rad.cos(), bearing_rad.sin(), 0.0);
        let p = PlaneVector::new(at[0], at[1], 0.0);
        Self {
            device,
            normal,
            surface_m: p.dot(&normal),
            sensor: true,
            counts: 65_536.0,
            error: [1.0; 2],
            lag_s: 2e-3,
            p,
            v: PlaneVector::zeros(),
            reached_Nm: ActuatorVector::zeros(),
            told_Nm: ActuatorVector::zeros(),
            state: LawState::default(),
            rng: ChaCha8Rng::seed_from_u64(7),
            strategy: Strategy::Auto,
        }
    }

    fn depth_m(&self) -> f64 {
        self.surface_m - self.p.dot(&self.normal)
    }

    fn tangent(&self) -> PlaneVector {
        tangent_of(&self.normal)
    }

    /// What the encoders tell: the pose at the middle of the floored counts.
    fn measured(&self) -> PlaneVector {
        let posture = self.device.posture_at(&self.p).expect("inside");
        let count_rad = std::f64::consts::TAU / self.counts;
        let error = posture.shaft_rad.map(|rad| (rad / count_rad).floor() * count_rad - rad);
        let gram =
            posture.reference.fixed_rows::<2>(0) * posture.reference.fixed_rows::<2>(0).transpose();
        let handle = gram.try_inverse().expect("regular") * (posture.reference * error).xy();
        self.p + PlaneVector::new(handle.x, handle.y, 0.0)
    }

    /// One tick under a hand that does this along the normal and the tangent.
    fn tick(&mut self, hand: [f64; 2]) -> Outcome {
        let F_hand = self.normal * hand[0] + self.tangent() * hand[1];
        let posture = self.device.posture_at(&self.p).expect("inside");
        let noise = |rng: &mut ChaCha8Rng| rng.random_range(-0.085..0.085);
        let bias = PlaneVector::new(0.1 + noise(&mut self.rng), noise(&mut self.rng), 0.0);
        let position = self.measured();
        let mut inertia = HandleInertia::zeros();
        (inertia[(0, 0)], inertia[(1, 1)]) = (MASS_KG, MASS_KG);
        let handle = Handle {
            position,
            velocity: self.v,
            hand_force: self.sensor.then_some(F_hand + bias),
            inertia,
            tick_s: TICK_S,
        };
        let kinds = [ActuatorKind::Brake; MAX_ACTUATORS];
        let motion = [ShaftMotion::Rest; MAX_ACTUATORS];
        let capability = Capability {
            reference: posture.reference,
            freedoms: 2,
            actuators: 4,
            kinds,
            bounds: Bounds::given(&kinds, &ActuatorVector::repeat(MOST_NM), &motion),
            moment_length_m: 0.6,
        };
        let depth_m = self.surface_m - position.dot(&self.normal);
        let force_N = (1e7 * depth_m).clamp(0.0, capability.range_N(&self.normal));
        let wall = [WallDemand { normal: self.normal, force_N, depth_m }];
        let walls = if depth_m > 0.0 { &wall[..] } else { &[] };
        let wanted = Wanted { soft: PlaneVector::zeros(), walls };
        let (lag_s, counts) =
            (ActuatorVector::repeat(self.lag_s), ActuatorVector::repeat(self.counts));
        let shafts = Shafts { lag_s: &lag_s, counts_per_revolution: &counts, ..Shafts::IDEAL };
        let outcome =
            allocate(self.strategy, &capability, &handle, &wanted, &shafts, &mut self.state);
        self.told_Nm = outcome.torque_Nm.abs();
        assert!(self.told_Nm.iter().all(|told| (0.0..=MOST_NM).contains(told)), "{outcome:?}");
        (0..2).for_each(|_| self.live(&F_hand, &capability, 0.5 * TICK_S));
        outcome
    }

    fn live(&mut self, F_hand: &PlaneVector, capability: &Capability, dt_s: f64) {
        let lag_s = self.lag_s * self.error[0];
        let kept = if lag_s > 0.0 { (-dt_s / lag_s).exp() } else { 0.0 };
        let told_Nm = self.told_Nm * self.error[1];
        self.reached_Nm = told_Nm + (self.reached_Nm - told_Nm) * kept;
        let free = self.v + F_hand * (dt_s / MASS_KG);
        let mut matrix = capability.reference;
        matrix.row_mut(2).fill(0.0);
        let target = free * (-MASS_KG / dt_s);
        let torque = nearest_in_box(&matrix, &target, &-self.reached_Nm, &self.reached_Nm, 4);
        self.v = free + matrix * torque * (dt_s / MASS_KG);
        self.p += self.v * dt_s;
    }

    /// Presses with `press_N` and follows `target_m(t)` along the wall like a hand, with at
    /// most 60 N; returns the deepest penetration and where it was left behind most, metres.
    fn follow(&mut self, press_N: f64, seconds: f64, target_m: impl Fn(f64) -> f64) -> [f64; 2] {
        let origin_m = self.p.dot(&self.tangent());
        let (mut deepest_m, mut behind_m) = (f64::MIN, 0.0f64);
        for tick in 0..(seconds / TICK_S) as usize {
            let t_s = tick as f64 * TICK_S;
            let rate = (target_m(t_s + TICK_S) - target_m(t_s)) / TICK_S;
            let left_m = target_m(t_s) - (self.p.dot(&self.tangent()) - origin_m);
            let slow = rate - self.v.dot(&self.tangent());
            let pull_N = (300.0 * left_m + 50.0 * slow).clamp(-60.0, 60.0);
            let press = press_N * (t_s / 0.1).min(1.0);
            self.tick([-press, pull_N]);
            deepest_m = deepest_m.max(self.depth_m());
            behind_m = behind_m.max(left_m.abs());
        }
        [deepest_m, behind_m]
    }
}

/// Back and forth along the wall, with rests at both ends.
fn to_and_fro(t_s: f64) -> f64 {
    0.04 * (1.5 * (2.2 * t_s).sin()).clamp(-1.0, 1.0)
}

/// Deepest penetration, worst and median, and furthest behind, over walls at any angle under
/// presses of 6 to 14 N, with 15 % of error in the believed lag and strength of the brakes.
/// Millimetres.
fn over_walls(sensor: bool, lag_s: f64, counts: f64) -> [f64; 3] {
    let mut rng = ChaCha8Rng::seed_from_u64(40);
    let mut deepest_mm = [0.0; 20];
    let mut behind_mm = 0.0f64;
    for deepest_mm in &mut deepest_mm {
        let (r_m, bearing_rad): (f64, f64) =
            (rng.random_range(0.25..0.42), rng.random_range(-3.0..3.0));
        let at = [r_m * bearing_rad.cos(), r_m * bearing_rad.sin()];
        let mut world = World::new(at, rng.random_range(-3.1..3.1));
        (world.sensor, world.lag_s, world.counts) = (sensor, lag_s, counts);
        let press_N = rng.random_range(6.0..14.0);
        world.error = [rng.random_range(0.85..1.15), rng.random_range(0.85..1.15)];
        let [deepest_m, behind_m] = world.follow(press_N, 5.0, to_and_fro);
        *deepest_mm = 1e3 * deepest_m;
        behind_mm = behind_mm.max(1e3 * behind_m);
    }
    deepest_mm.sort_by(f64::total_cmp);
    [deepest_mm[19], deepest_mm[10], behind_mm]
}

const LAGS_S: [f64; 4] = [0.0, 2e-3, 0.01, 0.03];

#[test]
fn with_a_sensor_a_hand_slides_both_ways_along_any_wall_at_every_lag() {
    for lag_s in LAGS_S {
        let [worst, median, behind] = over_walls(true, lag_s, 65_536.0);
        assert!((0.1..1.0).contains(&worst) && median < 0.4, "{lag_s}: {worst} {median} mm");
        assert!((5.0..60.0).contains(&behind), "{lag_s}: {behind} mm behind");
    }
}

#[test]
fn without_a_sensor_too() {
    for lag_s in LAGS_S {
        let [worst, median, behind] = over_walls(false, lag_s, 65_536.0);
        assert!((0.1..1.4).contains(&worst) && median < 0.6, "{lag_s}: {worst} {median} mm");
        assert!((5.0..60.0).contains(&behind), "{lag_s}: {behind} mm behind");
    }
}

/// A count of 4,096 is a tenth of a millimetre or more at the handle.
#[test]
fn coarse_encoders_cost_depth_and_nothing_else() {
    for (sensor, most_mm) in [(true, 1.6), (false, 4.0)] {
        let [worst, _, behind] = over_walls(sensor, 2e-3, 4_096.0);
        assert!((0.1..most_mm).contains(&worst), "{sensor}: {worst} mm");
        assert!((5.0..60.0).contains(&behind), "{sensor}: {behind} mm behind");
    }
}

/// In at 0.3 m/s with at most 10 N, out again; three times.
#[test]
fn a_tap_is_stopped_and_let_go() {
    for (sensor, lag_s) in [true, false].into_iter().flat_map(|s| LAGS_S.map(|lag| (s, lag))) {
        let mut world = World::new([0.3, 0.2], std::f64::consts::PI);
        (world.sensor, world.lag_s) = (sensor, lag_s);
        world.p.x -= 0.005;
        let (mut deepest_mm, mut off) = (f64::MIN, 0);
        for tick in 0..3_000 {
            let in_cycle = tick % 1_000;
            let place_m = if in_cycle < 100 { 0.02 } else { -0.01 };
            let target = (20.0 * (0.3 + place_m - world.p.x)).clamp(-0.3, 0.3);
            let push_N = (60.0 * (target - world.v.x)).clamp(-10.0, 10.0);
            let along_N = -20.0 * world.v.dot(&world.tangent());
            world.tick([-push_N, along_N]);
            deepest_mm = f64::max(deepest_mm, 1e3 * world.depth_m());
            off += u32::from(in_cycle == 990 && world.depth_m() < -3e-3);
        }
        assert_eq!(off, 3, "sensor {sensor}, lag {lag_s}");
        assert!((0.1..3.0).contains(&deepest_mm), "{sensor} {lag_s}: {deepest_mm} mm");
    }
}

#[test]
fn a_hand_that_leaves_is_let_go_at_once_where_it_is_felt_and_soon_where_not() {
    for (sensor, within) in [(true, 30), (false, 900)] {
        let mut world = World::new([0.3, 0.1], std::f64::consts::PI);
        world.sensor = sensor;
        world.follow(10.0, 1.0, |_| 0.0);
        assert!(world.state.is_touching());
        let gone = (0..3_000).find(|_| {
            world.tick([10.0, 0.0]);
            world.depth_m() < -1e-3
        });
        assert!(gone.is_some_and(|ticks| (5..within).contains(&ticks)), "{sensor}: {gone:?} ms");
        assert_eq!(world.told_Nm, ActuatorVector::zeros());
        assert!(!world.state.is_touching());
    }
}

#[test]
fn a_wall_that_goes_releases_the_handle_that_pressed_on_it() {
    let mut world = World::new([0.3, 0.1], std::f64::consts::PI);
    world.follow(10.0, 0.5, |_| 0.0);
    assert!(world.depth_m() > 1e-5 && world.told_Nm.norm() > 0.0);
    world.surface_m -= 0.01;
    world.tick([-10.0, 0.0]);
    assert_eq!(world.told_Nm, ActuatorVector::zeros());
    assert!(!world.state.is_touching());
}

#[test]
fn where_no_brake_holds_on_one_side_all_are_locked() {
    let world = World::new([0.3, 0.1], std::f64::consts::PI);
    let posture = world.device.posture_at(&world.p).expect("inside");
    let mut kinds = [ActuatorKind::Brake; MAX_ACTUATORS];
    let motion = [ShaftMotion::Rest; MAX_ACTUATORS];
    let bounds = Bounds::given(&kinds, &ActuatorVector::repeat(MOST_NM), &motion);
    let (freedoms, actuators, moment_length_m) = (2, 4, 0.6);
    let reference = posture.reference;
    let device = Capability { reference, freedoms, actuators, kinds, bounds, moment_length_m };
    let body = Body::of(&device, &posture.inertia).expect("regular");
    let all = Sides::of(&device, &body, &world.normal, 10.0);
    assert!(all.least(1.0).is_some() && all.least(-1.0).is_some());
    for (i, kind) in kinds.iter_mut().enumerate().take(4) {
        if all.against(i, 1.0).is_some() {
            *kind = ActuatorKind::Motor;
        }
    }
    let half = Sides::of(&Capability { kinds, ..device }, &body, &world.normal, 10.0);
    let held = half.holding(0.3, 0.0);
    assert!((0..4).all(|i| held[i] > 0.0), "{held}");
}

/// Numbers that are none, a handle that leaps, an inertia that cannot be inverted.
#[test]
fn nonsense_gives_finite_capacities_and_is_forgotten() {
    let mut world = World::new([0.3, 0.1], std::f64::consts::PI);
    world.follow(10.0, 0.2, |_| 0.0);
    for hand in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300] {
        let before = (world.p, world.v, world.reached_Nm);
        world.tick([hand, hand]);
        (world.p, world.v, world.reached_Nm) = before;
        let [deepest_m, _] = world.follow(10.0, 0.5, |_| 0.0);
        assert!(deepest_m < 2e-3, "{hand}: {deepest_m}");
    }
}

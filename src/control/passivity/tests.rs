//! The account against its promise: whatever is asked and however the handle moves.

use proptest::prelude::*;

use super::*;
use crate::config::{DeviceDefinition, Scene, build_plan};
use crate::control::Sample;
use crate::control::estimate::Estimator;
use crate::notation::ActuatorVector;

/// One device's account, and the books of somebody else.
struct Books {
    plan: Plan,
    estimate: Estimate,
    account: Account,
    last: Report,
    gave: PlaneVector,
    /// Fed to the handle, less what the power paid for.
    net_J: f64,
    least_J: f64,
    /// Most that was fed over any stretch beyond what the power paid for.
    most_J: f64,
}

/// A moment counts as the force on this arm.
const LENGTH_M: f64 = 0.1;

impl Books {
    fn new(reserve_J: f64, power_W: f64) -> Self {
        let device = DeviceDefinition::load("singh").expect("built in");
        let mut plan = build_plan(&device, &Scene::default());
        plan.guards.passivity_reserve_J = reserve_J;
        plan.guards.passivity_power_W = power_W;
        plan.actuators.lag_s.fill(0.0);
        let sample = Sample::at(&plan, &PlaneVector::new(0.0, 0.15, 0.0));
        let estimate = Estimator::default().update(&sample, &plan, 0).expect("within reach");
        Self {
            last: Report { p_BH: estimate.p_BH, ..Report::default() },
            plan,
            estimate,
            account: Account::default(),
            gave: PlaneVector::zeros(),
            net_J: 0.0,
            least_J: 0.0,
            most_J: 0.0,
        }
    }

    /// The handle went this way since the last tick and seems to move at this velocity: what is
    /// given of this force, beside another one.
    fn tick(
        &mut self,
        way: &PlaneVector,
        v_BH: &PlaneVector,
        asked: &PlaneVector,
        beside: &PlaneVector,
    ) -> PlaneVector {
        self.net_J += self.gave.dot(way) - self.plan.guards.passivity_power_W * self.plan.tick_s();
        self.most_J = self.most_J.max(self.net_J - self.least_J);
        self.least_J = self.least_J.min(self.net_J);
        self.estimate.p_BH += way;
        self.estimate.v_BH = *v_BH;
        let mut request = Request::default();
        (request.soft_BH_N, request.controller_soft_BH_N) = (asked + beside, *asked);
        let port = Port { plan: &self.plan, estimate: &self.estimate, length_m: LENGTH_M };
        self.account.settle(&port, &self.last);
        let soft = request.soft_BH_N - self.account.held_back(&port, &request.soft_BH_N, &request);
        self.account.give(&port, &soft, &request, &soft);
        self.last.p_BH = self.estimate.p_BH;
        self.gave = soft - beside;
        self.gave
    }
}

fn any_vector(force: f64, moment: f64) -> impl Strategy<Value = PlaneVector> {
    (-force..force, -force..force, -moment..moment).prop_map(|(x, y, z)| PlaneVector::new(x, y, z))
}

/// Up to 28 N and 2 N m; up to 2.8 m/s and 20 rad/s.
fn any_ticks() -> impl Strategy<Value = Vec<[PlaneVector; 3]>> {
    let one = (any_vector(20.0, 2.0), any_vector(2e-3, 2e-2), any_vector(2.0, 20.0));
    let one = one.prop_map(|(force, way, v)| [force, way, v]);
    // What goes on feeds, what is drawn anew in each tick mostly does not.
    let stretch = (one, 1_usize..60).prop_map(|(tick, n)| vec![tick; n]);
    prop::collection::vec(stretch, 1..30).prop_map(|stretches| stretches.concat())
}

const ZERO: PlaneVector = PlaneVector::new(0.0, 0.0, 0.0);

/// The part of a force across a motion, in the measure in which a moment is a force on an arm. It
/// can feed a way that is another than the motion more than the whole force does.
fn across(force: &PlaneVector, v_BH: &PlaneVector) -> PlaneVector {
    let motion = PlaneVector::new(v_BH.x, v_BH.y, v_BH.z * LENGTH_M);
    let along = motion * (force.dot(v_BH) / motion.norm_squared());
    force - PlaneVector::new(along.x, along.y, along.z * LENGTH_M)
}

proptest! {
    #[test]
    fn over_any_stretch_no_more_than_two_reserves_and_the_power_are_fed(
        ticks in any_ticks(),
        reserve_J in 0.01..1.0_f64,
        power_W in 0.0..0.5_f64,
    ) {
        let mut books = Books::new(reserve_J, power_W);
        let (mut given, mut largest_J) = ([ZERO; 2], 0.0_f64);
        for [asked, way, v_BH] in &ticks {
            // What the last tick gave lies between these two: this way is fed by it.
            largest_J = given.iter().map(|force| force.dot(way)).fold(largest_J, f64::max);
            books.tick(way, v_BH, asked, &ZERO);
            given = [*asked, across(asked, v_BH)];
        }
        // Overdrawn within one tick, where that is more than a reserve.
        let promised_J = 2.0 * reserve_J + (largest_J - reserve_J).max(0.0);
        prop_assert!(books.most_J <= promised_J + 1e-9, "{} J of {promised_J} J", books.most_J);
    }

    #[test]
    fn one_reserve_where_the_velocity_is_known(
        ticks in any_ticks(),
        reserve_J in 0.01..1.0_f64,
        power_W in 0.0..0.5_f64,
    ) {
        let mut books = Books::new(reserve_J, power_W);
        let mut before = ZERO;
        for [asked, way, _] in &ticks {
            books.tick(&before, &(way / books.plan.tick_s()), asked, &ZERO);
            before = *way;
        }
        books.tick(&before, &ZERO, &ZERO, &ZERO);
        prop_assert!(books.most_J <= reserve_J + 1e-9, "{} J of {reserve_J} J", books.most_J);
    }

    #[test]
    fn what_is_held_back_lies_along_the_motion_and_never_turns_the_force_around(
        asked in any_vector(20.0, 2.0),
        v_BH in any_vector(1.0, 10.0),
        spent in 0.0..1.0_f64,
    ) {
        let mut books = Books::new(0.3, 0.02);
        books.account.spent_J = 0.3 * spent;
        let gave = books.tick(&ZERO, &v_BH, &asked, &ZERO);
        let (before_W, after_W) = (asked.dot(&v_BH), gave.dot(&v_BH));
        if before_W <= 0.0 {
            prop_assert!((gave - asked).norm() < 1e-12, "what resists is left alone");
        } else {
            prop_assert!((0.0..=before_W + 1e-9).contains(&after_W), "{after_W} W of {before_W} W");
            // The part across, in the measure in which a moment is a force on an arm.
            let motion = PlaneVector::new(v_BH.x, v_BH.y, v_BH.z * LENGTH_M);
            let left = as_forces(&(asked - gave), LENGTH_M);
            prop_assert!(left.cross(&motion).norm() < 1e-9 * (1.0 + left.norm() * motion.norm()));
        }
    }

    #[test]
    fn what_the_scene_asks_beside_it_is_neither_booked_nor_held_back(
        ticks in any_ticks(),
        beside in any_vector(20.0, 2.0),
    ) {
        let (mut alone, mut among) = (Books::new(0.05, 0.01), Books::new(0.05, 0.01));
        for [asked, way, v_BH] in &ticks {
            let gave = [ZERO, beside].map(|beside| {
                let books = if beside == ZERO { &mut alone } else { &mut among };
                books.tick(way, v_BH, asked, &beside)
            });
            prop_assert!((gave[0] - gave[1]).norm() < 1e-6, "{} {}", gave[0], gave[1]);
        }
    }
}

/// Along x, metres and newtons.
fn along(x: f64) -> PlaneVector {
    PlaneVector::new(x, 0.0, 0.0)
}

#[test]
fn what_the_hand_pays_in_is_given_back_and_no_more_than_a_reserve_of_it_is_kept() {
    let mut books = Books::new(0.1, 0.0);
    let push = |books: &mut Books, way_m: f64, ticks: usize| {
        let mut given = ZERO;
        for _ in 0..ticks {
            given = books.tick(&along(way_m), &along(way_m / 1e-3), &along(5.0), &ZERO);
        }
        given.x
    };
    // With 5 N over 10 mm half of the reserve is fed.
    assert_eq!(push(&mut books, 1e-4, 100), 5.0);
    assert!((books.account.spent_J - 0.05).abs() < 1e-3, "{:?}", books.account);
    // The hand brings it back, and much further.
    assert_eq!(push(&mut books, -1e-4, 1000), 5.0);
    assert_eq!(books.account.spent_J, 0.0);
    // From there the whole reserve is there again, and nothing of what was more.
    let mut way_m = 0.0;
    while push(&mut books, 1e-4, 1) > 2.5 {
        way_m += 1e-4;
    }
    assert!((0.015..0.02).contains(&way_m), "{way_m} m of the 20 mm of a reserve");
    assert!(push(&mut books, 1e-4, 2000) < 1e-3, "without a power it is empty");
}

#[test]
fn an_empty_account_still_holds_at_rest_and_feeds_its_power() {
    let mut books = Books::new(0.1, 0.02);
    books.account.spent_J = 0.1;
    for speed_m_per_s in [0.0, 0.002, 0.01, 0.1, 1.0] {
        books.account.spent_J = 0.1;
        let given = books.tick(&ZERO, &along(speed_m_per_s), &along(5.0), &ZERO).x;
        let left_W = 0.02 * 1e-3 / WITHIN_S;
        let expected_N = ((0.02 + left_W) / speed_m_per_s).min(5.0);
        assert!((given - expected_N).abs() < 1e-9, "{given} N at {speed_m_per_s} m/s");
    }
}

#[test]
fn a_way_that_nobody_saw_is_booked_where_it_feeds_and_not_where_it_pays() {
    for (way_m, booked_J) in [(1e-3, 5e-3), (-1e-3, 0.0)] {
        let mut books = Books::new(0.1, 0.0);
        books.account.spent_J = 0.05;
        books.tick(&ZERO, &ZERO, &along(5.0), &ZERO);
        books.account.unseen();
        books.tick(&along(way_m), &ZERO, &ZERO, &ZERO);
        assert!((books.account.spent_J - 0.05 - booked_J).abs() < 1e-12, "{:?}", books.account);
    }
}

#[test]
fn under_a_law_that_gives_otherwise_the_work_of_the_motors_counts() {
    let work_J = |otherwise: bool, beside: PlaneVector| {
        let mut books = Books::new(1.0, 0.0);
        books.account.gave = Gave { controller_BH_N: along(-1.0), beside_BH_N: beside, otherwise };
        books.last.commanded_Nm = [0.5, 0.5, 0.0, 0.0, 0.0, 0.0].into();
        books.last.shaft_rad = books.estimate.shaft_rad - ActuatorVector::from_element(0.01);
        books.last.p_BH -= along(1e-3);
        let port = Port { plan: &books.plan, estimate: &books.estimate, length_m: LENGTH_M };
        books.account.settle(&port, &books.last);
        books.account.spent_J
    };
    assert_eq!(work_J(false, ZERO), 0.0, "as asked it would have been paid in");
    assert!((work_J(true, ZERO) - 0.01).abs() < 1e-12);
    assert!((work_J(true, along(4.0)) - 0.006).abs() < 1e-12, "without what the scene fed");
    assert!((work_J(true, along(-4.0)) - 0.01).abs() < 1e-12, "and not what it took");
}

#[test]
fn a_motor_that_lags_feeds_by_what_it_has_reached() {
    let lag_s = 0.002;
    let mut books = Books::new(10.0, 0.0);
    books.plan.actuators.lag_s.fill(lag_s);
    let (mut expected_J, way_m) = (0.0, 1e-3);
    for tick in 0..20 {
        let force_N = if tick < 10 { 5.0 } else { -3.0 };
        books.tick(&along(if tick == 0 { 0.0 } else { way_m }), &ZERO, &along(force_N), &ZERO);
        // A thousand steps of the lag in each tick, from the command of the tick before.
        let of_tick = |tick: i32, reached_N: f64| {
            let commanded_N = if tick < 10 { 5.0 } else { -3.0 };
            (0..1_000).fold((reached_N, 0.0), |(reached_N, sum_J), _| {
                let next_N = reached_N + (commanded_N - reached_N) * 1e-6 / lag_s;
                (next_N, sum_J + 0.5 * (reached_N + next_N) * way_m * 1e-3)
            })
        };
        expected_J = (0..tick)
            .fold((0.0, 0.0), |(reached_N, sum_J), tick| {
                let (reached_N, fed_J) = of_tick(tick, reached_N);
                (reached_N, sum_J + fed_J)
            })
            .1;
        let booked_J = books.account.spent_J;
        assert!((booked_J - expected_J).abs() < 1e-5, "{tick}: {booked_J} J, {expected_J} J");
    }
    assert!(expected_J > 0.01, "{expected_J}");
}

#[test]
fn with_brakes_alone_or_without_an_end_nothing_is_booked() {
    for brakes in [true, false] {
        let mut books = Books::new(0.01, 0.0);
        if brakes {
            books.plan.actuators.kinds.fill(ActuatorKind::Brake);
        } else {
            books.plan.guards.passivity_reserve_J = f64::INFINITY;
        }
        for _ in 0..100 {
            assert_eq!(books.tick(&along(1e-3), &along(1.0), &along(5.0), &ZERO), along(5.0));
        }
        assert_eq!(books.account.spent_J, 0.0);
    }
}

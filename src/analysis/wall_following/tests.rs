//! The figures of a few cells of the table, held from both sides.

use super::*;

fn figures(strategy: Strategy, sensor: bool, lag_s: f64, counts: f64) -> Figures {
    let (lag_s, counts) = (Some(lag_s), Some(counts));
    run(&Experiment { strategy, sensor, lag_s, counts, ..Experiment::default() }).unwrap()
}

const LAGS_S: [f64; 4] = [0.0, 2e-3, 0.01, 0.03];

/// A perfect law's hand is stuck for 0.26 s, pulls 6.57 N in the mean and 15.5 N at most.
fn near_the_bound(found: &Figures) {
    assert!(found.arrived && found.slide_s < 5.4, "{found:?}");
    assert!((0.15..0.35).contains(&found.stuck_s), "{found:?}");
    assert!((6.57..6.57 * 1.08).contains(&found.hand_mean_N), "{found:?}");
    assert!((15.0..18.5).contains(&found.hand_max_N), "{found:?}");
}

#[test]
fn with_a_sensor_sliding_is_smooth_and_stays_at_the_wall_at_every_lag() {
    for lag_s in LAGS_S {
        let found = figures(Strategy::Auto, true, lag_s, 65_536.0);
        near_the_bound(&found);
        assert!((0.08..0.3).contains(&found.penetration_mm), "{found:?}");
        assert!((5.0..40.0).contains(&found.jerk_rms_m_per_s3), "{found:?}");
        assert!((0.5..10.0).contains(&found.step_max_N), "{found:?}");
        assert!((0.3..3.0).contains(&found.switches_per_s), "{found:?}");
    }
}

#[test]
fn without_one_it_goes_a_little_deeper() {
    for lag_s in LAGS_S {
        let found = figures(Strategy::Auto, false, lag_s, 65_536.0);
        near_the_bound(&found);
        assert!((0.08..0.6).contains(&found.penetration_mm), "{found:?}");
        assert!((5.0..40.0).contains(&found.jerk_rms_m_per_s3), "{found:?}");
        assert!((0.3..4.0).contains(&found.switches_per_s), "{found:?}");
    }
}

#[test]
fn coarse_encoders_make_it_rougher() {
    for (sensor, most_mm) in [(true, 0.4), (false, 1.6)] {
        let found = figures(Strategy::Auto, sensor, 2e-3, 4_096.0);
        near_the_bound(&found);
        assert!((0.1..most_mm).contains(&found.penetration_mm), "{found:?}");
        assert!((20.0..100.0).contains(&found.jerk_rms_m_per_s3), "{found:?}");
    }
}

/// The figures that the law is there to improve, by the name that still selects them.
#[test]
fn predicted_velocity_is_as_rough_as_it_was() {
    let found = figures(Strategy::PredictedVelocity, true, 0.0, 65_536.0);
    assert!((150.0..300.0).contains(&found.jerk_rms_m_per_s3), "{found:?}");
    assert!((50.0..120.0).contains(&found.step_max_N), "{found:?}");
    assert!((200.0..500.0).contains(&found.switches_per_s), "{found:?}");
    let late = figures(Strategy::PredictedVelocity, true, 0.03, 65_536.0);
    assert!((1.0..8.0).contains(&late.penetration_mm), "{late:?}");
}

/// Mean force over that of a perfect law, and the figures.
fn on(course: CourseKind, sensor: bool, lag_s: f64) -> (f64, Figures) {
    let lag_s = Some(lag_s);
    let found = run(&Experiment { course, sensor, lag_s, ..Experiment::default() }).unwrap();
    let device = DeviceDefinition::load("cho-2005").unwrap();
    let path = Course::new(course, 1e7, device.mechanism.reach_m().1);
    let hand = HandSettings::default();
    let bound = perfect(device.mechanism.as_ref(), &device.residual_Nm, &path, hand);
    (found.hand_mean_N / bound.hand_mean_N, found)
}

#[test]
fn bent_walls_are_followed_near_the_bound() {
    for course in [CourseKind::Hollow, CourseKind::Ball, CourseKind::Corridor] {
        for (sensor, lag_s) in [(true, 0.0), (true, 0.01), (false, 0.01)] {
            let (ratio, found) = on(course, sensor, lag_s);
            assert!(found.arrived, "{course} {sensor} {lag_s}: {found:?}");
            assert!((0.95..1.15).contains(&ratio), "{course} {sensor} {lag_s}: {ratio}");
            assert!((0.08..0.7).contains(&found.penetration_mm), "{course}: {found:?}");
            assert!((5.0..60.0).contains(&found.jerk_rms_m_per_s3), "{course}: {found:?}");
        }
    }
}

/// Both walls are held while the hand presses into the corner, and the second is followed
/// without letting go of it.
#[test]
fn a_corner_is_entered_held_and_left_along_the_other_wall() {
    for (sensor, lag_s) in [(true, 0.0), (true, 0.03), (false, 0.0)] {
        let (ratio, found) = on(CourseKind::Corner, sensor, lag_s);
        assert!(found.arrived, "{sensor} {lag_s}: {found:?}");
        assert!((0.95..1.15).contains(&ratio), "{sensor} {lag_s}: {ratio}");
        assert!((0.15..2.0).contains(&found.penetration_mm), "{sensor} {lag_s}: {found:?}");
        assert!((5.0..50.0).contains(&found.jerk_rms_m_per_s3), "{found:?}");
    }
}

#[test]
fn a_fast_hand_is_stopped_as_soon_as_the_brakes_can() {
    for (lag_s, most_mm) in [(0.0, 0.8), (0.03, 4.0)] {
        let hand = HandSettings { approach_m_per_s: 0.5, ..HandSettings::default() };
        let found = run(&Experiment { hand, lag_s: Some(lag_s), ..Experiment::default() }).unwrap();
        assert!(found.arrived && (0.15..most_mm).contains(&found.penetration_mm), "{found:?}");
    }
}

/// A hand with a mass and a soft palm is no harder to hold.
#[test]
fn a_hand_of_flesh_follows_too() {
    let hand = HandSettings { flesh: Some(Flesh::default()), ..HandSettings::default() };
    let found = run(&Experiment { hand, ..Experiment::default() }).unwrap();
    assert!(found.arrived && (0.08..0.6).contains(&found.penetration_mm), "{found:?}");
}

/// For whoever tunes: `cargo test --lib courses_table -- --ignored --nocapture`.
#[test]
#[ignore = "prints a table, judges nothing"]
fn courses_table() {
    let var = |name: &str, usual: &str| std::env::var(name).unwrap_or_else(|_| usual.into());
    let device_name = var("DEVICE", "cho-2005");
    let approach_m_per_s: f64 = var("APPROACH", "0.025").parse().unwrap();
    let flesh = (var("FLESH", "") == "1").then(Flesh::default);
    let counts = var("COUNTS", "65536").parse().ok();
    let hand = HandSettings { approach_m_per_s, flesh, ..HandSettings::default() };
    let stiffness_N_per_m: f64 = var("STIFF", "1e7").parse().unwrap();
    for course in var("COURSES", &CourseKind::ALL.map(CourseKind::name).join(",")).split(',') {
        let course: CourseKind = course.parse().unwrap();
        let device = DeviceDefinition::load(&device_name).unwrap();
        let path = Course::new(course, 1e7, device.mechanism.reach_m().1);
        let bound = perfect(device.mechanism.as_ref(), &device.residual_Nm, &path, hand);
        println!(
            "{course}: perfect {} {:.1} s stuck {:.2} s, {:.2} {:.1} N, D {:.2} {:.1} N, {:.0} % impossible",
            bound.arrived,
            bound.slide_s,
            bound.stuck_s,
            bound.hand_mean_N,
            bound.hand_max_N,
            bound.bound_mean_N,
            bound.bound_max_N,
            100.0 * bound.impossible
        );
        for strategy in var("LAWS", "sliding").split(',').map(|law| law.parse().unwrap()) {
            for (sensor, lag_s) in [
                (true, 0.0),
                (true, 0.01),
                (true, 0.03),
                (false, 0.0),
                (false, 0.01),
                (false, 0.03),
            ] {
                let experiment = Experiment {
                    device: device_name.clone(),
                    hand,
                    counts,
                    strategy,
                    sensor,
                    course,
                    stiffness_N_per_m,
                    lag_s: Some(lag_s),
                    ..Experiment::default()
                };
                let (mut last, mut steps) = (None::<Moment>, Vec::new());
                let f = run_with(&experiment, None, |now| {
                    if let Some(last) = last.filter(|last| last.sliding && now.sliding) {
                        steps.push(((now.F_BH_N - last.F_BH_N).norm(), *now));
                    }
                    last = Some(*now);
                })
                .unwrap();
                steps.sort_by(|a, b| b.0.total_cmp(&a.0));
                println!(
                    "  {strategy:<18} {:<6} {:<4}: {} {:.1} s stuck {:.2} ({}) {:.2}/{:.2} mm, \
                     {:.2} ({:.2}) {:.1} N, gamma {:.0}/{:.0}, jerk {:.0}, step {:.1}, {:.1} sw/s",
                    if sensor { "sensor" } else { "none" },
                    1e3 * lag_s,
                    if f.arrived { "" } else { "NOT" },
                    f.slide_s,
                    f.stuck_s,
                    f.stick_events,
                    f.penetration_mm,
                    f.sliding_mm,
                    f.hand_mean_N,
                    f.hand_mean_N / bound.hand_mean_N,
                    f.hand_max_N,
                    f.gamma_mean_deg,
                    f.gamma_max_deg,
                    f.jerk_rms_m_per_s3,
                    f.step_max_N,
                    f.switches_per_s
                );
                if var("STEPS", "") == "1" {
                    for (step_N, m) in steps.iter().take(6) {
                        println!(
                            "    {step_N:.2} N at {:.3} s, p {:.4} {:.4}, v {:.4} {:.4}, hand {:.2} {:.2}, brakes {:.2} {:.2}, depth {:.3} mm, leads {:?}",
                            m.t_s,
                            m.p_BH.x,
                            m.p_BH.y,
                            m.v_BH.x,
                            m.v_BH.y,
                            m.F_hand_BH_N.x,
                            m.F_hand_BH_N.y,
                            m.F_BH_N.x,
                            m.F_BH_N.y,
                            1e3 * m.depth_m,
                            m.leading
                        );
                    }
                }
            }
        }
    }
}

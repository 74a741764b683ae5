//! The recorded hand under this law and another.

use super::*;

#[test]
fn one_lost_sample_leaves_the_hand_measured() {
    let mut lost = 0;
    let mut all = entries(&slide_bytes(true));
    for entry in &mut all {
        if let Some(Entry::Tick(tick)) = &mut entry.entry
            && [1, 2_500].contains(&tick.tick)
        {
            tick.sample = None;
            tick.sample_error = crate::proto::RecordDeviceError::Timeout.into();
            lost += 1;
        }
    }
    assert_eq!(lost, 2);
    let comparison = compare(&Recorded::read(bytes_of(all)).unwrap(), Strategy::Auto).unwrap();
    assert!(matches!(comparison.hand, Hand::Follows { .. }));
    let [recorded, own, _] = comparison.runs.as_slice() else { panic!("three runs") };
    let both = recorded.moments.iter().zip(&own.moments);
    // Before its first sample a run knows no place.
    let apart_m = both.skip(1).map(|(a, b)| (a.p_m - b.p_m).norm());
    let most_m = apart_m.fold(0.0, f64::max);
    assert!(most_m < 10e-3, "{most_m} m apart");
}

#[test]
fn a_run_that_touches_nothing_has_no_figures_of_touching() {
    let mut world = World::new(true, 0);
    let deliveries = world.begin(1, 100_000 * MS);
    world.snapshot(0);
    world.ticks(100);
    world.recorder.finish();
    let recorded = Recorded::read(file_of(deliveries)).unwrap();
    for run in compare(&recorded, Strategy::Optimal).unwrap().runs {
        assert_eq!(run.measures, Measures::default(), "{}", run.name);
        assert_eq!(run.measures.penetration_mm, None);
    }
}

fn slide(sensor: bool) -> Recorded {
    Recorded::read(slide_bytes(sensor)).unwrap()
}

fn slide_bytes(sensor: bool) -> Vec<u8> {
    let mut world = World::new(sensor, 0);
    world.wall("wall", 0.3);
    let deliveries = world.begin(1, 100_000 * MS);
    world.snapshot(0);
    world.ticks(5_000);
    world.recorder.finish();
    file_of(deliveries)
}

#[test]
fn the_recorded_hand_under_the_recorded_law_goes_the_recorded_way() {
    let comparison = compare(&slide(true), Strategy::PredictedVelocity).unwrap();
    let [recorded, own, other] = comparison.runs.as_slice() else { panic!("three runs") };
    assert_eq!(own.name, "simulated, auto");
    let apart_m = recorded.moments.iter().zip(&own.moments).map(|(a, b)| (a.p_m - b.p_m).norm());
    let most_m = apart_m.fold(0.0, f64::max);
    assert!(most_m < 5e-3, "{most_m} m apart");
    assert!(recorded.measures.touching_s > 2.0, "{:?}", recorded.measures);
    // As analysis::wall_following has it of these two laws.
    let (own, other) = (&own.measures, &other.measures);
    assert!(other.step_N > own.step_N.map(|step_N| 3.0 * step_N), "{own:?} {other:?}");
    let calm = own.jerk_rms_m_per_s3.map(|jerk| 1.5 * jerk);
    assert!(calm.is_some() && other.jerk_rms_m_per_s3 > calm, "{own:?} {other:?}");
    assert_eq!(recorded.measures.step_N, None, "what was at the handle is not recorded");
}

#[test]
fn without_a_force_sensor_the_motion_stays_the_recorded_one() {
    let comparison = compare(&slide(false), Strategy::Optimal).unwrap();
    assert_eq!(comparison.hand, Hand::Unknown);
    let [recorded, other] = comparison.runs.as_slice() else { panic!("two runs") };
    let same = |a: &measures::Moment, b: &measures::Moment| a.p_m == b.p_m;
    assert!(recorded.moments.iter().zip(&other.moments).all(|(a, b)| same(a, b)));
    assert_ne!(recorded.measures, other.measures);
}

#[test]
fn the_picture_has_a_row_for_each_run() {
    let comparison = compare(&slide(true), Strategy::Optimal).unwrap();
    let svg = draw(&comparison);
    assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"));
    for run in &comparison.runs {
        assert_eq!(svg.matches(run.name.as_str()).count(), 2, "{}: legend and row", run.name);
    }
    assert!(!svg.contains("NaN") && !svg.contains("inf"));
}

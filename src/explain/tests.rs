//! Each way to feel nothing, less, or something else has its first reason.

use super::*;
use crate::control::{Fault, Limits, Wrench};

fn wrench(x: f64) -> Wrench {
    Wrench { force_N: Vector3::new(x, 0.0, 0.0), ..Wrench::default() }
}

/// Pressed into a wall that is rendered as asked.
fn felt() -> Report {
    Report {
        mode: Mode::Enabled,
        homed: true,
        requested: wrench(-5.0),
        achievable: wrench(-5.0),
        rendered: wrench(-5.0),
        rendered_source: RenderedSource::Measured,
        region: Some(Region::Full),
        contact_count: 1,
        ..Report::default()
    }
}

fn free() -> Report {
    let nothing = wrench(0.0);
    let (requested, achievable, rendered) = (nothing, nothing, nothing);
    Report { requested, achievable, rendered, region: None, contact_count: 0, ..felt() }
}

fn limited(limit: Limit) -> Limits {
    let mut limits = Limits::default();
    limits.set(limit, true);
    limits
}

/// One object, a centimetre away.
fn one() -> Circumstances<'static> {
    let nearest = Some(NearestSurface { name: "wall".into(), distance_m: 0.01 });
    let around = Surroundings { objects: 1, fields: 0, nearest, out_of_reach: false };
    Circumstances { around, force_limit_N: 1000.0, ..Circumstances::default() }
}

fn one_at(distance_m: f64, out_of_reach: bool) -> Circumstances<'static> {
    let mut one = one();
    one.around.out_of_reach = out_of_reach;
    one.around.nearest.as_mut().unwrap().distance_m = distance_m;
    one
}

#[test]
fn what_is_rendered_as_asked_needs_no_reason() {
    let told = explain(&felt(), &one());
    assert!(told.reasons.is_empty() && told.summary.contains("5.00 N"), "{told:?}");
    assert_eq!(told.chain.last().unwrap().force_W_N, Some(Vector3::new(-5.0, 0.0, 0.0)));
}

#[test]
fn each_way_has_its_first_reason() {
    let observer = Circumstances { asked_by: Some(Role::Observer), ..one() };
    let ran_out = |s| Circumstances { ran_out_s: Some(s), ..one() };
    let gain = |force_gain| Circumstances { force_gain, ..one() };
    let range = Circumstances { range_N: Some(80.0), ..one() };
    let fault = Report { mode: Mode::Fault, fault: Some(Fault::Closure), ..free() };
    let with = |limit| Report { limits: limited(limit), ..felt() };
    let against = Report { requested: wrench(5.0), ..free() };
    let away = Report { region: Some(Region::NotDisplayable), ..against };
    let slid = Report { law: Some(Strategy::Sliding), ..away };
    let told = explain(&slid, &one()).reasons;
    assert!(told.iter().all(|(why, _)| *why != Reason::NotDisplayable), "{told:?}");
    let unknown = Report { rendered_source: RenderedSource::Unknown, ..felt() };
    let cases = [
        (fault, one(), Reason::Fault),
        (Report { mode: Mode::Disabled, ..free() }, one(), Reason::Disabled),
        (Report { mode: Mode::Disabled, homed: false, ..free() }, one(), Reason::NotHomed),
        (Report { mode: Mode::Stopped, ..free() }, one(), Reason::Stopped),
        (Report { limits: limited(Limit::Clutch), ..free() }, one(), Reason::Clutched),
        (with(Limit::Stale), one(), Reason::Stale),
        (free(), ran_out(3.0), Reason::Stale),
        (free(), ran_out(100.0), Reason::NothingTouched),
        (felt(), gain(0.0), Reason::NoGain),
        (felt(), gain(0.5), Reason::Gain),
        (free(), observer.clone(), Reason::Observer),
        (free(), Circumstances { controller: Some("sim"), ..observer }, Reason::NothingTouched),
        (free(), Circumstances::default(), Reason::NoScene),
        (free(), one(), Reason::NothingTouched),
        (free(), one_at(-0.01, false), Reason::GivenAway),
        (free(), one_at(4.0, true), Reason::OutOfReach),
        (Report { command_seq: 4, ..free() }, Circumstances::default(), Reason::NothingTouched),
        (away, one(), Reason::NotDisplayable),
        (Report { limits: limited(Limit::Freedom), ..against }, one(), Reason::OutsideFreedoms),
        (with(Limit::Force), one(), Reason::ForceLimit),
        (with(Limit::Force), range, Reason::DeviceRange),
        (with(Limit::Torque), one(), Reason::TorqueLimit),
        (with(Limit::Stiffness), one(), Reason::Softened),
        (with(Limit::Passivity), one(), Reason::HeldBack),
        (with(Limit::Activation), one(), Reason::Activation),
        (with(Limit::Slew), one(), Reason::Slew),
        (with(Limit::Constraints), one(), Reason::TooManyContacts),
        (Report { region: Some(Region::Approximate), ..felt() }, one(), Reason::Approximate),
        (Report { stuck: true, ..felt() }, one(), Reason::Stuck),
        (unknown, one(), Reason::Unmeasured),
    ];
    for (report, circumstances, first) in cases {
        let told = explain(&report, &circumstances);
        assert_eq!(told.reasons.first().map(|(why, _)| *why), Some(first), "{told:?}");
        assert!(told.summary.ends_with(&told.reasons[0].1));
        assert!(told.reasons.is_sorted_by_key(|(why, _)| *why), "{told:?}");
        assert!(told.reasons.iter().all(|(_, why)| why.ends_with('.') && !why.contains("  ")));
    }
}

#[test]
fn a_disabled_device_without_a_scene_names_both_the_deciding_one_first() {
    let told = explain(&Report { mode: Mode::Disabled, ..free() }, &Circumstances::default());
    let names: Vec<_> = told.reasons.iter().map(|(why, _)| *why).collect();
    assert_eq!(names, [Reason::Disabled, Reason::NoScene]);
    assert!(told.summary.starts_with("Nothing is felt. The device is disabled"));
}

#[test]
fn sentences_carry_the_numbers() {
    let range = Circumstances { range_N: Some(78.25), force_gain: 0.5, ..one() };
    let asked = Report { requested: wrench(400.0), limits: limited(Limit::Force), ..felt() };
    assert!(explain(&asked, &range).summary.contains("200.0 N are asked, more than the 78.2 N"));
    let told = explain(&free(), &one_at(0.0123, false)).summary;
    assert!(told.contains("wall is 12.3 mm away"), "{told}");
    let told = explain(&free(), &one_at(4.25, true)).summary;
    assert!(told.contains("Out of range") && told.contains("wall is 4.250 m away"), "{told}");
}

#[test]
fn what_is_held_back_is_told_with_what_is_missing() {
    let limits = limited(Limit::Passivity);
    let told = explain(&Report { limits, force_error_N: Some(2.25), ..felt() }, &one()).summary;
    assert!(told.contains("more energy than the hand put into it"), "{told}");
    assert!(told.contains("2.2 N are missing"), "{told}");
}

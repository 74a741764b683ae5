//! Settings of a running device: taken and in range, or refused by name and nothing changed.

use std::sync::OnceLock;

use hapticd::actuation::Strategy;
use hapticd::config::{DeviceDefinition, Scene, Setting, Settings, plan_with};
use hapticd::control::{ControlState, Mode, TickInput, tick};

use crate::script::Script;
use crate::ticks;

fn device() -> &'static DeviceDefinition {
    static DEVICE: OnceLock<DeviceDefinition> = OnceLock::new();
    DEVICE.get_or_init(|| DeviceDefinition::load("cho-2005").expect("built in"))
}

/// A script of settings, set one after another; then a few ticks with them.
pub fn check(data: &[u8]) {
    let script = &mut Script::new(data);
    let device = device();
    let mut settings = Settings::of(device);
    while !script.is_over() {
        let setting = setting(script);
        let before = settings;
        match settings.set("field", &setting) {
            Ok(()) => check_ranges(&settings),
            Err(refusal) => {
                assert!(refusal.field.starts_with("field"), "{refusal}");
                assert_eq!(settings, before, "{setting:?}: a refusal changes nothing");
            }
        }
    }
    let plan = plan_with(device, &settings, &Scene::default());
    let mut state = ControlState::new(Mode::Enabled);
    let sample = ticks::sample_at(&plan, device.start_m[0], device.start_m[1]);
    for number in 1..4 {
        let sample = Ok(sample.expect("the start was checked"));
        let input = TickInput::uncommanded(sample, &plan, number * plan.tick_ns);
        ticks::check_commands(&plan, &tick(&mut state, &input));
    }
}

fn setting(script: &mut Script<'_>) -> Setting {
    let whole = |script: &mut Script<'_>| match script.u8() {
        0..=199 => i64::from(script.u16()),
        200..=227 => -i64::from(script.u16()),
        _ => script.u64() as i64,
    };
    match script.below(17) {
        0 => Setting::Strategy(script.one_of(&Strategy::ALL)),
        1 => Setting::ForceLimit_N(script.number(0.1, 1e4)),
        2 => Setting::ForceGain(script.number(0.0, 1.0)),
        3 => Setting::ActivationRamp_ms(script.number(0.0, 1e4)),
        4 => Setting::Slew_N_per_s(script.number(1.0, 1e9)),
        5 => Setting::StaleRamp_ms(script.number(0.0, 1e4)),
        6 => Setting::ClosureLimit_rad(script.number(1e-4, 3.0)),
        7 => Setting::StopCapacity_Nm(script.number(0.0, 1e3)),
        8 => Setting::MaxOverruns(whole(script)),
        9 => Setting::MaxDeviceErrors(whole(script)),
        10 => Setting::MountPosition_m([(); 3].map(|()| script.number(-100.0, 100.0))),
        11 => Setting::MountOrientation_xyzw(orientation(script)),
        12 => Setting::ToolOffset_m([(); 3].map(|()| script.number(-1.0, 1.0))),
        13 => Setting::ToolRadius_m(script.number(0.0, 0.1)),
        14 => Setting::PassivityReserve_J(script.number(1e-3, 1e3)),
        15 => Setting::PassivityPower_W(script.number(0.0, 1e3)),
        _ => {
            let point = |script: &mut Script<'_>| [(); 3].map(|()| script.number(-1.0, 1.0));
            Setting::ToolPoints_m((0..script.below(10)).map(|_| point(script)).collect())
        }
    }
}

/// Of length 1 as a rule.
fn orientation(script: &mut Script<'_>) -> [f64; 4] {
    let raw = [(); 4].map(|()| script.number(-1.0, 1.0));
    let length = raw.iter().map(|part| part * part).sum::<f64>().sqrt();
    if script.rarely(4) { raw } else { raw.map(|part| part / length) }
}

/// Every number is finite and what a tick divides by is not zero.
fn check_ranges(settings: &Settings) {
    let Settings { guards, mount, tool, .. } = settings;
    assert!((0.1..=1e4).contains(&guards.force_limit_N));
    assert!((0.0..=1.0).contains(&guards.force_gain));
    assert!((1.0..=1e9).contains(&guards.slew_N_per_s));
    assert!((0.0..=1e3).contains(&guards.stop_capacity_Nm));
    assert!((1e-3..=1e3).contains(&guards.passivity_reserve_J));
    assert!((0.0..=1e3).contains(&guards.passivity_power_W));
    assert!(guards.closure_limit_rad > 0.0 && guards.closure_limit_rad < 3.2);
    assert!(guards.activation_ramp_ns <= 10_000_000_000 && guards.stale_ramp_ns <= 10_000_000_000);
    assert!((1..=1_000_000).contains(&guards.max_overruns));
    assert!((1..=100).contains(&guards.max_device_errors));
    assert!(mount.p_WB_m.iter().all(|part| part.abs() <= 100.0));
    assert!((mount.q_WB.coords.norm() - 1.0).abs() < 1e-9);
    assert!(tool.offset_B_m.iter().all(|part| part.abs() <= 1.0));
    assert!((0.0..=0.1).contains(&tool.radius_m));
    assert!(tool.points_T_m().iter().flatten().all(|part| part.abs() <= 1.0));
}

//! What a controller fed to a handle through motors is part of what is recorded.

use super::*;
use crate::control::{Limit, Wrench};

/// A controller on `singh` that pushes the handle wherever it goes, until it is held back.
fn fed() -> Vec<u8> {
    let mut world = World::of("singh", true, 0);
    let deliveries = world.begin(1, 10_000 * MS);
    world.snapshot(2);
    let mut force_N = Vector3::new(5.0, 0.0, 0.0);
    for i in 0..1_500 {
        world.send(Setpoint::NONE.with_wrench(Wrench { force_N, ..Wrench::default() }));
        // A state in the middle, when the account is empty.
        if i == 800 {
            world.snapshot(0);
        }
        let record = world.unobserved_tick();
        world.recorder.observe(&record);
        world.recorder.flush();
        let v = record.report.v_WT_m_per_s;
        force_N = v.try_normalize(1e-3).map_or(force_N, |along| 5.0 * along);
        for (_, message) in std::mem::take(&mut world.late) {
            world.tell.send(message).unwrap();
        }
    }
    world.recorder.finish();
    file_of(deliveries)
}

#[test]
fn what_was_held_back_is_replayed_to_the_last_bit_also_from_a_state_on_the_way() {
    let bytes = fed();
    let recorded = Recorded::read(bytes.clone()).unwrap();
    let bit = 1 << Limit::Passivity as u32;
    let held_back = recorded.reports().filter(|(_, report)| report.limits & bit != 0).count();
    assert!(held_back > 300, "{held_back} ticks");
    let verdict = replay(&recorded);
    assert!(verdict.is_bit_equal() && verdict.equal > 1_400, "{verdict:?}");
    // Without a tick before the second state the replay begins again there.
    let mut all = entries(&bytes);
    all.retain(|entry| !matches!(&entry.entry, Some(Entry::Tick(tick)) if tick.tick == 700));
    let verdict = replay(&Recorded::read(bytes_of(all)).unwrap());
    assert!(verdict.difference.is_none() && verdict.gaps.len() == 1, "{verdict:?}");
    assert!((1_390..1_400).contains(&verdict.equal), "{verdict:?}");
}

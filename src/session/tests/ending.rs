//! Why a force ends, each reason counted once; what a bad path may command; events seen.

use super::*;
use crate::proto::{Ack, WrenchCommand};

fn wrench_command(seq: u64, ttl_ms: u32) -> Command {
    let body = command::Body::Wrench(WrenchCommand { wrench: vec![1.0, 0.0, 0.0] });
    Command { ttl_ms, body: Some(body), ..wall_command(seq, 0, 0) }
}

/// The tick's word that a force ran out.
fn ran_out(tick: u64) -> Report {
    let mut stale = report(tick);
    (stale.events[0], stale.last_event) = (Some(Event::Stale), tick);
    stale
}

fn ends(sessions: &Sessions) -> Vec<(&'static str, u64)> {
    let counted = StaleReason::ALL.map(|reason| (reason.name(), sessions.counters().stale(reason)));
    counted.into_iter().filter(|(_, count)| *count > 0).collect()
}

#[test]
fn each_ended_force_has_one_reason() {
    type Story = fn(&mut Sessions, SessionId);
    let stories: [(&str, Story); 7] = [
        ("ttl", |_, _| ()),
        ("missed", |sessions, id| {
            sessions.on_datagram(id, &datagram(wrench_command(300, 200)), 300 * MS);
        }),
        ("disconnected", |sessions, id| sessions.disconnect(id, 301 * MS)),
        ("quality", |sessions, id| {
            // One of ten comes, until the path is known to be bad.
            for seq in (310..800).step_by(10) {
                sessions.on_datagram(id, &datagram(wrench_command(seq, 0)), 302 * MS);
            }
        }),
        ("age", |sessions, id| {
            let late = Command { state_seq: 1, ..wrench_command(301, 0) };
            sessions.on_datagram(id, &datagram(late), 303 * MS);
        }),
        ("released", |sessions, id| {
            sessions.on_message(id, say(Body::Bye(crate::proto::Bye::default())), 304 * MS);
        }),
        ("taken_over", |sessions, _| {
            let taker = Hello { takeover: true, ..hello("taker", Role::Controller) };
            meet(sessions, taker, 304 * MS);
        }),
    ];
    for (expected, story) in stories {
        let mut sessions = sessions();
        let id = join(&mut sessions, "first", Role::Controller, 250 * MS);
        (1..=300).for_each(|tick| sessions.on_report(&report(tick), tick * MS));
        sessions.on_datagram(id, &datagram(wall_command(299, 0, 300)), 300 * MS);
        story(&mut sessions, id);
        let setpoint = setpoints(&drain(&mut sessions)).pop();
        // The tick says that a force ran out, unless it was let go.
        let released = setpoint.is_some_and(|setpoint| setpoint.released);
        sessions.on_report(&if released { report(420) } else { ran_out(420) }, 420 * MS);
        assert_eq!(ends(&sessions), [(expected, 1)]);
    }
}

#[test]
fn a_command_from_an_old_state_is_refused_and_tells_why_but_a_newer_one_is_taken() {
    let mut sessions = sessions();
    let id = join(&mut sessions, "late", Role::Controller, 0);
    for tick in 1..=1500 {
        sessions.on_report(&report(tick), tick * MS);
        drain(&mut sessions);
    }
    let wall = |seq, state_seq| wall_command(seq, 0, state_seq);
    let wrench = |seq, state_seq| Command { state_seq, ..wrench_command(seq, 0) };
    for (command, outcome) in [
        (wrench(1, 1299), Outcome::Stale),
        (wrench(2, 0), Outcome::Stale),
        (wrench(3, 1300), Outcome::Accepted),
        (wall(4, 500), Outcome::Accepted),
        (wall(5, 499), Outcome::Stale),
        (wall(6, 0), Outcome::Stale),
    ] {
        let before = count(&sessions, outcome);
        sessions.on_datagram(id, &datagram(command.clone()), 1500 * MS);
        assert_eq!(count(&sessions, outcome), before + 1, "{command:?}");
    }
    let info = sessions.list(1500 * MS).next().unwrap();
    let refusal = info.last_refusal.unwrap().to_string();
    assert_eq!(refusal, "state_seq = none: must be a State at most 1000 ms old");
}

/// Commands of which only some come; returns what the last hundred came to.
fn over_a_path(loss_of_ten: u64, wrench: bool) -> [u64; 2] {
    let mut sessions = sessions();
    let id = join(&mut sessions, "far", Role::Controller, 0);
    let mut before = [0; 2];
    let counted =
        |sessions: &Sessions| [Outcome::Accepted, Outcome::Quality].map(|o| count(sessions, o));
    for seq in (1..2000).filter(|seq| seq * 7 % 10 >= loss_of_ten) {
        let command = if wrench { wrench_command(seq, 0) } else { wall_command(seq, 0, 0) };
        sessions.on_datagram(id, &datagram(command), seq * MS);
        if seq < 1000 {
            before = counted(&sessions);
        }
    }
    let after = counted(&sessions);
    [after[0] - before[0], after[1] - before[1]]
}

#[test]
fn direct_forces_need_a_good_path_and_contacts_none() {
    let refused = |loss_of_ten, wrench| {
        let [taken, refused] = over_a_path(loss_of_ten, wrench);
        assert!(taken == 0 || refused == 0, "{taken} {refused}");
        refused > 0
    };
    assert_eq!([0, 1, 2, 5].map(|loss| refused(loss, true)), [false, true, true, true]);
    assert_eq!([0, 1, 2, 5].map(|loss| refused(loss, false)), [false; 4]);
}

#[test]
fn events_ride_in_state_until_either_kind_of_acknowledgement() {
    let mut sessions = sessions();
    let mut pressed = report(1);
    (pressed.events[0], pressed.last_event) = (Some(Event::Button(1)), 1);
    sessions.on_report(&pressed, MS);
    let controller = join(&mut sessions, "controller", Role::Controller, MS);
    let observer = join(&mut sessions, "observer", Role::Observer, MS);
    let riding = |sessions: &mut Sessions, tick: u64, event: Option<Event>| {
        let mut report = report(tick);
        (report.events[0], report.last_event) = (event, 1 + tick / 2);
        sessions.on_report(&report, tick * MS);
        let states = states(&drain(sessions));
        states.into_iter().map(|(_, state)| state.event_id).collect::<Vec<_>>()
    };
    assert_eq!(riding(&mut sessions, 2, Some(Event::StuckBegin)), [vec![2], vec![2]], "not 1");
    assert_eq!(riding(&mut sessions, 3, None), [vec![2], vec![2]], "again");
    let acknowledging = Command { event_ack: 2, ..wall_command(1, 0, 0) };
    sessions.on_datagram(controller, &datagram(acknowledging), 3 * MS);
    assert_eq!(riding(&mut sessions, 4, Some(Event::StuckEnd)), [vec![3], vec![2, 3]]);
    for event_id in [3, 2, 0] {
        let ack = wire::encode(&DatagramBody::Ack(Ack { event_id }));
        sessions.on_datagram(observer, &ack, 4 * MS);
    }
    assert_eq!(
        riding(&mut sessions, 5, None),
        [vec![3], vec![]],
        "an older one takes nothing back"
    );
    assert_eq!(riding(&mut sessions, 5_010, None), [Vec::<u64>::new(), vec![]], "long ago");
}

#[test]
fn detail_is_for_those_who_asked() {
    let mut sessions = sessions();
    let detailed = Hello { detail: true, ..hello("detailed", Role::Observer) };
    let (_, outputs) = meet(&mut sessions, detailed, 0);
    assert!(welcome(&outputs).is_some());
    join(&mut sessions, "plain", Role::Observer, 0);
    let mut report = report(1);
    report.shaft_rad[1] = 0.5;
    report.bounds.lower_Nm[3] = -20.0;
    report.commanded_Nm[2] = 7.0;
    sessions.on_report(&report, MS);
    let states: Vec<_> = states(&drain(&mut sessions)).into_iter().map(|(_, s)| s).collect();
    assert_eq!(states[0].actuator_rad, [0.0, 0.5, 0.0, 0.0], "one per actuator");
    assert_eq!(states[0].actuator_lower_nm, [0.0, 0.0, 0.0, -20.0]);
    assert_eq!(states[0].actuator_commanded_nm, [0.0, 0.0, 7.0, 0.0]);
    assert!(states[1].actuator_rad.is_empty() && states[1].actuator_upper_nm.is_empty());
}

//! Sessions opened, closed and given the lease by calls.

use super::*;
use crate::session::{CallRefusal, LeaseInfo, Ticket};

const TICKET: Ticket = [7; 16];

fn board() -> Switchboard {
    let config = |name| SessionConfig { takes_hands: true, ..SessionConfig::new(name, MS, 2, 4) };
    Switchboard::new(vec![config("left"), config("right")])
}

fn to(device: &str, role: Role) -> Hello {
    Hello { device: format!("devices/{device}"), ..hello("caller", role) }
}

fn outputs(board: &mut Switchboard) -> Vec<Output> {
    std::iter::from_fn(|| board.poll_output()).map(|(_, output)| output).collect()
}

fn with_ticket(ticket: Ticket) -> StreamMessage {
    say(Body::Hello(Hello {
        versions: vec!["hapticd/1".into()],
        ticket: ticket.to_vec(),
        ..Hello::default()
    }))
}

fn named(welcome: &Welcome) -> SessionId {
    SessionId::parse(&welcome.session).unwrap()
}

#[test]
fn a_stream_joins_the_session_that_a_call_has_opened() {
    let mut board = board();
    let opened = board.open(&to("right", Role::Controller), TICKET, 0).unwrap();
    assert_eq!((opened.device.as_str(), opened.lease_epoch), ("devices/right", 1));
    // Until then it holds the lease, is sent nothing, and nobody else can command.
    board.device(1).unwrap().on_report(&report(1), MS);
    assert!(outputs(&mut board).is_empty());
    let rival = board.connect(Transport::Quic, MS).unwrap();
    board.on_message(rival, say(Body::Hello(to("right", Role::Controller))), MS);
    let refused = bye(&outputs(&mut board), rival).unwrap();
    assert_eq!(refused.0, ByeReason::LeaseHeld);

    let newcomer = board.connect(Transport::Quic, 800 * MS).unwrap();
    // Its first command answers no State, and is as old as the joining, not as the call.
    let late_ns = 900 * MS;
    let joined = board.on_message(newcomer, with_ticket(TICKET), late_ns);
    assert_eq!(joined, named(&opened));
    let welcomed = outputs(&mut board);
    let again = welcome(&welcomed).unwrap();
    assert_eq!((&again.session, again.lease_epoch), (&opened.session, 1));
    board.on_datagram(joined, &datagram(wall_command(1, 0, 0)), late_ns + MS);
    assert_eq!(setpoints(&outputs(&mut board)).len(), 1);
    board.device(1).unwrap().on_report(&report(4), 4 * MS);
    assert!(states(&outputs(&mut board)).iter().all(|(to, _)| *to == joined));
}

#[test]
fn a_ticket_is_good_once_and_for_ten_seconds() {
    let join = |board: &mut Switchboard, ticket, now_ns| {
        let id = board.connect(Transport::Quic, now_ns).unwrap();
        let known_as = board.on_message(id, with_ticket(ticket), now_ns);
        (id, known_as, bye(&outputs(board), id))
    };
    let mut board = board();
    let opened = board.open(&to("left", Role::Observer), TICKET, 0).unwrap();
    let (id, known_as, refused) = join(&mut board, [8; 16], MS);
    assert_eq!((id, refused.unwrap().0), (known_as, ByeReason::Invalid));
    let newcomer = board.connect(Transport::Quic, MS).unwrap();
    let other = say(Body::Hello(Hello { ticket: TICKET.to_vec(), ..Hello::default() }));
    assert_eq!(board.on_message(newcomer, other, MS), newcomer);
    assert_eq!(bye(&outputs(&mut board), newcomer).unwrap().0, ByeReason::Version);
    assert_eq!(join(&mut board, TICKET, 2 * MS).1, named(&opened));
    let (id, known_as, refused) = join(&mut board, TICKET, 3 * MS);
    assert!(id == known_as && refused.unwrap().1.contains("ticket"));

    board.open(&to("left", Role::Controller), [9; 16], 0).unwrap();
    for second in 1..=9 {
        board.on_timeout(second * S);
    }
    assert_eq!(board.device(0).unwrap().lease().epoch, 1);
    board.on_timeout(10 * S);
    assert_eq!(board.device(0).unwrap().lease(), LeaseInfo { holder: None, epoch: 0 });
    outputs(&mut board);
    let (_, _, refused) = join(&mut board, [9; 16], 10 * S);
    assert!(refused.unwrap().1.contains("not within 10 s"));
}

#[test]
fn what_a_hello_would_be_refused_for_a_call_is_refused_for_and_leaves_nothing() {
    let mut board = board();
    let unknown = board.open(&to("middle", Role::Observer), TICKET, 0);
    let CallRefusal::Refused { reason, .. } = unknown.unwrap_err() else { panic!() };
    assert_eq!(reason, ByeReason::UnknownDevice);
    let bad = Hello { command_interval_us: 1, ..to("left", Role::Controller) };
    let said = board.open(&bad, TICKET, 0).unwrap_err().to_string();
    assert!(said.contains("command_interval_us = 1"), "{said}");
    assert_eq!(board.devices().map(Sessions::connections).sum::<usize>(), 0);
    assert!(outputs(&mut board).is_empty());
}

#[test]
fn the_lease_is_given_taken_and_let_go_by_calls() {
    let mut board = board();
    let [one, two] = ["one", "two"].map(|_| {
        let id = board.connect(Transport::Quic, 0).unwrap();
        board.on_message(id, say(Body::Hello(to("left", Role::Observer))), 0);
        id
    });
    outputs(&mut board);
    assert_eq!(board.acquire_lease(one, false, MS), Ok(LeaseInfo { holder: Some(one), epoch: 1 }));
    assert_eq!(lease_news(&outputs(&mut board), two), [1]);
    // Asked again it is the same lease, and nothing is told.
    assert_eq!(board.acquire_lease(one, true, MS), Ok(LeaseInfo { holder: Some(one), epoch: 1 }));
    assert!(outputs(&mut board).is_empty());
    board.on_datagram(one, &datagram(wall_command(1, 0, 0)), 2 * MS);
    assert_eq!(setpoints(&outputs(&mut board)).len(), 1);

    let held = board.acquire_lease(two, false, 3 * MS).unwrap_err().to_string();
    assert!(held.contains(&format!("{one} (\"caller\") holds the lease")), "{held}");
    assert_eq!(board.acquire_lease(two, true, 3 * MS).unwrap().epoch, 2);
    assert!(setpoints(&outputs(&mut board)).iter().all(|setpoint| setpoint.released));
    board.on_datagram(one, &datagram(wall_command(2, 0, 0)), 4 * MS);
    assert!(setpoints(&outputs(&mut board)).is_empty(), "it only observes now");

    assert_eq!(board.release_lease(one, 5 * MS), Err(CallRefusal::NoLease(one)));
    board.on_datagram(two, &datagram(wall_command(1, 0, 0)), 5 * MS);
    assert_eq!(board.release_lease(two, 6 * MS), Ok(LeaseInfo { holder: None, epoch: 0 }));
    let let_go = outputs(&mut board);
    assert!(setpoints(&let_go).last().unwrap().released);
    assert_eq!(lease_news(&let_go, one), [0]);
}

#[test]
fn a_closed_session_is_told_and_who_is_not_there_is_unknown() {
    let mut board = board();
    let id = board.connect(Transport::Quic, 0).unwrap();
    // Not welcomed yet: no call knows it.
    assert_eq!(board.close(id, 0), Err(CallRefusal::Unknown(id.to_string())));
    board.on_message(id, say(Body::Hello(to("right", Role::Hand))), 0);
    outputs(&mut board);
    assert_eq!(board.acquire_lease(id, true, 0), Err(CallRefusal::Hand(id)));
    board.close(id, MS).unwrap();
    assert_eq!(bye(&outputs(&mut board), id).unwrap().0, ByeReason::Closed);
    assert_eq!(board.close(id, MS), Err(CallRefusal::Unknown(id.to_string())));
}

#[test]
fn a_name_is_a_session_in_one_way_only() {
    assert_eq!(SessionId::parse("sessions/17"), Some(SessionId(17)));
    for bad in ["17", "sessions/", "sessions/+17", "sessions/017", "sessions/x", "sessions/-1"] {
        assert_eq!(SessionId::parse(bad), None, "{bad}");
    }
}

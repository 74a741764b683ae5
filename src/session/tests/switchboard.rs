//! Several devices of one server: a client belongs to the one that its Hello names.

use super::*;

fn board() -> Switchboard {
    let config = |name| SessionConfig { max_sessions: 3, ..SessionConfig::new(name, MS, 2, 4) };
    Switchboard::new(vec![config("left"), config("right")])
}

/// What is to be done, device by device.
fn drain(board: &mut Switchboard) -> [Vec<Output>; 2] {
    let mut outputs = [const { Vec::new() }; 2];
    while let Some((device, output)) = board.poll_output() {
        outputs[device].push(output);
    }
    outputs
}

fn meet(board: &mut Switchboard, device: &str, role: Role) -> (SessionId, [Vec<Output>; 2]) {
    let id = board.connect(Transport::Quic, 0).unwrap();
    let hello = Hello { device: device.into(), ..hello("client", role) };
    board.on_message(id, say(Body::Hello(hello)), 0);
    (id, drain(board))
}

#[test]
fn each_device_has_its_own_lease_and_sends_state_to_its_own_sessions_only() {
    let mut board = board();
    let (left, welcomed) = meet(&mut board, "devices/left", Role::Controller);
    assert_eq!(welcome(&welcomed[0]).unwrap().device, "devices/left");
    let (right, welcomed) = meet(&mut board, "devices/right", Role::Controller);
    let Welcome { device, session, lease_epoch, .. } = welcome(&welcomed[1]).unwrap();
    assert_eq!((device.as_str(), *lease_epoch), ("devices/right", 1));
    assert_ne!(left, right);
    assert_eq!(*session, right.to_string());

    for tick in 1..=3 {
        board.device(1).unwrap().on_report(&report(tick), tick * MS);
    }
    let [none, some] = drain(&mut board);
    assert!(states(&none).is_empty());
    assert!(states(&some).iter().all(|(to, _)| *to == right) && !some.is_empty());

    board.on_datagram(right, &datagram(wall_command(1, 0, 3)), 3 * MS);
    let [none, some] = drain(&mut board);
    assert!(setpoints(&none).is_empty());
    assert_eq!(setpoints(&some).len(), 1);
    assert_eq!(board.list(3 * MS).map(|session| session.id).collect::<Vec<_>>(), [left, right]);
}

#[test]
fn a_hello_to_no_device_or_an_unknown_one_is_told_which_there_are() {
    for (device, value) in [("", "(none)"), ("devices/middle", "devices/middle"), ("left", "left")]
    {
        let mut board = board();
        let (id, outputs) = meet(&mut board, device, Role::Observer);
        let (reason, detail) = bye(&outputs.concat(), id).expect("refused");
        assert_eq!(reason, ByeReason::UnknownDevice);
        let said = format!("device = {value}: must be devices/left or devices/right");
        assert_eq!(detail, said);
    }
}

#[test]
fn a_second_hello_takes_nobody_to_another_device() {
    let mut board = board();
    let (id, _) = meet(&mut board, "devices/left", Role::Controller);
    let hello = Hello { device: "devices/right".into(), ..hello("client", Role::Controller) };
    board.on_message(id, say(Body::Hello(hello)), MS);
    let outputs = drain(&mut board);
    let (reason, detail) = bye(&outputs[0], id).expect("it broke the protocol");
    assert_eq!((reason, detail.as_str()), (ByeReason::Invalid, "a second Hello"));
    assert!(outputs[1].is_empty());
    // The device that it named is free for the next.
    let (_, welcomed) = meet(&mut board, "devices/right", Role::Controller);
    assert!(welcome(&welcomed[1]).is_some());
}

#[test]
fn all_devices_together_take_so_many_clients() {
    let mut board = board();
    let ids: Vec<_> = ["left", "right", "right"]
        .map(|device| meet(&mut board, &format!("devices/{device}"), Role::Observer).0)
        .to_vec();
    assert_eq!(board.connect(Transport::Quic, 0), Err(TooManySessions { most: 3 }));
    board.disconnect(ids[2], MS);
    assert!(board.connect(Transport::Quic, MS).is_ok());
}

#[test]
fn silence_and_the_end_of_the_server_reach_every_device() {
    let mut board = board();
    let newcomer = board.connect(Transport::Quic, 0).unwrap();
    let (watcher, _) = meet(&mut board, "devices/right", Role::Observer);
    assert!(board.next_timeout().unwrap() <= 10 * S);
    board.on_timeout(10 * S);
    let outputs = drain(&mut board);
    assert_eq!(bye(&outputs[0], newcomer).map(|(reason, _)| reason), Some(ByeReason::Silent));
    assert_eq!(bye(&outputs[1], watcher).map(|(reason, _)| reason), Some(ByeReason::Silent));

    let (left, _) = meet(&mut board, "devices/left", Role::Observer);
    let (right, _) = meet(&mut board, "devices/right", Role::Observer);
    board.shutdown(3 * S);
    let outputs = drain(&mut board);
    assert_eq!(bye(&outputs[0], left).map(|(reason, _)| reason), Some(ByeReason::Shutdown));
    assert_eq!(bye(&outputs[1], right).map(|(reason, _)| reason), Some(ByeReason::Shutdown));
}

#[test]
fn who_says_nothing_makes_room_for_a_newcomer_and_who_was_welcomed_does_not() {
    let mut board = board();
    let silent: Vec<_> = (0..3).map(|i| board.connect(Transport::Quic, i).unwrap()).collect();
    let first = |newcomers: &[SessionId]| {
        assert_eq!(newcomers, silent, "the oldest first");
        Some(0)
    };
    board.make_room(first, 3);
    let newcomer = board.connect(Transport::Quic, 3).unwrap();
    let outputs = drain(&mut board).concat();
    let (reason, detail) = bye(&outputs, silent[0]).expect("the first");
    assert_eq!(reason, ByeReason::TooManySessions);
    assert!(detail.contains("before you said Hello"), "{detail}");
    assert!(bye(&outputs, silent[1]).is_none() && bye(&outputs, newcomer).is_none());
    for id in [silent[1], silent[2], newcomer] {
        let hello = Hello { device: "devices/left".into(), ..hello("client", Role::Observer) };
        board.on_message(id, say(Body::Hello(hello)), 4);
    }
    board.make_room(|_| Some(0), 5);
    assert_eq!(board.connect(Transport::Quic, 5), Err(TooManySessions { most: 3 }));
    assert_eq!(board.list(5).count(), 3);
}

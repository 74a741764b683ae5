//! Sessions over real QUIC: a wall that is felt, who may command, and how a session ends.

use std::process::Stdio;
use std::time::Duration;

use hapticd::client::{Client, ClientError, ConnectString, Incoming, Options};
use hapticd::control::Guards;
use hapticd::proto::{ByeReason, EventKind, Limit, Mode, Role, SessionState, State};

use super::support::{Rig, command_until, hapticd, next_state, state_where, wait_until, wall_at};

/// The stiffness of [`wall_at`].
const WALL_N_PER_M: f32 = 1e7;

/// Time-to-live of `scene wall`.
const TTL_NS: u64 = 200_000_000;

fn touches_wall(state: &State) -> bool {
    state.contact_id == [1]
}

fn why<T>(result: Result<T, ClientError>) -> (ByeReason, String) {
    match result {
        Err(ClientError::Bye { reason, detail }) => (reason, detail),
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("no Bye"),
    }
}

#[test]
fn a_controllers_wall_is_asked_for_and_reported() {
    let rig = Rig::start();
    rig.run(async {
        let mut client = rig.client("needle trainer", Role::Controller).await;
        let welcome = client.welcome().clone();
        assert_eq!(
            (welcome.device.as_str(), welcome.version.as_str()),
            ("devices/cho-2005", "hapticd/1")
        );
        assert_eq!((welcome.freedoms, welcome.actuators, welcome.tick_period_us), (2, 4, 1000));
        assert_eq!(welcome.grpc_port, u32::from(rig.target().grpc_port));
        assert_eq!((welcome.lease_epoch, welcome.scene_revision, welcome.max_ttl_ms), (1, 1, 200));

        let wall = [wall_at(0.29)];
        let state = command_until(&mut client, &wall, touches_wall).await;
        let depth_m = state.contact_depth_m[0];
        let asked_N = state.requested[0];
        let stiff_N = -WALL_N_PER_M * depth_m;
        assert!(depth_m > 0.0 && (asked_N / stiff_N - 1.0).abs() < 1e-3, "{asked_N} {stiff_N}");
        assert_eq!(state.requested[1..], [0.0, 0.0]);
        assert!(state.position_m[0] > 0.29 - 1e-6, "{:?}", state.position_m);
        let force_limit_N = Guards::default().force_limit_N as f32;
        assert!((0.0..=force_limit_N).contains(&state.contact_normal_n[0]));
        assert_eq!(
            (state.session_state(), state.mode()),
            (SessionState::Commanding, Mode::Enabled)
        );
        assert!(state.echo_client_time_ns > 0 && state.command_seq > 0);
        client.close().await;
    });
}

#[test]
fn a_contact_begins_with_an_event() {
    let rig = Rig::start();
    rig.run(async {
        let mut client = rig.client("events", Role::Controller).await;
        let mut last_id = 0;
        loop {
            match client.next().await.unwrap() {
                Incoming::State(state) => {
                    client.send_contacts(state.seq, 0, vec![wall_at(0.29)]).unwrap();
                }
                Incoming::Event(event) if event.kind() == EventKind::ContactBegin => {
                    assert_eq!(event.value, 1);
                    break;
                }
                Incoming::Event(event) if event.id != 0 => {
                    assert!(event.id > last_id, "events are numbered in order");
                    last_id = event.id;
                }
                Incoming::Event(_) | Incoming::RoundTrip(_) => {}
            }
        }
    });
}

#[test]
fn an_observer_sees_and_does_not_command() {
    let rig = Rig::start();
    rig.run(async {
        let mut observer = rig.client("window", Role::Observer).await;
        assert_eq!(observer.welcome().lease_epoch, 0);
        let (mut last_tick, mut sent) = (0, 0);
        while sent < 200 {
            let state = next_state(&mut observer).await;
            assert!(state.seq > last_tick, "states come in order");
            last_tick = state.seq;
            assert_eq!((state.command_seq, state.contact_id.len()), (0, 0));
            assert!(state.requested.iter().all(|part| *part == 0.0), "{:?}", state.requested);
            assert_eq!((state.position_m.len(), state.echo_client_time_ns), (3, 0));
            assert_eq!(state.session_state(), SessionState::Monitoring);
            observer.send_contacts(state.seq, 200, vec![wall_at(0.2)]).unwrap();
            sent += 1;
        }
        rig.wait_for_datagrams("not_allowed", 1.0);
        assert!(rig.scrape().datagrams("not_allowed") <= f64::from(sent));
        let state = next_state(&mut observer).await;
        assert_eq!((state.command_seq, state.contact_id.len()), (0, 0));
    });
}

#[test]
fn a_second_controller_is_told_who_commands_and_the_first_goes_on() {
    let rig = Rig::start();
    rig.run(async {
        let mut first = rig.client("first of all", Role::Controller).await;
        let wall = [wall_at(0.3)];
        command_until(&mut first, &wall, |state| state.command_seq >= 5).await;
        let options = Options::new("second", Role::Controller);
        let (reason, detail) = why(Client::connect(rig.target(), options).await);
        assert_eq!(reason, ByeReason::LeaseHeld);
        let holder = first.welcome().session.clone();
        assert!(detail.contains(&holder) && detail.contains("\"first of all\""), "{detail}");
        let before = next_state(&mut first).await.command_seq;
        command_until(&mut first, &wall, |state| state.command_seq >= before + 20).await;
        assert_eq!(rig.scrape().datagrams("not_allowed"), 0.0);
    });
}

#[test]
fn the_lease_passes_when_its_holder_leaves() {
    let rig = Rig::start();
    rig.run(async {
        let wall = [wall_at(0.3)];
        let mut first = rig.client("first", Role::Controller).await;
        command_until(&mut first, &wall, |state| state.command_seq >= 50).await;
        let epoch = first.welcome().lease_epoch;
        first.close().await;
        let mut second = rig.client("second", Role::Controller).await;
        assert!(second.welcome().lease_epoch > epoch);
        // Its numbers begin anew, and what the first had asked for is not in force.
        let state = next_state(&mut second).await;
        assert_eq!((state.command_seq, state.echo_client_time_ns), (0, 0));
        let state = command_until(&mut second, &wall, |state| state.command_seq >= 5).await;
        assert!(state.command_seq < 50, "{}", state.command_seq);
    });
}

/// What an observer saw of one tick.
struct Seen {
    time_ns: u64,
    command_seq: u64,
    touches: bool,
    normal_N: f32,
    fading: bool,
}

impl Seen {
    fn of(state: &State) -> Self {
        Self {
            time_ns: state.device_time_ns,
            command_seq: state.command_seq,
            touches: touches_wall(state),
            normal_N: state.contact_normal_n.first().copied().unwrap_or(0.0),
            fading: state.limits & 1 << (Limit::Stale as u32 - 1) != 0,
        }
    }
}

#[test]
fn a_controller_that_vanishes_keeps_its_force_for_its_time_to_live_and_its_ramp() {
    let rig = Rig::start();
    let mut scene = hapticd()
        .args(["scene", "wall", "--x", "0.29", "--connect", &rig.target().to_string()])
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let seen = rig.run(async {
        let mut observer = rig.client("witness", Role::Observer).await;
        state_where(&mut observer, |state| touches_wall(state) && state.buttons == 1).await;
        let mut seen = Vec::new();
        let mut quiet = 0;
        while quiet < 300 {
            let state = next_state(&mut observer).await;
            let gone = state.command_seq == 0 && !touches_wall(&state);
            quiet = if gone { quiet + 1 } else { 0 };
            assert!(seen.len() < 5_000, "its force stays");
            seen.push(Seen::of(&state));
            // Some ticks from before belong to the account.
            if seen.len() == 50 {
                scene.kill().unwrap();
            }
        }
        seen
    });
    scene.wait().unwrap();
    judge_fade(&seen);
    wait_until("the count of it", || {
        rig.scrape().value("hapticd_stale_total{device=\"cho-2005\",reason=\"ttl\"}") == 1.0
    });
    // Its session ends by silence, and the lease is free again.
    rig.run(async {
        loop {
            let options = Options::new("heir", Role::Controller);
            match Client::connect(rig.target(), options).await {
                Ok(heir) => break heir.close().await,
                Err(ClientError::Bye { reason: ByeReason::LeaseHeld, .. }) => {
                    tokio::time::sleep(Duration::from_millis(50)).await;
                }
                Err(other) => panic!("{other}"),
            }
        }
    });
}

/// In device time. The last command came after the last tick under the one before it, and
/// before the first tick under itself; a tick can be late by the largest gap that was seen.
fn judge_fade(seen: &[Seen]) {
    let ramp_ns = Guards::default().stale_ramp_ns;
    let gap_ns = seen.windows(2).map(|two| two[1].time_ns - two[0].time_ns).max().unwrap();
    let slack_ns = 2 * gap_ns + 2_000_000;
    let last_seq = seen.iter().map(|tick| tick.command_seq).max().unwrap();
    let first = seen.iter().position(|tick| tick.command_seq == last_seq).unwrap();
    let came_before_ns = seen[first].time_ns;
    assert!(first > 0, "the command before the last one was seen");
    let came_after_ns = seen[first - 1].time_ns;
    let stale = seen.iter().position(|tick| tick.command_seq == 0).unwrap();
    let last_touch = seen.iter().rposition(|tick| tick.touches).unwrap();

    let gone_after_ns = seen[last_touch].time_ns - came_before_ns;
    assert!(gone_after_ns <= TTL_NS + ramp_ns + slack_ns, "{gone_after_ns} ns, gaps {gap_ns} ns");
    let stale_after_ns = seen[stale].time_ns - came_after_ns;
    assert!(stale_after_ns + slack_ns >= TTL_NS, "stale after {stale_after_ns} ns");
    let kept_ns = seen[last_touch].time_ns - came_after_ns;
    assert!(kept_ns + slack_ns >= TTL_NS, "gone after {kept_ns} ns");

    let ms = |ns: u64| ns / 1_000_000;
    println!(
        "stale after {} ms, gone after {} to {} ms, longest gap {} ms",
        ms(stale_after_ns),
        ms(gone_after_ns),
        ms(kept_ns),
        ms(gap_ns)
    );

    let fade: Vec<_> = seen[stale..=last_touch].iter().filter(|tick| tick.touches).collect();
    assert!(fade.iter().all(|tick| tick.fading), "a fade is announced");
    // The hand may bounce; what may be asked only falls.
    let most_N = seen[..stale].iter().map(|tick| tick.normal_N).fold(0.0, f32::max);
    assert!(most_N > 0.0 && fade.iter().all(|tick| tick.normal_N <= most_N));
    if let [.., last] = fade[..] {
        let left_ns = (seen[stale].time_ns + ramp_ns).saturating_sub(last.time_ns) + slack_ns;
        let share = left_ns as f32 / ramp_ns as f32;
        assert!(last.normal_N <= most_N * share, "{} of {most_N} N at the end", last.normal_N);
    }
    assert!(seen[last_touch + 1..].iter().all(|tick| tick.normal_N == 0.0));
}

#[test]
fn a_server_with_another_certificate_is_not_talked_to() {
    let rig = Rig::start();
    rig.run(async {
        let mut wrong = rig.target().clone();
        wrong.sha256.as_mut().unwrap()[31] ^= 1;
        let options = Options::new("careful", Role::Observer);
        let refused = Client::connect(&wrong, options.clone()).await;
        assert!(matches!(refused, Err(ClientError::WrongServer { .. })), "{refused:?}");
        let elsewhere = ConnectString { host: "192.0.2.1".into(), sha256: None, ..wrong };
        let refused = Client::connect(&elsewhere, options.clone()).await;
        assert!(matches!(refused, Err(ClientError::HashNeeded { .. })), "{refused:?}");
        let right = rig.target().to_string().parse::<ConnectString>().unwrap();
        assert_eq!(&right, rig.target());
        assert!(right.sha256.is_some());
        Client::connect(&right, options).await.unwrap().close().await;
        let local = ConnectString::local(right.stream_port, right.grpc_port);
        let bare: ConnectString = format!("127.0.0.1:{}", right.stream_port).parse().unwrap();
        assert_eq!((bare.stream_port, bare.sha256), (local.stream_port, None));
        let options = Options::new("neighbour", Role::Observer);
        Client::connect(&bare, options).await.unwrap().close().await;
    });
}

#[test]
fn a_server_that_stops_says_so_to_everyone() {
    let rig = Rig::start();
    let (controller, observer) = rig.run(async {
        let mut controller = rig.client("controller", Role::Controller).await;
        command_until(&mut controller, &[], |state| state.command_seq >= 5).await;
        (controller, rig.client("observer", Role::Observer).await)
    });
    let listening = |mut client: Client| async move {
        loop {
            if let Err(error) = client.next().await {
                return why::<()>(Err(error));
            }
        }
    };
    let last_words = [rig.spawn(listening(controller)), rig.spawn(listening(observer))];
    let (runtime, _state) = rig.stop();
    for words in last_words {
        let (reason, detail) = runtime.block_on(words).unwrap();
        assert_eq!(reason, ByeReason::Shutdown, "{detail}");
    }
}

#[test]
fn one_session_too_many_is_refused_and_the_others_stay() {
    let rig = Rig::with(|config| config.session.max_sessions = 2);
    rig.run(async {
        let mut one = rig.client("one", Role::Controller).await;
        let two = rig.client("two", Role::Observer).await;
        let options = Options::new("three", Role::Observer);
        let (reason, detail) = why(Client::connect(rig.target(), options).await);
        assert_eq!(reason, ByeReason::TooManySessions);
        assert!(detail.contains("sessions = 2"), "{detail}");
        two.close().await;
        rig.client("three", Role::Observer).await.close().await;
        command_until(&mut one, &[], |state| state.command_seq >= 5).await;
    });
}

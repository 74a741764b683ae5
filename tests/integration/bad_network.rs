//! `hapticd netsim` between processes: every transport comes through, and it tells what it did.

use std::process::Stdio;

use hapticd::app::netsim::{Netsim, NetsimConfig};
use hapticd::client::{Client, ConnectString, Options, Transport};
use hapticd::impairment::Impairment;
use hapticd::proto::Role;
use rustix::process::Signal;
use serde_json::Value;

use super::support::{Rig, finish, first_line, hapticd, next_state, run, send, wait};

#[test]
fn a_wall_stands_behind_a_bad_network_over_each_transport() {
    let rig = Rig::start();
    let mut command = hapticd();
    command.args(["netsim", "--connect", &rig.target().to_string(), "--json"]);
    command.args(["--delay-ms", "5", "--loss-percent", "10", "--burst", "3"]);
    command.args(["--jitter-ms", "2", "--corrupt-percent", "1", "--duplicate-percent", "1"]);
    let told = tempfile::NamedTempFile::new().unwrap();
    command.stdin(Stdio::null()).stdout(told.reopen().unwrap()).stderr(Stdio::piped());
    let mut netsim = command.spawn().unwrap();
    let through = first_line(netsim.stderr.take().unwrap()).expect("the line to connect by");
    let through = through.trim_end();
    for transport in ["quic", "webtransport", "udp"] {
        let mut scene = hapticd();
        scene.args(["scene", "wall", "--seconds", "5", "--json", "--transport", transport]);
        let scene = finish(scene.args(["--connect", through]));
        assert_eq!(scene.code, Some(0), "{transport}: {scene:?}");
        let figures: Value = serde_json::from_str(&scene.stdout).unwrap();
        let figure = |name: &str| figures[name].as_f64().unwrap_or_else(|| panic!("{figures}"));
        // How often depends on what the hand is about.
        assert!(figure("touching_ratio") > 0.02, "{transport}: {figures}");
        assert!(figure("states_ratio") < 0.99, "nothing was lost? {transport}: {figures}");
        // There and back it is 10 ms, and on this machine it took something more.
        assert!(figure("rtt_p50_ms") >= 10.0, "{transport}: {figures}");
    }
    send(&netsim, Signal::INT);
    assert!(wait(&mut netsim).success());
    let told: Value = serde_json::from_reader(told.reopen().unwrap()).unwrap();
    for way in ["up", "down"] {
        let count = |name: &str| told[way][name].as_f64().unwrap();
        let lost = count("lost") / count("datagrams");
        assert!((0.05..0.2).contains(&lost), "{told}");
        assert!(count("damaged") > 0.0 && count("doubled") > 0.0, "{told}");
    }
}

/// What a congestion window that shrinks with every loss does not do: at 60 ms and 3 % it lets
/// through half.
#[test]
fn a_little_loss_on_a_long_way_costs_no_more_than_what_is_lost() {
    let rig = Rig::start();
    let (delay_ns, loss) = (30_000_000, 0.03);
    let config = NetsimConfig {
        listen: ([127, 0, 0, 1], 0).into(),
        target: ([127, 0, 0, 1], rig.target().stream_port).into(),
        impairment: Impairment { delay_ns, loss, ..Impairment::NONE },
        seed: 1,
    };
    let netsim = Netsim::start(config).unwrap();
    let through = ConnectString { stream_port: netsim.address.port(), ..rig.target().clone() };
    for transport in [Transport::Quic, Transport::WebTransport] {
        let states = rig.run(async {
            let options =
                Options { transport, every_state: true, ..Options::new("far", Role::Observer) };
            let mut client = Client::connect(&through, options).await.unwrap();
            let first = next_state(&mut client).await.seq;
            let (mut came, mut last) = (1, first);
            while last < first + 4_000 {
                last = next_state(&mut client).await.seq.max(last);
                came += 1;
            }
            f64::from(came) / (last - first + 1) as f64
        });
        // A tick whose report found a newer one has no State on a busy machine.
        assert!((0.85..0.99).contains(&states), "{transport}: {states}");
    }
}

#[test]
fn a_network_that_cannot_be_is_refused() {
    run(&["netsim", "--loss-percent", "101"]).refused(&["--loss-percent", "0 to 100 %"]);
    run(&["netsim", "--delay-ms", "-1"]).refused(&["--delay-ms", "0 to 10000 ms"]);
    run(&["netsim", "--connect", "nowhere.invalid:7351"]).refused(&["nowhere.invalid"]);
}

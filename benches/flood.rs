//! A million bad datagrams of each kind, as fast as one processor sends them: what does the loop
//! feel of it, what is sent back, what does it cost in memory, and what changes? Memory is that of
//! either half of a flood: what the second takes is growth, what the first takes may be a beginning.
//! *Slow*: how long the controller had fewer States afterwards, because its session slows down where
//! States were lost.
//!
//! The server is a process of its own. A controller holds a wall meanwhile and answers every
//! State. Before each flood there is a quiet run of the same setting; figures of the loop
//! compare with that. On a machine with two processors the sender takes one of them,
//! which is the better part of what is seen.
//!
//! Nothing but the sessions may be different afterwards: mode, fault, scene, settings, lease.
//!
//! Kinds: random bytes on the port of QUIC; first packets of handshakes that are never gone on
//! with; packets of sealed UDP for associations that do not exist, forged for one with a session,
//! good ones of it again and again; a client with a session that seals
//! rubbish; and clients that come and go, as fast as one address is let in.
//!
//! `--quick`: twenty thousand of each.

mod clients;
mod measure;
mod server;

use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use anyhow::{Context, ensure};
use clients::{Crowd, Session};
use hapticd::client::{Client, ConnectString, Options, services};
use hapticd::proto::{
    GetSettingsRequest, GetStateRequest, Hello, ListDevicesRequest, ListSessionsRequest,
    OpenSessionRequest, Ping, Role, Settings, Transport, datagram::Body,
};
use hapticd::sealed::{Direction, Kind, Opener, Sealer, ends};
use hapticd::wire;
use measure::quick;
use rand::{Rng, RngCore, SeedableRng};
use rand_chacha::ChaCha8Rng;
use server::{Figures, Server};
use tokio::runtime::Runtime;

/// Of each kind.
const DATAGRAMS: usize = 1_000_000;

/// Different first packets of handshakes.
const FIRST_PACKETS: usize = 64;

/// A quiet run; a flood takes its time.
const QUIET: Duration = Duration::from_secs(4);

/// Clients at a time that come and go.
const LANES: usize = 16;

/// What the second half of a flood may take; the allocator's own doings are in it.
const GROWTH_KIB: i64 = 1024;

/// Of all States; below it a session is slow.
const WHOLE_PERCENT: f64 = 95.0;

/// Longest wait for a session that is slow.
const SLOW: u64 = 60;

/// Between two looks at what came back.
const LOOK: usize = 64;

fn main() -> anyhow::Result<()> {
    if let Some(config) = server::asked() {
        return server::serve(&config);
    }
    let count = if quick() { DATAGRAMS / 50 } else { DATAGRAMS };
    let mut bench = Bench::start()?;
    println!(
        "{:34} {:>9} {:>7} | {:>13} {:>13} {:>15} {:>13} {:>7} {:>6} | {:>13}",
        format!("{count} datagrams each"),
        "1000/s",
        "back/%",
        "wake-up/us",
        "tick/us",
        "overruns/1000",
        "States/%",
        "wall/%",
        "slow/s",
        "memory/KiB"
    );
    for (name, ready) in KINDS {
        bench.row(name, |target, runtime| {
            let mut flood = ready(target, runtime)?;
            Ok(move || flood.run(count / 2))
        })?;
    }
    let time = if quick() { QUIET / 8 } else { QUIET };
    bench.row("clients that come and go", |target, runtime| {
        let (target, handle) = (target.clone(), runtime.handle().clone());
        Ok(move || handle.block_on(come_and_go(&target, time)))
    })
}

/// A server, with a controller that holds a wall.
struct Bench {
    server: Server,
    target: ConnectString,
    controller: Crowd,
    runtime: Runtime,
}

impl Bench {
    fn start() -> anyhow::Result<Self> {
        let server = Server::start("hand = \"press-and-slide\"\nblack_box_s = 0.0")?;
        let target = server.target().clone();
        let mut controller = Crowd::new(&target);
        let wall =
            Session { role: Role::Controller, state_interval: Duration::ZERO, answers: true };
        controller.join(&[wall])?;
        std::thread::sleep(Duration::from_secs(1));
        let runtime =
            tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        Ok(Self { server, target, controller, runtime })
    }

    /// A quiet run, and a flood of two halves that is made ready just before it.
    fn row<F: FnMut() -> anyhow::Result<Sent>>(
        &mut self,
        name: &str,
        ready: impl FnOnce(&ConnectString, &Runtime) -> anyhow::Result<F>,
    ) -> anyhow::Result<()> {
        let Self { server, target, controller, runtime } = self;
        let quiet = Run::quiet(server, controller, QUIET)?;
        let mut memory_kib = vec![server.memory_kib()?];
        let before_it = runtime.block_on(unchanging(target))?;
        let (mut sent, mut flood) = (Sent::default(), ready(target, runtime)?);
        let flooded = Run::of(server, controller, |server| {
            for _half in 0..2 {
                sent.add(&flood()?);
                memory_kib.push(server.memory_kib()?);
            }
            Ok(())
        })?;
        let slow_s = slow_s(server, controller)?;
        let [before, half, after] = memory_kib[..] else { unreachable!("three looks") };
        let stood = flooded.figure("commanded_ratio")?;
        println!(
            "{name:34} {:>9.2} {:>7.1} | {:>6.0} {:>6.0} {:>6.1} {:>6.1} {:>7.2} {:>7.2} {:>6.1} {:>6.1} {:>7.1} {:>6} | {:>+6} {:>+6}",
            sent.count as f64 / sent.took.as_secs_f64() / 1e3,
            100.0 * sent.back_bytes as f64 / sent.bytes.max(1) as f64,
            quiet.figure("wakeup_p99_us")?,
            flooded.figure("wakeup_p99_us")?,
            quiet.figure("tick_p99_us")?,
            flooded.figure("tick_p99_us")?,
            quiet.per_thousand("overruns")?,
            flooded.per_thousand("overruns")?,
            quiet.states_percent()?,
            flooded.states_percent()?,
            100.0 * stood,
            slow_s,
            half - before,
            after - half,
        );
        ensure!(controller.lost() == 0, "{name}: the controller lost its session");
        ensure!(sent.back_bytes <= sent.bytes, "{name}: more is sent back than came");
        ensure!(stood > 0.5, "{name}: the wall of the controller was gone");
        ensure!(after - half < GROWTH_KIB, "{name}: the server grows");
        let after_it = runtime.block_on(unchanging(target))?;
        ensure!(before_it == after_it, "{name}: {before_it:?} became {after_it:?}");
        Ok(())
    }
}

/// Observers from one address that connect, say Hello and go, one after the other in a few lanes.
async fn come_and_go(target: &ConnectString, time: Duration) -> anyhow::Result<Sent> {
    let began = Instant::now();
    let mut lanes = tokio::task::JoinSet::new();
    for _ in 0..LANES {
        let target = target.clone();
        lanes.spawn(async move {
            let mut came = 0;
            while began.elapsed() < time {
                let options = Options::new("comes and goes", Role::Observer);
                // Some are not let in.
                let client = tokio::time::timeout(time, Client::connect(&target, options));
                if let Ok(Ok(client)) = client.await {
                    client.close().await;
                    came += 1;
                }
            }
            came
        });
    }
    let count = lanes.join_all().await.into_iter().sum();
    Ok(Sent { took: began.elapsed(), count, ..Sent::default() })
}

/// What the server did in a stretch of time.
struct Run {
    figures: Figures,
    states: u64,
}

impl Run {
    fn of(
        server: &mut Server,
        controller: &Crowd,
        during: impl FnOnce(&mut Server) -> anyhow::Result<()>,
    ) -> anyhow::Result<Self> {
        server.take_figures()?;
        let before: u64 = controller.received().iter().sum();
        during(server)?;
        let figures = server.take_figures()?;
        Ok(Self { figures, states: controller.received().iter().sum::<u64>() - before })
    }

    fn quiet(server: &mut Server, controller: &Crowd, time: Duration) -> anyhow::Result<Self> {
        Self::of(server, controller, |_| {
            std::thread::sleep(time);
            Ok(())
        })
    }

    fn figure(&self, name: &str) -> anyhow::Result<f64> {
        self.figures.get(name)
    }

    fn per_thousand(&self, name: &str) -> anyhow::Result<f64> {
        Ok(1000.0 * self.figure(name)? / self.figure("ticks")?)
    }

    fn states_percent(&self) -> anyhow::Result<f64> {
        Ok(100.0 * self.states as f64 / self.figure("ticks")?)
    }
}

/// What no stranger may change.
#[derive(Debug, PartialEq)]
struct Unchanging {
    mode: i32,
    fault: i32,
    scene_revision: u64,
    settings: Option<Settings>,
    lease_epochs: Vec<u64>,
}

async fn unchanging(target: &ConnectString) -> anyhow::Result<Unchanging> {
    let mut services = services(target).await?;
    let list = services.devices.list_devices(ListDevicesRequest {}).await?.into_inner();
    let name = list.devices.first().context("a device")?.name.clone();
    let state = GetStateRequest { name: name.clone() };
    let state = services.devices.get_state(state).await?.into_inner();
    let settings = services.devices.get_settings(GetSettingsRequest { name }).await?.into_inner();
    let sessions = services.sessions.list_sessions(ListSessionsRequest::default()).await?;
    let epochs = sessions.into_inner().sessions.into_iter().map(|session| session.lease_epoch);
    Ok(Unchanging {
        mode: state.mode,
        fault: state.fault,
        scene_revision: state.scene_revision,
        settings: Some(settings),
        lease_epochs: epochs.filter(|epoch| *epoch > 0).collect(),
    })
}

/// How long it takes until a controller gets its States again.
fn slow_s(server: &mut Server, controller: &Crowd) -> anyhow::Result<u64> {
    for second in 0..SLOW {
        let run = Run::quiet(server, controller, Duration::from_secs(1))?;
        if run.states_percent()? >= WHOLE_PERCENT {
            return Ok(second);
        }
    }
    Ok(SLOW)
}

/// What a flood was.
#[derive(Default)]
struct Sent {
    took: Duration,
    count: u64,
    bytes: u64,
    back_bytes: u64,
}

impl Sent {
    fn add(&mut self, other: &Self) {
        self.took += other.took;
        self.count += other.count;
        self.bytes += other.bytes;
        self.back_bytes += other.back_bytes;
    }
}

/// Kinds of floods; each is made ready just before it begins, because who waits is forgotten.
const KINDS: [(&str, Ready); 6] = [
    ("random bytes to QUIC", |target, _| {
        Flood::of(quic(target), |rng, packet| {
            packet.resize(rng.random_range(1..1_200), 0);
            rng.fill_bytes(packet);
        })
    }),
    ("handshakes without an end", |target, runtime| {
        let (firsts, mut turn) = (runtime.block_on(first_packets(target))?, 0);
        Flood::of(quic(target), move |_, packet| {
            turn = (turn + 1) % firsts.len();
            packet.clone_from(&firsts[turn]);
        })
    }),
    ("sealed, of nobody", |target, runtime| {
        let member = runtime.block_on(Member::open(target))?;
        Flood::of(member.to, |rng, packet| {
            packet.resize(rng.random_range(34..1_200), 0);
            rng.fill_bytes(packet);
            packet[0] = UP;
        })
    }),
    ("sealed, forged", |target, runtime| {
        let mut member = runtime.block_on(Member::open(target))?;
        member.arrive()?;
        let Member { association, to, mut sealer, socket, .. } = member;
        let (mut turn, mut good) = (0, Vec::new());
        let next = move |rng: &mut ChaCha8Rng, packet: &mut Vec<u8>| {
            turn += 1;
            if lives(&mut sealer, turn, &mut good) {
                return packet.clone_from(&good);
            }
            packet.resize(80, 0);
            rng.fill_bytes(packet);
            packet[0] = UP;
            packet[1..9].copy_from_slice(&association);
            packet[9..12].fill(0);
        };
        Ok(Flood { to, socket, next: Box::new(next) })
    }),
    ("sealed, replayed", |target, runtime| {
        let mut member = runtime.block_on(Member::open(target))?;
        member.arrive()?;
        let Member { to, mut sealer, socket, .. } = member;
        let (mut turn, mut good) = (0, Vec::new());
        let next = move |_: &mut ChaCha8Rng, packet: &mut Vec<u8>| {
            turn += 1;
            lives(&mut sealer, turn, &mut good);
            packet.clone_from(&good);
        };
        Ok(Flood { to, socket, next: Box::new(next) })
    }),
    ("rubbish of a client", |target, runtime| {
        let mut member = runtime.block_on(Member::open(target))?;
        member.arrive()?;
        let Member { to, mut sealer, socket, .. } = member;
        let rubbish = move |rng: &mut ChaCha8Rng, packet: &mut Vec<u8>| {
            let mut body = [0; 60];
            rng.fill_bytes(&mut body);
            *packet = sealer.seal(Kind::Datagram, &body).unwrap_or_default();
        };
        Ok(Flood { to, socket, next: Box::new(rubbish) })
    }),
];

/// Now and then a new good Ping, without which a session would end; true where it is one.
fn lives(sealer: &mut Sealer, turn: u64, good: &mut Vec<u8>) -> bool {
    let due = turn % 4096 == 1;
    if due {
        let ping = wire::encode(&Body::Ping(Ping { seq: turn, sent_ns: turn }));
        *good = sealer.seal(Kind::Datagram, &ping).unwrap_or_default();
    }
    due
}

/// Makes a flood ready.
type Ready = fn(&ConnectString, &Runtime) -> anyhow::Result<Flood>;

/// First byte of a sealed packet to the server.
const UP: u8 = 0xa1;

fn quic(target: &ConnectString) -> SocketAddr {
    SocketAddr::from(([127, 0, 0, 1], target.stream_port))
}

/// Writes the next packet.
type Next = Box<dyn FnMut(&mut ChaCha8Rng, &mut Vec<u8>)>;

/// One flood, ready to begin.
struct Flood {
    to: SocketAddr,
    socket: UdpSocket,
    next: Next,
}

impl Flood {
    fn of(
        to: SocketAddr,
        next: impl FnMut(&mut ChaCha8Rng, &mut Vec<u8>) + 'static,
    ) -> anyhow::Result<Self> {
        Ok(Self { to, socket: UdpSocket::bind("127.0.0.1:0")?, next: Box::new(next) })
    }

    fn run(&mut self, count: usize) -> anyhow::Result<Sent> {
        self.socket.set_nonblocking(true)?;
        let (mut rng, mut packet) = (ChaCha8Rng::seed_from_u64(1), Vec::new());
        let (mut sent, mut buffer) = (Sent::default(), [0; 2048]);
        let began = Instant::now();
        for number in 0..count {
            (self.next)(&mut rng, &mut packet);
            // What the system does not take was not sent.
            if let Ok(length) = self.socket.send_to(&packet, self.to) {
                sent.bytes += length as u64;
            }
            if number % LOOK == 0 || number + 1 == count {
                while let Ok(length) = self.socket.recv(&mut buffer) {
                    sent.back_bytes += length as u64;
                }
            }
        }
        (sent.took, sent.count) = (began.elapsed(), count as u64);
        Ok(sent)
    }
}

/// An observer over sealed UDP.
struct Member {
    association: [u8; 8],
    to: SocketAddr,
    sealer: Sealer,
    opener: Opener,
    socket: UdpSocket,
}

impl Member {
    async fn open(target: &ConnectString) -> anyhow::Result<Self> {
        let hello = Hello {
            versions: vec!["hapticd/1".into()],
            role: Role::Observer.into(),
            // As few States as there can be: what comes back is not theirs.
            state_interval_us: 1_000_000,
            ..Hello::default()
        };
        let transport = Transport::SealedUdp.into();
        let request = OpenSessionRequest { hello: Some(hello), transport };
        let opened = services(target).await?.sessions.open_session(request).await?.into_inner();
        let sealed = opened.sealed_udp.context("sealed UDP was asked for")?;
        let wrong = |_| anyhow::anyhow!("the answer has another length");
        let association = sealed.association.try_into().map_err(wrong)?;
        let secret = sealed.secret.try_into().map_err(wrong)?;
        let (sealer, opener) = ends(&secret, association, Direction::Up);
        let to = SocketAddr::from(([127, 0, 0, 1], u16::try_from(sealed.port)?));
        let socket = UdpSocket::bind("127.0.0.1:0")?;
        Ok(Self { association, to, sealer, opener, socket })
    }

    /// Shows the cookie; from then on its rubbish is heard by the session.
    fn arrive(&mut self) -> anyhow::Result<()> {
        self.socket.set_read_timeout(Some(Duration::from_secs(5)))?;
        let mut cookie = vec![0; 32];
        for _ in 0..2 {
            let here = self.sealer.seal(Kind::Here, &cookie).context("it fits")?;
            self.socket.send_to(&here, self.to)?;
            let mut buffer = [0; 2048];
            let length = self.socket.recv(&mut buffer)?;
            if let Ok((Kind::Challenge, shown)) = self.opener.open(&mut buffer[..length]) {
                cookie = shown.to_vec();
            }
        }
        Ok(())
    }
}

/// The first packets of clients, which a socket that says nothing takes.
async fn first_packets(target: &ConnectString) -> anyhow::Result<Vec<Vec<u8>>> {
    let trap = tokio::net::UdpSocket::bind("127.0.0.1:0").await?;
    let trapped = ConnectString { stream_port: trap.local_addr()?.port(), ..target.clone() };
    let mut packets = Vec::new();
    while packets.len() < FIRST_PACKETS {
        let target = trapped.clone();
        let client = tokio::spawn(async move {
            // Never answered.
            let _ = Client::connect(&target, Options::new("trapped", Role::Observer)).await;
        });
        let mut buffer = [0; 2048];
        let length = trap.recv(&mut buffer).await?;
        client.abort();
        // Beside it comes a single byte, which asks whether anybody listens.
        if length > 1 {
            packets.push(buffer[..length].to_vec());
        }
    }
    Ok(packets)
}

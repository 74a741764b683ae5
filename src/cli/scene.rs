//! `hapticd scene`: simulators that connect to a server.

use std::time::Duration;

use anyhow::ensure;
use clap::{Args, Subcommand};
use tokio::time::MissedTickBehavior;

use super::format::{device_resource, parse_seconds};
use super::scene_figures::Figures;
use crate::app::Signals;
use crate::client::{Client, ClientError, ConnectString, Incoming, Options, Transport};
use crate::proto::{ByeReason, Contact, HalfSpaceContact, Role, contact::Shape};
use crate::units::{self, FieldError};

/// Run a scene against a server.
#[derive(Debug, Args)]
#[command(after_help = "Example:
  hapticd scene wall --connect 127.0.0.1:7351 --seconds 30")]
pub struct Scene {
    #[command(subcommand)]
    scene: Which,
}

#[derive(Debug, Subcommand)]
enum Which {
    Wall(Wall),
}

/// A wall across the device's workspace, as stiff as the device takes it; that of Cho 2005, at
/// x = 0.3 m with 1e7 N/m, on the devices of that paper.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd scene wall --connect 127.0.0.1:7351 --seconds 30
  hapticd scene wall --connect 'hapticd://127.0.0.1:7351/?sha256=...' --stiffness 500
  hapticd scene wall --transport udp --seconds 30 --json")]
struct Wall {
    /// Where the server is: the line that `serve` prints, or HOST:PORT on this machine
    #[arg(long, value_name = "STRING", default_value = "127.0.0.1:7351")]
    connect: ConnectString,
    /// Which device, where there are several
    #[arg(long, value_name = "NAME")]
    device: Option<String>,
    /// What carries the stream: quic, webtransport or udp
    #[arg(long, value_name = "TRANSPORT", default_value_t = Transport::Quic)]
    transport: Transport,
    /// End after this time; without it, at Ctrl-C
    #[arg(long, value_name = "N", value_parser = parse_seconds, allow_negative_numbers = true)]
    seconds: Option<Duration>,
    /// Where the wall stands, metres: felt from the side of smaller x; without it, where the
    /// server proposes one
    #[arg(long, allow_negative_numbers = true)]
    x: Option<f32>,
    /// Its stiffness, N/m; without it, what the server proposes for the device
    #[arg(long, allow_negative_numbers = true)]
    stiffness: Option<f32>,
    /// Its damping, N s/m
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    damping: f32,
    /// Its friction coefficient
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    friction: f32,
    /// Print the figures of the run as JSON
    #[arg(long)]
    json: bool,
}

/// A wall holds this long without a newer command: through a burst of losses, and a scene that
/// hangs loses it soon.
const TTL_MS: u32 = 200;

/// So often at least the wall is sent, however few States come: it must not go where they do.
const AT_LEAST: Duration = Duration::from_millis(4);

/// A wall that appears around the tool, after a gap too, pushes it out within this time, as far as
/// motors can. A stiffer one is for brakes, which push nobody: it holds where the tool is.
const BLEND_MS: u32 = 200;
const STIFF_N_PER_M: f32 = 1e5;

/// SCHED_FIFO priority of a scene, below every thread of a server.
const SCENE_PRIORITY: u8 = 20;

impl Scene {
    /// Runs until its time is over, Ctrl-C, or the server ends.
    pub fn run(self) -> anyhow::Result<()> {
        let Which::Wall(wall) = self.scene;
        wall.check()?;
        // A simulator that answers every tick wants to run on time too. Denied, it runs on.
        let _ = crate::rt::fifo(SCENE_PRIORITY);
        super::runtime()?.block_on(wall.run())
    }
}

impl Wall {
    /// A server does not answer a bad command: what is wrong is said before there is one.
    fn check(&self) -> Result<(), FieldError> {
        let said =
            [("--x", self.x, units::POSITION), ("--stiffness", self.stiffness, units::STIFFNESS)];
        for (name, value, range) in said {
            value.map_or(Ok(0.0), |value| range.check(name, value.into()))?;
        }
        units::DAMPING.check("--damping", self.damping.into())?;
        units::FRICTION.check("--friction", self.friction.into())?;
        Ok(())
    }

    async fn run(self) -> anyhow::Result<()> {
        let mut signals = Signals::register()?;
        let options = Options {
            device: device_resource(self.device.as_deref()),
            transport: self.transport,
            ..Options::new("hapticd scene wall", Role::Controller)
        };
        let mut client = tokio::select! {
            connected = Client::connect(&self.connect, options) => connected?,
            () = signals.received() => {
                eprintln!("scene wall: ended before it was connected");
                return Ok(());
            }
        };
        let device = client.welcome().device.clone();
        let contact = self.contact(client.welcome().example_wall.as_deref().cloned())?;
        eprintln!("scene wall: commanding {device}, {}", described(&contact));
        let seconds = self.seconds;
        let over = async {
            tokio::select! {
                () = signals.received() => {}
                () = tokio::time::sleep(seconds.unwrap_or_default()), if seconds.is_some() => {}
            }
        };
        tokio::pin!(over);
        let (mut commands, mut came, mut newest) = (0u64, 0, 0);
        let mut figures = Figures::new();
        let mut overdue = tokio::time::interval(AT_LEAST);
        overdue.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            let due = tokio::select! {
                biased;
                incoming = client.next() => match incoming {
                    Ok(Incoming::State(state)) => {
                        newest = state.seq.max(newest);
                        figures.saw(&state, client.now_ns());
                        came = client.states_received();
                        true
                    }
                    Ok(Incoming::Event(_) | Incoming::RoundTrip(_)) => false,
                    Err(ClientError::Bye {
                        reason: ByeReason::Done | ByeReason::Shutdown,
                        detail,
                    }) => {
                        eprintln!("scene wall: the server ended the session: {detail}");
                        break;
                    }
                    Err(error) => return Err(error.into()),
                },
                _ = overdue.tick() => true,
                () = &mut over => {
                    client.close().await;
                    break;
                }
            };
            if !due {
                continue;
            }
            overdue.reset();
            match client.send_contacts(newest, TTL_MS, vec![contact.clone()]) {
                Ok(_) => commands += 1,
                // Why is heard next.
                Err(ClientError::Lost(_)) => {}
                Err(error) => return Err(error.into()),
            }
        }
        figures.came(came);
        eprintln!("scene wall: {}", figures.in_words(commands));
        if self.json {
            say!("{}", figures.to_json(commands));
        }
        Ok(())
    }

    /// The wall that the server proposes, but for what was said of it.
    fn contact(&self, proposed: Option<Contact>) -> anyhow::Result<Contact> {
        let mut contact = match (proposed, self.x) {
            (Some(contact), None) => contact,
            (None, None) => anyhow::bail!("the server proposes no wall: say where with --x"),
            (proposed, Some(x)) => {
                let half_space =
                    HalfSpaceContact { point_m: vec![x, 0.0, 0.0], normal: vec![-1.0, 0.0, 0.0] };
                let shape = Some(Shape::HalfSpace(half_space));
                ensure!(
                    proposed.is_some() || self.stiffness.is_some(),
                    "the server proposes no wall: say how stiff with --stiffness"
                );
                Contact { id: 1, revision: 1, shape, ..proposed.unwrap_or_default() }
            }
        };
        if let Some(stiffness) = self.stiffness {
            contact.stiffness_n_per_m = stiffness;
            contact.blend_ms = if stiffness < STIFF_N_PER_M { BLEND_MS } else { 0 };
        }
        (contact.damping_ns_per_m, contact.kinetic_friction) = (self.damping, self.friction);
        Ok(contact)
    }
}

fn described(wall: &Contact) -> String {
    let stiffness = wall.stiffness_n_per_m;
    let Some(Shape::HalfSpace(HalfSpaceContact { point_m, normal })) = &wall.shape else {
        return format!("a wall of {stiffness:.0} N/m");
    };
    match (point_m.first(), *normal == [-1.0, 0.0, 0.0]) {
        (Some(x), true) => {
            format!("wall at x = {} m of {stiffness:.0} N/m", (x * 1e4).round() / 1e4)
        }
        _ => {
            format!("wall through {point_m:.4?} m with normal {normal:.4?}, of {stiffness:.0} N/m")
        }
    }
}

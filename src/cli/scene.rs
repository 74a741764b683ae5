//! `hapticd scene`: simulators that connect to a server.

use std::time::Duration;

use clap::{Args, Subcommand};

use super::format::{device_resource, parse_seconds};
use crate::app::Signals;
use crate::client::{Client, ClientError, ConnectString, Incoming, Options};
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

/// The wall of Cho 2005: x = 0.3 m, felt from the side of smaller x, 1e7 N/m.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  hapticd scene wall --connect 127.0.0.1:7351 --seconds 30
  hapticd scene wall --connect 'hapticd://127.0.0.1:7351/?sha256=...' --stiffness 500")]
struct Wall {
    /// Where the server is: the line that `serve` prints, or HOST:PORT on this machine
    #[arg(long, value_name = "STRING", default_value = "127.0.0.1:7351")]
    connect: ConnectString,
    /// Which device, where there are several
    #[arg(long, value_name = "NAME")]
    device: Option<String>,
    /// Transport of the stream
    #[arg(long, default_value = "quic", value_parser = ["quic"])]
    transport: String,
    /// End after this time; without it, at Ctrl-C
    #[arg(long, value_name = "N", value_parser = parse_seconds, allow_negative_numbers = true)]
    seconds: Option<Duration>,
    /// Where the wall stands, metres
    #[arg(long, default_value_t = WALL_X_M, allow_negative_numbers = true)]
    x: f32,
    /// Its stiffness, N/m
    #[arg(long, default_value_t = 1e7, allow_negative_numbers = true)]
    stiffness: f32,
    /// Its damping, N s/m
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    damping: f32,
    /// Its friction coefficient
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    friction: f32,
}

/// Where the wall of the experiment stands, metres (Cho 2005, section 8.1).
const WALL_X_M: f32 = 0.3;

/// A wall holds this long without a newer command; a scene that hangs loses it soon.
const TTL_MS: u32 = 100;

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
        units::POSITION.check("--x", self.x.into())?;
        units::STIFFNESS.check("--stiffness", self.stiffness.into())?;
        units::DAMPING.check("--damping", self.damping.into())?;
        units::FRICTION.check("--friction", self.friction.into())?;
        Ok(())
    }

    async fn run(self) -> anyhow::Result<()> {
        let mut signals = Signals::register()?;
        let options = Options {
            device: device_resource(self.device.as_deref()),
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
        eprintln!("scene wall: commanding {device}, wall at x = {} m", self.x);
        let seconds = self.seconds;
        let over = async {
            tokio::select! {
                () = signals.received() => {}
                () = tokio::time::sleep(seconds.unwrap_or_default()), if seconds.is_some() => {}
            }
        };
        tokio::pin!(over);
        let mut commands = 0u64;
        loop {
            tokio::select! {
                biased;
                incoming = client.next() => match incoming {
                    Ok(Incoming::State(state)) => {
                        match client.send_contacts(state.seq, TTL_MS, vec![self.contact()]) {
                            Ok(_) => commands += 1,
                            // Why is heard next.
                            Err(ClientError::Lost(_)) => {}
                            Err(error) => return Err(error.into()),
                        }
                    }
                    Ok(Incoming::Event(_) | Incoming::RoundTrip(_)) => {}
                    Err(ClientError::Bye {
                        reason: ByeReason::Done | ByeReason::Shutdown,
                        detail,
                    }) => {
                        eprintln!("scene wall: the server ended the session: {detail}");
                        break;
                    }
                    Err(error) => return Err(error.into()),
                },
                () = &mut over => {
                    client.close().await;
                    break;
                }
            }
        }
        eprintln!("scene wall: {commands} commands sent");
        Ok(())
    }

    fn contact(&self) -> Contact {
        let half_space =
            HalfSpaceContact { point_m: vec![self.x, 0.0, 0.0], normal: vec![-1.0, 0.0, 0.0] };
        Contact {
            id: 1,
            revision: 1,
            shape: Some(Shape::HalfSpace(half_space)),
            stiffness_n_per_m: self.stiffness,
            damping_ns_per_m: self.damping,
            kinetic_friction: self.friction,
            blend_ms: if self.stiffness < STIFF_N_PER_M { BLEND_MS } else { 0 },
            ..Contact::default()
        }
    }
}

//! What the sessions of one device take as given, and the names that identify a session.

use std::fmt;

use nalgebra::Vector3;

/// How a client is connected: a label of metrics, no difference in behaviour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transport {
    /// QUIC streams and datagrams.
    Quic,
    /// The same inside HTTP/3, for browsers.
    WebTransport,
    /// Sealed datagrams over plain UDP.
    SealedUdp,
}

impl Transport {
    /// Every transport, for tables of metrics.
    pub const ALL: [Self; 3] = [Self::Quic, Self::WebTransport, Self::SealedUdp];

    /// The name used in metrics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Quic => "quic",
            Self::WebTransport => "webtransport",
            Self::SealedUdp => "udp",
        }
    }
}

/// What a session may do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Receives State.
    Observer,
    /// Holds the lease and commands.
    Controller,
    /// Pulls the handle of a simulated device.
    Hand,
}

impl Role {
    /// Every role, for tables of metrics.
    pub const ALL: [Self; 3] = [Self::Observer, Self::Controller, Self::Hand];

    /// The name used in metrics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Observer => "observer",
            Self::Controller => "controller",
            Self::Hand => "hand",
        }
    }
}

/// One session of a device; never used twice while the server runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SessionId(pub(super) u64);

impl SessionId {
    /// The session of a resource name; `None` where it cannot be one.
    pub fn parse(name: &str) -> Option<Self> {
        let digits = name.strip_prefix("sessions/")?;
        // One name for one session: no sign, no zero in front.
        let id = Self(digits.parse().ok()?);
        (id.to_string() == name).then_some(id)
    }
}

/// The resource name, `sessions/ID`.
impl fmt::Display for SessionId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "sessions/{}", self.0)
    }
}

/// What the sessions of one device take as given.
#[derive(Clone, Debug)]
pub struct SessionConfig {
    /// NAME of `devices/NAME`.
    pub device: String,
    /// The same of every device of the server, for a client that names none of them.
    pub devices: Vec<String>,
    /// Time between ticks.
    pub tick_ns: u64,
    /// Freedoms the device actuates.
    pub freedoms: u32,
    /// Its actuators.
    pub actuators: u32,
    /// More connections are refused.
    pub max_sessions: usize,
    /// Its handle can be pulled by a session of role hand.
    pub takes_hands: bool,
    /// How long contacts and force fields hold whose command does not say.
    pub default_ttl_ms: u32,
    /// How long a wrench holds whose command does not say.
    pub default_wrench_ttl_ms: u32,
    /// How long any command can hold.
    pub max_ttl_ms: u32,
    /// A wrench or force field computed from an older State is refused.
    pub max_age_ms: u32,
    /// The same of contacts: where a surface is does not hang on where the handle was.
    pub max_contacts_age_ms: u32,
    /// Where the services listen.
    pub grpc_port: u16,
    /// UTC minus the device clock, as the server starts.
    pub utc_minus_device_ns: i64,
    /// What a client may try first.
    pub example_wall: Option<ExampleWall>,
}

/// A wall that the device can render, where its handle gets to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExampleWall {
    /// Any point of its surface.
    pub point_W_m: Vector3<f64>,
    /// Out of it, of length 1.
    pub normal_W: Vector3<f64>,
    /// As stiff as the device takes it.
    pub stiffness_N_per_m: f64,
}

impl SessionConfig {
    /// A device with the usual bounds, UTC and gRPC unknown.
    pub fn new(device: impl Into<String>, tick_ns: u64, freedoms: u32, actuators: u32) -> Self {
        let device = device.into();
        Self {
            devices: vec![device.clone()],
            device,
            tick_ns,
            freedoms,
            actuators,
            max_sessions: 64,
            takes_hands: false,
            default_ttl_ms: 100,
            default_wrench_ttl_ms: 20,
            max_ttl_ms: 200,
            max_age_ms: 200,
            max_contacts_age_ms: 1000,
            grpc_port: 0,
            utc_minus_device_ns: 0,
            example_wall: None,
        }
    }

    /// The resource name of the device.
    pub(super) fn device_name(&self) -> String {
        format!("devices/{}", self.device)
    }

    /// Greatest age of a State that any command may be computed from.
    pub(super) fn greatest_age_ns(&self) -> u64 {
        u64::from(self.max_age_ms.max(self.max_contacts_age_ms)) * 1_000_000
    }

    /// UTC at a moment of the device clock.
    pub(super) fn utc_ns(&self, now_ns: u64) -> u64 {
        now_ns.saturating_add_signed(self.utc_minus_device_ns)
    }
}

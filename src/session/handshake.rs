//! Hello and its answer: what a client asks for becomes terms, or a reason why not.
//!
//! Only the words are judged here; whether the lease is free is the lease's business. What
//! a refusal repeats of the client's text is cut short and escaped: it goes into logs.

use crate::proto::{self, Bye, ByeReason, Hello, StreamMessage, Welcome, stream_message::Body};
use crate::units::FieldError;
use crate::wire::{MAX_STATE_BYTES, PROTOCOL, choose, max_detailed_bytes};

use super::deadband::Deadband;
use super::workspace::Workspace;
use super::{Role, SessionConfig, SessionId};

const MAX_NAME_BYTES: usize = 64;
const COMMAND_INTERVAL_US: std::ops::RangeInclusive<u32> = 1_000..=50_000;
const MAX_STATE_INTERVAL_US: u32 = 1_000_000;
const MIN_DATAGRAM_BYTES: u32 = 300;
const NS_PER_US: u64 = 1_000;

/// What a session was granted.
#[derive(Clone, Debug)]
pub(super) struct Terms {
    pub client_name: String,
    pub role: Role,
    /// The lease is taken from whoever holds it.
    pub takeover: bool,
    pub command_interval_ns: u64,
    /// 0: every tick.
    pub state_interval_ns: u64,
    /// State carries every actuator.
    pub detail: bool,
    pub workspace: Workspace,
    /// `None`: every State that is due is sent.
    pub deadband: Option<Deadband>,
}

/// Why there is no session.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Refusal {
    pub reason: ByeReason,
    pub detail: String,
}

impl From<FieldError> for Refusal {
    fn from(error: FieldError) -> Self {
        Self { reason: ByeReason::Invalid, detail: error.to_string() }
    }
}

/// The terms that a Hello asks for.
pub(super) fn agree(hello: &Hello, config: &SessionConfig) -> Result<Terms, Refusal> {
    check_version(hello)?;
    let several = config.devices.len() > 1;
    if hello.device != config.device_name() && (several || !hello.device.is_empty()) {
        let names: Vec<_> = config.devices.iter().map(|name| format!("devices/{name}")).collect();
        let empty = if several { "" } else { " or empty" };
        let allowed = format!("must be {}{empty}", names.join(" or "));
        let value = if hello.device.is_empty() { "(none)".into() } else { shown(&hello.device) };
        return Err(refusal(ByeReason::UnknownDevice, &FieldError::new("device", value, allowed)));
    }
    check_datagram(hello, config)?;
    let role = role(hello, config)?;
    Ok(Terms {
        client_name: client_name(&hello.client_name)?,
        role,
        takeover: takeover(hello, role)?,
        command_interval_ns: command_interval_ns(hello.command_interval_us)?,
        state_interval_ns: state_interval_ns(hello.state_interval_us, config)?,
        detail: hello.detail,
        workspace: Workspace::agree(hello.workspace.as_ref())?,
        deadband: Deadband::agree(hello.deadband)?,
    })
}

/// Refuses who speaks another protocol.
pub(super) fn check_version(hello: &Hello) -> Result<(), Refusal> {
    if choose(&hello.versions).is_some() {
        return Ok(());
    }
    let offered = shown(&hello.versions.join(", "));
    let error = FieldError::new("versions", offered, format!("must contain {PROTOCOL}"));
    Err(refusal(ByeReason::Version, &error))
}

fn refusal(reason: ByeReason, error: &FieldError) -> Refusal {
    Refusal { reason, detail: error.to_string() }
}

fn client_name(name: &str) -> Result<String, FieldError> {
    if name.len() > MAX_NAME_BYTES || name.chars().any(char::is_control) {
        let allowed = format!("must be at most {MAX_NAME_BYTES} bytes without control characters");
        return Err(FieldError::new("client_name", shown(name), allowed));
    }
    Ok(name.to_owned())
}

fn role(hello: &Hello, config: &SessionConfig) -> Result<Role, FieldError> {
    match proto::Role::try_from(hello.role) {
        Ok(proto::Role::Observer) => Ok(Role::Observer),
        Ok(proto::Role::Controller) => Ok(Role::Controller),
        Ok(proto::Role::Hand) if config.takes_hands => Ok(Role::Hand),
        _ => {
            let hand = if config.takes_hands {
                ", or ROLE_HAND (3)"
            } else {
                ": this device has no hand to pull (serve --hand pointer has)"
            };
            let allowed = format!("must be ROLE_OBSERVER (1) or ROLE_CONTROLLER (2){hand}");
            Err(FieldError::new("role", hello.role, allowed))
        }
    }
}

fn takeover(hello: &Hello, role: Role) -> Result<bool, FieldError> {
    if hello.takeover && role != Role::Controller {
        let allowed = "must be false unless role is ROLE_CONTROLLER (2)";
        return Err(FieldError::new("takeover", true, allowed));
    }
    Ok(hello.takeover)
}

fn command_interval_ns(interval_us: u32) -> Result<u64, FieldError> {
    let (least, most) = (*COMMAND_INTERVAL_US.start(), *COMMAND_INTERVAL_US.end());
    match interval_us {
        0 => Ok(u64::from(least) * NS_PER_US),
        _ if COMMAND_INTERVAL_US.contains(&interval_us) => Ok(u64::from(interval_us) * NS_PER_US),
        _ => {
            let allowed = format!("must be 0 or {least} to {most} us");
            Err(FieldError::new("command_interval_us", interval_us, allowed))
        }
    }
}

fn state_interval_ns(interval_us: u32, config: &SessionConfig) -> Result<u64, FieldError> {
    let tick_us = config.tick_ns.div_ceil(NS_PER_US);
    let within = u64::from(interval_us) >= tick_us && interval_us <= MAX_STATE_INTERVAL_US;
    if interval_us == 0 || within {
        return Ok(u64::from(interval_us) * NS_PER_US);
    }
    let allowed = format!("must be 0 or {tick_us} to {MAX_STATE_INTERVAL_US} us");
    Err(FieldError::new("state_interval_us", interval_us, allowed))
}

fn check_datagram(hello: &Hello, config: &SessionConfig) -> Result<(), FieldError> {
    let bytes = hello.max_datagram_bytes;
    let detailed_bytes = max_detailed_bytes(config.actuators as usize);
    let more = if hello.detail { detailed_bytes - MAX_STATE_BYTES } else { 0 };
    let least = MIN_DATAGRAM_BYTES + more as u32;
    if bytes == 0 || bytes >= least {
        return Ok(());
    }
    let allowed = format!("must be 0 or at least {least} bytes");
    Err(FieldError::new("max_datagram_bytes", bytes, allowed))
}

/// A client's text, short and harmless.
fn shown(text: &str) -> String {
    text.chars().take(MAX_NAME_BYTES).flat_map(char::escape_debug).collect()
}

/// The answer to a good Hello.
pub(super) fn welcome(
    id: SessionId,
    (lease_epoch, scene_revision): (u64, u64),
    workspace: &Workspace,
    config: &SessionConfig,
    now_ns: u64,
) -> Welcome {
    let tick_us = config.tick_ns / NS_PER_US;
    Welcome {
        version: PROTOCOL.to_owned(),
        session: id.to_string(),
        device: config.device_name(),
        tick_period_us: u32::try_from(tick_us).unwrap_or(u32::MAX),
        scene_revision,
        lease_epoch,
        device_time_ns: now_ns,
        utc_time_ns: config.utc_ns(now_ns),
        freedoms: config.freedoms,
        actuators: config.actuators,
        max_ttl_ms: config.max_ttl_ms,
        grpc_port: config.grpc_port.into(),
        felt_stiffness_ratio: workspace.felt_stiffness_ratio() as f32,
        max_age_ms: config.max_age_ms,
        max_contacts_age_ms: config.max_contacts_age_ms,
        example_wall: config.example_wall.map(|wall| workspace.example(&wall).into()),
    }
}

/// The last word to a client.
pub(super) fn bye(reason: ByeReason, detail: &str) -> StreamMessage {
    let bye = Bye { reason: reason.into(), detail: detail.to_owned() };
    StreamMessage { body: Some(Body::Bye(bye)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn good() -> Hello {
        Hello {
            versions: vec!["hapticd/1".into()],
            client_name: "needle trainer".into(),
            device: "devices/cho-2005".into(),
            role: proto::Role::Controller.into(),
            command_interval_us: 13_889,
            state_interval_us: 4_000,
            max_datagram_bytes: 1200,
            ..Hello::default()
        }
    }

    fn judge(change: impl FnOnce(&mut Hello)) -> Result<Terms, Refusal> {
        let mut hello = good();
        change(&mut hello);
        agree(&hello, &SessionConfig::new("cho-2005", 1_000_000, 2, 4))
    }

    #[test]
    fn a_good_hello_gets_its_terms() {
        let terms = judge(|_| ()).unwrap();
        assert_eq!(terms.client_name, "needle trainer");
        assert_eq!(terms.role, Role::Controller);
        assert_eq!(terms.command_interval_ns, 13_889_000);
        assert_eq!(terms.state_interval_ns, 4_000_000);
        assert_eq!(
            (terms.takeover, terms.detail, terms.workspace),
            (false, false, Workspace::SAME)
        );
    }

    #[test]
    fn a_hand_is_only_for_a_simulated_device_and_takes_nothing_over() {
        let hand = Hello { role: proto::Role::Hand.into(), ..good() };
        let mut config = SessionConfig::new("cho-2005", 1_000_000, 2, 4);
        let refusal = agree(&hand, &config).unwrap_err().detail;
        assert!(refusal.contains("role = 3") && refusal.contains("--hand pointer"), "{refusal}");
        config.takes_hands = true;
        assert_eq!(agree(&hand, &config).unwrap().role, Role::Hand);
        let grasping = Hello { takeover: true, ..hand };
        let refusal = agree(&grasping, &config).unwrap_err().detail;
        assert_eq!(refusal, "takeover = true: must be false unless role is ROLE_CONTROLLER (2)");
    }

    #[test]
    fn detail_needs_room_in_the_datagram() {
        let detailed = |bytes| judge(|h| (h.detail, h.max_datagram_bytes) = (true, bytes));
        assert!(detailed(0).is_ok() && detailed(395).is_ok());
        let refusal = detailed(394).unwrap_err().detail;
        assert_eq!(refusal, "max_datagram_bytes = 394: must be 0 or at least 395 bytes");
    }

    #[test]
    fn zero_and_empty_stand_for_defaults() {
        let terms = judge(|hello| {
            hello.device.clear();
            hello.client_name.clear();
            hello.command_interval_us = 0;
            hello.state_interval_us = 0;
            hello.max_datagram_bytes = 0;
        });
        let terms = terms.unwrap();
        assert_eq!(terms.command_interval_ns, 1_000_000);
        assert_eq!(terms.state_interval_ns, 0);
    }

    #[test]
    fn the_ends_of_every_range_are_inside() {
        type Change = fn(&mut Hello);
        let changes: [Change; 8] = [
            |h| h.client_name = "x".repeat(64),
            |h| h.command_interval_us = 1_000,
            |h| h.command_interval_us = 50_000,
            |h| h.state_interval_us = 1_000,
            |h| h.state_interval_us = 1_000_000,
            |h| h.max_datagram_bytes = 300,
            |h| h.versions.insert(0, "hapticd/2".into()),
            |h| h.takeover = true,
        ];
        for change in changes {
            assert!(judge(change).is_ok());
        }
    }

    #[test]
    fn every_bad_field_is_refused_by_name_with_its_value_and_range() {
        type Change = fn(&mut Hello);
        let table: [(Change, ByeReason, &str); 14] = [
            (
                |h| h.versions = vec!["hapticd/2".into()],
                ByeReason::Version,
                "versions = hapticd/2: must contain hapticd/1",
            ),
            (|h| h.versions.clear(), ByeReason::Version, "versions = : must contain hapticd/1"),
            (
                |h| h.device = "devices/other".into(),
                ByeReason::UnknownDevice,
                "device = devices/other: must be devices/cho-2005 or empty",
            ),
            (
                |h| h.device = "cho-2005".into(),
                ByeReason::UnknownDevice,
                "device = cho-2005: must be devices/cho-2005 or empty",
            ),
            (
                |h| h.client_name = "x".repeat(65),
                ByeReason::Invalid,
                "must be at most 64 bytes without control characters",
            ),
            (
                |h| h.client_name = "a\nb".into(),
                ByeReason::Invalid,
                "client_name = a\\nb: must be at most 64 bytes without control characters",
            ),
            (
                |h| h.role = 0,
                ByeReason::Invalid,
                "role = 0: must be ROLE_OBSERVER (1) or ROLE_CONTROLLER (2)",
            ),
            (
                |h| h.role = 3,
                ByeReason::Invalid,
                "role = 3: must be ROLE_OBSERVER (1) or ROLE_CONTROLLER (2): this device has no hand to pull (serve --hand pointer has)",
            ),
            (
                |h| h.command_interval_us = 999,
                ByeReason::Invalid,
                "command_interval_us = 999: must be 0 or 1000 to 50000 us",
            ),
            (
                |h| h.command_interval_us = 50_001,
                ByeReason::Invalid,
                "command_interval_us = 50001: must be 0 or 1000 to 50000 us",
            ),
            (
                |h| h.state_interval_us = 999,
                ByeReason::Invalid,
                "state_interval_us = 999: must be 0 or 1000 to 1000000 us",
            ),
            (
                |h| h.state_interval_us = 1_000_001,
                ByeReason::Invalid,
                "state_interval_us = 1000001: must be 0 or 1000 to 1000000 us",
            ),
            (
                |h| h.max_datagram_bytes = 299,
                ByeReason::Invalid,
                "max_datagram_bytes = 299: must be 0 or at least 300 bytes",
            ),
            (|h| h.role = -1, ByeReason::Invalid, "role = -1: must be"),
        ];
        for (change, reason, detail) in table {
            let refusal = judge(change).unwrap_err();
            assert_eq!(refusal.reason, reason, "{detail}");
            assert!(refusal.detail.contains(detail), "{}", refusal.detail);
        }
    }

    #[test]
    fn a_long_hostile_text_comes_back_short() {
        let refusal = judge(|hello| hello.device = "\u{1b}[2J".repeat(10_000)).unwrap_err();
        assert!(refusal.detail.len() < 1000 && !refusal.detail.contains('\u{1b}'));
    }
}

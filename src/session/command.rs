//! A Command as the Setpoint that the next tick takes: all of it, or nothing.
//!
//! A refusal names the field, the value and what is allowed, and changes nothing. A Command
//! that is not newer than the last one is old, not wrong: networks reorder. One computed from
//! an old State is stale however promptly it came, and a force over a path that is not good
//! enough for it is not taken at all. Contacts are models of surfaces, rendered here at full
//! rate: the worst that a bad path can do to a wall is to take it away, so nothing here does.

use crate::control::Setpoint;
use crate::proto::{self, Command, command::Body};
use crate::units::FieldError;

use super::contact::contacts;
use super::history::History;
use super::liveness::Liveness;
use super::quality::FOR_FORCES;
use super::workspace::Workspace;
use super::{Quality, SessionConfig, StaleReason, soft};

/// The largest sequence number: 17,000 years at 1 kHz, seven bytes in State, and exact in
/// languages whose only number is a double.
pub(super) const MAX_SEQ: u64 = (1 << 49) - 1;

const NS_PER_MS: u64 = 1_000_000;

/// Why a Command is not taken.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Refusal {
    /// Not newer than the last.
    Old,
    /// One field cannot be accepted.
    Invalid(FieldError),
    /// The State that it was computed from is too old.
    Stale(FieldError),
    /// The path is not good enough for it.
    Quality(FieldError),
}

impl From<FieldError> for Refusal {
    fn from(error: FieldError) -> Self {
        Self::Invalid(error)
    }
}

/// What a Command is judged by.
#[derive(Clone, Copy, Debug)]
pub(super) struct Context<'a> {
    pub config: &'a SessionConfig,
    /// Epoch of the lease it comes under.
    pub epoch: u64,
    /// The last command taken under it.
    pub last_seq: u64,
    /// The ticks reported.
    pub history: &'a History,
    /// When the session was welcomed.
    pub welcomed_ns: u64,
    pub quality: Quality,
    pub liveness: &'a Liveness,
    pub workspace: &'a Workspace,
    pub now_ns: u64,
}

/// What a Command asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Taken {
    pub setpoint: Setpoint,
    /// Why its force ends if nothing newer comes.
    pub ending: StaleReason,
}

/// The Setpoint that a Command asks for.
pub(super) fn take(command: &Command, context: &Context<'_>) -> Result<Taken, Refusal> {
    check_seq(command, context)?;
    let mut setpoint = with_body(command, context)?;
    setpoint.clutched = command.clutched;
    check_age(command, context)?;
    check_quality(command, context)?;
    setpoint.epoch = context.epoch;
    setpoint.seq = command.seq;
    setpoint.state_tick = command.state_seq;
    setpoint.received_ns = context.now_ns;
    let (ttl_ns, ending) = ttl(command, context);
    setpoint.ttl_ns = ttl_ns;
    Ok(Taken { setpoint, ending })
}

/// Its body in the device's world.
fn with_body(command: &Command, context: &Context<'_>) -> Result<Setpoint, FieldError> {
    let none = Setpoint::NONE;
    match &command.body {
        Some(Body::Contacts(wanted)) => {
            let mut contacts = contacts(&wanted.contacts)?;
            for (index, contact) in contacts.iter_mut().enumerate() {
                let mapped = context.workspace.contact(contact);
                mapped.map_err(|error| error.within(&format!("contacts[{index}]")))?;
            }
            Ok(none.with_contacts(&contacts))
        }
        Some(Body::Wrench(wanted)) => {
            let wrench = soft::wrench(wanted).map_err(|error| error.within("wrench"))?;
            Ok(none.with_wrench(wrench))
        }
        Some(Body::ForceField(wanted)) => {
            let mut field = soft::field(wanted).map_err(|error| error.within("force_field"))?;
            context.workspace.field(&mut field);
            Ok(none.with_field(field))
        }
        None if command.clutched => Ok(none),
        None => {
            let allowed = "must be contacts (maybe none), wrench or force_field";
            Err(FieldError::new("body", "absent", allowed))
        }
    }
}

fn check_age(command: &Command, context: &Context<'_>) -> Result<(), Refusal> {
    let age_ns = match (command.state_seq, context.history.newest()) {
        (_, 0) => 0,
        (0, _) => context.now_ns.saturating_sub(context.welcomed_ns),
        (tick, _) => context.history.age_ns(tick, context.now_ns),
    };
    let most_ms = match &command.body {
        Some(Body::Wrench(_) | Body::ForceField(_)) => context.config.max_age_ms,
        Some(Body::Contacts(_)) | None => context.config.max_contacts_age_ms,
    };
    if age_ns <= u64::from(most_ms) * NS_PER_MS {
        return Ok(());
    }
    // Without the numbers, which change every time: the log tells what is new.
    let value = if command.state_seq == 0 { "none" } else { "an older State" };
    let allowed = format!("must be a State at most {most_ms} ms old");
    Err(Refusal::Stale(FieldError::new("state_seq", value, allowed)))
}

fn check_quality(command: &Command, context: &Context<'_>) -> Result<(), Refusal> {
    let body = match &command.body {
        Some(Body::Wrench(_)) => "a wrench",
        Some(Body::ForceField(_)) => "a force field",
        Some(Body::Contacts(_)) | None => return Ok(()),
    };
    if context.quality >= FOR_FORCES {
        return Ok(());
    }
    let name = |quality: Quality| proto::Quality::from(quality).as_str_name();
    let allowed = format!("must be {} for {body}", name(FOR_FORCES));
    Err(Refusal::Quality(FieldError::new("session_quality", name(context.quality), allowed)))
}

fn check_seq(command: &Command, context: &Context<'_>) -> Result<(), Refusal> {
    if !(1..=MAX_SEQ).contains(&command.seq) {
        let allowed = format!("must be 1 to {MAX_SEQ}");
        return Err(FieldError::new("seq", command.seq, allowed).into());
    }
    if command.seq <= context.last_seq {
        return Err(Refusal::Old);
    }
    let newest = context.history.newest();
    if command.state_seq > newest {
        let allowed = format!("must be a State sent, at most {newest}");
        return Err(FieldError::new("state_seq", command.state_seq, allowed).into());
    }
    Ok(())
}

/// Clamped, not refused: the server's bound is its own, the client need not know it.
/// A wrench lasts no longer than its session commands.
fn ttl(command: &Command, context: &Context<'_>) -> (u64, StaleReason) {
    let config = context.config;
    let direct = matches!(command.body, Some(Body::Wrench(_)));
    let default_ms = if direct { config.default_wrench_ttl_ms } else { config.default_ttl_ms };
    let wanted_ms = if command.ttl_ms == 0 { default_ms } else { command.ttl_ms };
    let granted_ns = u64::from(wanted_ms.min(config.max_ttl_ms)) * NS_PER_MS;
    let late_ns = context.liveness.late_after_ns();
    if direct && late_ns < granted_ns {
        return (late_ns, StaleReason::Missed);
    }
    (granted_ns, StaleReason::Ttl)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::proto::{Contact, Contacts, ForceFieldCommand, WrenchCommand};
    use crate::session::Role;

    const NOW_NS: u64 = 45 * NS_PER_MS;

    fn command(contacts: Vec<Contact>) -> Command {
        Command {
            seq: 11,
            client_time_ns: 5,
            state_seq: 40,
            body: Some(Body::Contacts(Contacts { contacts })),
            ..Command::default()
        }
    }

    fn wrench() -> Command {
        let wanted = WrenchCommand { wrench: vec![1.0, 0.0, 0.0] };
        Command { body: Some(Body::Wrench(wanted)), ..command(vec![]) }
    }

    fn field() -> Command {
        let wanted = ForceFieldCommand { origin_m: vec![0.0; 3], ..ForceFieldCommand::default() };
        Command { body: Some(Body::ForceField(wanted)), ..command(vec![]) }
    }

    fn judge_with(
        command: &Command,
        change: impl FnOnce(&mut Context<'_>),
    ) -> Result<Taken, Refusal> {
        let config = SessionConfig::new("cho-2005", NS_PER_MS, 2, 4);
        let mut history = History::new(NS_PER_MS, config.greatest_age_ns());
        (1..=40).for_each(|tick| history.note(tick, tick * NS_PER_MS));
        let mut context = Context {
            config: &config,
            epoch: 6,
            last_seq: 10,
            history: &history,
            welcomed_ns: 3 * NS_PER_MS,
            quality: Quality::Good,
            liveness: &Liveness::new(Role::Controller, NS_PER_MS),
            workspace: &Workspace::SAME,
            now_ns: NOW_NS,
        };
        change(&mut context);
        take(command, &context)
    }

    fn judge(command: &Command) -> Result<Taken, Refusal> {
        judge_with(command, |_| ())
    }

    fn refused(command: &Command) -> String {
        match judge(command) {
            Err(Refusal::Invalid(error)) => error.to_string(),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_good_command_becomes_a_setpoint() {
        let setpoint = judge(&command(vec![])).unwrap().setpoint;
        assert_eq!((setpoint.epoch, setpoint.seq, setpoint.state_tick), (6, 11, 40));
        assert_eq!((setpoint.received_ns, setpoint.ttl_ns), (NOW_NS, 100 * NS_PER_MS));
        assert!(!setpoint.released && !setpoint.clutched && setpoint.field().is_none());
        let force_N = judge(&wrench()).unwrap().setpoint.field().map(|field| field.force_W_N.x);
        assert_eq!(force_N, Some(1.0));
        assert!(judge(&field()).unwrap().setpoint.field().is_some());
    }

    #[test]
    fn no_contacts_are_an_empty_world_but_no_body_is_no_command_unless_clutched() {
        assert_eq!(judge(&command(vec![])).unwrap().setpoint.contacts().count(), 0);
        let nothing = Command { body: None, ..command(vec![]) };
        let expected = "body = absent: must be contacts (maybe none), wrench or force_field";
        assert_eq!(refused(&nothing), expected);
        assert!(judge(&Command { clutched: true, ..nothing }).unwrap().setpoint.clutched);
    }

    #[test]
    fn a_bad_part_refuses_the_whole_command_by_name() {
        let message = refused(&command(vec![Contact::default()]));
        assert!(message.starts_with("contacts[0].shape = absent"), "{message}");
        let mut bad = wrench();
        bad.body = Some(Body::Wrench(WrenchCommand::default()));
        assert!(refused(&bad).starts_with("wrench.wrench = 0 numbers"));
        bad.body = Some(Body::ForceField(ForceFieldCommand::default()));
        assert!(refused(&bad).starts_with("force_field.origin_m = 0 numbers"));
    }

    #[test]
    fn time_to_live_is_clamped_and_zero_is_the_default_of_the_body() {
        type Body = fn() -> Command;
        let table: [(Body, u32, u64, StaleReason); 11] = [
            (|| command(vec![]), 0, 100, StaleReason::Ttl),
            (|| command(vec![]), 1, 1, StaleReason::Ttl),
            (|| command(vec![]), 200, 200, StaleReason::Ttl),
            (|| command(vec![]), u32::MAX, 200, StaleReason::Ttl),
            (field, 0, 100, StaleReason::Ttl),
            (field, 201, 200, StaleReason::Ttl),
            (wrench, 0, 20, StaleReason::Ttl),
            (wrench, 7, 7, StaleReason::Ttl),
            (wrench, 20, 20, StaleReason::Ttl),
            (wrench, 21, 20, StaleReason::Missed),
            (wrench, u32::MAX, 20, StaleReason::Missed),
        ];
        for (body, ttl_ms, granted_ms, ending) in table {
            let taken = judge(&Command { ttl_ms, ..body() }).unwrap();
            assert_eq!(taken.setpoint.ttl_ns, granted_ms * NS_PER_MS);
            assert_eq!(taken.ending, ending);
        }
        let slow: &'static _ = Box::leak(Box::new(Liveness::new(Role::Controller, 13_889_000)));
        let long = Command { ttl_ms: 150, ..wrench() };
        let taken = judge_with(&long, |context| context.liveness = slow).unwrap();
        assert_eq!((taken.setpoint.ttl_ns, taken.ending), (150 * NS_PER_MS, StaleReason::Ttl));
    }

    #[test]
    fn what_is_not_newer_is_old_and_what_is_no_number_of_a_command_is_invalid() {
        for seq in [1, 9, 10] {
            let command = Command { seq, ..command(vec![]) };
            assert_eq!(judge(&command), Err(Refusal::Old));
        }
        for seq in [0, MAX_SEQ + 1, u64::MAX] {
            let command = Command { seq, ..command(vec![]) };
            let expected = format!("seq = {seq}: must be 1 to 562949953421311");
            assert_eq!(refused(&command), expected);
        }
    }

    #[test]
    fn a_state_that_was_never_sent_is_refused_and_an_old_one_is_stale() {
        let future = Command { state_seq: 41, ..command(vec![]) };
        assert_eq!(refused(&future), "state_seq = 41: must be a State sent, at most 40");
        for (state_seq, now_ms, taken) in [
            (40, 40, true),
            (40, 41, false),
            (1, 1, true),
            (1, 2, false),
            (0, 3, true),
            (0, 4, false),
        ] {
            for (command, most_ms) in [(wrench(), 200), (field(), 200), (command(vec![]), 1000)] {
                let command = Command { state_seq, ..command };
                let now_ns = (now_ms + most_ms) * NS_PER_MS;
                match judge_with(&command, |context| context.now_ns = now_ns) {
                    Err(Refusal::Stale(error)) => {
                        let value = if state_seq == 0 { "none" } else { "an older State" };
                        let expected = format!(
                            "state_seq = {value}: must be a State at most {most_ms} ms old"
                        );
                        assert_eq!((error.to_string(), taken), (expected, false));
                    }
                    other => assert_eq!(other.is_ok(), taken, "{state_seq} at {now_ms}"),
                }
            }
        }
    }

    #[test]
    fn each_body_needs_its_quality() {
        for quality in Quality::ALL {
            let table = [
                (command(vec![]), Quality::Poor),
                (wrench(), Quality::Good),
                (field(), Quality::Good),
                (Command { body: None, clutched: true, ..command(vec![]) }, Quality::Poor),
            ];
            for (command, needed) in table {
                let result = judge_with(&command, |context| context.quality = quality);
                assert_eq!(result.is_ok(), quality >= needed, "{command:?}");
                assert!(result.is_ok() || matches!(result, Err(Refusal::Quality(_))));
            }
        }
        let result = judge_with(&wrench(), |context| context.quality = Quality::Fair);
        let Err(Refusal::Quality(error)) = result else { panic!("{result:?}") };
        let expected = "session_quality = QUALITY_FAIR: must be QUALITY_GOOD for a wrench";
        assert_eq!(error.to_string(), expected);
    }
}

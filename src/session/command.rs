//! A Command as the Setpoint that the next tick takes: all of it, or nothing.
//!
//! A refusal names the field, the value and what is allowed, and changes nothing. A Command that is not newer
//! than the last one is old, not wrong: networks reorder.

use crate::control::Setpoint;
use crate::proto::{Command, command::Body};
use crate::units::FieldError;

use super::SessionConfig;
use super::contact::contacts;

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
    /// The newest tick reported.
    pub newest_tick: u64,
    pub now_ns: u64,
}

/// The Setpoint that a Command asks for.
pub(super) fn setpoint(command: &Command, context: &Context<'_>) -> Result<Setpoint, Refusal> {
    check_seq(command, context)?;
    let Some(Body::Contacts(wanted)) = &command.body else {
        return Err(FieldError::new("body", "absent", "must be contacts, maybe none").into());
    };
    let contacts = contacts(&wanted.contacts)?;
    let mut setpoint = Setpoint::NONE.with_contacts(&contacts);
    setpoint.epoch = context.epoch;
    setpoint.seq = command.seq;
    setpoint.state_tick = command.state_seq;
    setpoint.received_ns = context.now_ns;
    setpoint.ttl_ns = ttl_ns(command.ttl_ms, context.config);
    Ok(setpoint)
}

fn check_seq(command: &Command, context: &Context<'_>) -> Result<(), Refusal> {
    if !(1..=MAX_SEQ).contains(&command.seq) {
        let allowed = format!("must be 1 to {MAX_SEQ}");
        return Err(FieldError::new("seq", command.seq, allowed).into());
    }
    if command.seq <= context.last_seq {
        return Err(Refusal::Old);
    }
    if command.state_seq > context.newest_tick {
        let allowed = format!("must be a State sent, at most {}", context.newest_tick);
        return Err(FieldError::new("state_seq", command.state_seq, allowed).into());
    }
    Ok(())
}

/// Clamped, not refused: the server's bound is its own, the client need not know it.
fn ttl_ns(ttl_ms: u32, config: &SessionConfig) -> u64 {
    let wanted_ms = if ttl_ms == 0 { config.default_ttl_ms } else { ttl_ms };
    u64::from(wanted_ms.min(config.max_ttl_ms)) * NS_PER_MS
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::proto::{Contact, Contacts};

    const NOW_NS: u64 = 77;

    fn command(contacts: Vec<Contact>) -> Command {
        Command {
            seq: 11,
            client_time_ns: 5,
            state_seq: 40,
            ttl_ms: 0,
            body: Some(Body::Contacts(Contacts { contacts })),
        }
    }

    fn judge(command: &Command) -> Result<Setpoint, Refusal> {
        let config = SessionConfig::new("cho-2005", 1_000_000, 2, 4);
        let context =
            Context { config: &config, epoch: 6, last_seq: 10, newest_tick: 40, now_ns: NOW_NS };
        setpoint(command, &context)
    }

    fn refused(command: &Command) -> String {
        match judge(command) {
            Err(Refusal::Invalid(error)) => error.to_string(),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_good_command_becomes_a_setpoint() {
        let setpoint = judge(&command(vec![])).unwrap();
        assert_eq!((setpoint.epoch, setpoint.seq, setpoint.state_tick), (6, 11, 40));
        assert_eq!((setpoint.received_ns, setpoint.ttl_ns), (NOW_NS, 100 * NS_PER_MS));
        assert!(!setpoint.released);
    }

    #[test]
    fn no_contacts_are_an_empty_world_but_no_body_is_no_command() {
        assert_eq!(judge(&command(vec![])).unwrap().contacts().count(), 0);
        let nothing = Command { body: None, ..command(vec![]) };
        assert_eq!(refused(&nothing), "body = absent: must be contacts, maybe none");
    }

    #[test]
    fn a_bad_contact_refuses_the_whole_command() {
        let message = refused(&command(vec![Contact::default()]));
        assert!(message.starts_with("contacts[0].shape = absent"), "{message}");
    }

    #[test]
    fn time_to_live_is_clamped_and_zero_is_the_default() {
        for (ttl_ms, granted_ms) in [(0, 100), (1, 1), (200, 200), (201, 200), (u32::MAX, 200)] {
            let command = Command { ttl_ms, ..command(vec![]) };
            assert_eq!(judge(&command).unwrap().ttl_ns, granted_ms * NS_PER_MS);
        }
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
    fn a_state_that_was_never_sent_is_refused() {
        let future = Command { state_seq: 41, ..command(vec![]) };
        assert_eq!(refused(&future), "state_seq = 41: must be a State sent, at most 40");
    }
}

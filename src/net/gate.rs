//! The gate: a token becomes a caller, and what callers do becomes lines of the audit log.
//!
//! On loopback, and where it was asked for in so many words, nothing is asked and everybody is
//! an operator called `local`. Elsewhere a [`Keyring`] judges. What needs which grant is said
//! where it is asked for: by the stream for a Hello (`guests`), by the services for each method
//! (`grpc::guard`).

use crate::audit::{AuditLog, Event, What};
use crate::credentials::{Denied, Grant, Holder, Keyring, LOCAL, NotAllowed, TokenHash};
use crate::proto::ByeReason;
use crate::telemetry::{TurnedAway, TurnedAwayMetrics};
use crate::utc::Utc;

/// The gate of one server.
#[derive(Debug)]
pub struct Gate {
    /// `None`: everybody may do everything.
    keyring: Option<Keyring>,
    audit: AuditLog,
    metrics: TurnedAwayMetrics,
}

/// Somebody who was let in.
#[derive(Clone, Debug, PartialEq)]
pub struct Caller {
    holder: Holder,
    /// Of the token, by which it is judged again while it stays.
    hash: Option<TokenHash>,
}

/// Why somebody is not let in, or not allowed what was asked for.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refused {
    /// The token does not count.
    #[error(transparent)]
    Denied(#[from] Denied),
    /// It does not allow this.
    #[error(transparent)]
    NotAllowed(#[from] NotAllowed),
    /// One credential leaves room for others.
    #[error("credential {name} has {held} of {most} sessions; end one of them")]
    Share { name: String, held: usize, most: usize },
}

impl Gate {
    /// With a keyring it asks for credentials, without it for nothing.
    pub fn new(keyring: Option<Keyring>, audit: AuditLog, metrics: TurnedAwayMetrics) -> Self {
        Self { keyring, audit, metrics }
    }

    /// Whether a credential is needed.
    pub fn is_guarded(&self) -> bool {
        self.keyring.is_some()
    }

    /// Whose token this is.
    pub fn judge(&self, token: &str) -> Result<Caller, Denied> {
        let Some(keyring) = &self.keyring else { return Ok(Caller::local()) };
        let holder = keyring.judge(token, Utc::now())?;
        Ok(Caller { holder, hash: Some(TokenHash::of(token)) })
    }

    /// Whether somebody who was let in would be let in now, for the same: credentials are
    /// revoked, changed and expire.
    pub fn still(&self, caller: &Caller, needed: Grant, device: &str) -> Result<(), Refused> {
        let (Some(keyring), Some(hash)) = (&self.keyring, &caller.hash) else { return Ok(()) };
        Ok(keyring.judge_hash(hash, Utc::now())?.check(needed, device)?)
    }

    /// Looks for changes of the credentials. Reads a file: not for a thread that forces wait for.
    pub fn refresh(&self, now_ns: u64) {
        use crate::credentials::Refreshed;
        let refreshed = self.keyring.as_ref().map(|keyring| keyring.refresh(now_ns));
        if let Some(Refreshed::Changed) = refreshed {
            self.record(What::CredentialsChanged, &Caller::local(), "", "", "");
        }
    }

    /// Into the audit log; never waits.
    pub fn record(&self, what: What, caller: &Caller, from: &str, device: &str, detail: &str) {
        self.audit.record(&Event { what, who: caller.name(), from, device, detail });
    }

    /// Something reached no session.
    pub fn count(&self, why: TurnedAway) {
        self.metrics.count(why);
    }

    /// Somebody was not let in, or not allowed what was asked for.
    pub fn record_refused(&self, who: &str, from: &str, device: &str, detail: &str) {
        self.count(TurnedAway::Denied);
        self.audit.record(&Event { what: What::Refused, who, from, device, detail });
    }
}

impl Caller {
    /// Whoever needs no credential.
    pub fn local() -> Self {
        let holder = Holder { name: LOCAL.to_owned(), grant: Grant::Operator, device: None };
        Self { holder, hash: None }
    }

    /// Name of the credential.
    pub fn name(&self) -> &str {
        &self.holder.name
    }

    /// What it may do, and where.
    pub fn holder(&self) -> &Holder {
        &self.holder
    }
}

impl Refused {
    /// The credential's name, where there is one.
    pub fn who(&self) -> &str {
        match self {
            Self::Denied(Denied::Missing | Denied::Unknown) => "",
            Self::Denied(Denied::Expired { name, .. })
            | Self::NotAllowed(NotAllowed::Grant { name, .. } | NotAllowed::Device { name, .. })
            | Self::Share { name, .. } => name,
        }
    }

    /// What a Bye says.
    pub fn reason(&self) -> ByeReason {
        match self {
            Self::Denied(_) | Self::NotAllowed(_) => ByeReason::Denied,
            Self::Share { .. } => ByeReason::TooManySessions,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::credentials::{CredentialFile, Wanted};
    use crate::telemetry::Telemetry;

    #[test]
    fn without_a_keyring_everybody_is_local_and_with_one_a_token_decides() {
        let folder = tempfile::tempdir().unwrap();
        let audit = || AuditLog::open(folder.path()).unwrap();
        let telemetry = Telemetry::new().unwrap();
        let metrics = || telemetry.turned_away();
        let open = Gate::new(None, audit(), metrics());
        let caller = open.judge("").unwrap();
        assert_eq!(caller.name(), "local");
        assert_eq!(open.still(&caller, Grant::Operator, "devices/any"), Ok(()));

        let file = CredentialFile::in_directory(folder.path());
        let wanted = Wanted {
            name: "anna".into(),
            grant: Grant::Controller,
            device: Some("devices/left".into()),
            days: None,
            replace: false,
        };
        let (token, _) = file.issue(wanted, Utc::now()).unwrap();
        let keyring = Keyring::open(folder.path()).unwrap();
        let guarded = Gate::new(Some(keyring), audit(), metrics());
        assert_eq!(guarded.judge(""), Err(Denied::Missing));
        assert_eq!(guarded.judge("guessed"), Err(Denied::Unknown));
        let anna = guarded.judge(token.as_str()).unwrap();
        assert_eq!(anna.name(), "anna");
        assert_eq!(guarded.still(&anna, Grant::Controller, "devices/left"), Ok(()));
        for (needed, device) in
            [(Grant::Operator, "devices/left"), (Grant::Observer, "devices/right")]
        {
            let refused = guarded.still(&anna, needed, device).unwrap_err();
            assert_eq!(refused.who(), "anna", "{refused}");
        }
        file.revoke("anna").unwrap();
        guarded.refresh(u64::MAX / 2);
        let refused = guarded.still(&anna, Grant::Observer, "devices/left");
        assert_eq!(refused, Err(Refused::Denied(Denied::Unknown)));
    }
}

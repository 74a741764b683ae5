//! `hapticd ctl session` and `ctl lease`: who is connected, and who commands.

use crate::client::Authorized;
use clap::Subcommand;
use serde_json::{Value, json};

use super::ctl::plain;
use super::format::word;
use crate::proto::session_service_client::SessionServiceClient;
use crate::proto::{
    AcquireLeaseRequest, CloseSessionRequest, Lease, ListSessionsRequest, ReleaseLeaseRequest,
    Session,
};

/// Sessions of the stream
#[derive(Debug, Subcommand)]
#[command(after_help = "Examples:
  hapticd ctl session list
  hapticd ctl session close 3")]
pub enum SessionCommand {
    /// Who is connected, to one device (--device) or to all
    #[command(after_help = "Examples:
  hapticd ctl session list
  hapticd ctl session list --device left --json")]
    List,
    /// Send one away; its force fades
    #[command(after_help = "Example:
  hapticd ctl session close 3")]
    Close {
        /// Its number, as `list` shows it
        #[arg(value_name = "ID")]
        session: String,
    },
}

/// The lease: who commands a device
#[derive(Debug, Subcommand)]
#[command(after_help = "Examples:
  hapticd ctl lease acquire 3 --takeover
  hapticd ctl lease release 3")]
pub enum LeaseCommand {
    /// Make a session the controller of its device
    #[command(after_help = "Examples:
  hapticd ctl lease acquire 3
  hapticd ctl lease acquire 3 --takeover")]
    Acquire {
        /// Its number, as `session list` shows it
        #[arg(value_name = "ID")]
        session: String,
        /// Take the lease from the session that holds it, which becomes an observer
        #[arg(long)]
        takeover: bool,
    },
    /// Make the controller an observer; its force fades
    #[command(after_help = "Example:
  hapticd ctl lease release 3")]
    Release {
        /// Its number
        #[arg(value_name = "ID")]
        session: String,
    },
}

type Client = SessionServiceClient<Authorized>;

impl SessionCommand {
    /// Does it and prints the answer; `device` is empty for all.
    pub async fn run(
        self,
        sessions: &mut Client,
        device: String,
        as_json: bool,
    ) -> anyhow::Result<()> {
        match self {
            Self::List => {
                let listed = sessions.list_sessions(ListSessionsRequest { device }).await;
                print_list(&listed.map_err(plain)?.into_inner().sessions, as_json);
            }
            Self::Close { session } => {
                let name = name_of(&session);
                sessions.close_session(CloseSessionRequest { name }).await.map_err(plain)?;
                say!("{} closed", name_of(&session));
            }
        }
        Ok(())
    }
}

impl LeaseCommand {
    /// Does it and prints who commands then.
    pub async fn run(self, sessions: &mut Client, as_json: bool) -> anyhow::Result<()> {
        let lease = match self {
            Self::Acquire { session, takeover } => {
                let name = name_of(&session);
                sessions.acquire_lease(AcquireLeaseRequest { name, takeover }).await
            }
            Self::Release { session } => {
                sessions.release_lease(ReleaseLeaseRequest { name: name_of(&session) }).await
            }
        };
        let Lease { session, epoch } = lease.map_err(plain)?.into_inner();
        match (as_json, session.as_str()) {
            (true, _) => say!("{}", json!({ "session": session, "epoch": epoch })),
            (false, "") => say!("nobody commands"),
            (false, session) => say!("{session} commands, epoch {epoch}"),
        }
        Ok(())
    }
}

fn name_of(session: &str) -> String {
    format!("sessions/{}", session.strip_prefix("sessions/").unwrap_or(session))
}

fn print_list(sessions: &[Session], as_json: bool) {
    if as_json {
        let list: Vec<_> = sessions.iter().map(session_json).collect();
        say!("{}", Value::from(list));
        return;
    }
    if sessions.is_empty() {
        say!("nobody is connected");
    }
    for session in sessions {
        let round_trip =
            session.round_trip_s.map_or("-".to_owned(), |s| format!("{:.2} ms", s * 1e3));
        say!(
            "{:<13} {:<20} {:<11} {:<11} {:<9} loss {:>5.1} %  rtt {round_trip:>8}  {}{}{}{}",
            session.name,
            session.device,
            word(session.role().as_str_name(), "ROLE_"),
            if session.waiting {
                "waiting".into()
            } else {
                word(session.state().as_str_name(), "SESSION_STATE_")
            },
            word(session.quality().as_str_name(), "QUALITY_"),
            session.loss_ratio * 100.0,
            // What a client calls itself is its own text.
            session.client_name.escape_debug(),
            match session.slowed_by {
                0 | 1 => String::new(),
                slowed_by =>
                    format!("  gets 1 State in {slowed_by}: its path loses or delays them"),
            },
            if session.clutched { "  clutched" } else { "" },
            match session.last_refusal.as_str() {
                "" => String::new(),
                refusal => format!("\n{:>15}refused: {refusal}", ""),
            },
        );
    }
}

fn session_json(session: &Session) -> Value {
    json!({
        "name": session.name,
        "device": session.device,
        "client_name": session.client_name,
        "role": word(session.role().as_str_name(), "ROLE_"),
        "transport": session.transport,
        "state": word(session.state().as_str_name(), "SESSION_STATE_"),
        "waiting": session.waiting,
        "quality": word(session.quality().as_str_name(), "QUALITY_"),
        "loss_ratio": session.loss_ratio,
        "delay_variation_s": session.delay_variation_s,
        "round_trip_s": session.round_trip_s,
        "felt_stiffness_ratio": session.felt_stiffness_ratio,
        "slowed_by": session.slowed_by,
        "clutched": session.clutched,
        "lease_epoch": session.lease_epoch,
        "last_refusal": session.last_refusal,
    })
}

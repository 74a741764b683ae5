//! A hand over the network: who pulls the handle of a simulated device, and where.
//!
//! Several sessions may have the role; the newest one pulls, and when it goes the one before
//! pulls again. A hand of which nothing comes for [`HOLDS_NS`], or whose session ends, lets
//! go. How the pull becomes a force is the device's business.

use nalgebra::Vector3;

use super::command::{MAX_SEQ, Refusal};
use super::peer::Peer;
use super::workspace::Workspace;
use super::{Outcome, Output, Role, SessionId, Sessions};
use crate::proto;
use crate::units::{FieldError, POSITION};
use crate::wire::get3;

/// How long a hand pulls without a new target.
const HOLDS_NS: u64 = 250_000_000;

/// Where a hand pulls the tool point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandTarget {
    /// In the device's W.
    pub position_W_m: Vector3<f64>,
    /// False: it let go, and the position means nothing.
    pub held: bool,
    /// Buttons that it presses.
    pub buttons: u32,
    /// Device clock at receipt.
    pub received_ns: u64,
}

/// The hand that pulls now.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pull {
    by: SessionId,
    received_ns: u64,
}

impl Pull {
    /// When it lets go by itself.
    pub fn ends_ns(&self) -> u64 {
        self.received_ns.saturating_add(HOLDS_NS)
    }
}

impl Sessions {
    /// A hand says where it pulls.
    pub(super) fn on_hand_target(
        &mut self,
        id: SessionId,
        target: &proto::HandTarget,
        now_ns: u64,
    ) -> Outcome {
        let newest = self.newest_hand();
        let Some(open) = self.peers.get_mut(&id).and_then(|peer| peer.open.as_mut()) else {
            return Outcome::Unexpected;
        };
        if newest != Some(id) {
            return Outcome::NotAllowed;
        }
        open.judge.take(target.seq, target.client_time_ns, now_ns);
        match checked(target, open.last_seq, &open.workspace, now_ns) {
            Ok(wanted) => {
                open.last_seq = target.seq;
                open.liveness.commanded(now_ns);
                self.pull = wanted.held.then_some(Pull { by: id, received_ns: now_ns });
                self.outbox.may(Output::Hand(wanted));
                Outcome::Accepted
            }
            Err(Refusal::Invalid(error)) => {
                open.last_refusal = Some(error);
                Outcome::Invalid
            }
            Err(_) => Outcome::Old,
        }
    }

    /// The session that may pull.
    fn newest_hand(&self) -> Option<SessionId> {
        let is_hand = |peer: &Peer| {
            let role = peer.open.as_ref().map(|open| open.role);
            role == Some(Role::Hand) && peer.waiting.is_none()
        };
        let mut newest_first = self.peers.iter().rev();
        newest_first.find(|(_, peer)| is_hand(peer)).map(|(id, _)| *id)
    }

    /// Lets go where the one that pulls is not the one that may, or has said nothing for
    /// too long.
    pub(super) fn watch_hand(&mut self, now_ns: u64) {
        let newest = self.newest_hand();
        if self.pull.is_some_and(|pull| newest != Some(pull.by) || now_ns >= pull.ends_ns()) {
            self.pull = None;
            self.outbox.must(Output::Hand(HandTarget {
                position_W_m: Vector3::zeros(),
                held: false,
                buttons: 0,
                received_ns: now_ns,
            }));
        }
    }
}

fn checked(
    target: &proto::HandTarget,
    last_seq: u64,
    workspace: &Workspace,
    now_ns: u64,
) -> Result<HandTarget, Refusal> {
    if !(1..=MAX_SEQ).contains(&target.seq) {
        let allowed = format!("must be 1 to {MAX_SEQ}");
        return Err(FieldError::new("seq", target.seq, allowed).into());
    }
    if target.seq <= last_seq {
        return Err(Refusal::Old);
    }
    let mut position_W_m = Vector3::zeros();
    if target.held || !target.position_m.is_empty() {
        let position_m = Vector3::from(get3("position_m", &target.position_m)?);
        for value in &position_m {
            POSITION.check("position_m", *value)?;
        }
        position_W_m = workspace.position(&position_m);
    }
    let (held, buttons) = (target.held, target.buttons);
    Ok(HandTarget { position_W_m, held, buttons, received_ns: now_ns })
}

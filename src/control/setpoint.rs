//! What the stream thread hands to the next tick: the controller's newest command.
//!
//! In the device's W, whatever workspace the controller has. One command carries one body:
//! contacts, or a soft force. A wrench that is the same everywhere is a field without
//! stiffness, damping and edge.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use super::Wrench;
use crate::environment::{Contact, ForceField, MAX_CONTACTS, Tool};

/// The newest command of the controller; all zero when there is none.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setpoint {
    /// Fencing epoch of the lease it came under, 0 for no command ever.
    pub epoch: u64,
    /// The command's own number, 0 for none.
    pub seq: u64,
    /// The tick whose State it was computed from.
    pub state_tick: u64,
    /// Device time at which it was received.
    pub received_ns: u64,
    /// How long it holds from then.
    pub ttl_ns: u64,
    /// Grows with every setpoint that is handed to the device, 0 for none ever.
    pub number: u64,
    contacts: [Option<Contact>; MAX_CONTACTS],
    field: Option<ForceField>,
    /// The owner let go on purpose: its force ends now, by the same ramp.
    pub released: bool,
    /// The owner lifted its workspace off the device: while this is fresh, nothing at all is
    /// rendered.
    pub clutched: bool,
}

impl Setpoint {
    /// No command.
    pub const NONE: Self = Self {
        epoch: 0,
        seq: 0,
        state_tick: 0,
        received_ns: 0,
        ttl_ns: 0,
        number: 0,
        contacts: [None; MAX_CONTACTS],
        field: None,
        released: false,
        clutched: false,
    };

    /// The same command with these contacts for its body; those beyond [`MAX_CONTACTS`] are
    /// dropped, so whoever maps a message checks the number first.
    #[must_use]
    pub fn with_contacts(mut self, contacts: &[Contact]) -> Self {
        (self.contacts, self.field) = ([None; MAX_CONTACTS], None);
        for (place, contact) in self.contacts.iter_mut().zip(contacts) {
            *place = Some(*contact);
        }
        self
    }

    /// The same command with a force field for its body.
    #[must_use]
    pub fn with_field(mut self, field: ForceField) -> Self {
        (self.contacts, self.field) = ([None; MAX_CONTACTS], Some(field));
        self
    }

    /// The same command with a wrench for its body.
    #[must_use]
    pub fn with_wrench(self, wrench: Wrench) -> Self {
        self.with_field(ForceField {
            origin_W_m: Vector3::zeros(),
            force_W_N: wrench.force_N,
            moment_W_Nm: wrench.moment_Nm,
            stiffness_N_per_m: Matrix3::zeros(),
            damping_Ns_per_m: Matrix3::zeros(),
            radius_m: f64::INFINITY,
        })
    }

    /// The local models it carries.
    pub fn contacts(&self) -> impl Iterator<Item = &Contact> {
        self.contacts.iter().flatten()
    }

    /// The field it carries, if that is its body.
    pub fn field(&self) -> Option<&ForceField> {
        self.field.as_ref()
    }

    /// What its field asks of this tool, in W; nothing where it has none.
    pub fn soft(&self, tool: &Tool) -> Wrench {
        let Some(field) = &self.field else { return Wrench::default() };
        let [force_N, moment_Nm] = field.at(&tool.p_WT_m, &tool.v_WT_m_per_s);
        Wrench { force_N, moment_Nm }
    }

    /// True while it counts: its time-to-live is not over and nobody let go.
    pub fn is_fresh(&self, now_ns: u64) -> bool {
        self.seq != 0 && !self.released && now_ns.saturating_sub(self.received_ns) <= self.ttl_ns
    }

    /// True while it may be rendered.
    pub fn is_rendered(&self, now_ns: u64) -> bool {
        self.is_fresh(now_ns) && !self.clutched
    }
}

impl Default for Setpoint {
    fn default() -> Self {
        Self::NONE
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;

    use super::*;
    use crate::environment::ToolMotion;

    #[test]
    fn a_command_has_one_body_and_a_wrench_is_the_same_everywhere() {
        let wrench = Wrench { force_N: Vector3::x(), moment_Nm: Vector3::z() * 0.1 };
        let setpoint = Setpoint::NONE.with_wrench(wrench);
        for place in [0.0, 0.3, 1e6] {
            let motion = ToolMotion {
                p_WT_m: Vector3::repeat(place),
                q_WT: UnitQuaternion::identity(),
                v_WT_m_per_s: Vector3::repeat(-place),
                omega_WT_rad_per_s: Vector3::zeros(),
            };
            let tool = Tool::new(&motion, &[], 0.0, 1e-3);
            assert_eq!(setpoint.soft(&tool), wrench);
            assert_eq!(setpoint.with_contacts(&[]).soft(&tool), Wrench::default());
        }
        assert_eq!(setpoint.contacts().count(), 0);
    }
}

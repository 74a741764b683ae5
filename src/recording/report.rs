//! A tick's Report as the contract has it in recordings, and where two of them differ.
//!
//! Every number keeps its bits: vectors are packed and single numbers optional, so that even
//! the sign of a zero is written.

use nalgebra::Vector3;
use prost::Message;

use crate::control::{ContactResult, Event, Report, Wrench};
use crate::environment::Source;
use crate::proto::record_event::{Surface, What};
use crate::proto::{self, RecordContact, RecordEvent, RecordReport};

/// Everything in a report but its number and time.
pub(super) fn report_entry(report: &Report) -> RecordReport {
    let list = |v: &Vector3<f64>| v.as_slice().to_vec();
    RecordReport {
        mode: proto::Mode::from(report.mode).into(),
        fault: report.fault.map_or(0, |fault| proto::Fault::from(fault).into()),
        position_m: list(&report.p_WT_m),
        orientation: report.q_WT.coords.as_slice().to_vec(),
        velocity_m_per_s: list(&report.v_WT_m_per_s),
        angular_velocity_rad_per_s: list(&report.omega_WT_rad_per_s),
        proxy_m: list(&report.proxy_W_m),
        hand: report.hand.as_ref().map_or_else(Vec::new, wrench),
        requested: wrench(&report.requested),
        achievable: wrench(&report.achievable),
        rendered: wrench(&report.rendered),
        rendered_source: proto::RenderedSource::from(report.rendered_source).into(),
        region: report.region.map_or(0, |region| proto::Region::from(region).into()),
        approximation_angle_rad: report.approximation_angle_rad,
        force_error_n: report.force_error_N,
        stuck: report.stuck,
        limits: report.limits.bits(),
        law: report.law.map_or(0, |law| proto::Strategy::from(law).into()),
        contacts: report.contacts().iter().map(contact).collect(),
        buttons: report.buttons,
        command_seq: report.command_seq,
        command_new: report.command_new,
        command_lag_ticks: report.command_lag_ticks,
        command_age_ns: report.command_age_ns,
        scene_revision: report.scene_revision,
        last_event: report.last_event,
        events: report.events.iter().flatten().map(event).collect(),
        shaft_rad: report.shaft_rad.as_slice().to_vec(),
        shaft_rad_per_s: report.shaft_rad_per_s.as_slice().to_vec(),
        lower_nm: report.bounds.lower_Nm.as_slice().to_vec(),
        upper_nm: report.bounds.upper_Nm.as_slice().to_vec(),
        commanded_nm: report.commanded_Nm.as_slice().to_vec(),
        handle_plane: report.p_BH.as_slice().to_vec(),
    }
}

fn wrench(wrench: &Wrench) -> Vec<f64> {
    [wrench.force_N.as_slice(), wrench.moment_Nm.as_slice()].concat()
}

fn contact(contact: &ContactResult) -> RecordContact {
    RecordContact {
        controller: contact.source == Source::Controller,
        id: contact.id,
        depth_m: Some(contact.depth_m),
        normal_n: Some(contact.normal_N),
        friction_n: Some(contact.friction_N),
        sticking: contact.sticking,
    }
}

fn event(event: &Event) -> RecordEvent {
    let surface = |source, id| Surface { controller: source == Source::Controller, id };
    let what = match *event {
        Event::ContactBegin { source, id } => What::ContactBegin(surface(source, id)),
        Event::ContactEnd { source, id } => What::ContactEnd(surface(source, id)),
        Event::StuckBegin => What::Stuck(true),
        Event::StuckEnd => What::Stuck(false),
        Event::Mode(mode) => What::Mode(proto::Mode::from(mode).into()),
        Event::Stale => What::Stale(true),
        Event::Fault(fault) => What::Fault(proto::Fault::from(fault).into()),
        Event::Button(buttons) => What::Buttons(buttons),
    };
    RecordEvent { what: Some(what) }
}

/// Something with bits that can be compared.
trait Bits {
    /// Equal to the last bit, signs of zeros and kinds of NaN included.
    fn same(&self, other: &Self) -> bool;
}

impl Bits for Vec<f64> {
    fn same(&self, other: &Self) -> bool {
        self.len() == other.len() && self.iter().zip(other).all(|(a, b)| a.to_bits() == b.to_bits())
    }
}

impl Bits for Option<f64> {
    fn same(&self, other: &Self) -> bool {
        self.map(f64::to_bits) == other.map(f64::to_bits)
    }
}

/// Messages, whose bytes keep every bit.
macro_rules! message_bits {
    ($($message:ty)*) => { $(impl Bits for Vec<$message> {
        fn same(&self, other: &Self) -> bool {
            let bytes = |all: &Self| all.iter().map(Message::encode_to_vec).collect::<Vec<_>>();
            bytes(self) == bytes(other)
        }
    })* };
}
message_bits!(RecordContact RecordEvent);

macro_rules! plain_bits {
    ($($plain:ty)*) => { $(impl Bits for $plain {
        fn same(&self, other: &Self) -> bool {
            self == other
        }
    })* };
}
plain_bits!(bool i32 u32 u64);

/// Goes through the fields in the order of a tick, all of them, or it does not compile.
macro_rules! first_of {
    ($a:expr, $b:expr, $($field:ident)*) => {{
        let RecordReport { $($field),* } = $a;
        $(if !$field.same(&$b.$field) {
            return Some((stringify!($field), format!("{:?}", $field), format!("{:?}", $b.$field)));
        })*
        None
    }};
}

/// The first field that differs, with both values; causes come before what follows from them.
pub(super) fn first_difference(
    recorded: &RecordReport,
    replayed: &RecordReport,
) -> Option<(&'static str, String, String)> {
    first_of!(recorded, replayed,
        mode fault shaft_rad handle_plane position_m orientation shaft_rad_per_s velocity_m_per_s
        angular_velocity_rad_per_s hand buttons scene_revision command_seq command_new
        command_lag_ticks command_age_ns lower_nm upper_nm requested proxy_m contacts limits law
        achievable approximation_angle_rad force_error_n region commanded_nm rendered
        rendered_source stuck last_event events
    )
}

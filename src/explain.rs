//! PURE from the report of a tick to sentences: why it feels as it does.
//!
//! The chain of one tick is told link by link (mode, world, command, asked, wanted, limits,
//! law, felt), and the reasons why less, other, or nothing is felt come out in the order in
//! which they decide: whoever asks "why do I feel nothing" reads the first. Forces in W,
//! newtons. Knows one tick and the [`Circumstances`] around it; what comes and goes from tick
//! to tick is seen by asking again.

mod surroundings;

#[cfg(test)]
mod tests;

use nalgebra::Vector3;

use crate::actuation::{Region, Strategy};
use crate::control::{Limit, Mode, RenderedSource, Report};
use crate::session::Role;

pub use surroundings::{NearestSurface, Surroundings, surroundings};

/// Less than this counts as nothing: twice the usual bias of the force sensor.
const FELT_N: f64 = 0.2;

/// Less than this is not asked at all.
const ASKED: f64 = 1e-9;

/// A command that ran out longer ago than this explains nothing any more.
const FORGOTTEN_S: f64 = 60.0;

/// Why less, other, or nothing is felt, most decisive first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Reason {
    /// A fault latched; everything is released.
    Fault,
    /// The device was stopped on purpose.
    Stopped,
    /// The place of the handle is not known.
    NotHomed,
    /// The device is disabled.
    Disabled,
    /// The client's workspace is clutched: nothing is rendered meanwhile.
    Clutched,
    /// The controller's command ran out.
    Stale,
    /// Somebody set the gain to nothing.
    NoGain,
    /// Whoever asks only observes, and nobody commands.
    Observer,
    /// There is no object and no command.
    NoScene,
    /// The tool is inside a surface that began around it, and so gave way.
    GivenAway,
    /// No surface lies where the handle can get.
    OutOfReach,
    /// There are objects or contacts, but the tool touches none and is in no field.
    NothingTouched,
    /// What is asked lies outside the device's freedoms.
    OutsideFreedoms,
    /// Brakes would have to push: the force asked for would drive the motion.
    NotDisplayable,
    /// More was asked than the force limit allows.
    ForceLimit,
    /// More was asked than the device can give here.
    DeviceRange,
    /// An actuator is at its torque limit.
    TorqueLimit,
    /// Motors would feed what surfaces ask: it is softened to what they can hold.
    Softened,
    /// The controller's force has fed the handle as much as it may.
    HeldBack,
    /// The device was enabled, or the gain or limit raised, a moment ago.
    Activation,
    /// A soft force is still growing as fast as it may.
    Slew,
    /// More surfaces are touched than a law considers.
    TooManyContacts,
    /// The gain makes less of what is asked.
    Gain,
    /// The brakes give the nearest direction that they have.
    Approximate,
    /// The brakes hold the handle where it should be free.
    Stuck,
    /// The force felt is not known: no sensor, and brakes that hold.
    Unmeasured,
}

/// One link of the chain.
#[derive(Clone, Debug, PartialEq)]
pub struct Link {
    /// What the link is about.
    pub name: &'static str,
    /// What it came to, in words.
    pub text: String,
    /// The force after it, where there is one.
    pub force_W_N: Option<Vector3<f64>>,
}

/// The account of one tick.
#[derive(Clone, Debug, PartialEq)]
pub struct Explanation {
    /// One sentence.
    pub summary: String,
    /// Why, most decisive first; empty where what was asked is felt.
    pub reasons: Vec<(Reason, String)>,
    /// The chain.
    pub chain: Vec<Link>,
}

/// What a report does not say.
#[derive(Clone, Debug, PartialEq)]
pub struct Circumstances<'a> {
    /// Name of the client that commands.
    pub controller: Option<&'a str>,
    /// Role of the session on whose behalf it is asked, if any.
    pub asked_by: Option<Role>,
    /// What is around the tool.
    pub around: Surroundings,
    /// The setting.
    pub force_gain: f64,
    /// The setting.
    pub force_limit_N: f64,
    /// What the device could give here at most in the direction asked, where that is known.
    pub range_N: Option<f64>,
    /// How long ago a command ran out, where none came since.
    pub ran_out_s: Option<f64>,
}

impl Default for Circumstances<'_> {
    fn default() -> Self {
        Self {
            controller: None,
            asked_by: None,
            around: Surroundings::default(),
            force_gain: 1.0,
            force_limit_N: f64::INFINITY,
            range_N: None,
            ran_out_s: None,
        }
    }
}

/// The account of the tick that `report` is of.
pub fn explain(report: &Report, circumstances: &Circumstances) -> Explanation {
    let reasons: Vec<_> = reasons(report, circumstances)
        .into_iter()
        .map(|why| (why, sentence(why, report, circumstances)))
        .collect();
    let felt_N = report.rendered.force_N.norm();
    let asked_N = report.requested.force_N.norm();
    let summary = match (reasons.first(), report.rendered_source) {
        (Some((_, why)), RenderedSource::Unknown) => format!("What is felt is not known. {why}"),
        (Some((_, why)), _) if felt_N < FELT_N => format!("Nothing is felt. {why}"),
        (Some((_, why)), _) => format!("{felt_N:.2} N are felt of {asked_N:.2} N asked. {why}"),
        (None, _) => format!("{felt_N:.2} N are felt, {asked_N:.2} N are asked; nothing is amiss."),
    };
    Explanation { summary, reasons, chain: chain(report, circumstances) }
}

fn reasons(report: &Report, circumstances: &Circumstances) -> Vec<Reason> {
    let Circumstances { around, asked_by, force_gain, .. } = circumstances;
    let asked = asks(report);
    let limited = |limit| report.limits.contains(limit);
    let commanded = report.command_seq != 0;
    let nobody = !commanded && circumstances.controller.is_none();
    let untouched = !asked && report.contact_count == 0;
    let ran_out = untouched && circumstances.ran_out_s.is_some_and(|s| s < FORGOTTEN_S);
    let inside = around.nearest.as_ref().is_some_and(|nearest| nearest.distance_m < 0.0);
    let by_range =
        circumstances.range_N.is_some_and(|range_N| range_N < circumstances.force_limit_N);
    let found = [
        (Reason::Fault, report.mode == Mode::Fault),
        (Reason::Stopped, report.mode == Mode::Stopped),
        (Reason::NotHomed, report.mode == Mode::Disabled && !report.homed),
        (Reason::Disabled, report.mode == Mode::Disabled),
        (Reason::Clutched, limited(Limit::Clutch)),
        (Reason::Stale, limited(Limit::Stale) || ran_out),
        (Reason::NoGain, asked && *force_gain == 0.0),
        (Reason::Observer, untouched && nobody && *asked_by == Some(Role::Observer)),
        (Reason::NoScene, untouched && around.objects == 0 && !commanded),
        (Reason::GivenAway, untouched && inside),
        (Reason::OutOfReach, untouched && !inside && !commanded && around.out_of_reach),
        (
            Reason::NothingTouched,
            untouched && !inside && (commanded || (around.objects > 0 && !around.out_of_reach)),
        ),
        (Reason::OutsideFreedoms, limited(Limit::Freedom)),
        // A wall that `sliding` holds is felt as it should be, whatever its penalty points along.
        (
            Reason::NotDisplayable,
            report.region == Some(Region::NotDisplayable) && report.law != Some(Strategy::Sliding),
        ),
        (Reason::ForceLimit, limited(Limit::Force) && !by_range),
        (Reason::DeviceRange, limited(Limit::Force) && by_range),
        (Reason::TorqueLimit, limited(Limit::Torque)),
        (Reason::Softened, limited(Limit::Stiffness)),
        (Reason::HeldBack, limited(Limit::Passivity)),
        (Reason::Activation, limited(Limit::Activation) && asked),
        (Reason::Slew, limited(Limit::Slew)),
        (Reason::TooManyContacts, limited(Limit::Constraints)),
        (Reason::Gain, asked && *force_gain > 0.0 && *force_gain < 1.0),
        (Reason::Approximate, report.region == Some(Region::Approximate)),
        (Reason::Stuck, report.stuck),
        (Reason::Unmeasured, report.rendered_source == RenderedSource::Unknown),
    ];
    found.into_iter().filter_map(|(reason, holds)| holds.then_some(reason)).collect()
}

fn asks(report: &Report) -> bool {
    report.requested.force_N.norm() > ASKED || report.requested.moment_Nm.norm() > ASKED
}

/// Why, with the numbers of this tick where there are any.
fn sentence(reason: Reason, report: &Report, circumstances: &Circumstances) -> String {
    let around = &circumstances.around;
    let nearest = || match &around.nearest {
        Some(NearestSurface { name, distance_m }) => {
            format!("{name} is {} away", length(distance_m.abs()))
        }
        None => "the fields of the scene ask nothing of a tool that moves like this".into(),
    };
    let asked_N = report.requested.force_N.norm() * circumstances.force_gain;
    match (reason, report.approximation_angle_rad, circumstances.range_N, circumstances.ran_out_s) {
        (Reason::Fault, ..) => format!(
            "The device is in fault ({}): every actuator is released until ClearFault and Enable.",
            report.fault.map_or("unknown", |fault| fault.name())
        ),
        (Reason::Stale, _, _, Some(ago_s)) if !report.limits.contains(Limit::Stale) => {
            format!("The controller's last command ran out {ago_s:.1} s ago, and none came since.")
        }
        (Reason::GivenAway, ..) => format!(
            "The tool is inside {}, which began around it and gave way: move out and come back.",
            around.nearest.as_ref().map_or("a surface", |nearest| &nearest.name)
        ),
        (Reason::OutOfReach, ..) => {
            format!("Out of range: the handle can get to no surface of the scene; {}.", nearest())
        }
        (Reason::NothingTouched, ..) => format!(
            "The tool touches nothing: it is at ({:.3}, {:.3}, {:.3}) m, and {}.",
            report.p_WT_m.x,
            report.p_WT_m.y,
            report.p_WT_m.z,
            match report.command_seq {
                0 => nearest(),
                seq => format!("command {seq} asks nothing here"),
            }
        ),
        (Reason::ForceLimit, ..) => {
            let limit_N = circumstances.force_limit_N;
            format!("{asked_N:.1} N are asked, more than the force limit of {limit_N:.1} N.")
        }
        (Reason::DeviceRange, _, Some(range_N), _) => format!(
            "{asked_N:.1} N are asked, more than the {range_N:.1} N that the device has here in that direction."
        ),
        (Reason::HeldBack, ..) if report.force_error_N.is_some() => format!(
            "The controller's force has fed the handle more energy than the hand put into it, and its reserve is used up: part of it along the motion is held back, {:.1} N are missing. A force computed from where the handle was does this; holding still, or working against it, pays back.",
            report.force_error_N.unwrap_or_default()
        ),
        (Reason::Gain, ..) => {
            let share = circumstances.force_gain * 100.0;
            format!("The force gain takes {share:.0} % of what is asked.")
        }
        (Reason::Approximate, Some(angle_rad), ..) => format!(
            "The actuators cannot give this direction; the nearest is {:.0} degrees away.",
            angle_rad.to_degrees()
        ),
        _ => always(reason).into(),
    }
}

/// Why, whatever the numbers.
fn always(reason: Reason) -> &'static str {
    match reason {
        Reason::Fault => "The device is in fault.",
        Reason::Stopped => {
            "The device was stopped: brakes hold their stop capacity, nothing is rendered; \
             Disable, then Enable it."
        }
        Reason::NotHomed => {
            "The place of the handle is not known: put it at its home place, Home, then Enable."
        }
        Reason::Disabled => "The device is disabled: Enable it.",
        Reason::Clutched => {
            "The client's workspace is clutched: nothing is rendered until it lets go."
        }
        Reason::Stale => {
            "The controller's last command ran out: its force fades until the next one."
        }
        Reason::NoGain => "The force gain is set to 0: nothing of what is asked is wanted.",
        Reason::Observer => {
            "This session only observes, nobody commands, and the scene asks nothing here; \
             connect as controller to command."
        }
        Reason::NoScene => {
            "There is nothing to feel: the scene has no object and no command is in force."
        }
        Reason::GivenAway => "The tool is inside a surface that began around it and gave way.",
        Reason::OutOfReach => "The handle can get to no surface of the scene.",
        Reason::NothingTouched => "The tool touches nothing.",
        Reason::OutsideFreedoms => "Part of what is asked points where the device has no freedom.",
        Reason::NotDisplayable => {
            "The force asked for points along the motion: brakes would have to push."
        }
        Reason::ForceLimit => "More is asked than the force limit.",
        Reason::DeviceRange => "More is asked than the device has here in that direction.",
        Reason::TorqueLimit => "An actuator gives all the torque that it has.",
        Reason::Softened => {
            "The surfaces touched are stiffer than motors can hold here, by the damping of the shafts, the lag and the rate: they are softened."
        }
        Reason::Activation => {
            "The device was enabled, or the gain or limit raised, a moment ago: the force still grows."
        }
        Reason::HeldBack => {
            "The controller's force has fed the handle more energy than it may: part of it along the motion is held back."
        }
        Reason::Slew => "A soft force is still growing, as fast as the slew limit lets it.",
        Reason::TooManyContacts => {
            "More surfaces are touched than a law considers; the strongest count."
        }
        Reason::Gain => "The force gain takes less than what is asked.",
        Reason::Approximate => "The actuators cannot give this direction; the nearest is given.",
        Reason::Stuck => "The brakes hold the handle where it should be free to slide.",
        Reason::Unmeasured => {
            "There is no force sensor, and what a brake that holds gives cannot be told."
        }
    }
}

fn length(length_m: f64) -> String {
    if length_m < 0.1 { format!("{:.1} mm", length_m * 1e3) } else { format!("{length_m:.3} m") }
}

fn counted(count: usize, one: &str, many: &str) -> String {
    match count {
        0 => format!("no {many}"),
        1 => format!("1 {one}"),
        _ => format!("{count} {many}"),
    }
}

fn chain(report: &Report, circumstances: &Circumstances) -> Vec<Link> {
    let link = |name, text, force_W_N| Link { name, text, force_W_N };
    let mode = match report.fault {
        Some(fault) => format!("fault: {}", fault.name()),
        None => format!("{:?}", report.mode).to_lowercase(),
    };
    let world = format!(
        "{}, {} touched",
        counted(circumstances.around.objects, "object", "objects"),
        report.contact_count
    );
    let command = match (report.command_seq, circumstances.controller) {
        (0, None) => "none".into(),
        (0, Some(name)) => format!("none in force from {name}"),
        (seq, name) => format!("number {seq} of {}", name.unwrap_or("a controller")),
    };
    let wanted = match circumstances.force_gain {
        1.0 => "all of it".into(),
        gain => format!("{:.0} % of it", gain * 100.0),
    };
    let limits: Vec<_> = Limit::ALL
        .into_iter()
        .filter(|limit| report.limits.contains(*limit))
        .map(Limit::name)
        .collect();
    let limits = if limits.is_empty() { "none".into() } else { limits.join(", ") };
    let law = report.law.map_or("none runs".into(), |law| match report.region {
        Some(region) => format!("{}, direction {}", law.name(), region.name().replace('_', " ")),
        None => law.name().to_owned(),
    });
    let felt = match report.rendered_source {
        RenderedSource::Measured => "measured",
        RenderedSource::Modelled => "modelled",
        RenderedSource::Unknown => "unknown",
    };
    let known = report.rendered_source != RenderedSource::Unknown;
    let asked_N = report.requested.force_N;
    vec![
        link("mode", mode, None),
        link("world", world, None),
        link("command", command, None),
        link("asked", "by scene and command together".into(), Some(asked_N)),
        link("wanted", wanted, Some(asked_N * circumstances.force_gain)),
        link("limits", limits, None),
        link("law", law, Some(report.achievable.force_N)),
        link("felt", felt.into(), known.then_some(report.rendered.force_N)),
    ]
}

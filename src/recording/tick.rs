//! A Record as an entry of a recording, and back the part that a replay needs.

use super::report::report_entry;
use crate::control::{COMMANDS_PER_TICK, DeviceError, Inputs, ModeCommand, Obeyed, Record, Sample};
use crate::notation::{MAX_ACTUATORS, PlaneVector};
use crate::proto::record_obeyed::{self, What};
use crate::proto::{RecordDeviceError, RecordObeyed, RecordSample, RecordTick};

/// A tick as it was.
pub(super) fn tick_entry(record: &Record) -> RecordTick {
    let Record { report, inputs, .. } = record;
    RecordTick {
        tick: report.tick,
        time_ns: report.time_ns,
        wakeup_lateness_ns: record.wakeup_lateness_ns,
        execution_ns: record.execution_ns,
        device_io_ns: record.device_io_ns,
        overrun: record.overrun,
        skipped_ticks: record.skipped_ticks,
        device_error: record.device_error.map_or(0, |error| error_entry(error).into()),
        sample: inputs.sample.ok().as_ref().map(sample_entry),
        sample_error: inputs.sample.err().map_or(0, |error| error_entry(error).into()),
        overruns_in_row: inputs.overruns_in_row,
        setpoint: inputs.setpoint,
        plan: inputs.plan,
        obeyed: inputs.obeyed.iter().flatten().map(obeyed_entry).collect(),
        report: Some(report_entry(report)),
    }
}

/// What the tick was given; what makes no sense is named.
pub(super) fn inputs_of(entry: &RecordTick) -> Result<Inputs, &'static str> {
    let sample = match (&entry.sample, error_of(entry.sample_error())) {
        (Some(sample), None) => Ok(sample_of(sample)?),
        (None, Some(error)) => Err(error),
        _ => return Err("either a sample or a reason why there is none"),
    };
    let mut obeyed = [None; COMMANDS_PER_TICK];
    if entry.obeyed.len() > obeyed.len() {
        return Err("at most 2 commands are carried out in a tick");
    }
    for (place, entry) in obeyed.iter_mut().zip(&entry.obeyed) {
        *place = Some(obeyed_of(entry).ok_or("a command of a kind that is known")?);
    }
    Ok(Inputs {
        sample,
        overruns_in_row: entry.overruns_in_row,
        setpoint: entry.setpoint,
        plan: entry.plan,
        obeyed,
    })
}

fn sample_entry(sample: &Sample) -> RecordSample {
    let hand = sample.F_hand_BH_N.as_ref();
    RecordSample {
        counts: sample.counts.to_vec(),
        hand_plane_n: hand.map_or_else(Vec::new, |force| force.as_slice().to_vec()),
        buttons: sample.buttons,
    }
}

fn sample_of(entry: &RecordSample) -> Result<Sample, &'static str> {
    let counts = <[i64; MAX_ACTUATORS]>::try_from(entry.counts.as_slice());
    let F_hand_BH_N = match *entry.hand_plane_n.as_slice() {
        [] => None,
        [x, y, moment] => Some(PlaneVector::new(x, y, moment)),
        _ => return Err("a hand force has 3 numbers or none"),
    };
    Ok(Sample {
        counts: counts.map_err(|_| "a sample has 6 counts")?,
        F_hand_BH_N,
        buttons: entry.buttons,
    })
}

fn error_entry(error: DeviceError) -> RecordDeviceError {
    match error {
        DeviceError::Timeout => RecordDeviceError::Timeout,
        DeviceError::Disconnected => RecordDeviceError::Disconnected,
        DeviceError::Malformed => RecordDeviceError::Malformed,
    }
}

fn error_of(entry: RecordDeviceError) -> Option<DeviceError> {
    DeviceError::ALL.into_iter().find(|error| error_entry(*error) == entry)
}

fn mode_entry(command: ModeCommand) -> record_obeyed::ModeCommand {
    match command {
        ModeCommand::Enable => record_obeyed::ModeCommand::Enable,
        ModeCommand::Disable => record_obeyed::ModeCommand::Disable,
        ModeCommand::Stop => record_obeyed::ModeCommand::Stop,
        ModeCommand::ClearFault => record_obeyed::ModeCommand::ClearFault,
    }
}

fn obeyed_entry(obeyed: &Obeyed) -> RecordObeyed {
    let what = match *obeyed {
        Obeyed::Mode(command) => What::Mode(mode_entry(command).into()),
        Obeyed::Home => What::Home(true),
        Obeyed::Plan(generation) => What::Plan(generation),
        Obeyed::Snapshot => What::Snapshot(true),
    };
    RecordObeyed { what: Some(what) }
}

fn obeyed_of(entry: &RecordObeyed) -> Option<Obeyed> {
    use ModeCommand::{ClearFault, Disable, Enable, Stop};
    match entry.what? {
        What::Mode(mode) => {
            let known = [Enable, Disable, Stop, ClearFault];
            let is = |command: &ModeCommand| i32::from(mode_entry(*command)) == mode;
            known.into_iter().find(is).map(Obeyed::Mode)
        }
        What::Home(_) => Some(Obeyed::Home),
        What::Plan(generation) => Some(Obeyed::Plan(generation)),
        What::Snapshot(_) => Some(Obeyed::Snapshot),
    }
}

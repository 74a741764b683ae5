//! The tick itself: read top to bottom, it is the sentence of the module's header.

use nalgebra::{UnitQuaternion, Vector3};

use super::activation::Asked;
use super::desire::{Asking, Request, UNFELT, proxy_W_m};
use super::estimate::Estimate;
use super::passivity::Port;
use super::plan::Tool as ToolPlan;
use super::stale::Before;
use super::state::ContactStates;
use super::{
    ActuatorCommands, ControlState, DeviceError, Event, Fault, Limit, Limits, Mode, Mount, Plan,
    RenderedSource, Report, Sample, Setpoint, Wrench, guard, values_Nm,
};
use crate::actuation::{
    ActuatorKind, Bounds, Capability, Handle, Outcome, ShaftMotion, Shafts, Wanted, allocate,
    approximation_angle,
};
use crate::environment::{Desired, Source, Tool, ToolMotion};
use crate::notation::{ActuatorVector, PlaneVector};

/// What one tick is given.
#[derive(Clone, Copy, Debug)]
pub struct TickInput<'a> {
    /// What the device sensed, or why not.
    pub sample: Result<Sample, DeviceError>,
    /// The controller's newest command.
    pub setpoint: &'a Setpoint,
    /// The configuration.
    pub plan: &'a Plan,
    /// Device clock.
    pub now_ns: u64,
    /// Ticks in a row that were not done when the next was due.
    pub overruns_in_row: u32,
}

impl<'a> TickInput<'a> {
    /// Of a tick that is in time and that no controller commands.
    pub fn uncommanded(sample: Result<Sample, DeviceError>, plan: &'a Plan, now_ns: u64) -> Self {
        Self { sample, setpoint: &Setpoint::NONE, plan, now_ns, overruns_in_row: 0 }
    }
}

/// What one tick decided: commands for the device, and the account of them.
#[derive(Clone, Copy, Debug)]
pub struct Decision {
    /// For the device.
    pub commands: ActuatorCommands,
    /// For everybody else.
    pub report: Report,
}

/// One tick. Bounded work, no allocation, no side effect but on `state`.
pub fn tick(state: &mut ControlState, input: &TickInput) -> Decision {
    state.tick += 1;
    state.remember_time(input.now_ns);
    if input.overruns_in_row >= input.plan.guards.max_overruns {
        state.latch(Fault::Overrun);
    }
    let decision = match sense(state, input) {
        Some(estimate) => render(state, &estimate, input),
        None => blind(state, input),
    };
    state.commands = decision.commands;
    state.last = decision.report;
    decision
}

/// The estimate, unless the device gave none that makes sense; latches the faults that this
/// reveals once they last.
fn sense(state: &mut ControlState, input: &TickInput) -> Option<Estimate> {
    let homing = state.estimator.homing_mut();
    homing.see(input.sample.ok().map(|sample| sample.counts));
    if input.sample == Err(DeviceError::Disconnected) {
        homing.forget();
    }
    let homed = state.estimator.is_homed(input.plan);
    let estimate = input.sample.map_err(|_| Fault::Device).and_then(|sample| {
        if sample.buttons != state.last.buttons {
            state.events.push(Event::Button(sample.buttons));
        }
        state.last.buttons = sample.buttons;
        match (homed, state.mode) {
            (true, _) => state.estimator.update(&sample, input.plan, input.now_ns).map(Some),
            // Nothing is missed before the place is known, but it must not be lost.
            (false, Mode::Enabled) => Err(Fault::Device),
            (false, _) => Ok(None),
        }
    });
    match estimate {
        Ok(estimate) => {
            state.blind_ticks = 0;
            estimate
        }
        Err(fault) => {
            state.blind_ticks = state.blind_ticks.saturating_add(1);
            // Disagreement of the encoders was watched for a while already.
            if fault == Fault::Closure || state.blind_ticks >= input.plan.guards.max_device_errors {
                state.latch(fault);
            }
            None
        }
    }
}

/// Without an estimate the brakes keep their capacities for the few ticks until the fault
/// latches: one that holds the hand must not open because of one lost sample. Motors let go:
/// a torque that nobody watches is no hold.
fn blind(state: &mut ControlState, input: &TickInput) -> Decision {
    let plan = input.plan;
    let mut held_Nm = values_Nm(&state.commands);
    for (torque_Nm, kind) in held_Nm.iter_mut().zip(plan.actuators.kinds) {
        *torque_Nm *= f64::from(u8::from(kind == ActuatorKind::Brake));
    }
    let commands = guard::commands(state.mode, &held_Nm, plan, &mut Limits::default());
    if state.mode == Mode::Enabled {
        state.account.unseen();
    } else {
        state.account.rest();
    }
    let last = state.last;
    let mut report = Report {
        tick: state.tick,
        time_ns: input.now_ns,
        mode: state.mode,
        fault: state.fault,
        p_WT_m: last.p_WT_m,
        q_WT: last.q_WT,
        proxy_W_m: last.p_WT_m,
        buttons: last.buttons,
        homed: state.estimator.is_homed(plan),
        scene_revision: plan.scene_revision,
        shaft_rad: last.shaft_rad,
        p_BH: last.p_BH,
        commanded_Nm: values_Nm(&commands),
        ..Report::default()
    };
    if state.mode != Mode::Fault && report.homed {
        // A lost sample does not end what was touched, or the command in force; where the place
        // itself is lost, nothing is touched and nothing is rendered.
        (report.contacts, report.contact_count) = (last.contacts, last.contact_count);
        (report.command_seq, report.stuck) = (last.command_seq, last.stuck);
    } else if std::mem::take(&mut state.was_stuck) {
        state.stuck = Default::default();
        state.events.push(Event::StuckEnd);
    }
    log_contacts(state, &report);
    (report.last_event, report.events) = state.events.take();
    Decision { commands, report }
}

fn render(state: &mut ControlState, estimate: &Estimate, input: &TickInput) -> Decision {
    let plan = input.plan;
    let tool = tool_of(state, estimate, plan);
    let capability = capability(estimate, plan);
    let (desired, request) = desire(state, estimate, &tool, &capability, input);
    let mut limits = request.limits;
    limits.set(Limit::Stale, state.authority.is_fading());

    let rendering = state.mode == Mode::Enabled;
    let last_soft_BH_N = if rendering { state.soft_BH_N } else { PlaneVector::zeros() };
    let slewed_BH_N = guard::slewed(&request.soft_BH_N, &last_soft_BH_N, plan, &mut limits);
    let port = Port { plan, estimate, length_m: capability.moment_length_m };
    state.account.settle(&port, &state.last);
    let held_back = state.account.held_back(&port, &slewed_BH_N, &request);
    limits.set(Limit::Passivity, rendering && held_back.norm() > UNFELT);
    let soft_BH_N = slewed_BH_N - held_back;
    state.soft_BH_N = soft_BH_N;
    let handle = Handle {
        position: estimate.p_BH,
        velocity: estimate.v_BH,
        hand_force: estimate.F_hand_BH_N,
        inertia: estimate.posture.inertia,
        tick_s: plan.tick_s(),
    };
    if !rendering {
        state.law.reset();
    }
    let wanted = Wanted { soft: soft_BH_N, walls: request.walls() };
    let shafts = Shafts {
        lag_s: &plan.actuators.lag_s,
        counts_per_revolution: &plan.actuators.counts_per_revolution,
        hysteresis_Nm: &plan.actuators.hysteresis_Nm,
        resolution_Nm: &plan.actuators.resolution_Nm,
        weight: &plan.actuators.weight,
    };
    let outcome = allocate(plan.strategy, &capability, &handle, &wanted, &shafts, &mut state.law);
    let commands = guard::commands(state.mode, &outcome.torque_Nm, plan, &mut limits);
    if rendering {
        state.account.give(&port, &soft_BH_N, &request, &outcome.wrench);
    } else {
        state.account.rest();
    }

    let stuck = watch_stuck(state, estimate, &request, &commands, plan);
    let mut report = sensed(state, estimate, &tool, input);
    asked(&mut report, &request, &capability, limits);
    report.proxy_W_m = proxy_W_m(&desired, &tool);
    report.stuck = stuck;
    report.commanded_Nm = values_Nm(&commands);
    if rendering {
        achieved(&mut report, estimate, &request, &outcome, plan);
        // The direction of a velocity that is no more than a count's flicker says nothing.
        report.region = outcome.region.filter(|_| report.law.is_some() && !estimate.is_at_rest());
    }
    felt(&mut report, estimate, &capability, plan);
    account_for_command(state, &mut report, input);
    log_contacts(state, &report);
    (report.last_event, report.events) = state.events.take();
    Decision { commands, report }
}

/// The tool as it is now; surfaces lose their past where the tool did not get here by itself:
/// another tool or mount, or the device begins to render.
fn tool_of(state: &mut ControlState, estimate: &Estimate, plan: &Plan) -> Tool {
    let tool = Tool::new(
        &motion_of(estimate, plan),
        plan.tool.points_T_m(),
        plan.tool.radius_m,
        plan.tick_s(),
    );
    let begins = state.mode == Mode::Enabled && std::mem::take(&mut state.begins);
    let same = |(_, mount, made_from): &(Tool, Mount, ToolPlan)| {
        (mount, made_from) == (&plan.mount, &plan.tool)
    };
    if begins || !state.tool.as_ref().is_some_and(same) {
        state.forget_surfaces();
        state.tool = None;
    }
    let tool = state.tool.as_ref().map_or(tool, |(last, _, _)| tool.after(last));
    state.tool = Some((tool, plan.mount, plan.tool));
    tool
}

fn motion_of(estimate: &Estimate, plan: &Plan) -> ToolMotion {
    let Mount { p_WB_m, q_WB } = plan.mount;
    let handle_B_m = Vector3::new(estimate.p_BH.x, estimate.p_BH.y, 0.0);
    let turned = turned(estimate, plan);
    let offset_W_m = q_WB * (turned * plan.tool.offset_B_m);
    let rate = if plan.mechanism.freedoms() == 3 { estimate.v_BH.z } else { 0.0 };
    let omega_WT_rad_per_s = q_WB * Vector3::new(0.0, 0.0, rate);
    ToolMotion {
        p_WT_m: p_WB_m + q_WB * handle_B_m + offset_W_m,
        q_WT: q_WB * turned,
        v_WT_m_per_s: plan.plane_to_W(&estimate.v_BH) + omega_WT_rad_per_s.cross(&offset_W_m),
        omega_WT_rad_per_s,
    }
}

/// How the tool is turned in B: with the handle, where that is a freedom.
fn turned(estimate: &Estimate, plan: &Plan) -> UnitQuaternion<f64> {
    let turned_rad = if plan.mechanism.freedoms() == 3 { estimate.p_BH.z } else { 0.0 };
    UnitQuaternion::from_euler_angles(0.0, 0.0, turned_rad)
}

/// What the scene and the controller want here, raw and as requests in the plane.
fn desire(
    state: &mut ControlState,
    estimate: &Estimate,
    tool: &Tool,
    capability: &Capability,
    input: &TickInput,
) -> (Desired, Request) {
    let (setpoint, ramp_ns) = (input.setpoint, input.plan.guards.stale_ramp_ns);
    let change = state.authority.advance(setpoint, input.now_ns, ramp_ns, state.before);
    if change.ran_out {
        state.events.push(Event::Stale);
    }
    if change.declutched {
        state.forget_surfaces();
    } else if change.returned {
        state.contacts = ContactStates::default();
    }
    let controller_cap_N = state.authority.cap_N(input.now_ns);
    let clutch_cap_N = state.authority.clutch_cap_N(input.now_ns);
    let live = controller_cap_N > 0.0;
    let guards = &input.plan.guards;
    let activation = state.activation.share(input.now_ns, guards.activation_ramp_ns);
    // A fade begins at what was given; it is not made smaller a second time.
    let controller_cap_N =
        if activation > 0.0 { controller_cap_N / activation } else { controller_cap_N };
    let contacts = || setpoint.contacts().filter(|_| live);
    state.contacts.follow(setpoint.epoch, contacts());
    let mut desired = Desired::default();
    for (point, layer) in state.scene.iter_mut().enumerate().take(tool.points().len()) {
        for item in input.plan.scene.iter().filter(|_| clutch_cap_N > 0.0) {
            if let Some(surface) = layer.get_mut(usize::from(item.slot)) {
                state.used.insert(usize::from(item.slot));
                desired.add_item(item, surface, tool, point);
            }
        }
        for (contact, surface) in contacts().zip(state.contacts.at_point(point)) {
            desired.add_contact(contact, surface, tool, point);
        }
    }
    let controller = if live { setpoint.soft(tool) } else { Wrench::default() };
    let plan = input.plan;
    let asking = Asking { tool, estimate, plan, capability, controller, controller_cap_N };
    let softened = asking.soften(&mut desired);
    let mut request = Request::from_desired(&desired, &asking);
    request.limits.set(Limit::Stiffness, softened);
    let last_N = state.before.total_N;
    let asked = Asked { last_N, now_N: request.total_N(&asking), guards };
    let activation = state.activation.settle(state.mode, activation, &asked, input.now_ns);
    request.grow(activation);
    request.cap(clutch_cap_N, &asking);
    request.limits.set(Limit::Clutch, state.authority.is_clutched());
    let total_N = request.total_N(&asking);
    state.before = Before { controller_N: request.controller_N, total_N };
    for (constraint, load_N) in request.loads(&desired) {
        let surface = match constraint.source {
            Source::Scene => state.scene[constraint.point].get_mut(constraint.id as usize),
            Source::Controller => state.contacts.get_mut(constraint.point, constraint.id),
        };
        if let Some(surface) = surface {
            surface.bear(load_N, constraint.bristle_share);
        }
    }
    (desired, request)
}

fn capability(estimate: &Estimate, plan: &Plan) -> Capability {
    let Plan { actuators, mechanism, .. } = plan;
    Capability {
        reference: estimate.posture.reference,
        freedoms: mechanism.freedoms(),
        actuators: mechanism.actuators(),
        kinds: actuators.kinds,
        bounds: Bounds::given(&actuators.kinds, &actuators.max_torque_Nm, &estimate.motion),
        moment_length_m: mechanism.reach_m().1,
    }
}

fn watch_stuck(
    state: &mut ControlState,
    estimate: &Estimate,
    request: &Request,
    commands: &ActuatorCommands,
    plan: &Plan,
) -> bool {
    let held = state.mode == Mode::Enabled && guard::engaged(commands);
    let stuck = state.stuck.update(
        &estimate.v_BH,
        estimate.F_hand_BH_N.as_ref(),
        request.walls(),
        held,
        plan.tick_s(),
    );
    if stuck != state.was_stuck {
        state.events.push(if stuck { Event::StuckBegin } else { Event::StuckEnd });
    }
    state.was_stuck = stuck;
    stuck
}

/// The part of the report that tells what was sensed.
fn sensed(state: &ControlState, estimate: &Estimate, tool: &Tool, input: &TickInput) -> Report {
    let plan = input.plan;
    let motion = motion_of(estimate, plan);
    Report {
        tick: state.tick,
        time_ns: input.now_ns,
        mode: state.mode,
        fault: state.fault,
        p_WT_m: tool.p_WT_m,
        q_WT: motion.q_WT,
        v_WT_m_per_s: tool.v_WT_m_per_s,
        omega_WT_rad_per_s: motion.omega_WT_rad_per_s,
        hand: estimate.F_hand_BH_N.map(|hand| wrench_W(&hand, estimate, plan)),
        buttons: state.last.buttons,
        homed: true,
        scene_revision: plan.scene_revision,
        shaft_rad: estimate.shaft_rad,
        shaft_rad_per_s: estimate.shaft_rad_per_s,
        p_BH: estimate.p_BH,
        ..Report::default()
    }
}

/// A wrench at H in B as force and moment about T in W. A handle that turns freely (two
/// freedoms) passes no moment on.
fn wrench_W(wrench_BH: &PlaneVector, estimate: &Estimate, plan: &Plan) -> Wrench {
    let mut moment_B_Nm = Vector3::new(0.0, 0.0, wrench_BH.z);
    if plan.mechanism.freedoms() == 3 {
        let offset_B_m = turned(estimate, plan) * plan.tool.offset_B_m;
        moment_B_Nm -= offset_B_m.cross(&Vector3::new(wrench_BH.x, wrench_BH.y, 0.0));
    }
    Wrench { force_N: plan.plane_to_W(wrench_BH), moment_Nm: plan.mount.q_WB * moment_B_Nm }
}

fn asked(report: &mut Report, request: &Request, capability: &Capability, limits: Limits) {
    report.requested = request.raw;
    report.contacts = request.contacts;
    report.contact_count = request.contact_count;
    report.limits = limits;
    report.bounds = capability.bounds;
}

fn achieved(
    report: &mut Report,
    estimate: &Estimate,
    request: &Request,
    outcome: &Outcome,
    plan: &Plan,
) {
    let clipped = request.clipped_BH_N();
    report.achievable = wrench_W(&outcome.wrench, estimate, plan);
    if clipped.norm() > 0.0 {
        report.law = Some(outcome.law);
        report.approximation_angle_rad = approximation_angle(&clipped, &outcome.wrench);
        report.force_error_N = Some((outcome.wrench - clipped).norm());
    }
}

/// What the hand felt: the sensor's reading turned around, or else the torques through the
/// linkage where every engaged brake is known to slip.
fn felt(report: &mut Report, estimate: &Estimate, capability: &Capability, plan: &Plan) {
    if let Some(hand) = estimate.F_hand_BH_N {
        report.rendered = wrench_W(&-hand, estimate, plan);
        report.rendered_source = RenderedSource::Measured;
    } else if let Some(torque_Nm) = slipping_torque_Nm(report, estimate, capability) {
        report.rendered = wrench_W(&(capability.reference * torque_Nm), estimate, plan);
        report.rendered_source = RenderedSource::Modelled;
    }
}

fn slipping_torque_Nm(
    report: &Report,
    estimate: &Estimate,
    capability: &Capability,
) -> Option<ActuatorVector> {
    let mut torque_Nm = ActuatorVector::zeros();
    for i in 0..capability.actuators {
        let commanded_Nm = report.commanded_Nm[i];
        torque_Nm[i] = match (capability.kinds[i], estimate.motion[i]) {
            (ActuatorKind::Motor, _) => commanded_Nm,
            (ActuatorKind::Brake, ShaftMotion::Forward) => -commanded_Nm,
            (ActuatorKind::Brake, ShaftMotion::Backward) => commanded_Nm,
            (ActuatorKind::Brake, ShaftMotion::Rest) if commanded_Nm == 0.0 => 0.0,
            (ActuatorKind::Brake, ShaftMotion::Rest) => return None,
        };
    }
    Some(torque_Nm)
}

fn account_for_command(state: &mut ControlState, report: &mut Report, input: &TickInput) {
    let setpoint = input.setpoint;
    if !setpoint.is_fresh(input.now_ns) {
        return;
    }
    report.command_seq = setpoint.seq;
    let command = (setpoint.epoch, setpoint.seq);
    report.command_new = command != std::mem::replace(&mut state.command, command);
    if setpoint.state_tick != 0 {
        report.command_lag_ticks = state.tick.saturating_sub(setpoint.state_tick);
        report.command_age_ns = state.since_tick_ns(setpoint.state_tick, input.now_ns);
    }
}

fn log_contacts(state: &mut ControlState, report: &Report) {
    let (before, count) = state.touched;
    let before = &before[..count];
    let same =
        |a: &super::ContactResult, b: &super::ContactResult| a.source == b.source && a.id == b.id;
    for gone in before.iter().filter(|old| !report.contacts().iter().any(|new| same(old, new))) {
        state.events.push(Event::ContactEnd { source: gone.source, id: gone.id });
    }
    for new in report.contacts().iter().filter(|new| !before.iter().any(|old| same(old, new))) {
        state.events.push(Event::ContactBegin { source: new.source, id: new.id });
    }
    state.touched = (report.contacts, report.contact_count);
}

//! What must be true of every setpoint: who gives it, as of which State, with which numbers; and
//! that the force goes when its time is over.

use hapticd::control::{Report, Setpoint};
use hapticd::environment::{Guide, Shape};
use hapticd::session::{LeaseInfo, SessionConfig};

use super::rules::Cause;

const MS: u64 = 1_000_000;

/// What was seen of one device.
#[derive(Debug)]
pub struct Device {
    pub actuators: usize,
    pub lease: LeaseInfo,
    pub newest_epoch: u64,
    pub newest_tick: u64,
    pub setpoint: Setpoint,
    max_ttl_ns: u64,
    /// Of a State that a soft force, or contacts, may be computed from.
    max_age_ns: [u64; 2],
    /// When each tick was.
    ticks_ns: Vec<u64>,
    /// The first tick that found the setpoint stale.
    stale_ns: Option<u64>,
}

impl Device {
    pub fn new(config: &SessionConfig) -> Self {
        let ages_ms = [config.max_age_ms, config.max_contacts_age_ms];
        Self {
            actuators: config.actuators as usize,
            lease: LeaseInfo { holder: None, epoch: 0 },
            newest_epoch: 0,
            newest_tick: 0,
            setpoint: Setpoint::NONE,
            max_ttl_ns: u64::from(config.max_ttl_ms) * MS,
            max_age_ns: ages_ms.map(|ms| u64::from(ms) * MS),
            ticks_ns: Vec::new(),
            stale_ns: None,
        }
    }

    /// A command's force is gone a ramp after the first tick that found it stale: the scene is
    /// empty, so nothing else asks.
    pub fn check_force(&mut self, report: &Report, setpoint: &Setpoint) {
        self.newest_tick = report.tick;
        self.ticks_ns.push(report.time_ns);
        assert_eq!(self.ticks_ns.len() as u64, report.tick, "ticks are counted from 1");
        if setpoint.is_fresh(report.time_ns) {
            self.stale_ns = None;
            return;
        }
        let since_ns = report.time_ns - *self.stale_ns.get_or_insert(report.time_ns);
        let ramp_ns = 50 * MS;
        if since_ns > ramp_ns + MS {
            assert_eq!(report.requested.force_N.norm(), 0.0, "{since_ns} ns after its time");
            assert_eq!(report.requested.moment_Nm.norm(), 0.0, "{since_ns} ns after its time");
        }
    }

    /// A setpoint comes of a command of the one that holds the lease, or lets the last one go.
    pub fn check_setpoint(&self, cause: Cause, may: bool, setpoint: &Setpoint, now_ns: u64) {
        let last = &self.setpoint;
        let (number, named) = ((setpoint.epoch, setpoint.seq), (last.epoch, last.seq));
        if setpoint.released {
            let may = matches!(
                cause,
                Cause::Message { .. } | Cause::Timeout | Cause::Call | Cause::Shutdown
            );
            assert!(may, "{cause:?} lets nothing go");
            assert_eq!(number, named, "only what is in force can be let go");
            assert!(last.is_fresh(now_ns), "and only while it counts");
            return;
        }
        assert!(may, "{cause:?} may not command");
        let Cause::Datagram { by, .. } = cause else { unreachable!() };
        assert_eq!(self.lease.holder, Some(by), "who commands holds the lease");
        assert_eq!(setpoint.epoch, self.lease.epoch);
        assert!(number > named, "{number:?} after {named:?}");
        assert_eq!(setpoint.received_ns, now_ns);
        assert!(setpoint.ttl_ns <= self.max_ttl_ns, "{} ns", setpoint.ttl_ns);
        self.check_age(setpoint, now_ns);
        check_numbers(setpoint);
    }

    fn check_age(&self, setpoint: &Setpoint, now_ns: u64) {
        let tick = setpoint.state_tick;
        assert!(tick <= self.newest_tick, "a State of the future");
        if tick > 0 {
            let age_ns = now_ns - self.ticks_ns[tick as usize - 1];
            let most_ns = self.max_age_ns[usize::from(setpoint.field().is_none())];
            assert!(age_ns <= most_ns, "{age_ns} ns old: {setpoint:?}");
        }
    }

    /// It is in force from now on.
    pub fn take(&mut self, setpoint: &Setpoint) {
        let number = self.setpoint.number + 1;
        self.setpoint = *setpoint;
        self.setpoint.number = number;
    }
}

/// Every number is one, and in the range that the contract gives it.
fn check_numbers(setpoint: &Setpoint) {
    for contact in setpoint.contacts() {
        let material = &contact.surface.material;
        assert!((0.0..=1e9).contains(&material.stiffness_N_per_m), "{material:?}");
        assert!((0.0..=1e6).contains(&material.damping_Ns_per_m), "{material:?}");
        assert!((0.0..=10.0).contains(&material.kinetic_friction), "{material:?}");
        assert!((material.kinetic_friction..=10.0).contains(&material.static_friction));
        assert!(material.surface_velocity_W_m_per_s.iter().all(|part| part.is_finite()));
        assert!((0.0..=1.0).contains(&contact.surface.blend_s));
        let numbers = numbers_of(&contact.surface.shape);
        assert!(numbers.iter().all(|number| number.abs() <= 1e6), "{contact:?}");
    }
    if let Some(field) = setpoint.field() {
        let forces = field.force_W_N.iter().chain(&field.moment_W_Nm);
        assert!(forces.into_iter().all(|part| part.abs() <= 1e3), "{field:?}");
        let matrices = field.stiffness_N_per_m.iter().chain(&field.damping_Ns_per_m);
        assert!(matrices.into_iter().all(|part| part.is_finite()), "{field:?}");
        assert!(field.origin_W_m.iter().all(|part| part.is_finite()), "{field:?}");
        assert!(field.radius_m > 0.0, "{field:?}");
    }
}

fn numbers_of(shape: &Shape) -> Vec<f64> {
    let vectors = match shape {
        Shape::HalfSpace { point_W_m, normal_W } => vec![*point_W_m, *normal_W],
        Shape::Sphere { centre_W_m, .. } => vec![*centre_W_m],
        Shape::Box { centre_W_m, half_extents_m, .. } => vec![*centre_W_m, *half_extents_m],
        Shape::Capsule { ends_W_m, .. } => ends_W_m.to_vec(),
        Shape::Guide { path, .. } => match path {
            Guide::Point { point_W_m } => vec![*point_W_m],
            Guide::Line { point_W_m, direction_W } => vec![*point_W_m, *direction_W],
            Guide::Plane { point_W_m, normal_W } => vec![*point_W_m, *normal_W],
            Guide::Segment { ends_W_m } => ends_W_m.to_vec(),
        },
    };
    let own = match shape {
        Shape::Sphere { radius_m, .. }
        | Shape::Capsule { radius_m, .. }
        | Shape::Guide { radius_m, .. } => vec![*radius_m],
        Shape::Box { q_WS, .. } => q_WS.coords.iter().copied().collect(),
        Shape::HalfSpace { .. } => Vec::new(),
    };
    vectors.iter().flatten().copied().chain(own).collect()
}

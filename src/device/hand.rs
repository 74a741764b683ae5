//! The simulated hand: a program that knows where the handle is and pulls it with a limited force.
//!
//! Positions in B, metres; forces are what the hand does to the handle, newtons. A hand feels
//! through springs and dampers ([`Grip`]), so it is a finite impedance, never a prescribed
//! motion. It knows the true state of the handle but no wall, no brake and no law. It is
//! deterministic: the same program, seed and motion give the same forces, bit for bit. It
//! turns the handle back to where it took it, with a spring and a damper of the wrist, which a
//! handle of two freedoms does not feel.
//!
//! Lengths of the programs are chosen for the workspace of `cho-2005` (0.2 to 0.5 m);
//! [`HandProgram::fitted`] shrinks them for a smaller device.

mod circle;
mod pointer;
mod random;
mod slide;

use std::fmt;
use std::str::FromStr;

use nalgebra::Vector2;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

pub use circle::CircleProgram;
pub use pointer::{Pointer, PointerInput, PointerTarget};
pub use random::RandomProgram;
pub use slide::SlideProgram;

use crate::notation::PlaneVector;

/// Where a hand without a path of its own begins: the middle of the workspace.
const MIDDLE_M: [f64; 2] = [0.28, 0.2];

/// Where the wall of Cho 2005, section 8.1, stands; the programs' lengths are made for it.
const WALL_M: f64 = 0.3;

/// A program leaves this part of the reach to the linkage's own stop.
const USED_REACH: f64 = 0.9;

/// How the simulated hand behaves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HandProgram {
    /// Holds the handle where it is at the beginning.
    Hold,
    /// Presses against a wall and slides along it, again and again.
    PressAndSlide(SlideProgram),
    /// Follows a circle.
    Circle(CircleProgram),
    /// Pulls at random.
    Random(RandomProgram),
    /// Pulls where a person points; lets go while nobody does.
    Pointer,
}

/// The wrist, against turns of the handle: well damped with a plate of a few g m^2, and no
/// stronger than a wrist.
const WRIST_STIFFNESS_NM_PER_RAD: f64 = 1.0;
const WRIST_DAMPING_NM_S_PER_RAD: f64 = 0.06;
const WRIST_MAX_NM: f64 = 1.0;

/// A name that no program has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "hand program `{0}` does not exist: choose hold, press-and-slide, circle, random or pointer"
)]
pub struct UnknownHandProgram(pub String);

impl HandProgram {
    /// Every program with its usual parameters.
    pub fn all() -> [Self; 5] {
        [
            Self::Hold,
            Self::PressAndSlide(SlideProgram::default()),
            Self::Circle(CircleProgram::default()),
            Self::Random(RandomProgram::default()),
            Self::Pointer,
        ]
    }

    /// The name in configuration and on command lines.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Hold => "hold",
            Self::PressAndSlide(_) => "press-and-slide",
            Self::Circle(_) => "circle",
            Self::Random(_) => "random",
            Self::Pointer => "pointer",
        }
    }

    /// Where the handle best begins.
    pub fn start_m(&self) -> [f64; 2] {
        match self {
            Self::Hold | Self::Pointer => MIDDLE_M,
            Self::PressAndSlide(program) => program.start_m,
            Self::Circle(program) => program.start_m(),
            Self::Random(program) => program.home_m,
        }
    }

    /// How much smaller than usual everything is for a device whose handle reaches from
    /// `reach_m.0` to `reach_m.1` metres, so that the program stays within.
    fn scale(&self, reach_m: (f64, f64)) -> f64 {
        let outermost_m = match self {
            // The middle that these begin in is that of the others' paths.
            Self::Hold | Self::Pointer => SlideProgram::default().outermost_m(),
            Self::PressAndSlide(program) => program.outermost_m(),
            Self::Circle(program) => program.outermost_m(),
            Self::Random(program) => Vector2::from(program.home_m).norm(),
        };
        (USED_REACH * reach_m.1 / outermost_m).min(1.0)
    }

    /// Where a wall has to stand on such a device for this program to meet it, along x of B.
    pub fn wall_m(&self, reach_m: (f64, f64)) -> f64 {
        WALL_M * self.scale(reach_m)
    }

    /// The same program, shrunk where it would leave a device whose handle reaches from
    /// `reach_m.0` to `reach_m.1` metres. Times stay, and forces except those of `random`, which are made for its lengths.
    #[must_use]
    pub fn fitted(self, reach_m: (f64, f64)) -> Self {
        let scale = self.scale(reach_m);
        match self {
            Self::Hold | Self::Pointer => self,
            Self::PressAndSlide(program) => Self::PressAndSlide(program.scaled(scale)),
            Self::Circle(program) => Self::Circle(program.scaled(scale)),
            Self::Random(program) => Self::Random(program.scaled(scale)),
        }
    }
}

impl Default for HandProgram {
    fn default() -> Self {
        Self::PressAndSlide(SlideProgram::default())
    }
}

impl fmt::Display for HandProgram {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for HandProgram {
    type Err = UnknownHandProgram;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::all()
            .into_iter()
            .find(|program| program.name() == name)
            .ok_or_else(|| UnknownHandProgram(name.to_owned()))
    }
}

/// A spring and a damper towards a target, as strong as the hand and no stronger.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grip {
    /// Stiffness, N/m.
    pub stiffness_N_per_m: f64,
    /// Damping against the target's velocity, N s/m.
    pub damping_N_s_per_m: f64,
    /// Largest force, N.
    pub max_N: f64,
}

impl Grip {
    /// A comfortable grip for motion in free air: overdamped with half a kilogram.
    pub const EASY: Self = Self { stiffness_N_per_m: 400.0, damping_N_s_per_m: 50.0, max_N: 20.0 };

    /// Force along one axis, from how far and how much too slowly the handle lags behind.
    fn along(&self, lag_m: f64, lag_m_per_s: f64) -> f64 {
        let force_N = self.stiffness_N_per_m * lag_m + self.damping_N_s_per_m * lag_m_per_s;
        force_N.clamp(-self.max_N, self.max_N)
    }

    /// Force in the plane, limited in magnitude.
    fn pull(&self, lag_m: Vector2<f64>, lag_m_per_s: Vector2<f64>) -> Vector2<f64> {
        let force_N = self.stiffness_N_per_m * lag_m + self.damping_N_s_per_m * lag_m_per_s;
        force_N.cap_magnitude(self.max_N)
    }

    /// A target further ahead than this does not pull harder: it would only be wound up.
    fn longest_lag_m(&self) -> f64 {
        self.max_N / self.stiffness_N_per_m
    }
}

/// What the hand does at one moment.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HandAction {
    /// Force on the handle, in B.
    pub F_hand_BH_N: PlaneVector,
    /// Buttons held, bit 0 first.
    pub buttons: u32,
}

/// A hand that somebody else wrote: an experiment's, a test's.
pub trait HandPull: Send + fmt::Debug {
    /// What it does for the next `dt_s` seconds to a handle at `p_BH` that moves at `v_BH`.
    fn act(&mut self, p_BH: &PlaneVector, v_BH: &PlaneVector, dt_s: f64) -> HandAction;
}

/// A hand at work.
#[derive(Debug)]
pub struct Hand {
    motion: Motion,
    /// Turn of the handle at which the wrist is at ease.
    ease_rad: f64,
    rng: ChaCha8Rng,
}

#[derive(Debug)]
enum Motion {
    Hold {
        home_m: Vector2<f64>,
    },
    Slide(slide::Slide),
    Circle(circle::Circle),
    Random(random::RandomPull),
    /// `None`: nobody can point yet.
    Pointer(Option<Pointer>),
    Other(Box<dyn HandPull>),
}

/// The state of the handle that a hand reacts to, and the time since it last did.
#[derive(Clone, Copy, Debug)]
struct Handle {
    p_m: Vector2<f64>,
    v_m_per_s: Vector2<f64>,
    dt_s: f64,
}

impl Hand {
    /// A hand that takes the handle at `p_BH`.
    pub fn new(program: HandProgram, p_BH: &PlaneVector, seed: u64) -> Self {
        let p_m = p_BH.xy();
        let motion = match program {
            HandProgram::Hold => Motion::Hold { home_m: p_m },
            HandProgram::PressAndSlide(program) => Motion::Slide(slide::Slide::new(program, p_m)),
            HandProgram::Circle(program) => Motion::Circle(circle::Circle::new(program)),
            HandProgram::Random(program) => Motion::Random(random::RandomPull::new(program)),
            HandProgram::Pointer => Motion::Pointer(None),
        };
        Self { motion, ease_rad: p_BH.z, rng: ChaCha8Rng::seed_from_u64(seed) }
    }

    /// From now on this hand pulls where `pointer` is told, whatever its program was.
    pub fn follow(&mut self, pointer: Pointer) {
        self.motion = Motion::Pointer(Some(pointer));
    }

    /// From now on this is somebody else's hand, whatever its program was.
    pub fn hand_over(&mut self, other: Box<dyn HandPull>) {
        self.motion = Motion::Other(other);
    }

    /// What the hand does for the next `dt_s` seconds to a handle at `p_BH` that moves at
    /// `v_BH`. Finite for finite arguments; does not allocate.
    pub fn act(&mut self, p_BH: &PlaneVector, v_BH: &PlaneVector, dt_s: f64) -> HandAction {
        let handle = Handle { p_m: p_BH.xy(), v_m_per_s: v_BH.xy(), dt_s };
        let (force_N, buttons) = match &mut self.motion {
            Motion::Hold { home_m } => {
                (Grip::EASY.pull(*home_m - handle.p_m, -handle.v_m_per_s), 0)
            }
            Motion::Slide(slide) => slide.act(&handle),
            Motion::Circle(circle) => (circle.act(&handle), 0),
            Motion::Random(random) => (random.act(&handle, &mut self.rng), 0),
            Motion::Pointer(None) => (Vector2::zeros(), 0),
            Motion::Pointer(Some(pointer)) => pointer.act(&handle),
            Motion::Other(other) => return other.act(p_BH, v_BH, dt_s),
        };
        let turn_Nm = WRIST_STIFFNESS_NM_PER_RAD * (self.ease_rad - p_BH.z)
            - WRIST_DAMPING_NM_S_PER_RAD * v_BH.z;
        let moment_Nm = turn_Nm.clamp(-WRIST_MAX_NM, WRIST_MAX_NM);
        HandAction { F_hand_BH_N: PlaneVector::new(force_N.x, force_N.y, moment_Nm), buttons }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(crate) const DT_S: f64 = 5e-4;

    /// Half a kilogram in free air, moved by the hand and a wall or brake that changes its
    /// velocity: enough of a world to try a program in.
    pub(crate) struct PointMass {
        pub(crate) p_m: Vector2<f64>,
        pub(crate) v_m_per_s: Vector2<f64>,
    }

    impl PointMass {
        pub(crate) fn at(p_m: [f64; 2]) -> Self {
            Self { p_m: p_m.into(), v_m_per_s: Vector2::zeros() }
        }

        pub(crate) fn step(
            &mut self,
            hand: &mut Hand,
            world: impl Fn(&mut Self, &HandAction),
        ) -> HandAction {
            let pad = |v: &Vector2<f64>| PlaneVector::new(v.x, v.y, 0.0);
            let action = hand.act(&pad(&self.p_m), &pad(&self.v_m_per_s), DT_S);
            self.v_m_per_s += DT_S / 0.5 * action.F_hand_BH_N.xy();
            world(self, &action);
            self.p_m += DT_S * self.v_m_per_s;
            action
        }
    }

    #[test]
    fn every_program_has_a_name_that_reads_back() {
        for program in HandProgram::all() {
            assert_eq!(program.to_string().parse(), Ok(program));
        }
        assert_eq!(
            "wave".parse::<HandProgram>().unwrap_err().to_string(),
            "hand program `wave` does not exist: choose hold, press-and-slide, circle, random or pointer"
        );
    }

    #[test]
    fn a_hand_that_holds_brings_a_pushed_handle_home() {
        let mut handle = PointMass::at([0.3, 0.1]);
        let mut hand = Hand::new(HandProgram::Hold, &PlaneVector::new(0.3, 0.1, 0.0), 0);
        handle.v_m_per_s = Vector2::new(0.5, -0.5);
        let mut furthest_m = 0.0_f64;
        for _ in 0..4_000 {
            let action = handle.step(&mut hand, |_, _| ());
            assert!(action.F_hand_BH_N.norm() <= Grip::EASY.max_N + 1e-9);
            furthest_m = furthest_m.max((handle.p_m - Vector2::new(0.3, 0.1)).norm());
        }
        assert!((0.003..0.05).contains(&furthest_m), "{furthest_m}");
        assert!((handle.p_m - Vector2::new(0.3, 0.1)).norm() < 1e-6);
    }

    #[test]
    fn programs_shrink_to_a_small_device_and_leave_a_large_one_alone() {
        for program in HandProgram::all() {
            assert_eq!(program.fitted((0.0, 0.6)), program);
            let small = program.fitted((0.05, 0.25));
            let start_m = Vector2::from(small.start_m()).norm();
            assert!(
                start_m < 0.25 || matches!(program, HandProgram::Hold | HandProgram::Pointer),
                "{small:?}"
            );
        }
    }
}

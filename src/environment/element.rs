//! What a scene is made of: surfaces that constrain and fields that push.

use nalgebra::Vector3;

use super::Surface;

/// Most objects a resident scene can hold.
pub const MAX_OBJECTS: usize = 256;

/// One thing in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Element {
    /// Something with a surface.
    Surface(Surface),
    /// The same force everywhere, newtons in W.
    ConstantField { force_W_N: Vector3<f64> },
    /// Force against the tool's velocity.
    ViscousField { damping_Ns_per_m: f64 },
}

impl Element {
    /// Force of a field on the tool; `None` for a surface.
    pub fn field_force_W_N(&self, v_WT_m_per_s: &Vector3<f64>) -> Option<Vector3<f64>> {
        match self {
            Self::Surface(_) => None,
            Self::ConstantField { force_W_N } => Some(*force_W_N),
            Self::ViscousField { damping_Ns_per_m } => Some(-*damping_Ns_per_m * v_WT_m_per_s),
        }
    }
}

/// An element of the resident scene, with the slot that keeps its run-time state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneItem {
    /// Stable for the life of the object, below [`MAX_OBJECTS`].
    pub slot: u16,
    /// Changes when the object changes.
    pub revision: u64,
    /// The thing itself.
    pub element: Element,
}

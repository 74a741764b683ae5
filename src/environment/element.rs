//! What a scene is made of: surfaces that constrain and fields that push.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{Corridor, ForceField, Surface};

/// Most objects a resident scene can hold.
pub const MAX_OBJECTS: usize = 256;

/// One thing in the world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Element {
    /// Something with a surface.
    Surface(Surface),
    /// A path with room around it.
    Corridor(Corridor),
    /// The same force everywhere, newtons in W.
    ConstantField { force_W_N: Vector3<f64> },
    /// Force against the tool's velocity.
    ViscousField { damping_Ns_per_m: f64 },
    /// A wrench that varies with place and velocity.
    ForceField(ForceField),
}

impl Element {
    /// Force and moment of a field at the tool point; `None` for what has a surface.
    pub fn field_at(
        &self,
        p_WT_m: &Vector3<f64>,
        v_WT_m_per_s: &Vector3<f64>,
    ) -> Option<[Vector3<f64>; 2]> {
        match self {
            Self::Surface(_) | Self::Corridor(_) => None,
            Self::ConstantField { force_W_N } => Some([*force_W_N, Vector3::zeros()]),
            Self::ViscousField { damping_Ns_per_m } => {
                Some([-*damping_Ns_per_m * v_WT_m_per_s, Vector3::zeros()])
            }
            Self::ForceField(field) => Some(field.at(p_WT_m, v_WT_m_per_s)),
        }
    }

    /// Stiffness (N/m) and damping (N s/m) of a field there, no less than they are in any
    /// direction; none of what has a surface.
    pub fn field_feel(&self, p_WT_m: &Vector3<f64>) -> [f64; 2] {
        match self {
            Self::Surface(_) | Self::Corridor(_) | Self::ConstantField { .. } => [0.0; 2],
            Self::ViscousField { damping_Ns_per_m } => [0.0, *damping_Ns_per_m],
            Self::ForceField(field) => field.feel(p_WT_m),
        }
    }
}

/// An element of the resident scene, with the slot that keeps its run-time state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneItem {
    /// Stable for the life of the object, below [`MAX_OBJECTS`].
    pub slot: u16,
    /// Changes when the object changes.
    pub revision: u64,
    /// The thing itself.
    pub element: Element,
}

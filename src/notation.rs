//! Frames, signs and the vectors that carry them, defined once for the whole crate.
//!
//! | letter | frame |
//! |---|---|
//! | W | world: right-handed, X right, Y forward, Z up |
//! | B | the device's plane: origin at its base axis, x and y in the plane, phi about its normal |
//! | H | the handle: the point that the linkage carries |
//! | T | the tool point: where the user and the scene meet; H plus the tool's offset |
//!
//! `p_BH_m` is the position of H in B, in metres; `v_BH` its rate; `F_BH_N` a wrench at H
//! in B. Sign of a force: what the *device* does to the hand, unless the name says `hand`.
//! Actuator torque and actuator rate are positive the same way round, so their product is
//! the power that the actuator puts into the linkage: a brake's is never positive.
//!
//! Arrays have room for the largest device and are zero beyond `freedoms` and `actuators`;
//! fixed sizes keep the real-time path free of allocation.

use nalgebra::{Matrix3, SMatrix, SVector};

/// Most freedoms a device can actuate: x, y and phi of its plane.
pub const MAX_FREEDOMS: usize = 3;

/// Most actuators a device can have (the 3-RRR of Kim et al. 2003 has six).
pub const MAX_ACTUATORS: usize = 6;

/// (x, y, phi) of the device's plane: a pose [m, m, rad], twist [m/s, m/s, rad/s] or
/// wrench [N, N, N m].
pub type PlaneVector = SVector<f64, MAX_FREEDOMS>;

/// One number per actuator: angle, rate or torque.
pub type ActuatorVector = SVector<f64, MAX_ACTUATORS>;

/// `R`, 3x6: column i is the wrench at the handle per unit torque of actuator i (the
/// reference force R_i+ of Cho 2005, Eq 16); rates follow by duality, `w = R^T v`.
pub type ReferenceMatrix = SMatrix<f64, MAX_FREEDOMS, MAX_ACTUATORS>;

/// Inertia at the handle, 3x3: kg, kg m, kg m^2.
pub type HandleInertia = Matrix3<f64>;

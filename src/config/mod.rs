//! What the user wrote becomes what the loop needs: device files, server file, scenes, plans.
//!
//! Every value passes through a range of [`crate::units`] exactly once and comes out as a
//! type that cannot hold anything else; gRPC goes through the same doors as files. An error
//! names file, key path, value, and what is allowed with its unit. Unknown keys are errors.
//! This module opens files when asked to; it knows no socket, no thread and no clock.

mod device;
mod device_file;
mod error;
mod id;
mod linkage;
mod object;
mod object_check;
mod object_layout;
mod object_message;
mod plan;
mod scene;
mod scene_file;
mod scene_layout;
mod served;
mod server;
mod server_layout;
mod settings;
mod stiffness;

pub use device::{BUILT_IN, DemoWall, DeviceDefinition};
pub use error::ConfigError;
#[cfg(feature = "net")]
pub(crate) use error::parse as parse_toml;
pub use id::Id;
pub use object::{GuidePath, ObjectKind, SceneObject};
pub use object_layout::ObjectLayout;
pub use object_message::{object_from_proto, object_to_proto};
pub use plan::{build_plan, plan_with};
pub use scene::{ExpectedRevision, Scene, SceneError};
pub use scene_file::{SceneFile, StateDir, StateError};
pub use scene_layout::{read_scene_objects, write_scene_objects};
pub use served::{MAX_DEVICES, ServedDevice, load_devices};
pub use server::{
    EXAMPLE, LogConfig, LogFormat, LogLevel, Overrides, RealtimePolicy, ServerConfig,
    SessionLimits, default_state_dir,
};
pub use settings::{Setting, Settings, SettingsError};

//! From a device and its scene to the plan that a tick takes.
//!
//! Both are checked already, so this cannot fail: it only chooses what a tick has to know.

use std::sync::Arc;

use super::{DeviceDefinition, Scene, Settings};
use crate::control::Plan;

/// The plan of a device as it starts, with its scene.
pub fn build_plan(device: &DeviceDefinition, scene: &Scene) -> Plan {
    plan_with(device, &Settings::of(device), scene)
}

/// The plan of a device with these settings and this scene, as of the first generation;
/// whoever builds another for the same device counts on.
pub fn plan_with(device: &DeviceDefinition, settings: &Settings, scene: &Scene) -> Plan {
    Plan {
        mechanism: Arc::clone(&device.mechanism),
        actuators: device.actuators,
        home_rad: device.home_rad,
        mount: settings.mount,
        tool: settings.tool,
        tick_ns: device.tick_ns,
        strategy: settings.strategy,
        guards: settings.guards,
        scene: scene.items(),
        scene_revision: scene.revision(),
        generation: 1,
    }
}

#[cfg(test)]
mod tests {
    use super::super::scene::tests::wall;
    use super::*;

    #[test]
    fn a_plan_has_the_device_and_the_scene_of_its_revision() {
        let device = DeviceDefinition::load("cho-2005").unwrap();
        let mut scene = Scene::default();
        assert_eq!(build_plan(&device, &scene).scene_revision, 1);
        scene.create(wall("wall", 0.3), None).unwrap();
        let plan = build_plan(&device, &scene);
        assert_eq!((plan.scene_revision, plan.scene.len()), (2, 1));
        assert_eq!((plan.tick_ns, plan.mechanism.actuators()), (1_000_000, 4));
        assert_eq!(plan.actuators, device.actuators);
    }
}

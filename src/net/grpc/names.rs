//! Resource names: `devices/NAME`, `devices/NAME/scene`, `devices/NAME/scene/objects/ID`.

use tonic::Status;

use crate::host::DeviceHost;

/// `devices/NAME` of a device.
pub fn device(host: &DeviceHost) -> String {
    format!("devices/{}", host.definition().name)
}

/// `devices/NAME/scene` of a device.
pub fn scene(host: &DeviceHost) -> String {
    format!("{}/scene", device(host))
}

/// Name of one of its objects.
pub fn object(host: &DeviceHost, id: &str) -> String {
    format!("{}/objects/{id}", scene(host))
}

/// Refuses the name of another device.
pub fn expect_device(host: &DeviceHost, field: &str, name: &str) -> Result<(), Status> {
    let known = device(host);
    if name == known { Ok(()) } else { Err(unknown(field, name, &known)) }
}

/// Refuses the name of another scene.
pub fn expect_scene(host: &DeviceHost, field: &str, name: &str) -> Result<(), Status> {
    let known = scene(host);
    if name == known { Ok(()) } else { Err(unknown(field, name, &known)) }
}

/// The ID in an object's name.
pub fn object_id<'a>(host: &DeviceHost, field: &str, name: &'a str) -> Result<&'a str, Status> {
    let prefix = object(host, "");
    name.strip_prefix(&prefix).ok_or_else(|| unknown(field, name, &format!("{prefix}ID")))
}

fn unknown(field: &str, name: &str, known: &str) -> Status {
    Status::not_found(format!("{field} = {name:?}: this server has {known}"))
}

//! Resource names: `devices/NAME`, `devices/NAME/scene`, `devices/NAME/scene/objects/ID`.

use tonic::Status;

use super::desk::{Desk, Desks};
use super::guard::Asker;
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

/// The device of this name, for this caller.
pub fn find_device<'a>(
    desks: &'a Desks,
    asker: &Asker,
    field: &str,
    name: &str,
) -> Result<&'a Desk, Status> {
    let found = desks.iter().find(|desk| device(&desk.host) == name);
    allowed(found.ok_or_else(|| unknown(field, name, desks, device))?, asker)
}

/// The device whose scene has this name, for this caller.
pub fn find_scene<'a>(
    desks: &'a Desks,
    asker: &Asker,
    field: &str,
    name: &str,
) -> Result<&'a Desk, Status> {
    let found = desks.iter().find(|desk| scene(&desk.host) == name);
    allowed(found.ok_or_else(|| unknown(field, name, desks, scene))?, asker)
}

/// The device in whose scene an object of this name is or is to be, and the object's ID, for
/// this caller.
pub fn find_object<'a, 'n>(
    desks: &'a Desks,
    asker: &Asker,
    field: &str,
    name: &'n str,
) -> Result<(&'a Desk, &'n str), Status> {
    let within = |desk: &'a Desk| Some((desk, name.strip_prefix(&object(&desk.host, ""))?));
    let found = desks.iter().find_map(within);
    let (desk, id) = found.ok_or_else(|| unknown(field, name, desks, |host| object(host, "ID")))?;
    Ok((allowed(desk, asker)?, id))
}

fn allowed<'a>(desk: &'a Desk, asker: &Asker) -> Result<&'a Desk, Status> {
    asker.on(&device(&desk.host))?;
    Ok(desk)
}

fn unknown(
    field: &str,
    name: &str,
    desks: &Desks,
    known: impl Fn(&DeviceHost) -> String,
) -> Status {
    let known: Vec<_> = desks.iter().map(|desk| known(&desk.host)).collect();
    Status::not_found(format!("{field} = {name:?}: this server has {}", known.join(", ")))
}

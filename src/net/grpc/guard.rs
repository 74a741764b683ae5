//! Who may call what: each method needs a grant, on the device that it is about.
//!
//! A token comes as `authorization: Bearer TOKEN`. Health and reflection tell nobody's secrets and
//! need none. What a method is about only itself knows, so it asks [`Asker::on`].

use std::net::SocketAddr;
use std::sync::Arc;

use axum::extract::Request;
use axum::http::header::{AUTHORIZATION, HOST, ORIGIN};
use axum::middleware::Next;
use axum::response::Response;
use tonic::{Extensions, Status};

use crate::audit::What;
use crate::credentials::{Denied, Grant};
use crate::net::Access;
use crate::net::gate::{Caller, Gate, Refused};
use crate::net::visit::Peer;

/// Begins the paths of the services.
const PACKAGE: &str = "/hapticd.v1.";

/// Every method and what it needs. A Stop is for everybody: who sees that something is wrong
/// need not be who may put it right. What a session may do is judged by its role.
const NEEDED: &[(&str, Grant)] = &[
    ("DeviceService/ListDevices", Grant::Observer),
    ("DeviceService/WatchDevices", Grant::Observer),
    ("DeviceService/GetDescription", Grant::Observer),
    ("DeviceService/GetState", Grant::Observer),
    ("DeviceService/WatchState", Grant::Observer),
    ("DeviceService/WatchEvents", Grant::Observer),
    ("DeviceService/GetSettings", Grant::Observer),
    ("DeviceService/UpdateSettings", Grant::Operator),
    ("DeviceService/Enable", Grant::Operator),
    ("DeviceService/Disable", Grant::Operator),
    ("DeviceService/Home", Grant::Operator),
    ("DeviceService/Stop", Grant::Observer),
    ("DeviceService/ClearFault", Grant::Operator),
    ("DeviceService/Explain", Grant::Observer),
    ("DeviceService/GetManipulability", Grant::Observer),
    ("SceneService/GetScene", Grant::Observer),
    ("SceneService/ReplaceScene", Grant::Operator),
    ("SceneService/WatchScene", Grant::Observer),
    ("SceneService/ListObjects", Grant::Observer),
    ("SceneService/GetObject", Grant::Observer),
    ("SceneService/CreateObject", Grant::Operator),
    ("SceneService/UpdateObject", Grant::Operator),
    ("SceneService/DeleteObject", Grant::Operator),
    ("SessionService/ListSessions", Grant::Observer),
    ("SessionService/OpenSession", Grant::Observer),
    ("SessionService/CloseSession", Grant::Observer),
    ("SessionService/AcquireLease", Grant::Controller),
    ("SessionService/ReleaseLease", Grant::Controller),
    ("RecordingService/StartRecording", Grant::Controller),
    ("RecordingService/StopRecording", Grant::Controller),
    ("RecordingService/GetRecording", Grant::Observer),
    ("RecordingService/ListRecordings", Grant::Observer),
    ("RecordingService/DownloadRecording", Grant::Observer),
    ("RecordingService/DeleteRecording", Grant::Operator),
];

/// Who makes a call.
#[derive(Clone, Debug)]
pub struct Asker {
    caller: Caller,
    from: String,
    gate: Arc<Gate>,
    needed: Grant,
}

impl Asker {
    /// Of a request that came through [`guard`].
    pub fn of(extensions: &Extensions) -> Result<Self, Status> {
        let missing = || Status::internal("nobody knows who is calling");
        extensions.get::<Self>().cloned().ok_or_else(missing)
    }

    /// What it asks for is about this device (`devices/NAME`).
    pub fn on(&self, device: &str) -> Result<(), Status> {
        let allowed = self.caller.holder().check_device(device);
        allowed.map_err(|not| self.refuse(&not.into(), device))
    }

    /// Whether this device is any of its business.
    pub fn sees(&self, device: &str) -> bool {
        self.caller.holder().check_device(device).is_ok()
    }

    /// A refusal that the audit log knows of.
    pub fn refuse(&self, refused: &Refused, device: &str) -> Status {
        self.gate.record_refused(refused.who(), &self.from, device, &refused.to_string());
        status(refused)
    }

    /// The one device that it is for; empty where that is any.
    pub fn own_device(&self) -> String {
        self.caller.holder().device.clone().unwrap_or_default()
    }

    /// Whether it would be let in now, for the same: a watch that stays open asks again.
    pub fn still(&self, device: &str) -> Result<(), Status> {
        let still = self.gate.still(&self.caller, self.needed, device);
        still.map_err(|refused| self.refuse(&refused, device))
    }

    /// What it did, for the audit log.
    pub fn did(&self, what: What, device: &str, detail: &str) {
        self.gate.record(what, &self.caller, &self.from, device, detail);
    }

    /// Name of its credential; `None` where none is needed.
    pub fn credential(&self) -> Option<&str> {
        self.gate.is_guarded().then(|| self.caller.name())
    }

    /// Who it is, and where.
    pub fn who(&self) -> (Caller, String) {
        (self.caller.clone(), self.from.clone())
    }
}

/// The layer before the services.
pub async fn guard(
    gate: Arc<Gate>,
    access: Arc<Access>,
    mut request: Request,
    next: Next,
) -> Response {
    // Programs that are no browsers name no page, and call the server what they like.
    if let Some(page) = request.headers().get(ORIGIN) {
        let host = request.uri().authority().map(|name| name.as_str().to_owned());
        let named = request.headers().get(HOST).and_then(|name| name.to_str().ok());
        let host = host.or(named.map(str::to_owned)).unwrap_or_default();
        if let Err(refusal) = access.check(&host, Some(&String::from_utf8_lossy(page.as_bytes()))) {
            return Status::permission_denied(refusal.to_string()).into_http();
        }
    }
    let method = request.uri().path().strip_prefix(PACKAGE);
    let needed = method.and_then(|method| NEEDED.iter().find(|(name, _)| *name == method));
    // A method that is not there is refused by those who would know it.
    let Some((method, needed)) = needed else { return next.run(request).await };
    let from = from(&request).map_or_else(String::new, |address| address.to_string());
    match judge(&gate, &request, *needed) {
        Ok(caller) => {
            let asker = Asker { caller, from, gate, needed: *needed };
            request.extensions_mut().insert(asker);
            next.run(request).await
        }
        Err(refused) => {
            gate.record_refused(refused.who(), &from, "", &format!("{method}: {refused}"));
            status(&refused).into_http()
        }
    }
}

fn judge(gate: &Gate, request: &Request, needed: Grant) -> Result<Caller, Refused> {
    let token = request.headers().get(AUTHORIZATION).and_then(|value| value.to_str().ok());
    let caller = gate.judge(token.map_or("", bearer))?;
    caller.holder().check_grant(needed)?;
    Ok(caller)
}

/// The token of `Bearer TOKEN`, whose first word may be written in any case (RFC 9110 section
/// 11.1).
fn bearer(value: &str) -> &str {
    match value.split_once(' ') {
        Some((scheme, token)) if scheme.eq_ignore_ascii_case("bearer") => token.trim(),
        _ => "",
    }
}

fn from(request: &Request) -> Option<SocketAddr> {
    request.extensions().get::<Peer>().map(|peer| peer.0)
}

/// What a client is told.
pub fn status(refused: &Refused) -> Status {
    let text = refused.to_string();
    match refused {
        Refused::Denied(Denied::Missing | Denied::Unknown | Denied::Expired { .. }) => {
            Status::unauthenticated(text)
        }
        Refused::NotAllowed(_) => Status::permission_denied(text),
        Refused::Share { .. } => Status::resource_exhausted(text),
    }
}

#[cfg(test)]
mod tests {
    use prost::Message;

    use super::*;
    use crate::proto::DESCRIPTOR_SET;

    /// Nothing can be called that is not in the table, nor is anything in it that cannot be.
    #[test]
    fn every_method_of_the_contract_has_its_grant() {
        let set = prost_types::FileDescriptorSet::decode(DESCRIPTOR_SET).unwrap();
        let services = set.file.iter().flat_map(|file| &file.service);
        let methods = services.flat_map(|service| {
            service.method.iter().map(|method| format!("{}/{}", service.name(), method.name()))
        });
        let mut methods: Vec<_> = methods.collect();
        methods.sort();
        let mut listed: Vec<_> = NEEDED.iter().map(|(name, _)| (*name).to_owned()).collect();
        listed.sort();
        assert_eq!(methods, listed);
    }

    #[test]
    fn a_token_follows_its_scheme() {
        for (value, token) in [
            ("Bearer abc", "abc"),
            ("bearer  abc ", "abc"),
            ("Basic abc", ""),
            ("abc", ""),
            ("", ""),
        ] {
            assert_eq!(bearer(value), token, "{value:?}");
        }
    }
}

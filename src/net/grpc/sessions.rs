//! SessionService: who is connected to the stream, and who commands.

use tonic::{Request, Response, Status};

use super::guard::Asker;
use super::{field_status, names};
use crate::host::Hosts;
use crate::net::{DeskRefusal, SealedUdpOffer, SessionDesk};
use crate::proto::session_service_server::SessionService;
use crate::proto::{
    self, AcquireLeaseRequest, ByeReason, CloseSessionRequest, CloseSessionResponse, Lease,
    ListSessionsRequest, ListSessionsResponse, OpenSessionRequest, OpenSessionResponse,
    ReleaseLeaseRequest, Session,
};
use crate::quic;
use crate::session::{
    CallRefusal, LeaseInfo, Role, SessionId, SessionInfo, Sessions, Switchboard, Ticket,
};
use crate::units::FieldError;

/// The service.
pub struct SessionCallsService {
    desk: SessionDesk,
    hosts: Hosts,
}

impl SessionCallsService {
    /// Of the stream behind this desk.
    pub fn new(desk: SessionDesk, hosts: Hosts) -> Self {
        Self { desk, hosts }
    }

    async fn ask<T: Send + 'static>(
        &self,
        question: impl FnOnce(&mut Switchboard, u64) -> T + Send + 'static,
    ) -> Result<T, Status> {
        let ended = || Status::unavailable("the stream has ended");
        self.desk.ask(question).await.ok_or_else(ended)
    }
}

/// Bytes that nobody can guess.
fn random<const N: usize>() -> Result<[u8; N], Status> {
    let mut bytes = [0; N];
    quic::fill_random(&mut bytes).map_err(|none| Status::internal(none.to_string()))?;
    Ok(bytes)
}

#[tonic::async_trait]
impl SessionService for SessionCallsService {
    async fn list_sessions(
        &self,
        request: Request<ListSessionsRequest>,
    ) -> Result<Response<ListSessionsResponse>, Status> {
        let asker = Asker::of(request.extensions())?;
        let device = request.into_inner().device;
        if !device.is_empty() && !self.hosts.iter().any(|host| names::device(host) == device) {
            let known: Vec<_> = self.hosts.iter().map(|host| names::device(host)).collect();
            let known = known.join(", ");
            return Err(Status::not_found(format!("device = {device:?}: this server has {known}")));
        }
        let list = move |board: &mut Switchboard, now_ns| {
            let wanted = |sessions: &&Sessions| {
                let name = sessions.device_name();
                asker.sees(&name) && (device.is_empty() || name == device)
            };
            let of = |sessions| list_of(sessions, now_ns);
            board.devices().filter(wanted).flat_map(of).collect()
        };
        Ok(Response::new(ListSessionsResponse { sessions: self.ask(list).await? }))
    }

    async fn open_session(
        &self,
        request: Request<OpenSessionRequest>,
    ) -> Result<Response<OpenSessionResponse>, Status> {
        let missing = || field_status(&FieldError::new("hello", "(none)", "is required"));
        let asker = Asker::of(request.extensions())?;
        let request = request.into_inner();
        let sealed = wants_sealed(request.transport)?;
        let hello = request.hello.ok_or_else(missing)?;
        if !hello.ticket.is_empty() {
            let set = FieldError::new("hello.ticket", "(set)", "must be empty: it is the answer");
            return Err(field_status(&set));
        }
        let ticket: Ticket = random()?;
        let offer = || {
            let (association, secret) = (random()?, random()?);
            Ok::<_, Status>(SealedUdpOffer { association, secret, ticket })
        };
        let offer = sealed.then(offer).transpose()?;
        let opened = self.desk.open(asker.who(), hello, ticket, offer).await;
        let welcome = opened.map_err(|refusal| desk_status(&asker, &refusal))?;
        tracing::info!(session = welcome.session, device = welcome.device, "opened by a call");
        let port = self.desk.udp_port().into();
        let sealed_udp = offer.map(|SealedUdpOffer { association, secret, .. }| proto::SealedUdp {
            port,
            association: association.to_vec(),
            secret: secret.to_vec(),
        });
        let (welcome, ticket) = (Some(welcome), ticket.to_vec());
        Ok(Response::new(OpenSessionResponse { welcome, ticket, sealed_udp }))
    }

    async fn close_session(
        &self,
        request: Request<CloseSessionRequest>,
    ) -> Result<Response<CloseSessionResponse>, Status> {
        let asker = Asker::of(request.extensions())?;
        let id = session_id(&request.get_ref().name)?;
        let closed = self.desk.close(asker.who(), id).await;
        closed.map_err(|refusal| desk_status(&asker, &refusal))?;
        Ok(Response::new(CloseSessionResponse {}))
    }

    async fn acquire_lease(
        &self,
        request: Request<AcquireLeaseRequest>,
    ) -> Result<Response<Lease>, Status> {
        let asker = Asker::of(request.extensions())?;
        let AcquireLeaseRequest { name, takeover } = request.into_inner();
        let id = session_id(&name)?;
        told(&asker, "lease given", self.desk.acquire_lease(asker.who(), id, takeover).await)
    }

    async fn release_lease(
        &self,
        request: Request<ReleaseLeaseRequest>,
    ) -> Result<Response<Lease>, Status> {
        let asker = Asker::of(request.extensions())?;
        let id = session_id(&request.get_ref().name)?;
        told(&asker, "lease released", self.desk.release_lease(asker.who(), id).await)
    }
}

fn wants_sealed(transport: i32) -> Result<bool, Status> {
    match proto::Transport::try_from(transport) {
        Ok(proto::Transport::Unspecified) => Ok(false),
        Ok(proto::Transport::SealedUdp) => Ok(true),
        Err(_) => {
            let allowed = "must be TRANSPORT_UNSPECIFIED (0) or TRANSPORT_SEALED_UDP (1)";
            Err(field_status(&FieldError::new("transport", transport, allowed)))
        }
    }
}

fn told(
    asker: &Asker,
    what: &str,
    lease: Result<LeaseInfo, DeskRefusal>,
) -> Result<Response<Lease>, Status> {
    let LeaseInfo { holder, epoch } = lease.map_err(|refusal| desk_status(asker, &refusal))?;
    let session = holder.map_or_else(String::new, |holder| holder.to_string());
    tracing::info!(session, epoch, what);
    Ok(Response::new(Lease { session, epoch }))
}

fn session_id(name: &str) -> Result<SessionId, Status> {
    SessionId::parse(name).ok_or_else(|| {
        field_status(&FieldError::new("name", format!("{name:?}"), "must be sessions/ID"))
    })
}

fn desk_status(asker: &Asker, refusal: &DeskRefusal) -> Status {
    match refusal {
        DeskRefusal::Call(refusal) => call_status(refusal),
        DeskRefusal::Caller(refused) => asker.refuse(refused, ""),
        DeskRefusal::Ended => Status::unavailable(refusal.to_string()),
    }
}

fn call_status(refusal: &CallRefusal) -> Status {
    let text = refusal.to_string();
    match refusal {
        CallRefusal::Unknown(_) => Status::not_found(text),
        CallRefusal::Hand(_) | CallRefusal::NoLease(_) => Status::failed_precondition(text),
        CallRefusal::Refused { reason, .. } => match reason {
            ByeReason::LeaseHeld => Status::failed_precondition(text),
            ByeReason::UnknownDevice => Status::not_found(text),
            ByeReason::TooManySessions => Status::resource_exhausted(text),
            _ => Status::invalid_argument(text),
        },
    }
}

fn list_of(sessions: &Sessions, now_ns: u64) -> Vec<Session> {
    let device = sessions.device_name();
    let lease = sessions.lease();
    let shown = |info: SessionInfo| {
        let epoch = if lease.holder == Some(info.id) { lease.epoch } else { 0 };
        session_to_proto(&info, &device, epoch)
    };
    sessions.list(now_ns).map(shown).collect()
}

fn session_to_proto(info: &SessionInfo, device: &str, lease_epoch: u64) -> Session {
    Session {
        name: info.id.to_string(),
        device: device.to_owned(),
        client_name: info.client_name.to_owned(),
        role: match info.role {
            Role::Observer => proto::Role::Observer.into(),
            Role::Controller => proto::Role::Controller.into(),
            Role::Hand => proto::Role::Hand.into(),
        },
        transport: if info.waiting { String::new() } else { info.transport.name().to_owned() },
        state: info.state.into(),
        quality: proto::Quality::from(info.quality).into(),
        loss_ratio: info.loss,
        delay_variation_s: info.variation_ns * 1e-9,
        round_trip_s: info.rtt_ns.map(|ns| ns as f64 * 1e-9),
        felt_stiffness_ratio: info.felt_stiffness_ratio,
        slowed_by: info.slowed_by,
        clutched: info.clutched,
        lease_epoch,
        last_refusal: info.last_refusal.map_or_else(String::new, ToString::to_string),
        waiting: info.waiting,
    }
}

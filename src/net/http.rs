//! HTTP: `/metrics` for Prometheus, `/healthz`, and for pages `/certificate-hashes`, with which they
//! open WebTransport, and the services as grpc-web.
//!
//! Whose line nobody else hears gets all of it: this machine's, and HTTPS but for the metrics. Plain
//! HTTP for others is for those who watch: hashes and tokens have no place on it.

use std::sync::Arc;

use axum::Router;
use axum::extract::Request;
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::middleware::{Next, from_fn};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use serde_json::json;
use tokio::sync::watch;
use tonic_web::GrpcWebLayer;

use super::visit::{Speaks, receive};
use super::{Access, BrowserIdentity, Door};
use crate::host::{DeviceHost, Hosts};
use crate::quic::WEBTRANSPORT_PATH;
use crate::telemetry::Scrape;

/// Prometheus' text format.
const TEXT_FORMAT: &str = "text/plain; version=0.0.4; charset=utf-8";

/// JSON, new each time: a page that holds on to an old hash does not connect.
const JSON: [(header::HeaderName, &str); 2] =
    [(header::CONTENT_TYPE, "application/json"), (header::CACHE_CONTROL, "no-store")];

/// Who hears what is said.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reach {
    /// This machine alone; or everybody, where that was asked for in so many words.
    Here,
    /// Whoever is on the way: plain HTTP beyond this machine.
    Watchers,
    /// Whoever came by HTTPS.
    Encrypted,
}

/// What a page of another origin that may call may send and read: what grpc-web needs.
const CROSS_ORIGIN: [(header::HeaderName, &str); 4] = [
    (header::ACCESS_CONTROL_ALLOW_METHODS, "GET, POST"),
    (
        header::ACCESS_CONTROL_ALLOW_HEADERS,
        "authorization, content-type, grpc-timeout, x-grpc-web, x-user-agent",
    ),
    (header::ACCESS_CONTROL_EXPOSE_HEADERS, "grpc-message, grpc-status, grpc-status-details-bin"),
    (header::ACCESS_CONTROL_MAX_AGE, "600"),
];

/// What pages can be told.
#[derive(Clone, Debug)]
pub struct HttpParts {
    /// The metrics.
    pub scrape: Scrape,
    /// The devices.
    pub hosts: Hosts,
    /// Whose hashes are published.
    pub browser: Arc<BrowserIdentity>,
    /// Where WebTransport is.
    pub stream_port: u16,
    /// Whose pages may ask.
    pub access: Access,
}

/// Serves until `stopped` is true or its sender gone.
pub async fn serve(
    door: Door,
    reach: Reach,
    parts: HttpParts,
    services: Router,
    stopped: watch::Receiver<bool>,
) {
    let HttpParts { scrape, hosts, browser, stream_port, access } = parts;
    let metrics = move || {
        let scrape = scrape.clone();
        async move { ([(header::CONTENT_TYPE, TEXT_FORMAT)], scrape.render()) }
    };
    let health = move || {
        let hosts = hosts.clone();
        async move { health(&hosts) }
    };
    let hashes = move || {
        let said = hashes(&browser, stream_port);
        async move { (JSON, said) }
    };
    let access = Arc::new(access);
    let mut router = Router::new().route("/healthz", get(health));
    if reach != Reach::Encrypted {
        router = router.route("/metrics", get(metrics));
    }
    if reach != Reach::Watchers {
        router = router.route("/certificate-hashes", get(hashes));
        // What is no call is not there, and not a bad call.
        router = router.merge(services.layer(GrpcWebLayer::new()).reset_fallback());
    }
    let access = Arc::new(access);
    let router = router.layer(from_fn(move |request: Request, next: Next| {
        guard(Arc::clone(&access), request, next)
    }));
    receive(door, Speaks::Either, router, stopped).await;
}

/// Strangers' pages get nothing, and allowed ones may read what they get.
async fn guard(access: Arc<Access>, request: Request, next: Next) -> Response {
    let text = |headers: &HeaderMap, name| {
        headers.get(name).map(|value| String::from_utf8_lossy(value.as_bytes()).into_owned())
    };
    let host = text(request.headers(), header::HOST)
        .or_else(|| request.uri().authority().map(ToString::to_string))
        .unwrap_or_default();
    let origin = text(request.headers(), header::ORIGIN);
    if let Err(refusal) = access.check(&host, origin.as_deref()) {
        return (StatusCode::FORBIDDEN, format!("{refusal}\n")).into_response();
    }
    // A page asks whether it may before it sends a call.
    let mut response = match *request.method() {
        Method::OPTIONS => StatusCode::NO_CONTENT.into_response(),
        _ => next.run(request).await,
    };
    if let Some(origin) = origin.and_then(|origin| origin.parse().ok()) {
        let headers = response.headers_mut();
        headers.insert(header::ACCESS_CONTROL_ALLOW_ORIGIN, origin);
        headers.insert(header::VARY, HeaderValue::from_static("origin"));
        for (name, value) in CROSS_ORIGIN {
            headers.insert(name, HeaderValue::from_static(value));
        }
    }
    response
}

/// What `new WebTransport(url, { serverCertificateHashes })` needs: the certificate of now, and
/// the one after it.
fn hashes(browser: &BrowserIdentity, stream_port: u16) -> String {
    let hex = |hash: [u8; 32]| hash.iter().map(|byte| format!("{byte:02x}")).collect::<String>();
    let hashes = browser.hashes().map(hex);
    json!({ "port": stream_port, "path": WEBTRANSPORT_PATH, "algorithm": "sha-256", "sha256": hashes })
        .to_string()
}

/// 200 while every loop turns, 503 when one does not, with its name.
fn health(hosts: &Hosts) -> impl IntoResponse + use<> {
    let dead = |host: &&Arc<DeviceHost>| !host.is_alive();
    let name = |host: &Arc<DeviceHost>| host.definition().name.to_string();
    let dead: Vec<_> = hosts.iter().filter(dead).map(name).collect();
    if dead.is_empty() {
        return (StatusCode::OK, "ok\n".to_owned());
    }
    let said = format!("the real-time loop does not turn: {}\n", dead.join(", "));
    (StatusCode::SERVICE_UNAVAILABLE, said)
}

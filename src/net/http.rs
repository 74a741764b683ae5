//! Plain HTTP: `/metrics` for Prometheus and `/healthz`.

use std::sync::Arc;

use axum::Router;
use axum::http::{StatusCode, header};
use axum::response::IntoResponse;
use axum::routing::get;
use tokio::sync::watch;

use super::Door;
use crate::host::{DeviceHost, Hosts};
use crate::telemetry::Scrape;

/// Prometheus' text format.
const TEXT_FORMAT: &str = "text/plain; version=0.0.4; charset=utf-8";

/// Serves until `stopped` is true or its sender gone.
pub async fn serve(
    door: Door,
    scrape: Scrape,
    hosts: Hosts,
    mut stopped: watch::Receiver<bool>,
) -> std::io::Result<()> {
    let metrics = move || {
        let scrape = scrape.clone();
        async move { ([(header::CONTENT_TYPE, TEXT_FORMAT)], scrape.render()) }
    };
    let health = move || {
        let hosts = hosts.clone();
        async move { health(&hosts) }
    };
    let router = Router::new().route("/metrics", get(metrics)).route("/healthz", get(health));
    let shutdown = async move {
        let _ = stopped.wait_for(|stopped| *stopped).await;
    };
    axum::serve(door, router).with_graceful_shutdown(shutdown).await
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

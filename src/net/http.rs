//! Plain HTTP: `/metrics` for Prometheus and `/healthz`.

use std::sync::Arc;

use axum::Router;
use axum::http::{StatusCode, header};
use axum::response::IntoResponse;
use axum::routing::get;
use tokio::sync::watch;

use super::Door;
use crate::host::DeviceHost;
use crate::telemetry::Scrape;

/// Prometheus' text format.
const TEXT_FORMAT: &str = "text/plain; version=0.0.4; charset=utf-8";

/// Serves until `stopped` is true or its sender gone.
pub async fn serve(
    door: Door,
    scrape: Scrape,
    host: Arc<DeviceHost>,
    mut stopped: watch::Receiver<bool>,
) -> std::io::Result<()> {
    let metrics = move || {
        let scrape = scrape.clone();
        async move { ([(header::CONTENT_TYPE, TEXT_FORMAT)], scrape.render()) }
    };
    let health = move || {
        let host = Arc::clone(&host);
        async move { health(&host) }
    };
    let router = Router::new().route("/metrics", get(metrics)).route("/healthz", get(health));
    let shutdown = async move {
        let _ = stopped.wait_for(|stopped| *stopped).await;
    };
    axum::serve(door, router).with_graceful_shutdown(shutdown).await
}

/// 200 while the loop turns, 503 when it does not.
fn health(host: &DeviceHost) -> impl IntoResponse + use<> {
    if host.is_alive() {
        (StatusCode::OK, "ok\n")
    } else {
        (StatusCode::SERVICE_UNAVAILABLE, "the real-time loop does not turn\n")
    }
}

//! Plain HTTP: `/metrics` for Prometheus and `/healthz`.

use std::future::Future;
use std::sync::Arc;

use axum::Router;
use axum::http::{StatusCode, header};
use axum::response::IntoResponse;
use axum::routing::get;
use tokio::net::TcpListener;

use crate::host::DeviceHost;
use crate::telemetry::Scrape;

/// Prometheus' text format.
const TEXT_FORMAT: &str = "text/plain; version=0.0.4; charset=utf-8";

/// Serves until `shutdown` is done.
pub async fn serve(
    listener: TcpListener,
    scrape: Scrape,
    host: Arc<DeviceHost>,
    shutdown: impl Future<Output = ()> + Send + 'static,
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
    axum::serve(listener, router).with_graceful_shutdown(shutdown).await
}

/// 200 while the loop turns, 503 when it does not.
fn health(host: &DeviceHost) -> impl IntoResponse + use<> {
    if host.is_alive() {
        (StatusCode::OK, "ok\n")
    } else {
        (StatusCode::SERVICE_UNAVAILABLE, "the real-time loop does not turn\n")
    }
}

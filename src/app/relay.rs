//! A TCP relay for the services beside a bad network: it makes nothing worse.

use std::net::SocketAddr;
use std::sync::Arc;

use tokio::io::copy_bidirectional;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;

/// Connections at a time; one more waits.
const MOST: usize = 64;

/// Relays whatever comes to that server until it is dropped, and the connections with it.
pub async fn relay(listener: TcpListener, target: SocketAddr) {
    let places = Arc::new(Semaphore::new(MOST));
    let mut connections = tokio::task::JoinSet::new();
    while let Ok(place) = Arc::clone(&places).acquire_owned().await {
        // A client that is gone again, or no file for it: the next one may fare better.
        let Ok((mut client, _)) = listener.accept().await else {
            tokio::time::sleep(std::time::Duration::from_millis(100)).await;
            continue;
        };
        connections.spawn(async move {
            let _place = place;
            // Whoever cannot be connected sees the end of the line.
            let Ok(mut server) = TcpStream::connect(target).await else { return };
            let _ = client.set_nodelay(true);
            let _ = server.set_nodelay(true);
            let _ = copy_bidirectional(&mut client, &mut server).await;
        });
        while connections.try_join_next().is_some() {}
    }
}

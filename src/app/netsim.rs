//! A UDP proxy that is as bad a network as it is told, between real processes.
//!
//! One thread with its own clock: what comes from a client goes to the server, and back, when
//! its [`ImpairedPath`] lets it arrive. Each client gets a socket of its own towards the
//! server, as behind an address translator.

use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::os::fd::AsFd;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use crate::clock::now_ns;
use crate::impairment::{Carried, ImpairedPath, Impairment};

/// Clients at a time; a stranger beyond is not heard.
const MOST_CLIENTS: usize = 64;

/// A client that is silent for this long is forgotten.
const FORGOTTEN_NS: u64 = 60_000_000_000;

/// How long a stop may take to be seen.
const LONGEST_SLEEP_NS: u64 = 20_000_000;

/// Larger than any datagram.
const ROOM_BYTES: usize = 65_536;

/// Between whom, and how bad.
#[derive(Clone, Copy, Debug)]
pub struct NetsimConfig {
    /// Where clients come; port 0: any.
    pub listen: SocketAddr,
    /// The server.
    pub target: SocketAddr,
    /// Of each direction.
    pub impairment: Impairment,
    /// The same seed loses the same datagrams.
    pub seed: u64,
}

/// What became of the datagrams of both directions, all clients together.
#[derive(Clone, Copy, Debug, Default)]
pub struct Figures {
    /// From clients to the server.
    pub up: Carried,
    /// From the server to clients.
    pub down: Carried,
}

/// A running proxy; it ends when this is dropped.
#[derive(Debug)]
pub struct Netsim {
    /// Where it listens.
    pub address: SocketAddr,
    stop: Arc<AtomicBool>,
    figures: Arc<Mutex<Figures>>,
    thread: Option<JoinHandle<()>>,
}

impl Netsim {
    /// Starts it.
    pub fn start(config: NetsimConfig) -> io::Result<Self> {
        let socket = UdpSocket::bind(config.listen)?;
        socket.set_nonblocking(true)?;
        let address = socket.local_addr()?;
        let (stop, figures) = (Arc::<AtomicBool>::default(), Arc::<Mutex<Figures>>::default());
        let mut proxy = Proxy {
            socket,
            config,
            clients: Vec::new(),
            gone: Figures::default(),
            buffer: vec![0; ROOM_BYTES],
            met: 0,
        };
        let (stopped, told) = (Arc::clone(&stop), Arc::clone(&figures));
        let thread =
            std::thread::Builder::new().name("hapticd-netsim".into()).spawn(move || {
                while !stopped.load(Ordering::Relaxed) {
                    proxy.turn();
                    *told.lock().unwrap_or_else(PoisonError::into_inner) = proxy.figures();
                }
            })?;
        Ok(Self { address, stop, figures, thread: Some(thread) })
    }

    /// Until now.
    pub fn figures(&self) -> Figures {
        *self.figures.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Netsim {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic in there was reported by the panic hook; there is nothing to add.
            let _ = thread.join();
        }
    }
}

struct Client {
    address: SocketAddr,
    /// Towards the server, and connected to it.
    socket: UdpSocket,
    up: ImpairedPath<Vec<u8>>,
    down: ImpairedPath<Vec<u8>>,
    heard_ns: u64,
}

struct Proxy {
    socket: UdpSocket,
    config: NetsimConfig,
    clients: Vec<Client>,
    /// Of clients that are forgotten.
    gone: Figures,
    buffer: Vec<u8>,
    /// Clients until now: each has losses of its own.
    met: u64,
}

impl Proxy {
    /// Delivers what is due, waits for what comes, and takes it.
    fn turn(&mut self) {
        let now_ns = now_ns();
        self.deliver(now_ns);
        self.wait(now_ns);
        self.take_up();
        self.take_down();
    }

    fn deliver(&mut self, now_ns: u64) {
        for client in &mut self.clients {
            // What a socket does not take is lost, as on any network.
            while let Some(bytes) = client.up.receive(now_ns) {
                let _ = client.socket.send(&bytes);
            }
            while let Some(bytes) = client.down.receive(now_ns) {
                let _ = self.socket.send_to(&bytes, client.address);
            }
        }
        for gone in self.clients.extract_if(.., |client| client.heard_ns + FORGOTTEN_NS < now_ns) {
            self.gone.up += gone.up.carried();
            self.gone.down += gone.down.carried();
        }
    }

    fn wait(&self, now_ns: u64) {
        let due =
            |client: &Client| client.up.next_ns().into_iter().chain(client.down.next_ns()).min();
        let next_ns = self.clients.iter().filter_map(due).min().unwrap_or(u64::MAX);
        let sleep_ns = next_ns.saturating_sub(now_ns).min(LONGEST_SLEEP_NS);
        let mut watched = vec![PollFd::new(&self.socket, PollFlags::IN)];
        watched.extend(
            self.clients
                .iter()
                .map(|client| PollFd::from_borrowed_fd(client.socket.as_fd(), PollFlags::IN)),
        );
        let sleep = Timespec { tv_sec: 0, tv_nsec: sleep_ns as i64 };
        // Interrupted, it looks a little early.
        let _ = poll(&mut watched, Some(&sleep));
    }

    fn take_up(&mut self) {
        while let Ok((length, from)) = self.socket.recv_from(&mut self.buffer) {
            let now_ns = now_ns();
            let known = self.clients.iter().position(|client| client.address == from);
            let Some(at) = known.or_else(|| self.meet(from)) else { continue };
            let client = &mut self.clients[at];
            client.heard_ns = now_ns;
            client.up.send(self.buffer[..length].to_vec(), now_ns);
        }
    }

    fn take_down(&mut self) {
        for client in &mut self.clients {
            while let Ok(length) = client.socket.recv(&mut self.buffer) {
                client.down.send(self.buffer[..length].to_vec(), now_ns());
            }
        }
    }

    fn meet(&mut self, address: SocketAddr) -> Option<usize> {
        if self.clients.len() >= MOST_CLIENTS {
            return None;
        }
        let NetsimConfig { target, impairment, seed, .. } = self.config;
        let any: SocketAddr =
            if target.is_ipv4() { ([0, 0, 0, 0], 0).into() } else { ([0_u16; 8], 0).into() };
        let connect = || {
            let socket = UdpSocket::bind(any)?;
            socket.connect(target)?;
            socket.set_nonblocking(true)?;
            io::Result::Ok(socket)
        };
        let socket = connect().ok()?;
        let seed = seed.wrapping_add(2 * self.met);
        self.met += 1;
        let path = |seed| ImpairedPath::new(impairment, seed);
        let (up, down) = (path(seed), path(seed.wrapping_add(1)));
        self.clients.push(Client { address, socket, up, down, heard_ns: now_ns() });
        Some(self.clients.len() - 1)
    }

    fn figures(&self) -> Figures {
        self.clients.iter().fold(self.gone, |mut sum, client| {
            sum.up += client.up.carried();
            sum.down += client.down.carried();
            sum
        })
    }
}

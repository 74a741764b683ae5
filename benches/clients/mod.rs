//! Sessions that load a server and count the States they get.
//!
//! Each has a connection and a socket of its own, as separate programs would have. How many
//! share a thread is the caller's choice: a simulator has one to itself.

#![allow(dead_code)] // each bench takes what it needs

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc;
use std::thread::JoinHandle;
use std::time::Duration;

use hapticd::client::{Client, ConnectString, Incoming, Options};
use hapticd::proto::{Contact, HalfSpaceContact, Role, contact};
use tokio::sync::watch;
use tokio::task::LocalSet;
use tokio::time::timeout;

/// A session that is not open by then is not coming.
const PATIENCE: Duration = Duration::from_secs(5);

/// What a session does.
#[derive(Clone, Copy, Debug)]
pub struct Session {
    /// One per server commands; the commands of an observer are read and refused.
    pub role: Role,
    /// Between two States; zero: every tick.
    pub state_interval: Duration,
    /// Every State is answered at once with a Command.
    pub answers: bool,
}

/// Running sessions; they say Bye when this is dropped.
pub struct Crowd {
    target: ConnectString,
    received: Vec<Arc<AtomicU64>>,
    /// Sessions that never opened, or ended before they were told to.
    lost: Arc<AtomicUsize>,
    stop: watch::Sender<bool>,
    threads: Vec<JoinHandle<()>>,
}

impl Crowd {
    /// Nobody yet.
    pub fn new(target: &ConnectString) -> Self {
        Self {
            target: target.clone(),
            received: Vec::new(),
            lost: Arc::default(),
            stop: watch::Sender::new(false),
            threads: Vec::new(),
        }
    }

    /// One more thread with these sessions. Returns when each is open or lost.
    pub fn join(&mut self, sessions: &[Session]) -> anyhow::Result<()> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let mine: Vec<_> =
            sessions.iter().map(|session| (*session, Arc::<AtomicU64>::default())).collect();
        self.received.extend(mine.iter().map(|(_, received)| Arc::clone(received)));
        let (target, stop) = (self.target.clone(), self.stop.subscribe());
        let lost = Arc::clone(&self.lost);
        let (tried, trying) = mpsc::channel();
        self.threads.push(std::thread::spawn(move || {
            let local = LocalSet::new();
            for (session, received) in mine {
                let (target, stop, tried) = (target.clone(), stop.clone(), tried.clone());
                let lost = Arc::clone(&lost);
                local.spawn_local(async move {
                    if live(session, &target, &received, stop, tried).await.is_err() {
                        lost.fetch_add(1, Ordering::Relaxed);
                    }
                });
            }
            drop(tried);
            runtime.block_on(local);
        }));
        for () in trying {}
        Ok(())
    }

    /// States that each got so far.
    pub fn received(&self) -> Vec<u64> {
        self.received.iter().map(|received| received.load(Ordering::Relaxed)).collect()
    }

    /// How many sessions are not there any more, or never were.
    pub fn lost(&self) -> usize {
        self.lost.load(Ordering::Relaxed)
    }
}

impl Drop for Crowd {
    fn drop(&mut self) {
        self.stop.send_replace(true);
        for thread in self.threads.drain(..) {
            // Its panic, if any, has been printed.
            let _ = thread.join();
        }
    }
}

/// One session from Hello to Bye; `tried` goes when it is open.
async fn live(
    session: Session,
    target: &ConnectString,
    received: &AtomicU64,
    mut stop: watch::Receiver<bool>,
    tried: mpsc::Sender<()>,
) -> anyhow::Result<()> {
    let options = Options {
        state_interval: session.state_interval,
        every_state: true,
        ..Options::new("bench", session.role)
    };
    let mut client = timeout(PATIENCE, Client::connect(target, options)).await??;
    drop(tried);
    loop {
        tokio::select! {
            incoming = client.next() => {
                if let Incoming::State(state) = incoming? {
                    received.fetch_add(1, Ordering::Relaxed);
                    if session.answers {
                        client.send_contacts(state.seq, 100, vec![wall()])?;
                    }
                }
            }
            _ = stop.wait_for(|stop| *stop) => break,
        }
    }
    client.close().await;
    Ok(())
}

/// What a controller asks for.
pub fn wall() -> Contact {
    Contact {
        id: 1,
        revision: 1,
        shape: Some(contact::Shape::HalfSpace(HalfSpaceContact {
            point_m: vec![0.3, 0.0, 0.0],
            normal: vec![-1.0, 0.0, 0.0],
        })),
        stiffness_n_per_m: 1e7,
        ..Contact::default()
    }
}

//! What the tests share: a daemon of their own, clients, child processes, HTTP, and patience.
//!
//! Every daemon listens on free ports of loopback and keeps its state in a folder that goes
//! with it. Every wait ends: what does not happen within [`PATIENCE`] fails the test that
//! waits for it. Nothing is judged by how fast it is.

use std::fs::File;
use std::future::Future;
use std::io::{BufRead, BufReader, Read, Seek, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use hapticd::app::{Daemon, Start};
use hapticd::client::{Client, ConnectString, Incoming, Options, Services, services};
use hapticd::config::ServerConfig;
use hapticd::proto::{Contact, HalfSpaceContact, Role, State, contact::Shape};
use rustix::process::{Pid, Signal, kill_process};
use tempfile::TempDir;
use tokio::runtime::Runtime;

/// The longest time that anything may take on a busy machine.
pub const PATIENCE: Duration = Duration::from_secs(45);

/// The usual device's resource name.
pub const DEVICE: &str = "devices/cho-2005";

/// Waits until `happened`; fails if it does not.
pub fn wait_until(what: &str, mut happened: impl FnMut() -> bool) {
    let deadline = Instant::now() + PATIENCE;
    while !happened() {
        assert!(Instant::now() < deadline, "{what} did not happen within {PATIENCE:?}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Waits until `figure` has grown to `least`.
pub fn wait_at_least(what: &str, least: f64, mut figure: impl FnMut() -> f64) {
    wait_until(what, || figure() >= least);
}

/// A daemon in this process, and a runtime for its clients.
pub struct Rig {
    runtime: Runtime,
    daemon: Daemon,
    state: TempDir,
}

impl Rig {
    /// The usual device and hand.
    pub fn start() -> Self {
        Self::with(|_| ())
    }

    /// The usual configuration, changed.
    pub fn with(change: impl FnOnce(&mut ServerConfig)) -> Self {
        let state = tempfile::tempdir().unwrap();
        let mut config = ServerConfig {
            grpc_port: 0,
            stream_port: 0,
            udp_port: 0,
            http_port: 0,
            https_port: 0,
            state_dir: Some(state.path().to_owned()),
            ..ServerConfig::default()
        };
        change(&mut config);
        let daemon = Daemon::start(&config, Start::default()).unwrap();
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .enable_all()
            .build()
            .unwrap();
        Self { runtime, daemon, state }
    }

    /// Runs a client's work to its end.
    pub fn run<T>(&self, work: impl Future<Output = T>) -> T {
        let bounded = async { tokio::time::timeout(PATIENCE, work).await };
        self.runtime.block_on(bounded).expect("what the test waits for does not happen")
    }

    /// Starts a client's work beside the test.
    pub fn spawn<T: Send + 'static>(
        &self,
        work: impl Future<Output = T> + Send + 'static,
    ) -> tokio::task::JoinHandle<T> {
        self.runtime.spawn(work)
    }

    /// How clients reach it.
    pub fn target(&self) -> &ConnectString {
        self.daemon.connect_string()
    }

    /// The daemon itself.
    pub fn daemon(&self) -> &Daemon {
        &self.daemon
    }

    /// Where it keeps its state.
    pub fn state_dir(&self) -> &Path {
        self.state.path()
    }

    /// A session.
    pub async fn client(&self, name: &str, role: Role) -> Client {
        Client::connect(self.target(), Options::new(name, role)).await.unwrap()
    }

    /// The services.
    pub async fn services(&self) -> Services {
        services(self.target()).await.unwrap()
    }

    /// The metrics now.
    pub fn scrape(&self) -> Metrics {
        let (status, text) = http_get(self.daemon.http_address, "/metrics");
        assert_eq!(status, 200);
        Metrics(text)
    }

    /// Waits until a datagram's outcome was counted so often.
    pub fn wait_for_datagrams(&self, outcome: &str, count: f64) {
        wait_until(&format!("datagram {outcome} number {count}"), || {
            self.scrape().datagrams(outcome) >= count
        });
    }

    /// Ends the daemon while the runtime lives on.
    pub fn stop(mut self) -> (Runtime, TempDir) {
        self.daemon.stop();
        (self.runtime, self.state)
    }
}

/// One scrape.
pub struct Metrics(pub String);

impl Metrics {
    /// A sample by its name with all its labels.
    pub fn value(&self, sample: &str) -> f64 {
        let line = self.0.lines().find_map(|line| line.strip_prefix(sample)?.strip_prefix(' '));
        line.unwrap_or_else(|| panic!("no {sample} in\n{}", self.0)).trim().parse().unwrap()
    }

    /// Datagrams received with one outcome.
    pub fn datagrams(&self, outcome: &str) -> f64 {
        let labels = format!(
            "{{device=\"cho-2005\",transport=\"quic\",direction=\"in\",outcome=\"{outcome}\"}}"
        );
        self.value(&format!("hapticd_datagrams_total{labels}"))
    }
}

/// Status and body of a GET.
pub fn http_get(address: SocketAddr, path: &str) -> (u16, String) {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    write!(stream, "GET {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    let (head, body) = answer.split_once("\r\n\r\n").unwrap();
    let status = head.split(' ').nth(1).unwrap().parse().unwrap();
    (status, body.to_owned())
}

/// The next State of a session.
pub async fn next_state(client: &mut Client) -> State {
    loop {
        if let Incoming::State(state) = client.next().await.unwrap() {
            return *state;
        }
    }
}

/// The first State from now on that is as wanted.
pub async fn state_where(client: &mut Client, wanted: impl Fn(&State) -> bool) -> State {
    loop {
        let state = next_state(client).await;
        if wanted(&state) {
            return state;
        }
    }
}

/// Answers every State with these contacts until one is as wanted.
pub async fn command_until(
    client: &mut Client,
    contacts: &[Contact],
    wanted: impl Fn(&State) -> bool,
) -> State {
    loop {
        let state = next_state(client).await;
        if wanted(&state) {
            return state;
        }
        client.send_contacts(state.seq, 100, contacts.to_vec()).unwrap();
    }
}

/// The experiment's wall at `x_m`, felt from the side of smaller x.
pub fn wall_at(x_m: f32) -> Contact {
    let plane = HalfSpaceContact { point_m: vec![x_m, 0.0, 0.0], normal: vec![-1.0, 0.0, 0.0] };
    Contact {
        id: 1,
        revision: 1,
        shape: Some(Shape::HalfSpace(plane)),
        stiffness_n_per_m: 1e7,
        blend_ms: 10,
        ..Contact::default()
    }
}

/// What a command left behind.
#[derive(Debug)]
pub struct Finished {
    /// Exit code; `None` when a signal ended it.
    pub code: Option<i32>,
    /// What it printed.
    pub stdout: String,
    /// What it said.
    pub stderr: String,
}

impl Finished {
    /// Expects success.
    pub fn ok(self) -> Self {
        assert_eq!(self.code, Some(0), "{self:?}");
        self
    }

    /// Expects a refusal that says all of this on stderr.
    pub fn refused(&self, words: &[&str]) {
        assert!(self.code.is_some_and(|code| code != 0), "{self:?}");
        for word in words {
            assert!(self.stderr.contains(word), "{word:?} is not in {self:?}");
        }
    }
}

/// The program.
pub fn hapticd() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hapticd"));
    command.env_remove("HAPTICD_LOG");
    command
}

/// Runs `hapticd` with these arguments to its end.
pub fn run(arguments: &[&str]) -> Finished {
    let mut command = hapticd();
    finish(command.args(arguments))
}

/// Runs a command to its end, or ends it when that takes too long.
pub fn finish(command: &mut Command) -> Finished {
    let (mut stdout, mut stderr) = (tempfile::tempfile().unwrap(), tempfile::tempfile().unwrap());
    command.stdin(Stdio::null()).stdout(stdout.try_clone().unwrap());
    let mut child = command.stderr(stderr.try_clone().unwrap()).spawn().unwrap();
    let status = wait(&mut child);
    Finished { code: status.code(), stdout: text(&mut stdout), stderr: text(&mut stderr) }
}

/// Waits for a child, and kills it when that takes too long.
pub fn wait(child: &mut Child) -> ExitStatus {
    let deadline = Instant::now() + PATIENCE;
    loop {
        if let Some(status) = child.try_wait().unwrap() {
            return status;
        }
        if Instant::now() > deadline {
            child.kill().unwrap();
            return child.wait().unwrap();
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// The first line, waited for no longer than anything else.
pub fn first_line(from: impl Read + Send + 'static) -> Option<String> {
    let (found, line) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        let mut line = String::new();
        let read = BufReader::new(from).read_line(&mut line);
        // Nobody listens any more when it comes too late.
        let _ = found.send(read.map(|_| line));
    });
    line.recv_timeout(PATIENCE).ok()?.ok()
}

fn text(file: &mut File) -> String {
    let mut text = String::new();
    file.rewind().unwrap();
    file.read_to_string(&mut text).unwrap();
    text
}

/// Sends a signal to a child.
pub fn send(child: &Child, signal: Signal) {
    let pid = Pid::from_raw(child.id().try_into().unwrap()).unwrap();
    kill_process(pid, signal).unwrap();
}

/// `hapticd serve` in a process of its own.
pub struct Server {
    child: Child,
    stderr: File,
    /// What it printed.
    pub connect: ConnectString,
}

impl Server {
    /// Serves with its state in `state`; returns when it has printed where it is.
    pub fn start(state: &Path) -> Self {
        Self::with(state, "")
    }

    /// The same with these lines at the top of its configuration.
    pub fn with(state: &Path, top: &str) -> Self {
        let stderr = tempfile::tempfile().unwrap();
        let mut command = hapticd();
        command.args(["serve", "--config"]).arg(config_file(state, top));
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(stderr.try_clone().unwrap());
        let mut child = command.spawn().unwrap();
        let printed = first_line(child.stdout.take().unwrap());
        let mut server = Self { child, stderr, connect: ConnectString::local(0, 0) };
        let line = printed.unwrap_or_else(|| panic!("silent: {}", text(&mut server.stderr)));
        let connect = line.trim_end().parse();
        server.connect =
            connect.unwrap_or_else(|error| panic!("{error}: {}", text(&mut server.stderr)));
        server
    }

    /// `kill -9`.
    pub fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Keeps all of it from running for a while.
    pub fn stall(&self, how_long: Duration) {
        send(&self.child, Signal::STOP);
        std::thread::sleep(how_long);
        send(&self.child, Signal::CONT);
    }

    /// Sends a signal and waits for the end; the exit code and what was logged.
    pub fn end_by(mut self, signal: Signal) -> (Option<i32>, String) {
        send(&self.child, signal);
        let status = wait(&mut self.child);
        (status.code(), text(&mut self.stderr))
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // Both fail when it has ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A configuration file beside `state` that keeps state there and takes free ports; `top`
/// goes before the first table.
pub fn config_file(state: &Path, top: &str) -> PathBuf {
    let path = state.with_extension("toml");
    let ports =
        "[server]\ngrpc_port = 0\nstream_port = 0\nudp_port = 0\nhttp_port = 0\nhttps_port = 0\n";
    std::fs::write(&path, format!("state_dir = {state:?}\n{top}{ports}")).unwrap();
    path
}

//! `hapticd pair` and `hapticd audit`, as people type them.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use hapticd::client::ConnectString;
use hapticd::credentials::{Denied, Grant, Holder, Keyring};
use hapticd::utc::Utc;
use serde_json::Value;

use super::support::{Finished, Server, finish, hapticd, run};

/// A state directory that is not there yet.
struct Place {
    folder: tempfile::TempDir,
    state: PathBuf,
}

impl Place {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let state = folder.path().join("state");
        Self { folder, state }
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    /// A command on that state directory.
    fn run(&self, arguments: &[&str]) -> Finished {
        run(&[arguments, &["--state-dir", self.state.to_str().unwrap()]].concat())
    }

    fn json(&self, arguments: &[&str]) -> Value {
        let finished = self.run(&[arguments, &["--json"]].concat()).ok();
        serde_json::from_str(&finished.stdout)
            .unwrap_or_else(|error| panic!("{error}: {finished:?}"))
    }

    fn judge(&self, token: &str) -> Result<Holder, Denied> {
        Keyring::open(&self.state).unwrap().judge(token, Utc::now())
    }

    fn file(&self) -> PathBuf {
        self.state.join("credentials.toml")
    }
}

/// The connect string that was printed, and its token.
fn connect(finished: &Finished) -> (ConnectString, String) {
    assert_eq!(finished.stdout.lines().count(), 1, "{finished:?}");
    let connect: ConnectString = finished.stdout.trim_end().parse().unwrap();
    let token = connect.token.clone().unwrap();
    (connect, token)
}

fn mode(path: &Path) -> u32 {
    fs::metadata(path).unwrap().permissions().mode() & 0o777
}

#[test]
fn what_pair_prints_lets_its_holder_in_until_it_is_revoked() {
    let place = Place::new();
    let paired = place.run(&["pair", "anna", "--role", "controller"]).ok();
    let (string, token) = connect(&paired);
    assert_eq!(
        (string.host.as_str(), string.stream_port, string.grpc_port),
        ("127.0.0.1", 7351, 7350)
    );
    assert!(paired.stderr.contains("server.listen = 127.0.0.1"), "works only here: {paired:?}");
    assert!(!paired.stderr.contains(&token), "{paired:?}");
    let anna = Holder { name: "anna".into(), grant: Grant::Controller, device: None };
    assert_eq!(place.judge(&token), Ok(anna));
    assert_eq!(mode(&place.file()), 0o600);
    assert!(!fs::read_to_string(place.file()).unwrap().contains(&token), "only its hash is kept");

    let bob = ["pair", "bob", "--role", "observer", "--device", "cho-2005", "--days", "30"];
    let bob = place.json(&bob);
    assert!(bob["connect"].as_str().unwrap().starts_with("hapticd://127.0.0.1:7351/?sha256="));
    let listed = place.run(&["pair", "--list"]).ok().stdout;
    let rows: Vec<Vec<_>> = listed.lines().map(|line| line.split_whitespace().collect()).collect();
    assert_eq!(
        (rows.len(), &rows[0][..2], &rows[1][..3]),
        (2, &["anna", "controller"][..], &["bob", "observer", "devices/cho-2005"][..]),
        "{listed}"
    );
    let list = place.json(&["pair", "--list"]);
    assert_eq!(
        (&list[0]["expires"], &list[1]["device"]),
        (&Value::Null, &"devices/cho-2005".into())
    );
    let moment = |value: &Value| value.as_str().unwrap().parse::<Utc>().unwrap().ms();
    assert_eq!(moment(&list[1]["expires"]) - moment(&list[1]["issued"]), 30 * 86_400_000);
    assert!(!list.to_string().contains(&token) && !listed.contains(&token));

    assert_eq!(place.run(&["pair", "--revoke", "anna"]).ok().stdout, "anna revoked\n");
    assert_eq!(place.judge(&token), Err(Denied::Unknown));
    assert_eq!(place.json(&["pair", "--list"]).as_array().unwrap().len(), 1);
    place.run(&["pair", "--revoke", "anna"]).refused(&["name = anna", "there are: bob"]);
}

#[test]
fn the_audit_log_tells_who_was_let_in_and_never_a_secret() {
    let place = Place::new();
    let nothing = place.run(&["audit"]).ok().stdout;
    assert!(nothing.starts_with("nothing is recorded in "), "{nothing}");
    assert_eq!(place.run(&["audit", "--json"]).ok().stdout, "");
    assert!(!place.state.exists(), "to look changes nothing");
    let (_, token) = connect(&place.run(&["pair", "anna", "--role", "operator"]).ok());
    place.run(&["pair", "--revoke", "anna"]).ok();
    let lines = place.run(&["audit", "--json"]).ok().stdout;
    let lines: Vec<Value> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let deeds: Vec<_> = lines.iter().map(|line| line["what"].as_str().unwrap()).collect();
    assert_eq!(deeds, ["credential_issued", "credential_revoked"]);
    for line in &lines {
        assert_eq!(line["who"], "local");
        assert_eq!(line["detail"], "anna: operator of all devices, until it is revoked");
        assert!(line["time"].as_str().unwrap().parse::<Utc>().is_ok());
    }
    let shown = place.run(&["audit", "--lines", "1"]).ok().stdout;
    assert!(shown.contains("credential_revoked") && shown.lines().count() == 1, "{shown}");
    let log = fs::read_to_string(place.state.join("audit.jsonl")).unwrap();
    assert!(!log.contains(&token), "{log}");
    assert_eq!(mode(&place.state.join("audit.jsonl")), 0o600);
    for lines in ["0", "-1", "100001", "many"] {
        place.run(&["audit", "--lines", lines]).refused(&["--lines", lines]);
    }
}

#[test]
fn a_bad_input_is_refused_by_name_value_and_range_before_anything_is_made() {
    let place = Place::new();
    let fixed = ["pair", "anna", "--role", "controller"];
    let refused = |more: &[&str], words: &[&str]| {
        place.run(&[&fixed, more].concat()).refused(words);
        assert!(!place.state.exists(), "{more:?}");
    };
    for days in ["0", "-1", "3651"] {
        refused(&["--days", days], &[&format!("--days = {days}"), "1 to 3650 days"]);
    }
    refused(&["--days", "soon"], &["--days", "soon"]);
    refused(&["--device", "../x"], &["--device = \"../x\"", "must be 1 to 63 of"]);
    for host in
        ["", "a b", "lab:7351", "a/b", "a?token=x", "user@lab", "a#b", "[::1]:7", "::g", "-a", "é"]
    {
        refused(&["--host", host], &["--host = ", "must be a host name or an IP address"]);
    }
    refused(&["--config", "missing.toml"], &["missing.toml"]);
    let ports = place.path("ports.toml");
    fs::write(&ports, "[server]\ngrpc_port = 0\n").unwrap();
    refused(&["--config", &ports], &["server.grpc_port = 0", "1 to 65535"]);

    for (name, shown) in
        [("a/b", "\"a/b\""), ("..", "\"..\""), ("local", "\"local\""), ("", "\"\"")]
    {
        let words = [&format!("NAME = {shown}"), "must be 1 to 64 of"];
        place.run(&["pair", name, "--role", "observer"]).refused(&words);
    }
    place.run(&["pair", "anna", "--role", "root"]).refused(&["--role", "\"root\"", "\"operator\""]);
    place.run(&["pair", "anna"]).refused(&["--role"]);
    place.run(&["pair"]).refused(&["NAME"]);
    place.run(&["pair", "--list", "--revoke", "anna"]).refused(&["--list"]);
    place.run(&["pair", "anna", "--list"]).refused(&["--list"]);
    place.run(&["pair", "--revoke", "a b"]).refused(&["--revoke = \"a b\""]);
    assert!(!place.state.exists());
}

#[test]
fn a_name_is_taken_until_it_is_replaced() {
    let place = Place::new();
    let (_, first) = connect(&place.run(&["pair", "anna", "--role", "observer"]).ok());
    let svg = place.path("anna.svg");
    let again = ["pair", "anna", "--role", "operator", "--svg", &svg];
    place.run(&again).refused(&["name = anna", "observer", "--replace"]);
    assert!(place.judge(&first).is_ok() && !Path::new(&svg).exists());
    let replaced = place.run(&[&again[..], &["--replace"]].concat()).ok();
    let (_, second) = connect(&replaced);
    assert_eq!(place.judge(&first), Err(Denied::Unknown));
    assert_eq!(place.judge(&second).unwrap().grant, Grant::Operator);
}

#[test]
fn a_file_that_cannot_be_understood_is_named_and_left_as_it_is() {
    let place = Place::new();
    place.run(&["pair", "anna", "--role", "observer"]).ok();
    let broken = fs::read_to_string(place.file()).unwrap().replace("observer", "everything");
    fs::write(place.file(), &broken).unwrap();
    let path = place.file().to_str().unwrap().to_owned();
    for arguments in [
        &["pair", "bob", "--role", "observer"][..],
        &["pair", "--list"],
        &["pair", "--revoke", "anna"],
    ] {
        let words = [path.as_str(), "credential[0].role = \"everything\": must be \"observer\""];
        place.run(arguments).refused(&words);
        assert_eq!(fs::read_to_string(place.file()).unwrap(), broken);
    }
}

#[test]
fn commands_at_the_same_time_lose_nothing_of_each_other() {
    let place = Place::new();
    let names: Vec<_> = (0..8).map(|i| format!("c{i}")).collect();
    std::thread::scope(|scope| {
        for name in &names {
            scope.spawn(|| place.run(&["pair", name, "--role", "observer"]).ok());
        }
    });
    let list = place.json(&["pair", "--list"]);
    let mut listed: Vec<_> =
        list.as_array().unwrap().iter().map(|entry| entry["name"].as_str().unwrap()).collect();
    listed.sort_unstable();
    assert_eq!(listed, names);
}

/// The state directory is locked by the server, and its identity is the one in the string.
#[test]
fn beside_a_running_server_the_string_leads_to_that_server() {
    let place = Place::new();
    let server = Server::start(&place.state);
    let paired = place.run(&["pair", "anna", "--role", "observer", "--host", "lab.example"]).ok();
    let (string, token) = connect(&paired);
    assert_eq!((string.host.as_str(), string.sha256), ("lab.example", server.connect.sha256));
    assert!(place.judge(&token).is_ok());
}

#[test]
fn where_the_server_listens_is_where_the_string_leads() {
    let place = Place::new();
    let config = place.path("hapticd.toml");
    let with = |listen: &str, more: &[&str]| {
        let ports = "insecure = true\ngrpc_port = 7450\nstream_port = 7451\nudp_port = 7452\n";
        fs::write(&config, format!("[server]\nlisten = \"{listen}\"\n{ports}")).unwrap();
        let pair = ["pair", "anna", "--role", "observer", "--replace", "--config", &config];
        let paired = place.run(&[&pair, more].concat()).ok();
        assert!(!paired.stderr.contains("server.listen"), "others reach it: {paired:?}");
        paired.stdout
    };
    assert!(with("192.0.2.9", &[]).starts_with("hapticd://192.0.2.9:7451/?sha256="));
    let (usual, _) = connect(&place.run(&["pair", "carl", "--role", "observer"]).ok());
    let everywhere: ConnectString = with("0.0.0.0", &[]).trim_end().parse().unwrap();
    assert!(!everywhere.is_loopback() && everywhere.host != "0.0.0.0", "{}", everywhere.host);
    assert_eq!((everywhere.stream_port, everywhere.grpc_port), (7451, 7450));
    assert_eq!((everywhere.udp_port, usual.udp_port), (Some(7452), None));
    for six in ["2001:db8::1", "[2001:db8::1]"] {
        let said = with("::", &["--host", six]);
        assert!(said.starts_with("hapticd://[2001:db8::1]:7451/"), "{said}");
    }
    let other = ["pair", "bob", "--role", "observer", "--device", "right", "--json"];
    let warned = place.run(&other).ok().stderr;
    assert!(
        warned.contains("--device = devices/right: as configured, the server has devices/cho-2005")
    );
}

/// Dark modules of the half blocks on stderr, row by row.
fn drawn(stderr: &str) -> Vec<Vec<bool>> {
    let blocks = ['\u{2588}', '\u{2580}', '\u{2584}', ' '];
    let of_code =
        |line: &&str| line.chars().count() > 20 && line.chars().all(|c| blocks.contains(&c));
    let mut rows: Vec<Vec<bool>> = Vec::new();
    for line in stderr.lines().filter(of_code) {
        let halves = |light: char| line.chars().map(|c| c != '\u{2588}' && c != light).collect();
        rows.extend([halves('\u{2580}'), halves('\u{2584}')]);
    }
    rows.truncate(rows[0].len());
    rows
}

/// Dark modules of the only path of an SVG.
fn painted(svg: &str) -> Vec<Vec<bool>> {
    let between = |from: &str, to: &str| svg.split_once(from).unwrap().1.split_once(to).unwrap().0;
    let size = between("viewBox=\"0 0 ", " ").parse().unwrap();
    let mut rows = vec![vec![false; size]; size];
    for run in between(" d=\"", "\"").split_terminator('z') {
        let (x, rest) = run.trim_start_matches('M').split_once(' ').unwrap();
        let (y, rest) = rest.split_once('h').unwrap();
        let (x, y): (usize, usize) = (x.parse().unwrap(), y.parse().unwrap());
        let length: usize = rest.split_once('v').unwrap().0.parse().unwrap();
        rows[y][x..x + length].fill(true);
    }
    rows
}

/// What another program reads in a code.
fn read(rows: &[Vec<bool>]) -> String {
    let (edge, scale) = (rows.len(), 3);
    let pixel = |x: usize, y: usize| if rows[y / scale][x / scale] { 0 } else { 255 };
    let mut picture =
        rqrr::PreparedImage::prepare_from_greyscale(edge * scale, edge * scale, pixel);
    picture.detect_grids().first().expect("a code").decode().unwrap().1
}

#[test]
fn the_codes_say_what_the_line_says() {
    let place = Place::new();
    let svg = place.path("anna.svg");
    let pair = ["pair", "anna", "--role", "observer", "--qr", "--svg", &svg];
    let paired = place.run(&pair).ok();
    let line = paired.stdout.trim_end();
    assert_eq!(read(&drawn(&paired.stderr)), line);
    assert_eq!(read(&painted(&fs::read_to_string(&svg).unwrap())), line);
    assert_eq!(mode(Path::new(&svg)), 0o600, "it is as secret as the line");
    let other = ["pair", "bob", "--role", "observer", "--svg", &svg];
    place.run(&other).refused(&["--svg", "anna.svg"]);
    assert_eq!(place.json(&["pair", "--list"]).as_array().unwrap().len(), 1);
    let silent = place.run(&["pair", "carl", "--role", "observer"]).ok().stderr;
    assert!(!silent.contains('\u{2588}'), "no terminal, no code");
}

/// Whoever reads the first line and goes away has it; a terminal that is closed is no panic.
#[test]
fn a_reader_that_goes_away_is_no_error() {
    let place = Place::new();
    let mut command = hapticd();
    command.args(["pair", "anna", "--role", "observer", "--state-dir"]).arg(&place.state);
    let mut shell = std::process::Command::new("sh");
    let program = command.get_program().to_str().unwrap();
    let arguments: Vec<_> = command.get_args().map(|word| word.to_str().unwrap()).collect();
    shell.arg("-c").arg(format!("{program} {} | true", arguments.join(" ")));
    let ended = finish(&mut shell).ok();
    assert!(!ended.stderr.contains("panicked"), "{ended:?}");
}

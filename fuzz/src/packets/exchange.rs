//! Two ends of sealed UDP and a network that loses, repeats, delays, changes and moves.
//!
//! Beside them stands a model that knows what was sealed, what was opened and which cookie was
//! given where. From it follows for each packet what the server makes of it.

use std::collections::BTreeMap;

use super::{ID, Numbers, TICKET, at, both, server};
use crate::associations::{Associations, Heard};
use crate::script::Script;
use crate::sealed::{Kind, MAX_BODY_BYTES, MAX_PACKET_BYTES, Messages, Opener, Sealer};
use crate::session::SessionId;

const MS: u64 = 1_000_000;

/// Steps of one input.
const MOST_STEPS: usize = 400;

/// Packets that the network has and may deliver, more than once.
const KEPT: usize = 24;

/// Where the client may be.
const PORTS: usize = 3;

/// A server waits so long for a client to come.
const AWAITED_NS: u64 = 10_000 * MS;

/// In this many rounds a network of good will delivers all that can wait.
const ROUNDS: u64 = 200;

const KINDS: [Kind; 5] = [Kind::Here, Kind::Challenge, Kind::Datagram, Kind::Message, Kind::Taken];

/// What happened in a script.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Seen {
    /// The client has shown its cookie, and its session was joined.
    pub joined: bool,
    /// Datagrams that were opened, both ways.
    pub datagrams: u64,
    /// Messages that were heard, both ways.
    pub messages: u64,
}

#[derive(Clone, Debug)]
struct Packet {
    up: bool,
    kind: Kind,
    /// Unknown of what the server has sealed by itself.
    body: Option<Vec<u8>>,
    bytes: Vec<u8>,
    /// Where the server has sent it.
    to: u16,
}

impl Packet {
    fn number(&self) -> u64 {
        u64::from_be_bytes(self.bytes[9..17].try_into().expect("8 bytes"))
    }
}

struct Client {
    sealer: Sealer,
    opener: Opener,
    messages: Messages,
    cookie: Vec<u8>,
    port: u16,
}

/// What must come of it.
#[derive(Default)]
struct Model {
    by_server: Numbers,
    by_client: Numbers,
    /// Those that the client was told, and where.
    cookies: BTreeMap<u16, Vec<u8>>,
    address: Option<u16>,
    joined: bool,
    gone: bool,
    /// Number of the last message that the server heard.
    heard: u32,
    said: [Vec<Vec<u8>>; 2],
    heard_of: [Vec<Vec<u8>>; 2],
    /// The client has made messages or acknowledgements of its own.
    crafty: bool,
    ended: bool,
}

/// What the server makes of a packet.
#[derive(Debug, PartialEq)]
enum Expected {
    Nothing,
    /// Nothing, or a challenge where the packet has paid for it.
    Challenge,
    Arrived,
    Datagram,
    Message,
    Taken,
}

impl Model {
    fn expect(&mut self, packet: &Packet, from: u16) -> Expected {
        let body = packet.body.as_deref().unwrap_or_default();
        if self.gone || !packet.up || !self.by_server.offer(packet.number()) {
            return Expected::Nothing;
        }
        if self.address != Some(from) {
            let cookie = self.cookies.get(&from);
            if packet.kind != Kind::Here || cookie.is_none_or(|cookie| cookie != body) {
                return Expected::Challenge;
            }
            self.address = Some(from);
        }
        match (packet.kind, self.joined) {
            (Kind::Here, false) => Expected::Arrived,
            (Kind::Datagram, true) => Expected::Datagram,
            (Kind::Message, true) if body.len() < 4 => Expected::Nothing,
            (Kind::Message, true) if body[..4] == (self.heard + 1).to_be_bytes() => {
                self.heard += 1;
                Expected::Message
            }
            (Kind::Message, true) => Expected::Taken,
            _ => Expected::Nothing,
        }
    }
}

struct Exchange {
    table: Associations,
    session: SessionId,
    client: Client,
    network: Vec<Packet>,
    model: Model,
    opened_ns: u64,
    now_ns: u64,
    seen: Seen,
}

/// A script of what both ends do and what the network does to them.
pub fn run(data: &[u8]) -> Seen {
    let script = &mut Script::new(data);
    let mut exchange = Exchange::new(script);
    let mut steps = 0;
    while !script.is_over() && steps < MOST_STEPS {
        exchange.step(script);
        steps += 1;
    }
    exchange.end();
    exchange.seen
}

impl Exchange {
    fn new(script: &mut Script<'_>) -> Self {
        let now_ns = u64::from(script.u32()) << script.below(30);
        let [(sealer, opener), _] = both();
        let messages = Messages::default();
        Self {
            table: server(now_ns),
            session: SessionId::parse("sessions/5").expect("a name"),
            client: Client { sealer, opener, messages, cookie: vec![0; 32], port: 0 },
            network: Vec::new(),
            model: Model::default(),
            opened_ns: now_ns,
            now_ns,
            seen: Seen::default(),
        }
    }

    fn step(&mut self, script: &mut Script<'_>) {
        match script.below(20) {
            0 => self.knock(),
            1 => {
                let body = body(script);
                self.seal(Kind::Datagram, &body);
            }
            2 => self.client_says(&body(script), script),
            3 => self.client_repeats(),
            4 => self.craft(script),
            5 => self.stream(&body(script)),
            6 => self.server_says(&body(script), script),
            7 => self.server_repeats(),
            8..=14 => self.deliver(script),
            15 | 16 => self.deliver_changed(script),
            17 => {
                let ms = script.one_of(&[1, 4, 5, 6, 49, 50, 51, 250, 1_000, 10_000]);
                self.now_ns += ms * MS;
            }
            18 => self.client.port = script.below(PORTS) as u16,
            _ if script.rarely(4) => {
                self.table.end(self.session, self.now_ns);
                self.model.ended |= self.model.joined;
            }
            _ => {}
        }
    }

    /// A packet of the client comes onto the network.
    fn seal(&mut self, kind: Kind, body: &[u8]) {
        let sealed = self.client.sealer.seal(kind, body);
        assert_eq!(sealed.is_none(), body.len() > MAX_BODY_BYTES, "{} bytes", body.len());
        let Some(bytes) = sealed else { return };
        assert!(bytes.len() <= MAX_PACKET_BYTES);
        self.carry(Packet { up: true, kind, body: Some(body.to_vec()), bytes, to: 0 });
    }

    fn carry(&mut self, packet: Packet) {
        if self.network.len() >= KEPT {
            self.network.remove(0);
        }
        self.network.push(packet);
    }

    fn knock(&mut self) {
        let cookie = self.client.cookie.clone();
        self.seal(Kind::Here, &cookie);
    }

    fn client_says(&mut self, message: &[u8], script: &mut Script<'_>) {
        for _ in 0..times(script) {
            if self.client.messages.say(message) {
                self.model.said[0].push(message.to_vec());
            }
        }
    }

    fn client_repeats(&mut self) {
        let due: Vec<_> = self.client.messages.due(self.now_ns).map(<[u8]>::to_vec).collect();
        due.iter().for_each(|body| self.seal(Kind::Message, body));
    }

    /// A client that holds to nothing but its key.
    fn craft(&mut self, script: &mut Script<'_>) {
        let kind = script.one_of(&KINDS);
        let mut body = body(script);
        if script.rarely(2) {
            let next = self.model.heard.wrapping_add(u32::from(script.u8() % 3));
            body.splice(0..0, next.to_be_bytes());
        }
        self.model.crafty |= matches!(kind, Kind::Message | Kind::Taken);
        self.seal(kind, &body);
    }

    fn stream(&mut self, body: &[u8]) {
        let sealed = self.table.seal(self.session, body);
        let may = self.model.joined && !self.model.gone && body.len() <= MAX_BODY_BYTES;
        assert_eq!(sealed.is_some(), may, "a stream for who has shown a cookie");
        let Some((bytes, to)) = sealed else { return };
        assert_eq!(Some(to.port()), self.model.address, "and to where it has shown it");
        let (kind, body, to) = (Kind::Datagram, Some(body.to_vec()), to.port());
        self.carry(Packet { up: false, kind, body, bytes, to });
    }

    fn server_says(&mut self, message: &[u8], script: &mut Script<'_>) {
        for _ in 0..times(script) {
            if self.table.say(self.session, message) {
                assert!(self.model.joined && !self.model.gone);
                self.model.said[1].push(message.to_vec());
            }
        }
    }

    fn server_repeats(&mut self) {
        for (bytes, to) in self.table.due(self.now_ns) {
            assert_eq!(Some(to.port()), self.model.address, "where the cookie was shown");
            let kind = Kind::Message;
            self.carry(Packet { up: false, kind, body: None, bytes, to: to.port() });
        }
        let model = &mut self.model;
        let late = self.now_ns >= self.opened_ns + AWAITED_NS;
        assert!(
            !self.table.is_empty() || !model.joined || model.ended,
            "it lives with its session"
        );
        model.gone |= if model.joined { self.table.is_empty() } else { late };
    }

    fn deliver(&mut self, script: &mut Script<'_>) {
        if self.network.is_empty() {
            return;
        }
        // The newest first: a script of zeros is a network without a fault.
        let place = self.network.len() - 1 - script.below(self.network.len());
        let packet = self.network[place].clone();
        let from = if script.rarely(8) { script.below(PORTS) as u16 } else { self.client.port };
        if !script.rarely(4) {
            self.network.remove(place);
        }
        if packet.up { self.server_hears(&packet, from) } else { self.client_hears(&packet) }
    }

    /// Changed, cut, lengthened or turned round it comes to nothing, whoever hears it.
    fn deliver_changed(&mut self, script: &mut Script<'_>) {
        if self.network.is_empty() {
            return;
        }
        let packet = &self.network[script.below(self.network.len())];
        let mut bytes = packet.bytes.clone();
        let at_byte = usize::from(script.u16()) % bytes.len();
        match script.below(4) {
            0 => bytes.truncate(at_byte),
            1 => bytes.extend_from_slice(&[0; 3][..1 + script.below(3)]),
            2 => bytes[0] ^= 0xa1 ^ 0xa2,
            _ => bytes[at_byte] ^= 1 << script.below(8),
        }
        let from = at(script.below(PORTS) as u16);
        assert!(self.client.opener.open(&mut bytes.clone()).is_err());
        let heard = self.table.on_packet(&mut bytes, from, self.now_ns);
        assert!(matches!(heard, Heard::Nothing | Heard::Unsealed(_)), "{heard:?}");
    }

    fn server_hears(&mut self, packet: &Packet, from: u16) {
        let expected = self.model.expect(packet, from);
        let asked = packet.body.as_deref().unwrap_or_default();
        let mut bytes = packet.bytes.clone();
        let most = bytes.len();
        let answer = match self.table.on_packet(&mut bytes, at(from), self.now_ns) {
            Heard::Nothing | Heard::Unsealed(_) => {
                let silent = [Expected::Nothing, Expected::Challenge];
                assert!(silent.contains(&expected), "{expected:?} of {packet:?}");
                None
            }
            Heard::Answer(answer) => match expected {
                Expected::Challenge => Some((Kind::Challenge, None, answer)),
                Expected::Taken => Some((Kind::Taken, Some(self.model.heard), answer)),
                _ => panic!("an answer, not {expected:?}, to {packet:?}"),
            },
            Heard::Arrived { association, ticket } => {
                assert_eq!((expected, association, ticket), (Expected::Arrived, ID, TICKET));
                self.table.join(ID, self.session);
                (self.model.joined, self.seen.joined) = (true, true);
                None
            }
            Heard::Datagram { session, body } => {
                assert_eq!((expected, session, body), (Expected::Datagram, self.session, asked));
                self.seen.datagrams += 1;
                None
            }
            Heard::Message { session, frame, answer } => {
                let heard = (expected, session, frame);
                assert_eq!(heard, (Expected::Message, self.session, &asked[4..]));
                self.model.heard_of[0].push(frame.to_vec());
                self.seen.messages += 1;
                Some((Kind::Taken, Some(self.model.heard), answer))
            }
        };
        if let Some((kind, number, bytes)) = answer {
            assert!(bytes.len() <= most, "{} bytes for {most}", bytes.len());
            let body = number.map(|number| number.to_be_bytes().to_vec());
            self.carry(Packet { up: false, kind, body, bytes, to: from });
        }
        self.check_heard(0);
    }

    fn client_hears(&mut self, packet: &Packet) {
        let new = self.model.by_client.offer(packet.number());
        let mut bytes = packet.bytes.clone();
        let opened = self.client.opener.open(&mut bytes);
        assert_eq!(opened.is_ok(), new, "each is opened once: {opened:?}");
        let Ok((kind, body)) = opened else { return };
        assert_eq!(kind, packet.kind);
        assert!(packet.body.as_deref().is_none_or(|sealed| sealed == body));
        match kind {
            Kind::Challenge => {
                assert_eq!(body.len(), 32);
                let known = self.model.cookies.insert(packet.to, body.to_vec());
                assert!(known.is_none_or(|known| known == body), "one cookie of one address");
                self.client.cookie = body.to_vec();
            }
            Kind::Datagram => self.seen.datagrams += 1,
            Kind::Message => {
                let (taken, message) = self.client.messages.on_message(body);
                self.model.heard_of[1].extend(message.map(<[u8]>::to_vec));
                self.seen.messages += u64::from(message.is_some());
                self.seal(Kind::Taken, &taken);
            }
            Kind::Taken => self.client.messages.on_taken(body),
            Kind::Here => panic!("a server that says it is here"),
        }
        self.check_heard(1);
    }

    /// What was heard is what was said, in order and nothing twice.
    fn check_heard(&self, by: usize) {
        let (said, heard) = (&self.model.said[by], &self.model.heard_of[by]);
        assert!(self.model.crafty || said.starts_with(heard), "{heard:?} of {said:?}");
    }

    /// Over a network of good will all that was said is heard.
    fn end(&mut self) {
        let late = self.now_ns + 1_000 * MS > self.opened_ns + AWAITED_NS;
        let over = self.model.ended || self.model.gone || (late && !self.model.joined);
        if self.model.crafty || over {
            return;
        }
        self.network.clear();
        for _ in 0..ROUNDS {
            self.now_ns += 50 * MS;
            self.knock();
            self.client_repeats();
            self.server_repeats();
            while !self.network.is_empty() {
                let packet = self.network.remove(0);
                let from = self.client.port;
                if packet.up {
                    self.server_hears(&packet, from)
                } else {
                    self.client_hears(&packet)
                }
            }
        }
        assert_eq!(self.model.heard_of, self.model.said, "all was heard");
        assert!(self.client.messages.is_done());
    }
}

/// Mostly short, now and then near the longest.
fn body(script: &mut Script<'_>) -> Vec<u8> {
    let mut body = {
        let count = script.below(40);
        script.bytes(count).to_vec()
    };
    if script.rarely(12) {
        body.resize(MAX_BODY_BYTES - 8 + script.below(16), 7);
    }
    body
}

fn times(script: &mut Script<'_>) -> usize {
    if script.rarely(40) { 300 } else { 1 }
}

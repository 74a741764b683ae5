//! The server's ends of sealed UDP, without a socket: who may speak, from where, and what is
//! still to be said to whom.
//!
//! ```text
//!  opened by a call ──Here──▶ Challenge ──Here with the cookie──▶ bound to an address, joined
//! ```
//!
//! Nothing is streamed to an address before a cookie has come back from it, and no answer is
//! longer than what asked for it: a spoofed address gets nothing that it did not pay for. What is
//! not sealed with an association's key is dropped after a look into a table. An association whose
//! client moves to another address is challenged there, and streamed to at the old one until the
//! cookie has come from the new.

use std::collections::HashMap;
use std::net::SocketAddr;

use ring::hmac;

use crate::sealed::{
    AssociationId, Direction, Kind, Messages, Opener, Sealer, Secret, Unsealed, association_of,
    ends,
};
use crate::session::{SessionId, Ticket};

/// Associations at a time, those that nobody came for included.
const MOST: usize = 1_200;

/// Time for a client to come after the call that opened its association.
const AWAITED_NS: u64 = 10_000_000_000;

/// Time for the last messages to be taken.
const FAREWELL_NS: u64 = 250_000_000;

/// Between two challenges of one association.
const CHALLENGE_NS: u64 = 5_000_000;

/// Why no association was opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("sealed UDP: {MOST} associations are open, and no more are possible")]
pub struct TooManyAssociations;

/// What a packet came to.
#[derive(Debug, PartialEq)]
pub enum Heard<'a> {
    /// Nothing that is to be answered or acted on.
    Nothing,
    /// Not sealed as it should be; `None`: of no association that is open.
    Unsealed(Option<Unsealed>),
    /// Send this to where the packet came from.
    Answer(Vec<u8>),
    /// The client has shown that it is where it says: its session can be joined with this.
    Arrived { association: AssociationId, ticket: Ticket },
    /// A datagram of this session.
    Datagram { session: SessionId, body: &'a [u8] },
    /// A frame of the reliable stream of this session, and its acknowledgement.
    Message { session: SessionId, frame: &'a [u8], answer: Vec<u8> },
}

#[derive(Debug)]
struct Association {
    sealer: Sealer,
    opener: Opener,
    messages: Messages,
    ticket: Ticket,
    session: Option<SessionId>,
    /// Where it was shown to receive.
    address: Option<SocketAddr>,
    challenged_ns: Option<u64>,
    /// It goes then, or when its last message was taken.
    ends_ns: Option<u64>,
}

/// All associations of a server.
pub struct Associations {
    open: HashMap<AssociationId, Association>,
    by_session: HashMap<SessionId, AssociationId>,
    cookies: hmac::Key,
}

impl Associations {
    /// None yet; cookies are made with this.
    pub fn new(secret: &Secret) -> Self {
        let cookies = hmac::Key::new(hmac::HMAC_SHA256, secret);
        Self { open: HashMap::new(), by_session: HashMap::new(), cookies }
    }

    /// One more, for a client that is to join with this ticket.
    pub fn open(
        &mut self,
        id: AssociationId,
        secret: &Secret,
        ticket: Ticket,
        now_ns: u64,
    ) -> Result<(), TooManyAssociations> {
        if self.open.len() >= MOST {
            return Err(TooManyAssociations);
        }
        let (sealer, opener) = ends(secret, id, Direction::Down);
        let association = Association {
            sealer,
            opener,
            messages: Messages::default(),
            ticket,
            session: None,
            address: None,
            challenged_ns: None,
            ends_ns: Some(now_ns + AWAITED_NS),
        };
        self.open.insert(id, association);
        Ok(())
    }

    /// Nobody is to come for it after all.
    pub fn forget(&mut self, id: AssociationId) {
        self.open.remove(&id);
    }

    /// A packet came; it is decrypted where it lies.
    pub fn on_packet<'a>(
        &mut self,
        packet: &'a mut [u8],
        from: SocketAddr,
        now_ns: u64,
    ) -> Heard<'a> {
        let id = association_of(packet, Direction::Up);
        let open = id.and_then(|id| Some((id, self.open.get_mut(&id)?)));
        let Some((id, association)) = open else { return Heard::Unsealed(None) };
        let length = packet.len();
        let (kind, body) = match association.opener.open(packet) {
            Ok(opened) => opened,
            Err(unsealed) => return Heard::Unsealed(Some(unsealed)),
        };
        if association.address != Some(from) {
            let proved = proof(id, from);
            if kind != Kind::Here || hmac::verify(&self.cookies, &proved, body).is_err() {
                let cookie = hmac::sign(&self.cookies, &proved);
                return association.challenge(cookie.as_ref(), length, now_ns);
            }
            association.address = Some(from);
        }
        match (kind, association.session) {
            (Kind::Here, None) => Heard::Arrived { association: id, ticket: association.ticket },
            (Kind::Datagram, Some(session)) => Heard::Datagram { session, body },
            (Kind::Message, Some(session)) => association.on_message(session, body),
            (Kind::Taken, _) => {
                association.messages.on_taken(body);
                Heard::Nothing
            }
            _ => Heard::Nothing,
        }
    }

    /// It has become this session.
    pub fn join(&mut self, id: AssociationId, session: SessionId) {
        if let Some(association) = self.open.get_mut(&id) {
            (association.session, association.ends_ns) = (Some(session), None);
            self.by_session.insert(session, id);
        }
    }

    /// A datagram for a session, sealed, and where it goes.
    pub fn seal(&mut self, session: SessionId, bytes: &[u8]) -> Option<(Vec<u8>, SocketAddr)> {
        let association = self.open.get_mut(self.by_session.get(&session)?)?;
        Some((association.sealer.seal(Kind::Datagram, bytes)?, association.address?))
    }

    /// A frame for the reliable stream of a session; false where it takes none any more.
    pub fn say(&mut self, session: SessionId, frame: &[u8]) -> bool {
        let association = self.by_session.get(&session).and_then(|id| self.open.get_mut(id));
        association.is_some_and(|association| association.messages.say(frame))
    }

    /// What is to be said to all of them now, sealed, and where it goes.
    pub fn due(&mut self, now_ns: u64) -> Vec<(Vec<u8>, SocketAddr)> {
        let mut due = Vec::new();
        for association in self.open.values_mut() {
            let Association { messages, sealer, address: Some(address), .. } = association else {
                continue;
            };
            let sealed = messages.due(now_ns).filter_map(|body| sealer.seal(Kind::Message, body));
            due.extend(sealed.map(|packet| (packet, *address)));
        }
        let over = |association: &Association| {
            let Some(ends_ns) = association.ends_ns else { return false };
            let said = association.session.is_some() && association.messages.is_done();
            said || now_ns >= ends_ns
        };
        let gone: Vec<_> =
            self.open.iter().filter(|(_, a)| over(a)).map(|(id, a)| (*id, a.session)).collect();
        for (id, session) in gone {
            self.open.remove(&id);
            session.map(|session| self.by_session.remove(&session));
        }
        due
    }

    /// The session is over: what was said is said to the end, and then it goes.
    pub fn end(&mut self, session: SessionId, now_ns: u64) {
        let association = self.by_session.get(&session).and_then(|id| self.open.get_mut(id));
        if let Some(association) = association {
            association.ends_ns = Some(now_ns + FAREWELL_NS);
        }
    }

    /// Nobody is left.
    pub fn is_empty(&self) -> bool {
        self.by_session.is_empty()
    }
}

impl Association {
    fn challenge(&mut self, cookie: &[u8], asked_bytes: usize, now_ns: u64) -> Heard<'static> {
        let soon = self.challenged_ns.is_some_and(|ns| now_ns < ns + CHALLENGE_NS);
        let packet = if soon { None } else { self.sealer.seal(Kind::Challenge, cookie) };
        match packet.filter(|packet| packet.len() <= asked_bytes) {
            Some(packet) => {
                self.challenged_ns = Some(now_ns);
                Heard::Answer(packet)
            }
            None => Heard::Nothing,
        }
    }

    fn on_message<'a>(&mut self, session: SessionId, body: &'a [u8]) -> Heard<'a> {
        let (taken, frame) = self.messages.on_message(body);
        if body.len() < taken.len() {
            return Heard::Nothing; // without a number it is no message, and pays for no answer
        }
        let Some(answer) = self.sealer.seal(Kind::Taken, &taken) else { return Heard::Nothing };
        match frame {
            Some(frame) => Heard::Message { session, frame, answer },
            None => Heard::Answer(answer),
        }
    }
}

/// What a cookie is signed for: this association, at this address.
fn proof(id: AssociationId, address: SocketAddr) -> Vec<u8> {
    [&id[..], address.to_string().as_bytes()].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    const ID: AssociationId = *b"trainer1";
    const SECRET: Secret = [3; 32];
    const TICKET: Ticket = [9; 16];
    const MS: u64 = 1_000_000;

    fn at(port: u16) -> SocketAddr {
        ([192, 0, 2, 7], port).into()
    }

    fn session() -> SessionId {
        SessionId::parse("sessions/5").unwrap()
    }

    fn opened() -> (Associations, Sealer, Opener) {
        let mut associations = Associations::new(&[1; 32]);
        associations.open(ID, &SECRET, TICKET, 0).unwrap();
        let (sealer, opener) = ends(&SECRET, ID, Direction::Up);
        (associations, sealer, opener)
    }

    fn hear(
        table: &mut Associations,
        packet: &[u8],
        from: SocketAddr,
        now_ns: u64,
    ) -> Heard<'static> {
        match table.on_packet(&mut packet.to_vec(), from, now_ns) {
            Heard::Nothing => Heard::Nothing,
            Heard::Unsealed(why) => Heard::Unsealed(why),
            Heard::Answer(answer) => Heard::Answer(answer),
            Heard::Arrived { association, ticket } => Heard::Arrived { association, ticket },
            Heard::Datagram { session, body } => {
                Heard::Datagram { session, body: body.to_vec().leak() }
            }
            Heard::Message { session, frame, answer } => {
                Heard::Message { session, frame: frame.to_vec().leak(), answer }
            }
        }
    }

    /// Shows the cookie that a first packet from there was answered with.
    fn arrive(
        (table, sealer, opener): &mut (Associations, Sealer, Opener),
        from: SocketAddr,
        now_ns: u64,
    ) -> Heard<'static> {
        let asks = sealer.seal(Kind::Here, &[0; 32]).unwrap();
        let Heard::Answer(mut answer) = hear(table, &asks, from, now_ns) else {
            panic!("not challenged");
        };
        assert!(answer.len() <= asks.len(), "no more than was paid for");
        let (kind, cookie) = opener.open(&mut answer).unwrap();
        assert_eq!(kind, Kind::Challenge);
        let shows = sealer.seal(Kind::Here, cookie).unwrap();
        hear(table, &shows, from, now_ns)
    }

    #[test]
    fn a_client_arrives_by_its_cookie_and_is_spoken_to_only_then() {
        let mut all = opened();
        let early = all.1.seal(Kind::Datagram, &[0x12, 0]).unwrap();
        assert_eq!(hear(&mut all.0, &early, at(1), 0), Heard::Nothing, "36 bytes pay for nothing");
        assert_eq!(arrive(&mut all, at(1), 0), Heard::Arrived { association: ID, ticket: TICKET });
        let (table, sealer, opener) = &mut all;
        assert_eq!(table.seal(session(), b"State"), None, "it has no session yet");
        table.join(ID, session());
        let (mut packet, to) = table.seal(session(), b"State").unwrap();
        assert_eq!((opener.open(&mut packet), to), (Ok((Kind::Datagram, &b"State"[..])), at(1)));
        let command = sealer.seal(Kind::Datagram, b"Command").unwrap();
        let expected = Heard::Datagram { session: session(), body: b"Command" };
        assert_eq!(hear(table, &command, at(1), MS), expected);
        let replayed = Heard::Unsealed(Some(Unsealed::Replayed));
        assert_eq!(hear(table, &command, at(1), MS), replayed);
    }

    #[test]
    fn a_spoofed_address_gets_one_small_answer_and_the_stream_stays_where_it_is() {
        let mut all = opened();
        arrive(&mut all, at(1), 0);
        all.0.join(ID, session());
        // Whoever took a packet from the wire and sends it from elsewhere, before it came.
        let taken = all.1.seal(Kind::Datagram, &[0; 200]).unwrap();
        let heard = hear(&mut all.0, &taken, at(2), 10 * MS);
        assert!(matches!(&heard, Heard::Answer(answer) if answer.len() <= taken.len()));
        for n in 0..100 {
            let taken = all.1.seal(Kind::Datagram, &[n; 200]).unwrap();
            assert_eq!(hear(&mut all.0, &taken, at(2), 11 * MS), Heard::Nothing);
        }
        assert_eq!(all.0.seal(session(), b"State").unwrap().1, at(1));
        // A cookie of one address is none of another.
        let asks = all.1.seal(Kind::Here, &[0; 32]).unwrap();
        let Heard::Answer(mut answer) = hear(&mut all.0, &asks, at(2), 40 * MS) else { panic!() };
        let (_, cookie) = all.2.open(&mut answer).unwrap();
        let elsewhere = all.1.seal(Kind::Here, cookie).unwrap();
        hear(&mut all.0, &elsewhere, at(3), 60 * MS);
        assert_eq!(all.0.seal(session(), b"State").unwrap().1, at(1));
        let there = all.1.seal(Kind::Here, cookie).unwrap();
        hear(&mut all.0, &there, at(2), 80 * MS);
        assert_eq!(all.0.seal(session(), b"State").unwrap().1, at(2), "it has moved");
    }

    #[test]
    fn messages_are_said_until_taken_and_heard_once() {
        let mut all = opened();
        arrive(&mut all, at(1), 0);
        let (table, sealer, opener) = &mut all;
        table.join(ID, session());
        assert!(table.say(session(), b"Welcome"));
        for again in 0..3 {
            assert_eq!(table.due(again * 50 * MS).len(), 1);
            assert_eq!(table.due(again * 50 * MS + 49 * MS).len(), 0);
        }
        let mut said = table.due(150 * MS).pop().unwrap().0;
        let (kind, body) = opener.open(&mut said).unwrap();
        assert_eq!((kind, &body[4..]), (Kind::Message, &b"Welcome"[..]));
        let taken = sealer.seal(Kind::Taken, &body[..4]).unwrap();
        assert_eq!(hear(table, &taken, at(1), 0), Heard::Nothing);
        assert_eq!(table.due(400 * MS), []);
        let mut client = Messages::default();
        client.say(b"Bye");
        let body = client.due(0).next().unwrap().to_vec();
        let bye = sealer.seal(Kind::Message, &body).unwrap();
        let heard = hear(table, &bye, at(1), 0);
        assert!(matches!(heard, Heard::Message { frame: b"Bye", .. }), "{heard:?}");
        let again = sealer.seal(Kind::Message, &body).unwrap();
        assert!(matches!(hear(table, &again, at(1), 0), Heard::Answer(_)), "its answer was lost");
    }

    #[test]
    fn what_has_no_number_is_no_message_and_gets_no_answer() {
        let mut all = opened();
        arrive(&mut all, at(1), 0);
        all.0.join(ID, session());
        for count in 0..6 {
            let packet = all.1.seal(Kind::Message, &[0; 6][..count]).unwrap();
            match hear(&mut all.0, &packet, at(1), 0) {
                Heard::Nothing => assert!(count < 4),
                Heard::Answer(answer) => assert!(count >= 4 && answer.len() <= packet.len()),
                heard => panic!("{heard:?}"),
            }
        }
    }

    #[test]
    fn what_nobody_comes_for_and_what_has_ended_is_forgotten() {
        let mut all = opened();
        assert_eq!(all.0.due(AWAITED_NS - 1), []);
        assert_eq!(all.0.open.len(), 1);
        all.0.due(AWAITED_NS);
        assert_eq!(all.0.open.len(), 0);
        let mut all = opened();
        arrive(&mut all, at(1), 0);
        all.0.join(ID, session());
        all.0.due(100 * AWAITED_NS);
        assert!(!all.0.is_empty(), "it lives as long as its session");
        all.0.say(session(), b"Bye");
        all.0.end(session(), 0);
        assert_eq!(all.0.due(MS).len(), 1);
        assert!(!all.0.is_empty(), "its Bye was not taken");
        all.0.due(FAREWELL_NS);
        assert!(all.0.is_empty() && all.0.open.is_empty());
    }

    #[test]
    fn there_is_room_for_so_many() {
        let mut table = Associations::new(&[1; 32]);
        for n in 0..MOST as u64 {
            table.open(n.to_be_bytes(), &SECRET, TICKET, 0).unwrap();
        }
        assert_eq!(table.open([255; 8], &SECRET, TICKET, 0), Err(TooManyAssociations));
        table.due(AWAITED_NS);
        assert_eq!(table.open([255; 8], &SECRET, TICKET, 0), Ok(()));
    }

    #[test]
    fn forged_replayed_and_foreign_packets_come_to_nothing() {
        let mut all = opened();
        arrive(&mut all, at(1), 0);
        all.0.join(ID, session());
        let good = all.1.seal(Kind::Datagram, b"Command").unwrap();
        let mut forged = good.clone();
        *forged.last_mut().unwrap() ^= 1;
        // A number far ahead, to move the window past what is to come.
        let mut leading = good.clone();
        leading[9] = 0x7f;
        let foreign = ends(&[4; 32], ID, Direction::Up).0.seal(Kind::Datagram, b"x").unwrap();
        let unknown = ends(&SECRET, *b"nobodyxx", Direction::Up).0.seal(Kind::Here, &[0; 32]);
        let (unknown, short) = (unknown.unwrap(), good[..20].to_vec());
        let by_others = Some(Unsealed::Forged);
        for (packet, why) in [
            (&forged, by_others),
            (&leading, by_others),
            (&foreign, Some(Unsealed::Replayed)),
            (&unknown, None),
            (&short, None),
        ] {
            assert_eq!(hear(&mut all.0, packet, at(1), 0), Heard::Unsealed(why));
        }
        let heard = hear(&mut all.0, &good, at(1), 0);
        assert!(matches!(heard, Heard::Datagram { .. }), "the good one still counts: {heard:?}");
    }
}

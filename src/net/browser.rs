//! Certificates for browsers, which take one by its hash alone if it lives two weeks at most
//! (W3C WebTransport, `serverCertificateHashes`: ECDSA P-256, 14 days).
//!
//! Time is cut into slots. The certificate of a slot is valid from a day before it, for 13 days;
//! it is shown during its slot, and its hash is published during the slot before, too. So a page
//! that was told the hashes of two slots connects for six days at least, whatever the time of
//! day, and a clock may be wrong by a day. Both are kept in the state directory.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};

use rcgen::{CertificateParams, KeyPair, PKCS_ECDSA_P256_SHA256};
use rustls::server::{ClientHello, ResolvesServerCert};
use rustls::sign::CertifiedKey;
use time::{Duration, OffsetDateTime};

use super::identity::{IdentityError, from_pem, keep};
use crate::quic::{self, PINNED_NAME};

const SLOT_S: i64 = 6 * 86_400;

/// Before its slot begins a certificate is valid already.
const EARLY_S: i64 = 86_400;

/// From its first day to its last.
const VALID_S: i64 = 13 * 86_400;

// Short enough for a browser, and with a day for clocks at the end, too.
const _: () = assert!(VALID_S <= 14 * 86_400 && EARLY_S + SLOT_S + 86_400 <= VALID_S);

/// SHA-256 of the certificate that browsers see now, and of the next one.
pub type PublishedHashes = [[u8; 32]; 2];

/// The certificates of this slot and the next.
#[derive(Debug)]
pub struct BrowserIdentity {
    state_dir: PathBuf,
    held: Mutex<Held>,
}

/// Between two attempts to renew: a disk that is full is not asked all the time.
const AGAIN_S: i64 = 60;

#[derive(Clone, Debug)]
struct Held {
    slot: i64,
    /// When it is looked at again.
    next_s: i64,
    keys: [Arc<CertifiedKey>; 2],
}

impl BrowserIdentity {
    /// Those kept in `state_dir`, made and kept there where there are none for now.
    pub fn load_or_create(state_dir: &Path) -> Result<Self, IdentityError> {
        let held = Mutex::new(hold(state_dir, slot_of(now_s()))?);
        Ok(Self { state_dir: state_dir.to_owned(), held })
    }

    /// What pages may be told.
    pub fn hashes(&self) -> PublishedHashes {
        self.held().keys.map(|key| quic::fingerprint(&key.cert[0]))
    }

    /// A new slot brings a new certificate. Where it cannot be kept the old ones stay. Waits for
    /// the disk, so that handshakes need not.
    pub fn renew(&self) {
        self.renew_at(now_s());
    }

    fn renew_at(&self, now_s: i64) {
        let mut held = self.held();
        let slot = slot_of(now_s);
        if held.slot == slot || now_s < held.next_s {
            return;
        }
        match hold(&self.state_dir, slot) {
            Ok(renewed) => held = renewed,
            Err(error) => {
                held.next_s = now_s + AGAIN_S;
                tracing::error!(%error, "no new certificate for browsers");
            }
        }
        *self.held.lock().unwrap_or_else(PoisonError::into_inner) = held;
    }

    fn held(&self) -> Held {
        self.held.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// The certificate that a handshake gets: browsers theirs, all others the server's own.
#[derive(Debug)]
pub(super) struct ByProtocol {
    pub own: Arc<CertifiedKey>,
    pub browser: Arc<BrowserIdentity>,
}

impl ResolvesServerCert for ByProtocol {
    fn resolve(&self, hello: ClientHello<'_>) -> Option<Arc<CertifiedKey>> {
        let webtransport = quic::alpn_webtransport();
        let http = hello.alpn().is_some_and(|mut offers| offers.any(|offer| offer == webtransport));
        if http && hello.server_name() != Some(PINNED_NAME) {
            let [now, _] = self.browser.held().keys;
            return Some(now);
        }
        Some(Arc::clone(&self.own))
    }
}

fn now_s() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0, |since| i64::try_from(since.as_secs()).unwrap_or(i64::MAX))
}

fn slot_of(now_s: i64) -> i64 {
    now_s.div_euclid(SLOT_S)
}

fn hold(state_dir: &Path, slot: i64) -> Result<Held, IdentityError> {
    let keys = [load(state_dir, slot)?, load(state_dir, slot + 1)?];
    for old in fs::read_dir(state_dir).into_iter().flatten().flatten() {
        let number = old.file_name().to_str().and_then(slot_in);
        // The last one stays, for a clock that is put back.
        if number.is_some_and(|number| number + 1 < slot) {
            // One more file to look at next time.
            let _ = fs::remove_file(old.path());
        }
    }
    Ok(Held { slot, next_s: 0, keys })
}

fn file_name(slot: i64) -> String {
    format!("browser-{slot}.pem")
}

fn slot_in(name: &str) -> Option<i64> {
    name.strip_prefix("browser-")?.strip_suffix(".pem")?.parse().ok()
}

fn load(state_dir: &Path, slot: i64) -> Result<Arc<CertifiedKey>, IdentityError> {
    let path = state_dir.join(file_name(slot));
    let pem = match fs::read(&path) {
        Ok(pem) => pem,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            let pem = generate(slot)?;
            keep(state_dir, &path, &pem)
                .map_err(|source| IdentityError::File { path: path.clone(), source })?;
            pem.into_bytes()
        }
        Err(source) => return Err(IdentityError::File { path, source }),
    };
    Ok(Arc::new(from_pem(&path, &pem)?.certified()?))
}

fn generate(slot: i64) -> Result<String, rcgen::Error> {
    let key = KeyPair::generate_for(&PKCS_ECDSA_P256_SHA256)?;
    let mut params = CertificateParams::new(vec!["localhost".to_owned()])?;
    let begin_s = slot * SLOT_S - EARLY_S;
    params.not_before = OffsetDateTime::UNIX_EPOCH + Duration::seconds(begin_s);
    params.not_after = params.not_before + Duration::seconds(VALID_S);
    let certificate = params.self_signed(&key)?;
    Ok(format!("{}{}", certificate.pem(), key.serialize_pem()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustls::RootCertStore;
    use rustls::client::WebPkiServerVerifier;
    use rustls::client::danger::ServerCertVerifier;
    use rustls::pki_types::pem::PemObject;
    use rustls::pki_types::{CertificateDer, ServerName, UnixTime};

    const DAY_S: i64 = 86_400;

    /// Whether a client's clock that says so finds a certificate valid.
    fn is_valid(certificate: &CertificateDer<'static>, at_s: i64) -> bool {
        let mut roots = RootCertStore::empty();
        roots.add(certificate.clone()).unwrap();
        let verifier = WebPkiServerVerifier::builder_with_provider(roots.into(), quic::provider());
        let name = ServerName::try_from("localhost").unwrap();
        let at = UnixTime::since_unix_epoch(std::time::Duration::from_secs(at_s as u64));
        let verified =
            verifier.build().unwrap().verify_server_cert(certificate, &[], &name, &[], at);
        verified.is_ok()
    }

    /// As browsers see them: at any time the one that is shown counts, and so does the next one
    /// for whoever was told it, on a clock that is wrong by a day, too.
    #[test]
    fn the_one_that_is_shown_is_valid_for_a_wrong_clock_too_and_none_lives_two_weeks() {
        let dir = tempfile::tempdir().unwrap();
        let identity = BrowserIdentity::load_or_create(dir.path()).unwrap();
        let begin_s = slot_of(now_s()) * SLOT_S;
        for slot in 0..3 {
            let told = identity.hashes();
            let [shown, next] = identity.held().keys.map(|key| key.cert[0].clone());
            let (first_s, last_s) = (begin_s + slot * SLOT_S, begin_s + (slot + 1) * SLOT_S - 1);
            for clock_s in [first_s - DAY_S + 1, first_s, last_s, last_s + DAY_S] {
                assert!(is_valid(&shown, clock_s), "{slot}: {}", clock_s - first_s);
            }
            assert!(is_valid(&next, last_s + 1) && !is_valid(&next, first_s - DAY_S));
            let lives_s = (-15 * DAY_S..15 * DAY_S).step_by(3600);
            let lives = lives_s.filter(|s| is_valid(&shown, first_s + s)).count();
            assert!((13 * 24 - 1..=13 * 24 + 1).contains(&lives), "{lives} hours");
            identity.renew_at(last_s);
            assert_eq!(identity.hashes(), told, "not before its time");
            identity.renew_at(last_s + 1);
            assert_eq!(identity.hashes()[0], told[1], "what was promised");
        }
    }

    #[test]
    fn two_certificates_overlap_and_are_kept() {
        let dir = tempfile::tempdir().unwrap();
        let first = BrowserIdentity::load_or_create(dir.path()).unwrap().hashes();
        assert_eq!(BrowserIdentity::load_or_create(dir.path()).unwrap().hashes(), first);
        assert_ne!(first[0], first[1]);
        let slot = slot_of(now_s());
        let next = hold(dir.path(), slot + 1).unwrap();
        assert_eq!(quic::fingerprint(&next.keys[0].cert[0]), first[1], "what was promised");
        assert!(dir.path().join(file_name(slot)).exists(), "for a clock that is put back");
        hold(dir.path(), slot + 2).unwrap();
        assert!(!dir.path().join(file_name(slot)).exists(), "the old one is gone");
        let pem = fs::read(dir.path().join(file_name(slot + 1))).unwrap();
        let kept = CertificateDer::from_pem_slice(&pem).unwrap();
        assert_eq!(quic::fingerprint(&kept), first[1]);
    }

    #[test]
    fn a_broken_file_is_named_and_left_alone() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(file_name(slot_of(now_s())));
        fs::write(&path, "rubbish").unwrap();
        let error = BrowserIdentity::load_or_create(dir.path()).unwrap_err().to_string();
        assert!(error.contains("browser-") && error.contains("no certificate"), "{error}");
        assert_eq!(fs::read_to_string(&path).unwrap(), "rubbish");
    }
}

//! Tokens: what proves a credential. The server keeps only their hashes.
//!
//! 32 random bytes, written as 43 characters of the URL-safe alphabet of base64 (RFC 4648
//! section 5, without padding). The hash is that of the text, so that there is one spelling of
//! each. A plain SHA-256 is enough: nobody guesses 256 random bits, so that there is nothing a
//! slow hash would slow down.

use std::fmt;

use ring::digest::{SHA256, digest};
use ring::rand::{SecureRandom, SystemRandom};
use subtle::ConstantTimeEq;

const RANDOM_BYTES: usize = 32;
const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_";

/// A token. It is shown once and kept nowhere.
#[derive(Clone)]
pub struct Token(String);

impl Token {
    /// Characters of every token.
    pub const LENGTH: usize = 43;

    /// A new one; `None` when the system has no random numbers.
    pub fn random() -> Option<Self> {
        let mut bytes = [0; RANDOM_BYTES];
        SystemRandom::new().fill(&mut bytes).ok()?;
        Some(Self(url_safe(&bytes)))
    }

    /// The secret itself.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// What may be kept of it.
    pub fn hash(&self) -> TokenHash {
        TokenHash::of(&self.0)
    }
}

/// Never the secret: a log may hold it.
impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token(..)")
    }
}

/// SHA-256 of a token.
#[derive(Clone, Copy, Eq, PartialOrd, Ord)]
pub struct TokenHash([u8; 32]);

impl TokenHash {
    /// Of any text that somebody presents as a token.
    pub fn of(token: &str) -> Self {
        let mut hash = [0; 32];
        hash.copy_from_slice(digest(&SHA256, token.as_bytes()).as_ref());
        Self(hash)
    }

    /// Whether both are of the same token, in a time that does not depend on where they differ.
    pub(super) fn equals(&self, other: &Self) -> subtle::Choice {
        self.0.ct_eq(&other.0)
    }

    /// The hash in 64 hexadecimal digits of either case.
    pub(super) fn from_hex(text: &str) -> Option<Self> {
        let digit =
            |byte: u8| (byte as char).to_digit(16).and_then(|digit| u8::try_from(digit).ok());
        let mut hash = [0; 32];
        if text.len() != 2 * hash.len() {
            return None;
        }
        for (byte, pair) in hash.iter_mut().zip(text.as_bytes().chunks(2)) {
            *byte = digit(pair[0])? << 4 | digit(pair[1])?;
        }
        Some(Self(hash))
    }

    pub(super) fn to_hex(self) -> String {
        self.0.iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

impl PartialEq for TokenHash {
    fn eq(&self, other: &Self) -> bool {
        self.equals(other).into()
    }
}

impl fmt::Debug for TokenHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("TokenHash(..)")
    }
}

/// Six bits to a character, the last one filled up with zeros.
fn url_safe(bytes: &[u8]) -> String {
    let mut text = String::with_capacity(bytes.len() * 4 / 3 + 1);
    for group in bytes.chunks(3) {
        let bits = group.iter().fold(0, |bits, byte| bits << 8 | u32::from(*byte));
        let bits = bits << (8 * (3 - group.len()));
        for place in 0..=group.len() {
            text.push(ALPHABET[(bits >> (18 - 6 * place) & 63) as usize] as char);
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The examples of RFC 4648 section 10, without their padding, and one with `-` and `_`.
    #[test]
    fn bytes_are_written_as_the_standard_says() {
        for (bytes, text) in [
            (&b""[..], ""),
            (b"f", "Zg"),
            (b"fo", "Zm8"),
            (b"foo", "Zm9v"),
            (b"foob", "Zm9vYg"),
            (b"fooba", "Zm9vYmE"),
            (b"foobar", "Zm9vYmFy"),
            (&[0xfb, 0xef, 0xff], "--__"),
        ] {
            assert_eq!(url_safe(bytes), text);
        }
    }

    #[test]
    fn a_token_is_43_characters_that_no_url_changes_and_none_comes_twice() {
        let tokens: std::collections::BTreeSet<_> =
            (0..1000).map(|_| Token::random().unwrap().as_str().to_owned()).collect();
        assert_eq!(tokens.len(), 1000);
        for token in tokens {
            assert_eq!(token.len(), Token::LENGTH);
            assert!(token.bytes().all(|byte| ALPHABET.contains(&byte)), "{token}");
        }
    }

    /// FIPS 180-4: the message "abc".
    #[test]
    fn the_hash_is_sha256_and_survives_its_digits() {
        let hash = TokenHash::of("abc");
        let hex = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(hash.to_hex(), hex);
        assert_eq!(TokenHash::from_hex(hex), Some(hash));
        assert_eq!(TokenHash::from_hex(&hex.to_uppercase()), Some(hash));
        for wrong in
            ["", &hex[1..], &format!("{hex}0"), &hex.replace('b', "g"), &"\u{e9}".repeat(32)]
        {
            assert_eq!(TokenHash::from_hex(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn a_secret_is_not_in_what_is_logged() {
        let token = Token::random().unwrap();
        let logged = format!("{token:?} {:?}", token.hash());
        assert!(!logged.contains(token.as_str()) && !logged.contains(&token.hash().to_hex()));
    }
}

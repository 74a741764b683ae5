//! The audit log: who did what to a server, and when, as lines of JSON on disk.
//!
//! ```text
//! STATE_DIR/audit.jsonl        what is written now; then audit.jsonl.1 to .3, older each
//! ```
//!
//! One object a line, ASCII throughout: whatever a client calls itself, a line is a line and
//! no terminal obeys it. Keys: `time`, `who` (a credential, or `local`), `from` (an address),
//! `device`, `what`, `detail`; those that say nothing are left out. A line with `lost` says that
//! so many more could not be written. [`AuditLog`] is the server's, which never waits; [`append`]
//! is that of a command; [`tail`] reads.

mod log;
mod tail;

use std::fmt::Write;

use serde::{Deserialize, Serialize};

use crate::utc::Utc;

pub use log::{AuditLog, append};
pub use tail::tail;

/// The file that is written now.
const FILE: &str = "audit.jsonl";
/// Older files that are kept.
const KEPT: u32 = 3;

/// Longest name or address, and longest detail, in characters; more is cut off.
const LONGEST_WORD: usize = 128;
const LONGEST_DETAIL: usize = 400;

/// What was done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum What {
    /// The server began.
    Started,
    /// The server ended in order.
    Ended,
    /// A session became the controller of a device.
    LeaseAcquired,
    /// It ceased to be.
    LeaseReleased,
    /// It took the lease from another.
    Takeover,
    /// A device was stopped.
    Stopped,
    /// A device was enabled.
    Enabled,
    /// A device was disabled.
    Disabled,
    /// A latched fault was cleared.
    FaultCleared,
    /// Encoders were given their place.
    Homed,
    /// Settings of a device were changed.
    SettingsChanged,
    /// The resident scene was changed.
    SceneChanged,
    /// A client began a session.
    SessionOpened,
    /// It ended, or was ended.
    SessionClosed,
    /// A recording was begun.
    RecordingStarted,
    /// A recording was deleted.
    RecordingDeleted,
    /// A credential was made.
    CredentialIssued,
    /// A credential was taken back.
    CredentialRevoked,
    /// The list of credentials in force became another.
    CredentialsChanged,
    /// Somebody was not let in, or not allowed what was asked for.
    Refused,
}

impl What {
    /// Whether it has to be on disk at once: after it, somebody may switch the machine off, or
    /// have a reason to.
    fn is_synced(self) -> bool {
        matches!(
            self,
            Self::Stopped | Self::Ended | Self::CredentialIssued | Self::CredentialRevoked
        )
    }
}

/// What is recorded; empty where there is nothing to say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Event<'a> {
    /// What was done.
    pub what: What,
    /// Name of a credential, or [`LOCAL`](crate::credentials::LOCAL).
    pub who: &'a str,
    /// Address that it came from.
    pub from: &'a str,
    /// `devices/NAME`.
    pub device: &'a str,
    /// The rest, for people.
    pub detail: &'a str,
}

/// One line of the log.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Line {
    /// When.
    pub time: String,
    /// What was done; a line about what is lost may have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub what: Option<What>,
    /// Who did it.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub who: String,
    /// From where.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub from: String,
    /// To which device.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub device: String,
    /// The rest.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub detail: String,
    /// So many more are missing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lost: Option<u64>,
}

impl Line {
    fn new(event: &Event<'_>, now: Utc) -> Self {
        Self {
            time: stamp(now),
            what: Some(event.what),
            who: cut(event.who, LONGEST_WORD),
            from: cut(event.from, LONGEST_WORD),
            device: cut(event.device, LONGEST_WORD),
            detail: cut(event.detail, LONGEST_DETAIL),
            lost: None,
        }
    }

    /// A line about lines that are missing, of one kind or of any.
    fn lost(count: u64, what: Option<What>, now: Utc) -> Self {
        let none = Event { what: What::Refused, who: "", from: "", device: "", detail: "" };
        Self { what, lost: Some(count), ..Self::new(&none, now) }
    }

    /// The object and the end of its line.
    fn to_json(&self) -> String {
        // Nothing in it can fail: no map, and no number that is not finite.
        let json = serde_json::to_string(self).unwrap_or_default();
        let mut line = ascii(&json);
        line.push('\n');
        line
    }
}

/// Always with its milliseconds: columns stay columns.
fn stamp(now: Utc) -> String {
    format!("{}.{:03}Z", now.whole_second().to_string().trim_end_matches('Z'), now.ms() % 1000)
}

/// The beginning of a text; what is left out is told by three dots.
fn cut(text: &str, longest: usize) -> String {
    match text.char_indices().nth(longest) {
        None => text.to_owned(),
        Some((end, _)) => format!("{}...", &text[..end]),
    }
}

/// JSON in which nothing but printable ASCII stands. Anything else is within a string there,
/// where `\u` says the same.
fn ascii(json: &str) -> String {
    let mut plain = String::with_capacity(json.len());
    for c in json.chars() {
        if c.is_ascii_graphic() || c == ' ' {
            plain.push(c);
        } else {
            for unit in c.encode_utf16(&mut [0; 2]) {
                // A String takes whatever is written.
                let _ = write!(plain, "\\u{unit:04x}");
            }
        }
    }
    plain
}

#[cfg(test)]
pub(in crate::audit) mod tests {
    use super::*;

    pub(in crate::audit) const QUIET: Event<'static> =
        Event { what: What::Stopped, who: "anna", from: "", device: "devices/left", detail: "" };

    #[test]
    fn a_line_is_one_object_that_leaves_out_what_it_does_not_know() {
        let now = Utc::from_ms(1_763_803_800_007);
        assert_eq!(
            Line::new(&QUIET, now).to_json(),
            "{\"time\":\"2025-11-22T09:30:00.007Z\",\"what\":\"stopped\",\"who\":\"anna\",\
             \"device\":\"devices/left\"}\n"
        );
        assert_eq!(
            Line::lost(7, None, Utc::from_ms(0)).to_json(),
            "{\"time\":\"1970-01-01T00:00:00.000Z\",\"lost\":7}\n"
        );
    }

    #[test]
    fn deeds_have_the_names_that_programs_look_for() {
        for (what, name) in [
            (What::Started, "started"),
            (What::Ended, "ended"),
            (What::LeaseAcquired, "lease_acquired"),
            (What::LeaseReleased, "lease_released"),
            (What::Takeover, "takeover"),
            (What::Stopped, "stopped"),
            (What::Enabled, "enabled"),
            (What::Disabled, "disabled"),
            (What::FaultCleared, "fault_cleared"),
            (What::Homed, "homed"),
            (What::SettingsChanged, "settings_changed"),
            (What::SceneChanged, "scene_changed"),
            (What::SessionOpened, "session_opened"),
            (What::SessionClosed, "session_closed"),
            (What::RecordingStarted, "recording_started"),
            (What::RecordingDeleted, "recording_deleted"),
            (What::CredentialIssued, "credential_issued"),
            (What::CredentialRevoked, "credential_revoked"),
            (What::CredentialsChanged, "credentials_changed"),
            (What::Refused, "refused"),
        ] {
            assert_eq!(serde_json::to_string(&what).unwrap(), format!("\"{name}\""));
        }
    }

    /// What a stranger says of itself is text to every reader: JSON keeps it, a terminal sees
    /// printable ASCII, and it ends no line.
    #[test]
    fn hostile_text_stays_text() {
        for text in [
            "a\nb",
            "\r\n{\"what\":\"stopped\"}",
            "\"},{\"",
            "\\",
            "\u{1b}[2J",
            "\u{9b}31m",
            "\0\u{7f}",
            "\u{202e}evil",
            "\u{feff}",
            "\u{1f600} \u{e9} \u{2028}",
        ] {
            let event = Event { who: text, from: text, device: text, detail: text, ..QUIET };
            let line = Line::new(&event, Utc::from_ms(0)).to_json();
            let body = line.strip_suffix('\n').unwrap();
            assert!(body.bytes().all(|byte| (b' '..=b'~').contains(&byte)), "{body}");
            let read: Line = serde_json::from_str(body).unwrap();
            assert_eq!((read.who.as_str(), read.detail.as_str()), (text, text));
        }
    }

    #[test]
    fn a_line_is_bounded_whatever_is_said() {
        let endless = "\u{1f600}".repeat(1 << 20);
        let event =
            Event { who: &endless, from: &endless, device: &endless, detail: &endless, ..QUIET };
        let line = Line::new(&event, Utc::LAST);
        assert!(line.detail.ends_with("..."), "what is missing is told");
        assert_eq!(line.detail.chars().count(), LONGEST_DETAIL + 3);
        assert!(line.to_json().len() < 12_000, "{}", line.to_json().len());
        assert_eq!(cut("ab", 2), "ab");
    }
}

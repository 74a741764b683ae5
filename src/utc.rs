//! Moments of the world's clock as people write them: `2025-11-22T09:30:00.125Z` (RFC 3339).
//!
//! Milliseconds since 1970-01-01T00:00:00Z, without leap seconds, as the system counts them;
//! years 1970 to 9999. The calendar is the Gregorian one: a year has a 29 February when 4
//! divides it, except that of the centuries only every fourth has one. For what lasts: when a
//! credential was issued, when something was done. Nothing that renders asks for it.

use std::fmt;
use std::str::FromStr;
use std::time::{SystemTime, UNIX_EPOCH};

const MS_PER_S: u64 = 1000;
const MS_PER_DAY: u64 = 86_400 * MS_PER_S;
/// 400 years, after which the calendar begins again.
const DAYS_PER_ERA: u64 = 146_097;
const FIRST_YEAR: u64 = 1970;
const LAST_YEAR: u64 = 9999;

/// A moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Utc {
    ms: u64,
}

/// A text that is no moment.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("must be a moment in UTC, years 1970 to 9999, such as 2025-11-22T09:30:00Z")]
pub struct UtcError;

impl Utc {
    /// The last moment that can be written.
    pub const LAST: Self = Self { ms: days_before(LAST_YEAR + 1) * MS_PER_DAY - 1 };

    /// What the system's clock says.
    pub fn now() -> Self {
        let since = SystemTime::now().duration_since(UNIX_EPOCH);
        Self::from_ms(since.map_or(0, |since| u64::try_from(since.as_millis()).unwrap_or(u64::MAX)))
    }

    /// Milliseconds since 1970; what lies beyond [`Utc::LAST`] is that.
    pub fn from_ms(ms: u64) -> Self {
        Self { ms: ms.min(Self::LAST.ms) }
    }

    /// Milliseconds since 1970.
    pub fn ms(self) -> u64 {
        self.ms
    }

    /// The same without its part of a second.
    #[must_use]
    pub fn whole_second(self) -> Self {
        Self { ms: self.ms - self.ms % MS_PER_S }
    }

    /// So many days later.
    #[must_use]
    pub fn plus_days(self, days: u32) -> Self {
        Self::from_ms(self.ms + u64::from(days) * MS_PER_DAY)
    }
}

/// Milliseconds are written where there are any.
impl fmt::Display for Utc {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (days, ms) = (self.ms / MS_PER_DAY, self.ms % MS_PER_DAY);
        let (year, month, day) = date(days);
        let (s, ms) = (ms / MS_PER_S, ms % MS_PER_S);
        let (hour, minute, second) = (s / 3600, s / 60 % 60, s % 60);
        write!(f, "{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}")?;
        if ms > 0 { write!(f, ".{ms:03}Z") } else { f.write_str("Z") }
    }
}

/// Reads what [`Utc`] writes, and any other number of digits of a second.
impl FromStr for Utc {
    type Err = UtcError;

    fn from_str(text: &str) -> Result<Self, UtcError> {
        read(text).ok_or(UtcError)
    }
}

fn read(text: &str) -> Option<Utc> {
    let text = text.strip_suffix('Z')?;
    let (whole, fraction) = match text.split_once('.') {
        Some((whole, fraction)) => (whole, fraction),
        None => (text, "0"),
    };
    let bytes = whole.as_bytes();
    let shape = b"0000-00-00T00:00:00";
    let fits = |(found, wanted): (&u8, &u8)| match wanted {
        b'0' => found.is_ascii_digit(),
        _ => found == wanted,
    };
    let digits = !fraction.is_empty() && fraction.bytes().all(|byte| byte.is_ascii_digit());
    if bytes.len() != shape.len() || !bytes.iter().zip(shape).all(fits) || !digits {
        return None;
    }
    let number = |from: usize, to: usize| whole[from..to].parse::<u64>().ok();
    let (year, month, day) = (number(0, 4)?, number(5, 7)?, number(8, 10)?);
    let (hour, minute, second) = (number(11, 13)?, number(14, 16)?, number(17, 19)?);
    let days = days_at(year, month, day)?;
    if hour > 23 || minute > 59 || second > 59 {
        return None;
    }
    let thousandths: String = fraction.chars().chain("00".chars()).take(3).collect();
    let ms = ((days * 24 + hour) * 60 + minute) * 60 + second;
    Some(Utc { ms: ms * MS_PER_S + thousandths.parse::<u64>().ok()? })
}

/// Leap years among the years 1 to `year`.
const fn leap_years(year: u64) -> u64 {
    year / 4 - year / 100 + year / 400
}

/// Days from 1970 to the first of January of a year that is not before 1970.
const fn days_before(year: u64) -> u64 {
    (year - FIRST_YEAR) * 365 + leap_years(year - 1) - leap_years(FIRST_YEAR - 1)
}

fn month_lengths(year: u64) -> [u64; 12] {
    let february = if leap_years(year) > leap_years(year - 1) { 29 } else { 28 };
    [31, february, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31]
}

/// Days from 1970 to a date; `None` where there is no such date.
fn days_at(year: u64, month: u64, day: u64) -> Option<u64> {
    if !(FIRST_YEAR..=LAST_YEAR).contains(&year) {
        return None;
    }
    let lengths = month_lengths(year);
    let before = usize::try_from(month.checked_sub(1)?).ok()?;
    let length = *lengths.get(before)?;
    let past: u64 = lengths[..before].iter().sum();
    (1..=length).contains(&day).then(|| days_before(year) + past + day - 1)
}

/// Year, month and day of a day since 1970.
fn date(days: u64) -> (u64, u64, u64) {
    // The mean length of a year leads to the right year or the one after.
    let mut year = FIRST_YEAR + (days + 1) * 400 / DAYS_PER_ERA;
    while days_before(year) > days {
        year -= 1;
    }
    while days_before(year + 1) <= days {
        year += 1;
    }
    let mut rest = days - days_before(year);
    let mut month = 1;
    for length in month_lengths(year) {
        if rest < length {
            break;
        }
        rest -= length;
        month += 1;
    }
    (year, month, rest + 1)
}

#[cfg(test)]
mod tests {
    use time::{OffsetDateTime, UtcDateTime};

    use super::*;

    /// Another implementation's date of every day that can be written.
    #[test]
    fn every_day_has_its_date_and_every_date_its_day() {
        let days = days_before(LAST_YEAR + 1);
        for day in 0..days {
            let other = OffsetDateTime::from_unix_timestamp((day * 86_400) as i64).unwrap();
            let wanted = (other.year() as u64, u8::from(other.month()).into(), other.day().into());
            assert_eq!(date(day), wanted, "day {day}");
            assert_eq!(days_at(wanted.0, wanted.1, wanted.2), Some(day));
        }
        let last = UtcDateTime::MAX.unix_timestamp() as u64;
        assert_eq!(days, last / 86_400 + 1, "ends with the year 9999");
    }

    #[test]
    fn a_moment_is_written_as_people_read_it() {
        // GNU date: `date -u -d @1763803800 +%FT%TZ`.
        for (ms, text) in [
            (0, "1970-01-01T00:00:00Z"),
            (1_763_803_800_125, "2025-11-22T09:30:00.125Z"),
            (951_782_400_000, "2000-02-29T00:00:00Z"),
            (4_107_542_399_999, "2100-02-28T23:59:59.999Z"),
            (253_402_300_799_999, "9999-12-31T23:59:59.999Z"),
        ] {
            let moment = Utc::from_ms(ms);
            assert_eq!((moment.to_string().as_str(), text.parse()), (text, Ok(moment)));
        }
        assert_eq!(Utc::from_ms(u64::MAX), Utc::LAST);
        assert_eq!(Utc::LAST.plus_days(u32::MAX), Utc::LAST);
    }

    #[test]
    fn what_is_no_moment_is_refused() {
        for text in [
            "",
            "Z",
            "2025-11-22",
            "2025-11-22T09:30:00",
            "2025-11-22T09:30:00+01:00",
            "2025-11-22 09:30:00Z",
            "2025-02-29T00:00:00Z",
            "2100-02-29T00:00:00Z",
            "2025-00-01T00:00:00Z",
            "2025-13-01T00:00:00Z",
            "2025-04-31T00:00:00Z",
            "2025-04-00T00:00:00Z",
            "2025-11-22T24:00:00Z",
            "2025-11-22T23:60:00Z",
            "2025-11-22T23:59:60Z",
            "1969-12-31T23:59:59Z",
            "2025-11-22T09:30:00.Z",
            "2025-11-22T09:30:00.1x5Z",
            "+025-11-22T09:30:00Z",
            "2025-11-22T09:30:0\u{e9}Z",
            "10000-01-01T00:00:00Z",
        ] {
            assert_eq!(text.parse::<Utc>(), Err(UtcError), "{text:?}");
        }
        let tenth: Utc = "2025-11-22T09:30:00.1Z".parse().unwrap();
        let more: Utc = "2025-11-22T09:30:00.100999999Z".parse().unwrap();
        assert_eq!((tenth.ms() % 1000, more), (100, tenth));
        assert_eq!(tenth.whole_second().to_string(), "2025-11-22T09:30:00Z");
    }
}

//! An input read as a script: choices and numbers, one after another, zeros once it is over.
//!
//! Everything is taken from the front, least significant byte first, so a seed can be written
//! by hand. A number in a range is mostly usual, now and then a bound, just beyond it, or no
//! number at all: what a refusal is for.

use arbitrary::Unstructured;

/// The rest of an input.
pub struct Script<'a>(Unstructured<'a>);

impl<'a> Script<'a> {
    /// From its beginning.
    pub fn new(data: &'a [u8]) -> Self {
        Self(Unstructured::new(data))
    }

    /// True once everything that comes is zero.
    pub fn is_over(&self) -> bool {
        self.0.is_empty()
    }

    pub fn u8(&mut self) -> u8 {
        self.0.arbitrary().unwrap_or_default()
    }

    pub fn u16(&mut self) -> u16 {
        self.0.arbitrary().unwrap_or_default()
    }

    pub fn u32(&mut self) -> u32 {
        self.0.arbitrary().unwrap_or_default()
    }

    pub fn u64(&mut self) -> u64 {
        self.0.arbitrary().unwrap_or_default()
    }

    /// One of so many.
    pub fn below(&mut self, count: usize) -> usize {
        usize::from(self.u8()) % count.max(1)
    }

    /// True once in `rarity` times.
    pub fn rarely(&mut self, rarity: u8) -> bool {
        self.u8() % rarity == rarity - 1
    }

    /// One of these.
    pub fn one_of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.below(choices.len())]
    }

    /// So many bytes, or as many as there are.
    pub fn bytes(&mut self, count: usize) -> &'a [u8] {
        let count = count.min(self.0.len());
        self.0.bytes(count).unwrap_or_default()
    }

    /// Text of some bytes: a letter over and over, or whatever there is.
    pub fn text(&mut self) -> String {
        let count = usize::from(self.u8() % 80);
        if self.rarely(2) {
            return "a".repeat(count);
        }
        String::from_utf8_lossy(self.bytes(count)).into_owned()
    }

    /// A number that is in the range as a rule.
    pub fn number(&mut self, min: f64, max: f64) -> f64 {
        match self.u8() {
            0..=199 => self.inside(min, max),
            200..=209 => min,
            210..=219 => max,
            220..=229 => 0.0,
            230..=233 => min - (min.abs() * 1e-6).max(f64::MIN_POSITIVE),
            234..=237 => max + (max.abs() * 1e-6).max(f64::MIN_POSITIVE),
            238..=240 => f64::from_bits(self.u64()),
            241..=243 => f64::from(f32::from_bits(self.u32())),
            244 | 245 => f64::NAN,
            246 | 247 => f64::INFINITY,
            248 | 249 => f64::NEG_INFINITY,
            250 => f64::MIN_POSITIVE,
            251 => f64::from(f32::MAX),
            252 => f64::MAX,
            253 => -0.0,
            254 => 5e-324,
            255 => 1.0,
        }
    }

    /// A number of the range.
    pub fn inside(&mut self, min: f64, max: f64) -> f64 {
        min + (max - min) * f64::from(self.u16()) / f64::from(u16::MAX)
    }

    /// The same as floats, for the wire.
    pub fn floats(&mut self, count: usize, min: f64, max: f64) -> Vec<f32> {
        let count = if self.rarely(50) { self.below(12) } else { count };
        (0..count).map(|_| self.number(min, max) as f32).collect()
    }
}

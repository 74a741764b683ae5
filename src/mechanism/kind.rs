//! Kinds of linkages: which keys a device file has for each, and how the linkage comes of them.
//!
//! A linkage's file declares its keys with their forms, ranges and defaults, and builds itself
//! from the [`Described`] that passed them; [`KINDS`] has a line for each, and nobody else
//! knows their keys. SI units, radians. A refusal carries the key path as its author wrote it,
//! the value, and what is allowed; a key that belongs to other kinds is told from one that no
//! kind has. Reading files is not done here: a [`Value`] is what a file's format made of it.
#![expect(
    clippy::disallowed_types,
    clippy::disallowed_methods,
    clippy::disallowed_macros,
    reason = "linkages are built before the first tick"
)]

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

use serde::Deserialize;

use super::{Inertia, LinkInertia, Mechanism, five_bar, symmetric_five_bar, three_rrr, two_link};
use crate::notation::ActuatorVector;
use crate::units::{FieldError, Range};

/// Every kind of linkage that a device file can name.
pub const KINDS: [&Kind; 4] =
    [&two_link::KIND, &five_bar::KIND, &symmetric_five_bar::KIND, &three_rrr::KIND];

/// One kind of linkage.
#[derive(Debug)]
pub struct Kind {
    /// Its name in device files.
    pub name: &'static str,
    /// Its keys, in the order in which a description names them.
    pub keys: &'static [Key],
    /// Builds it from checked values.
    pub build: fn(&Described) -> Result<Arc<dyn Mechanism>, FieldError>,
}

/// One key of `[mechanism]`.
#[derive(Debug)]
pub struct Key {
    /// As people write it.
    pub name: &'static str,
    /// What may stand there.
    pub form: Form,
}

/// What may stand at a key.
#[derive(Clone, Copy, Debug)]
pub enum Form {
    /// A number that must be given.
    Number(Range),
    /// A number, and the one that is meant where none stands.
    Usually(f64, Range),
    /// So many numbers.
    Numbers(usize, Range),
    /// -1 or 1, and which is meant where nothing stands.
    Sign(i32),
    /// A word for 1, which is also meant where nothing stands, and a word for -1.
    Word(&'static str, &'static str),
}

/// A value as a file has it.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub enum Value {
    /// Whole or not.
    Number(f64),
    /// A word.
    Text(String),
    /// Several values.
    List(Vec<Value>),
    /// What no linkage has a use for.
    Other(serde::de::IgnoredAny),
}

/// What moves besides the mechanism's own geometry: `[inertia]` and the shafts' part.
#[derive(Clone, Debug)]
pub struct Weights {
    /// Mass of the handle.
    pub handle_mass_kg: f64,
    /// Moment of inertia of the handle about H, where it is told.
    pub handle_inertia_kg_m2: Option<f64>,
    /// The links, or none at all for massless ones.
    pub links: Vec<LinkInertia>,
    /// What turns with each shaft.
    pub shaft_inertia_kg_m2: ActuatorVector,
}

/// The checked values of one kind's keys, with what moves.
#[derive(Debug)]
pub struct Described<'a> {
    values: Vec<(&'static Key, Vec<f64>)>,
    weights: &'a Weights,
}

/// A linkage with the numbers that it was built from, by name.
pub type Built = (Arc<dyn Mechanism>, Vec<(String, f64)>);

/// A linkage as its users hold it.
pub(super) fn shared(mechanism: impl Mechanism + 'static) -> Arc<dyn Mechanism> {
    Arc::new(mechanism)
}

/// The linkage that `[mechanism]`, with its `kind`, and `weights` describe together.
pub fn build(table: &BTreeMap<String, Value>, weights: &Weights) -> Result<Built, FieldError> {
    let kind = kind_of(table)?;
    for (key, value) in table.iter().filter(|(key, _)| key.as_str() != "kind") {
        kind.require_own(key, value)?;
    }
    let read = |key: &'static Key| Ok((key, key.read(table.get(key.name))?));
    let values = kind.keys.iter().map(read).collect::<Result<_, FieldError>>()?;
    let described = Described { values, weights };
    let mechanism = (kind.build)(&described)?;
    if let (Some(inertia_kg_m2), 2) = (weights.handle_inertia_kg_m2, mechanism.freedoms()) {
        let allowed = format!("a {} does not turn its handle: leave it out", kind.name);
        return Err(FieldError::new("inertia.handle_inertia_kg_m2", inertia_kg_m2, allowed));
    }
    Ok((mechanism, described.named()))
}

fn kind_of(table: &BTreeMap<String, Value>) -> Result<&'static Kind, FieldError> {
    let written = table.get("kind");
    let named = |kind: &&&Kind| matches!(written, Some(Value::Text(name)) if name == kind.name);
    KINDS.iter().find(named).copied().ok_or_else(|| {
        let written = written.map_or("(missing)".to_owned(), Value::to_string);
        let names = KINDS.map(|kind| format!("{:?}", kind.name)).join(", ");
        FieldError::new("mechanism.kind", written, format!("must be one of {names}"))
    })
}

impl Kind {
    fn has(&self, key: &str) -> bool {
        self.keys.iter().any(|own| own.name == key)
    }

    /// Refuses a key that this kind does not have.
    fn require_own(&self, key: &str, value: &Value) -> Result<(), FieldError> {
        if self.has(key) {
            return Ok(());
        }
        let field = format!("mechanism.{key}");
        let owners = KINDS.iter().filter(|kind| kind.has(key));
        let owners = owners.map(|kind| format!("{:?}", kind.name)).collect::<Vec<_>>();
        if owners.is_empty() {
            let own = self.keys.iter().map(|own| format!("`{}`", own.name)).collect::<Vec<_>>();
            let allowed = format!("unknown field, expected one of `kind`, {}", own.join(", "));
            return Err(FieldError::new(field, value, allowed));
        }
        let allowed = format!("is a key of kind {}, not of {:?}", owners.join(", "), self.name);
        Err(FieldError::new(field, "(set)", allowed))
    }
}

impl Key {
    /// The numbers that stand there, or that are meant where nothing stands.
    fn read(&self, value: Option<&Value>) -> Result<Vec<f64>, FieldError> {
        let path = format!("mechanism.{}", self.name);
        let Some(value) = value else {
            let missing = "this kind of mechanism needs it";
            let usual = self.form.usual();
            return usual.ok_or_else(|| FieldError::new(path, "(missing)", missing));
        };
        match (self.form, value) {
            (Form::Number(range) | Form::Usually(_, range), Value::Number(number)) => {
                Ok(vec![range.check(&path, *number)?])
            }
            (Form::Numbers(count, range), shown @ Value::List(list)) if list.len() == count => {
                let check = |(i, value): (usize, &Value)| match value {
                    Value::Number(number) => range.check(&format!("{path}[{i}]"), *number),
                    _ => Err(FieldError::new(&path, shown, self.form.to_string())),
                };
                list.iter().enumerate().map(check).collect()
            }
            (Form::Sign(_), Value::Number(sign)) if sign.abs() == 1.0 => Ok(vec![*sign]),
            (Form::Word(plus, _), Value::Text(word)) if word == plus => Ok(vec![1.0]),
            (Form::Word(_, minus), Value::Text(word)) if word == minus => Ok(vec![-1.0]),
            _ => Err(FieldError::new(path, value, self.form.to_string())),
        }
    }

    /// Its numbers by name: `l_m` is `l1_m`, `l2_m` and so on.
    fn named(&self, numbers: &[f64]) -> Vec<(String, f64)> {
        match self.form {
            Form::Numbers(..) => {
                let name = |i| self.name.replacen('_', &format!("{i}_"), 1);
                (1..).zip(numbers).map(|(i, &number)| (name(i), number)).collect()
            }
            _ => numbers.iter().map(|&number| (self.name.to_owned(), number)).collect(),
        }
    }
}

impl Form {
    fn usual(&self) -> Option<Vec<f64>> {
        match *self {
            Self::Number(_) | Self::Numbers(..) => None,
            Self::Usually(number, _) => Some(vec![number]),
            Self::Sign(sign) => Some(vec![f64::from(sign)]),
            Self::Word(..) => Some(vec![1.0]),
        }
    }
}

/// What is allowed, as a refusal says it.
impl fmt::Display for Form {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(range) | Self::Usually(_, range) => {
                write!(f, "must be a number in {range}")
            }
            Self::Numbers(count, range) => write!(f, "must be {count} numbers in {range}"),
            Self::Sign(_) => write!(f, "must be -1 or 1"),
            Self::Word(plus, minus) => write!(f, "must be {plus:?} or {minus:?}"),
        }
    }
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(number) => write!(f, "{number}"),
            Self::Text(text) => write!(f, "{text:?}"),
            Self::List(list) => {
                let items = list.iter().map(Self::to_string).collect::<Vec<_>>();
                write!(f, "[{}]", items.join(", "))
            }
            Self::Other(_) => write!(f, "(neither a number nor a word)"),
        }
    }
}

impl Described<'_> {
    /// A number by its key; not a number where the kind declares no such key, which every
    /// range refuses.
    pub(super) fn number(&self, key: &str) -> f64 {
        self.numbers::<1>(key)[0]
    }

    /// A list of numbers by its key.
    pub(super) fn numbers<const N: usize>(&self, key: &str) -> [f64; N] {
        let found = self.values.iter().find(|(own, _)| own.name == key);
        let at = |i| found.and_then(|(_, numbers)| numbers.get(i)).copied().unwrap_or(f64::NAN);
        std::array::from_fn(at)
    }

    /// A sign or the sign of a word by its key.
    pub(super) fn sign(&self, key: &str) -> i32 {
        self.number(key) as i32
    }

    /// What moves on a linkage of `N` links; no `links` at all are massless ones.
    pub(super) fn inertia<const N: usize>(&self) -> Result<Inertia<N>, FieldError> {
        let Weights { handle_mass_kg, handle_inertia_kg_m2, links, shaft_inertia_kg_m2 } =
            self.weights;
        if !links.is_empty() && links.len() != N {
            let (found, allowed) =
                (format!("{} entries", links.len()), format!("must be none or {N} entries"));
            return Err(FieldError::new("inertia.links", found, allowed));
        }
        let usual = Inertia::<N>::default();
        Ok(Inertia {
            handle_mass_kg: *handle_mass_kg,
            handle_inertia_kg_m2: handle_inertia_kg_m2.unwrap_or(usual.handle_inertia_kg_m2),
            links: std::array::from_fn(|i| links.get(i).copied().unwrap_or_default()),
            shaft_inertia_kg_m2: *shaft_inertia_kg_m2,
        })
    }

    fn named(&self) -> Vec<(String, f64)> {
        self.values.iter().flat_map(|(key, numbers)| key.named(numbers)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weights() -> Weights {
        Weights {
            handle_mass_kg: 0.5,
            handle_inertia_kg_m2: None,
            links: Vec::new(),
            shaft_inertia_kg_m2: ActuatorVector::zeros(),
        }
    }

    /// Values that every key of a kind accepts.
    fn accepted(kind: &Kind) -> BTreeMap<String, Value> {
        let value = |form: &Form| match form {
            Form::Number(_) => Some(Value::Number(0.1)),
            Form::Numbers(count, _) => Some(Value::List(vec![Value::Number(0.1); *count])),
            _ => None,
        };
        let given = kind.keys.iter().filter_map(|key| Some((key.name, value(&key.form)?)));
        let mut table: BTreeMap<_, _> =
            given.map(|(name, value)| (name.to_owned(), value)).collect();
        table.insert("kind".to_owned(), Value::Text(kind.name.to_owned()));
        table
    }

    fn refusal(table: &BTreeMap<String, Value>) -> String {
        build(table, &weights()).unwrap_err().to_string()
    }

    #[test]
    fn every_kind_builds_itself_from_nothing_but_its_required_keys() {
        for kind in KINDS {
            let (mechanism, named) = build(&accepted(kind), &weights()).expect(kind.name);
            assert_eq!(mechanism.name(), kind.name);
            assert!(named.len() >= kind.keys.len() && named.iter().all(|(_, x)| x.is_finite()));
        }
    }

    #[test]
    fn every_key_refuses_what_is_not_of_its_form() {
        for kind in KINDS {
            for key in kind.keys {
                let nothing = Value::Other(serde::de::IgnoredAny);
                let bad = [Value::Number(f64::NAN), Value::Text("much".into()), nothing];
                for value in bad {
                    let mut table = accepted(kind);
                    table.insert(key.name.to_owned(), value.clone());
                    let said = refusal(&table);
                    let begins = format!("mechanism.{} = {value}: must be ", key.name);
                    assert!(said.starts_with(&begins), "{said}");
                }
            }
        }
    }

    #[test]
    fn keys_of_other_kinds_are_told_from_keys_of_none() {
        for kind in KINDS {
            let others =
                KINDS.iter().flat_map(|other| other.keys).filter(|key| !kind.has(key.name));
            for key in others {
                let mut table = accepted(kind);
                table.insert(key.name.to_owned(), Value::Number(1.0));
                let said = refusal(&table);
                assert!(said.starts_with(&format!("mechanism.{} = (set): is a key of", key.name)));
                assert!(said.ends_with(&format!(", not of {:?}", kind.name)), "{said}");
            }
            let mut table = accepted(kind);
            table.insert("colour".to_owned(), Value::Text("red".into()));
            let said = refusal(&table);
            assert!(said.starts_with("mechanism.colour = \"red\": unknown field, expected one of"));
        }
    }

    #[test]
    fn a_missing_key_and_an_unknown_kind_are_named() {
        for kind in KINDS {
            let mut table = accepted(kind);
            let required = kind.keys.iter().find(|key| key.form.usual().is_none()).expect("one");
            table.remove(required.name);
            assert!(
                refusal(&table).starts_with(&format!("mechanism.{} = (missing)", required.name))
            );
            table.insert("kind".to_owned(), Value::Number(4.0));
            let said = refusal(&table);
            assert!(said.starts_with("mechanism.kind = 4: must be one of"), "{said}");
            assert!(said.contains(kind.name));
        }
        assert!(refusal(&BTreeMap::new()).starts_with("mechanism.kind = (missing)"));
    }
}

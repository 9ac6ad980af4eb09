//! A value in a grid, and a combination of them.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// A value in a grid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Value {
    /// Whole number.
    Integer(i64),
    /// Number.
    Float(f64),
    /// Switch.
    Switch(bool),
    /// Word.
    Word(String),
}

impl std::fmt::Display for Value {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Value::Integer(x) => write!(f, "{x}"),
            Value::Float(x) => write!(f, "{x}"),
            Value::Switch(x) => write!(f, "{x}"),
            Value::Word(x) => write!(f, "{x}"),
        }
    }
}

impl std::str::FromStr for Value {
    type Err = std::convert::Infallible;

    /// The type of a text.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let number =
            || text.parse().map(Value::Integer).or_else(|_| text.parse().map(Value::Float));
        let switch = || text.parse().map(Value::Switch);
        Ok(number().or_else(|_| switch()).unwrap_or_else(|_| Value::Word(text.to_owned())))
    }
}

impl Value {
    pub(super) fn number(&self) -> Option<f64> {
        match self {
            Value::Integer(x) => Some(*x as f64),
            Value::Float(x) => Some(*x),
            Value::Switch(_) | Value::Word(_) => None,
        }
    }
}

/// One combination of values.
pub type Combination = BTreeMap<String, Value>;

/// The folder name of a combination; other characters are replaced.
pub fn slug(values: &Combination) -> String {
    let text: Vec<String> = values.iter().map(|(k, v)| format!("{k}-{v}")).collect();
    let plain = |c: char| if c.is_ascii_alphanumeric() || "-._+".contains(c) { c } else { '_' };
    text.join("_").chars().map(plain).collect()
}

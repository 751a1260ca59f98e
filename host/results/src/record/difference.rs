//! Two runs of one scenario against each other: which numbers differ, and by how much.

use std::{collections::BTreeMap, fmt};

use serde_json::Value;

use super::RunRecord;

/// Fields that are never twice the same, or follow from the rest.
const NOT_COMPARED: [&str; 2] = ["wall_seconds", "summary"];
/// Fields that differ are printed up to here.
const IN_FULL: usize = 20;

/// Why two records cannot be compared.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CompareError {
    /// Of different scenarios or paths.
    #[error("one run is of {0}, the other of {1}: only runs of one scenario can be compared")]
    Scenario(String, String),
    /// A record is no JSON.
    #[error("a record cannot be compared: {0}")]
    Json(#[from] serde_json::Error),
}

/// Differences between two records.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Difference {
    /// Numbers that differ by more than was allowed, by field; `*` stands for any node, stop or
    /// place of an array.
    pub numbers: BTreeMap<String, NumberDifference>,
    /// Other differences: texts, `null` against a value, longer lists.
    pub others: Vec<String>,
    /// Number of numbers that were compared.
    pub compared: usize,
}

/// Differences between the numbers of one field.
#[derive(Clone, Debug, PartialEq)]
pub struct NumberDifference {
    /// Number of them that differ.
    pub count: usize,
    /// The largest difference.
    pub largest: f64,
    /// Where that is.
    pub place: String,
    /// The two values there.
    pub values: [f64; 2],
}

impl Difference {
    /// Between two records, leaving out the time the computer took and the summary, which follows
    /// from the nodes. Numbers may differ by
    /// `tolerance` times the larger of 1 and their size; 0 asks for the very same numbers.
    ///
    /// # Errors
    /// [`CompareError`]
    pub fn between(
        one: &RunRecord,
        other: &RunRecord,
        tolerance: f64,
    ) -> Result<Self, CompareError> {
        Self::is_possible(&one.scenario, one.path, other)?;
        let mut difference = Self::default();
        let (one, other) = (serde_json::to_value(one)?, serde_json::to_value(other)?);
        difference.compare(&one, &other, &Path::default(), tolerance);
        Ok(difference)
    }

    /// Checks that a run of this scenario and path can be compared with this record.
    ///
    /// # Errors
    /// [`CompareError::Scenario`]
    pub fn is_possible(
        scenario: &str,
        path: Option<u32>,
        other: &RunRecord,
    ) -> Result<(), CompareError> {
        if (scenario, path) == (&other.scenario, other.path) {
            return Ok(());
        }
        let [one, other] = [(scenario, path), (&other.scenario, other.path)]
            .map(|(scenario, path)| super::name(scenario, path));
        Err(CompareError::Scenario(one, other))
    }

    /// Returns true if nothing differs.
    pub fn is_none(&self) -> bool {
        self.numbers.is_empty() && self.others.is_empty()
    }

    /// 0 if nothing differs, otherwise 1.
    pub fn exit_code(&self) -> u8 {
        u8::from(!self.is_none())
    }

    // As deep as a record is, which is a handful.
    fn compare(&mut self, one: &Value, other: &Value, at: &Path, tolerance: f64) {
        match (one, other) {
            (Value::Number(a), Value::Number(b)) => {
                self.compared += 1;
                let same = a == b;
                if let (false, Some(a), Some(b)) = (same, a.as_f64(), b.as_f64()) {
                    self.compare_numbers([a, b], at, tolerance);
                }
            }
            (Value::Array(a), Value::Array(b)) => {
                if a.len() != b.len() {
                    let what = format!("{} has {} and {} entries", at.exact, a.len(), b.len());
                    self.others.push(what);
                }
                for (place, (a, b)) in a.iter().zip(b).enumerate() {
                    self.compare(a, b, &at.entry(place, a), tolerance);
                }
            }
            (Value::Object(a), Value::Object(b)) => {
                let only_b = b.keys().filter(|key| !a.contains_key(*key));
                for key in a
                    .keys()
                    .chain(only_b)
                    .filter(|key| !NOT_COMPARED.contains(&key.as_str()))
                {
                    let (a, b) = (a.get(key), b.get(key));
                    let [a, b] = [a, b].map(|v| v.unwrap_or(&Value::Null));
                    self.compare(a, b, &at.field(key), tolerance);
                }
            }
            (a, b) if a != b => {
                let short = |value: &Value| match value {
                    Value::Array(_) | Value::Object(_) => "a value".to_owned(),
                    value => value.to_string(),
                };
                let what = format!("{}: {} and {}", at.exact, short(a), short(b));
                self.others.push(what);
            }
            _ => {}
        }
    }

    fn compare_numbers(&mut self, values: [f64; 2], at: &Path, tolerance: f64) {
        let [a, b] = values;
        let off = (a - b).abs();
        // They differ; large whole numbers may be the same as floating-point ones all the same.
        if tolerance > 0.0 && off <= tolerance * a.abs().max(b.abs()).max(1.0) {
            return;
        }
        let entry = self.numbers.entry(at.general.clone());
        let known = entry.or_insert_with(|| NumberDifference {
            count: 0,
            largest: f64::NEG_INFINITY,
            place: String::new(),
            values,
        });
        known.count += 1;
        if off > known.largest {
            known.largest = off;
            known.values = values;
            known.place.clone_from(&at.exact);
        }
    }
}

/// Where in a record, exactly and with `*` for places in arrays.
#[derive(Default)]
struct Path {
    exact: String,
    general: String,
}

impl Path {
    fn field(&self, name: &str) -> Self {
        let append = |path: &String| match path.as_str() {
            "" => name.to_owned(),
            path => format!("{path}.{name}"),
        };
        Self {
            exact: append(&self.exact),
            general: append(&self.general),
        }
    }

    /// An entry is called by its number if it has one.
    fn entry(&self, place: usize, value: &Value) -> Self {
        let number = |key| value.get(key).and_then(Value::as_u64);
        let name = match (number("stop"), number("id").or(number("network"))) {
            (Some(stop), _) => format!("stop {stop}"),
            (None, Some(id)) => id.to_string(),
            (None, None) => place.to_string(),
        };
        Self {
            exact: format!("{}[{name}]", self.exact),
            general: format!("{}[*]", self.general),
        }
    }
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_none() {
            return writeln!(f, "The runs agree in all {} numbers.", self.compared);
        }
        let differing: usize = self.numbers.values().map(|n| n.count).sum();
        writeln!(
            f,
            "The runs differ in {differing} of {} numbers, and in {} other things:",
            self.compared,
            self.others.len()
        )?;
        let numbers = self.numbers.iter().map(|(name, n)| {
            let [a, b] = n.values;
            let (count, largest, place) = (n.count, n.largest, &n.place);
            format!("{name}: {count}, at most by {largest:.3e} ({place}: {a:.6} and {b:.6})")
        });
        let lines: Vec<String> = self.others.iter().cloned().chain(numbers).collect();
        for line in lines.iter().take(IN_FULL) {
            writeln!(f, "  {line}")?;
        }
        if let Some(more @ 1..) = lines.len().checked_sub(IN_FULL) {
            writeln!(f, "  {more} more fields")?;
        }
        Ok(())
    }
}

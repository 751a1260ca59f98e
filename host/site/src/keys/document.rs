//! A file against the list of its keys.

use toml::{
    Spanned,
    de::{DeTable, DeValue},
};

use super::{KEYS, Key, Kind, Without, limits::LARGE};
use crate::{check::refuse, error::ScenarioError, meant};

type Value<'a> = Spanned<DeValue<'a>>;

/// Refuses a key that there is not, and a value that a key may not have.
pub(crate) fn check(text: &str) -> Result<(), ScenarioError> {
    let document = DeTable::parse(text)?;
    table(document.get_ref(), 0, "", "").map_err(|(error, at)| error.at_line(line(text, at)))
}

type Checked = Result<(), (ScenarioError, usize)>;

/// `at` is where the table begins, `path` is that of the key list, `name` what people call the table.
fn table(table: &DeTable<'_>, at: usize, path: &str, name: &str) -> Checked {
    for (key, value) in table {
        let own = key.get_ref().as_ref();
        let field = join(name, own);
        let Some(known) = find(path, own) else {
            let error = ScenarioError::Key {
                key: own.into(),
                place: place(name),
                nearest: nearest(path, own),
                line: None,
            };
            return Err((error, key.span().start));
        };
        self::value(value, known, known.path, &field)?;
    }
    let is_missing =
        |key: &&Key| matches!(key.default, Without::Needed) && !table.contains_key(name_of(key));
    match siblings(path).find(is_missing) {
        Some(key) => Err((
            ScenarioError::Missing {
                key: name_of(key).into(),
                place: place(name),
                example: format!("{} = {}", name_of(key), example(key)),
                what: key.what,
                line: None,
            },
            at,
        )),
        None => Ok(()),
    }
}

/// Place of a key in a message.
fn place(table: &str) -> String {
    match table {
        "" => "at the top of the file".into(),
        name => format!("in `{name}`"),
    }
}

/// A value that may be written for a key.
fn example(key: &Key) -> String {
    let numbers = |count: usize, low: f64| {
        let numbers = (0..count).map(|n| short(low + n as f64));
        format!("[{}]", numbers.collect::<Vec<_>>().join(", "))
    };
    let table = || {
        let needed = siblings(key.path).filter(|key| matches!(key.default, Without::Needed));
        let needed = needed.map(|key| format!("{} = {}", name_of(key), example(key)));
        format!("{{ {} }}", needed.collect::<Vec<_>>().join(", "))
    };
    match key.kind {
        Kind::Number(low, high, _) => format!("{:?}", 1.0_f64.clamp(low, high)),
        Kind::Whole(low, high, _) => short(1.0_f64.clamp(low, high)),
        Kind::Wholes(low, ..) => numbers(1, low),
        Kind::Numbers(count, low, high, _) => numbers(count, 0.0_f64.clamp(low, high)),
        Kind::Levels(count, low, ..) => numbers(count, low),
        Kind::Places(least, ..) => {
            let places = (0..least).map(|n| format!("[{n}.0, 0.0]"));
            format!("[{}]", places.collect::<Vec<_>>().join(", "))
        }
        Kind::Flag => "true".into(),
        Kind::Text | Kind::Texts => "\"my site\"".into(),
        Kind::Choice(names) => format!("\"{}\"", names.first().unwrap_or(&"")),
        Kind::OneOf(numbers) => numbers.first().map_or_else(String::new, u32::to_string),
        Kind::Table | Kind::Rates => table(),
        Kind::Tables => format!("[{}]", table()),
        Kind::Same(other) => {
            let same = KEYS.iter().find(|key| key.path == other);
            same.map_or_else(String::new, example)
        }
    }
}

fn join(name: &str, own: &str) -> String {
    match name {
        "" => own.into(),
        name => format!("{name}.{own}"),
    }
}

/// The key of this name in a table.
fn find(path: &str, own: &str) -> Option<&'static Key> {
    siblings(path).find(|key| name_of(key) == own)
}

fn siblings(path: &str) -> impl Iterator<Item = &'static Key> {
    KEYS.iter()
        .filter(move |key| key.path.rsplit_once('.').map_or("", |(parent, _)| parent) == path)
}

fn name_of(key: &Key) -> &'static str {
    let name = key.path.rsplit_once('.').map_or(key.path, |(_, name)| name);
    name.trim_end_matches("[]")
}

/// The key that was probably meant.
fn nearest(path: &str, own: &str) -> Option<String> {
    if let Some(name) = meant::nearest(own, siblings(path).map(name_of)) {
        return Some(name.into());
    }
    // It may belong elsewhere.
    let elsewhere = KEYS.iter().find(|key| name_of(key) == own)?;
    Some(elsewhere.path.into())
}

/// Returns true if it is one of these, or the other spelling of a lens.
fn is_choice(names: &[&str], text: &str) -> bool {
    let text = match text {
        "pinhole" => "pin-hole",
        text => text,
    };
    names.contains(&text)
}

fn value(value: &Value<'_>, key: &Key, path: &str, field: &str) -> Checked {
    let wrong = |found: String| {
        let error = refuse(field, found, key.kind.to_string());
        Err((error, value.span().start))
    };
    let found = value.get_ref();
    match key.kind {
        Kind::Same(other) => match KEYS.iter().find(|key| key.path == other) {
            Some(same) => self::value(value, same, other, field),
            None => Ok(()),
        },
        Kind::Number(low, high, unit) => match number(found) {
            Some(number) if (low..=high).contains(&number) => Ok(()),
            Some(number) if unit.starts_with(DEGREES) && is_angle(number, low, high) => {
                let degrees = number.to_degrees();
                let allowed = format!("{}: is it in radians? Then write {degrees:.1}", key.kind);
                Err((refuse(field, show(found), allowed), value.span().start))
            }
            _ => wrong(show(found)),
        },
        Kind::Whole(low, high, _) => match whole(found) {
            Some(number) if (low..=high).contains(&number) => Ok(()),
            _ => wrong(show(found)),
        },
        Kind::Wholes(low, high, _) => match list(found, whole) {
            Some(all) if !all.is_empty() && all.iter().all(|n| (low..=high).contains(n)) => Ok(()),
            _ => wrong(show(found)),
        },
        Kind::Numbers(count, low, high, _) => match list(found, number) {
            Some(all) if all.len() == count && all.iter().all(|n| (low..=high).contains(n)) => {
                Ok(())
            }
            _ => wrong(show(found)),
        },
        Kind::Levels(count, low, high, _) => match list(found, whole) {
            Some(all) if all.len() == count && all.iter().all(|n| (low..=high).contains(n)) => {
                Ok(())
            }
            _ => wrong(show(found)),
        },
        Kind::Places(least, most, _) => {
            let Some(places) = found.as_array() else {
                return wrong(show(found));
            };
            for (n, place) in (1..).zip(places.iter()) {
                let pair = list(place.get_ref(), number);
                let is_place = |pair: &Vec<f64>| {
                    pair.len() == 2 && pair.iter().all(|c| (-LARGE..=LARGE).contains(c))
                };
                if !pair.as_ref().is_some_and(is_place) {
                    let allowed =
                        format!("a place `[x, y]`: two numbers, each {} to {LARGE}", -LARGE);
                    let error = refuse(
                        format!("{field}, place {n}"),
                        show(place.get_ref()),
                        allowed,
                    );
                    return Err((error, place.span().start));
                }
            }
            match places.len() {
                count if (least..=most).contains(&count) => Ok(()),
                1 => wrong("1 place".into()),
                count if count > most => {
                    let allowed = format!("{most} places or fewer: a target counts no further");
                    let error = refuse(field, format!("{count} places"), allowed);
                    Err((error, value.span().start))
                }
                count => wrong(format!("{count} places")),
            }
        }
        Kind::Flag if found.is_bool() => Ok(()),
        Kind::Text
            if found
                .as_str()
                .is_some_and(|text| !text.contains(char::is_control)) =>
        {
            Ok(())
        }
        Kind::Texts if found.is_str() => Ok(()),
        Kind::Choice(names) if found.as_str().is_some_and(|text| is_choice(names, text)) => Ok(()),
        Kind::Choice(names) => {
            let text = found.as_str().unwrap_or("");
            let hint = meant::nearest(text, names.iter().copied());
            let hint = meant::question(hint.map(|name| format!("\"{name}\"")));
            let allowed = format!("{}{hint}", key.kind);
            Err((refuse(field, show(found), allowed), value.span().start))
        }
        Kind::OneOf(all) => match whole(found) {
            Some(number) if all.iter().any(|&one| f64::from(one) == number) => Ok(()),
            _ => wrong(show(found)),
        },
        Kind::Table => match found.as_table() {
            Some(own) => table(own, value.span().start, path, field),
            None => wrong(show(found)),
        },
        Kind::Tables => {
            let Some(all) = found.as_array() else {
                let hint = match found.as_table() {
                    Some(_) => format!(
                        ": write `[[{}]]`, with two brackets",
                        path.replace("[]", "")
                    ),
                    None => String::new(),
                };
                let allowed = format!("{}{hint}", key.kind);
                return Err((refuse(field, show(found), allowed), value.span().start));
            };
            for (n, one) in (1..).zip(all.iter()) {
                let name = format!("{field} {n}");
                match one.get_ref().as_table() {
                    Some(own) => table(own, one.span().start, path, &name)?,
                    None => {
                        let error = refuse(name, show(one.get_ref()), "a table");
                        return Err((error, one.span().start));
                    }
                }
            }
            Ok(())
        }
        Kind::Rates => {
            let Some(rates) = found.as_table() else {
                return wrong(show(found));
            };
            let mut all = rates.iter();
            match all.find(|(_, rate)| number(rate.get_ref()).is_none()) {
                Some((name, rate)) => {
                    let field = format!("{field}.{}", name.get_ref());
                    let error = refuse(field, show(rate.get_ref()), "a number");
                    Err((error, rate.span().start))
                }
                None => Ok(()),
            }
        }
        Kind::Flag | Kind::Text | Kind::Texts => wrong(show(found)),
    }
}

/// The unit of angles, as kinds have it.
const DEGREES: &str = " degrees";

/// Returns true if a number would be an angle in this range, degrees, if it were radians.
fn is_angle(number: f64, low: f64, high: f64) -> bool {
    number.abs() <= std::f64::consts::TAU && (low..=high).contains(&number.to_degrees())
}

fn whole(value: &DeValue<'_>) -> Option<f64> {
    let integer = value.as_integer()?;
    let number = i128::from_str_radix(integer.as_str(), integer.radix()).ok()?;
    Some(number as f64)
}

fn number(value: &DeValue<'_>) -> Option<f64> {
    match value.as_float() {
        Some(float) => float.as_str().parse().ok(),
        None => whole(value),
    }
}

fn list<T>(value: &DeValue<'_>, one: impl Fn(&DeValue<'_>) -> Option<T>) -> Option<Vec<T>> {
    let all = value.as_array()?.iter();
    all.map(|value| one(value.get_ref())).collect()
}

/// As it may stand in a message.
fn show(value: &DeValue<'_>) -> String {
    match value {
        DeValue::Array(all) => {
            let all: Vec<_> = all.iter().map(|one| show(one.get_ref())).collect();
            format!("[{}]", all.join(", "))
        }
        DeValue::Table(_) => "a table".into(),
        // A number in quotes is none.
        DeValue::String(text) if text.trim().parse::<f64>().is_ok() => {
            format!("a text, \"{}\"", text.escape_debug())
        }
        DeValue::String(text) => text.escape_debug().to_string(),
        value => number(value).map_or_else(|| shown(value), short),
    }
}

/// All digits of a number that people write out.
pub(super) fn short(number: f64) -> String {
    match number.abs() {
        0.0 | 1e-6..1e16 => number.to_string(),
        _ => format!("{number:e}"),
    }
}

fn shown(value: &DeValue<'_>) -> String {
    match value.as_bool() {
        Some(flag) => flag.to_string(),
        None => value.type_str().into(),
    }
}

fn line(text: &str, at: usize) -> usize {
    1 + text.bytes().take(at).filter(|&byte| byte == b'\n').count()
}

/// The line of what people call so, such as `network 1.camera 3.x`: its own, or that of the table
/// where it should be. `None` if not even that is in the file.
pub(crate) fn line_of(text: &str, field: &str) -> Option<usize> {
    let document = DeTable::parse(text).ok()?;
    let mut here = document.get_ref();
    let mut found = None;
    let field = field.split([',', '(']).next().unwrap_or(field).trim_end();
    for part in field.split('.') {
        let (name, number) = match part.split_once(' ') {
            Some((name, number)) => (name, number.parse::<usize>().ok()),
            None => (part, None),
        };
        // An event's action is a table in the event.
        let action = || {
            let action = here.get("action")?.get_ref().as_table()?;
            let (_, what) = action.iter().next()?;
            what.get_ref().as_table()?.get(name)
        };
        let Some(mut value) = here.get(name).or_else(action) else {
            break;
        };
        if let (Some(number), Some(all)) = (number, value.get_ref().as_array()) {
            match all.get(number.wrapping_sub(1)) {
                Some(one) => value = one,
                None => break,
            }
        }
        found = Some(line(text, value.span().start));
        match value.get_ref().as_table() {
            Some(table) => here = table,
            None => break,
        }
    }
    found
}

//! The text of a site's file, changed only where the user changed something.

use serde::Serialize;
use site::{NetworkTable, OutlineTable, PillarTable, Scenario};
use toml_edit::{
    Array, ArrayOfTables, DocumentMut, InlineTable, Item, Table, TableLike, Value, value,
};

use super::{EditError, Hindrance, Placed};

/// Tables that are written in place of a grid.
#[derive(Serialize)]
struct Expanded<'a> {
    network: &'a [NetworkTable],
}

pub(super) fn network(document: &mut DocumentMut, n: usize) -> Option<&mut dyn TableLike> {
    match document.get_mut("network")? {
        Item::ArrayOfTables(tables) => Some(tables.get_mut(n)? as &mut dyn TableLike),
        Item::Value(Value::Array(array)) => {
            Some(array.get_mut(n)?.as_inline_table_mut()? as &mut dyn TableLike)
        }
        _ => None,
    }
}

/// Writes the networks that a grid made in its place, and the place that holds them.
pub(super) fn write_out(document: &mut DocumentMut, scenario: &Scenario) -> Result<(), EditError> {
    let network = &scenario.networks[..];
    let written: DocumentMut = toml::to_string(&Expanded { network })?.parse()?;
    for (key, item) in written.iter() {
        document.insert(key, item.clone());
    }
    let world = world(document)?;
    for (key, corner) in [("low", scenario.world.low), ("high", scenario.world.high)] {
        world.insert(key, value(Array::from_iter(corner)));
    }
    Ok(())
}

fn world(document: &mut DocumentMut) -> Result<&mut dyn TableLike, EditError> {
    let world = document.entry("world").or_insert(Item::Table(Table::new()));
    world.as_table_like_mut().ok_or(EditError::Unknown("world"))
}

/// Rounds to the digits of a tape measure.
fn rounded(number: f64) -> f64 {
    (number * 1e4).round() / 1e4
}

/// Sets a number and keeps its comment; changes nothing if the number is the same.
fn set(table: &mut dyn TableLike, key: &str, number: f64) {
    match table.get_mut(key).and_then(Item::as_value_mut) {
        Some(old) => set_value(old, number),
        None => {
            let mut new = Value::from(rounded(number));
            if let Some(space) = space_at_end(table) {
                new.decor_mut().set_suffix(space);
            }
            table.insert(key, Item::Value(new));
        }
    }
}

/// Removes a key. The space before the end of an inline table stays.
fn remove(table: &mut dyn TableLike, key: &str) {
    let is_last = table.iter().last().is_some_and(|(last, _)| last == key);
    let space = if is_last { space_at_end(table) } else { None };
    table.remove(key);
    let last = table.iter_mut().last().map(|(_, item)| item);
    if let (Some(space), Some(last)) = (space, last.and_then(Item::as_value_mut)) {
        last.decor_mut().set_suffix(space);
    }
}

/// Takes the space before the end of an inline table from its last value: another one comes there.
fn space_at_end(table: &mut dyn TableLike) -> Option<String> {
    let (_, last) = table.iter_mut().last()?;
    let decor = last.as_value_mut()?.decor_mut();
    let space = decor.suffix()?.as_str()?.to_owned();
    space.trim().is_empty().then(|| {
        decor.set_suffix("");
        space
    })
}

fn set_value(old: &mut Value, number: f64) {
    let number = rounded(number);
    let known = old
        .as_float()
        .or(old.as_integer().map(|whole| whole as f64));
    if known.is_none_or(|known| (known - number).abs() > 5e-5) {
        let decor = old.decor().clone();
        *old = Value::from(number);
        *old.decor_mut() = decor;
    }
}

fn place(table: &mut dyn TableLike, new: &Placed) {
    set(table, "x", new.x);
    set(table, "y", new.y);
    set(table, "heading_deg", new.heading_deg);
    for (key, number) in new.mount() {
        match number {
            Some(number) => set(table, key, number),
            None => remove(table, key),
        }
    }
}

fn id_of(table: &dyn TableLike) -> Option<i64> {
    table.get("id")?.as_integer()
}

pub(super) fn cameras(network: &mut dyn TableLike, new: &[Placed], old: &[Placed]) {
    let is_kept = |id: Option<i64>| new.iter().any(|camera| Some(i64::from(camera.id)) == id);
    let of = |id: Option<i64>| new.iter().find(|camera| Some(i64::from(camera.id)) == id);
    let added = || {
        new.iter()
            .filter(|camera| old.iter().all(|known| known.id != camera.id))
    };
    match network
        .entry("camera")
        .or_insert(Item::ArrayOfTables(ArrayOfTables::new()))
    {
        Item::ArrayOfTables(tables) => {
            tables.retain(|table| is_kept(id_of(table)));
            for table in tables.iter_mut() {
                if let Some(new) = of(id_of(table)) {
                    place(table, new);
                }
            }
            for camera in added() {
                let mut table = Table::new();
                table.insert("id", value(i64::from(camera.id)));
                place(&mut table, camera);
                tables.push(table);
            }
        }
        Item::Value(Value::Array(array)) => {
            let of_value = |one: &Value| one.as_inline_table().and_then(|table| id_of(table));
            array.retain(|one| is_kept(of_value(one)));
            for one in array.iter_mut() {
                let id = of_value(one);
                if let (Some(new), Some(table)) = (of(id), one.as_inline_table_mut()) {
                    place(table, new);
                }
            }
            for camera in added() {
                let mut table = InlineTable::new();
                table.insert("id", Value::from(i64::from(camera.id)));
                place(&mut table, camera);
                append(array, Value::InlineTable(table));
            }
        }
        _ => {}
    }
}

/// Puts a value on a line of its own, if the others are on theirs.
fn append(array: &mut Array, mut value: Value) {
    let prefix = { array.iter().last() }
        .and_then(|last| last.decor().prefix()?.as_str())
        .and_then(|prefix| Some(prefix[prefix.rfind('\n')?..].to_owned()));
    if let Some(prefix) = prefix {
        value.decor_mut().set_prefix(prefix);
        array.push_formatted(value);
    } else {
        array.push(value);
    }
}

pub(super) fn numbers_of(obstacle: &OutlineTable) -> Vec<f64> {
    match obstacle {
        OutlineTable::Wall(corners) | OutlineTable::Block(corners) => corners.concat(),
        &OutlineTable::Pillar(PillarTable { x, y, radius }) => vec![x, y, radius],
    }
}

/// An obstacle as a file has it: the name of its kind, and its numbers.
fn written(obstacle: &OutlineTable) -> (&'static str, Value) {
    let corners = |corners: &[[f64; 2]]| {
        let corner = |corner: &[f64; 2]| Value::from_iter(corner.map(rounded));
        Value::Array(corners.iter().map(corner).collect())
    };
    match obstacle {
        OutlineTable::Wall(all) => ("wall", corners(all)),
        OutlineTable::Block(all) => ("block", corners(all)),
        &OutlineTable::Pillar(PillarTable { x, y, radius }) => {
            let numbers = [("x", x), ("y", y), ("radius", radius)];
            let numbers = numbers.map(|(key, number)| (key, rounded(number)));
            let table = InlineTable::from_iter(numbers);
            ("pillar", Value::InlineTable(table))
        }
    }
}

/// Changes the numbers of an obstacle of the file.
fn reshape(table: &mut dyn TableLike, obstacle: &OutlineTable) -> Result<(), EditError> {
    let (kind, new) = written(obstacle);
    let old = table.get_mut(kind).ok_or(EditError::Unknown(kind))?;
    if let (Some(old), &OutlineTable::Pillar(PillarTable { x, y, radius })) =
        (old.as_table_like_mut(), obstacle)
    {
        for (key, number) in [("x", x), ("y", y), ("radius", radius)] {
            set(old, key, number);
        }
        return Ok(());
    }
    let old = old.as_value_mut().ok_or(EditError::Unknown(kind))?;
    let corners = old.as_array_mut().ok_or(EditError::Unknown(kind))?;
    let pairs: Vec<_> = corners.iter_mut().filter_map(Value::as_array_mut).collect();
    if pairs.len() * 2 == numbers_of(obstacle).len() {
        let places = pairs.into_iter().flat_map(Array::iter_mut);
        for (place, number) in places.zip(numbers_of(obstacle)) {
            set_value(place, number);
        }
    } else {
        let decor = old.decor().clone();
        *old = new;
        *old.decor_mut() = decor;
    }
    Ok(())
}

pub(super) fn obstacles(
    document: &mut DocumentMut,
    new: &[Hindrance],
    count: usize,
) -> Result<(), EditError> {
    let kept: Vec<_> = { new.iter() }
        .filter_map(|one| Some((one.of?, &one.is)))
        .collect();
    let are_known = kept.iter().all(|(n, _)| *n < count);
    if !are_known || !kept.is_sorted_by(|(a, _), (b, _)| a < b) {
        return Err(EditError::Unknown("obstacle"));
    }
    let is_kept = |n: usize| kept.iter().any(|(of, _)| *of == n);
    let mut n = 0..;
    let mut keep = || n.next().is_some_and(is_kept);
    let added = new.iter().filter(|one| one.of.is_none());
    let added = added.map(|one| written(&one.is));
    let list = world(document)?
        .entry("obstacle")
        .or_insert(Item::ArrayOfTables(ArrayOfTables::new()));
    match list {
        Item::ArrayOfTables(tables) => {
            tables.retain(|_| keep());
            for (table, (_, is)) in tables.iter_mut().zip(&kept) {
                reshape(table, is)?;
            }
            for (kind, numbers) in added {
                let mut table = Table::new();
                table.insert(kind, value(numbers));
                tables.push(table);
            }
        }
        Item::Value(Value::Array(array)) => {
            array.retain(|_| keep());
            for (table, (_, is)) in array.iter_mut().zip(&kept) {
                let table = table.as_inline_table_mut();
                reshape(table.ok_or(EditError::Unknown("obstacle"))?, is)?;
            }
            for one in added {
                append(array, Value::InlineTable(InlineTable::from_iter([one])));
            }
        }
        _ => return Err(EditError::Unknown("obstacle")),
    }
    Ok(())
}

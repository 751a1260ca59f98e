//! Content of a linked image.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result};
use object::{Object, ObjectSection, ObjectSymbol, SymbolKind};

use super::thumb::{Decoder, Effect};
use crate::elf::{self, Size, is_loaded, is_writable};

/// An image.
pub(super) struct Image {
    pub(super) path: PathBuf,
    pub(super) size: Size,
    /// Name and bytes of the sections in the flash.
    pub(super) sections: Vec<(String, u64)>,
    /// Functions by address.
    pub(super) functions: BTreeMap<u32, Function>,
    /// Name and bytes of the symbols that take memory.
    pub(super) symbols: Vec<Symbol>,
    /// Functions that the processor calls: at the reset, and at exceptions and interrupts.
    pub(super) vectors: Vec<u32>,
    /// Functions whose address is kept somewhere, so that any code may call them.
    pub(super) kept: BTreeSet<u32>,
    /// Functions whose addresses are together in a constant, by its name.
    pub(super) tables: BTreeMap<String, Vec<u32>>,
}

pub(super) struct Symbol {
    pub(super) name: String,
    pub(super) size: u64,
    pub(super) is_variable: bool,
}

/// A function.
pub(super) struct Function {
    pub(super) name: String,
    pub(super) size: u32,
    /// Bytes of the stack that it takes, at most.
    pub(super) frame: u32,
    pub(super) calls: Vec<Call>,
    /// Branches within it.
    pub(super) jumps: Vec<Call>,
    /// Places where it calls through a pointer.
    pub(super) pointer_calls: Vec<u32>,
}

#[derive(Clone, Copy)]
pub(super) struct Call {
    pub(super) at: u32,
    pub(super) target: u32,
}

impl Image {
    pub(super) fn read(path: &Path) -> Result<Self> {
        let bytes = fs::read(path)?;
        let file = object::File::parse(&*bytes)
            .with_context(|| format!("{} is no image", path.display()))?;
        let mut image = Self {
            path: path.to_owned(),
            size: elf::size(&file).with_context(|| path.display().to_string())?,
            sections: file
                .sections()
                .filter(|section| elf::is_in_flash(section) && section.size() > 0)
                .map(|section| {
                    (
                        section.name().unwrap_or_default().to_owned(),
                        section.size(),
                    )
                })
                .collect(),
            functions: BTreeMap::new(),
            symbols: symbols(&file),
            vectors: Vec::new(),
            kept: BTreeSet::new(),
            tables: BTreeMap::new(),
        };
        image.find_functions(&file);
        image.disassemble(&file)?;
        Ok(image)
    }

    fn find_functions(&mut self, file: &object::File<'_>) {
        for symbol in file.symbols() {
            if symbol.kind() == SymbolKind::Text && symbol.size() > 0 {
                let function = Function {
                    name: demangle(symbol.name().unwrap_or_default()),
                    size: symbol.size() as u32,
                    frame: 0,
                    calls: Vec::new(),
                    jumps: Vec::new(),
                    pointer_calls: Vec::new(),
                };
                // The lowest bit says Thumb.
                self.functions
                    .insert(symbol.address() as u32 & !1, function);
            }
        }
    }

    fn disassemble(&mut self, file: &object::File<'_>) -> Result<()> {
        // Marks where data begins within code, and where code goes on (ELF for the Arm Architecture, "Mapping
        // symbols").
        let marks: BTreeMap<u32, bool> = file
            .symbols()
            .filter_map(|symbol| match symbol.name().ok()?.get(..2)? {
                "$t" => Some((symbol.address() as u32, true)),
                "$d" => Some((symbol.address() as u32, false)),
                _ => None,
            })
            .collect();
        let is_code = |at: u32| marks.range(..=at).next_back().is_none_or(|(_, code)| *code);
        let mut kept = BTreeSet::new();
        for section in file.sections() {
            let start = section.address() as u32;
            let data = section.data()?;
            if !is_loaded(&section) {
                continue;
            }
            if section.name() == Ok(".vector_table") {
                // The first word is the stack's.
                self.vectors = words(data)
                    .skip(1)
                    .map(|vector| vector & !1)
                    .filter(|vector| self.functions.contains_key(vector))
                    .collect();
                continue;
            }
            if section.kind() != object::SectionKind::Text {
                kept.extend(words(data));
                continue;
            }
            let end = start + data.len() as u32;
            let literal = |at: u32| {
                let from = at.checked_sub(start)? as usize;
                words(data.get(from..from + 4)?).next()
            };
            for (&address, function) in self.functions.range_mut(start..end) {
                let own = address..address + function.size;
                let mut decoder = Decoder::default();
                let mut at = address;
                while own.contains(&at) {
                    let code = &data[(at - start) as usize..];
                    if !is_code(at) {
                        kept.extend(words(&code[..4.min(code.len())]));
                        at += 4;
                        continue;
                    }
                    let (len, effect) = decoder
                        .next(at, code, literal)
                        .with_context(|| format!("{} is cut off", function.name))?;
                    match effect {
                        Some(Effect::Goes(target)) if !own.contains(&target) => {
                            function.calls.push(Call { at, target });
                        }
                        Some(Effect::GoesSomewhere) => function.pointer_calls.push(at),
                        Some(Effect::Pushes(bytes)) => function.frame += bytes,
                        Some(Effect::Holds(value)) => {
                            kept.insert(value);
                        }
                        Some(Effect::Goes(target)) => function.jumps.push(Call { at, target }),
                        Some(Effect::Loads(..)) | None => {}
                    }
                    at += len;
                }
            }
        }
        let is_function = |address: &u32| self.functions.contains_key(address);
        for symbol in file.symbols() {
            let section = symbol.section_index();
            let constant = section
                .filter(|_| symbol.kind() == SymbolKind::Data)
                .and_then(|index| file.section_by_index(index).ok())
                .and_then(|section| section.data_range(symbol.address(), symbol.size()).ok()?);
            let functions: Vec<u32> = words(constant.unwrap_or_default())
                .map(|word| word & !1)
                .filter(is_function)
                .collect();
            if !functions.is_empty() {
                let name = demangle(symbol.name().unwrap_or_default());
                self.tables.insert(name, functions);
            }
        }
        // As data they have the bit that says Thumb.
        self.kept = kept
            .into_iter()
            .filter(|value| value & 1 != 0)
            .map(|value| value & !1)
            .filter(is_function)
            .collect();
        Ok(())
    }
}

fn words(data: &[u8]) -> impl Iterator<Item = u32> {
    data.as_chunks::<4>()
        .0
        .iter()
        .map(|word| u32::from_le_bytes(*word))
}

fn symbols(file: &object::File<'_>) -> Vec<Symbol> {
    let mut symbols: Vec<_> = file
        .symbols()
        .filter(|symbol| symbol.size() > 0)
        .filter_map(|symbol| {
            let section = file.section_by_index(symbol.section_index()?).ok()?;
            is_loaded(&section).then(|| Symbol {
                name: demangle(symbol.name().unwrap_or_default()),
                size: symbol.size(),
                is_variable: is_writable(&section),
            })
        })
        .collect();
    symbols.sort_by_key(|symbol| std::cmp::Reverse(symbol.size));
    symbols
}

/// Without the hash at the end.
fn demangle(name: &str) -> String {
    format!("{:#}", rustc_demangle::demangle(name))
}

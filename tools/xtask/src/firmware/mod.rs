//! `cargo xtask firmware`: images for all boards, and the memory that they take.

mod grants;
mod image;
mod panics;
mod parts;
mod stack;
mod thumb;

use std::{
    env, fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, ensure};
use board_facts::{BOARDS, Board, chip::Family};
use comfy_table::{CellAlignment, Table, presets::ASCII_MARKDOWN};
use radio_update::stamp::Stamp;
use xshell::{Shell, cmd};

use self::{grants::Count, image::Image, stack::Worst};
use crate::{
    built,
    documented::{self, number},
    setup,
};

const TARGET: &str = "thumbv7em-none-eabihf";
const PROFILE: &str = "firmware";
/// Folder of the images.
const DIRECTORY: &str = "target/firmware";

/// Limit of inlining. At `opt-level = "z"` LLVM stops at 5, where many a call takes more than the function that is
/// called: with 25 the image of the nRF52840 is 3.5 KB smaller, with 15, 40 or 60 less than that.
const INLINING: &str = "-Cllvm-args=-inline-threshold=25";

/// Functions of the same instructions are linked once: no code compares addresses of functions.
const FOLDING: &str = "-Clink-arg=--icf=all";

/// Variables that make other images: the level of logs, for `defmt`, which is errors without it; and sizes of tables
/// (`node_firmware::limits`).
const VARIABLES: [&str; 4] = [SIZES[0], SIZES[1], SIZES[2], "DEFMT_LOG"];
const SIZES: [&str; 3] = ["NODE_MEMBERS", "NODE_CAMERAS", "NODE_STOPS"];

/// Sizes for a room, and the RAM that an image for all roles takes then at most.
const ROOM: [&str; 3] = ["10", "8", "24"];
const ROOM_RAM: u64 = 52 << 10;

/// Number of the largest symbols that are listed.
const LARGEST: usize = 12;

/// A board whose image is looked into, and the bytes that it may take. Images of other boards with its chip have the
/// same code.
struct Audited {
    board: &'static Board,
    /// Its name in the documentation.
    name: &'static str,
    budget: Budget,
}

/// Enforced limits, and the aims for the image.
struct Budget {
    flash: u64,
    ram: u64,
    stack: u64,
    aim: [u64; 3],
}

/// Memory of the thesis's node: a Jennic JN5121's ROM, and its RAM.
const THESIS: (u64, u64) = (64 << 10, 96 << 10);

const AUDITED: [Audited; 2] = [
    Audited {
        board: &board_facts::NRF52840_DK,
        name: "nRF52840",
        // The aims for flash and stack are not met. Enforced are the measured values, rounded up, so that they get
        // no worse: lower them when the image shrinks. 5.3 KB are the Pixy2's, which any node may have, 2.4 KB are
        // for bringing a target to another network and for the line of its stops, 2 KB for the judging of colours,
        // 17 KB for the tracking of objects, 12 KB for cameras that are not level, 2.5 KB for
        // sleep, 1.7 KB for an estimate in slices, 2 KB for the distortion of lenses, 0.7 KB for doubts about the frame;
        // the chip has 1 MB. Of the RAM 82 KB are the equations of the stops
        // that a target estimates together.
        budget: Budget {
            flash: 314 << 10,
            ram: 153 << 10,
            stack: 12 << 10,
            aim: [96 << 10, 120 << 10, 8 << 10],
        },
    },
    Audited {
        board: &board_facts::NUCLEO_L476RG,
        name: "NUCLEO-L476RG",
        // As above.
        budget: Budget {
            flash: 326 << 10,
            ram: 90 << 10,
            stack: 12 << 10,
            aim: [96 << 10, 120 << 10, 8 << 10],
        },
    },
];

/// A role that an image may have alone, and the most that such an image of the nRF52840 may take.
struct Role {
    /// Its name, and that of its feature.
    name: &'static str,
    flash: u64,
    ram: u64,
}

/// The camera's is promised: most nodes are cameras. The others are the measured values, rounded up.
const ROLES: [Role; 3] = [
    Role {
        name: "camera",
        flash: 200 << 10,
        ram: 32 << 10,
    },
    Role {
        name: "coordinator",
        flash: 134 << 10,
        ram: 53 << 10,
    },
    Role {
        name: "target",
        flash: 213 << 10,
        ram: 153 << 10,
    },
];

/// Names of the roles.
pub(crate) const ROLE_NAMES: [&str; 3] = [ROLES[0].name, ROLES[1].name, ROLES[2].name];

/// Builds the images of these boards, or of all, with these roles, or with all: `cargo xtask firmware`.
///
/// # Errors
/// There is no such board, or a check fails.
pub(crate) fn run(sh: &Shell, chosen: &[String], roles: &[String]) -> Result<()> {
    if chosen.is_empty() && roles.is_empty() {
        check(sh, &BOARDS)?;
        return check_roles(sh, &ROLES);
    }
    let boards = chosen.iter().map(|name| {
        Board::named(name).with_context(|| {
            let names = BOARDS.map(|board| board.name).join(", ");
            format!("no board is called `{name}`: there are {names}")
        })
    });
    let boards = boards.collect::<Result<Vec<_>>>()?;
    if roles.is_empty() {
        return check(sh, &boards);
    }
    let boards = if boards.is_empty() { &BOARDS } else { &*boards };
    let roles: Vec<_> = roles.iter().map(String::as_str).collect();
    for board in boards {
        pack(board, &build(sh, board, &roles)?)?;
    }
    Ok(())
}

/// Kits that have a USB plug of their chip beside that of their debug probe, which is a coordinator's line by default.
const KITS: [&Board; 2] = [&board_facts::NRF52840_DK, &board_facts::NRF52833_DK];

/// Builds images for kits whose coordinator has its PC at the plug of the chip: `cargo xtask firmware --usb`.
///
/// # Errors
/// A board is no such kit, or a check fails.
pub(crate) fn plugged(sh: &Shell, chosen: &[String], roles: &[String]) -> Result<()> {
    for name in chosen {
        let names = KITS.map(|board| board.name);
        ensure!(
            names.contains(&name.as_str()),
            "`{name}` is no kit with a plug of its chip and one of its probe: there are {}; an image of a board without \
             a probe speaks over its plug anyway",
            names.join(", ")
        );
    }
    let roles: Vec<_> = roles.iter().map(String::as_str).collect();
    let is_chosen =
        |board: &&Board| chosen.is_empty() || chosen.iter().any(|name| name == board.name);
    for board in KITS.into_iter().filter(is_chosen) {
        let image = pack(board, &build_plugged(sh, board, &roles)?)?;
        Count::new(&panics::find(&image)?).none_of_ours(board.name)?;
    }
    Ok(())
}

/// Builds an image whose coordinator has its PC at the plug of the chip, and returns its path.
pub(crate) fn build_plugged(sh: &Shell, board: &Board, roles: &[&str]) -> Result<PathBuf> {
    finish(sh, board, &Name::of(board, roles, Some("usb")))
}

/// Builds images of a version for updates by radio, and the boot loader: `cargo xtask firmware --update`.
///
/// # Errors
/// A board cannot be updated by radio, or a check fails.
pub(crate) fn updated(sh: &Shell, chosen: &[String], roles: &[String], version: u32) -> Result<()> {
    let can = || BOARDS.into_iter().filter(|board| board.updated.is_some());
    for name in chosen {
        let names: Vec<_> = can().map(|board| board.name).collect();
        ensure!(
            names.contains(&name.as_str()),
            "`{name}` is no board that can be updated by radio: there is {}",
            names.join(", ")
        );
    }
    let roles: Vec<_> = roles.iter().map(String::as_str).collect();
    for board in can() {
        let image = build_updated(sh, board, &roles, version)?;
        let read = Image::read(&image)?;
        println!(
            "{}: version {version}: {}, {}: {} bytes of flash",
            board.title,
            name(&image),
            name(&image.with_extension("bin")),
            read.size.flash
        );
    }
    let loader = loader(sh)?;
    let read = Image::read(&loader)?;
    println!(
        "boot loader: {}: {} bytes of flash",
        name(&loader),
        read.size.flash
    );
    Ok(())
}

/// Builds an image that is updated by radio, with a version, and returns its path. Beside it, with the ending `bin`,
/// are the bytes that a node takes by radio.
pub(crate) fn build_updated(
    sh: &Shell,
    board: &'static Board,
    roles: &[&str],
    version: u32,
) -> Result<PathBuf> {
    let name = Name::of(board, roles, Some("update"));
    let (path, mut elf) = compile(sh, board.name, &name.file, &name.features)?;
    let length = flash_file::updated(board, &elf)
        .with_context(|| self::name(&path))?
        .len();
    ensure!(
        Stamp::set_version(&mut elf, version, length),
        "{} has no stamp",
        path.display()
    );
    replace(&path, &elf)?;
    let bytes = flash_file::updated(board, &elf).with_context(|| self::name(&path))?;
    replace(&path.with_extension("bin"), &bytes)?;
    Ok(path)
}

/// Builds the boot loader, and returns its path.
pub(crate) fn loader(sh: &Shell) -> Result<PathBuf> {
    // With the image, which is built before: so their libraries are built once.
    let image = ["--package=nrf52840", "--features=nrf52840/update"].map(str::to_owned);
    let (path, elf) = compile(sh, "loader", "loader", &image)?;
    replace(&path, &elf)?;
    let bytes = flash_file::loader(&board_facts::NRF52840_DK, &elf)?;
    replace(&path.with_extension("bin"), &bytes)?;
    Ok(path)
}

/// The stage of every day: the images that are looked into, and a camera's alone.
pub(crate) fn audit(sh: &Shell) -> Result<()> {
    check(sh, &AUDITED.map(|audited| audited.board))?;
    check_roles(sh, &ROLES[..1])
}

/// The stage of the night: the images of all other boards, and of each role alone.
pub(crate) fn others(sh: &Shell) -> Result<()> {
    let is_audited = |board: &Board| AUDITED.iter().any(|known| known.board.name == board.name);
    let others = BOARDS.into_iter().filter(|board| !is_audited(board));
    check(sh, &others.collect::<Vec<_>>())?;
    check_sizes(sh)?;
    check_roles(sh, &ROLES)
}

/// Builds an image with the tables of a room, which must take less RAM.
fn check_sizes(sh: &Shell) -> Result<()> {
    let image = {
        let _sizes: Vec<_> = (SIZES.iter().zip(ROOM))
            .map(|(name, size)| sh.push_env(name, size))
            .collect();
        Image::read(&build(sh, &board_facts::NRF52840_DK, &[])?)?
    };
    let ram = image.size.ram;
    println!("all roles, with the tables of a room: {ram} bytes of RAM");
    ensure!(
        ram <= ROOM_RAM,
        "an image with the tables of a room may take {ROOM_RAM} bytes of RAM"
    );
    Ok(())
}

/// Builds an image for each of these roles alone, and fails over its limits or, where these are all roles, a figure in
/// the documentation that is another one.
fn check_roles(sh: &Shell, roles: &[Role]) -> Result<()> {
    let header = ["bytes, nRF52840 with one role", "flash", "static RAM"];
    let mut rows = vec![header.map(str::to_owned).to_vec()];
    for &Role { name, flash, ram } in roles {
        let image = Image::read(&build(sh, &board_facts::NRF52840_DK, &[name])?)?;
        let size = image.size;
        println!(
            "a {name} alone: {} bytes of flash, {} of RAM",
            size.flash, size.ram
        );
        ensure!(
            size.flash <= flash && size.ram <= ram,
            "a {name} alone may take {flash} bytes of flash and {ram} of RAM"
        );
        rows.push(vec![name.to_owned(), number(size.flash), number(size.ram)]);
    }
    if roles.len() < ROLES.len() {
        return Ok(());
    }
    let table = documented::Table {
        name: "firmware: roles",
        rows,
    };
    documented::agree(sh, "firmware", &[table])
}

/// Builds images, and the files with which their boards are flashed; prints the memory that they take, and fails over
/// a budget, a panic, a byte outside of the board's region or, where all audited ones are among them, a figure in the
/// documentation that is another one. Of other boards only panics of this project are looked for. Images for which one of
/// [`VARIABLES`] is set are only built: logging takes room and stack, and formats text.
fn check(sh: &Shell, boards: &[&'static Board]) -> Result<()> {
    let is_set = |name: &&str| env::var_os(name).is_some_and(|value| !value.is_empty());
    let variable = VARIABLES.into_iter().find(is_set);
    let mut measured = Vec::new();
    for board in boards {
        let image = pack(board, &build(sh, board, &[])?)?;
        let audited = AUDITED
            .iter()
            .position(|audited| audited.board.name == board.name);
        match (audited, variable) {
            (_, Some(_)) => {}
            (None, None) => Count::new(&panics::find(&image)?).none_of_ours(board.name)?,
            (Some(number), None) => {
                let stack = stack::worst(&image)?;
                measured.push((number, &AUDITED[number], image, stack));
            }
        }
    }
    if let Some(name) = variable {
        println!(
            "{name} is set: what these images take, and whether they can panic, is not checked."
        );
    }
    if measured.is_empty() {
        return Ok(());
    }
    println!("{}", table(&measured));
    println!(
        "The thesis's node had {} bytes of ROM and {} of RAM.",
        THESIS.0, THESIS.1
    );
    let mut failures = Vec::new();
    for (number, audited, image, stack) in &measured {
        println!("\n{}", largest(image));
        println!("\nFlash of {} by crate:", name(&image.path));
        for (part, bytes) in parts::by_crate(image)? {
            println!("{bytes:>6} {part}");
        }
        println!("{:>6} in all", image.size.flash);
        println!("\nThe deepest stack of {}:", name(&image.path));
        for (function, bytes) in &stack.path {
            println!("{bytes:>6} {function}");
        }
        failures.extend(over_budget(audited, image, stack.bytes));
        let panics = panics::find(image)?;
        let count = Count::new(&panics);
        let board = audited.board.name;
        println!("\nBranches to a panic that {board} never takes:");
        for line in count.lines() {
            println!("{line}");
        }
        let errors = count.errors(*number);
        failures.extend(errors.iter().map(|error| format!("{board}: {error}")));
    }
    println!("\nWhy they are not taken:");
    for reason in Count::reasons() {
        println!("       {reason}");
    }
    ensure!(failures.is_empty(), "\n  {}", failures.join("\n  "));
    if measured.len() == AUDITED.len() {
        documented::agree(sh, "firmware", &[memory(&measured), crates(&measured)?])?;
    }
    Ok(())
}

/// Checks that an image is within its board's region, and writes the file beside it that the board's boot loader
/// takes.
fn pack(board: &'static Board, path: &Path) -> Result<Image> {
    let elf = fs::read(path)?;
    let image = flash_file::Image::of(board, &elf).with_context(|| name(path))?;
    let mut files = name(path);
    if let Some((ending, bytes)) = image.file(None, false) {
        let file = path.with_extension(ending);
        replace(&file, &bytes)?;
        files = format!("{files}, {}", name(&file));
    }
    let image = Image::read(path)?;
    println!(
        "{}: {files}: {} bytes of flash, {} of static RAM",
        board.title, image.size.flash, image.size.ram
    );
    Ok(image)
}

/// Measurements of a board: its number, itself, its image and its stack.
type Measured = (usize, &'static Audited, Image, Worst);

fn header(what: &str) -> Vec<String> {
    let boards = AUDITED.iter().map(|audited| audited.name.to_owned());
    [what.to_owned()].into_iter().chain(boards).collect()
}

/// Memory that the images take, for the documentation.
fn memory(measured: &[Measured]) -> documented::Table {
    let mut rows = vec![header("bytes, `cargo xtask firmware`")];
    rows[0].extend(["aim", "thesis's node"].map(str::to_owned));
    let thesis = [number(THESIS.0), number(THESIS.1), String::new()];
    let what = ["flash", "static RAM", "deepest stack, computed"];
    for (i, (what, thesis)) in what.into_iter().zip(thesis).enumerate() {
        let mut row = vec![what.to_owned()];
        let mut aims = Vec::new();
        for (_, audited, image, stack) in measured {
            row.push(number([image.size.flash, image.size.ram, stack.bytes][i]));
            aims.push(audited.budget.aim[i]);
        }
        row.push(aims.first().map_or_else(String::new, |aim| number(*aim)));
        row.push(thesis);
        rows.push(row);
    }
    documented::Table {
        name: "firmware: memory",
        rows,
    }
}

/// Flash by groups of crates, for the documentation.
fn crates(measured: &[Measured]) -> Result<documented::Table> {
    let mut rows = vec![header("bytes of flash")];
    let parts: Vec<_> = measured
        .iter()
        .map(|(_, _, image, _)| Ok(parts::by_group(&parts::by_crate(image)?)))
        .collect::<Result<_>>()?;
    for (i, group) in parts::groups().enumerate() {
        let bytes = parts.iter().map(|parts| number(parts[i]));
        rows.push([group.to_owned()].into_iter().chain(bytes).collect());
    }
    let all = measured
        .iter()
        .map(|(_, _, image, _)| number(image.size.flash));
    rows.push(["in all".to_owned()].into_iter().chain(all).collect());
    Ok(documented::Table {
        name: "firmware: crates",
        rows,
    })
}

/// Builds an image with these roles, or with all, and returns its path.
pub(crate) fn build(sh: &Shell, board: &Board, roles: &[&str]) -> Result<PathBuf> {
    finish(sh, board, &Name::of(board, roles, None))
}

fn finish(sh: &Shell, board: &Board, name: &Name) -> Result<PathBuf> {
    let (path, elf) = compile(sh, board.name, &name.file, &name.features)?;
    replace(&path, &elf)?;
    Ok(path)
}

/// Name of the file of an image, and options for its features.
struct Name {
    file: String,
    features: Vec<String>,
}

impl Name {
    /// With a feature of the board's package, if any.
    fn of(board: &Board, roles: &[&str], feature: Option<&str>) -> Self {
        let mut file = board.name.to_owned();
        let mut features = Vec::new();
        if !roles.is_empty() {
            features.push("--no-default-features".to_owned());
        }
        for role in roles {
            file = format!("{file}-{role}");
            features.push(match board.chip.family {
                Family::Nrf52 => format!("--features=nrf52/{role}"),
                Family::Stm32l4 => format!("--features={role}"),
            });
        }
        if let Some(feature) = feature {
            file = format!("{file}-{feature}");
            features.push(format!("--features={feature}"));
        }
        Self {
            file: format!("{file}-node"),
            features,
        }
    }
}

/// Compiles the image of a package for the boards. Returns the path that it is to have, and the image.
fn compile(sh: &Shell, package: &str, name: &str, chosen: &[String]) -> Result<(PathBuf, Vec<u8>)> {
    sh.create_dir(DIRECTORY)?;
    let folder = sh.current_dir().join(DIRECTORY);
    // Stages side by side: images of other features are built at the same path.
    let lock = fs::File::create(folder.join("lock"))?;
    lock.lock()?;
    let built = built::program(&compiled(sh, package, chosen)?, package)?;
    let elf = fs::read(&built).with_context(|| format!("{} is missing", built.display()))?;
    Ok((folder.join(format!("{name}.elf")), elf))
}

/// Compiles a package as images are, and returns cargo's messages.
pub(crate) fn compiled(sh: &Shell, package: &str, chosen: &[String]) -> Result<String> {
    setup::image_compiler(sh, TARGET)?;
    setup::linker(sh)?;
    // Only here: other programs of this target have their own layout of the memory.
    let linker = format!("target.{TARGET}.linker='{}'", setup::LINKER);
    let mut flags = short_paths()?;
    flags.extend([INLINING, FOLDING].map(|flag| format!("'{flag}'")));
    let flags = format!("target.{TARGET}.rustflags=[{}]", flags.join(", "));
    let cargo = cmd!(
        sh,
        "cargo build --locked --ignore-rust-version --config {linker} --config {flags} --profile {PROFILE} --package {package} {chosen...} --target {TARGET} --message-format json-render-diagnostics"
    )
    .env("RUSTUP_TOOLCHAIN", setup::IMAGE_COMPILER);
    eprintln!("$ {cargo}");
    Ok(cargo.quiet().read()?)
}

/// Writes a file at once: a stage beside this one may read it just now.
fn replace(path: &Path, bytes: &[u8]) -> Result<()> {
    let new = path.with_added_extension(std::process::id().to_string());
    fs::write(&new, bytes)
        .and_then(|()| fs::rename(&new, path))
        .with_context(|| format!("{} cannot be written", path.display()))
}

/// Flags for the compiler, in quotes. Panics tell where they are: an image is not to have the names
/// of its builder's folders in it, nor to be as long as these. Only what is linked: debug information
/// keeps them.
fn short_paths() -> Result<Vec<String>> {
    let mut flags = vec!["'--remap-path-scope=macro'".to_owned()];
    for folder in built::registries()? {
        flags.push(format!("'--remap-path-prefix={}='", folder.display()));
    }
    flags.sort();
    Ok(flags)
}

/// The most bytes of stack that an image can take.
pub(crate) fn stack_bound(image: &Path) -> Result<u64> {
    Ok(stack::worst(&Image::read(image)?)?.bytes)
}

fn table(measured: &[Measured]) -> Table {
    let mut table = Table::new();
    table.load_style(ASCII_MARKDOWN);
    table.set_header(["bytes of", "flash", "static RAM", "stack, computed"]);
    for (_, _, image, stack) in measured {
        let row = [image.size.flash, image.size.ram, stack.bytes];
        let name = name(&image.path);
        table.add_row([name].into_iter().chain(row.map(|bytes| bytes.to_string())));
    }
    for (_, audited, ..) in measured {
        let budget = &audited.budget;
        let rows = [
            ("at most", [budget.flash, budget.ram, budget.stack]),
            ("aim", budget.aim),
        ];
        for (what, row) in rows {
            let name = format!("{}: {what}", audited.board.name);
            table.add_row([name].into_iter().chain(row.map(|bytes| bytes.to_string())));
        }
    }
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table
}

fn largest(image: &Image) -> Table {
    let mut table = Table::new();
    table.load_style(ASCII_MARKDOWN);
    table.set_header(["bytes", "in", &format!("of {}", name(&image.path))]);
    for symbol in image.symbols.iter().take(LARGEST) {
        let place = if symbol.is_variable { "RAM" } else { "flash" };
        table.add_row([&symbol.size.to_string(), place, &symbol.name]);
    }
    table
}

fn over_budget(audited: &Audited, image: &Image, stack: u64) -> Vec<String> {
    let budget = &audited.budget;
    [
        ("flash", image.size.flash, budget.flash),
        ("static RAM", image.size.ram, budget.ram),
        ("stack", stack, budget.stack),
    ]
    .into_iter()
    .filter(|(_, bytes, most)| bytes > most)
    .map(|(what, bytes, most)| {
        format!(
            "{} takes {bytes} bytes of {what}, its budget is {most}",
            audited.board.name
        )
    })
    .collect()
}

fn name(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

//! The project's chores.

mod cortex_m;

fn main() -> anyhow::Result<()> {
    let measurements = cortex_m::run(&xshell::Shell::new()?)?;
    println!("{}", cortex_m::table(&measurements));
    Ok(())
}

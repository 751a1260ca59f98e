//! Sightings of the object at known places.

use std::{
    io::{self, Write},
    path::Path,
};

use cmucam2_driver::colour::ColourBounds;
use host_sim::probe::{
    display::Degrees,
    record::{self, Recording, Row, SightingLine},
};
use node_firmware::vision::steady::{Shape, Steadiness, Steady, Unsteady};

use super::{Bench, Look, person::Person, spinner, tell};

/// Times the packets of a sighting after which the object is given up.
const PATIENCE: usize = 5;

/// The most packets of a sighting.
pub(super) const PACKETS_MAX: usize = 1000;

/// Why there is no sighting.
#[derive(Debug, thiserror::Error)]
enum NotSeen {
    #[error(transparent)]
    Unsteady(Unsteady),
    /// What it had adapted to is lost, and with it the colour.
    #[error(
        "the camera restarted meanwhile, and sees other colours now: start it up again, without \
         --as-is, and check its supply"
    )]
    Restarted,
    #[error("this camera counts columns otherwise than --first-column says")]
    Columns,
}

/// Records one sighting, or one for each line of the standard input.
pub(super) fn run(
    bench: &mut Bench<'_>,
    recording: &mut Recording,
    path: &Path,
    bounds: ColourBounds,
) -> anyhow::Result<()> {
    if let Some(place) = bench.arguments.at {
        let sighting = wait(bench, bounds)??;
        return keep(bench, recording, path, place, &sighting);
    }
    let mut kept = 0_usize;
    if Person::is_there() {
        tell("Put the object at a known place and type where that is. `q` or Ctrl-D ends.");
    }
    while let Some(line) = bench.person.line("X,Y:")? {
        match line.trim() {
            "" => continue,
            "q" => break,
            text => match record::place(text) {
                Err(why) => tell(format_args!("{text}: {why}")),
                Ok(place) => match wait(bench, bounds)? {
                    Ok(sighting) => {
                        keep(bench, recording, path, place, &sighting)?;
                        kept += 1;
                    }
                    Err(why) => tell(format_args!("{text} is not recorded: {why}")),
                },
            },
        }
    }
    let plural = if kept == 1 { "" } else { "s" };
    tell(format_args!(
        "{kept} sighting{plural} added to {}",
        path.display()
    ));
    Ok(())
}

/// Tracks until the blob is steady, and leaves the camera idle.
fn wait(bench: &mut Bench<'_>, bounds: ColourBounds) -> anyhow::Result<Result<Steady, NotSeen>> {
    let packets = usize::from(bench.arguments.packets);
    let columns = bench.view.columns();
    // Not every object is round.
    let mut steadiness = Steadiness::<PACKETS_MAX>::new(packets, columns, Shape::Any);
    let mut judged = Err(NotSeen::Unsteady(Unsteady::Few));
    let wait = spinner("looking");
    bench
        .camera
        .track_colour(bounds)
        .wait()
        .map_err(|e| bench.failed(e))?;
    for _ in 0..PATIENCE * packets {
        let tracking = match bench.look()? {
            Look::Packet(tracking) => tracking,
            Look::Quiet => continue,
            Look::Restarted => {
                judged = Err(NotSeen::Restarted);
                break;
            }
        };
        if let Some(remark) = bench.remark(&tracking) {
            wait.suspend(|| tell(remark));
        }
        if bench.contradicted {
            judged = Err(NotSeen::Columns);
            break;
        }
        judged = steadiness
            .push(bench.view.blob(&tracking))
            .map_err(NotSeen::Unsteady);
        match &judged {
            Ok(_) => break,
            Err(NotSeen::Unsteady(Unsteady::Few)) => {}
            Err(why) => wait.set_message(why.to_string()),
        }
    }
    wait.finish_and_clear();
    bench.camera.stop().wait().map_err(|e| bench.failed(e))?;
    Ok(judged)
}

fn keep(
    bench: &Bench<'_>,
    recording: &mut Recording,
    path: &Path,
    (target_x, target_y): (f64, f64),
    sighting: &Steady,
) -> anyhow::Result<()> {
    let bearing = bench.view.bearing(sighting);
    let row = Row {
        case: &bench.arguments.case,
        target_x,
        target_y,
        column: bench.view.column(sighting),
        sigma_rad: bearing.map(|b| b.sigma),
    };
    recording.append(&row)?;
    let mut out = io::stdout().lock();
    if bench.arguments.json {
        serde_json::to_writer(&mut out, &SightingLine::new(row, sighting, bearing))?;
        return Ok(out.write_all(b"\n")?);
    }
    let Row { case, column, .. } = row;
    let Steady {
        column_sigma,
        frames,
        pixels,
        confidence,
        ..
    } = sighting;
    write!(
        out,
        "{case},{target_x},{target_y}: column {column:.2} +/- {column_sigma:.2} ({frames} packets, \
         pixels {pixels}, confidence {confidence})"
    )?;
    if let Some(bearing) = bearing {
        write!(
            out,
            ", bearing {} deg",
            Degrees(bearing.bearing, bearing.sigma)
        )?;
    }
    writeln!(out, "  -> {}", path.display())?;
    Ok(out.flush()?)
}

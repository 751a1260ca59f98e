//! Sightings of the object at known places.

use std::{
    io::{self, Write},
    path::Path,
};

use anyhow::ensure;
use cmucam2_driver::colour::ColourBounds;
use host_sim::probe::{
    View,
    display::Degrees,
    record::{self, Recording, Row, SightingLine},
};
use indicatif::ProgressBar;
use node_firmware::vision::{
    Blob,
    steady::{Shape, Steadiness, Steady, Unsteady},
};

use super::{Arguments, Bench, Look, person::Person, spinner, tell};

/// Times the packets of a sighting after which the object is given up.
const PATIENCE: usize = 5;

/// The most packets of a sighting.
pub(super) const PACKETS_MAX: usize = 1000;

/// Reason why there is no sighting.
#[derive(Debug, thiserror::Error)]
pub(super) enum NotSeen {
    #[error(transparent)]
    Unsteady(Unsteady),
    /// The camera has lost its adaptation to the light, and so the colour.
    #[error(
        "the camera restarted meanwhile, and sees other colours now: start it up again, without \
         --as-is, and check its supply"
    )]
    Restarted,
    #[error("this camera counts columns otherwise than --first-column says")]
    Columns,
}

/// A camera that can be asked repeatedly what it sees.
pub(super) trait Watches {
    fn arguments(&self) -> &Arguments;
    fn view(&self) -> &View;
    fn person(&mut self) -> &mut Person;
    /// Shape of what it watches.
    fn shape(&self) -> Shape;
    /// Returns true if its blobs have a number of pixels and a confidence.
    fn tells_pixels(&self) -> bool;
    /// Called before the first look; `end` after the last one.
    fn begin(&mut self) -> anyhow::Result<()>;
    fn end(&mut self) -> anyhow::Result<()>;
    /// The next look; the outer `None`: nothing came.
    fn next(&mut self, wait: &ProgressBar)
    -> anyhow::Result<Result<Option<Option<Blob>>, NotSeen>>;
}

/// Records one sighting, or one for each line of the standard input.
pub(super) fn run(
    camera: &mut impl Watches,
    recording: &mut Recording,
    path: &Path,
) -> anyhow::Result<()> {
    if let Some(place) = camera.arguments().at {
        let sighting = wait(camera)??;
        return keep(camera, recording, path, place, &sighting);
    }
    let (mut kept, mut refused) = (0_usize, 0_usize);
    if Person::is_there() {
        tell("Put the object at a known place and type where that is. `q` or Ctrl-D ends.");
    }
    while let Some(line) = camera.person().line("X,Y:")? {
        match line.trim() {
            "" => continue,
            "q" => break,
            text => match record::place(text) {
                Err(why) => {
                    refused += 1;
                    tell(format_args!("{text}: {why}"));
                }
                Ok(place) => match wait(camera)? {
                    Ok(sighting) => {
                        keep(camera, recording, path, place, &sighting)?;
                        kept += 1;
                    }
                    Err(why) => {
                        refused += 1;
                        tell(format_args!("{text} is not recorded: {why}"));
                    }
                },
            },
        }
    }
    ensure!(
        kept > 0 || refused == 0,
        "no sighting was added to {}: see above why, and type the same command again",
        path.display()
    );
    let plural = if kept == 1 { "" } else { "s" };
    tell(format_args!(
        "{kept} sighting{plural} added to {}",
        path.display()
    ));
    Ok(())
}

/// Looks until the blob is steady.
fn wait(camera: &mut impl Watches) -> anyhow::Result<Result<Steady, NotSeen>> {
    let packets = usize::from(camera.arguments().packets);
    let columns = camera.view().columns();
    let mut steadiness = Steadiness::<PACKETS_MAX>::new(packets, columns, camera.shape());
    let mut judged = Err(NotSeen::Unsteady(Unsteady::Few));
    let wait = spinner("looking");
    camera.begin()?;
    for _ in 0..PATIENCE * packets {
        let blob = match camera.next(&wait)? {
            Ok(Some(blob)) => blob,
            Ok(None) => continue,
            Err(why) => {
                judged = Err(why);
                break;
            }
        };
        judged = steadiness.push(blob).map_err(NotSeen::Unsteady);
        match &judged {
            Ok(_) => break,
            Err(NotSeen::Unsteady(Unsteady::Few)) => {}
            Err(why) => wait.set_message(why.to_string()),
        }
    }
    wait.finish_and_clear();
    camera.end()?;
    Ok(judged)
}

/// A CMUcam2 that tracks a colour.
pub(super) struct Tracking<'b, 'a> {
    pub(super) bench: &'b mut Bench<'a>,
    pub(super) bounds: ColourBounds,
}

impl Watches for Tracking<'_, '_> {
    fn arguments(&self) -> &Arguments {
        self.bench.arguments
    }

    fn view(&self) -> &View {
        &self.bench.view
    }

    fn person(&mut self) -> &mut Person {
        &mut self.bench.person
    }

    /// Not every object is round.
    fn shape(&self) -> Shape {
        Shape::Any
    }

    fn tells_pixels(&self) -> bool {
        true
    }

    fn begin(&mut self) -> anyhow::Result<()> {
        let bounds = self.bounds;
        self.bench.ask(|camera| camera.track_colour(bounds).wait())
    }

    /// Leaves the camera idle.
    fn end(&mut self) -> anyhow::Result<()> {
        self.bench.ask(|camera| camera.stop().wait())
    }

    fn next(
        &mut self,
        wait: &ProgressBar,
    ) -> anyhow::Result<Result<Option<Option<Blob>>, NotSeen>> {
        let tracking = match self.bench.look()? {
            Look::Packet(tracking) => tracking,
            Look::Quiet => return Ok(Ok(None)),
            Look::Restarted => return Ok(Err(NotSeen::Restarted)),
        };
        if let Some(remark) = self.bench.remark(&tracking) {
            wait.suspend(|| tell(remark));
        }
        if self.bench.contradicted {
            return Ok(Err(NotSeen::Columns));
        }
        Ok(Ok(Some(self.bench.view.blob(&tracking))))
    }
}

fn keep(
    camera: &impl Watches,
    recording: &mut Recording,
    path: &Path,
    (target_x, target_y): (f64, f64),
    sighting: &Steady,
) -> anyhow::Result<()> {
    let (arguments, view) = (camera.arguments(), camera.view());
    let bearing = view.bearing(sighting);
    let row = Row {
        case: &arguments.case,
        target_x,
        target_y,
        column: view.column(sighting),
        sigma_rad: bearing.map(|b| b.sigma),
    };
    recording.append(&row)?;
    let mut out = io::stdout().lock();
    if arguments.json {
        serde_json::to_writer(
            &mut out,
            &SightingLine::new(row, sighting, bearing, camera.tells_pixels()),
        )?;
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
        "{case},{target_x},{target_y}: column {column:.2} +/- {column_sigma:.2} ({frames} packets"
    )?;
    if camera.tells_pixels() {
        write!(out, ", pixels {pixels}, confidence {confidence}")?;
    }
    write!(out, ")")?;
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

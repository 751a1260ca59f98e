//! A camera role and its camera.

use core::{convert::Infallible, pin::pin, time::Duration};

use calib_core::camera::Camera;
use embassy_futures::select::{Either, Either3, select, select3};
use embedded_storage_async::nor_flash::NorFlash;
use zigbee_link::{
    Instant,
    runner::{Clock, Delay},
};

use super::{
    drive::{AnyDriver, DeviceChannels, Events, RoleDriver, Services, Tasks, drive},
    outlined::Outlined,
};
use crate::{
    config::{CameraConfig, Subjects},
    hardware::{Buttons, Hardware},
    liveness::Liveness,
    log::warning,
    message::{CameraCommand, CommandOutcome, CommandResult, Seen, Sight, Tracked},
    network::Network,
    role::camera::{CameraEvent, CameraRole, CameraTask},
    vision::{Blob, BlobCamera, EitherCamera, Judge, Look, Subject, VisionError, look},
};

/// After a start-up that failed. Doubled each time, up to [`PAUSE_MAX_US`].
const PAUSE_US: u64 = 1_000_000;
const PAUSE_MAX_US: u64 = 32_000_000;

/// Start-ups in a row that fail before no target waits for the camera any more.
const FAILURES: u8 = 2;

/// Looks that are taken again where bytes of the line were lost, and the time before each: more may be lost of the
/// picture that is being sent.
const LOST: u8 = 3;
const PICTURE: Duration = Duration::from_millis(60);

/// A camera follows the sleep of its node within this time.
const LOOK_UP: Duration = Duration::from_secs(1);

/// Reason why the camera starts.
#[derive(Clone, Copy)]
enum Start {
    /// The node was switched on.
    First,
    /// The camera restarted, fell silent or cannot be understood.
    Again,
}

pub(super) async fn run<H: Hardware, N: Network, F: NorFlash>(
    (id, optics, sleeps): (u16, Camera<f32>, bool),
    config: &CameraConfig,
    services: Services<'_, H, N, F>,
    (uart, mut buttons): (H::Uart, H::Buttons),
) -> Infallible {
    let (network, clock, liveness) = (services.network, services.clock, services.liveness);
    let channels = DeviceChannels::new();
    let mut role = None;
    let role = new_role(&mut role, id, config);
    let driver = AnyDriver::Camera(RoleDriver::new(role, &channels));
    let driven = drive(driver, services);
    let camera = EitherCamera::new(config, uart, Delay(clock));
    let mut device = CameraDevice {
        camera,
        config,
        optics,
        subjects: config.subjects.clone(),
        sleeps,
        clock,
        liveness,
    };
    let watched = device.serve(network, channels.tasks.receiver(), channels.events.sender());
    let pressed = async {
        loop {
            let button = buttons.pressed().await;
            channels.events.send(CameraEvent::Button(button)).await;
        }
    };
    match select3(pin!(driven), Outlined(pin!(watched)), pressed).await {
        Either3::First(never) => match never {},
        Either3::Second(never) => match never {},
        Either3::Third(never) => never,
    }
}

/// Made in a function of its own: its caller would have it on the stack once more.
#[inline(never)] // for less stack
fn new_role<'a>(
    role: &'a mut Option<CameraRole>,
    id: u16,
    config: &CameraConfig,
) -> &'a mut CameraRole {
    role.insert(CameraRole::new(id, config.clone()))
}

/// The camera, and its subjects.
struct CameraDevice<'a, K, C> {
    camera: K,
    config: &'a CameraConfig,
    optics: Camera<f32>,
    /// Colours may be learnt anew.
    subjects: Subjects,
    /// The camera sleeps while the network does.
    sleeps: bool,
    clock: &'a C,
    liveness: &'a Liveness,
}

impl<K: BlobCamera, C: Clock> CameraDevice<'_, K, C> {
    async fn serve(
        &mut self,
        network: &impl Network,
        tasks: Tasks<'_, CameraTask>,
        events: Events<'_, CameraEvent>,
    ) -> Infallible {
        let mut judge = self.config.judge(self.optics);
        let mut start = Some(Start::First);
        let mut next = None;
        let mut is_asleep = false;
        loop {
            if let Some(start) = start.take() {
                self.wake(&events, start).await;
                // A network that still sleeps puts it to sleep again.
                is_asleep = false;
            }
            let task = match next.take() {
                Some(task) => task,
                None => {
                    self.liveness.on_camera_rests();
                    let wait = match self.may_sleep() {
                        true => self.clock.now() + LOOK_UP,
                        false => Instant(u64::MAX),
                    };
                    let wait = self.clock.sleep_until(wait);
                    match select3(tasks.receive(), self.camera.rest(), wait).await {
                        Either3::First(task) => task,
                        Either3::Second(never) => match never {},
                        Either3::Third(()) => {
                            let was_asleep =
                                core::mem::replace(&mut is_asleep, network.is_asleep());
                            if is_asleep && !was_asleep {
                                self.camera.sleep().await;
                            } else if was_asleep && !is_asleep {
                                start = Some(Start::Again);
                                events.send(CameraEvent::Starting).await;
                            }
                            continue;
                        }
                    }
                }
            };
            self.liveness.on_camera_works(self.clock.now());
            // A target that waits hears that the camera starts before it does: it would give up before that is over.
            let event = match task {
                CameraTask::Look { colour } => match self.look(colour, &mut judge).await {
                    Some((sight, seen)) => Some(CameraEvent::Looked(sight, seen)),
                    None => {
                        start = Some(Start::Again);
                        Some(CameraEvent::Starting)
                    }
                },
                CameraTask::Adapt => {
                    start = Some(Start::Again);
                    None
                }
                CameraTask::Command(CameraCommand::Track { colour }) => {
                    match self.track(colour, &judge, &tasks, &events).await {
                        Ok(asked) => {
                            next = asked;
                            None
                        }
                        Err(_) => {
                            start = Some(Start::Again);
                            // People ask for it once.
                            next = Some(task);
                            Some(CameraEvent::Starting)
                        }
                    }
                }
                CameraTask::Command(command) => {
                    let outcome = match self.obey(command, &mut judge).await {
                        Ok(outcome) => outcome,
                        Err(VisionError::CommonColour(share)) => {
                            CommandOutcome::CommonColour(share)
                        }
                        Err(VisionError::PartOfObject) => CommandOutcome::PartOfObject,
                        Err(VisionError::NotStarted) => {
                            // People ask for it once.
                            start = Some(Start::Again);
                            next = Some(task);
                            continue;
                        }
                        Err(_) => CommandOutcome::Failed,
                    };
                    if outcome.is_success()
                        && let CameraCommand::LearnColour { colour } = command
                        && let Some(Subject::Colour(window)) = self.subjects.of_target(colour)
                    {
                        events.send(CameraEvent::Learnt(colour, window)).await;
                    }
                    Some(done(command, outcome))
                }
                CameraTask::Recall(windows) => {
                    for (colour, window) in (0..).zip(windows) {
                        if let Some(window) = window {
                            self.subjects.learn(colour, window);
                        }
                    }
                    None
                }
            };
            if let Some(event) = event {
                events.send(event).await;
            }
        }
    }

    /// Starts the camera, however long it takes; nothing works before.
    async fn wake(&mut self, events: &Events<'_, CameraEvent>, start: Start) {
        let mut pause = PAUSE_US;
        let mut failures = 0_u8;
        loop {
            self.liveness.on_camera_works(self.clock.now());
            let started = match start {
                Start::First => self.start_up().await,
                // No more than that: the target is in view, and would be background.
                Start::Again => self.camera.start_up().await,
            };
            let Err(error) = started else {
                break;
            };
            warning!("the camera does not start: {}", error);
            failures = failures.saturating_add(1);
            if failures == FAILURES {
                events.send(CameraEvent::Failed).await;
            }
            let now = self.clock.now().0;
            let until = self.clock.sleep_until(Instant(now.saturating_add(pause)));
            select(until, self.camera.rest()).await;
            pause = (pause * 2).min(PAUSE_MAX_US);
        }
        events.send(CameraEvent::Ready).await;
    }

    /// A camera that sleeps loses its background.
    fn may_sleep(&self) -> bool {
        self.sleeps && !matches!(self.subjects, Subjects::Motion { .. })
    }

    async fn start_up(&mut self) -> Result<(), VisionError> {
        self.camera.start_up().await?;
        // The target is not there yet, or it is and the background is learnt again later.
        if let Subjects::Motion { .. } = self.subjects {
            self.camera.learn_background().await?;
        }
        Ok(())
    }

    /// Result of a look. `None`: the camera has to start up first.
    async fn look(&mut self, colour: u8, judge: &mut Judge) -> Option<(Sight, Option<Seen>)> {
        let Some(subject) = self.subjects.of_target(colour) else {
            return Some((Sight::NotInView, None));
        };
        let mut lost = 0..LOST;
        let looked = loop {
            match look(&mut self.camera, subject, judge).await {
                // A picture is lost, and the target stands there for more of them.
                Err(error) if error.is_passing() && lost.next().is_some() => {
                    self.clock.sleep_until(self.clock.now() + PICTURE).await;
                }
                looked => break looked,
            }
        };
        let looked = match looked {
            Ok(Look::Steady(seen)) => (Sight::InView, Some(seen)),
            Ok(Look::Nothing) => (Sight::NotInView, None),
            Ok(Look::Clipped) => (Sight::Clipped, None),
            Ok(Look::Lopsided) => (Sight::Hidden, None),
            Ok(Look::Several) => (Sight::Several, None),
            Ok(Look::Unsteady) => (Sight::Unsteady, None),
            Err(error) => {
                warning!("the camera does not look: {}", error);
                if error.wants_start_up() {
                    return None;
                }
                (Sight::Failed, None)
            }
        };
        Some(looked)
    }

    /// Result of a command.
    async fn obey(
        &mut self,
        command: CameraCommand,
        judge: &mut Judge,
    ) -> Result<CommandOutcome, VisionError> {
        match command {
            CameraCommand::Initialise => self.start_up().await?,
            CameraCommand::LearnColour { colour }
                if let Some(subject @ (Subject::Signature(_) | Subject::Tag(_))) =
                    self.subjects.of_target(colour) =>
            {
                // It was taught beforehand: only whether it sees one such object can be told.
                let looked = look(&mut self.camera, subject, judge).await?;
                return Ok(match looked {
                    Look::Steady(_) => CommandOutcome::Done,
                    _ => CommandOutcome::Failed,
                });
            }
            CameraCommand::LearnColour { colour } if self.subjects.has_room_for(colour) => {
                let learnt = self.camera.learn_colour().await?;
                self.subjects.learn(colour, learnt.window);
                return Ok(CommandOutcome::Learnt(learnt.background));
            }
            CameraCommand::LearnColour { .. } => return Ok(CommandOutcome::Failed),
            CameraCommand::LearnBackground => self.camera.learn_background().await?,
            CameraCommand::Track { .. } | CameraCommand::StopTracking | CameraCommand::Forget => {}
        }
        Ok(CommandOutcome::Done)
    }

    /// Streams packets until another task comes, which it returns, or the camera cannot do so any more.
    ///
    /// # Errors
    /// The camera has to start up first.
    async fn track(
        &mut self,
        colour: u8,
        judge: &Judge,
        tasks: &Tasks<'_, CameraTask>,
        events: &Events<'_, CameraEvent>,
    ) -> Result<Option<CameraTask>, VisionError> {
        let command = CameraCommand::Track { colour };
        let begun = match self.subjects.of_target(colour) {
            Some(subject) => self.camera.begin(subject).await.is_ok(),
            None => false,
        };
        events.send(done(command, CommandOutcome::of(begun))).await;
        if !begun {
            return Ok(None);
        }
        let next = loop {
            match select(tasks.receive(), self.camera.next()).await {
                Either::First(task) => break Some(task),
                Either::Second(Ok(blob)) => {
                    self.liveness.on_camera_works(self.clock.now());
                    let tracked = blob.map(|blob| tracked(&blob, judge)).unwrap_or_default();
                    events.send(CameraEvent::Tracked(tracked)).await;
                }
                Either::Second(Err(error)) => {
                    warning!("the camera does not track: {}", error);
                    if error.wants_start_up() {
                        return Err(error);
                    }
                    if error.is_passing() {
                        // It is begun again.
                        break Some(CameraTask::Command(command));
                    }
                    events.send(done(command, CommandOutcome::Failed)).await;
                    break None;
                }
            }
        };
        // A camera that does not end it is silenced by its next request.
        let _ = self.camera.end().await;
        Ok(next)
    }
}

/// View of a frame.
fn tracked(blob: &Blob, judge: &Judge) -> Tracked {
    let (seen, is_wide) = judge.glance(blob).unzip();
    Tracked {
        blob: blob.told,
        age_ms: 0,
        seen,
        is_wide: is_wide.unwrap_or(false),
    }
}

const fn done(command: CameraCommand, outcome: CommandOutcome) -> CameraEvent {
    CameraEvent::Done(CommandResult { command, outcome })
}

#[cfg(test)]
mod tests {
    use core::{
        cell::Cell,
        future::{pending, poll_fn},
        task::{Context, Poll, Waker},
    };

    use zigbee_link::wire::ShortAddress;

    use super::*;
    use crate::{
        config::examples,
        message::{Message, Restart},
        network::{Attachment, NetworkEvent, PostError, Receipt},
        vision::LearntColour,
    };

    const TICK: u64 = 100_000;

    struct Time(Cell<u64>);

    impl Clock for Time {
        fn now(&self) -> Instant {
            Instant(self.0.get())
        }

        fn sleep_until(&self, time: Instant) -> impl Future<Output = ()> {
            poll_fn(move |_| match self.now() >= time {
                true => Poll::Ready(()),
                false => Poll::Pending,
            })
        }
    }

    /// A network that only sleeps.
    struct Sleeper(Cell<bool>);

    impl Network for Sleeper {
        type Ticket = ();

        fn post(&self, _: ShortAddress, _: &Message, _: Receipt) -> Result<(), PostError> {
            Err(PostError::Refused)
        }

        fn happened(&self, _: Option<Attachment>) -> impl Future<Output = NetworkEvent<()>> {
            pending()
        }

        fn is_asleep(&self) -> bool {
            self.0.get()
        }
    }

    /// A camera that sees nothing, and counts how often it starts and sleeps.
    struct Blind<'a> {
        counts: &'a [Cell<u32>; 2],
        is_started: bool,
    }

    impl Blind<'_> {
        fn count(&self, n: usize) {
            let count = &self.counts[n];
            count.set(count.get() + 1);
        }

        fn check(&self) -> Result<(), VisionError> {
            self.is_started.then_some(()).ok_or(VisionError::NotStarted)
        }
    }

    impl BlobCamera for Blind<'_> {
        async fn start_up(&mut self) -> Result<(), VisionError> {
            self.is_started = true;
            self.count(0);
            Ok(())
        }

        async fn learn_colour(&mut self) -> Result<LearntColour, VisionError> {
            self.check()?;
            Err(VisionError::PartOfObject)
        }

        async fn learn_background(&mut self) -> Result<(), VisionError> {
            self.check()
        }

        async fn begin(&mut self, _: Subject) -> Result<(), VisionError> {
            self.check()
        }

        async fn next(&mut self) -> Result<Option<Blob>, VisionError> {
            Ok(None)
        }

        async fn end(&mut self) -> Result<(), VisionError> {
            Ok(())
        }

        async fn sleep(&mut self) {
            self.is_started = false;
            self.count(1);
        }
    }

    /// It starts once for each time it slept, and sleeps again while the network does.
    #[test]
    fn a_camera_that_is_asked_in_its_sleep_starts_once() {
        let (time, network) = (Time(Cell::new(0)), Sleeper(Cell::new(true)));
        let counts = [Cell::new(0), Cell::new(0)];
        let config = examples::camera();
        let liveness = Liveness::new(Restart::Ordinary);
        let optics = Camera::pin_hole(88, 0.8).unwrap();
        let mut device = CameraDevice {
            camera: Blind {
                counts: &counts,
                is_started: false,
            },
            config: &config,
            optics,
            subjects: config.subjects.clone(),
            sleeps: true,
            clock: &time,
            liveness: &liveness,
        };
        let channels = DeviceChannels::<CameraTask, CameraEvent>::new();
        let serve = device.serve(
            &network,
            channels.tasks.receiver(),
            channels.events.sender(),
        );
        let mut serve = pin!(serve);
        let mut run = |ticks: u64| {
            for _ in 0..ticks {
                for _ in 0..4 {
                    let polled = serve.as_mut().poll(&mut Context::from_waker(Waker::noop()));
                    assert!(polled.is_pending());
                    while channels.events.try_receive().is_ok() {}
                }
                time.0.set(time.0.get() + TICK);
            }
            [0, 1].map(|n| counts[n].get())
        };
        assert_eq!(run(30), [1, 1]);
        // The network is woken, and a target stops before the camera has noticed.
        network.0.set(false);
        let look = CameraTask::Look { colour: 0 };
        assert!(channels.tasks.try_send(look).is_ok());
        assert_eq!(run(30), [2, 1]);
        network.0.set(true);
        assert_eq!(run(30), [2, 2]);
        // A person presses a button, and the network sleeps on.
        let learn = CameraTask::Command(CameraCommand::LearnColour { colour: 0 });
        assert!(channels.tasks.try_send(learn).is_ok());
        assert_eq!(run(30), [3, 3]);
    }
}

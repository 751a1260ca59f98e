//! Work of the camera's hardware: one task at a time.

use super::CameraTask;
use crate::message::{CameraCommand, MemberAddress, Sight, StopNumber, Stopped};

/// Look that a target asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LookRequest {
    pub(super) target: MemberAddress,
    pub(super) stopped: Stopped,
}

impl LookRequest {
    pub(super) const fn stop(&self) -> (MemberAddress, StopNumber) {
        (self.target, self.stopped.stop)
    }
}

/// State of the hardware's start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Start {
    /// It is starting.
    Starting,
    Ready,
    /// It has not started yet, and is tried again.
    Failed,
}

/// Work of the hardware, and the requests that wait for it.
#[derive(Clone, Debug)]
pub(super) struct Device {
    start: Start,
    /// True while a task goes on.
    is_busy: bool,
    looking: Option<LookRequest>,
    next_look: Option<LookRequest>,
    next_command: Option<CameraCommand>,
    /// True if it is to adapt to the light once nothing else waits.
    adapts_next: bool,
}

impl Device {
    pub(super) const fn new() -> Self {
        Self {
            start: Start::Starting,
            is_busy: false,
            looking: None,
            next_look: None,
            next_command: None,
            adapts_next: false,
        }
    }

    /// Returns true if it has started.
    pub(super) const fn is_ready(&self) -> bool {
        matches!(self.start, Start::Ready)
    }

    /// Returns the answer of a camera that cannot look.
    pub(super) const fn excuse(&self) -> Sight {
        match self.start {
            Start::Starting | Start::Ready => Sight::NotReady,
            Start::Failed => Sight::Failed,
        }
    }

    pub(super) const fn on_ready(&mut self) {
        self.start = Start::Ready;
    }

    /// Marks a failed start. It is tried again.
    pub(super) const fn on_failed(&mut self) {
        self.start = Start::Failed;
    }

    /// Restarts it, even during a look. Returns the requests that are given up.
    pub(super) fn on_starting(&mut self) -> ([Option<LookRequest>; 2], Option<CameraCommand>) {
        self.start = Start::Starting;
        self.is_busy = false;
        self.adapts_next = false;
        let requests = [self.looking.take(), self.next_look.take()];
        (requests, self.next_command.take())
    }

    /// Has a command carried out next. Returns the command that is given up for it: the one that waited. Before the
    /// camera has started it is this one: it is unknown when it could be carried out.
    pub(super) const fn command(&mut self, command: CameraCommand) -> Option<CameraCommand> {
        if self.is_ready() {
            self.next_command.replace(command)
        } else {
            Some(command)
        }
    }

    /// Has it look. Of two requests that wait the later one counts. The other target asks again.
    pub(super) fn look(&mut self, request: LookRequest) {
        match &mut self.looking {
            Some(looking) if looking.stop() == request.stop() => *looking = request,
            _ => self.next_look = Some(request),
        }
    }

    /// Has it adapt to the light once it has time.
    pub(super) const fn adapt(&mut self) {
        self.adapts_next = true;
    }

    /// Stops of the look that goes on and of the one that waits.
    pub(super) fn requested(&self) -> impl Iterator<Item = (MemberAddress, StopNumber)> {
        let requests = [&self.looking, &self.next_look].into_iter().flatten();
        requests.map(LookRequest::stop)
    }

    /// Returns the next task, if none goes on.
    pub(super) fn next_task(&mut self) -> Option<CameraTask> {
        if self.is_busy {
            return None;
        }
        if let Some(command) = self.next_command.take() {
            // Tracking goes on until the next task.
            self.is_busy = !matches!(command, CameraCommand::Track { .. });
            return Some(CameraTask::Command(command));
        }
        let Some(request) = self.next_look.take() else {
            if core::mem::take(&mut self.adapts_next) {
                self.start = Start::Starting;
                return Some(CameraTask::Adapt);
            }
            return None;
        };
        self.is_busy = true;
        self.looking = Some(request);
        let colour = request.stopped.colour;
        Some(CameraTask::Look { colour })
    }

    /// Ends a look. Returns its request, if that still counts.
    pub(super) const fn on_looked(&mut self) -> Option<LookRequest> {
        self.is_busy = false;
        self.looking.take()
    }

    /// Ends a command.
    pub(super) fn on_done(&mut self, command: CameraCommand) {
        self.is_busy &= matches!(command, CameraCommand::Track { .. });
    }

    /// Drops all requests, even that of a look that goes on.
    pub(super) fn forget_requests(&mut self) {
        self.looking = None;
        self.next_look = None;
    }
}

//! Work of the camera's hardware: one task at a time.

use super::CameraTask;
use crate::message::{CameraCommand, MemberAddress, Sight, StopNumber, Stopped};

/// A target asked for a look.
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
    /// It does not start so far.
    Failed,
}

/// Work of the hardware, and the requests that wait for it.
#[derive(Clone, Debug)]
pub(super) struct Device {
    start: Start,
    /// It has a task that is not over.
    is_busy: bool,
    looking: Option<LookRequest>,
    next_look: Option<LookRequest>,
    next_command: Option<CameraCommand>,
    /// It is to adapt to the light when nothing else waits.
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

    /// Answer of a camera that does not look.
    pub(super) const fn excuse(&self) -> Sight {
        match self.start {
            Start::Starting | Start::Ready => Sight::NotReady,
            Start::Failed => Sight::Failed,
        }
    }

    pub(super) const fn on_ready(&mut self) {
        self.start = Start::Ready;
    }

    /// It does not start; it goes on trying.
    pub(super) const fn on_failed(&mut self) {
        self.start = Start::Failed;
    }

    /// It has to start anew, in the middle of a look. Returns the requests that are given up.
    pub(super) fn on_starting(&mut self) -> ([Option<LookRequest>; 2], Option<CameraCommand>) {
        self.start = Start::Starting;
        self.is_busy = false;
        self.adapts_next = false;
        let requests = [self.looking.take(), self.next_look.take()];
        (requests, self.next_command.take())
    }

    /// Has a command carried out next. Another one that waits is given up. Before the camera has started,
    /// this one is given up: its start time, and its view then, are not known. Returns the command that is
    /// given up.
    pub(super) const fn command(&mut self, command: CameraCommand) -> Option<CameraCommand> {
        if self.is_ready() {
            self.next_command.replace(command)
        } else {
            Some(command)
        }
    }

    /// Has it look. The later one of two requests that wait counts; the other target asks again.
    pub(super) fn look(&mut self, request: LookRequest) {
        match &mut self.looking {
            Some(looking) if looking.stop() == request.stop() => *looking = request,
            _ => self.next_look = Some(request),
        }
    }

    /// Has it adapt to the light when it has the time.
    pub(super) const fn adapt(&mut self) {
        self.adapts_next = true;
    }

    /// Stops that are looked at or will be.
    pub(super) fn requested(&self) -> impl Iterator<Item = (MemberAddress, StopNumber)> {
        let requests = [&self.looking, &self.next_look].into_iter().flatten();
        requests.map(LookRequest::stop)
    }

    /// The next task, if it has the time.
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

    /// A look is over. Returns its request, if that is still of interest.
    pub(super) const fn on_looked(&mut self) -> Option<LookRequest> {
        self.is_busy = false;
        self.looking.take()
    }

    /// A command is carried out, or failed.
    pub(super) fn on_done(&mut self, command: CameraCommand) {
        self.is_busy &= matches!(command, CameraCommand::Track { .. });
    }

    /// Drops all requests, a look that goes on included.
    pub(super) fn forget_requests(&mut self) {
        self.looking = None;
        self.next_look = None;
    }
}

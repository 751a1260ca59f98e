//! Status of a camera, and the decision when others hear of it.

use calib_core::Status;

use crate::{
    config::CameraConfig,
    facts::FactKey,
    limits::SIGHTINGS,
    message::{CameraState, Duty, PoseParts, Report},
    role::{Unsaved, is_news},
};

/// Status of a camera.
#[derive(Clone, Debug)]
pub(super) struct Progress {
    report: Report,
    /// The report that was sent last.
    told: Report,
}

impl Progress {
    pub(super) const fn new(id: u16) -> Self {
        let report = nothing_known(id);
        Self {
            report,
            told: report,
        }
    }

    pub(super) const fn report(&self) -> &Report {
        &self.report
    }

    /// The pose, if it is known.
    pub(super) fn pose(&self) -> Option<PoseParts> {
        self.report.pose().copied()
    }

    /// Returns true if there is something to report.
    pub(super) fn has_report(&self) -> bool {
        self.report.state != CameraState::Waiting
    }

    /// Restores a report. The limits may have changed since.
    pub(super) fn restore(&mut self, report: &Report, config: &CameraConfig) {
        let state = report
            .state
            .judged_again(&config.weak.limits(), report.is_tested());
        let is_done = report.duty.is_some() || is_done(config, report.sightings.into(), &state);
        self.report = Report {
            id: self.report.id,
            done: report.done && is_done,
            state,
            ..*report
        };
        self.told = self.report;
    }

    /// Takes a new report: returns true if others should hear of it.
    pub(super) fn update(&mut self, report: Report, unsaved: &mut Unsaved) -> bool {
        if report == self.report {
            return false;
        }
        self.report = report;
        unsaved.insert(FactKey::Report);
        let is_news = is_news(&self.told, &report);
        if is_news {
            self.told = report;
        }
        is_news
    }

    /// Returns the report of a reference that knows its pose. No target has estimated it yet.
    pub(super) fn solved(&self, duty: Duty, solved: &Report) -> Report {
        Report {
            id: self.report.id,
            duty: Some(duty),
            done: true,
            state: solved.state.untested(),
            ..*solved
        }
    }

    /// Report of a camera that knows nothing.
    pub(super) const fn nothing_known(&self) -> Report {
        nothing_known(self.report.id)
    }

    /// It knows nothing, and no receiver of an earlier report is there.
    pub(super) fn clear(&mut self, unsaved: &mut Unsaved) {
        self.report = self.nothing_known();
        unsaved.insert(FactKey::Report);
        self.told = self.report;
    }

    /// Notes that the report is sent, or that there is no receiver.
    pub(super) const fn on_told(&mut self) {
        self.told = self.report;
    }
}

const fn nothing_known(id: u16) -> Report {
    Report {
        id,
        duty: None,
        sightings: 0,
        used: 0,
        chi_squared: 0.0,
        done: false,
        joint: None,
        state: CameraState::Waiting,
        mount: None,
    }
}

/// Returns true if a camera needs no more stops: it is calibrated and as certain as wanted, or it has a pose and no
/// room for more sightings.
pub(super) fn is_done(config: &CameraConfig, sightings: usize, state: &CameraState) -> bool {
    let Some(pose) = state.pose().and_then(PoseParts::pose) else {
        return false;
    };
    sightings >= SIGHTINGS
        || state.status() == Status::Calibrated
            && sightings >= usize::from(config.stops)
            && (!config.refine || config.good_enough.limits().allow(&pose))
}

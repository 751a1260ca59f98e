//! From worn sensors to steps.

use core::time::Duration;

use calib_core::{
    Real,
    angle::{wrap_positive, wrap_signed},
    dead_reckoning::Step,
    lit,
};

use crate::{
    HeadingFilter, HeadingSettings, ImuError, ImuSample, InvalidSetting, StepDetector,
    StepDetectorSettings, StepLength, Swing, settings::require,
};

/// A pause longer than this between two samples is a gap: motion in it is not known. Sampling below 10 Hz is too
/// slow to see steps anyway; 25 to 100 Hz is good.
const LONGEST_PAUSE: Duration = Duration::from_millis(100);

/// The most steps that [`PedestrianSettings::confirmation`] can hold back.
const MOST_WAITING: usize = 4;

/// Settings of a [`Pedestrian`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct PedestrianSettings<T> {
    /// Settings of the detection of steps.
    pub detector: StepDetectorSettings<T>,
    /// Length of a step: to be calibrated for the person.
    pub length: StepLength<T>,
    /// Settings of the heading of a step.
    pub heading: HeadingSettings<T>,
    /// Standard deviation, radians, zero or above, of the direction of a single step against that of the body.
    /// Default 0.05 (3 degrees): people sway. A constant part belongs to
    /// [`Systematic::heading_sigma`](calib_core::dead_reckoning::Systematic::heading_sigma).
    pub sway_sigma: T,
    /// Number of swings in a row that make a walk, 1 to 4. The first ones are held back until then, and lost if no
    /// more follow. Default 2: a knock is not walking, and moving over by two steps is. Zhao's pedometer takes 4,
    /// where more handling than walking is to be expected.
    pub confirmation: u8,
}

impl<T: Real> Default for PedestrianSettings<T> {
    fn default() -> Self {
        Self {
            detector: StepDetectorSettings::default(),
            length: StepLength::default(),
            heading: HeadingSettings::default(),
            sway_sigma: lit(0.05),
            confirmation: 2,
        }
    }
}

/// A walking person: sensor readings in, steps out.
///
/// Step counting, step length and compass-aided gyroscope heading are the classical pedestrian
/// dead reckoning of a low-cost sensor worn on the trunk (compared, with alternatives, by Jimenez
/// et al., "A comparison of pedestrian dead-reckoning algorithms using a low-cost MEMS IMU", WISP
/// 2009). It takes the person to walk forward: steps sideways and backwards count as forward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pedestrian<T: Real> {
    settings: PedestrianSettings<T>,
    detector: StepDetector<T>,
    heading: HeadingFilter<T>,
    last: Option<Duration>,
    mean: MeanHeading<T>,
    waiting: Waiting<T>,
    /// Swings in a row.
    run: u8,
}

impl<T: Real> Pedestrian<T> {
    /// A person of whom nothing is known yet.
    ///
    /// # Errors
    /// A setting out of its range.
    pub fn new(settings: PedestrianSettings<T>) -> Result<Self, InvalidSetting> {
        settings.length.check()?;
        require(&[
            (
                settings.sway_sigma >= T::zero() && settings.sway_sigma.is_finite(),
                "sway_sigma",
            ),
            (
                (1..=MOST_WAITING).contains(&usize::from(settings.confirmation)),
                "confirmation",
            ),
        ])?;
        Ok(Self {
            settings,
            detector: StepDetector::new(settings.detector)?,
            heading: HeadingFilter::new(settings.heading)?,
            last: None,
            mean: MeanHeading::from(T::zero()),
            waiting: Waiting::default(),
            run: 0,
        })
    }

    /// The heading, its sigma, and the state of the compass.
    pub fn heading_filter(&self) -> &HeadingFilter<T> {
        &self.heading
    }

    /// The heading is known from elsewhere: [`HeadingFilter::align`].
    pub fn align(&mut self, heading: T, sigma: T) {
        self.heading.align(heading, sigma);
    }

    /// Takes a reading, at a time since any one moment; gives a step when one is complete. Steps
    /// that were held back for confirmation come with the readings after it, one each.
    ///
    /// After a gap of more than 0.1 s, and at first, the heading is unknown until the compass has
    /// told it, and a walk begins anew. Steps made in a gap are lost.
    ///
    /// # Errors
    /// A reading that is not usable or not later than the one before. It is left out.
    pub fn update(
        &mut self,
        time: Duration,
        sample: &ImuSample<T>,
    ) -> Result<Option<Step<T>>, ImuError> {
        if !sample.is_usable() {
            return Err(ImuError::NotUsable);
        }
        let Some(last) = self.last else {
            self.last = Some(time);
            return Ok(None);
        };
        let pause = time
            .checked_sub(last)
            .filter(|pause| !pause.is_zero())
            .ok_or(ImuError::TimeNotAfter)?;
        self.last = Some(time);
        if pause > LONGEST_PAUSE {
            self.detector.restart();
            self.heading.restart();
            self.run = 0;
            self.waiting.drop_unconfirmed();
            return Ok(self.waiting.next());
        }
        // In single precision, which is exact enough for a pause, and cheap on a node.
        let dt = lit(f64::from(pause.as_secs_f32()));
        self.heading.update(dt, sample);
        self.mean.add(dt, self.heading.heading());
        if let Some(swing) = self.detector.update(dt, sample.acceleration.norm()) {
            self.count(&swing);
        }
        Ok(self.waiting.next())
    }

    fn count(&mut self, swing: &Swing<T>) {
        let heading_now = self.heading.heading();
        let mean = core::mem::replace(&mut self.mean, MeanHeading::from(heading_now)).value();
        // Before the first step of a walk the person may have turned on the spot.
        let heading = match swing.interval {
            Some(_) => mean,
            None => heading_now,
        };
        if swing.interval.is_none() {
            self.waiting.drop_unconfirmed();
            self.run = 0;
        }
        let distance = self.settings.length.length(swing.amplitude);
        self.waiting.push(Step {
            distance,
            heading,
            distance_sigma: self.settings.length.sigma(distance),
            heading_sigma: self.independent_heading_sigma(swing.interval),
        });
        self.run = self.run.saturating_add(1);
        if self.run >= self.settings.confirmation {
            self.waiting.confirm();
        }
    }

    /// The sigma that headings would need, were they independent from step to step, for a long
    /// walk to become as uncertain as it does. The filter's errors last for its time constant,
    /// that is for `n` steps, which multiplies their variance by `n`. That is cautious for walks
    /// shorter than the time constant.
    fn independent_heading_sigma(&self, interval: Option<T>) -> T {
        let usual_interval = lit(0.5);
        let filter = self.heading.sigma();
        let steps = self.settings.heading.time_constant / interval.unwrap_or(usual_interval);
        let sway = self.settings.sway_sigma;
        let sigma = (filter * filter * steps.max(T::one()) + sway * sway).sqrt();
        // No direction is less known than one that is not known at all.
        sigma.min(T::pi() / lit::<T>(3.0).sqrt())
    }
}

/// The mean heading over a step, without trigonometry: of its departures from the first.
#[derive(Clone, Copy, Debug, PartialEq)]
struct MeanHeading<T> {
    first: T,
    departures: T,
    time: T,
}

impl<T: Real> MeanHeading<T> {
    fn from(first: T) -> Self {
        Self {
            first,
            departures: T::zero(),
            time: T::zero(),
        }
    }

    fn add(&mut self, dt: T, heading: T) {
        self.departures += wrap_signed(heading - self.first) * dt;
        self.time += dt;
    }

    fn value(&self) -> T {
        if self.time > T::zero() {
            wrap_positive(self.first + self.departures / self.time)
        } else {
            self.first
        }
    }
}

/// Steps that are held back, and those that are due, in order.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Waiting<T> {
    steps: [Option<Step<T>>; MOST_WAITING],
    length: usize,
    confirmed: usize,
}

impl<T> Default for Waiting<T> {
    fn default() -> Self {
        Self {
            steps: [const { None }; MOST_WAITING],
            length: 0,
            confirmed: 0,
        }
    }
}

impl<T: Real> Waiting<T> {
    fn push(&mut self, step: Step<T>) {
        // A swing takes two readings at least, and each reading hands out a step.
        debug_assert!(self.length < MOST_WAITING, "there is room for a step");
        if let Some(slot) = self.steps.get_mut(self.length) {
            *slot = Some(step);
            self.length += 1;
        }
    }

    fn confirm(&mut self) {
        self.confirmed = self.length;
    }

    fn drop_unconfirmed(&mut self) {
        self.length = self.confirmed;
    }

    fn next(&mut self) -> Option<Step<T>> {
        if self.confirmed == 0 {
            return None;
        }
        self.confirmed -= 1;
        self.length -= 1;
        self.steps.rotate_left(1);
        self.steps.last_mut()?.take()
    }
}

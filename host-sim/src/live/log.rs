//! The events so far, for pages that are opened late or again.

use std::collections::VecDeque;

use results::record::{
    RunRecord,
    event::{Event, What},
};

/// Number of events that are kept one by one; older ones become one record.
const KEPT: usize = 20_000;

/// Events with consecutive numbers. Memory is bounded: the oldest are folded into the record with which
/// the stream begins, and the verdict that follows it. A later verdict tells only its changes, and is not
/// told if nothing changed.
#[derive(Debug, Default)]
pub struct Log {
    /// Sum of the events before the first that is kept.
    begin: Option<Event>,
    /// The verdict at that time.
    verdict: Option<Event>,
    /// The present verdict.
    latest: Option<What>,
    /// The number of the first event that is kept.
    first: u64,
    lines: VecDeque<Event>,
}

impl Log {
    /// Takes the next event.
    pub fn push(&mut self, mut event: Event) {
        if matches!(event.what, What::Begin { .. }) {
            // A new beginning replaces everything.
            self.first += self.lines.len() as u64 + u64::from(self.begin.is_some());
            self.lines.clear();
            (self.verdict, self.latest) = (None, None);
            self.begin = Some(event);
            return;
        }
        if matches!(event.what, What::Verdict { .. }) {
            let before = self.latest.replace(event.what.clone());
            if before.as_ref() == Some(&event.what) {
                return;
            }
            let change = before.and_then(|before| What::verdict_change(&before, &event.what));
            event.what = change.unwrap_or(event.what);
        }
        self.lines.push_back(event);
        if self.lines.len() > KEPT
            && let Some(oldest) = self.lines.pop_front()
        {
            self.first += 1;
            self.fold(oldest);
        }
    }

    fn fold(&mut self, oldest: Event) {
        if let Some(Event {
            seconds,
            what: What::Begin { record, .. },
        }) = &mut self.begin
        {
            record.apply(&oldest);
            *seconds = oldest.seconds;
        }
        let verdict = match oldest.what {
            What::VerdictChange { .. } => {
                let before = self.verdict.as_ref();
                before.and_then(|before| oldest.what.verdict_now(&before.what))
            }
            What::Verdict { .. } => Some(oldest.what),
            _ => None,
        };
        if let Some(verdict) = verdict {
            self.verdict = Some(Event::new(oldest.seconds, verdict));
        }
    }

    /// The number of the next event.
    pub fn next(&self) -> u64 {
        self.first + self.lines.len() as u64
    }

    /// Returns true if the events from a number on are kept one by one.
    pub fn has(&self, number: u64) -> bool {
        (self.first..=self.next()).contains(&number)
    }

    /// The events from a number on, each with the number after it. If some of them are not kept one by one
    /// any more: all that is known, with a beginning.
    pub fn since(&self, number: Option<u64>) -> Vec<(u64, &Event)> {
        let known = number.filter(|number| self.has(*number));
        // A page that got the beginning without the verdict gets both again.
        let number = self.first.saturating_sub(u64::from(self.verdict.is_some()));
        let begin = { self.begin.iter() }.map(|begin| (number, begin));
        let verdict = { self.verdict.iter() }.map(|verdict| (self.first, verdict));
        let begin = begin.chain(verdict).filter(|_| known.is_none());
        let skipped = known.map_or(0, |number| (number - self.first) as usize);
        let numbered = (self.first + 1..).zip(&self.lines).skip(skipped);
        begin.chain(numbered).collect()
    }

    /// Sum of all events.
    pub fn record(&self) -> Option<RunRecord> {
        let What::Begin { record, .. } = &self.begin.as_ref()?.what else {
            return None;
        };
        let mut record = RunRecord::clone(record);
        for event in &self.lines {
            record.apply(event);
        }
        Some(record)
    }
}

#[cfg(test)]
mod tests {
    use results::record::event::{Advice, Piece, WalkTo};

    use super::*;

    /// A verdict in which some cameras want something.
    fn verdict(calibrated: usize, wanting: &[u16]) -> Event {
        let findings = wanting.iter().map(|&node| Advice {
            node,
            words: format!("weak: one of {}", node / 10),
        });
        let lines = wanting
            .iter()
            .map(|node| format!("\n  camera {node}: weak"));
        let walk_to = wanting.iter().map(|&node| WalkTo {
            network: 1,
            x: f64::from(node) / 7.0,
            y: 0.5,
            seen_by: vec![node],
        });
        let what = What::Verdict {
            good: wanting.is_empty(),
            calibrated,
            expected: 40,
            words: format!(
                "{calibrated} of 40 cameras are calibrated{}",
                lines.collect::<String>()
            ),
            findings: findings.collect(),
            walk_to: walk_to.collect(),
        };
        Event::new(calibrated as f64, what)
    }

    fn begin() -> Event {
        let record = crate::network::Simulation::new(
            site::Scenario::load("lab", &site::Overrides::default()).unwrap(),
            crate::network::Options::default(),
        );
        let record = Box::new(record.unwrap().record());
        Event::new(0.0, What::Begin { events: 1, record })
    }

    /// Last verdict of a reader that takes all events over.
    fn told(log: &Log, from: Option<u64>, mut now: Option<What>) -> Option<What> {
        for (_, event) in log.since(from) {
            match &event.what {
                What::Verdict { .. } => now = Some(event.what.clone()),
                What::VerdictChange { .. } => now = Some(event.what.verdict_now(&now?).unwrap()),
                _ => {}
            }
        }
        now
    }

    #[test]
    fn a_verdict_is_told_by_what_changed_of_it() {
        let mut log = Log::default();
        log.push(begin());
        let all: Vec<u16> = (1..=40).collect();
        let mut wanting = all.clone();
        log.push(verdict(0, &wanting));
        let whole = serde_json::to_string(log.since(Some(0))[0].1)
            .unwrap()
            .len();
        wanting.remove(17);
        for (step, wanting) in [&wanting[..], &wanting[..], &[], &all[3..9], &all]
            .iter()
            .enumerate()
        {
            let now = verdict(step / 2, wanting);
            let (number, before) = (log.next(), told(&log, None, None));
            log.push(now.clone());
            assert_eq!(told(&log, None, None).as_ref(), Some(&now.what));
            assert_eq!(told(&log, Some(number), before).as_ref(), Some(&now.what));
            if step == 1 {
                assert_eq!(log.next(), number, "nothing changed");
            }
        }
        let (_, change) = log.since(Some(1))[0];
        let What::VerdictChange { findings, .. } = &change.what else {
            panic!("{change:?}");
        };
        assert_eq!(*findings, [Piece::Kept([0, 17]), Piece::Kept([18, 22])]);
        let line = serde_json::to_string(change).unwrap();
        assert!(line.len() < whole / 10, "{line}");
        assert_eq!(Event::from_line(&line).unwrap(), *change);
    }

    /// A reader that comes when the first verdicts are no longer kept one by one gets the present one too.
    #[test]
    fn a_verdict_outlasts_the_events_that_told_it() {
        let mut log = Log::default();
        log.push(begin());
        log.push(verdict(0, &[1, 2, 3]));
        log.push(verdict(1, &[1, 3]));
        for n in 0..KEPT + 10 {
            let words = format!("{n}");
            log.push(Event::new(2.0, What::Said { node: None, words }));
        }
        let kept = log.since(None);
        assert!(
            kept.iter()
                .all(|(_, event)| !matches!(event.what, What::VerdictChange { .. }))
        );
        assert_eq!(told(&log, None, None), Some(verdict(1, &[1, 3]).what));
        log.push(verdict(2, &[3]));
        assert_eq!(told(&log, None, None), Some(verdict(2, &[3]).what));
        // A new beginning replaces everything, also the verdict.
        log.push(begin());
        assert_eq!(told(&log, None, None), None);
        log.push(verdict(2, &[3]));
        assert_eq!(told(&log, None, None), Some(verdict(2, &[3]).what));
    }
}

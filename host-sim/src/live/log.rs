//! The events so far, for whoever opens the page late or again.

use std::collections::VecDeque;

use answers::record::{
    RunRecord,
    event::{Event, What},
};

/// More events than these are not kept one by one: the older ones become one record.
const KEPT: usize = 20_000;

/// Events with consecutive numbers. Memory is bounded: the oldest are folded into the record with which
/// the stream begins.
#[derive(Debug, Default)]
pub struct Log {
    /// What the events before the first that is kept come to.
    begin: Option<Event>,
    /// The number of the first that is kept.
    first: u64,
    lines: VecDeque<Event>,
}

impl Log {
    /// Takes the next event.
    pub fn push(&mut self, event: Event) {
        if matches!(event.what, What::Begin { .. }) {
            // Everything begins again.
            self.first += self.lines.len() as u64 + u64::from(self.begin.is_some());
            self.lines.clear();
            self.begin = Some(event);
            return;
        }
        self.lines.push_back(event);
        if self.lines.len() > KEPT
            && let Some(oldest) = self.lines.pop_front()
        {
            self.first += 1;
            if let Some(Event {
                seconds,
                what: What::Begin { record, .. },
            }) = &mut self.begin
            {
                record.apply(&oldest);
                *seconds = oldest.seconds;
            }
        }
    }

    /// The number of the next event.
    pub fn next(&self) -> u64 {
        self.first + self.lines.len() as u64
    }

    /// The events from a number on, each with the number after it; all that is known, with a beginning,
    /// where some of them are not there one by one any more.
    pub fn since(&self, number: Option<u64>) -> Vec<(u64, &Event)> {
        let known = number.filter(|number| (self.first..=self.next()).contains(number));
        let begin = self.begin.iter().filter(|_| known.is_none());
        let skipped = known.map_or(0, |number| (number - self.first) as usize);
        let numbered = (self.first + 1..).zip(&self.lines).skip(skipped);
        begin
            .map(|begin| (self.first, begin))
            .chain(numbered)
            .collect()
    }

    /// What all events come to.
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

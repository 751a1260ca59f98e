//! A camera as written by an engineer who has only the manual: it takes a line, looks at its two letters,
//! prints. It knows nothing of the driver, and keeps nothing that it is not asked for.
//!
//! Its view is one orange ball, a little further right in each frame.

use std::collections::VecDeque;

/// Further known habits of cameras and cables of this kind. None of them contradicts the manual.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Habits {
    /// Every byte that is sent comes back.
    pub(crate) echoes: bool,
    /// Bytes behind ACK and NCK, and behind packets.
    pub(crate) end_of_line: &'static str,
    pub(crate) prompt: &'static str,
    /// Before each reply.
    pub(crate) thinks_ms: u64,
    pub(crate) boots_ms: u64,
    pub(crate) before_banner: &'static str,
    pub(crate) banner: &'static str,
    /// A packet that was on its way comes between `AC` and `K` of the next reply.
    pub(crate) interrupts_itself: bool,
    /// The carriage return that ends a stream is acknowledged.
    pub(crate) acknowledges_stop: bool,
    /// Every so many commands are refused without a reason.
    pub(crate) refuses_every: u32,
    pub(crate) lower_bounds_first: bool,
    /// TW tells the mean first.
    pub(crate) tells_mean: bool,
    pub(crate) first_number: i32,
    /// A mark before the first row, one after the last.
    pub(crate) row_marks: (bool, bool),
    pub(crate) histogram_goes_on: bool,
    pub(crate) sleeps_with_prompt: bool,
}

pub(crate) const PLAIN: Habits = Habits {
    echoes: false,
    end_of_line: "\r",
    prompt: ":",
    thinks_ms: 0,
    boots_ms: 600,
    before_banner: "",
    banner: "CMUcam2 v1.00 c6\r",
    interrupts_itself: false,
    acknowledges_stop: false,
    refuses_every: 0,
    lower_bounds_first: false,
    tells_mean: false,
    first_number: 1,
    row_marks: (false, true),
    histogram_goes_on: false,
    sleeps_with_prompt: true,
};

/// The colour of the ball, and of the wall.
const BALL: [i32; 3] = [200, 100, 40];
const WALL: [i32; 3] = [120, 118, 112];

const FRAME_US: u64 = 20_000;
const BYTE_US: u64 = 87;

#[derive(Clone, Copy, PartialEq)]
enum Busy {
    Waiting,
    /// Sends packets of this kind, the next one then.
    Sending(&'static str, u64),
    Asleep,
    Upload(usize),
    Off,
}

pub(crate) struct Camera {
    habits: Habits,
    line: String,
    busy: Busy,
    /// Bytes under way, and the times when they are through.
    out: VecDeque<(u64, u8)>,
    bounds: [i32; 6],
    learnt: bool,
    poll: bool,
    filter: bool,
    was_lost: bool,
    skip: u64,
    raw: i32,
    bitmap: bool,
    window: [i32; 4],
    servo: i32,
    frames: i32,
    commands: u32,
    late_packet: bool,
    /// All lines that were understood.
    pub(crate) obeyed: Vec<String>,
    pub(crate) uploaded: usize,
}

impl Camera {
    pub(crate) fn new(habits: Habits) -> Self {
        Self {
            habits,
            line: String::new(),
            busy: Busy::Waiting,
            out: VecDeque::new(),
            bounds: [16, 240, 16, 240, 16, 240],
            learnt: false,
            poll: false,
            filter: false,
            was_lost: false,
            skip: 0,
            raw: 0,
            bitmap: false,
            window: [1, 1, 88, 143],
            servo: 128,
            frames: 0,
            commands: 0,
            late_packet: false,
            obeyed: Vec::new(),
            uploaded: 0,
        }
    }

    /// The next byte that has left it by then.
    pub(crate) fn sends(&mut self, now: u64) -> Option<u8> {
        while let Busy::Sending(kind, at) = self.busy
            && at <= now
        {
            self.packet(kind, at);
            self.busy = Busy::Sending(kind, at + FRAME_US * (1 + self.skip));
        }
        let (at, _) = self.out.front()?;
        (*at <= now).then(|| self.out.pop_front().unwrap().1)
    }

    /// Its power fails; half a second later it is back, as it was when it was new.
    pub(crate) fn restart(&mut self, now: u64) {
        let (habits, obeyed) = (self.habits, std::mem::take(&mut self.obeyed));
        *self = Self::new(habits);
        self.obeyed = obeyed;
        let up = now + habits.boots_ms * 1_000;
        self.say(
            up,
            &format!("{}{}{}", habits.before_banner, habits.banner, habits.prompt),
        );
    }

    pub(crate) fn pull_the_plug(&mut self) {
        self.busy = Busy::Off;
        self.out.clear();
    }

    fn say_bytes(&mut self, at: u64, bytes: &[u8]) {
        let mut at = self.out.back().map_or(at, |&(busy, _)| busy.max(at));
        for &byte in bytes {
            at += BYTE_US;
            self.out.push_back((at, byte));
        }
    }

    fn say(&mut self, at: u64, text: &str) {
        self.say_bytes(at, text.as_bytes());
    }

    pub(crate) fn hears(&mut self, byte: u8, now: u64) {
        if self.busy == Busy::Off {
            return;
        }
        if self.habits.echoes {
            self.say_bytes(now, &[byte]);
        }
        if let Busy::Upload(missing) = self.busy {
            self.uploaded += 1;
            self.busy = match missing {
                1 => {
                    self.ack_and_prompt(now);
                    Busy::Waiting
                }
                _ => Busy::Upload(missing - 1),
            };
            return;
        }
        if byte != b'\r' {
            self.line.push(char::from(byte));
            return;
        }
        let line = std::mem::take(&mut self.line).to_uppercase();
        match self.busy {
            Busy::Asleep => self.busy = Busy::Waiting,
            Busy::Sending(..) => {
                // Bytes that have not left it are dropped, anywhere in its packet.
                self.out.retain(|&(at, _)| at <= now + 4 * BYTE_US);
                self.busy = Busy::Waiting;
                self.late_packet = self.habits.interrupts_itself;
                if self.habits.acknowledges_stop {
                    self.say(now, "ACK\r");
                }
                let prompt = self.habits.prompt;
                self.say(now, prompt);
            }
            _ => self.obey(&line, now + self.habits.thinks_ms * 1_000),
        }
    }

    fn ack(&mut self, now: u64) {
        if self.raw & 2 != 0 {
            return;
        }
        let end = self.habits.end_of_line;
        if std::mem::take(&mut self.late_packet) {
            let packet = self.tracked();
            self.say(now, &format!("AC{packet}\rK{end}"));
        } else {
            self.say(now, &format!("ACK{end}"));
        }
    }

    fn ack_and_prompt(&mut self, now: u64) {
        self.ack(now);
        let prompt = self.habits.prompt;
        self.say(now, prompt);
    }

    fn answer(&mut self, now: u64, text: &str) {
        self.ack(now);
        let prompt = self.habits.prompt;
        self.say(now, &format!("{text}\r{prompt}"));
    }

    fn obey(&mut self, line: &str, now: u64) {
        let (habits, words) = (self.habits, line.split_whitespace());
        let words: Vec<&str> = words.collect();
        let Some((&name, words)) = words.split_first() else {
            return self.ack_and_prompt(now);
        };
        self.commands += 1;
        let n: Vec<i32> = words.iter().filter_map(|word| word.parse().ok()).collect();
        let known = " BM CP CR CT DC DM DS FD FS GB GH GI GM GS GT GV GW HC HD HR HT L0 L1 LF LM MD NF \
            OM PD PF PM PS RF RM RS SD SF SL SM SO SP ST SV TC TI TW UD VW ";
        let refuses =
            habits.refuses_every > 0 && self.commands.is_multiple_of(habits.refuses_every);
        if !known.contains(&format!(" {name} ")) || n.len() != words.len() || refuses {
            let (end, prompt) = (habits.end_of_line, habits.prompt);
            return self.say(now, &format!("NCK{end}{prompt}"));
        }
        self.obeyed.push(line.to_owned());
        let on = n.first().is_some_and(|&first| first != 0);
        match name {
            "PM" => self.poll = on,
            "PF" => self.filter = on,
            "PS" => self.skip = n[0] as u64,
            "RM" => self.raw = n[0],
            "LM" if n[0] == 0 => self.bitmap = n[1] == 1,
            "VW" => self.window = n.try_into().unwrap_or([1, 1, 88, 143]),
            "SV" if n[0] == 0 => self.servo = n[1],
            "ST" => self.bounds = n.try_into().unwrap(),
            _ => {}
        }
        match name {
            "GV" => {
                self.ack(now);
                self.say(now, &format!("{}{}", habits.banner, habits.prompt));
            }
            "RS" => {
                self.ack(now);
                self.restart(now);
            }
            "GB" => self.answer(now, "0"),
            "GI" => self.answer(now, "5"),
            "GS" => self.answer(now, &self.servo.to_string()),
            "GW" => {
                let [x, y, x2, y2] = self.window;
                self.answer(now, &format!("{x} {y} {x2} {y2}"));
            }
            "GT" => {
                let [a, b, c, d, e, f] = self.bounds;
                let text = match habits.lower_bounds_first {
                    true => format!("{a} {c} {e} {b} {d} {f}"),
                    false => format!("{a} {b} {c} {d} {e} {f}"),
                };
                self.answer(now, &text);
            }
            "TC" | "FD" => {
                if let Ok(bounds) = words
                    .iter()
                    .map(|word| word.parse().unwrap())
                    .collect::<Vec<i32>>()
                    .try_into()
                {
                    self.bounds = bounds;
                }
                self.begins(if name == "TC" { "T" } else { "D" }, now);
            }
            "TW" => {
                for (channel, level) in BALL.into_iter().enumerate() {
                    self.bounds[2 * channel] = (level - 30).max(16);
                    self.bounds[2 * channel + 1] = (level + 30).min(240);
                }
                self.learnt = true;
                self.begins("W", now);
            }
            "GM" => self.begins("S", now),
            "GH" => self.begins("H", now),
            "SF" => {
                self.ack(now);
                let frame = self.frame(words.is_empty());
                self.say_bytes(now, &frame);
                self.say(now, habits.prompt);
            }
            "UD" => {
                self.ack(now);
                self.busy = Busy::Upload(64);
            }
            "SL" | "SD" => {
                match habits.sleeps_with_prompt {
                    true => self.ack_and_prompt(now),
                    false => self.ack(now),
                }
                self.busy = Busy::Asleep;
            }
            _ => self.ack_and_prompt(now),
        }
    }

    fn begins(&mut self, kind: &'static str, now: u64) {
        self.ack(now);
        self.was_lost = false;
        let at = now + FRAME_US;
        let once = self.poll || kind == "H" && !self.habits.histogram_goes_on;
        if kind == "W" && self.habits.tells_mean {
            self.packet("S", at);
        }
        let kind = if kind == "W" { "T" } else { kind };
        if !once {
            self.busy = Busy::Sending(kind, at);
            return;
        }
        self.packet(kind, at);
        let prompt = self.habits.prompt;
        self.say(at, prompt);
    }

    fn sees_it(&self) -> bool {
        let b = self.bounds;
        (0..3).all(|i| b[2 * i] <= BALL[i] && BALL[i] <= b[2 * i + 1])
    }

    /// The ball is 17 columns wide and twice as many rows tall, its outline an octagon.
    fn tracked(&mut self) -> String {
        self.frames += 1;
        if !self.sees_it() {
            return "T 0 0 0 0 0 0 0 0".to_owned();
        }
        let first = self.habits.first_number;
        let (x, y) = (39 + first + self.frames % 8, 69 + first);
        let pixels = (17 * 34 * 4 / 5 + 4) / 8;
        format!(
            "T {x} {y} {} {} {} {} {pixels} 204",
            x - 8,
            y - 17,
            x + 8,
            y + 16
        )
    }

    fn packet(&mut self, kind: &str, at: u64) {
        let text = match kind {
            "T" => self.tracked(),
            "D" => "T 4 5 3 4 5 6 9 255".to_owned(),
            "S" => {
                let [r, g, b] = if self.window == [1, 1, 88, 143] {
                    WALL
                } else {
                    BALL
                };
                format!("S {r} {g} {b} 4 5 6")
            }
            _ => format!("H{}", " 9".repeat(28)),
        };
        if self.filter && kind == "T" {
            let lost = !self.sees_it();
            if std::mem::replace(&mut self.was_lost, lost) && lost {
                return;
            }
        }
        if self.bitmap && kind == "T" {
            let mut rows = vec![0xAA, 87, 143];
            rows.extend([0b0001_1000; 11 * 143]);
            rows.extend([0xAA, 0xAA]);
            self.say_bytes(at, &rows);
        }
        if self.raw & 1 != 0 {
            let (letter, numbers) = text.split_at(1);
            let numbers = numbers.split_whitespace().map(|word| word.parse().unwrap());
            let mut bytes = vec![255, letter.as_bytes()[0]];
            bytes.extend(numbers.map(|number: u8| number.min(254)));
            return self.say_bytes(at, &bytes);
        }
        let end = self.habits.end_of_line;
        self.say(at, &format!("{text}{end}"));
    }

    fn frame(&self, colour: bool) -> Vec<u8> {
        let mut bytes = vec![1, 87, 143];
        let (first, last) = self.habits.row_marks;
        for row in 0..143 {
            if row > 0 || first {
                bytes.push(2);
            }
            for column in 0..87 {
                let is_ball = (31..48).contains(&column) && (52..86).contains(&row);
                let pixel = if is_ball { BALL } else { WALL };
                let channels = if colour { &pixel[..] } else { &pixel[..1] };
                bytes.extend(channels.iter().map(|&level| level as u8));
            }
        }
        if last {
            bytes.push(2);
        }
        bytes.push(3);
        bytes
    }
}

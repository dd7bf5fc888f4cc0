//! Step interrupt's view of entries.

use ferrostep_planner::{Notice, StepDigests, StepEntry, StepKind, StepObserver, StepSink};

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Event {
    pub tick: u64,
    pub axes: u8,
    pub directions: u8,
}

impl Event {
    pub fn apply(&self, motors: &mut [i64; 4]) {
        for (motor, steps) in motors.iter_mut().enumerate() {
            if self.axes >> motor & 1 == 1 {
                *steps += if self.directions >> motor & 1 == 1 { -1 } else { 1 };
            }
        }
    }
}

/// Plays entries into events.
#[derive(Default)]
pub struct Player {
    pub tick: u64,
    pub directions: u8,
    pub events: Vec<Event>,
    pub notices: Vec<Notice>,
    pub entries: usize,
    motors: [i64; 4],
    counted_events: usize,
}

impl Player {
    /// Motor positions after some of the events, from zero.
    pub fn motors_after<'a>(events: impl IntoIterator<Item = &'a Event>) -> [i64; 4] {
        let mut motors = [0; 4];
        events.into_iter().for_each(|event| event.apply(&mut motors));
        motors
    }

    /// Motor positions.
    fn counted(&mut self) -> [i64; 4] {
        for event in self.events.get(self.counted_events..).unwrap_or_default() {
            event.apply(&mut self.motors);
        }
        self.counted_events = self.events.len();
        self.motors
    }

    /// The moves that have ended: tick and line.
    pub fn ends(&self) -> Vec<(u64, u32)> {
        let ends = self.notices.iter().filter_map(|notice| match *notice {
            Notice::MoveEnded { tick, line } => Some((tick, line)),
            Notice::BlockEnded { .. } | Notice::FanPower { .. } => None,
        });
        ends.collect()
    }

    pub fn digest(&self) -> StepDigests {
        let mut digests = StepDigests::default();
        for event in &self.events {
            digests.stepped(event.tick, event.axes, event.directions);
        }
        digests
    }
}

impl StepSink for Player {
    fn entry(&mut self, entry: StepEntry) {
        self.entries += 1;
        match entry.kind() {
            StepKind::Directions { directions } => {
                assert_ne!(directions, self.directions, "a change that changes nothing");
                self.directions = directions;
            }
            StepKind::Wait { interval_ticks } => self.tick += u64::from(interval_ticks),
            StepKind::Stair { interval_ticks, count, axes, added } => {
                for index in 1..=count {
                    self.tick += u64::from(interval_ticks);
                    let axes = if index == count { axes ^ added } else { axes };
                    self.events.push(Event { tick: self.tick, axes, directions: self.directions & axes });
                }
            }
        }
    }

    fn notice(&mut self, notice: Notice) {
        if let Notice::BlockEnded { motor_steps, .. } = notice {
            // The planner's own account of where the motors are, against a count of the events.
            assert_eq!(self.counted(), motor_steps, "at the end of a block");
            return;
        }
        self.notices.push(notice);
    }
}

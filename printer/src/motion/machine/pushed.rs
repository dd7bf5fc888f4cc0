//! Count of the new filament that the extruder pushes: only beyond the furthest point so far.
//! Filament that is drawn back and pushed again is not new.

/// Filament pushed up to a place in the queue: the extruder's steps beyond its furthest point so
/// far, modulo 2^32.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pushed(u32);

impl Pushed {
    /// No filament yet.
    pub const NONE: Self = Self(0);

    /// The count with `steps` more, modulo 2^32.
    pub const fn plus(self, steps: u32) -> Self {
        Self(self.0.wrapping_add(steps))
    }

    /// Steps of new filament since an earlier place; 0 for a later one.
    pub const fn steps_since(self, earlier: Self) -> u32 {
        let ahead = self.0.wrapping_sub(earlier.0) as i32;
        if ahead < 0 { 0 } else { ahead as u32 }
    }
}

/// Counts the queued filament.
#[derive(Clone, Copy, Debug, Default)]
pub struct FilamentCount {
    /// The extruder's furthest place, steps.
    furthest: i64,
    at_end: Pushed,
}

impl FilamentCount {
    /// Count at the end of the queue.
    pub const fn at_end(&self) -> Pushed {
        self.at_end
    }

    /// The queue ends with the extruder at this place, steps.
    pub fn follow(&mut self, extruder_steps: i64) {
        let ahead = extruder_steps - self.furthest;
        if ahead > 0 {
            self.furthest = extruder_steps;
            self.at_end = Pushed(self.at_end.0.wrapping_add(ahead as u32));
        }
    }

    /// Corrects the count after a stop: of the queued filament at least `played` has been pushed,
    /// and the extruder is at `extruder_steps`.
    pub fn stop_at(&mut self, played: Pushed, extruder_steps: i64) {
        self.furthest -= i64::from(self.at_end.steps_since(played));
        self.at_end = played;
        self.follow(extruder_steps);
    }
}

/// Filament that the extruder has pushed by now. If the two differ, it is pushing new filament.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PushedFilament {
    /// Minimum count.
    pub at_least: Pushed,
    /// Largest count; some steps of a piece that is drawn back between two looks at the queue's
    /// end may be missing.
    pub at_most: Pushed,
}

#[cfg(test)]
mod tests;

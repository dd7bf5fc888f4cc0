//! Speed at which filament is melted, from the extruder's position at each sample.

use super::sample_time::SAMPLE_S;

/// Share of the newest speed in the smoothed one, per sample: a time constant of half a second.
/// Motion is planned in pieces of up to that length, and retracted filament that is pushed again
/// does not melt.
const SHARE: f32 = 2.0 * SAMPLE_S;

/// Change in one sample that no extruder can make, thousandths of a millimetre: its position was
/// set.
const JUMP_UM: u32 = 5_000;

/// The smoothed speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilamentSpeed {
    pushed_um: Option<i32>,
    mm_per_s: f32,
}

impl FilamentSpeed {
    /// Filament at rest.
    pub const NONE: Self = Self { pushed_um: None, mm_per_s: 0.0 };

    /// Takes where the extruder is, thousandths of a millimetre; the numbers may wrap.
    pub fn note(&mut self, pushed_um: i32) {
        let change_um = pushed_um.wrapping_sub(self.pushed_um.unwrap_or(pushed_um));
        self.pushed_um = Some(pushed_um);
        if change_um.unsigned_abs() < JUMP_UM {
            let mm_per_s = change_um as f32 * 1e-3 / SAMPLE_S;
            self.mm_per_s += (mm_per_s - self.mm_per_s) * SHARE;
        }
    }

    /// The speed, mm/s; 0 while more is drawn back than pushed.
    pub const fn mm_per_s(&self) -> f32 {
        self.mm_per_s.max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_steady_speed_is_found_whatever_the_pieces_and_jumps_do_not_count() {
        for (every, um) in [(1, 60), (5, 300), (20, 1_200)] {
            let mut speed = FilamentSpeed::NONE;
            let mut pushed_um = i32::MAX - 1_000;
            for sample in 0..600 {
                if sample % every == 0 {
                    pushed_um = pushed_um.wrapping_add(um);
                }
                speed.note(pushed_um);
            }
            assert!((speed.mm_per_s() - 6.0).abs() < 1.3, "{speed:?} in pieces of {um}");
            let before = speed.mm_per_s();
            speed.note(pushed_um.wrapping_add(1_000_000));
            assert!(speed.mm_per_s() == before);
        }
    }

    #[test]
    fn what_is_drawn_back_is_no_speed() {
        let mut speed = FilamentSpeed::NONE;
        (0..10).for_each(|sample| speed.note(-300 * sample));
        assert_eq!(speed.mm_per_s(), 0.0);
    }
}

//! Loads that take heat from a heater's mass beside the air: filament, and a second mass
//! attached to the first.

use super::*;

/// Heat that PLA of 1.75 mm takes, J/K for each millimetre: 1.8 J/(g K), 1.24 g/cm^3, 2.405 mm^2.
const PLA_J_PER_K_MM: f32 = 0.005_37;
/// Filament leaves the nozzle colder than the block, the more so the faster: this
/// share of the heat ...
const HEATED_SHARE: f32 = 0.85;
/// ... and it takes the heat on its way down, with a time constant of this, s.
const MELTING_S: f32 = 0.8;

/// A nozzle, a sock or a plate attached to the block.
#[derive(Clone, Copy, Debug)]
pub struct SecondMass {
    pub capacity_j_per_k: f32,
    pub coupling_w_per_k: f32,
    pub celsius: f32,
}

/// Filament and a second mass.
#[derive(Clone, Copy, Debug, Default)]
pub struct Load {
    /// Speed of the filament, mm/s.
    pub filament_mm_per_s: f32,
    /// Position of the extruder, thousandths of a millimetre.
    pub pushed_um: i64,
    melting_w: f32,
    pub second: Option<SecondMass>,
}

impl Load {
    /// Advances by a sample.
    pub fn pass(&mut self, heater: Heater, board: &mut VirtualHeaters) {
        let seconds = SAMPLE_MS as f32 * 1e-3;
        let celsius = board.true_celsius(heater);
        self.pushed_um += (self.filament_mm_per_s * 1e3 * seconds).round() as i64;
        let wanted_w = self.filament_mm_per_s * PLA_J_PER_K_MM * HEATED_SHARE * (celsius - 22.0);
        self.melting_w += (wanted_w - self.melting_w) * seconds / MELTING_S;
        board.warm(heater, -self.melting_w, seconds);
        if let Some(second) = &mut self.second {
            let watts = second.coupling_w_per_k * (celsius - second.celsius);
            second.celsius += watts / second.capacity_j_per_k * seconds;
            board.warm(heater, -watts, seconds);
        }
    }
}

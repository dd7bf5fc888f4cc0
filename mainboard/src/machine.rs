//! x
use rigless::machine::armv7m;
use rigless::machine::{Board, Target};
use rigless::soc::Error;
use rigless::store;
use std::num::{NonZeroU32, NonZeroU64};

use crate::chip::{Chip, Model};

/// The machine.
#[derive(Debug)]
pub struct Machine {
    /// chip
    pub chip: Chip,
    ips: NonZeroU64,
}

store!(Machine { values: [], parts: [chip], built: [ips] });

impl Machine {
    /// new
    pub fn new(model: Model, crystal_hz: u64) -> Result<Self, Error> {
        let mut chip = Chip::new(model)?;
        chip.set_crystal(crystal_hz);
        chip.set_supply(3300);
        Ok(Self { chip, ips: NonZeroU64::new(120_000_000).unwrap() })
    }
}

impl Board for Machine {
    fn name(&self) -> &'static str {
        "mainboard"
    }
    fn target_names(&self) -> Vec<&'static str> {
        vec!["mcu"]
    }
    fn mcu(&mut self, target: usize) -> Option<&mut dyn rigless::mcu::Mcu> {
        (target == 0).then_some(&mut self.chip)
    }
    fn targets(&mut self) -> Vec<Target<'_>> {
        let windows = rigless::cpu::armv7m::windows(rigless::mcu::Mcu::bus(&self.chip));
        let core = armv7m::Core {
            variant: armv7m::Variant::M4,
            clock_hz: NonZeroU64::new(168_000_000).unwrap(),
            interrupt_lines: NonZeroU32::new(91).unwrap(),
            priority_bits: 4,
            refclk_divider: NonZeroU32::new(8).unwrap(),
            instructions_per_second: self.ips,
            boot: "flash",
        }
        .spec_with_parts(&windows, armv7m::Fpu::FpV4Sp, armv7m::MpuRegions::Eight);
        vec![Target::new("mcu", &mut self.chip, core)]
    }
}

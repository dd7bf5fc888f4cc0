//! Registers in memory that record every store.

use std::collections::BTreeMap;

use super::Registers;
use crate::rcc::{RCC_AHB1ENR, RCC_APB2ENR};

/// Memory that replaces a chip: loads return the last store, or a fixed value.
#[derive(Clone, Debug, Default)]
pub struct Recorder {
    values: BTreeMap<u32, u32>,
    fixed: BTreeMap<u32, u32>,
    /// Every store, in order: address and value.
    pub stores: Vec<(u32, u32)>,
}

impl Recorder {
    /// A register's value after reset, if it is not 0.
    pub fn with(mut self, address: u32, value: u32) -> Self {
        self.values.insert(address, value);
        self
    }

    /// Fixes a register's value, as the hardware sets it: stores do not change it.
    pub fn fix(&mut self, address: u32, value: u32) {
        self.fixed.insert(address, value);
    }

    /// The last value of a register.
    pub fn value(&self, address: u32) -> u32 {
        self.values.get(&address).copied().unwrap_or_default()
    }

    /// Values stored to a register, in order.
    pub fn stored(&self, address: u32) -> Vec<u32> {
        self.stores.iter().filter(|(to, _)| *to == address).map(|(_, value)| *value).collect()
    }

    /// Place of the first store to a register with these bits.
    pub fn position(&self, address: u32, bits: u32) -> Option<usize> {
        self.stores.iter().position(|(to, value)| *to == address && value & bits == bits)
    }
}

impl Registers for Recorder {
    fn read(&mut self, address: u32) -> u32 {
        self.fixed.get(&address).copied().unwrap_or_else(|| self.value(address))
    }

    fn write(&mut self, address: u32, value: u32) {
        self.values.insert(address, value);
        self.stores.push((address, value));
    }
}
/// Registers that lose the first access after a clock was switched on, unless the
/// switch was read back.
#[derive(Clone, Debug)]
pub struct Sluggish<R> {
    /// The registers.
    pub registers: R,
    /// The switch that was stored to last.
    switched: Option<u32>,
    /// Number of lost loads and stores.
    pub lost: u32,
}

impl<R: Registers> Sluggish<R> {
    /// A sluggish view of these registers.
    pub fn new(registers: R) -> Self {
        Self { registers, switched: None, lost: 0 }
    }

    /// Returns true if this load or store is lost.
    fn loses(&mut self, address: u32) -> bool {
        let is_lost = self.switched.take().is_some_and(|switch| switch != address);
        self.lost += u32::from(is_lost);
        is_lost
    }
}

impl<R: Registers> Registers for Sluggish<R> {
    fn read(&mut self, address: u32) -> u32 {
        if self.loses(address) { 0 } else { self.registers.read(address) }
    }

    fn write(&mut self, address: u32, value: u32) {
        if self.loses(address) {
            return;
        }
        let before = self.registers.read(address);
        if (RCC_AHB1ENR..=RCC_APB2ENR).contains(&address) && value & !before != 0 {
            self.switched = Some(address);
        }
        self.registers.write(address, value);
    }
}

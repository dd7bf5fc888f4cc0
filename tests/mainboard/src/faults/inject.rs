//! Makes a fault happen on a running machine.

use std::collections::VecDeque;

use rigless::chip::uart::{Errors, Rate};
use rigless::emulator::Host;
use rigless::mcu::{Operate, flip_bytes};
use rigless::soc::Width;
use rigless::time::VirtualNanos;

use super::fault::{Block, DriverFault, Fault, Memory, SupplyFault, ThermistorFault};
use super::host_side::HostSide;
use super::image::Layout;
use crate::chip::Halt;
use crate::machine::{HOST_PORT, Machine};
use crate::parts::fan::FanFault;
use crate::parts::heat::thermistor::SensorFault;
use crate::parts::random::Random;
use crate::parts::tmc2209;
use crate::pins::Pin;

const MILLISECOND: u64 = 1_000_000;
const MOTORS: [&str; 4] = ["X", "Y", "Z", "E"];
/// A branch to itself, Thumb encoding T2.
const BRANCH_TO_ITSELF: u64 = 0xE7FE;
/// RCC's enables of APB2, RM0090 6.3.14: ADC1EN to ADC3EN are bits 8 to 10.
const RCC_APB2ENR: u64 = 0x4002_3844;
const ADCEN: u64 = 0b111 << 8;
/// ADC1 to ADC3, 0x100 apart: CR2 is at 0x08 with ADON in bit 0, DR at 0x4C (RM0090 13.13).
const ADC: u64 = 0x4001_2000;
const ADC_CR2: u64 = 0x08;
const ADC_DR: u64 = 0x4C;
/// DMA2: CR of stream n is at 0x10 + 0x18 n with EN in bit 0, PAR at 0x18 + 0x18 n (RM0090 10.5).
const DMA2: u64 = 0x4002_6400;
/// A driver's temperature above all its limits, degrees Celsius.
const HOT_CELSIUS: f64 = 165.0;

/// A later step of a fault that lasts.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Later {
    MotorSupplyReturns,
    ChipSupplyReturns,
    LineRecovers,
    DriverSupplied(usize),
    Toggle { pin: Pin, level: bool, until_ns: u64, step_ns: u64 },
}

/// A fault that happens at its instant.
#[derive(Debug)]
pub struct Injection {
    /// The fault.
    pub fault: Fault,
    /// The instant, ns of the run.
    pub at_ns: u64,
    /// Description of what was done; empty before the fault.
    pub detail: String,
    /// The machine has no such part, so the fault did not happen.
    pub without: bool,
    /// The motor that the fault concerns, if it concerns one.
    pub motor: Option<usize>,
    random: Random,
    later: VecDeque<(u64, Later)>,
    /// Bits that are cleared again at each turn: register and mask.
    held: Vec<(u64, u64)>,
    done: bool,
}

impl Injection {
    /// A future fault.
    #[must_use]
    pub fn new(fault: Fault, at_ns: u64, random: Random) -> Self {
        Self {
            fault,
            at_ns,
            detail: String::new(),
            without: false,
            motor: None,
            random,
            later: VecDeque::new(),
            held: Vec::new(),
            done: false,
        }
    }

    /// True if the fault has happened.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.done
    }

    /// The next instant at which the fault acts, ns.
    #[must_use]
    pub fn next_ns(&self) -> Option<u64> {
        if self.done { self.later.front().map(|(at_ns, _)| *at_ns) } else { Some(self.at_ns) }
    }

    /// Does what is due.
    pub fn turn(
        &mut self,
        machine: &mut Machine,
        side: &mut HostSide,
        layout: &Layout,
        now_ns: u64,
        host: &mut dyn Host,
    ) {
        while let Some((_, later)) = self.later.pop_front_if(|(at_ns, _)| *at_ns <= now_ns) {
            self.apply_later(machine, later, now_ns);
        }
        for (address, bits) in &self.held {
            clear(machine, now_ns, *address, *bits);
        }
        if self.done || now_ns < self.at_ns {
            return;
        }
        self.done = true;
        self.at_ns = now_ns;
        match self.apply(machine, side, layout, now_ns, host) {
            Some(detail) => self.detail = detail,
            None => self.without = true,
        }
        machine.plant.refresh_inputs();
    }

    fn apply_later(&mut self, machine: &mut Machine, later: Later, now_ns: u64) {
        match later {
            Later::MotorSupplyReturns => machine.plant.motor_rail.restore(now_ns),
            Later::ChipSupplyReturns => machine.plant.chip_rail.restore(now_ns),
            Later::LineRecovers => {
                if let Some(line) = machine.chip.serial_port(HOST_PORT) {
                    *line.errors_mut() = Errors::default();
                }
            }
            Later::DriverSupplied(motor) => {
                machine.plant.disturb_driver(now_ns, motor, |driver| driver.set_supply(now_ns, true));
            }
            Later::Toggle { pin, level, until_ns, step_ns } => {
                if now_ns >= until_ns {
                    machine.plant.refresh_inputs();
                    return;
                }
                machine.chip.drive_pin(VirtualNanos(now_ns), pin, Some(level));
                let next = Later::Toggle { pin, level: !level, until_ns, step_ns };
                self.later.push_back((now_ns + step_ns, next));
            }
        }
    }

    /// Makes the fault happen; returns its details, or `None` if the machine has no such part.
    fn apply(
        &mut self,
        machine: &mut Machine,
        side: &mut HostSide,
        layout: &Layout,
        now_ns: u64,
        host: &mut dyn Host,
    ) -> Option<String> {
        match self.fault {
            Fault::Control => Some(String::new()),
            Fault::CrystalStops => {
                machine.chip.stop_crystal(VirtualNanos(now_ns));
                machine.chip.set_crystal(0);
                Some(String::new())
            }
            Fault::MotorSupply(supply) => Some(self.motor_supply(machine, supply, now_ns)),
            Fault::ChipSupply(supply) => Some(self.chip_supply(machine, supply, now_ns)),
            Fault::HostVanishes => {
                side.vanish(machine);
                Some(String::new())
            }
            Fault::HostLineGarbles => self.garble(machine, now_ns),
            Fault::Thermistor(block, sensor) => self.thermistor(machine, block, sensor, now_ns),
            Fault::Heater(block, fault) => {
                let place = machine.plant.heaters.iter_mut().find(|place| place.name.starts_with(block.name()))?;
                place.heater.set_fault(now_ns, Some(fault));
                Some(String::new())
            }
            Fault::ConverterStands => clear(machine, now_ns, RCC_APB2ENR, ADCEN),
            Fault::ConverterHiccup => {
                let done: Vec<String> =
                    (0..3).filter_map(|nth| clear(machine, now_ns, ADC + 0x100 * nth + ADC_CR2, 1)).collect();
                (!done.is_empty()).then(|| done.join(", "))
            }
            Fault::TransferStands | Fault::TransferHiccup => {
                let mut done = Vec::new();
                for stream in 0..8 {
                    let from = peek(machine, now_ns, DMA2 + 0x18 + 0x18 * stream);
                    if (0..3).any(|nth| from == Some(ADC + 0x100 * nth + ADC_DR)) {
                        let control = DMA2 + 0x10 + 0x18 * stream;
                        done.extend(clear(machine, now_ns, control, 1));
                        if self.fault == Fault::TransferStands {
                            self.held.push((control, 1));
                        }
                    }
                }
                (!done.is_empty()).then(|| done.join(", "))
            }
            Fault::Driver(trouble) => self.driver(machine, trouble, now_ns),
            Fault::EndStop(fault) => {
                let count = (0..3).filter(|stop| machine.plant.motion.end_stop(*stop).is_some()).count();
                let stop = self.pick(count)?;
                machine.plant.motion.end_stop_mut(stop)?.set_fault(Some(fault));
                Some(format!("switch {stop}"))
            }
            Fault::Probe(fault) => {
                machine.plant.motion.probe_mut()?.set_fault(Some(fault));
                Some(String::new())
            }
            Fault::FanStuck => {
                let fan = self.pick(machine.plant.fans.len())?;
                let place = machine.plant.fans.get_mut(fan)?;
                place.fan.set_fault(now_ns, Some(FanFault::Stuck));
                Some(place.name.clone())
            }
            Fault::Flip(memory) => self.flip(layout, memory, host),
            Fault::TaskHangs => {
                let index = self.pick(layout.handlers.len())?;
                let (line, address) = layout.handlers[index];
                host.program(u64::from(address), Width::W16, BRANCH_TO_ITSELF).ok()?;
                Some(format!("exception {line} at {address:#010x}"))
            }
            Fault::CoreHalted => {
                machine.chip.halt(VirtualNanos(now_ns), Halt::Debugger);
                Some(String::new())
            }
            Fault::InputStorm => {
                let pins: Vec<Pin> = machine.plant.input_pins().collect();
                let pin = pins[self.pick(pins.len())?];
                let step_ns = self.random.between(2_000, 20_000);
                let until_ns = now_ns + self.random.between(1, 50) * MILLISECOND;
                let storm = Later::Toggle { pin, level: true, until_ns, step_ns };
                self.later.push_back((now_ns + 1, storm));
                Some(format!("{pin}, every {step_ns} ns for {} ms", (until_ns - now_ns) / MILLISECOND))
            }
        }
    }

    fn pick(&mut self, count: usize) -> Option<usize> {
        let last = u64::try_from(count).ok()?.checked_sub(1)?;
        usize::try_from(self.random.between(0, last)).ok()
    }

    fn later(&mut self, at_ns: u64, what: Later) {
        self.later.push_back((at_ns, what));
    }

    fn motor_supply(&mut self, machine: &mut Machine, supply: SupplyFault, now_ns: u64) -> String {
        let (to_mv, for_ms) = match supply {
            SupplyFault::Sags => (self.random.between(6_000, 20_000), Some(self.random.between(100, 3_000))),
            SupplyFault::Dips => (0, Some(self.random.between(5, 60))),
            SupplyFault::Cut => (0, None),
            SupplyFault::Returns => (0, Some(self.random.between(200, 2_000))),
        };
        machine.plant.motor_rail.aim(now_ns, to_mv as f64);
        self.schedule_return(now_ns, to_mv, for_ms, Later::MotorSupplyReturns)
    }

    fn chip_supply(&mut self, machine: &mut Machine, supply: SupplyFault, now_ns: u64) -> String {
        let (to_mv, for_ms) = match supply {
            SupplyFault::Sags => (self.random.between(2_000, 2_600), Some(self.random.between(50, 500))),
            // Long enough for the rail, with its own capacitors, to fall below the brown-out level.
            SupplyFault::Dips => (self.random.between(0, 2_000), Some(self.random.between(6, 20))),
            SupplyFault::Cut => (0, None),
            SupplyFault::Returns => (0, Some(self.random.between(100, 1_000))),
        };
        machine.plant.chip_rail.aim(now_ns, to_mv as f64);
        self.schedule_return(now_ns, to_mv, for_ms, Later::ChipSupplyReturns)
    }

    fn schedule_return(&mut self, now_ns: u64, to_mv: u64, for_ms: Option<u64>, what: Later) -> String {
        let Some(for_ms) = for_ms else { return format!("to {to_mv} mV for good") };
        self.later(now_ns + for_ms * MILLISECOND, what);
        format!("to {to_mv} mV for {for_ms} ms")
    }

    fn garble(&mut self, machine: &mut Machine, now_ns: u64) -> Option<String> {
        let per_million = u32::try_from(self.random.between(1_000, 300_000)).ok()?;
        let for_ms = self.random.between(10, 2_000);
        let noise = Rate { name: "line.noise_errors", per_million };
        let errors = machine.chip.serial_port(HOST_PORT)?.errors_mut();
        (errors.noise, errors.seed) = (noise, self.random.bits());
        self.later(now_ns + for_ms * MILLISECOND, Later::LineRecovers);
        Some(format!("{per_million} of a million bytes for {for_ms} ms"))
    }

    fn thermistor(
        &mut self,
        machine: &mut Machine,
        block: Block,
        sensor: ThermistorFault,
        now_ns: u64,
    ) -> Option<String> {
        let (fault, detail) = match sensor {
            ThermistorFault::Open => (SensorFault::Open, String::new()),
            ThermistorFault::Short => (SensorFault::Short, String::new()),
            ThermistorFault::SlippedOut => {
                let seconds = self.random.between(2, 15);
                // Fully out of its hole: the firmware cannot detect one that is half out, as the
                // documentation says.
                let coupling = self.random.unit() * 0.05;
                let fault =
                    SensorFault::SlippedOut { since_ns: now_ns, time_constant_ns: seconds * 1_000_000_000, coupling };
                (fault, format!("within {seconds} s, coupling {coupling:.2}"))
            }
            ThermistorFault::Loose => {
                let probability = 0.01 + 0.5 * self.random.unit();
                (SensorFault::Loose { probability }, format!("{probability:.2} of the samples are open"))
            }
            ThermistorFault::Drifts => {
                let kelvin_per_hour = if self.random.chance(0.5) { -600.0 } else { 600.0 };
                (SensorFault::Drift { since_ns: now_ns, kelvin_per_hour }, format!("{kelvin_per_hour} K per hour"))
            }
        };
        let place = machine.plant.thermistors.iter_mut().find(|place| place.name == block.name())?;
        place.thermistor.set_fault(Some(fault));
        Some(detail)
    }

    fn driver(&mut self, machine: &mut Machine, trouble: DriverFault, now_ns: u64) -> Option<String> {
        let motor = self.pick(machine.plant.drivers.len().min(MOTORS.len()))?;
        self.motor = Some(motor);
        let plant = &mut machine.plant;
        let mut detail = format!("driver {}", MOTORS[motor]);
        match trouble {
            DriverFault::Resets => {
                let for_us = self.random.between(100, 200_000);
                plant.disturb_driver(now_ns, motor, |driver| driver.set_supply(now_ns, false));
                self.later(now_ns + for_us * 1_000, Later::DriverSupplied(motor));
                detail.push_str(&format!(", without supply for {for_us} us"));
            }
            DriverFault::Hot => {
                plant.disturb_driver(now_ns, motor, |driver| driver.set_temperature(now_ns, HOT_CELSIUS))
            }
            DriverFault::Short => plant.disturb_driver(now_ns, motor, |driver| {
                driver.set_fault(now_ns, tmc2209::Fault::ShortToGroundA, true);
            }),
            DriverFault::Mute => plant.disturb_driver(now_ns, motor, |driver| {
                driver.set_fault(now_ns, tmc2209::Fault::Mute, true);
            }),
        }
        Some(detail)
    }

    fn flip(&mut self, layout: &Layout, memory: Memory, host: &mut dyn Host) -> Option<String> {
        let ranges = match memory {
            Memory::Ram => &layout.ram,
            Memory::Ccm => &layout.ccm,
            Memory::Flash => &layout.flash,
        };
        let sizes: u64 = ranges.iter().map(|range| range.end - range.start).sum();
        let mut place = self.random.between(0, sizes.checked_sub(1)?);
        let range = ranges.iter().find(|range| {
            let size = range.end - range.start;
            let here = place < size;
            place -= if here { 0 } else { size };
            here
        })?;
        let address = range.start + place;
        let bit = self.random.between(0, 7);
        // The mask's top bits belong to the first byte of the word.
        let mask = 1_u64 << (8 * (7 - (address & 7)) + bit);
        flip_bytes(address, mask, host).ok()?;
        Some(format!("bit {bit} of the byte at {address:#010x}{}", layout.symbol(address)))
    }
}

fn peek(machine: &mut Machine, now_ns: u64, address: u64) -> Option<u64> {
    machine.chip.peek(VirtualNanos(now_ns), address, Width::W32).ok()
}

/// Clears bits of a register like a stray write; `None` if they are clear already.
fn clear(machine: &mut Machine, now_ns: u64, address: u64, bits: u64) -> Option<String> {
    let value = peek(machine, now_ns, address)?;
    if value & bits == 0 {
        return None;
    }
    machine.chip.write(VirtualNanos(now_ns), address, Width::W32, value & !bits).ok()?;
    Some(format!("{address:#010x} was {value:#x}"))
}

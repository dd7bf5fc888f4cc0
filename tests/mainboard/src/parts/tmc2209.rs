//! TMC2209: a stepper driver with a single-wire serial line (data sheet revision 1.09).
//!
//! Covered:
//!
//! | what | data sheet | test |
//! |---|---|---|
//! | datagrams, checksum, address, IFCNT, SENDDELAY, recovery after errors | 4.1 to 4.3 | `reads_and_writes`, `refuses_*`, `recovers_*`, `reply_waits_*` |
//! | a node with SENDDELAY below 2 misreads its neighbours' replies | 4.1.2, 5.1 | `a_short_send_delay_*` |
//! | registers: access, values at reset, GSTAT write-1-to-clear, live IOIN | 5.1 to 5.5 | `registers_*`, `ioin_*` |
//! | STEP, DIR, both edges, MRES, MS1 and MS2, GCONF.shaft, MSCNT, MSCURACT | 5.4, 13 | `steps_*`, `a_turn_*`, `microsteps_by_*` |
//! | STEP and DIR: shortest times, against 13.1 | 13.1 | `records_the_shortest_*` |
//! | TSTEP, standstill, run and hold current, sense resistor, vsense, VREF | 5.2, 6, 8, 9 | `tstep_*`, `current_*` |
//! | SG_RESULT and DIAG by SGTHRS, TCOOLTHRS, TPWMTHRS | 5.3, 11 | `a_stall_*` |
//! | over-temperature, shorts, open load, charge pump, DIAG on error | 5.5.3, 15 | `a_short_*`, `heat_*` |
//! | supply off: silent, outputs off, registers lost, GSTAT.reset after | 5.1, 20 | `without_supply_*` |
//!
//! Left out, and why:
//! - VACTUAL and the INDEX pin: no board here turns a motor by them. VACTUAL is
//!   stored without effect.
//! - GCONF: internal_Rsense, multistep_filt, test_mode and the bits of INDEX are
//!   stored without effect.
//! - MicroPlyer's interpolation (CHOPCONF.intpol): a step is a jump; the position at each
//!   step is the same.
//! - stealthChop's tuning: PWM_SCALE and PWM_AUTO report PWMCONF's initial values. coolStep
//!   (COOLCONF) changes no current.
//! - OTP_PROG: writes are counted and have no effect; [`Config`] sets the memory's contents.
//! - SG_RESULT depends linearly on the load of one full step; in the chip it also depends on speed,
//!   current and motor.
//! - The input filter of STEP and DIR: pulses that are too short are counted, yet make their steps.
//! - SG_RESULT between standstill and the first full step, which the data sheet leaves open: the
//!   old value stays readable and raises no DIAG, because drivers in the field start from a stall
//!   without a false one.
//! - TSTEP's hysteresis at thresholds. Clock drift: the chip's 12 MHz is exact.
//! - The level of DIR that counts MSCNT up, which the data sheet leaves open: here low does. The
//!   wiring decides the direction of motion.
//! - Loss of VCC_IO while the motor supply stays.

mod current;
pub mod datagram;
mod line;
mod readback;
pub mod registers;
#[cfg(test)]
mod tests;

use datagram::Receiver;
use registers::{Registers, address, drv_status, gstat};

/// TSTEP at standstill, and the clocks without a step before standstill minus one (5.2).
const TSTEP_MAX: u32 = 0xF_FFFF;
/// Minimum high and low time of STEP in ns: the filter's 100 ns (13.1).
pub const STEP_MINIMUM_NS: u64 = 100;
/// Minimum set-up and hold time of DIR around a step in ns (13.1).
pub const DIRECTION_MINIMUM_NS: u64 = 20;

/// The parts around a driver.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Config {
    /// Level at MS1: lowest bit of the address, and microsteps until a register selects them.
    pub ms1: bool,
    /// Level at MS2: second bit of the address.
    pub ms2: bool,
    /// Level at SPREAD: inverts GCONF.en_SpreadCycle.
    pub spread: bool,
    /// Sense resistors in milliohms, typically 110.
    pub sense_milliohm: u32,
    /// Voltage at VREF in millivolts; 2500 and above is full scale.
    pub vref_mv: u32,
    /// The chip's clock in Hz: 12 000 000 internally.
    pub clock_hz: u32,
    /// One-time memory, as OTP_READ shows it; 0 as delivered, except the clock's
    /// trim in bits 0 to 4.
    pub otp: u32,
    /// SG_RESULT of this motor when it turns freely, 0 to 510.
    pub sg_result_unloaded: u16,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            ms1: false,
            ms2: false,
            spread: false,
            sense_milliohm: 110,
            vref_mv: 2500,
            clock_hz: 12_000_000,
            otp: 0x0F,
            sg_result_unloaded: 300,
        }
    }
}

/// A fault of a driver or its motor; [`Tmc2209::set_fault`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Fault {
    /// Phase A shorted to ground (s2ga).
    ShortToGroundA,
    /// Phase B shorted to ground (s2gb).
    ShortToGroundB,
    /// Phase A shorted to the supply (s2vsa).
    ShortToSupplyA,
    /// Phase B shorted to the supply (s2vsb).
    ShortToSupplyB,
    /// Phase A not connected (ola).
    OpenLoadA,
    /// Phase B not connected (olb).
    OpenLoadB,
    /// Charge pump below its voltage (uv_cp): outputs off meanwhile.
    ChargePump,
    /// The serial line neither receives nor sends.
    Mute,
}

/// The field's movement by one step, in 1/256 of a full step, positive when MSCNT counts up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Microsteps {
    /// The movement, -256 to 256.
    pub delta: i32,
    /// The outputs are on, so that the motor follows.
    pub energized: bool,
}

/// Shortest times at STEP and DIR, in ns; `u64::MAX` before the first.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Timing {
    /// STEP high.
    pub high_ns: u64,
    /// STEP low.
    pub low_ns: u64,
    /// Time from DIR's edge to the next step.
    pub direction_setup_ns: u64,
    /// Time from a step to DIR's next edge.
    pub direction_hold_ns: u64,
    /// Number of steps, including those with the outputs off.
    pub steps: u64,
    /// Number of times below the data sheet's minima (13.1).
    pub violations: u64,
}

/// The driver.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Tmc2209 {
    config: Config,
    registers: Registers,
    receiver: Receiver,
    /// End of its latest reply, until which it does not receive.
    transmits_until_ns: u64,
    supplied: bool,
    mute: bool,
    enable_not: bool,
    step_level: bool,
    direction_level: bool,
    pdn_level: bool,
    step_edge_ns: Option<u64>,
    direction_edge_ns: Option<u64>,
    timing: Timing,
    /// Microstep counter, 0 to 1023.
    mscnt: u16,
    /// The last step, or the arrival of the supply.
    last_step_ns: u64,
    stepped: bool,
    tstep: u32,
    load: f32,
    sg_result: u16,
    /// SG_RESULT was measured since the last standstill.
    sg_measured: bool,
    celsius: f64,
    over_temperature: bool,
    faults_present: u32,
    charge_pump_low: bool,
    shorts_latched: u32,
    // Computed when an input changes, so that a step is cheap.
    delta: i32,
    energized: bool,
    diag: bool,
    standstill_after_ns: u64,
}

const SHORTS: u32 = drv_status::S2GA | drv_status::S2GB | drv_status::S2VSA | drv_status::S2VSB;

impl Tmc2209 {
    /// A driver without supply: EN high, STEP and DIR low, at 25 degrees Celsius.
    pub fn new(config: Config) -> Self {
        let standstill_after_ns = (1_u64 << 20) * 1_000_000_000 / u64::from(config.clock_hz.max(1));
        let registers = Registers::at_reset(config.otp);
        Self {
            config,
            registers,
            receiver: Receiver::default(),
            transmits_until_ns: 0,
            supplied: false,
            mute: false,
            enable_not: true,
            step_level: false,
            direction_level: false,
            pdn_level: true,
            step_edge_ns: None,
            direction_edge_ns: None,
            timing: Timing {
                high_ns: u64::MAX,
                low_ns: u64::MAX,
                direction_setup_ns: u64::MAX,
                direction_hold_ns: u64::MAX,
                steps: 0,
                violations: 0,
            },
            mscnt: 0,
            last_step_ns: 0,
            stepped: false,
            tstep: TSTEP_MAX,
            load: 0.0,
            sg_result: 0,
            sg_measured: false,
            celsius: 25.0,
            over_temperature: false,
            faults_present: 0,
            charge_pump_low: false,
            shorts_latched: 0,
            delta: 0,
            energized: false,
            diag: false,
            standstill_after_ns,
        }
    }

    /// The address on the line: 0 to 3, from MS1 and MS2.
    pub fn node(&self) -> u8 {
        u8::from(self.config.ms1) | u8::from(self.config.ms2) << 1
    }

    /// Switches the motor supply on or off. Without it the chip has no clock: silent, outputs
    /// off, registers lost.
    pub fn set_supply(&mut self, now_ns: u64, on: bool) {
        if on == self.supplied {
            return;
        }
        self.supplied = on;
        self.registers = Registers::at_reset(self.config.otp);
        self.receiver.reset();
        self.transmits_until_ns = now_ns;
        (self.mscnt, self.sg_result, self.tstep) = (0, 0, TSTEP_MAX);
        (self.last_step_ns, self.stepped, self.sg_measured) = (now_ns, false, false);
        (self.shorts_latched, self.over_temperature) = (0, false);
        self.settle(now_ns);
    }

    /// True if the motor supply is on.
    pub fn supplied(&self) -> bool {
        self.supplied
    }

    /// Sets the level at EN (ENN in the data sheet: low switches the outputs on).
    pub fn set_enable_pin(&mut self, now_ns: u64, level: bool) {
        self.enable_not = level;
        self.settle(now_ns);
    }

    /// Sets the level at PDN_UART as power-down input, which matters only while GCONF.pdn_disable
    /// is 0. High before the first call.
    pub fn set_pdn_pin(&mut self, level: bool) {
        self.pdn_level = level;
    }

    /// Sets the level at DIR.
    pub fn set_direction_pin(&mut self, now_ns: u64, level: bool) {
        if level == self.direction_level {
            return;
        }
        self.direction_level = level;
        self.direction_edge_ns = Some(now_ns);
        if self.stepped {
            let hold_ns = now_ns.saturating_sub(self.last_step_ns);
            self.timing.direction_hold_ns = self.timing.direction_hold_ns.min(hold_ns);
            self.timing.violations += u64::from(hold_ns < DIRECTION_MINIMUM_NS);
        }
        self.delta = self.microsteps();
    }

    /// Sets the level at STEP, at each edge; returns the movement of a step.
    pub fn set_step_pin(&mut self, now_ns: u64, level: bool) -> Option<Microsteps> {
        if level == self.step_level {
            return None;
        }
        self.step_level = level;
        if let Some(edge_ns) = self.step_edge_ns {
            let width_ns = now_ns.saturating_sub(edge_ns);
            let shortest_ns = if level { &mut self.timing.low_ns } else { &mut self.timing.high_ns };
            *shortest_ns = width_ns.min(*shortest_ns);
            self.timing.violations += u64::from(width_ns < STEP_MINIMUM_NS);
        }
        self.step_edge_ns = Some(now_ns);
        if !self.supplied || !(level || self.registers.double_edge()) {
            return None;
        }
        if let Some(edge_ns) = self.direction_edge_ns.take() {
            let setup_ns = now_ns.saturating_sub(edge_ns);
            self.timing.direction_setup_ns = setup_ns.min(self.timing.direction_setup_ns);
            self.timing.violations += u64::from(setup_ns < DIRECTION_MINIMUM_NS);
        }
        self.timing.steps += 1;
        self.take_step(now_ns);
        Some(Microsteps { delta: self.delta, energized: self.energized })
    }

    fn take_step(&mut self, now_ns: u64) {
        let before = self.mscnt;
        self.mscnt = ((i32::from(before) + self.delta) & 1023) as u16;
        let elapsed_ns = now_ns.saturating_sub(self.last_step_ns);
        self.tstep = if !self.stepped || elapsed_ns >= self.standstill_after_ns {
            self.sg_measured = false;
            TSTEP_MAX
        } else {
            let clocks = elapsed_ns * u64::from(self.config.clock_hz) / 1_000_000_000;
            (clocks as u32 / self.delta.unsigned_abs()).min(TSTEP_MAX)
        };
        (self.last_step_ns, self.stepped) = (now_ns, true);
        // A new value at each full step (11.1).
        if before >> 8 != self.mscnt >> 8 || self.delta.unsigned_abs() == 256 {
            self.sg_result = self.measured_load();
            self.sg_measured = true;
        }
        self.diag = self.diag_at(now_ns);
    }

    fn measured_load(&self) -> u16 {
        if !self.energized {
            return 0;
        }
        let unloaded = f32::from(self.config.sg_result_unloaded.min(510));
        // Bits 9 and 0 are always 0 (5.3).
        (unloaded * (1.0 - self.load)) as u16 & 0x1FE
    }

    /// Sets the motor's load, 0 for free to 1 for stalled. SG_RESULT follows at the next full step.
    pub fn set_load(&mut self, load: f32) {
        self.load = load.clamp(0.0, 1.0);
    }

    /// Sets the chip's temperature in degrees Celsius.
    pub fn set_temperature(&mut self, now_ns: u64, celsius: f64) {
        self.celsius = celsius;
        self.settle(now_ns);
    }

    /// Causes or mends a fault.
    pub fn set_fault(&mut self, now_ns: u64, fault: Fault, present: bool) {
        let bit = match fault {
            Fault::ShortToGroundA => drv_status::S2GA,
            Fault::ShortToGroundB => drv_status::S2GB,
            Fault::ShortToSupplyA => drv_status::S2VSA,
            Fault::ShortToSupplyB => drv_status::S2VSB,
            Fault::OpenLoadA => drv_status::OLA,
            Fault::OpenLoadB => drv_status::OLB,
            Fault::ChargePump => {
                self.charge_pump_low = present;
                return self.settle(now_ns);
            }
            Fault::Mute => {
                self.mute = present;
                return;
            }
        };
        self.faults_present = if present { self.faults_present | bit } else { self.faults_present & !bit };
        self.settle(now_ns);
    }

    /// True if the outputs are on.
    pub fn energized(&self) -> bool {
        self.energized
    }

    /// The microstep counter, 0 to 1023: the field's position.
    pub fn mscnt(&self) -> u16 {
        self.mscnt
    }

    /// The level at DIAG; floating without supply.
    pub fn diag(&self) -> Option<bool> {
        self.supplied.then_some(self.diag)
    }

    /// The shortest times so far.
    pub fn timing(&self) -> &Timing {
        &self.timing
    }

    /// The registers as stored.
    pub fn registers(&self) -> &Registers {
        &self.registers
    }

    /// The number of refused bytes and datagrams.
    pub fn line_errors(&self) -> u32 {
        self.receiver.errors()
    }

    /// The next change of DIAG by time alone, ns: a stall signal ends at standstill.
    pub fn next_event_ns(&self) -> Option<u64> {
        (self.diag && !self.driver_error()).then_some(self.last_step_ns + self.standstill_after_ns)
    }

    /// Applies changes that depend on time alone, up to `now_ns`.
    pub fn advance(&mut self, now_ns: u64) {
        if self.sg_measured && self.stands_still(now_ns) {
            self.sg_measured = false;
            self.diag = self.diag_at(now_ns);
        }
    }

    /// Accepts a register write from the line.
    fn write(&mut self, now_ns: u64, register: u8, value: u32) {
        self.registers.ifcnt = self.registers.ifcnt.wrapping_add(1);
        let remains = self.over_temperature || self.shorts_latched != 0;
        self.registers.write(register, value, remains);
        self.settle(now_ns);
    }

    /// Recomputes the values that steps and levels use, after an input changed.
    fn settle(&mut self, now_ns: u64) {
        let (warning, shutdown) = self.registers.over_temperature_celsius();
        // A shutdown lasts until the warning ends, too (15.1).
        let limit = if self.over_temperature { warning } else { shutdown };
        self.over_temperature = self.supplied && self.celsius >= limit;
        let asked = self.supplied && !self.enable_not && self.registers.toff() != 0;
        // A short switches the outputs off until they are switched off and on again by
        // EN or TOFF (15.2).
        self.shorts_latched = if asked { self.shorts_latched | self.faults_present & SHORTS } else { 0 };
        if self.over_temperature || self.shorts_latched != 0 {
            self.registers.gstat |= gstat::DRV_ERR;
        }
        self.energized = asked && !self.driver_error();
        self.delta = self.microsteps();
        self.diag = self.diag_at(now_ns);
    }

    /// The movement of a step, in 1/256, with its sign.
    fn microsteps(&self) -> i32 {
        let size = if self.registers.mstep_reg_select() {
            1 << self.registers.mres()
        } else {
            // MS2, MS1: 1/8, 1/32, 1/64, 1/16 (2.2, pins MS1 and MS2).
            [32, 8, 4, 16][usize::from(self.node())]
        };
        if self.direction_level != self.registers.shaft() { -size } else { size }
    }

    fn stands_still(&self, now_ns: u64) -> bool {
        now_ns.saturating_sub(self.last_step_ns) >= self.standstill_after_ns
    }

    fn tstep_at(&self, now_ns: u64) -> u32 {
        if self.stands_still(now_ns) { TSTEP_MAX } else { self.tstep }
    }

    /// True if stealthChop is selected and TSTEP is not below TPWMTHRS (5.2).
    fn stealth_chop(&self, tstep: u32) -> bool {
        self.registers.spread_cycle() == self.config.spread && tstep >= self.registers.tpwmthrs
    }

    /// True if an error switches the outputs off and raises DIAG. GSTAT.drv_err stays until it is
    /// cleared, DIAG only while the reason lasts: EN high ends that of a short (2.2, pin DIAG).
    fn driver_error(&self) -> bool {
        self.over_temperature || self.shorts_latched != 0 || self.charge_pump_low
    }

    fn diag_at(&self, now_ns: u64) -> bool {
        if !self.supplied {
            return false;
        }
        if self.driver_error() {
            return true;
        }
        let tstep = self.tstep_at(now_ns);
        // TCOOLTHRS >= TSTEP > TPWMTHRS (5.3): a stall of a motor that is on.
        self.energized
            && self.sg_measured
            && !self.stands_still(now_ns)
            && u32::from(self.sg_result) <= 2 * self.registers.sgthrs
            && self.registers.tcoolthrs >= tstep
            && tstep > self.registers.tpwmthrs
            && self.stealth_chop(tstep)
    }

    /// The value that a read reports; 0 for a register that cannot be read.
    pub fn read(&self, now_ns: u64, register: u8) -> u32 {
        let stored = &self.registers;
        match register {
            address::GCONF => stored.gconf,
            address::GSTAT => stored.gstat | if self.charge_pump_low { gstat::UV_CP } else { 0 },
            address::IFCNT => u32::from(stored.ifcnt),
            address::OTP_READ => self.config.otp,
            address::IOIN => self.ioin(),
            address::FACTORY_CONF => stored.factory_conf,
            address::TSTEP => self.tstep_at(now_ns),
            address::SG_RESULT => u32::from(self.sg_result),
            address::MSCNT => u32::from(self.mscnt),
            address::MSCURACT => self.mscuract(),
            address::CHOPCONF => stored.chopconf,
            address::DRV_STATUS => self.drv_status(now_ns),
            address::PWMCONF => stored.pwmconf,
            address::PWM_SCALE => stored.pwmconf & 0xFF,
            address::PWM_AUTO => stored.pwmconf & 0xFF | (stored.pwmconf >> 8 & 0xFF) << 16,
            _ => 0,
        }
    }
}

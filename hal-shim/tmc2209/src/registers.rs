//! The registers that are used, as types (data sheet, section 5).

use core::fmt;

/// The upper byte of a TMC2209's IOIN (section 5.1).
pub const VERSION: u8 = 0x21;

/// A register of the chip (section 5, register map).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Register {
    /// Global configuration, read and write.
    Gconf = 0x00,
    /// Global status, read; a bit is cleared by writing 1.
    Gstat = 0x01,
    /// Number of writes that the chip has accepted, modulo 256; read only.
    Ifcnt = 0x02,
    /// Delay of the chip before it replies (NODECONF, in older revisions SLAVECONF); write only.
    NodeConf = 0x03,
    /// Levels of the pins, and the version; read only.
    Ioin = 0x06,
    /// Currents; write only.
    IholdIrun = 0x10,
    /// Time from standstill to the hold current; write only.
    Tpowerdown = 0x11,
    /// Time between two microsteps of 1/256; read only.
    Tstep = 0x12,
    /// Below this time spreadCycle takes over from stealthChop; write only.
    Tpwmthrs = 0x13,
    /// Above this time the stall signal is off; write only.
    Tcoolthrs = 0x14,
    /// Stall threshold; write only.
    Sgthrs = 0x40,
    /// Measured load; read only.
    SgResult = 0x41,
    /// Current by load; write only.
    CoolConf = 0x42,
    /// Place within a period of the microstep table; read only.
    Mscnt = 0x6a,
    /// Chopper and microsteps; read and write.
    ChopConf = 0x6c,
    /// Errors and warnings; read only.
    DrvStatus = 0x6f,
    /// stealthChop; read and write.
    PwmConf = 0x70,
}

impl Register {
    /// All that are used, in the order of their address.
    pub const ALL: [Self; 17] = [
        Self::Gconf,
        Self::Gstat,
        Self::Ifcnt,
        Self::NodeConf,
        Self::Ioin,
        Self::IholdIrun,
        Self::Tpowerdown,
        Self::Tstep,
        Self::Tpwmthrs,
        Self::Tcoolthrs,
        Self::Sgthrs,
        Self::SgResult,
        Self::CoolConf,
        Self::Mscnt,
        Self::ChopConf,
        Self::DrvStatus,
        Self::PwmConf,
    ];

    /// The register's address.
    #[must_use]
    pub const fn address(self) -> u8 {
        self as u8
    }

    /// Returns true if a written value can be read back.
    #[must_use]
    pub const fn reads_back(self) -> bool {
        matches!(self, Self::Gconf | Self::ChopConf | Self::PwmConf)
    }

    /// Returns true if the chip accepts a write.
    #[must_use]
    pub const fn is_writable(self) -> bool {
        !matches!(self, Self::Ifcnt | Self::Ioin | Self::Tstep | Self::SgResult | Self::Mscnt | Self::DrvStatus)
    }

    /// Returns true if its value can be read.
    #[must_use]
    pub const fn is_readable(self) -> bool {
        self.reads_back() || !self.is_writable() || matches!(self, Self::Gstat)
    }
}

impl fmt::Display for Register {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Self::Gconf => "GCONF",
            Self::Gstat => "GSTAT",
            Self::Ifcnt => "IFCNT",
            Self::NodeConf => "NODECONF",
            Self::Ioin => "IOIN",
            Self::IholdIrun => "IHOLD_IRUN",
            Self::Tpowerdown => "TPOWERDOWN",
            Self::Tstep => "TSTEP",
            Self::Tpwmthrs => "TPWMTHRS",
            Self::Tcoolthrs => "TCOOLTHRS",
            Self::Sgthrs => "SGTHRS",
            Self::SgResult => "SG_RESULT",
            Self::CoolConf => "COOLCONF",
            Self::Mscnt => "MSCNT",
            Self::ChopConf => "CHOPCONF",
            Self::DrvStatus => "DRV_STATUS",
            Self::PwmConf => "PWMCONF",
        })
    }
}

/// The bit, if the flag is set.
const fn bit(flag: bool, at: u32) -> u32 {
    (flag as u32) << at
}

/// GCONF (section 5.1). All functions without a field are off: the reference voltage from the pin,
/// resistors in the chip, the functions of INDEX, the test mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GlobalConf {
    /// spreadCycle at all speeds (and no stealthChop).
    pub spread_cycle: bool,
    /// The pin PDN_UART is only a serial line.
    pub pin_is_serial: bool,
    /// Microsteps by CHOPCONF, not by the pins MS1 and MS2, which are the chip's address.
    pub microsteps_by_register: bool,
    /// Steps are evened out where one pulse counts for several microsteps.
    pub filter_steps: bool,
}

impl GlobalConf {
    /// The register's bit for [`Self::spread_cycle`].
    pub const SPREAD_CYCLE: u32 = 1 << 2;

    /// The register's value.
    #[must_use]
    pub const fn bits(self) -> u32 {
        bit(self.spread_cycle, Self::SPREAD_CYCLE.trailing_zeros())
            | bit(self.pin_is_serial, 6)
            | bit(self.microsteps_by_register, 7)
            | bit(self.filter_steps, 8)
    }
}

/// GSTAT (section 5.1).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GlobalStatus {
    /// The chip has been reset since this was last cleared: all registers are at their defaults.
    pub reset: bool,
    /// Over-temperature or a short has switched the motor off.
    pub driver_error: bool,
    /// The charge pump's voltage is too low; the motor is off for as long.
    pub charge_pump_low: bool,
}

impl GlobalStatus {
    /// The value that clears all flags when it is written.
    pub const CLEAR_ALL: u32 = 0b111;

    /// Reads the flags from the register's value.
    #[must_use]
    pub const fn from_bits(bits: u32) -> Self {
        Self { reset: bits & 1 != 0, driver_error: bits & 2 != 0, charge_pump_low: bits & 4 != 0 }
    }

    /// The register's value.
    #[must_use]
    pub const fn bits(self) -> u32 {
        bit(self.reset, 0) | bit(self.driver_error, 1) | bit(self.charge_pump_low, 2)
    }
}

/// IHOLD_IRUN (section 5.2): currents as shares of 1/32 of the full scale, less one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HoldRun {
    /// Current at standstill, 0 to 31.
    pub hold: u8,
    /// Current in motion, 0 to 31.
    pub run: u8,
    /// Time of each step down from run to hold, 2^18 clocks (22 ms), 0 to 15.
    pub hold_delay: u8,
}

impl HoldRun {
    /// The register's value.
    #[must_use]
    pub const fn bits(self) -> u32 {
        (self.hold as u32 & 31) | (self.run as u32 & 31) << 8 | (self.hold_delay as u32 & 15) << 16
    }
}

/// Microsteps of a full step as MRES has them (section 5.5.1): 256 as 0, halved with
/// each number, 1 as 8.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MicrostepResolution(u8);

impl MicrostepResolution {
    /// Code of 1, 2, 4 ... 256 microsteps; `None` for another number.
    #[must_use]
    pub const fn from_microsteps(microsteps: u16) -> Option<Self> {
        if microsteps.is_power_of_two() && microsteps <= 256 {
            Some(Self(8 - microsteps.trailing_zeros() as u8))
        } else {
            None
        }
    }

    /// Microsteps of a full step.
    #[must_use]
    pub const fn microsteps(self) -> u16 {
        256 >> self.0
    }
}

/// CHOPCONF (section 5.5.1). Protections against shorts are left on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChopConf {
    /// Off time: 24 + 32 times this many clocks, 1 to 15; 0 switches the motor off.
    pub off_time: u8,
    /// Start of the hysteresis, 1 to 8 are 0 to 7.
    pub hysteresis_start: u8,
    /// End of the hysteresis, -3 to 12 are 0 to 15.
    pub hysteresis_end: u8,
    /// Blank time of the comparator: 16, 24, 32 or 40 clocks are 0 to 3.
    pub blank_time: u8,
    /// Full scale at 0.18 V across the sense resistor instead of 0.325 V.
    pub high_sensitivity: bool,
    /// Microsteps of a full step.
    pub resolution: MicrostepResolution,
    /// The chip interpolates to 256 microsteps.
    pub interpolate: bool,
    /// Both edges of the step signal step.
    pub both_edges: bool,
}

impl ChopConf {
    /// The register's value.
    #[must_use]
    pub const fn bits(self) -> u32 {
        (self.off_time as u32 & 15)
            | (self.hysteresis_start as u32 & 7) << 4
            | (self.hysteresis_end as u32 & 15) << 7
            | (self.blank_time as u32 & 3) << 15
            | bit(self.high_sensitivity, 17)
            | (self.resolution.0 as u32) << 24
            | bit(self.interpolate, 28)
            | bit(self.both_edges, 29)
    }
}

/// DRV_STATUS (section 5.5.3).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DriverStatus(u32);

impl DriverStatus {
    /// Flags of a driver that has switched itself off: over-temperature, shorts to ground
    /// and to the supply.
    pub const FATAL: u32 = 0b11_1110;
    /// Flags of something that a person should know: over-temperature warning, open
    /// load of the coils.
    pub const WARNINGS: u32 = 0b1100_0001;
    /// Over-temperature shutdown.
    pub const OVER_TEMPERATURE: u32 = 1 << 1;
    /// Over-temperature warning.
    pub const OVER_TEMPERATURE_WARNING: u32 = 1;

    const NAMES: [(u32, &'static str); 8] = [
        (1 << 1, "over-temperature, switched off"),
        (1 << 0, "over-temperature warning"),
        (1 << 2, "short to ground at coil A"),
        (1 << 3, "short to ground at coil B"),
        (1 << 4, "short to the supply at coil A"),
        (1 << 5, "short to the supply at coil B"),
        (1 << 6, "open load at coil A"),
        (1 << 7, "open load at coil B"),
    ];

    /// Reads the status from the register's value.
    #[must_use]
    pub const fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    /// The register's value.
    #[must_use]
    pub const fn bits(self) -> u32 {
        self.0
    }

    /// Flags that have switched the motor off.
    #[must_use]
    pub const fn fatal(self) -> u32 {
        self.0 & Self::FATAL
    }

    /// The present current, 0 to 31.
    #[must_use]
    pub const fn current_scale(self) -> u8 {
        (self.0 >> 16 & 31) as u8
    }

    /// Returns true if stealthChop drives the motor.
    #[must_use]
    pub const fn is_stealth_chop(self) -> bool {
        self.0 >> 30 & 1 == 1
    }

    /// Returns true if the motor is at rest.
    #[must_use]
    pub const fn is_standing(self) -> bool {
        self.0 >> 31 == 1
    }
}

impl fmt::Display for DriverStatus {
    /// The flags in words, `no errors` without any.
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut separator = "";
        for (_, name) in Self::NAMES.iter().filter(|(flag, _)| self.0 & flag != 0) {
            write!(out, "{separator}{name}")?;
            separator = ", ";
        }
        if separator.is_empty() { out.write_str("no errors") } else { Ok(()) }
    }
}

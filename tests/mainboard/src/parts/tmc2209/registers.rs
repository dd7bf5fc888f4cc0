//! The driver's registers: addresses, access, values at reset (data sheet chapter 5).

/// Addresses of registers (data sheet 5.1 to 5.5).
#[allow(missing_docs)] // the data sheet's names
pub mod address {
    pub const GCONF: u8 = 0x00;
    pub const GSTAT: u8 = 0x01;
    pub const IFCNT: u8 = 0x02;
    pub const NODECONF: u8 = 0x03;
    pub const OTP_PROG: u8 = 0x04;
    pub const OTP_READ: u8 = 0x05;
    pub const IOIN: u8 = 0x06;
    pub const FACTORY_CONF: u8 = 0x07;
    pub const IHOLD_IRUN: u8 = 0x10;
    pub const TPOWERDOWN: u8 = 0x11;
    pub const TSTEP: u8 = 0x12;
    pub const TPWMTHRS: u8 = 0x13;
    pub const TCOOLTHRS: u8 = 0x14;
    pub const VACTUAL: u8 = 0x22;
    pub const SGTHRS: u8 = 0x40;
    pub const SG_RESULT: u8 = 0x41;
    pub const COOLCONF: u8 = 0x42;
    pub const MSCNT: u8 = 0x6A;
    pub const MSCURACT: u8 = 0x6B;
    pub const CHOPCONF: u8 = 0x6C;
    pub const DRV_STATUS: u8 = 0x6F;
    pub const PWMCONF: u8 = 0x70;
    pub const PWM_SCALE: u8 = 0x71;
    pub const PWM_AUTO: u8 = 0x72;
}

/// Bits of GSTAT (5.1).
#[allow(missing_docs)] // the data sheet's names
pub mod gstat {
    pub const RESET: u32 = 1 << 0;
    pub const DRV_ERR: u32 = 1 << 1;
    pub const UV_CP: u32 = 1 << 2;
}

/// Bits of DRV_STATUS (5.5.3).
#[allow(missing_docs)] // the data sheet's names
pub mod drv_status {
    pub const OTPW: u32 = 1 << 0;
    pub const OT: u32 = 1 << 1;
    pub const S2GA: u32 = 1 << 2;
    pub const S2GB: u32 = 1 << 3;
    pub const S2VSA: u32 = 1 << 4;
    pub const S2VSB: u32 = 1 << 5;
    pub const OLA: u32 = 1 << 6;
    pub const OLB: u32 = 1 << 7;
    pub const T120: u32 = 1 << 8;
    pub const T143: u32 = 1 << 9;
    pub const T150: u32 = 1 << 10;
    pub const T157: u32 = 1 << 11;
    pub const STEALTH: u32 = 1 << 30;
    pub const STST: u32 = 1 << 31;
}

/// The chip's version in IOIN (5.1).
pub const VERSION: u32 = 0x21;

/// The stored registers. The driver itself computes measured ones (TSTEP, SG_RESULT, MSCNT, ...).
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Registers {
    /// GCONF, 10 bits.
    pub gconf: u32,
    /// GSTAT without the live bit uv_cp.
    pub gstat: u32,
    /// IFCNT: accepted writes, modulo 256.
    pub ifcnt: u8,
    /// NODECONF; older data sheets call it SLAVECONF.
    pub nodeconf: u32,
    /// FACTORY_CONF: FCLKTRIM and OTTRIM.
    pub factory_conf: u32,
    /// IHOLD_IRUN: IHOLD, IRUN, IHOLDDELAY.
    pub ihold_irun: u32,
    /// TPOWERDOWN, 8 bits.
    pub tpowerdown: u32,
    /// TPWMTHRS, 20 bits.
    pub tpwmthrs: u32,
    /// TCOOLTHRS, 20 bits.
    pub tcoolthrs: u32,
    /// VACTUAL, 24 bits; stored without effect.
    pub vactual: u32,
    /// SGTHRS, 8 bits.
    pub sgthrs: u32,
    /// COOLCONF, 16 bits; stored without effect.
    pub coolconf: u32,
    /// CHOPCONF.
    pub chopconf: u32,
    /// PWMCONF.
    pub pwmconf: u32,
}

impl Registers {
    /// The values after power-up. `otp` is the one-time memory (OTP_READ, 5.1.1); its
    /// power-up values for currents, sense resistor, chopper mode and trims are applied, the
    /// rest has no effect.
    pub fn at_reset(otp: u32) -> Self {
        let bit = |number: u32| otp >> number & 1;
        let ihold = [16, 2, 8, 24][(otp >> 21 & 3) as usize];
        let ihold_delay = [1, 2, 4, 8][(otp >> 19 & 3) as usize];
        Self {
            // I_scale_analog and multistep_filt are set at reset; otp0.6 is internal_Rsense,
            // otp2.7 en_SpreadCycle.
            gconf: 0x101 | bit(6) << 1 | bit(23) << 2,
            gstat: gstat::RESET,
            ifcnt: 0,
            nodeconf: 0,
            factory_conf: (otp & 0x1F) | bit(5) << 8,
            ihold_irun: ihold | 31 << 8 | ihold_delay << 16,
            tpowerdown: 20,
            tpwmthrs: 0,
            tcoolthrs: 0,
            vactual: 0,
            sgthrs: 0,
            coolconf: 0,
            chopconf: 0x1000_0053,
            pwmconf: 0xC10D_0024,
        }
    }

    /// Stores a write; a write to a read-only or unknown register has no effect. `drv_err_remains`
    /// keeps GSTAT.drv_err from being cleared while its reason lasts.
    pub fn write(&mut self, register: u8, value: u32, drv_err_remains: bool) {
        match register {
            address::GCONF => self.gconf = value & 0x3FF,
            address::GSTAT => {
                let held = if drv_err_remains { gstat::DRV_ERR } else { 0 };
                self.gstat &= !value | held;
            }
            address::NODECONF => self.nodeconf = value & 0xF00,
            address::FACTORY_CONF => self.factory_conf = value & 0x31F,
            address::IHOLD_IRUN => self.ihold_irun = value & 0xF_1F1F,
            address::TPOWERDOWN => self.tpowerdown = value & 0xFF,
            address::TPWMTHRS => self.tpwmthrs = value & 0xF_FFFF,
            address::TCOOLTHRS => self.tcoolthrs = value & 0xF_FFFF,
            address::VACTUAL => self.vactual = value & 0xFF_FFFF,
            address::SGTHRS => self.sgthrs = value & 0xFF,
            address::COOLCONF => self.coolconf = value & 0xFFFF,
            address::CHOPCONF => self.chopconf = value,
            address::PWMCONF => self.pwmconf = value,
            _ => {}
        }
    }

    /// GCONF: the voltage at VREF scales the current.
    pub fn scales_by_vref(&self) -> bool {
        self.gconf & 1 != 0
    }

    /// GCONF: the chopper mode before the pin SPREAD inverts it.
    pub fn spread_cycle(&self) -> bool {
        self.gconf & 1 << 2 != 0
    }

    /// GCONF: the motor's direction is inverted.
    pub fn shaft(&self) -> bool {
        self.gconf & 1 << 3 != 0
    }

    /// GCONF: PDN_UART is the serial line only.
    pub fn pdn_disable(&self) -> bool {
        self.gconf & 1 << 6 != 0
    }

    /// GCONF: CHOPCONF.MRES selects the microsteps rather than MS1 and MS2.
    pub fn mstep_reg_select(&self) -> bool {
        self.gconf & 1 << 7 != 0
    }

    /// CHOPCONF: off time; 0 switches the outputs off.
    pub fn toff(&self) -> u32 {
        self.chopconf & 0xF
    }

    /// CHOPCONF: low sense voltage, for small currents.
    pub fn vsense(&self) -> bool {
        self.chopconf & 1 << 17 != 0
    }

    /// CHOPCONF: a step at both edges of STEP.
    pub fn double_edge(&self) -> bool {
        self.chopconf & 1 << 29 != 0
    }

    /// CHOPCONF: the step's binary size, 0 for 1/256 to 8 for a full step. 9 to 15 are
    /// reserved and read as 8.
    pub fn mres(&self) -> u32 {
        (self.chopconf >> 24 & 0xF).min(8)
    }

    /// IHOLD_IRUN: current at standstill, 0 to 31.
    pub fn ihold(&self) -> u32 {
        self.ihold_irun & 0x1F
    }

    /// IHOLD_IRUN: current in motion, 0 to 31.
    pub fn irun(&self) -> u32 {
        self.ihold_irun >> 8 & 0x1F
    }

    /// IHOLD_IRUN: the decay time of the current to IHOLD, in 2^18 clocks a step; 0 is at once.
    pub fn ihold_delay(&self) -> u32 {
        self.ihold_irun >> 16 & 0xF
    }

    /// NODECONF: the wait before a reply, in bit times (0 and 1: 8, then 24, 40, ... 120).
    pub fn send_delay_bits(&self) -> u64 {
        u64::from((self.nodeconf >> 8 & 0xF) | 1) * 8
    }

    /// FACTORY_CONF.OTTRIM: the temperatures of warning and shutdown in degrees Celsius.
    pub fn over_temperature_celsius(&self) -> (f64, f64) {
        [(120.0, 143.0), (120.0, 150.0), (143.0, 150.0), (143.0, 157.0)][(self.factory_conf >> 8 & 3) as usize]
    }
}

//! The memory map of the STM32F405, F407 and F446: rigless's tables of the STM32F427 (RM0090)
//! without the instances that these chips lack, with the corrections that rigless applies to its
//! own part, and with the own models.
//!
//! rigless does not export the description of its part, and a description cannot be changed once it
//! is built. So this module repeats the facts, each with its section of RM0090 rev 22. It asks
//! rigless where it can (which output of the clock tree feeds an instance).

use rigless::cpu::armv7m;
use rigless::soc::stm32f427::generated::{self, gpioa, tim2, tim3, tim10};
use rigless::soc::stm32f427::peripherals::{ADC_COMMON, CONVERTERS, PORTS, SERIAL_PORTS, adc, flash, rcc};
use rigless::soc::{Bus, Clock, Cpu, EraseBlocks, Error, Gate, Peripheral, Region, WriteModify};

use super::{entry, instances, late_clocks, usb};
use crate::wiring::Chip as Model;

/// The interrupt lines are 0 to 81 on the F405 and F407, 0 to 96 on the F446 (RM0090 table 62,
/// RM0390 table 38). Lines above 90 belong to instances that no board here uses.
const CPU: Cpu = Cpu::new("CM4", true, 91, rigless::soc::Endian::Little);

/// Sectors of one bank: four of 16 KiB, one of 64, seven of 128 (RM0090 table 5), or three of 128
/// (RM0390 table 4).
static SECTORS_1024: [EraseBlocks; 3] = [blocks(16, 4), blocks(64, 1), blocks(128, 7)];
static SECTORS_512: [EraseBlocks; 3] = [blocks(16, 4), blocks(64, 1), blocks(128, 3)];

const fn blocks(kib: u64, count: u32) -> EraseBlocks {
    match (std::num::NonZeroU64::new(kib << 10), std::num::NonZeroU32::new(count)) {
        (Some(size), Some(count)) => EraseBlocks { size, count },
        _ => panic!("a sector has bytes"),
    }
}

/// The F405's and F407's memories: RM0090 section 2.3, table 1, and DS8626 section 2.2.
static MEMORY_F405: [Region; 5] = [
    Region::flash("flash", 0x0800_0000, 1 << 20).erased_in(&SECTORS_1024).erased_to(0xFF).programmed_by("FLASH"),
    Region::ram("ccm", 0x1000_0000, 64 << 10),
    Region::system("system", 0x1FFF_0000, 32 << 10),
    Region::ram("sram", 0x2000_0000, 128 << 10),
    Region::ram("backup_sram", 0x4002_4000, 4 << 10),
];

/// The F446's memories: RM0390 section 2.2, table 1. It has no core coupled memory.
static MEMORY_F446: [Region; 4] = [
    Region::flash("flash", 0x0800_0000, 512 << 10).erased_in(&SECTORS_512).erased_to(0xFF).programmed_by("FLASH"),
    Region::system("system", 0x1FFF_0000, 32 << 10),
    Region::ram("sram", 0x2000_0000, 128 << 10),
    Region::ram("backup_sram", 0x4002_4000, 4 << 10),
];

/// Instances of the STM32F427 that the F405, F407 and F446 lack, or that differ there. An access to
/// one is reported as an address without a device.
const ABSENT: [&str; 14] = [
    "UART7",
    "UART8",
    "SPI5",
    "SPI6",
    "SAI1",
    "DMA2D",
    "GPIOJ",
    "GPIOK",
    "CRYP",
    "HASH",
    "FMC",
    "OTG_FS_HOST",
    "OTG_FS_DEVICE",
    "OTG_FS_PWRCLK",
];

/// Interrupt lines on which ST's file contradicts RM0090 table 62. The EXTI's are in the order of
/// its lines: 0 to 4, 9 to 5, 15 to 10, and the supply's.
const INTERRUPTS: [(&str, &[u16]); 9] = [
    ("ADC1", &[18]),
    ("ADC2", &[18]),
    ("TIM9", &[24]),
    ("TIM10", &[25]),
    ("TIM11", &[26]),
    ("TIM12", &[43]),
    ("TIM8", &[43, 44, 45, 46]),
    ("TIM6", &[54]),
    ("EXTI", &[6, 7, 8, 9, 10, 23, 40, 1]),
];

/// Ports whose pins are not floating inputs after a reset: MODER, OSPEEDR, PUPDR (RM0090
/// 8.4.1, 8.4.3, 8.4.4).
const DEBUG_PORTS: [(&str, [u64; 3]); 2] =
    [("GPIOA", [0xA800_0000, 0x0C00_0000, 0x6400_0000]), ("GPIOB", [0x0000_0280, 0x0000_00C0, 0x0000_0100])];

const TIMERS: [&str; 14] = [
    "TIM1", "TIM2", "TIM3", "TIM4", "TIM5", "TIM6", "TIM7", "TIM8", "TIM9", "TIM10", "TIM11", "TIM12", "TIM13", "TIM14",
];
const WIDE_TIMERS: [&str; 2] = ["TIM2", "TIM5"];

/// The names of clock enable and reset bits that differ from the instance's name plus EN and RST
/// (RM0090 6.3.5 to 6.3.14, in ST's spelling).
const SPELLED_OTHERWISE: [(&str, &str, &str); 6] = [
    ("ADC1", "ADC1EN", "ADCRST"),
    ("ADC2", "ADC2EN", "ADCRST"),
    ("ADC3", "ADC3EN", "ADCRST"),
    ("USART2", "USART2EN", "UART2RST"),
    ("USART3", "USART3EN", "UART3RST"),
    ("OTG_FS_GLOBAL", "OTGFSEN", "OTGFSRST"),
];

/// Enable and reset registers of the same bus, with matching bit positions.
const BUSES: [(&str, &str); 4] =
    [("AHB1ENR", "AHB1RSTR"), ("AHB2ENR", "AHB2RSTR"), ("APB1ENR", "APB1RSTR"), ("APB2ENR", "APB2RSTR")];

/// The bus of a chip, without models. With `clocks_are_late` instances answer after a delay: see
/// [`late_clocks`].
pub fn bus(model: Model, clocks_are_late: bool) -> Result<Bus, Error> {
    let memory: &'static [Region] = match model {
        Model::F405 | Model::F407 => &MEMORY_F405,
        Model::F446 => &MEMORY_F446,
    };
    let mut builder = Bus::builder(CPU, memory, instances(model))
        .routes_interrupts(entry::PERIPHERAL.name)
        // DBGMCU_IDCODE: RM0090 38.6.1 (0x413; revision Z 0x1001, DS8626) and
        // RM0390 33.6.1 (0x421).
        .reset("DBG", "DBGMCU_IDCODE", if model == Model::F446 { 0x1000_0421 } else { 0x1001_6413 })
        // AHBIDL, 34.16.2, is part of the model's own table.
        .field("FLASH", "ACR", "LATENCY", flash::LATENCY)
        .field("FLASH", "CR", "LOCK", flash::LOCK)
        .field("FLASH", "CR", "STRT", flash::STRT)
        .field("FLASH", "OPTCR", "OPTLOCK", flash::OPTLOCK)
        .field("FLASH", "OPTCR", "OPTSTRT", flash::OPTSTRT)
        .declare("FLASH", "SR", &flash::RDERR)
        .write_modify("FLASH", "SR", WriteModify::OneToClear)
        // EXTI_PR, 12.3.6: rc_w1.
        .write_modify("EXTI", "PR", WriteModify::OneToClear);
    for port in serial_ports() {
        builder = builder.reset(port, "SR", 0x0000_00C0); // 30.6.1: TXE and TC
    }
    for interface in ["SPI1", "SPI2", "SPI3", "SPI4", "I2S2ext", "I2S3ext"] {
        builder = builder.reset(interface, "I2SPR", 0x0000_0002); // 28.5.9
    }
    for timer in TIMERS {
        // 17.4.12, 18.4.12, 19.4.8, 19.5.7, 20.4.8: all ones, and zero would stop the counter.
        let reload = if WIDE_TIMERS.contains(&timer) { 0xFFFF_FFFF } else { 0xFFFF };
        builder = builder.write_modify(timer, "SR", WriteModify::ZeroToClear).reset(timer, "ARR", reload);
    }
    for interface in ["I2C1", "I2C2", "I2C3"] {
        builder = builder.write_modify(interface, "SR1", WriteModify::ZeroToClear); // 27.6.6
    }
    for port in ports() {
        let values = DEBUG_PORTS.iter().find(|(name, _)| *name == port).map_or([0; 3], |(_, values)| *values);
        for (register, value) in ["MODER", "OSPEEDR", "PUPDR"].into_iter().zip(values) {
            builder = builder.reset(port, register, value);
        }
    }
    for (instance, enable, reset) in gates()? {
        let enable = if clocks_are_late { late_clocks::late(enable) } else { enable };
        builder = builder.gate(instance, enable).reset_by(instance, reset);
    }
    // 5.4.1 bit 8: DBP protects RCC_BDCR and the RTC with its backup registers.
    builder = builder.gate_writes("RCC", &["BDCR"], Gate::by("PWR", "CR", "DBP")).gate_writes(
        "RTC",
        &[],
        Gate::by("PWR", "CR", "DBP"),
    );
    // Instances with inputs from other instances: the backup domain's reset, the clock controller
    // (the watchdog's start), the converters' common block, the advanced timers' break, the DMA
    // controllers (tables 42 and 43), each timer that can follow another (tables 93, 94, 101), and
    // the EXTI (12.2.5).
    for instance in ["RTC", "RCC", ADC_COMMON, CONVERTERS[0], "DMA1", "DMA2", "EXTI"] {
        builder = builder.reads_requests(instance);
    }
    for (instance, _) in super::timers::MASTERS {
        builder = builder.reads_requests(instance);
    }
    clocks(model)?
        .into_iter()
        .try_fold(builder, |builder, (instance, clock)| Ok(builder.clocked_by(instance, clock)))?
        .build()
}

/// All instances of the chip.
fn instances(model: Model) -> impl Iterator<Item = Peripheral> {
    let clocks = (model == Model::F446).then_some(entry::CLOCKS_F446);
    generated::PERIPHERALS
        .iter()
        .filter(|peripheral| !ABSENT.contains(&peripheral.name))
        .map(|&peripheral| {
            let interrupts = INTERRUPTS
                .iter()
                .find(|(name, _)| *name == peripheral.name)
                .map_or(peripheral.interrupts, |(_, lines)| *lines);
            match peripheral.name {
                "OTG_FS_GLOBAL" => usb::PERIPHERAL,
                // The registers that all chips have end here.
                "RCC" => Peripheral { size: entry::CLOCKS_F446.base - peripheral.base, ..peripheral },
                name if PORTS.contains(&name) => Peripheral { registers: &gpioa::REGISTERS, ..peripheral },
                "TIM2" | "TIM5" => Peripheral { registers: &tim2::REGISTERS, ..peripheral },
                "TIM3" | "TIM4" => Peripheral { registers: &tim3::REGISTERS, ..peripheral },
                // TIM11 also has an option register, for an input that no board here captures.
                "TIM11" => Peripheral { interrupts, registers: &tim10::REGISTERS, ..peripheral },
                _ => Peripheral { interrupts, ..peripheral },
            }
        })
        .chain([armv7m::PERIPHERAL, entry::PERIPHERAL, late_clocks::PERIPHERAL])
        .chain(clocks)
}

/// The ports that all three chips have.
pub fn ports() -> impl Iterator<Item = &'static str> {
    PORTS.into_iter().filter(|port| !ABSENT.contains(port))
}

/// The serial ports.
pub fn serial_ports() -> impl Iterator<Item = &'static str> {
    SERIAL_PORTS.iter().map(|port| port.instance).filter(|port| !ABSENT.contains(port))
}

/// The clock enable and reset bit of each modelled instance.
fn gates() -> Result<Vec<(&'static str, Gate, Gate)>, Error> {
    let rcc = generated::rcc::REGISTERS;
    let mut gates = Vec::new();
    for instance in instances::clocked() {
        let spelled = SPELLED_OTHERWISE.iter().find(|(name, ..)| *name == instance);
        // The names live as long as the static tables that contain them.
        let found = BUSES.iter().find_map(|(enables, resets)| {
            let enable = rcc.iter().find(|row| row.name == *enables)?.fields.iter().find(|field| match spelled {
                Some((_, enable, _)) => field.name == *enable,
                None => field.name.strip_suffix("EN") == Some(instance),
            })?;
            let reset = rcc.iter().find(|row| row.name == *resets)?.fields.iter().find(|field| match spelled {
                Some((.., reset)) => field.name == *reset,
                None => field.name.strip_suffix("RST") == Some(instance),
            })?;
            Some((Gate::by("RCC", enables, enable.name), Gate::by("RCC", resets, reset.name)))
        });
        let (enable, reset) = found.ok_or(Error::UnknownInstance { instance })?;
        gates.push((instance, enable, reset));
    }
    Ok(gates)
}

/// The output of the clock tree that clocks each instance (RM0090 figure 16): rigless's answer for
/// the instances that it models, and the bus's timer clock for the timers of chapters 19 and 20.
fn clocks(model: Model) -> Result<Vec<(&'static str, Clock)>, Error> {
    let theirs = rigless::soc::stm32f427::builder().build()?;
    let mut clocks: Vec<(&'static str, Clock)> = instances(model)
        .filter(|instance| !instance.name.starts_with("ADC"))
        .filter_map(|instance| Some((instance.name, theirs.clock_of(instance.name)?)))
        .collect();
    for converter in CONVERTERS {
        clocks.push((converter, Clock::output(ADC_COMMON, adc::ADCCLK)));
    }
    for timer in ["TIM6", "TIM7", "TIM12", "TIM13", "TIM14"] {
        clocks.push((timer, Clock::output("RCC", rcc::APB1_TIMERS)));
    }
    for timer in ["TIM9", "TIM10", "TIM11"] {
        clocks.push((timer, Clock::output("RCC", rcc::APB2_TIMERS)));
    }
    clocks.push(("OTG_FS_GLOBAL", Clock::output("RCC", rcc::PLL48)));
    Ok(clocks)
}

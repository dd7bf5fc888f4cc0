//! Leftovers of boot loaders, one kind a function. Addresses: RM0090 2.3 and the chapters of the
//! parts; PM0214 4.

use super::stub::Stub;

const RCC: u32 = 0x4002_3800;
const FLASH_ACR: u32 = 0x4002_3C00;
const PWR_CR: u32 = 0x4000_7000;
const NVIC: u32 = 0xE000_E100;
const SCB: u32 = 0xE000_ED00;
const EXTI: u32 = 0x4001_3C00;

/// PRIMASK of a boot loader whose interrupts are still on.
const MASKED: u32 = 1;

fn stores(stores: &[(u32, u32)]) -> Stub {
    Stub {
        statements: stores.iter().map(|(address, value)| (*address, *value, 0)).collect(),
        masks: MASKED,
        ..Stub::default()
    }
}

/// All instances with a clock, none while the core sleeps.
pub fn clocks_of_parts() -> Stub {
    let on = [(0x30, 0x0074_11FF), (0x34, 0x80), (0x40, 0x36FE_C9FF), (0x44, 0x0007_5F33)];
    let asleep = [0x50, 0x54, 0x58, 0x60, 0x64].map(|offset| (RCC + offset, 0));
    stores(&[on.map(|(offset, bits)| (RCC + offset, bits)).as_slice(), &asleep].concat())
}

/// The core on a PLL at 120 MHz from the crystal, clock security and the second PLL on, a clock on
/// a pin, the tree's interrupts on.
pub fn pll() -> Stub {
    let statements = vec![
        (RCC, 0x0001_0083, 0),
        (RCC, 1 << 17, 1 << 17),
        // 12 MHz / 6 * 120 / 2; Q = 5.
        (RCC + 4, 6 | 120 << 6 | 1 << 22 | 5 << 24, 0),
        (RCC + 0x84, 192 << 6 | 2 << 28, 0),
        (FLASH_ACR, 0x705, 0),
        (RCC, 0x0509_0083, 0),
        (RCC, 1 << 25, 1 << 25),
        // APB1 / 4, APB2 / 2, the PLL on MCO1.
        (RCC + 8, 0b10 | 0b101 << 10 | 0b100 << 13 | 3 << 21, 0),
        (RCC + 8, 0b1000, 0b1100),
        (RCC + 0xC, 0x3F00, 0),
    ];
    Stub { statements, masks: MASKED, ..Stub::default() }
}

/// All external interrupts on and pending, on both edges of port E's pins.
pub fn exti() -> Stub {
    let routes = [0x08, 0x0C, 0x10, 0x14].map(|offset| (0x4001_3800 + offset, 0x4444));
    let lines = [0x00, 0x08, 0x0C, 0x10].map(|offset| (EXTI + offset, 0x007F_FFFF));
    clocks_of_parts().and(&stores(&[routes, lines].concat())).and(&interrupts())
}

/// All timers run at different rates, with interrupts and DMA requests; channels drive
/// inverted signals.
pub fn timers() -> Stub {
    let mut words = Vec::new();
    for timer in [0x4000_0000, 0x4000_0400, 0x4000_0800, 0x4000_0C00, 0x4001_0000, 0x4001_0400] {
        // CCMR1, CCMR2: PWM mode 2 with preload; CCER: all on, inverted; PSC, CNT, ARR; DIER; CR1:
        // down; CR2: another trigger.
        let of_channels = [(0x18, 0x7878), (0x1C, 0x7878), (0x20, 0x3333), (0x30, 0), (0x34, 9), (0x44, 0xC000)];
        let of_counter = [(0x28, 11), (0x2C, 0xFFFF_FFFF), (0x14, 1), (0x2C, 50_000), (0x24, 0xFFFF_0000)];
        let of_rest = [(0x04, 0x30), (0x08, 0), (0x0C, 0x5F5F), (0x00, 0x91)];
        words.extend(
            [of_channels.as_slice(), &of_counter, &of_rest].concat().iter().map(|(at, word)| (timer + at, *word)),
        );
    }
    let small =
        [0x4000_1000, 0x4000_1400, 0x4000_1800, 0x4000_1C00, 0x4000_2000, 0x4001_4000, 0x4001_4400, 0x4001_4800];
    for timer in small {
        words.extend([(0x28, 3), (0x2C, 20), (0x14, 1), (0x0C, 1), (0x00, 1)].map(|(at, word)| (timer + at, word)));
    }
    clocks_of_parts().and(&stores(&words)).and(&interrupts())
}

/// A converter in continuous mode, and a DMA stream that writes its samples over the
/// image's RAM for good.
pub fn dma() -> Stub {
    let stream = 0x4002_6410;
    let words = [
        (stream + 0x08, 0x4001_204C),
        (stream + 0x0C, 0x2000_0000),
        (stream + 0x04, 0x4000),
        // Channel 0, 16 bits each, the memory address advances, circular, interrupts, on.
        (stream, 1 << 13 | 1 << 11 | 1 << 10 | 1 << 8 | 0b1111 << 1 | 1),
        // Left-aligned, 6 bits, continuous, all its interrupts on.
        (0x4001_2004, 3 << 24 | 1 << 8 | 1 << 26 | 0xE0),
        (0x4001_2034, 9),
        (0x4001_2304, 3 << 16),
        (0x4001_2008, 1 << 30 | 1 << 11 | 1 << 9 | 1 << 8 | 0b11),
    ];
    clocks_of_parts().and(&stores(&words)).and(&interrupts())
}

/// Serial ports with nine bits, parity, two stop bits, one wire, DMA and all interrupts.
pub fn serial_ports() -> Stub {
    let mut words = Vec::new();
    for port in [0x4001_1000, 0x4000_4400] {
        words.extend(
            [(0x08, 0x1234), (0x10, 0x2000), (0x14, 0x03C8), (0x0C, 0xB5FC)].map(|(at, word)| (port + at, word)),
        );
    }
    clocks_of_parts().and(&stores(&words)).and(&interrupts())
}

/// The USB core in use as another device: with an address, its interrupts on.
pub fn usb() -> Stub {
    let words = [(0x0C, 0x4000_1840), (0x38, 1 << 16 | 1 << 21), (0x08, 1), (0x18, 0xC03C_F8FF)]
        .map(|(at, word)| (0x5000_0000 + at, word));
    let device = [(0x800, 3 | 42 << 4), (0x810, 0xB), (0x814, 0x9), (0x81C, 0x000F_000F), (0x804, 0)]
        .map(|(at, word)| (0x5000_0000 + at, word));
    clocks_of_parts().and(&stores(&words)).and(&stores(&device)).and(&interrupts())
}

/// Heaters' pins high, motors on, everything open-drain with pulls and fast.
pub fn ports() -> Stub {
    let mut words = Vec::new();
    // B: heaters; D: motors; E: fans. Alternate functions stay selected too.
    for (port, levels, modes) in
        [(0x4002_0400, 0x0003, 0x0000_0285), (0x4002_0C00, 0xB3F4, 0x5555_5555), (0x4002_1000, 0, 0x5555_5555)]
    {
        let rest = [(0x04, 0xFFFF), (0x08, 0xFFFF_FFFF), (0x0C, 0xAAAA_AAAA), (0x20, 0x2222_2222), (0x24, 0x2222_2222)];
        words.extend(rest.map(|(at, word)| (port + at, word)));
        words.extend([(port + 0x14, levels), (port, modes)]);
    }
    clocks_of_parts().and(&stores(&words))
}

/// SysTick runs with its interrupt on; the vector table is the boot loader's.
pub fn systick() -> Stub {
    stores(&[(0xE000_E014, 1_000), (0xE000_E018, 0), (0xE000_E010, 7), (SCB + 8, super::stub::BASE)])
}

/// Interrupts masked by PRIMASK and by a priority.
pub fn masks() -> Stub {
    Stub { masks: MASKED, basepri: 0x10, ..Stub::default() }
}

/// Threads on the process stack; both stacks in the middle of the image's RAM.
pub fn stacks() -> Stub {
    Stub { control: 0b10, process_stack: 0x2000_0400, main_stack: 0x2000_4000, ..Stub::default() }
}

/// An MPU region that denies all access to the upper half of RAM and stays on.
pub fn mpu() -> Stub {
    guarded(0x2001_0000, 15)
}

/// An MPU region that denies all access to RAM, including the image's stack.
pub fn guarded_stack() -> Stub {
    guarded(0x2000_0000, 16)
}

/// A region of 2 to the power of `log2` + 1 bytes without access; other addresses behave as
/// without regions.
fn guarded(base: u32, log2: u32) -> Stub {
    stores(&[(SCB + 0x98, 0), (SCB + 0x9C, base), (SCB + 0xA0, 1 << 28 | log2 << 1 | 1), (SCB + 0x94, 0b101)])
}

/// Sleep is deep and follows each interrupt.
pub fn deep_sleep() -> Stub {
    stores(&[(SCB + 0x10, 0b110)])
}

/// No priority preempts another.
pub fn priorities() -> Stub {
    stores(&[(SCB + 0x0C, 0x05FA_0700)]).and(&interrupts())
}

/// Unaligned words trap.
pub fn unaligned_trap() -> Stub {
    stores(&[(SCB + 0x14, 0x0208)])
}

/// Divisions by zero trap, and each fault has its own handler.
pub fn faults() -> Stub {
    stores(&[(SCB + 0x14, 0x0210), (SCB + 0x24, 0x0007_0000)])
}

/// The core's own interrupts and all of the chip's are pending.
pub fn pended() -> Stub {
    stores(&[(SCB + 0x04, 1 << 28 | 1 << 26)]).and(&interrupts())
}

/// The voltage scale for 144 MHz, and the supply's detector on.
pub fn voltage() -> Stub {
    stores(&[(RCC + 0x40, 1 << 28), (PWR_CR, 1 << 8 | 0b111 << 5 | 1 << 4)])
}

/// The watchdog with a time-out of half a second.
pub fn watchdog() -> Stub {
    stores(&[(0x4000_3000, 0xCCCC)])
}

/// All of the processor's interrupts on and pending, all at the lowest priority.
fn interrupts() -> Stub {
    let mut words = Vec::new();
    for word in 0..3 {
        words.extend([(NVIC + 4 * word, u32::MAX), (NVIC + 0x100 + 4 * word, u32::MAX)]);
    }
    words.extend((0..21).map(|word| (NVIC + 0x300 + 4 * word, u32::MAX)));
    stores(&words)
}

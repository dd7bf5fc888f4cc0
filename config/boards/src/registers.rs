//! A board's pins as stores to registers: the firmware makes them in this order,
//! without knowing a pin.

use ferrostep_stm32f4::gpio::{self, AFRL, ALTERNATE, ANALOGUE, BSRR, MODER, OSPEEDR, OTYPER, OUTPUT, PULL_UP, PUPDR};
use ferrostep_stm32f4::rcc::{RCC_AHB1ENR, RCC_AHB2ENR};
use ferrostep_stm32f4::usb_controller;

use crate::board::{Accelerometer, Board, Eeprom, SupplyOutput};
use crate::pin::Pin;
use crate::start::as_after_reset;
use crate::store::Store;

// Addresses: PM0214 4.2, 4.3.3, 4.4, 4.5. They are the core's own, which the chip's register
// description leaves to `cortex-m`, and that one names them by pointers, for the chip only.
const SYST_CSR: u32 = 0xe000_e010;
const NVIC_ICER: u32 = 0xe000_e180;
const NVIC_ICPR: u32 = 0xe000_e280;
const SCB_ICSR: u32 = 0xe000_ed04;
const SCB_SCR: u32 = 0xe000_ed10;
/// Configuration register; at reset the stack is aligned at exceptions, and nothing traps.
const SCB_CCR: u32 = 0xe000_ed14;
const CCR_AT_RESET: u32 = 1 << 9;
const MPU_CTRL: u32 = 0xe000_ed94;

/// Code in OSPEEDR, two bits a pin, for the slowest edges, up to 100 ns at 50 pF (DS8626, I/O AC
/// characteristics). Pulses are much longer than that, and faster edges ring on the long traces to
/// the drivers; Prusa's own firmware chooses it for these pins as well.
const LOW_SPEED: u32 = 0b00;
/// Code in OSPEEDR for edges of up to 10 ns at 30 pF, for 12 MHz.
const HIGH_SPEED: u32 = 0b10;
/// The SDIO on all its pins.
const CARD_FUNCTION: u32 = 12;
/// USART1 on all its pins.
const SERIAL_FUNCTION: u32 = 7;

/// A register of a port.
fn of_port(port: u8, offset: u32) -> u32 {
    gpio::port(port) + offset
}

/// One store for each port that has any of the pins: their fields of `width` bits become `value`.
fn fields(pins: &[Pin], offset: u32, width: u32, value: u32) -> Vec<Store> {
    let mut stores: Vec<Store> = Vec::new();
    for pin in pins {
        // Pins 8 to 15 have a second register for their alternate functions.
        let (register, place) = match u32::from(pin.number) * width {
            place @ 0..32 => (offset, place),
            place => (offset + 4, place - 32),
        };
        let address = of_port(pin.port, register);
        let (clear, set) = (((1 << width) - 1) << place, value << place);
        match stores.iter_mut().find(|store| store.address == address) {
            Some(store) => (store.clear, store.set) = (store.clear | clear, store.set | set),
            None => stores.push(Store { address, clear, set }),
        }
    }
    stores
}

/// One store to BSRR for each port that has any of the pins.
fn levels(high: &[Pin], low: &[Pin]) -> Vec<Store> {
    let mut words: Vec<(u8, u32)> = Vec::new();
    let set = high.iter().map(|pin| (pin.port, pin.bit()));
    for (port, word) in set.chain(low.iter().map(|pin| (pin.port, pin.bit() << 16))) {
        match words.iter_mut().find(|(of, _)| *of == port) {
            Some((_, words)) => *words |= word,
            None => words.push((port, word)),
        }
    }
    words.into_iter().map(|(port, word)| Store::word(of_port(port, BSRR), word)).collect()
}

fn heater_pins(board: &Board) -> Vec<Pin> {
    board.heaters.iter().map(|heater| heater.pin).collect()
}

/// Each once: motors may share them.
fn enable_pins(board: &Board) -> Vec<Pin> {
    let mut pins: Vec<Pin> = board.all_motors().map(|motor| motor.enable).collect();
    pins.sort_unstable();
    pins.dedup();
    pins
}

fn thermistor_pins(board: &Board) -> Vec<Pin> {
    board.thermistors.iter().map(|thermistor| thermistor.pin).collect()
}

fn signal_pins(board: &Board) -> Vec<Pin> {
    board.moving_motors().flat_map(|motor| [motor.step, motor.direction]).collect()
}

fn step_pins(board: &Board) -> Vec<Pin> {
    board.moving_motors().map(|motor| motor.step).collect()
}

/// The lines to a memory card, and the pin that says that it is there.
fn card_pins(board: &Board) -> Vec<Pin> {
    board.card.iter().flat_map(|card| card.lines.into_iter().chain(card.detect)).collect()
}

/// The SDIO's pins, with the pull-ups that a card's lines need (SD specification, 6.6);
/// its clock has none.
fn card(board: &Board) -> Vec<Store> {
    let Some(card) = board.card else { return Vec::new() };
    let [_, pulled @ ..] = card.lines;
    let detect: Vec<Pin> = card.detect.into_iter().collect();
    [
        fields(&card.lines, OTYPER, 1, 0),
        fields(&card.lines, PUPDR, 2, 0),
        fields(&[&pulled[..], &detect].concat(), PUPDR, 2, PULL_UP),
        fields(&card.lines, OSPEEDR, 2, HIGH_SPEED),
        fields(&card.lines, AFRL, 4, CARD_FUNCTION),
        fields(&card.lines, MODER, 2, ALTERNATE),
        fields(&detect, MODER, 2, 0),
    ]
    .concat()
}

/// The pins to an accelerometer, and those of them that the board drives.
fn accelerometer_pins(board: &Board) -> Vec<Pin> {
    board.accelerometer.iter().flat_map(|plug| [plug.sck, plug.mosi, plug.cs, plug.miso]).collect()
}

/// The bus at rest: clock and select high before they are outputs. An undriven data
/// line reads ones.
fn accelerometer(board: &Board) -> Vec<Store> {
    let Some(Accelerometer { sck, miso, mosi, cs, .. }) = board.accelerometer else { return Vec::new() };
    let driven = [sck, mosi, cs];
    [
        levels(&[sck, cs], &[mosi]),
        push_pull(&driven),
        fields(&driven, OSPEEDR, 2, LOW_SPEED),
        fields(&driven, MODER, 2, OUTPUT),
        fields(&[miso], PUPDR, 2, PULL_UP),
        fields(&[miso], MODER, 2, 0),
    ]
    .concat()
}

fn eeprom_pins(board: &Board) -> Vec<Pin> {
    board.eeprom.iter().flat_map(|Eeprom { scl, sda, .. }| [*scl, *sda]).collect()
}

/// The bus at rest: both lines released before they are outputs, which pull low alone. The chip's
/// pull-ups help the board's.
fn eeprom(board: &Board) -> Vec<Store> {
    let pins = eeprom_pins(board);
    [
        levels(&pins, &[]),
        fields(&pins, OTYPER, 1, 1),
        fields(&pins, PUPDR, 2, PULL_UP),
        fields(&pins, OSPEEDR, 2, LOW_SPEED),
        fields(&pins, MODER, 2, OUTPUT),
    ]
    .concat()
}

/// The output of the machine's power supply, with the supply on or off: its level first, so that
/// the change to an output makes no pulse. A pin that no profile uses stays an input.
fn supply(board: &Board, is_on: impl Fn(&SupplyOutput) -> bool) -> Vec<Store> {
    let Some(output) = &board.used_supply else { return Vec::new() };
    let pin = [output.pin];
    let (high, low): (&[Pin], &[Pin]) =
        if is_on(output) == output.settings.on_is_low { (&[], &pin) } else { (&pin, &[]) };
    [levels(high, low), push_pull(&pin), fields(&pin, OSPEEDR, 2, LOW_SPEED), fields(&pin, MODER, 2, OUTPUT)].concat()
}

/// The output for a servo, low: no pulse. A pin that no profile uses stays an input.
fn servo(board: &Board) -> Vec<Store> {
    let Some(pin) = board.used_servo else { return Vec::new() };
    let pin = [pin];
    [levels(&[], &pin), push_pull(&pin), fields(&pin, OSPEEDR, 2, LOW_SPEED), fields(&pin, MODER, 2, OUTPUT)].concat()
}

/// Outputs that drive both levels, without pulls: a boot loader may have had them otherwise.
fn push_pull(pins: &[Pin]) -> Vec<Store> {
    [fields(pins, OTYPER, 1, 0), fields(pins, PUPDR, 2, 0)].concat()
}

/// Heaters off, whatever used their pins before: low first, so that the change to an
/// output makes no pulse.
fn heaters_off(board: &Board) -> Vec<Store> {
    let heaters = heater_pins(board);
    [levels(&[], &heaters), fields(&heaters, MODER, 2, OUTPUT)].concat()
}

/// The image's first instructions: heaters off, motors off, everything that a boot loader may
/// have started off.
pub fn first(board: &Board) -> Vec<Store> {
    let outputs = [heater_pins(board), enable_pins(board), signal_pins(board), board.serial.to_vec()].concat();
    let others = board.fans.iter().map(|fan| fan.pin).chain(thermistor_pins(board)).chain(card_pins(board));
    let others = others.chain(accelerometer_pins(board)).chain(eeprom_pins(board));
    let others = others.chain(board.used_supply.map(|supply| supply.pin)).chain(board.used_servo);
    let ports = outputs.into_iter().chain(others).fold(0, |ports, pin| ports | 1 << pin.port);
    // Twice: the second time reads the first back (`Registers::switch_clocks_on` says why).
    let mut stores = vec![Store { address: RCC_AHB1ENR, clear: 0, set: ports }; 2];
    stores.extend(heaters_off(board));
    stores.extend(push_pull(&heater_pins(board)));
    stores.extend(levels(&enable_pins(board), &step_pins(board)));
    stores.extend(push_pull(&enable_pins(board)));
    stores.extend(fields(&enable_pins(board), MODER, 2, OUTPUT));
    // SysTick and the memory protection are off, and `wfi` sleeps lightly: a deep sleep would
    // stop all clocks.
    stores.extend([SYST_CSR, MPU_CTRL, SCB_SCR].map(|register| Store::word(register, 0)));
    stores.push(Store::word(SCB_CCR, CCR_AT_RESET));
    stores.extend(as_after_reset(board.chip, ports));
    for word in 0..board.chip.interrupt_words {
        stores.push(Store::word(NVIC_ICER + 4 * word, u32::MAX));
        stores.push(Store::word(NVIC_ICPR + 4 * word, u32::MAX));
    }
    // PENDSTCLR and PENDSVCLR.
    stores.push(Store::word(SCB_ICSR, 1 << 25 | 1 << 27));
    stores
}

/// The stores of the panic and fault handlers: heaters off, motors off, the fans of nozzle and
/// part full, the power supply off where it can be switched, and the USB port off the bus, so that
/// its host stops as well. Without such a supply a transistor that has failed closed keeps
/// heating, so the fans cool.
pub fn all_off(board: &Board) -> Vec<Store> {
    let outputs = |on: bool| -> Vec<Pin> {
        board.safe_outputs.iter().filter(|(_, is_on)| *is_on == on).map(|(pin, _)| *pin).collect()
    };
    let (on, off) = (outputs(true), outputs(false));
    let mut stores = [
        heaters_off(board),
        levels(&enable_pins(board), &step_pins(board)),
        levels(&on, &off),
        fields(&[on, off].concat(), MODER, 2, OUTPUT),
        supply(board, |_| false),
    ]
    .concat();
    if board.usb.is_some() {
        // Its clock may still be off.
        let clock = Store { address: RCC_AHB2ENR, clear: 0, set: usb_controller::CLOCK };
        let disconnect = Store { address: usb_controller::DCTL, clear: 0, set: usb_controller::SOFT_DISCONNECT };
        stores.extend([clock, clock, disconnect]);
    }
    stores
}

/// The stores of `init`: motors, thermistors and the serial line are ready, fans off.
pub fn pins(board: &Board) -> Vec<Store> {
    let fans: Vec<Pin> = board.fans.iter().map(|fan| fan.pin).collect();
    let signals = signal_pins(board);
    let [_, receiver] = board.serial;
    [
        levels(&[], &fans),
        push_pull(&fans),
        fields(&fans, MODER, 2, OUTPUT),
        fields(&thermistor_pins(board), PUPDR, 2, 0),
        fields(&thermistor_pins(board), MODER, 2, ANALOGUE),
        push_pull(&signals),
        fields(&signals, MODER, 2, OUTPUT),
        fields(&signals, OSPEEDR, 2, LOW_SPEED),
        push_pull(&board.serial),
        fields(&board.serial, AFRL, 4, SERIAL_FUNCTION),
        // The pull-up keeps an open line silent.
        fields(&[receiver], PUPDR, 2, PULL_UP),
        fields(&board.serial, MODER, 2, ALTERNATE),
        card(board),
        accelerometer(board),
        eeprom(board),
        supply(board, |output| output.settings.on_at_start),
        servo(board),
    ]
    .concat()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    /// Registers after some stores, starting from their reset values, which are zeros as far as the
    /// tests need them.
    fn after(stores: &[Store]) -> BTreeMap<u32, u32> {
        let mut registers = BTreeMap::new();
        for Store { address, clear, set } in stores {
            let register = registers.entry(*address).or_insert(0);
            *register = *register & !clear | set;
        }
        registers
    }

    fn boards() -> impl Iterator<Item = Board> {
        crate::builtin_names().map(|name| crate::load(name).unwrap())
    }

    /// Place of the first store that drives a pin low or high.
    fn drives(stores: &[Store], pin: Pin, high: bool) -> Option<usize> {
        let bit = if high { pin.bit() } else { pin.bit() << 16 };
        stores.iter().position(|store| store.address == of_port(pin.port, BSRR) && store.set & bit != 0)
    }

    #[test]
    fn the_bench_is_what_it_was_by_hand() {
        let board = crate::load("bench").unwrap();
        let [gpioa, gpiob, gpioc] = [0x4002_0000, 0x4002_0400, 0x4002_0800];
        let off = all_off(&board);
        let levels = [
            // Heaters off; drivers off and steps low; fans on.
            Store::word(gpioa + 0x18, 0b11 << 22),
            Store::word(gpioc + 0x18, 1 << 8 | 0b1111 << 16),
            Store::word(gpiob + 0x18, 0b11 << 6),
        ];
        assert_eq!(off.first(), levels.first());
        assert!(levels.iter().filter_map(|level| off.iter().position(|store| store == level)).is_sorted());
        assert!(levels.iter().all(|level| off.contains(level)));
        let disconnect = Store { address: 0x5000_0804, clear: 0, set: 0b10 };
        assert_eq!((off.len(), off.last()), (8, Some(&disconnect)));
        let all = after(&[first(&board), pins(&board)].concat());
        assert_eq!(all[&gpioc], 0x1_5555);
        assert_eq!(all[&(gpioc + 8)], 0, "the slowest edges");
        assert_eq!(all[&(gpioa + 0x24)], 0x770);
        assert_eq!(all[&(gpioa + 0x0c)], 0b01 << 20);
        // The serial line, the heaters, the thermistors.
        assert_eq!(all[&gpioa], 0b1010 << 18 | 0b0101 << 12 | 0b1111 << 2);
        assert_eq!(all[&gpiob], 0b0101 << 12);
        assert_eq!(all[&RCC_AHB1ENR], 0b111 | 1 << 20);
    }

    #[test]
    fn no_pin_is_an_output_before_its_level_is_safe() {
        for board in boards() {
            let first = first(&board);
            for heater in heater_pins(&board) {
                let low = drives(&first, heater, false).unwrap();
                let output = first.iter().position(|store| {
                    store.address == of_port(heater.port, MODER) && store.set >> (2 * heater.number) & 0b11 == OUTPUT
                });
                assert!(low < output.unwrap(), "{} {heater}", board.name);
                assert_eq!(drives(&first, heater, true), None);
                assert_eq!(drives(&pins(&board), heater, true), None);
            }
            for enable in enable_pins(&board) {
                let off = drives(&first, enable, true).unwrap();
                let output = first.iter().rposition(|store| {
                    store.address == of_port(enable.port, MODER) && store.set >> (2 * enable.number) & 0b11 == OUTPUT
                });
                assert!(off < output.unwrap(), "{} {enable}", board.name);
                assert_eq!(drives(&first, enable, false), None);
            }
        }
    }

    /// Only the fans of nozzle and part blow, after heaters and motors are off and once the pins
    /// are taken from their timers.
    #[test]
    fn the_end_lets_both_fans_blow() {
        for board in boards() {
            let stores = all_off(&board);
            for fan in &board.fans {
                let full = drives(&stores, fan.pin, true);
                let output = stores.iter().position(|store| {
                    store.address == of_port(fan.pin.port, MODER) && store.set >> (2 * fan.pin.number) & 0b11 == OUTPUT
                });
                let cools = matches!(fan.name, "part" | "hotend");
                assert_eq!((full.is_some(), output.is_some()), (cools, cools), "{} {}", board.name, fan.name);
                let motors_off = enable_pins(&board).into_iter().filter_map(|pin| drives(&stores, pin, true)).max();
                assert!(
                    full.is_none_or(|full| motors_off.unwrap() <= full && full < output.unwrap()),
                    "{}",
                    board.name
                );
            }
        }
    }

    #[test]
    fn the_end_reaches_every_heater_first_and_every_motor() {
        for board in boards() {
            let stores = all_off(&board);
            let last_heater = heater_pins(&board).iter().map(|pin| drives(&stores, *pin, false).unwrap()).max();
            for enable in enable_pins(&board) {
                let off = drives(&stores, enable, true).unwrap();
                assert!(last_heater.is_none_or(|heater| heater < off), "{} {enable}", board.name);
            }
            for step in step_pins(&board) {
                assert!(drives(&stores, step, false).is_some(), "{} {step}", board.name);
            }
        }
    }

    #[test]
    fn thermistors_are_analogue_and_have_no_pull() {
        for board in boards() {
            let registers = after(&[first(&board), pins(&board)].concat());
            let field = |pin: Pin, offset| {
                registers.get(&of_port(pin.port, offset)).copied().unwrap_or(0) >> (2 * pin.number) & 0b11
            };
            for pin in thermistor_pins(&board) {
                assert_eq!((field(pin, MODER), field(pin, PUPDR)), (ANALOGUE, 0), "{} {pin}", board.name);
                assert_eq!(registers[&RCC_AHB1ENR] >> pin.port & 1, 1, "{} {pin}", board.name);
            }
        }
    }

    /// No clock edge and no select before the first frame, and an undriven data line reads ones.
    #[test]
    fn an_accelerometers_bus_rests_before_it_is_driven() {
        let board = crate::load("btt-octopus-1.1").unwrap();
        let Accelerometer { sck, miso, mosi, cs, .. } = board.accelerometer.unwrap();
        let stores = pins(&board);
        let registers = after(&[first(&board), stores.clone()].concat());
        let field = |pin: Pin, offset| {
            registers.get(&of_port(pin.port, offset)).copied().unwrap_or(0) >> (2 * pin.number) & 0b11
        };
        for (pin, high) in [(sck, true), (cs, true), (mosi, false)] {
            let level = drives(&stores, pin, high).unwrap();
            let output = stores.iter().position(|store| {
                store.address == of_port(pin.port, MODER) && store.set >> (2 * pin.number) & 0b11 == OUTPUT
            });
            assert!(level < output.unwrap() && drives(&stores, pin, !high).is_none(), "{pin}");
            assert_eq!((field(pin, MODER), field(pin, OSPEEDR)), (OUTPUT, LOW_SPEED));
            assert_eq!(registers[&RCC_AHB1ENR] >> pin.port & 1, 1, "{pin}");
        }
        assert_eq!((field(miso, MODER), field(miso, PUPDR)), (0, PULL_UP));
    }

    /// Neither line is ever driven high, and none is an output before it is released.
    #[test]
    fn an_eeproms_lines_are_open_drain_and_released() {
        let board = crate::load("btt-octopus-1.1").unwrap();
        let Eeprom { scl, sda, .. } = board.eeprom.unwrap();
        let stores = pins(&board);
        let registers = after(&[first(&board), stores.clone()].concat());
        for pin in [scl, sda] {
            let field = |offset, width: u8| {
                let register = registers.get(&of_port(pin.port, offset)).copied().unwrap_or(0);
                register >> (width * pin.number) & ((1 << width) - 1)
            };
            assert_eq!((field(MODER, 2), field(OTYPER, 1), field(PUPDR, 2)), (OUTPUT, 1, PULL_UP), "{pin}");
            let place = |offset, bits: u32| {
                stores.iter().position(|store| store.address == of_port(pin.port, offset) && store.set & bits == bits)
            };
            let [released, open, output] =
                [drives(&stores, pin, true), place(OTYPER, pin.bit()), place(MODER, OUTPUT << (2 * pin.number))];
            assert!(released < output && open < output && released.is_some() && open.is_some(), "{pin}");
            assert_eq!(drives(&stores, pin, false), None, "{pin}");
            assert_eq!(registers[&RCC_AHB1ENR] >> pin.port & 1, 1, "{pin}");
        }
    }

    #[test]
    fn only_pins_of_the_board_are_touched() {
        for board in boards() {
            let fans = board.fans.iter().map(|fan| fan.pin);
            let known: Vec<Pin> =
                [heater_pins(&board), enable_pins(&board), signal_pins(&board), board.serial.to_vec()]
                    .concat()
                    .into_iter()
                    .chain(fans)
                    .chain(thermistor_pins(&board))
                    .chain(card_pins(&board))
                    .chain(accelerometer_pins(&board))
                    .chain(eeprom_pins(&board))
                    .collect();
            for Store { address, clear, .. } in [first(&board), pins(&board), all_off(&board)].concat() {
                let Some(offset) = address.checked_sub(gpio::GPIO).filter(|offset| *offset < 7 * gpio::GPIO_STRIDE)
                else {
                    continue;
                };
                if offset % gpio::GPIO_STRIDE != MODER {
                    continue;
                }
                let port = (offset / gpio::GPIO_STRIDE) as u8;
                let mask =
                    known.iter().filter(|pin| pin.port == port).fold(0, |mask, pin| mask | 0b11 << (2 * pin.number));
                assert_eq!(clear & !mask, 0, "{} {address:#x}", board.name);
            }
        }
    }
}

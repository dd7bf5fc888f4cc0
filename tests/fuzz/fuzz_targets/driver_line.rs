//! Any bytes are a TMC2209's reply or a reported error; and whatever comes over the line, the
//! drivers' code ends in drivers that are confirmed or have failed, the chips of those that are
//! confirmed hold what was to be written.
#![no_main]

use ferrostep_tmc2209::{
    DriverBank, DriverSettings, DriverState, LineBusy, LineTiming, Register, RegisterImage, SingleWireUart, crc8,
    parse_reply,
};
use ferrostep_virtual_board::{VIRTUAL_WIRING, VirtualDriverLines};
use libfuzzer_sys::fuzz_target;

const TIMING: LineTiming = LineTiming::new(1_000_000, 115_200);

const SETTINGS: DriverSettings = DriverSettings {
    current_ma: 600,
    hold_percent: 50,
    microsteps: 16,
    interpolate: true,
    stealth_chop: true,
    spread_cycle_above_mm_per_s: 0,
    steps_per_mm: 100.0,
    stall_threshold: 0,
    both_edges: false,
};

/// Model chips on a line that the input disturbs: a byte that is not 0 is added to
/// what is received.
struct Disturbed<'a> {
    lines: VirtualDriverLines,
    input: &'a [u8],
}

impl SingleWireUart for Disturbed<'_> {
    fn send(&mut self, line: u8, bytes: &[u8], now_ticks: u32) -> Result<(), LineBusy> {
        self.lines.send(line, bytes, now_ticks)
    }

    fn receive(&mut self, now_ticks: u32) -> Option<u8> {
        let byte = self.lines.receive(now_ticks)?;
        let Some((first, rest)) = self.input.split_first() else { return Some(byte) };
        self.input = rest;
        match first {
            // Lost.
            0xff => self.lines.receive(now_ticks),
            // A reset in between.
            0xfe => {
                let motor = rest.len() % 4;
                self.lines.chip(motor).into_iter().for_each(|chip| chip.reset());
                Some(byte)
            }
            first => Some(byte.wrapping_add(*first)),
        }
    }
}

fuzz_target!(|input: &[u8]| {
    for register in Register::ALL {
        match parse_reply(input, register) {
            Ok(value) => {
                assert_eq!(input[..3], [0x05, 0xff, register.address()]);
                assert_eq!(input[3..7], value.to_be_bytes());
                assert_eq!(input[7], crc8(&input[..7]));
            }
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    }
    let drivers = VIRTUAL_WIRING.map(|wiring| Some((SETTINGS, wiring)));
    let mut bank = DriverBank::new(drivers, TIMING, 0);
    let lines = VirtualDriverLines::new(VIRTUAL_WIRING.map(Some), TIMING.bit_ticks);
    let mut line = Disturbed { lines, input };
    let mut now = 0;
    // Once the disturbances have ended, five seconds are enough.
    let mut end = 5_000_000;
    while now < end {
        if !line.input.is_empty() {
            end = now + 5_000_000;
        }
        if let Some(event) = bank.poll(&mut line, now) {
            assert!(!event.to_string().is_empty());
        } else {
            now += bank.idle_ticks(now).clamp(1, 10_000);
        }
    }
    for (motor, wiring) in VIRTUAL_WIRING.iter().enumerate() {
        assert_eq!(bank.state(motor), Some(DriverState::Confirmed));
        let image = RegisterImage::new(&SETTINGS, wiring).unwrap();
        let chip = line.lines.chip(motor).unwrap();
        assert!(image.writes.iter().all(|(register, value)| chip.register(*register) == *value));
    }
});

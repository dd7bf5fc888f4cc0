//! Thermistors for an emulator that has no converter that goes on by itself, and no DMA: the image's one function that
//! takes readings is replaced, in a copy, by one that takes them from a word of memory that nothing else uses.

use std::path::{Path, PathBuf};

use ferrostep_hal_shim::thermistor::{Thermistor, ThermistorType};
use ferrostep_image_code::code::Code;
use object::{Object, ObjectSection};

use crate::image::Bench;

/// Below all that the stack comes down to. It is 0 after reset.
const WORD: u32 = 0x2000_0100;

/// What both thermistors read at a temperature: types differ little where beds and nozzles are cool.
pub fn reading(celsius: f32) -> u16 {
    Thermistor { kind: ThermistorType::Epcos100k, pull_up_ohm: 4700.0 }.reading(celsius)
}

/// What they read while the word is 0.
fn room() -> u16 {
    reading(25.0)
}

/// `movw` (0xf240) or `movt` (0xf2c0) of a constant to r1.
fn load(instruction: u16, constant: u16) -> [u16; 2] {
    let (high, low) = (constant >> 12, constant & 0xff);
    [instruction | (constant >> 11 & 1) << 10 | high, (constant >> 8 & 7) << 12 | 1 << 8 | low]
}

/// `return *WORD ^ room()`.
fn replacement() -> Vec<u8> {
    let (low, high) = (WORD as u16, (WORD >> 16) as u16);
    // ldrh r0, [r1]; eors r0, r1; bx lr
    let words =
        [&load(0xf240, low)[..], &load(0xf2c0, high), &[0x8808], &load(0xf240, room()), &[0x4048, 0x4770]].concat();
    words.into_iter().flat_map(u16::to_le_bytes).collect()
}

/// A copy of an image with that function, in a folder.
pub fn with_thermistors(image: &Path, folder: &Path) -> PathBuf {
    let functions = Code::of(image).unwrap().functions_named("reading_of_sensor");
    let &[function] = functions.as_slice() else { panic!("{}: {functions:x?}", image.display()) };
    let mut bytes = std::fs::read(image).unwrap();
    let place = {
        let file = object::File::parse(&*bytes).unwrap();
        let text = file.section_by_name(".text").unwrap();
        let (start, _) = text.file_range().unwrap();
        (start + u64::from(function) - text.address()) as usize
    };
    let code = replacement();
    bytes[place..place + code.len()].copy_from_slice(&code);
    let copy = folder.join("thermistors.elf");
    std::fs::write(&copy, bytes).unwrap();
    copy
}

/// From now on both thermistors read this.
pub fn set_reading(bench: &mut Bench, reading: u16) {
    let mut debugger = bench.host.port().halt().unwrap();
    debugger.write_memory(WORD, &(reading ^ room()).to_le_bytes()).unwrap();
    debugger.resume().unwrap();
}

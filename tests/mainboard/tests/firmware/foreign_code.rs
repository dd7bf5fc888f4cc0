//! Code that no image contains, executed in place of its sleep, to simulate a stray jump
//! or damaged memory.

use std::path::Path;

use ferrostep_image_code::code::Code;
use object::{Object, ObjectSection};

/// Below the lowest address of the stack.
pub const PROGRAM: u32 = 0x2000_0200;

/// The processor jumps to the address in this word as soon as it is not 0.
pub const JUMP_TARGET: u32 = PROGRAM - 4;

/// Bytes at the end of flash that no image uses.
const STUB_BYTES: u32 = 64;

/// `movw` and `movt` of a constant to a register.
pub fn load(register: u16, constant: u32) -> [u16; 4] {
    let half = |instruction: u16, half: u16| {
        let (high, low) = (half >> 12, half & 0xff);
        [instruction | (half >> 11 & 1) << 10 | high, (half >> 8 & 7) << 12 | register << 8 | low]
    };
    let ([a, b], [c, d]) = (half(0xf240, constant as u16), half(0xf2c0, (constant >> 16) as u16));
    [a, b, c, d]
}

/// `b .`
pub const STAND_STILL: u16 = 0xe7fe;

/// The code in place of the image's function that sleeps: sleeps, reads [`JUMP_TARGET`], and either
/// clears it and jumps there or returns.
fn stub() -> Vec<u16> {
    // wfi; r3 = JUMP_TARGET; ldr r2, [r3]; cmp r2, #0; beq to the return; movs r0, #0; str r0,
    // [r3]; bx r2; pop {r7, pc}
    [&[0xbf30][..], &load(3, JUMP_TARGET), &[0x681a, 0x2a00, 0xd002, 0x2000, 0x6018, 0x4710, RETURN]].concat()
}

/// `pop {r7, pc}`: the function has its own frame.
const RETURN: u16 = 0xbd80;

/// An image whose sleep is replaced by a stub.
#[derive(Clone, Debug)]
pub struct PatchedImage {
    /// The image; the function that sleeps leads to the stub.
    pub image: Vec<u8>,
    /// The stub, for the end of flash.
    pub stub: Vec<u8>,
    /// The address of the stub.
    pub stub_address: u32,
}

impl PatchedImage {
    /// Patches an image for a chip whose flash ends at this address.
    pub fn of(image: &Path, flash_end: u32) -> Self {
        let all = Code::of(image).unwrap().instructions().unwrap();
        let sleeps: Vec<_> = all.windows(2).filter(|pair| pair[0].name == "wfi").collect();
        let &[[sleep, back]] = sleeps.as_slice() else { panic!("{} places to sleep", sleeps.len()) };
        assert_eq!((back.length, back.name.as_str()), (2, "pop"), "{back}");
        let mut bytes = std::fs::read(image).unwrap();
        let place = {
            let file = object::File::parse(&*bytes).unwrap();
            let text = file.section_by_name(".text").unwrap();
            (text.file_range().unwrap().0 + u64::from(sleep.address) - text.address()) as usize
        };
        let stub_address = flash_end - STUB_BYTES;
        let branch: Vec<u8> = branch(sleep.address, stub_address).into_iter().flat_map(u16::to_le_bytes).collect();
        bytes[place..place + 4].copy_from_slice(&branch);
        Self { image: bytes, stub: stub().into_iter().flat_map(u16::to_le_bytes).collect(), stub_address }
    }
}

/// `b.w` (ARMv7-M, A7.7.12, encoding T4).
fn branch(from: u32, to: u32) -> [u16; 2] {
    let distance = to.wrapping_sub(from + 4);
    let bit = |place: u32| (distance >> place & 1) as u16;
    let (sign, high, low) = (bit(24), (distance >> 12 & 0x3ff) as u16, (distance >> 1 & 0x7ff) as u16);
    [0xf000 | sign << 10 | high, 0x9000 | (1 ^ bit(23) ^ sign) << 13 | (1 ^ bit(22) ^ sign) << 11 | low]
}

#[test]
fn constants_are_encoded_as_the_architecture_s_manual_says() {
    // A7.7.76 and A7.7.79: imm4:i:imm3:imm8.
    assert_eq!(load(1, 0xe000_ed0c), [0xf64e, 0x510c, 0xf2ce, 0x0100]);
}

#[test]
fn branches_are_encoded_as_the_architecture_s_manual_says() {
    // From an assembler: 4 ahead, 4 back, 1 MiB ahead.
    assert_eq!(branch(0x0800_0000, 0x0800_0008), [0xf000, 0xb802]);
    assert_eq!(branch(0x0800_0000, 0x0800_0000), [0xf7ff, 0xbffe]);
    assert_eq!(branch(0x0800_0000, 0x0810_0004), [0xf100, 0xb800]);
}

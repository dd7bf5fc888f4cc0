//! Code that no image has, executed in the place of its sleep: what a stray jump or a broken flash would come to.

use ferrostep_image_code::code::Code;
use rigless::emulator::Host as Core;
use rigless::soc::Width;

/// Below all that the stack comes down to.
pub const PROGRAM: u32 = 0x2000_0200;

/// This word has its own address as soon as the program runs.
const MARK: u32 = PROGRAM - 4;

/// `str r3, [r3]`.
const STORE_R3: u16 = 0x601b;

/// `ldr.w pc, [pc]`: the word behind it is where to go on.
const JUMP: [u16; 2] = [0xf8df, 0xf000];

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

/// What makes a processor that wakes up go to [`PROGRAM`] instead of back to sleep.
///
/// The branch behind the image's one `wfi` leads to the first instructions of the function around it, which are its start
/// and never run again; a jump to RAM takes their place.
#[derive(Clone, Debug)]
pub struct Diversion {
    branch: u32,
    jump: u32,
    before: Vec<(u32, u16)>,
}

impl Diversion {
    /// The places in an image.
    pub fn of(code: &Code) -> Self {
        let all = code.instructions().unwrap();
        let sleeps: Vec<_> = all.windows(2).filter(|pair| pair[0].name == "wfi").collect();
        let &[[sleep, branch]] = sleeps.as_slice() else { panic!("one place to sleep") };
        assert_eq!((branch.length, branch.target()), (2, Some(sleep.address)), "{branch}");
        let jump = code.function_start(sleep.address).unwrap().next_multiple_of(4);
        assert!(jump + 8 < sleep.address, "no room in the start");
        Self { branch: branch.address, jump, before: Vec::new() }
    }

    /// Puts the program into RAM and the way to it into flash.
    pub fn begin(&mut self, core: &mut dyn Core, code: &[u16]) {
        let program = load(3, MARK).into_iter().chain([STORE_R3]).chain(code.iter().copied());
        core.write(u64::from(MARK), Width::W32, 0).unwrap();
        for (place, half) in (u64::from(PROGRAM)..).step_by(2).zip(program) {
            core.write(place, Width::W16, u64::from(half)).unwrap();
        }
        // PC is 4 ahead of a branch, and its distance is in halfwords (ARMv7-M, A7.7.12, encoding T2).
        let distance = self.jump.wrapping_sub(self.branch + 4) >> 1 & 0x7ff;
        let target = (PROGRAM | 1).to_le_bytes();
        let target = [u16::from_le_bytes([target[0], target[1]]), u16::from_le_bytes([target[2], target[3]])];
        let jump = JUMP.into_iter().chain(target);
        let stores = (self.jump..).step_by(2).zip(jump).chain([(self.branch, 0xe000 | distance as u16)]);
        for (place, half) in stores {
            let before = core.read(u64::from(place), Width::W16).unwrap() as u16;
            self.before.push((place, before));
            core.program(u64::from(place), Width::W16, u64::from(half)).unwrap();
        }
    }

    /// Whether the program runs.
    pub fn has_begun(&self, core: &mut dyn Core) -> bool {
        core.read(u64::from(MARK), Width::W32).unwrap() == u64::from(MARK)
    }

    /// Puts flash back as it was.
    pub fn end(&self, core: &mut dyn Core) {
        for &(place, half) in &self.before {
            core.program(u64::from(place), Width::W16, u64::from(half)).unwrap();
        }
    }
}

#[test]
fn constants_are_encoded_as_the_architecture_s_manual_says() {
    // A7.7.76 and A7.7.79: imm4:i:imm3:imm8.
    assert_eq!(load(1, 0xe000_ed0c), [0xf64e, 0x510c, 0xf2ce, 0x0100]);
}

//! A boot loader of one kind of statement: it stores words, waits for bits, and starts the image
//! with its masks and stacks.

use std::path::Path;

use rigless::image::Image;

/// Address of the stub: after the largest image, aligned for a vector table.
pub const BASE: u32 = 0x080C_0000;
/// Entries of its vector table: the stack pointer, then addresses of instructions,
/// for 82 interrupts.
const VECTORS: u32 = 16 + 82;
/// Stack of the stub; the image's stack is elsewhere.
const STACK: u32 = 0x2001_0000;

/// For each record of the table after it (address, value, mask): a store if the mask is 0, else a
/// wait until the masked word has the value. After a record of zeros: the image's vector table,
/// CONTROL, BASEPRI, PRIMASK with FAULTMASK in bit 1, PSP, and MSP (0: the image's own, as correct
/// boot loaders do).
///
/// ```text
///         cpsid i                        done:  ldmia r7!, {r0-r5}
///         ldr   r7, table                       cbnz  r5, own
/// next:   ldmia r7!, {r0, r1, r2}               ldr   r5, [r0]
///         cbz   r0, done                 own:   ldr   r6, [r0, #4]
///         cbz   r2, store                       msr   msp, r5
/// wait:   ldr   r3, [r0]                        msr   psp, r4
///         ands  r3, r2                          msr   basepri, r2
///         cmp   r3, r1                          msr   primask, r3
///         bne   wait                            lsrs  r3, r3, #1
///         b     next                            msr   faultmask, r3
/// store:  str   r1, [r0]                        msr   control, r1
///         b     next                            isb
///                                               bx    r6
/// table:  .word (the table's address)
/// ```
const CODE: [u16; 32] = [
    0xB672, 0x4F0F, 0xCF07, 0xB138, 0xB122, 0x6803, 0x4013, 0x428B, 0xD1FB, 0xE7F7, 0x6001, 0xE7F5, 0xCF3F, 0xB905,
    0x6805, 0x6846, 0xF385, 0x8808, 0xF384, 0x8809, 0xF382, 0x8811, 0xF383, 0x8810, 0x085B, 0xF383, 0x8813, 0xF381,
    0x8814, 0xF3BF, 0x8F6F, 0x4730,
];
/// The handler of an interrupt before the image has set its own vector table: `b .`
const STUCK: u32 = 0xE7FE_E7FE;

/// The boot loader's statements and the state in which it starts the image.
#[derive(Debug, Clone, Default)]
pub struct Stub {
    /// Address, value, and mask of the bits to wait for (0: a store).
    pub statements: Vec<(u32, u32, u32)>,
    pub control: u32,
    pub basepri: u32,
    pub masks: u32,
    pub process_stack: u32,
    pub main_stack: u32,
}

impl Stub {
    /// Appends another boot loader; its masks and stacks are added.
    pub fn and(mut self, other: &Self) -> Self {
        self.statements.extend(&other.statements);
        for (mine, theirs) in [
            (&mut self.control, other.control),
            (&mut self.basepri, other.basepri),
            (&mut self.masks, other.masks),
            (&mut self.process_stack, other.process_stack),
            (&mut self.main_stack, other.main_stack),
        ] {
            *mine |= theirs;
        }
        self
    }

    /// An image of the boot loader that starts another image at `next`.
    pub fn image(&self, next: u32) -> Image {
        let stuck = BASE + 4 * VECTORS;
        let code = stuck + 4;
        let table = code + 2 * CODE.len() as u32 + 4;
        let mut words = vec![STACK, code | 1];
        words.resize(VECTORS as usize, stuck | 1);
        words.push(STUCK);
        words.extend(CODE.chunks(2).map(|pair| u32::from(pair[0]) | u32::from(pair[1]) << 16));
        words.push(table);
        words.extend(self.statements.iter().flat_map(|(address, value, mask)| [*address, *value, *mask]));
        words.extend([0; 3]);
        words.extend([next, self.control, self.basepri, self.masks, self.process_stack, self.main_stack]);
        let bytes = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        Image::new(Path::new("boot loader"), bytes, Some(u64::from(BASE))).unwrap()
    }
}

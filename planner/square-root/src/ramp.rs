//! The intervals of a ramp, one after the other: what the square root is most used for.

/// Equally spaced steps at a constant acceleration.
///
/// The squared speed at the step of index k is `slow` + k `gain`; from one step to the next it
/// takes `dividend` divided by the sum of the speeds there.
// Fixed order: the assembly below loads all, and stores the first three.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Ramp {
    /// Index of the step.
    pub index: f32,
    /// Speed there.
    pub speed: f32,
    /// The last interval that was worked out, and half of one.
    pub interval_and_half: f32,
    /// 1, or -1 where the index falls.
    pub direction: f32,
    /// Squared speed at index 0.
    pub slow: f32,
    /// Growth of the squared speed with the index.
    pub gain: f32,
    /// The interval of speeds whose sum is 1.
    pub dividend: f32,
    half: f32,
}

impl Ramp {
    /// Ramp at the step of this index, with this speed.
    #[inline(always)]
    pub fn new([index, direction]: [f32; 2], speed: f32, [slow, gain]: [f32; 2], dividend: f32) -> Self {
        Self { index, speed, interval_and_half: 0.0, direction, slow, gain, dividend, half: 0.5 }
    }

    /// Advances to the next step; returns how long that takes, the nearest whole
    /// number, cut to 32 bits.
    #[cfg(all(target_arch = "arm", target_os = "none", target_abi = "eabihf"))]
    #[inline(always)]
    pub fn advance(&mut self) -> u32 {
        let interval: u32;
        // The compiler takes a call of C's function for one that may be made, round which it keeps
        // little in registers.
        // SAFETY: the block loads the eight floats that the pointer points to and stores the first
        // three, as the layout of C has them; the exclusive reference rules out other uses
        // meanwhile. It uses no other memory and no stack, and the flags of the core stay. The
        // target's ABI (hard float) says that the floating-point unit is there and on. All
        // registers that are overwritten are declared. VMLA rounds the product before it adds, as
        // the code for other targets does; VCVT cuts and saturates, as a cast does.
        unsafe {
            core::arch::asm!(
                "vldmia {ramp}, {{s0-s7}}",
                "vadd.f32 s8, s0, s3",
                "vmla.f32 s4, s8, s5",
                "vsqrt.f32 s9, s4",
                "vadd.f32 s10, s1, s9",
                "vdiv.f32 s10, s6, s10",
                "vadd.f32 s10, s10, s7",
                "vstmia {ramp}, {{s8-s10}}",
                "vcvt.u32.f32 s10, s10",
                "vmov {interval}, s10",
                ramp = in(reg) core::ptr::from_mut(self),
                interval = lateout(reg) interval,
                out("s0") _, out("s1") _, out("s2") _, out("s3") _,
                out("s4") _, out("s5") _, out("s6") _, out("s7") _,
                out("s8") _, out("s9") _, out("s10") _,
                options(nostack, preserves_flags),
            );
        }
        interval
    }

    /// Advances to the next step; returns how long that takes, the nearest whole
    /// number, cut to 32 bits.
    #[cfg(not(all(target_arch = "arm", target_os = "none", target_abi = "eabihf")))]
    #[inline(always)]
    pub fn advance(&mut self) -> u32 {
        self.index += self.direction;
        let speed = crate::root::square_root(self.slow + self.index * self.gain);
        self.interval_and_half = self.dividend / (self.speed + speed) + self.half;
        self.speed = speed;
        self.interval_and_half as u32
    }
}

#[cfg(test)]
mod tests {
    use super::Ramp;

    #[test]
    fn a_ramp_takes_the_same_time_up_and_down() {
        // Ramp from standstill at an acceleration of 2^-10 steps a tick each tick, in ticks: sqrt(2
        // k / a) = 45.25 sqrt(k).
        let gain = 2.0 / 1024.0;
        let mut up = Ramp::new([0.0, 1.0], 0.0, [0.0, gain], 2.0);
        let intervals = [(); 100].map(|()| up.advance());
        assert_eq!(intervals[..4], [45, 19, 14, 12]);
        assert_eq!(up.index, 100.0);
        let mut down = Ramp::new([100.0, -1.0], up.speed, [0.0, gain], 2.0);
        assert!(intervals.iter().rev().all(|interval| down.advance() == *interval));
        assert_eq!((down.index, down.speed), (0.0, 0.0));
    }

    #[test]
    fn long_and_impossible_intervals() {
        let mut still = Ramp::new([0.0, 1.0], 0.0, [0.0, 0.0], 2.0);
        assert_eq!(still.advance(), u32::MAX);
        assert_eq!(still.interval_and_half, f32::INFINITY);
        // A hair below standstill.
        let mut below = Ramp::new([1.0, -1.0], 1.0, [-1e-9, 0.0], 2.0);
        assert_eq!(below.advance(), 0);
    }
}

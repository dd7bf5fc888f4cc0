//! The full-speed USB controller (OTG_FS), on PA11 and PA12.
//!
//! Its driver is synopsys-usb-otg. It waits for flags without end and panics when its clock is too
//! slow or when a bus reset ends with a speed that it does not know. So it starts only on a
//! controller that has answered and has its 48 MHz, and [`UsbGuard`] checks the speed first.

use core::fmt;

use ferrostep_stm32f4::clock_tree::{Clock, ClockSource};
use synopsys_usb_otg::UsbPeripheral;
use usb_device::bus::UsbBusAllocator;

use ferrostep_stm32f4_board::board;
use ferrostep_stm32f4_board::clock::comes_true;
use ferrostep_stm32f4_board::pac::{GPIOA, OTG_FS_DEVICE, OTG_FS_GLOBAL, OTG_FS_PWRCLK, RCC};
use ferrostep_stm32f4_board::usb_guard::UsbGuard;

/// Words that the packets of OUT endpoints are copied to: 64 bytes each of the control and
/// the bulk endpoint.
pub const PACKET_WORDS: usize = 32;

/// The controller, as its driver's trait describes it.
pub struct Controller {
    core_hz: u32,
}

// SAFETY: the registers are those of OTG_FS, whose owner was given up in `start`. 320 words of FIFO
// and four endpoints each way are the resources of the smallest of the chips (RM0090 34.4; an
// STM32F446 has six endpoints).
unsafe impl UsbPeripheral for Controller {
    const REGISTERS: *const () = OTG_FS_GLOBAL::PTR.cast();
    const HIGH_SPEED: bool = false;
    const FIFO_DEPTH_WORDS: usize = 320;
    const ENDPOINT_COUNT: usize = 4;

    /// `start` has done it.
    fn enable() {}

    fn ahb_frequency_hz(&self) -> u32 {
        self.core_hz
    }
}

/// The controller with its driver.
pub type Bus = synopsys_usb_otg::UsbBus<Controller>;

/// The controller's registers, all of them.
pub type Registers = (OTG_FS_GLOBAL, OTG_FS_DEVICE, OTG_FS_PWRCLK);

/// Reason why there is no USB.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoUsb {
    /// The board has no plug for it.
    NoPlug,
    /// The PLL does not run, which makes its 48 MHz.
    NoClock,
    /// The controller does not answer.
    NoAnswer,
}

impl fmt::Display for NoUsb {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Self::NoPlug => "off, the board has none",
            Self::NoClock => "off, there are no 48 MHz without the PLL",
            Self::NoAnswer => "off, the controller does not answer",
        })
    }
}

/// Connects the pins and wakes the controller; its device side starts when a device is made on it.
/// To be called in `init`.
///
/// # Errors
/// The board has no plug, there is no clock for it, or it does not answer in bounded time.
pub fn start(
    registers: Registers,
    rcc: &RCC,
    clock: &Clock,
    packets: &'static mut [u32; PACKET_WORDS],
) -> Result<(UsbBusAllocator<Bus>, UsbGuard), NoUsb> {
    if !board::USB {
        return Err(NoUsb::NoPlug);
    }
    if clock.source == ClockSource::Internal {
        return Err(NoUsb::NoClock);
    }
    rcc.ahb1enr().modify(|_, w| w.gpioaen().set_bit());
    rcc.ahb2enr().modify(|_, w| w.otgfsen().set_bit());
    // Read back: `Registers::switch_clocks_on` says why.
    let _switched_on = (rcc.ahb1enr().read(), rcc.ahb2enr().read());
    let (global, device, _) = registers;
    let reset = global.grstctl();
    // No chip has an identification of zero.
    if global.cid().read().bits() == 0 || !comes_true(|| reset.read().ahbidl().bit_is_set()) {
        return Err(NoUsb::NoAnswer);
    }
    reset.modify(|_, w| w.csrst().set_bit());
    // The driver waits for the same, but without end.
    if !comes_true(|| reset.read().csrst().bit_is_clear()) || !comes_true(|| reset.read().ahbidl().bit_is_set()) {
        return Err(NoUsb::NoAnswer);
    }
    connect_pins();
    Ok((Bus::new(Controller { core_hz: clock.core.raw() }, packets), UsbGuard::new(&global, &device)))
}

/// PA11 and PA12 become the controller's.
fn connect_pins() {
    // SAFETY: called in `init`, where nothing else runs, and it changes nothing but the two pins.
    let port = unsafe { &*GPIOA::PTR };
    // SAFETY: one bit a pin, 0 = push-pull; whatever a boot loader has left.
    port.otyper().modify(|r, w| unsafe { w.bits(r.bits() & !(0b11 << 11)) });
    // SAFETY: two bits a pin, 00 = no pull.
    port.pupdr().modify(|r, w| unsafe { w.bits(r.bits() & !(0b1111 << 22)) });
    // SAFETY: four bits a pin from PA8 on, 10 = OTG_FS (datasheet, table 9).
    port.afrh().modify(|r, w| unsafe { w.bits(r.bits() & !(0xff << 12) | 0xaa << 12) });
    // SAFETY: two bits a pin, 11 = very high speed.
    port.ospeedr().modify(|r, w| unsafe { w.bits(r.bits() | 0b1111 << 22) });
    // SAFETY: two bits a pin, 10 = alternate function.
    port.moder().modify(|r, w| unsafe { w.bits(r.bits() & !(0b1111 << 22) | 0b1010 << 22) });
}

//! The USB OTG full-speed core in device mode: RM0090 chapter 34 (F405, F407) and RM0390
//! chapter 31 (F446).
//!
//! The firmware sees registers and FIFOs; a host drives the other side between two accesses,
//! through [`bus_side::Port`].
//!
//! A chip puts [`PERIPHERAL`] on its bus in place of rigless's four instances, connects its clock
//! to the tree's 48 MHz output (`clocked_by("OTG_FS_GLOBAL", Clock::output("RCC", rcc::PLL48))`),
//! and lets EXTI read request [`WAKEUP`]. A run drives the host with the registers and context that
//! `Bus::drive` lends for the slot: `host.advance(now_ns, &mut otg.port(registers, &mut context))`.
//!
//! | Register or section | Behaviour | Source | Test |
//! |---|---|---|---|
//! | Reset values, reserved bits | As the register descriptions give them; reserved bits stay zero | 34.16 | `registers_reset_as_the_manual_gives_them`, `reserved_bits_stay_zero` |
//! | `CID` | 0x1200 in the F405, 0x2000 in the F446; read-only here | 34.16.2 | `the_cores_have_their_own_numbers` |
//! | `GRSTCTL` `CSRST` | Clears interrupts, registers and FIFOs, keeps PCGCCTL, DSPD, SDIS and GCCFG; clears itself | 34.16.2 | `a_soft_reset_keeps_what_the_manual_lists` |
//! | `GRSTCTL` `AHBIDL`, `RXFFLSH`, `TXFFLSH`, `TXFNUM` | The core is always idle; a flush empties one FIFO or all and clears itself at once | 34.16.2 | `flushes_empty_the_fifos_they_name` |
//! | `GAHBCFG` `GINT`, `GINTMSK` | The interrupt line is a level: any masked flag with `GINT` | 34.16.2 | `the_line_is_the_masked_flags` |
//! | `GINTSTS` `USBRST`, `ENUMDNE` | 2.5 us into a reset, and after its end; `DSTS` then reads full speed; a shorter reset is ignored | 34.17.3, USB 2.0 7.1.7.5 | `a_bus_reset_is_seen_and_enumerates`, `a_short_reset_is_ignored` |
//! | USB reset | Deactivates all endpoints but 0; leaves `DAD`, which the driver clears | 34.16.4, 34.17.5 | `a_bus_reset_deactivates_the_endpoints` |
//! | `GINTSTS` `ESUSP`, `USBSUSP`, `WKUPINT`, `DSTS` `SUSPSTS` | Idle for 3 ms and resume; a resume pulses request [`WAKEUP`] too, for EXTI line 18 | 34.7.3, 34.16.2 | `suspend_and_resume_are_seen` |
//! | `GINTSTS` `SOF`, `DSTS` `FNSOF` | At each start of frame | 34.16.4 | `a_start_of_frame_sets_the_frame_number` |
//! | `GRXSTSR`, `GRXSTSP` | Peek and pop: SETUP 6, its end 4, OUT 2, its end 3, global OUT NAK 1; endpoint, bytes, DATA0/1, frame | 34.16.2 | `a_setup_comes_with_its_data_and_its_end`, `an_out_packet_is_read_and_ended` |
//! | SETUP | Accepted whatever the values of `NAKSTS` and `EPENA`; sets NAK on both sides, DATA1 next, clears STALL, counts `STUPCNT`; more than three set `B2BSTUP` | 34.17.6 | `a_setup_is_accepted_despite_nak`, `too_many_setups_set_b2bstup` |
//! | End of SETUP | Written at the next token of endpoint 0; popping it sets `STUP` and (F405) clears `EPENA` | 34.17.6 | `a_setup_comes_with_its_data_and_its_end` |
//! | OUT | `PKTCNT` at reception, `XFRSIZ` at the pop; NAK set at the last or a short packet; popping the end sets `XFRC` and (F405) clears `EPENA` | 34.17.6 | `an_out_packet_is_read_and_ended`, `a_transfer_of_several_packets_ends_at_its_count`, `a_short_packet_ends_a_transfer` |
//! | `EPENA` of the F446 | Cleared as the end is written, not as it is popped: drivers re-enable before they pop | `synopsys-usb-otg` 0.5 | `the_f446_may_be_enabled_before_the_end_is_popped` |
//! | IN | Needs `EPENA`, no NAK, the packet in the FIFO; `PKTCNT` at the acknowledgement, `XFRSIZ` as the FIFO is filled; `XFRC` and `EPENA` cleared at the end; zero-length packets | 34.17.6 | `an_in_packet_is_sent_once`, `an_in_transfer_of_several_packets`, `a_packet_of_no_bytes` |
//! | Data toggles | DATA0/1 in turn; a repeated OUT is acknowledged and dropped; an unacknowledged IN is sent again; `SD0PID`, `SD1PID`, `DPID` | USB 2.0 8.6 | `a_repeated_packet_is_acknowledged_and_dropped`, `an_unacknowledged_packet_is_sent_again`, `toggles_can_be_set` |
//! | `SNAK`, `CNAK`, `NAKSTS`, `INEPNE` | NAK of one endpoint | 34.16.4 | `nak_of_an_endpoint` |
//! | `STALL` | Before NAK; cleared by a SETUP on endpoint 0 and by the driver elsewhere | 34.16.4 | `a_stall_is_answered_before_nak`, `a_setup_clears_the_stall_of_endpoint_0` |
//! | `EPDIS`, `EPDISD` | Ends an enabled endpoint | 34.16.4 | `an_endpoint_is_disabled` |
//! | `TXFE`, `DIEPEMPMSK`, `TXFELVL`, `DTXFSTS` | Half or fully empty, with its own mask | 34.16.4 | `an_empty_fifo_interrupts_through_its_own_mask` |
//! | `ITTXFE`, `OTEPDIS`, `TOC` | IN token with an empty FIFO, OUT token at a disabled endpoint 0, missing acknowledgement | 34.16.4 | `tokens_without_a_transfer_are_flagged`, `an_unacknowledged_packet_is_sent_again` |
//! | `DAINT`, `DAINTMSK`, `DIEPMSK`, `DOEPMSK` | The endpoints and flags that raise an interrupt | 34.16.4 | `the_masks_of_the_endpoints` |
//! | Global NAKs | `SGINAK`, `CGINAK` at once; `SGONAK` through the FIFO, effective on the bus at once | 34.17.6 | `the_global_naks` |
//! | FIFO sizes | An OUT packet without room is NAKed, a SETUP without room unanswered, an excess word lost; the run reports each | 34.11, 34.17.6 | `a_receive_fifo_too_small_naks`, `a_transmit_fifo_too_small_loses`, `overlapping_fifos_are_reported` |
//! | FIFO windows | Every word of the 4 KiB windows reaches the FIFO | 34.16.1 | `any_word_of_a_window_reaches_the_fifo` |
//! | Connection | Pull-up with `PWRDWN`, no `SDIS`, 48 MHz within 0.25 %, device mode, and a valid session | 34.17.3, 34.16.2, USB 2.0 7.1.11 | `the_pull_up_needs_every_condition` |
//! | Session | F405: `NOVBUSSENS`, or `VBUSBSEN` with VBUS. F446: `VBDEN` with VBUS, or `BVALOEN` with `BVALOVAL`. `BSVLD`, `SRQINT`, `SEDET` | 34.16.2, RM0390 31.15.2 | `a_session_follows_the_cable`, `the_f446_detects_vbus_in_its_own_way` |
//! | Address | `DAD`; a token to another address is not answered. An address written during SET_ADDRESS takes effect after the status stage, which uses the old one: the manual demands the write before it | 34.16.4, 34.17.5, `synopsys-usb-otg` 0.5 | `a_token_to_another_address_is_not_answered`, `an_address_takes_effect_after_its_status_stage` |
//! | `PCGCCTL` | A stopped or gated clock answers nothing and keeps the pull-up | 34.16.5 | `a_gated_clock_answers_nothing` |
//! | Four endpoints | The F405 answers zero where the F446 has endpoints 4 and 5, and the run reports it | 34.2 | `the_f405_has_four_endpoints` |
//!
//! **What the model leaves out, and why.**
//!
//! | Behaviour | Source | Reason |
//! |---|---|---|
//! | Host mode, HNP, SRP | 34.16.3 | No board here is a host. The host registers are stored; writing one sets `MMIS` |
//! | Isochronous endpoints, `EOPF`, `ISOODRP`, `IISOIXFR`, `IPXFR` | 34.17.6 | Serial ports do not use them |
//! | Remote wakeup (`RWUSIG`), test modes (`TCTL`), battery charging | 34.16.4 | Stored |
//! | Low speed, and speeds other than `DSPD` 3 | 34.16.4 | The core's transceiver has full speed only; another value is reported |
//! | Duration of flushes, soft reset and the change of mode | 34.16.2 | They happen at once; the model does not detect a driver that does not wait |
//! | Control endpoints other than 0 | 34.17.6 | SETUP to them is not answered |
//! | Accesses narrower than a word to a FIFO, the window at 0x2_0000 into the packet memory | 34.16.1 | The manual forbids the first; the second is for debuggers |
//! | The effect of overlapping FIFOs on the data | 34.11 | Reported; each FIFO keeps its own data |
//! | `PKTCNT` of 0 on an enabled OUT endpoint | 34.17.6 | The manual demands at least one; drivers rely on 0, so that each packet is a transfer. Reported once |
//! | CRC errors, bit errors | 34.16.4 | The host loses handshakes instead |

use rigless::device::{Device, DeviceContext, RegisterFile};
use rigless::soc::{FieldSpec, Layout};
use rigless::time::{EventId, VirtualNanos};

pub mod bus_side;
mod complaint;
mod endpoints;
#[allow(missing_docs)] // Modules of constants by the manual's names.
pub mod fields;
pub mod fifo;
mod levels;
pub mod registers;

pub use registers::{ENDPOINTS, PERIPHERAL, REGISTERS, Register};

use complaint::Complaint;
use fields as f;
use fifo::{Receive, Transmit};

/// Position of the core's interrupt (67) in [`PERIPHERAL`]'s list; position 0 is the wakeup,
/// which EXTI raises.
pub const OTG_FS: usize = 1;
/// The request that a resume pulses: EXTI line 18, OTG_FS wakeup.
pub const WAKEUP: usize = 0;

/// The core of a chip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Core {
    /// STM32F405 and F407: RM0090, four endpoints of each direction.
    F405,
    /// STM32F446: RM0390, six endpoints of each direction.
    F446,
}

impl Core {
    /// Endpoints of each direction, endpoint 0 included.
    #[must_use]
    pub fn endpoints(self) -> usize {
        match self {
            Self::F405 => 4,
            Self::F446 => 6,
        }
    }

    fn id(self) -> u64 {
        match self {
            Self::F405 => 0x0000_1200,
            Self::F446 => 0x0000_2000,
        }
    }
}

/// The state of an IN endpoint beyond its registers.
#[derive(Debug, Clone, Copy, Default, serde::Serialize, serde::Deserialize)]
struct In {
    /// The next packet is DATA1.
    toggle: bool,
    /// Bytes of the transfer that the host has not acknowledged yet.
    to_send: u32,
    /// Bytes in the FIFO of a packet that is still incomplete.
    loaded: u32,
}

/// The state of an OUT endpoint beyond its registers.
#[derive(Debug, Clone, Copy, Default, serde::Serialize, serde::Deserialize)]
struct Out {
    /// The next packet is DATA1.
    toggle: bool,
    /// A SETUP stage whose end is not written yet.
    setup_open: bool,
}

/// The core of one chip.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Otg {
    core: Core,
    clock_hz: u64,
    built_clock_hz: u64,
    vbus: bool,
    /// The host drives the reset state.
    in_reset: bool,
    /// A reset has ended and the speed is known, so the core answers tokens.
    ready: bool,
    /// The effective address: DAD after the control transfer that brought it.
    address: u8,
    /// A control transfer whose status stage is still to come.
    control_open: bool,
    /// The session was valid at the last check.
    session: bool,
    reset_seen: Option<EventId>,
    enumerated: Option<EventId>,
    receive: Receive,
    transmit: [Transmit; ENDPOINTS],
    input: [In; ENDPOINTS],
    output: [Out; ENDPOINTS],
    global_in_nak: bool,
    global_out_nak: bool,
    /// The global OUT NAK has been popped.
    global_out_nak_effective: bool,
    line: bool,
    reported: u32,
}

rigless::store!(Otg);

impl Otg {
    /// The core of a chip without a cable; its 48 MHz clock is stopped until the
    /// clock tree drives it.
    #[must_use]
    pub fn new(core: Core) -> Self {
        Self {
            core,
            clock_hz: 0,
            built_clock_hz: 0,
            vbus: false,
            in_reset: false,
            ready: false,
            address: 0,
            control_open: false,
            session: false,
            reset_seen: None,
            enumerated: None,
            receive: Receive::default(),
            transmit: Default::default(),
            input: Default::default(),
            output: Default::default(),
            global_in_nak: false,
            global_out_nak: false,
            global_out_nak_effective: false,
            line: false,
            reported: 0,
        }
    }

    /// Gives the core its own clock, for a bus without a clock tree. `clock_hz` should be 48 MHz.
    #[must_use]
    pub fn with_clock(self, clock_hz: u64) -> Self {
        Self { clock_hz, built_clock_hz: clock_hz, ..self }
    }

    /// Reports an error of the driver, once until a reset.
    fn complain(&mut self, complaint: Complaint, context: &mut DeviceContext<'_>) {
        let bit = 1 << complaint as u32;
        if self.reported & bit == 0 {
            self.reported |= bit;
            let (register, reason) = complaint.text();
            context.tell(register, reason);
        }
    }

    /// True if this register belongs to an endpoint that the core lacks.
    fn absent(&self, register: Register) -> bool {
        let number = match register {
            Register::Dieptxf(number)
            | Register::Diepctl(number)
            | Register::Diepint(number)
            | Register::Dieptsiz(number)
            | Register::Dtxfsts(number)
            | Register::Doepctl(number)
            | Register::Doepint(number)
            | Register::Doeptsiz(number)
            | Register::Fifo(number) => number,
            _ => return false,
        };
        usize::from(number) >= self.core.endpoints()
    }

    fn write_grstctl(&mut self, registers: &mut RegisterFile) {
        let value = registers.get(Register::Grstctl);
        if f::grstctl::CSRST.is_set(value) {
            self.soft_reset(registers);
            return;
        }
        if f::grstctl::RXFFLSH.is_set(value) {
            self.receive.flush();
        }
        if f::grstctl::TXFFLSH.is_set(value) {
            let number = f::grstctl::TXFNUM.get(value) as usize;
            for (fifo, transmit) in self.transmit.iter_mut().enumerate() {
                if number == 0x10 || number == fifo {
                    transmit.flush();
                }
            }
            for endpoint in self.numbers() {
                let fifo = usize::from(self.fifo_of(endpoint, registers));
                if number == 0x10 || number == fifo {
                    self.input[usize::from(endpoint)].loaded = 0;
                }
            }
        }
        // Only the number stays; the core is idle again before the next access.
        let kept = f::grstctl::TXFNUM.mask() | f::grstctl::AHBIDL.mask();
        registers.set(Register::Grstctl, value & kept);
    }

    /// CSRST: resets everything except the registers that 34.16.2 lists.
    fn soft_reset(&mut self, registers: &mut RegisterFile) {
        let kept = [
            (Register::Pcgcctl, f::pcgcctl::STPPCLK.mask() | f::pcgcctl::GATEHCLK.mask()),
            (Register::Host(0), 0b11), // HCFG.FSLSPCS
            (Register::Dcfg, f::dcfg::DSPD.mask()),
            (Register::Dctl, f::dctl::SDIS.mask()),
            (Register::Gccfg, u64::MAX),
        ]
        .map(|(register, mask)| (register, mask, registers.get(register)));
        registers.reset();
        for (register, mask, value) in kept {
            registers.restore(register, mask, value);
        }
        self.clear();
    }

    /// Clears what both resets clear: FIFOs, transfers, NAKs. The cable and the clock stay.
    fn clear(&mut self) {
        *self = Self {
            vbus: self.vbus,
            in_reset: self.in_reset,
            session: self.session,
            line: self.line,
            built_clock_hz: self.built_clock_hz,
            clock_hz: self.clock_hz,
            ..Self::new(self.core)
        };
    }

    fn write_dctl(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let value = registers.get(Register::Dctl);
        if f::dctl::CGINAK.is_set(value) {
            self.global_in_nak = false;
        }
        if f::dctl::SGINAK.is_set(value) {
            self.global_in_nak = true;
        }
        if f::dctl::CGONAK.is_set(value) {
            self.global_out_nak = false;
            self.global_out_nak_effective = false;
        }
        if f::dctl::SGONAK.is_set(value) && !self.global_out_nak {
            self.global_out_nak = true;
            self.receive.push(self.entry(fifo::Status::GlobalOutNak, 0, false, Vec::new(), registers));
        }
        let actions = f::dctl::SGINAK.mask() | f::dctl::CGINAK.mask() | f::dctl::SGONAK.mask() | f::dctl::CGONAK.mask();
        registers.set(Register::Dctl, value & !actions);
        if !f::dctl::SDIS.is_set(value) && f::dcfg::DSPD.get(registers.get(Register::Dcfg)) != 3 {
            self.complain(Complaint::Speed, context);
        }
    }
}

impl Device for Otg {
    type Register = Register;

    fn read(
        &mut self,
        register: Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        if self.absent(register) {
            self.complain(Complaint::AbsentEndpoint, context);
            return Some(0);
        }
        match register {
            Register::Grxstsp => {
                let value = self.front();
                self.pop(registers, context);
                self.settle(registers, context);
                Some(value)
            }
            Register::Fifo(_) => {
                let word = self.receive.read();
                if word.is_none() {
                    self.complain(Complaint::EmptyRead, context);
                }
                Some(word.unwrap_or(0).into())
            }
            _ => self.peek(register, registers, context.now()),
        }
    }

    fn peek(&self, register: Register, registers: &RegisterFile, _now: VirtualNanos) -> Option<u64> {
        if self.absent(register) {
            return Some(0);
        }
        Some(match register {
            Register::Cid => self.core.id(),
            Register::Gotgctl => f::gotgctl::BSVLD.set(registers.get(register), self.session_valid(registers).into()),
            Register::Gintsts => self.flags(registers),
            Register::Grxstsr | Register::Grxstsp => self.front(),
            Register::Dctl => {
                let value = f::dctl::GINSTS.set(registers.get(register), self.global_in_nak.into());
                f::dctl::GONSTS.set(value, self.global_out_nak.into())
            }
            Register::Daint => self.endpoints_flagged(registers),
            Register::Diepint(endpoint) => self.in_flags(endpoint, registers),
            Register::Dtxfsts(endpoint) => self.free_words(endpoint, registers).into(),
            Register::Doepctl(0) => f::doepctl0::MPSIZ
                .set(registers.get(register), f::diepctl0::MPSIZ.get(registers.get(Register::Diepctl(0)))),
            Register::Fifo(_) => self.receive.peek().unwrap_or(0).into(),
            _ => return None,
        })
    }

    fn write(&mut self, register: Register, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if self.absent(register) {
            registers.set(register, register.spec().reset);
            self.complain(Complaint::AbsentEndpoint, context);
            return;
        }
        let fields = register.spec().fields;
        if !fields.is_empty() {
            let known = fields.iter().fold(0, |mask, field| mask | field.mask());
            let reset = register.spec().reset;
            registers.set(register, (registers.get(register) & known) | (reset & !known));
        }
        match register {
            Register::Grstctl => self.write_grstctl(registers),
            Register::Gusbcfg if f::gusbcfg::FHMOD.is_set(registers.get(register)) => {
                self.complain(Complaint::HostMode, context);
            }
            Register::Dctl => self.write_dctl(registers, context),
            Register::Dcfg => {
                let address = f::dcfg::DAD.get(registers.get(register)) as u8;
                if address == 0 || !self.control_open {
                    self.address = address;
                }
            }
            Register::Diepctl(endpoint) => self.write_in_control(endpoint, registers, context),
            Register::Doepctl(endpoint) => self.write_out_control(endpoint, registers, context),
            Register::Dieptsiz(endpoint) => self.write_in_size(endpoint, registers),
            Register::Fifo(endpoint) => self.write_fifo(endpoint, value as u32, registers, context),
            Register::Host(_) => raise(Register::Gintsts, f::gintsts::MMIS, registers),
            _ => {}
        }
        self.settle(registers, context);
    }

    fn on_event(&mut self, event: EventId, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if Some(event) == self.reset_seen {
            self.reset_seen = None;
            self.on_bus_reset(registers);
        }
        if Some(event) == self.enumerated {
            self.enumerated = None;
            self.on_enumerated(registers);
        }
        self.settle(registers, context);
    }

    fn on_clock(&mut self, hz: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.clock_hz = hz;
        self.settle(registers, context);
    }

    fn reset(&mut self) {
        self.clock_hz = self.built_clock_hz;
        self.clear();
        // After a reset no session is valid and no interrupt is raised.
        self.session = false;
        self.line = false;
    }

    fn reset_line(&mut self, _registers: &mut RegisterFile, _context: &mut DeviceContext<'_>) {
        // The clock tree continues and will not drive the clock again.
        let clock_hz = self.clock_hz;
        self.reset();
        self.clock_hz = clock_hz;
    }
}

/// Sets a flag in a register.
fn raise(register: Register, field: FieldSpec, registers: &mut RegisterFile) {
    registers.set(register, field.set(registers.get(register), 1));
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod bench;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod end_to_end;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;

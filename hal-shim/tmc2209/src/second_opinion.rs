//! Datagrams and registers beside those of the crate `tmc2209`, which others wrote from the same
//! data sheet.

use std::string::ToString;

use proptest::prelude::*;
use tmc2209::data::MicroStepResolution;
use tmc2209::reg::{Address, CHOPCONF, DRV_STATUS, GCONF, GSTAT, IHOLD_IRUN};
use tmc2209::{ReadRequest, Reader, WriteRequest};

use crate::{
    ChopConf, DriverStatus, GlobalConf, GlobalStatus, HoldRun, MicrostepResolution, Register, parse_reply,
    read_request, write_request,
};

fn address(register: Register) -> Address {
    Address::try_from(register.address()).unwrap()
}

#[test]
fn registers_have_the_same_addresses_and_rights() {
    for register in Register::ALL {
        let address = address(register);
        // The data sheet has renamed this one.
        if register != Register::NodeConf {
            assert_eq!(format!("{address:?}"), register.to_string());
        }
        assert_eq!(address.readable(), register.is_readable(), "{register}");
        assert_eq!(address.writable(), register.is_writable(), "{register}");
    }
}

/// The reader looks for a reply in all bytes of the line, on which the sent ones come back.
#[test]
fn their_reader_takes_an_echo_for_a_reply() {
    let echo = write_request(0, Register::Tcoolthrs, 0x0005_ff00);
    let mut reply = write_request(0xff, Register::Ifcnt, 7);
    reply[2] = Register::Ifcnt.address();
    reply[7] = tmc2209::crc(&reply[..7]);
    let (_, theirs) = Reader::default().read_response(&[echo, reply].concat());
    assert!(theirs.is_some_and(|reply| !reply.crc_is_valid()));
    assert_eq!(parse_reply(&reply, Register::Ifcnt), Ok(7));
}

proptest! {
    #[test]
    fn requests_are_the_same(chip in 0_u8..4, index in 0..Register::ALL.len(), value: u32) {
        let register = Register::ALL[index];
        let [write, read] = [
            WriteRequest::from_raw_data(chip, address(register), value).bytes().to_vec(),
            ReadRequest::from_addr(chip, address(register)).bytes().to_vec(),
        ];
        prop_assert_eq!(write, write_request(chip, register, value));
        prop_assert_eq!(read, read_request(chip, register));
    }

    #[test]
    fn replies_are_the_same(index in 0..Register::ALL.len(), value: u32, wrong_bit in 0_usize..128) {
        let register = Register::ALL[index];
        let mut reply = write_request(0xff, register, value);
        reply[2] = register.address();
        reply[7] = tmc2209::crc(&reply[..7]);
        if let Some(byte) = reply.get_mut(wrong_bit / 8) {
            *byte ^= 1 << (wrong_bit % 8);
        }
        let (_, theirs) = Reader::default().read_response(&reply);
        let theirs = theirs.filter(|reply| reply.crc_is_valid() && reply.reg_addr().ok() == Some(address(register)));
        prop_assert_eq!(parse_reply(&reply, register).ok(), theirs.map(|reply| reply.data_u32()));
    }

    #[test]
    fn settings_are_the_same(
        [spread_cycle, pin_is_serial, microsteps_by_register, filter_steps]: [bool; 4],
        [hold, run, hold_delay] in [0_u8..32, 0_u8..32, 0_u8..16],
        (off_time, hysteresis_start, hysteresis_end, blank_time) in (0_u8..16, 0_u8..8, 0_u8..16, 0_u8..4),
        [high_sensitivity, interpolate, both_edges]: [bool; 3],
        exponent in 0_u8..9,
    ) {
        let ours = GlobalConf { spread_cycle, pin_is_serial, microsteps_by_register, filter_steps };
        let mut theirs = GCONF::from(0);
        theirs.set_en_spread_cycle(spread_cycle);
        theirs.set_pdn_disable(pin_is_serial);
        theirs.set_mstep_reg_select(microsteps_by_register);
        theirs.set_multistep_filt(filter_steps);
        prop_assert_eq!(ours.bits(), u32::from(theirs));

        let mut theirs = IHOLD_IRUN::from(0);
        theirs.set_ihold(hold);
        theirs.set_irun(run);
        theirs.set_ihold_delay(hold_delay);
        prop_assert_eq!(HoldRun { hold, run, hold_delay }.bits(), u32::from(theirs));

        let resolution = MicrostepResolution::from_microsteps(1 << exponent).unwrap();
        let ours = ChopConf {
            off_time,
            hysteresis_start,
            hysteresis_end,
            blank_time,
            high_sensitivity,
            resolution,
            interpolate,
            both_edges,
        };
        let mut theirs = CHOPCONF::from(0);
        theirs.set_toff(off_time.into());
        theirs.set_hstrt(hysteresis_start.into());
        theirs.set_hend(hysteresis_end.into());
        theirs.set_tbl(blank_time.into());
        theirs.set_vsense(high_sensitivity);
        theirs.set_mres(MicroStepResolution::new(exponent));
        theirs.set_intpol(interpolate);
        theirs.set_dedge(both_edges);
        prop_assert_eq!(ours.bits(), u32::from(theirs));
    }

    #[test]
    fn states_are_the_same(bits: u32) {
        let (ours, theirs) = (GlobalStatus::from_bits(bits), GSTAT::from(bits));
        let flags = (theirs.reset(), theirs.drv_err(), theirs.uv_cp());
        prop_assert_eq!((ours.reset, ours.driver_error, ours.charge_pump_low), flags);

        let (ours, theirs) = (DriverStatus::from_bits(bits), DRV_STATUS::from(bits));
        prop_assert_eq!(u32::from(ours.current_scale()), theirs.cs_actual());
        prop_assert_eq!((ours.is_stealth_chop(), ours.is_standing()), (theirs.stealth(), theirs.stst()));
        let off = [theirs.ot(), theirs.s2ga(), theirs.s2gb(), theirs.s2vsa(), theirs.s2vsb()];
        prop_assert_eq!(ours.fatal() != 0, off.contains(&true));
        prop_assert_eq!(bits & DriverStatus::WARNINGS != 0, theirs.otpw() || theirs.ola() || theirs.olb());
    }
}

#![allow(clippy::unwrap_used)]

use super::datagram::{Reply, checksum};
use super::*;
use proptest::prelude::*;

const BIT_NS: u64 = 8_681;

fn driver() -> Tmc2209 {
    let mut driver = Tmc2209::new(Config::default());
    driver.set_supply(0, true);
    driver.set_enable_pin(0, false);
    driver
}

/// Sends bytes back to back; returns the reply to the last one and the end of it.
fn send(driver: &mut Tmc2209, start_ns: u64, bytes: &[u8]) -> (Option<Reply>, u64) {
    let mut reply = None;
    for (index, &byte) in bytes.iter().enumerate() {
        reply = driver.receive_byte(start_ns + index as u64 * 10 * BIT_NS, BIT_NS, byte);
    }
    (reply, start_ns + bytes.len() as u64 * 10 * BIT_NS)
}

fn read_request(node: u8, register: u8) -> [u8; 4] {
    let mut bytes = [0x05, node, register, 0];
    bytes[3] = checksum(&bytes[..3]);
    bytes
}

fn write_request(node: u8, register: u8, value: u32) -> [u8; 8] {
    let [a, b, c, d] = value.to_be_bytes();
    let mut bytes = [0x05, node, register | 0x80, a, b, c, d, 0];
    bytes[7] = checksum(&bytes[..7]);
    bytes
}

fn write(driver: &mut Tmc2209, register: u8, value: u32) {
    // Directly into the register, for tests of other parts than the line.
    driver.write(0, register, value);
}

#[test]
fn checksum_is_the_data_sheets() {
    // A read of IOIN recorded between a computer and a TMC2209 (public wiki of
    // TMC2209_Raspberry_Pi).
    assert_eq!(checksum(&[0x55, 0x00, 0x06]), 0xE8);
    assert_eq!(checksum(&[0x05, 0xFF, 0x06, 0x21, 0x00, 0x02, 0x41]), 0x9D);
}

#[test]
fn reads_and_writes() {
    let mut driver = driver();
    let (none, end_ns) = send(&mut driver, 0, &write_request(0, address::GCONF, 0xFFFF_FFC0));
    assert_eq!(none, None);
    let (reply, end_ns) = send(&mut driver, end_ns, &read_request(0, address::GCONF));
    let reply = reply.unwrap();
    assert_eq!(reply.bytes[..7], [0x05, 0xFF, 0x00, 0x00, 0x00, 0x03, 0xC0]);
    assert_eq!(checksum(&reply.bytes[..7]), reply.bytes[7]);
    assert_eq!((reply.start_ns, reply.bit_ns), (end_ns + 8 * BIT_NS, BIT_NS));
    assert_eq!(driver.read(0, address::IFCNT), 1);
}

#[test]
fn refuses_a_wrong_checksum_and_an_address_of_another() {
    let mut driver = driver();
    let mut wrong = write_request(0, address::SGTHRS, 9);
    wrong[7] ^= 1;
    let (_, end_ns) = send(&mut driver, 0, &wrong);
    assert_eq!((driver.registers().sgthrs, driver.registers().ifcnt), (0, 0));
    let later_ns = end_ns + 12 * BIT_NS;
    let (_, end_ns) = send(&mut driver, later_ns, &write_request(1, address::SGTHRS, 9));
    let (reply, end_ns) = send(&mut driver, end_ns, &read_request(2, address::IOIN));
    assert_eq!((reply, driver.registers().ifcnt), (None, 0));
    // Another driver's address is not an error and needs no silence.
    send(&mut driver, end_ns, &write_request(0, address::SGTHRS, 9));
    assert_eq!((driver.registers().sgthrs, driver.registers().ifcnt), (9, 1));
}

#[test]
fn recovers_after_12_bit_times_of_silence_and_no_sooner() {
    let mut driver = driver();
    let (_, end_ns) = send(&mut driver, 0, &[0x0A]);
    let (_, end_ns) = send(&mut driver, end_ns + 11 * BIT_NS, &write_request(0, address::SGTHRS, 1));
    assert_eq!(driver.registers().ifcnt, 0);
    send(&mut driver, end_ns + 12 * BIT_NS, &write_request(0, address::SGTHRS, 1));
    assert_eq!(driver.registers().ifcnt, 1);
}

#[test]
fn recovery_counts_silence_only() {
    let mut driver = driver();
    let (_, end_ns) = send(&mut driver, 0, &[0x0A]);
    let (_, end_ns) = send(&mut driver, end_ns + 11 * BIT_NS, &[0xFF]);
    send(&mut driver, end_ns, &write_request(0, address::SGTHRS, 1));
    assert_eq!(driver.registers().ifcnt, 0);
}

#[test]
fn refuses_bytes_of_another_baud_rate_in_a_datagram() {
    for (per_cent, accepted) in [(104, 1), (106, 0), (94, 0)] {
        let mut driver = driver();
        for (index, byte) in write_request(0, address::SGTHRS, 1).into_iter().enumerate() {
            let bit_ns = if index == 5 { 10_000 * per_cent / 100 } else { 10_000 };
            driver.receive_byte(index as u64 * 110_000, bit_ns, byte);
        }
        assert_eq!(driver.registers().ifcnt, accepted, "{per_cent}");
    }
}

#[test]
fn a_load_shows_at_the_next_full_step() {
    let mut driver = driver();
    let last_ns = run(&mut driver, 0, 8, 160_000);
    assert_eq!((driver.mscnt(), driver.read(last_ns, address::SG_RESULT)), (256, 300));
    driver.set_load(0.5);
    let last_ns = run(&mut driver, last_ns + 160_000, 7, 160_000);
    assert_eq!(driver.read(last_ns, address::SG_RESULT), 300);
    let last_ns = run(&mut driver, last_ns + 160_000, 1, 160_000);
    assert_eq!(driver.read(last_ns, address::SG_RESULT), 150);
}

#[test]
fn a_datagram_ends_after_63_bit_times_without_a_start_bit() {
    for (gap_bits, accepted) in [(63, 1), (64, 0)] {
        let mut driver = driver();
        let request = write_request(0, address::SGTHRS, 1);
        send(&mut driver, 0, &request[..3]);
        send(&mut driver, (20 + gap_bits) * BIT_NS, &request[3..]);
        assert_eq!(driver.registers().ifcnt, accepted, "{gap_bits}");
    }
}

#[test]
fn reply_waits_for_its_send_delay() {
    for (setting, bits) in [(0, 8), (1, 8), (2, 24), (3, 24), (7, 56), (15, 120)] {
        let mut driver = driver();
        write(&mut driver, address::NODECONF, setting << 8);
        let (reply, end_ns) = send(&mut driver, 0, &read_request(0, address::IOIN));
        assert_eq!(reply.unwrap().start_ns, end_ns + bits * BIT_NS, "{setting}");
    }
}

#[test]
fn a_short_send_delay_misreads_replies_of_neighbours() {
    for (setting, accepted) in [(0, 0), (2, 1)] {
        let mut one = driver();
        write(&mut one, address::NODECONF, setting << 8);
        let before = one.registers().ifcnt;
        let reply = Reply::new(1_000_000, BIT_NS, address::IOIN, 0);
        one.overhear(&reply);
        send(&mut one, reply.end_ns() + 4 * BIT_NS, &write_request(0, address::SGTHRS, 1));
        assert_eq!(one.registers().ifcnt - before, accepted, "{setting}");
    }
}

#[test]
fn registers_have_their_reset_values_and_access() {
    let mut driver = driver();
    for (register, value) in [
        (address::GCONF, 0x101),
        (address::GSTAT, gstat::RESET),
        (address::IFCNT, 0),
        (address::OTP_READ, 0x0F),
        (address::FACTORY_CONF, 0x0F),
        (address::TSTEP, TSTEP_MAX),
        (address::CHOPCONF, 0x1000_0053),
        (address::PWMCONF, 0xC10D_0024),
        (address::PWM_AUTO, 0x0000_0024),
        (address::IHOLD_IRUN, 0),
        (0x33, 0),
    ] {
        if register == address::TSTEP {
            assert_eq!(driver.read(1 << 30, register), value);
        } else {
            assert_eq!(driver.read(0, register), value, "{register:#x}");
        }
    }
    assert_eq!((driver.registers.irun(), driver.registers.ihold(), driver.registers.ihold_delay()), (31, 16, 1));
    write(&mut driver, address::GSTAT, gstat::DRV_ERR);
    assert_eq!(driver.read(0, address::GSTAT), gstat::RESET);
    write(&mut driver, address::GSTAT, gstat::RESET);
    assert_eq!(driver.read(0, address::GSTAT), 0);
    write(&mut driver, address::IFCNT, 77);
    assert_eq!(driver.read(0, address::IFCNT), 3);
}

#[test]
fn ioin_shows_the_pins() {
    let mut driver = driver();
    assert_eq!(driver.read(0, address::IOIN), 0x2100_0040);
    driver.set_enable_pin(0, true);
    driver.set_step_pin(0, true);
    driver.set_direction_pin(0, true);
    assert_eq!(driver.read(0, address::IOIN), 0x2100_0040 | 1 | 1 << 7 | 1 << 9);
}

#[test]
fn microsteps_by_pins_and_by_register() {
    for (ms2, ms1, size) in [(false, false, 32), (false, true, 8), (true, false, 4), (true, true, 16)] {
        let mut driver = Tmc2209::new(Config { ms1, ms2, ..Config::default() });
        driver.set_supply(0, true);
        assert_eq!(driver.set_step_pin(0, true).unwrap().delta, size);
    }
    let mut driver = driver();
    write(&mut driver, address::GCONF, 1 << 7);
    for mres in 0..=8 {
        write(&mut driver, address::CHOPCONF, 3 | mres << 24);
        assert_eq!(driver.set_step_pin(0, true).unwrap().delta, 1 << mres);
        assert_eq!(driver.set_step_pin(0, false), None);
    }
}

#[test]
fn steps_follow_dir_and_shaft_and_both_edges() {
    let mut driver = driver();
    assert_eq!(driver.set_step_pin(100, true), Some(Microsteps { delta: 32, energized: true }));
    assert_eq!(driver.set_step_pin(200, false), None);
    driver.set_direction_pin(300, true);
    assert_eq!(driver.set_step_pin(400, true).unwrap().delta, -32);
    write(&mut driver, address::GCONF, 1 << 3);
    assert_eq!((driver.set_step_pin(500, false), driver.set_step_pin(600, true).unwrap().delta), (None, 32));
    write(&mut driver, address::CHOPCONF, 3 | 1 << 29);
    assert_eq!(driver.set_step_pin(700, false).unwrap().delta, 32);
    driver.set_enable_pin(800, true);
    assert_eq!(driver.set_step_pin(900, true), Some(Microsteps { delta: 32, energized: false }));
}

#[test]
fn a_turn_of_the_field_is_1024_and_backwards_wraps() {
    let mut driver = driver();
    driver.set_direction_pin(0, true);
    driver.set_step_pin(0, true);
    assert_eq!(driver.mscnt(), 1024 - 32);
    assert_eq!(driver.read(0, address::MSCURACT) >> 16 & 0x1FF, 243);
    assert_eq!(driver.read(0, address::MSCURACT) & 0x1FF, 512 - 48);
}

#[test]
fn records_the_shortest_times() {
    let mut driver = driver();
    for (at_ns, level) in [(1_000, true), (1_150, false), (1_400, true), (1_520, false), (1_650, true)] {
        driver.set_step_pin(at_ns, level);
    }
    driver.set_direction_pin(1_680, true);
    driver.set_step_pin(1_750, false);
    driver.set_step_pin(1_860, true);
    let timing = driver.timing();
    assert_eq!((timing.high_ns, timing.low_ns), (100, 110));
    assert_eq!((timing.direction_setup_ns, timing.direction_hold_ns), (180, 30));
    assert_eq!((timing.steps, timing.violations), (4, 0));
    driver.set_direction_pin(1_870, false);
    driver.set_step_pin(1_900, false);
    assert_eq!(driver.timing().violations, 2);
}

fn run(driver: &mut Tmc2209, from_ns: u64, steps: u64, interval_ns: u64) -> u64 {
    for step in 0..steps {
        driver.set_step_pin(from_ns + step * interval_ns, true);
        driver.set_step_pin(from_ns + step * interval_ns + interval_ns / 2, false);
    }
    from_ns + (steps - 1) * interval_ns
}

#[test]
fn tstep_is_of_a_256th_and_ends_at_standstill() {
    let mut driver = driver();
    let last_ns = run(&mut driver, 0, 10, 160_000);
    // 160 us are 1920 clocks for 32/256.
    assert_eq!(driver.read(last_ns, address::TSTEP), 60);
    assert_eq!(driver.read(last_ns, address::DRV_STATUS) & drv_status::STST, 0);
    let still_ns = last_ns + (1 << 20) * 1000 / 12;
    assert_eq!(driver.read(still_ns + 1, address::TSTEP), TSTEP_MAX);
    assert_eq!(driver.read(still_ns + 1, address::DRV_STATUS) & drv_status::STST, drv_status::STST);
}

#[test]
fn current_of_run_and_hold() {
    let mut driver = driver();
    write(&mut driver, address::GCONF, 1 << 6);
    write(&mut driver, address::IHOLD_IRUN, 8 | 16 << 8 | 2 << 16);
    write(&mut driver, address::TPOWERDOWN, 10);
    let last_ns = run(&mut driver, 0, 2, 100_000);
    // 17/32 of 325 mV at 0.13 ohm, RMS.
    assert_eq!(driver.current_ma(last_ns), 939);
    write(&mut driver, address::CHOPCONF, 3 | 1 << 17);
    assert_eq!(driver.current_ma(last_ns), 520);
    let clocks_ns = |clocks: u64| clocks * 1000 / 12 + 100;
    let powered_down_ns = last_ns + clocks_ns((1 << 20) + (10 << 18));
    assert_eq!(driver.current_scale(powered_down_ns - 1000), 16);
    assert_eq!(driver.current_scale(powered_down_ns + clocks_ns(2 << 18)), 15);
    assert_eq!(driver.current_scale(powered_down_ns + clocks_ns(7 * (2 << 18))), 9);
    assert_eq!(driver.current_scale(powered_down_ns + clocks_ns(80 * (2 << 18))), 8);
    write(&mut driver, address::GCONF, 0);
    assert_eq!(driver.current_scale(powered_down_ns + clocks_ns(80 * (2 << 18))), 16);
    driver.set_enable_pin(0, true);
    assert_eq!(driver.current_ma(powered_down_ns), 0);
}

#[test]
fn a_stall_raises_diag_between_the_thresholds_of_speed() {
    let mut driver = driver();
    write(&mut driver, address::SGTHRS, 65);
    write(&mut driver, address::TCOOLTHRS, 100);
    let last_ns = run(&mut driver, 0, 20, 160_000);
    assert_eq!((driver.read(last_ns, address::SG_RESULT), driver.diag()), (300, Some(false)));
    driver.set_load(1.0);
    let last_ns = run(&mut driver, last_ns + 160_000, 10, 160_000);
    assert_eq!((driver.read(last_ns, address::SG_RESULT), driver.diag()), (0, Some(true)));
    let event_ns = driver.next_event_ns().unwrap();
    assert!(event_ns > last_ns + 87_000_000 && event_ns < last_ns + 88_000_000);
    driver.advance(event_ns);
    assert_eq!((driver.diag(), driver.next_event_ns()), (Some(false), None));
    // Too slow, too fast, spreadCycle: no DIAG.
    for (register, value) in [(address::TCOOLTHRS, 59), (address::TPWMTHRS, 60), (address::GCONF, 1 << 2)] {
        let mut other = driver.clone();
        write(&mut other, register, value);
        run(&mut other, event_ns + 1_000_000, 20, 160_000);
        assert_eq!(other.diag(), Some(false), "{register:#x}");
    }
    run(&mut driver, event_ns + 1_000_000, 20, 160_000);
    assert_eq!(driver.diag(), Some(true));
}

#[test]
fn a_stall_before_standstill_raises_no_diag_at_the_next_start() {
    let mut driver = driver();
    write(&mut driver, address::SGTHRS, 100);
    write(&mut driver, address::TCOOLTHRS, TSTEP_MAX);
    driver.set_load(1.0);
    let last_ns = run(&mut driver, 0, 20, 160_000);
    assert_eq!(driver.diag(), Some(true));
    driver.set_load(0.0);
    let start_ns = last_ns + 100_000_000;
    for step in 0..40 {
        let step_ns = start_ns + step * 160_000;
        driver.set_step_pin(step_ns, true);
        driver.set_step_pin(step_ns + 80_000, false);
        assert_eq!(driver.diag(), Some(false), "{step}");
    }
    assert_eq!(driver.read(start_ns, address::SG_RESULT), 300);
}

#[test]
fn a_short_switches_off_until_enabled_again() {
    let mut driver = driver();
    driver.set_fault(0, Fault::ShortToGroundA, true);
    assert!(!driver.energized() && driver.diag() == Some(true));
    assert_ne!(driver.read(0, address::DRV_STATUS) & drv_status::S2GA, 0);
    driver.set_fault(0, Fault::ShortToGroundA, false);
    write(&mut driver, address::GSTAT, 7);
    assert_eq!(driver.read(0, address::GSTAT) & gstat::DRV_ERR, gstat::DRV_ERR);
    driver.set_enable_pin(0, true);
    assert_eq!((driver.diag(), driver.read(0, address::GSTAT) & gstat::DRV_ERR), (Some(false), gstat::DRV_ERR));
    write(&mut driver, address::GSTAT, 7);
    driver.set_enable_pin(0, false);
    assert!(driver.energized() && driver.diag() == Some(false));
    assert_eq!(driver.read(0, address::GSTAT) & gstat::DRV_ERR, 0);
}

#[test]
fn heat_warns_and_then_switches_off_until_cool() {
    let mut driver = driver();
    driver.set_temperature(0, 125.0);
    assert_eq!(driver.read(0, address::DRV_STATUS) & 0xF03, drv_status::OTPW | drv_status::T120);
    assert!(driver.energized());
    driver.set_temperature(0, 144.0);
    assert!(!driver.energized() && driver.diag() == Some(true) && driver.next_event_ns().is_none());
    driver.set_temperature(0, 125.0);
    assert!(!driver.energized());
    driver.set_temperature(0, 119.0);
    assert!(driver.energized());
    assert_eq!(driver.read(0, address::GSTAT) & gstat::DRV_ERR, gstat::DRV_ERR);
}

#[test]
fn a_low_charge_pump_and_open_loads_are_reported() {
    let mut driver = driver();
    driver.set_fault(0, Fault::ChargePump, true);
    assert_eq!(driver.read(0, address::GSTAT) & gstat::UV_CP, gstat::UV_CP);
    assert!(!driver.energized());
    driver.set_fault(0, Fault::ChargePump, false);
    driver.set_fault(0, Fault::OpenLoadB, true);
    assert_eq!(driver.read(0, address::DRV_STATUS) & 0xC0, drv_status::OLB);
    assert!(driver.energized() && driver.read(0, address::GSTAT) & gstat::UV_CP == 0);
}

#[test]
fn without_supply_the_driver_is_silent_and_loses_its_registers() {
    let mut driver = driver();
    write(&mut driver, address::GSTAT, 1);
    write(&mut driver, address::SGTHRS, 5);
    driver.set_supply(0, false);
    assert_eq!(send(&mut driver, 0, &read_request(0, address::IOIN)).0, None);
    assert!(!driver.energized() && driver.diag().is_none() && driver.set_step_pin(0, true).is_none());
    driver.set_supply(10_000_000, true);
    assert_eq!((driver.read(0, address::GSTAT), driver.registers().sgthrs, driver.mscnt()), (1, 0, 0));
    assert!(send(&mut driver, 20_000_000, &read_request(0, address::IOIN)).0.is_some());
    driver.set_fault(0, Fault::Mute, true);
    assert_eq!(send(&mut driver, 30_000_000, &read_request(0, address::IOIN)).0, None);
}

proptest! {
    #[test]
    fn any_flipped_bit_of_a_write_is_refused(bit in 4_usize..64, value: u32) {
        let mut driver = driver();
        let mut request = write_request(0, address::CHOPCONF, value);
        request[bit / 8] ^= 1 << (bit % 8);
        send(&mut driver, 0, &request);
        prop_assert_eq!(driver.registers().ifcnt, 0);
    }

    #[test]
    fn mscnt_is_the_sum_of_its_steps(steps in proptest::collection::vec((any::<bool>(), 0_u32..=8), 1..200)) {
        let mut driver = driver();
        write(&mut driver, address::GCONF, 1 << 7);
        let mut sum = 0_i32;
        for (index, (back, mres)) in steps.into_iter().enumerate() {
            let now_ns = index as u64 * 10_000;
            write(&mut driver, address::CHOPCONF, 3 | mres << 24);
            driver.set_direction_pin(now_ns, back);
            sum += driver.set_step_pin(now_ns + 1_000, true).unwrap().delta;
            driver.set_step_pin(now_ns + 2_000, false);
            prop_assert_eq!(i32::from(driver.mscnt()), sum.rem_euclid(1024));
        }
    }
}

//! Parts connected as in the run.

#![allow(clippy::unwrap_used)]

use super::motion::end_stop::{EndStopConfig, Side};
use super::motion::sheet::SheetConfig;
use super::motion::{AxisConfig, Config, Kinematics, Motion, MotorConfig};
use super::tmc2209::registers::address;
use super::tmc2209::{Config as DriverConfig, Tmc2209, datagram};
use super::wire::Bus;

fn machine() -> Motion {
    let axis =
        AxisConfig { minimum_mm: 0.0, maximum_mm: 100.0, frame_below_mm: 2.0, frame_above_mm: 1.0, start_mm: 20.0 };
    Motion::new(Config {
        kinematics: Kinematics::Cartesian,
        axes: [axis.clone(), axis.clone(), axis],
        motors: vec![MotorConfig { full_steps_per_mm: 5.0, inverted: true }; 3],
        lift: None,
        end_stops: vec![EndStopConfig {
            axis: 1,
            side: Side::Low,
            at_mm: 0.0,
            hysteresis_mm: 0.2,
            bounce_ns: 0,
            high_when_triggered: true,
            seed: 1,
        }],
        sheet: SheetConfig {
            x_mm: (0.0, 100.0),
            y_mm: (0.0, 100.0),
            height_mm: 0.0,
            tilt: (0.0, 0.0),
            allowed_press_mm: 0.1,
        },
        probe: None,
    })
    .unwrap()
}

fn set(drivers: &mut [Tmc2209], bus: &mut Bus, now_ns: u64, register: u8, value: u32) {
    let [a, b, c, d] = value.to_be_bytes();
    let mut bytes = [0x05, 0, register | 0x80, a, b, c, d, 0];
    bytes[7] = datagram::checksum(&bytes[..7]);
    for (index, byte) in bytes.into_iter().enumerate() {
        bus.byte(drivers, now_ns + index as u64 * 100_000, 10_000, byte);
    }
}

/// Steps at 80 us until DIAG rises; returns the number of steps.
fn step_until_diag(driver: &mut Tmc2209, motion: &mut Motion, from_ns: u64) -> Option<u32> {
    for step in 0..20_000 {
        let now_ns = from_ns + u64::from(step) * 80_000;
        let moved = driver.set_step_pin(now_ns, true).unwrap();
        driver.set_step_pin(now_ns + 1_000, false);
        motion.set_energized(now_ns, 0, moved.energized, driver.mscnt());
        if motion.step(now_ns, 0, moved.delta).loads {
            driver.set_load(motion.load(0));
        }
        if driver.diag() == Some(true) {
            return Some(step + 1);
        }
    }
    None
}

#[test]
fn a_carriage_homes_against_the_frame() {
    let mut drivers = [Tmc2209::new(DriverConfig::default())];
    let (mut motion, mut bus) = (machine(), Bus::new(vec![0], 1));
    drivers[0].set_supply(0, true);
    drivers[0].set_enable_pin(0, false);
    motion.set_energized(0, 0, true, drivers[0].mscnt());
    set(&mut drivers, &mut bus, 1_000_000, address::SGTHRS, 60);
    set(&mut drivers, &mut bus, 3_000_000, address::TCOOLTHRS, 400);
    // MS pins: 1/8; DIR low counts up and the motor is inverted: down. 22 mm are 880 steps.
    let steps = step_until_diag(&mut drivers[0], &mut motion, 10_000_000).unwrap();
    assert!((881..=881 + 16).contains(&steps), "{steps}");
    assert!((motion.position_mm(0) + 2.0).abs() < 1e-9 && motion.record(0).slipped_periods == 0);
    // With the minimum threshold only a full stall raises DIAG; without TCOOLTHRS no stall does.
    set(&mut drivers, &mut bus, 9_000_000_000, address::TCOOLTHRS, 0);
    assert_eq!(step_until_diag(&mut drivers[0], &mut motion, 10_000_000_000), None);
    assert!(motion.record(0).slipped_periods > 500);
}

#[test]
fn a_stored_state_is_restored() {
    let (mut motion, mut driver) = (machine(), Tmc2209::new(DriverConfig::default()));
    driver.set_supply(0, true);
    driver.set_enable_pin(0, false);
    motion.set_energized(0, 0, true, 0);
    (0..1_000).for_each(|_| assert!(!motion.step(5, 0, 7).lines));
    let stored = (serde_json::to_string(&motion).unwrap(), serde_json::to_string(&driver).unwrap());
    let mut restored: (Motion, Tmc2209) =
        (serde_json::from_str(&stored.0).unwrap(), serde_json::from_str(&stored.1).unwrap());
    for step in 0..500 {
        let delta = driver.set_step_pin(step * 1_000, step % 2 == 0).map_or(0, |moved| moved.delta);
        assert_eq!(restored.1.set_step_pin(step * 1_000, step % 2 == 0).map_or(0, |moved| moved.delta), delta);
        assert_eq!(motion.step(step, 0, delta), restored.0.step(step, 0, delta));
    }
    assert_eq!(motion.position_mm(0), restored.0.position_mm(0));
    assert_eq!(driver.mscnt(), restored.1.mscnt());
}

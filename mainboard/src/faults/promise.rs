//! What the documentation (docs/src/safety.md, docs/src/drivers.md) promises for each fault, and within which time.
//!
//! Where it names a number, that number and some tolerance stand here: a sample of the control is 10 ms, the median of five and
//! the converter's round take some more, and what a driver suffers is looked at twice a second.

use super::fault::{Block, Driver, Fault, Sensor, Supply};
use super::state::{HEATER_TIMEOUT_S, State};
use crate::parts::heat::HeaterFault;

const SECOND: u64 = 1_000;

/// What a row of the table holds for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum When {
    /// Always.
    Always,
    /// Heaters have targets.
    Hot,
    /// The motor (or any, where the fault concerns all) has current.
    Powered,
    /// The printer runs: it is neither starting nor halted.
    Running,
}

/// What is promised.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum What {
    /// Heaters go off for good within the time, and the host reads why.
    Off,
    /// The chip is reset within the time, which is heaters off.
    Reset,
    /// Nothing stops: after this long everything is as it would have been.
    GoesOn,
    /// Nothing in particular: watched for this long. The heat stays controlled, or the heaters are off.
    Controlled,
}

/// A row of the table.
#[derive(Debug, Clone, Copy)]
pub struct Promise {
    /// What it holds for; of a fault's rows the first that fits counts.
    pub when: When,
    /// What is promised.
    pub what: What,
    /// Within which time, ms; for what promises nothing, how long is watched.
    pub within_ms: u64,
    /// What the host is to read some of, for [`What::Off`]; empty for any error.
    pub says: &'static [&'static str],
    /// Where it stands.
    pub source: &'static str,
}

const fn row(when: When, what: What, within_ms: u64, says: &'static [&'static str], source: &'static str) -> Promise {
    Promise { when, what, within_ms, says, source }
}

/// After the watchdog's longest time, with a planner that is silent for a second before.
pub const DEAF_MS: u64 = 6_900 + 500;

const WATCHED: Promise = row(When::Always, What::Controlled, 2_000, &[], "nothing is promised");
const GOES_ON: [Promise; 1] =
    [row(When::Always, What::GoesOn, 1_500, &[], "a bad reading trips nothing; a hiccup costs nothing")];
const OPEN: [Promise; 1] =
    [row(When::Always, What::Off, 100, &["MINTEMP"], "thermistor open: 3 readings, 30 ms: MINTEMP")];
const SHORT: [Promise; 1] =
    [row(When::Always, What::Off, 100, &["MAXTEMP"], "thermistor shorted: 3 readings, 30 ms: MAXTEMP")];
const STANDS: [Promise; 1] = [row(
    When::Always,
    What::Off,
    300,
    &["MINTEMP"],
    "a reading that is not new for 80 ms is that of an open thermistor; one that lasts trips",
)];
const DRIVER: [Promise; 2] = [
    row(
        When::Powered,
        What::Off,
        3_000,
        &["driver", "Driver"],
        "a driver that is reset, falls silent or switches its motor \
        off while it has current halts the machine; each is looked at twice a second",
    ),
    row(When::Always, What::Controlled, 3_000, &[], "a notice, where the motor has no current"),
];
const SAGS: [Promise; 1] =
    [row(When::Always, What::Controlled, 2_500, &[], "a driver that is reset while it has current halts the machine")];
const BROWN_OUT: [Promise; 2] = [
    row(When::Running, What::Reset, 60, &["start"], "a supply that is too low resets the chip below 2.7 V"),
    row(When::Always, What::Controlled, 2_500, &[], "the level is set by the first start"),
];
const FLIP: [Promise; 1] = [row(
    When::Always,
    What::Controlled,
    2_000,
    &[],
    "nothing is promised for a bit that flips: \
    heaters off within the watchdog's time, or the heat stays controlled",
)];

/// The rows of a fault.
#[must_use]
pub fn rows(fault: Fault) -> &'static [Promise] {
    const SLIPPED: &str = "heating up: 2 in 20 s (bed 240 s on a MINI); runaway: 25 to 40 s; falls out: noticed after 25 s \
        (bed 46 s)";
    match fault {
        Fault::Control => {
            const ROWS: [Promise; 1] =
                [row(When::Always, What::GoesOn, 4_000, &[], "nothing trips that has not failed")];
            &ROWS
        }
        Fault::CrystalStops => {
            const ROWS: [Promise; 1] = [row(
                When::Running,
                What::Off,
                300,
                &[],
                "noticed by the chip itself, and ends as a fault does: heaters off first (the emulator has no NMI for it: \
                    then the converter's slower clock is noticed, as one that stands still)",
            )];
            &ROWS
        }
        // Drivers live on above 4 V: whether a dip takes their registers is the capacitors' affair.
        Fault::MotorSupply(Supply::Sags | Supply::Dips) => &SAGS,
        Fault::MotorSupply(_) => &DRIVER,
        Fault::ChipSupply(_) => &BROWN_OUT,
        Fault::HostVanishes => {
            // The time begins at the end of the motion that is queued.
            const ROWS: [Promise; 1] = [row(
                When::Hot,
                What::Off,
                (HEATER_TIMEOUT_S + 5) * SECOND,
                &["heaters switched off"],
                "heaters that have a target and no use are switched off (M86)",
            )];
            &ROWS
        }
        Fault::HostLineGarbles => {
            const ROWS: [Promise; 1] =
                [row(When::Always, What::Controlled, 4_000, &[], "no input can make it panic; lines have checksums")];
            &ROWS
        }
        Fault::Thermistor(_, Sensor::Open) => &OPEN,
        Fault::Thermistor(_, Sensor::Short) => &SHORT,
        Fault::Thermistor(Block::Nozzle, Sensor::SlippedOut) => {
            const ROWS: [Promise; 1] =
                [row(When::Hot, What::Off, 75 * SECOND, &["Thermal Runaway", "Heating failed", "MAXTEMP"], SLIPPED)];
            &ROWS
        }
        Fault::Thermistor(Block::Bed, Sensor::SlippedOut) => {
            const ROWS: [Promise; 1] =
                [row(When::Hot, What::Off, 320 * SECOND, &["Thermal Runaway", "Heating failed", "MAXTEMP"], SLIPPED)];
            &ROWS
        }
        Fault::Thermistor(_, Sensor::Loose) => {
            const ROWS: [Promise; 1] =
                [row(When::Always, What::Controlled, 3_000, &[], "two bad readings of five change nothing at all")];
            &ROWS
        }
        Fault::Thermistor(_, Sensor::Drifts) => {
            const ROWS: [Promise; 1] = [row(
                When::Always,
                What::Controlled,
                8_000,
                &[],
                "not covered: nothing that looks at this reading can tell",
            )];
            &ROWS
        }
        Fault::Heater(Block::Nozzle, HeaterFault::Broken) => {
            const ROWS: [Promise; 1] = [row(
                When::Hot,
                What::Off,
                75 * SECOND,
                &["Thermal Runaway", "Heating failed"],
                "heater without power: noticed after 37 s (MINI's nozzle)",
            )];
            &ROWS
        }
        Fault::Heater(Block::Bed, HeaterFault::Broken) => {
            const ROWS: [Promise; 1] = [row(
                When::Hot,
                What::Off,
                320 * SECOND,
                &["Thermal Runaway", "Heating failed"],
                "heater without power: noticed after 182 s (MINI's bed)",
            )];
            &ROWS
        }
        Fault::Heater(Block::Nozzle, HeaterFault::StuckOn) => {
            const ROWS: [Promise; 1] = [row(
                When::Always,
                What::Off,
                110 * SECOND,
                &["Thermal Runaway", "MAXTEMP"],
                "transistor fails closed: 10 in 20 s without power; noticed after 14 s (MINI's nozzle)",
            )];
            &ROWS
        }
        Fault::Heater(Block::Bed, HeaterFault::StuckOn) => {
            const ROWS: [Promise; 1] = [row(
                When::Always,
                What::Off,
                320 * SECOND,
                &["Thermal Runaway", "MAXTEMP"],
                "transistor fails closed: 10 in 60 s without power; noticed after 174 s (MINI's bed)",
            )];
            &ROWS
        }
        Fault::ConverterStands | Fault::TransferStands => &STANDS,
        Fault::ConverterHiccup | Fault::TransferHiccup => &GOES_ON,
        Fault::Driver(Driver::Resets | Driver::Hot | Driver::Short | Driver::Mute) => &DRIVER,
        Fault::EndStop(_) | Fault::Probe(_) => {
            const ROWS: [Promise; 1] =
                [row(When::Always, What::Controlled, 2_000, &[], "homing believes two approaches that agree")];
            &ROWS
        }
        Fault::InputStorm | Fault::FanStuck => {
            const ROWS: [Promise; 1] = [row(
                When::Always,
                What::GoesOn,
                2_000,
                &[],
                "tachometers are not read; heat does not depend on motion",
            )];
            &ROWS
        }
        Fault::Flip(_) => &FLIP,
        Fault::TaskHangs => {
            const ROWS: [Promise; 1] = [row(
                When::Always,
                What::Controlled,
                3_000,
                &[],
                "the watchdog resets when control \
                stands still, the planner is silent for a second, the lowest task for five",
            )];
            &ROWS
        }
        Fault::CoreHalted => {
            const ROWS: [Promise; 1] = [row(
                When::Running,
                What::Reset,
                1_900,
                &["start"],
                "a debugger that halts the core does not halt the watchdog: it resets the board within 1.9 s",
            )];
            &ROWS
        }
    }
}

/// What is promised for a fault that comes in this state.
#[must_use]
pub fn promise(fault: Fault, state: State, powered: bool) -> Promise {
    let fits = |when: When| match when {
        When::Always => true,
        When::Hot => state.is_hot(),
        When::Powered => powered,
        When::Running => state != State::Boot,
    };
    let found = rows(fault).iter().find(|row| fits(row.when)).copied().unwrap_or(WATCHED);
    // Before the first start's end nothing is set up; once halted, the reason stays M112.
    let quiet = matches!(state, State::Boot) && found.what == What::Off && found.within_ms < 5 * SECOND;
    if quiet { Promise { what: What::Controlled, within_ms: found.within_ms + 1_500, ..found } } else { found }
}

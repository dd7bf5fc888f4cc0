//! The promises of the documentation (docs/src/safety.md, docs/src/drivers.md) for each fault,
//! and their times.
//!
//! Each time is the documented number plus a tolerance: the control samples every 10 ms, the median
//! of five and the converter's cycle take some more, and the firmware polls drivers twice a second.

use super::fault::{Block, DriverFault, Fault, SupplyFault, ThermistorFault};
use super::state::{HEATER_TIMEOUT_S, State};
use crate::parts::heat::HeaterFault;

const SECOND: u64 = 1_000;

/// The condition of a promise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum When {
    /// Always.
    Always,
    /// Heaters have targets.
    Hot,
    /// The motor (or any motor, if the fault concerns all) has current.
    Powered,
    /// The printer is neither starting nor halted.
    Running,
}

/// The promised reaction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum What {
    /// Heaters go off for good within the time, and the host reads the cause.
    Off,
    /// The chip is reset within the time, which switches heaters off.
    Reset,
    /// The printer continues as without the fault for this time.
    GoesOn,
    /// No specific reaction within the watched time: the heat stays controlled, or the
    /// heaters are off.
    Controlled,
}

/// A row of the table.
#[derive(Debug, Clone, Copy)]
pub struct Promise {
    /// The condition; the first row of a fault whose condition holds applies.
    pub when: When,
    /// The promised reaction.
    pub what: What,
    /// The time limit, ms; the watched time for [`What::GoesOn`] and [`What::Controlled`].
    pub within_ms: u64,
    /// Texts of which the host must read at least one, for [`What::Off`]; empty for any error.
    pub expected_texts: &'static [&'static str],
    /// The documented sentence.
    pub source: &'static str,
}

const fn row(
    when: When,
    what: What,
    within_ms: u64,
    expected_texts: &'static [&'static str],
    source: &'static str,
) -> Promise {
    Promise { when, what, within_ms, expected_texts, source }
}

/// Maximum silence of a live printer, ms: the watchdog's longest time after a planner that is
/// silent for a second.
pub const MAX_SILENCE_MS: u64 = 6_900 + 500;

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

/// The promises of a fault.
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
        // The chip of a driver keeps running above 4 V: its capacitors decide whether a dip
        // clears its registers.
        Fault::MotorSupply(SupplyFault::Sags | SupplyFault::Dips) => &SAGS,
        Fault::MotorSupply(_) => &DRIVER,
        Fault::ChipSupply(_) => &BROWN_OUT,
        Fault::HostVanishes => {
            // The time begins at the end of queued motion, and of the command under way.
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
        Fault::Thermistor(_, ThermistorFault::Open) => &OPEN,
        Fault::Thermistor(_, ThermistorFault::Short) => &SHORT,
        Fault::Thermistor(Block::Nozzle, ThermistorFault::SlippedOut) => {
            const ROWS: [Promise; 1] =
                [row(When::Hot, What::Off, 75 * SECOND, &["Thermal Runaway", "Heating failed", "MAXTEMP"], SLIPPED)];
            &ROWS
        }
        Fault::Thermistor(Block::Bed, ThermistorFault::SlippedOut) => {
            const ROWS: [Promise; 1] =
                [row(When::Hot, What::Off, 320 * SECOND, &["Thermal Runaway", "Heating failed", "MAXTEMP"], SLIPPED)];
            &ROWS
        }
        Fault::Thermistor(_, ThermistorFault::Loose) => {
            const ROWS: [Promise; 1] =
                [row(When::Always, What::Controlled, 3_000, &[], "two bad readings of five change nothing at all")];
            &ROWS
        }
        Fault::Thermistor(_, ThermistorFault::Drifts) => {
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
        Fault::Driver(DriverFault::Resets | DriverFault::Hot | DriverFault::Short | DriverFault::Mute) => &DRIVER,
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
                "heat does not depend on motion; a fan that stands is reported after seconds, and pauses a print",
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

/// The promise for a fault in this state.
#[must_use]
pub fn promise(fault: Fault, state: State, powered: bool) -> Promise {
    let fits = |when: When| match when {
        When::Always => true,
        When::Hot => state.is_hot(),
        When::Powered => powered,
        When::Running => state != State::Boot,
    };
    let found = rows(fault).iter().find(|row| fits(row.when)).copied().unwrap_or(WATCHED);
    // During the start most checks are not set up yet, so that only later promises hold.
    let quiet = matches!(state, State::Boot) && found.what == What::Off && found.within_ms < 5 * SECOND;
    if quiet { Promise { what: What::Controlled, within_ms: found.within_ms + 1_500, ..found } } else { found }
}

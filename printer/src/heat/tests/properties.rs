//! Properties of any sequence of readings and targets.

use proptest::prelude::*;

use super::*;
use crate::heat::fans::FanRule;

/// The usual fans, one by command and a controller's.
const FANS: FanTable = {
    let mut fans = FanSettings::USUAL;
    fans[2] = Some(FanSettings { rule: FanRule::Commanded { number: Some(1) }, ..FanSettings::PART });
    fans[3] = Some(FanSettings { rule: FanRule::Controller { power: 99, idle_s: 9 }, ..FanSettings::PART });
    fans
};

/// A board whose readings a test sets.
struct AnyBoard {
    readings: [u16; Heater::COUNT],
    powers: [f32; Heater::COUNT],
    fans: [u8; FanOutput::COUNT],
}

impl ThermalBoard for AnyBoard {
    fn reading(&mut self, heater: Heater) -> u16 {
        self.readings[heater.index()]
    }
    fn set_power(&mut self, heater: Heater, power: f32) {
        self.powers[heater.index()] = power;
    }
}

impl Fans for AnyBoard {
    fn set_fan_power(&mut self, fan: FanOutput, power: u8) {
        self.fans[fan.index()] = power;
    }
}

/// An event for a control.
#[derive(Clone, Debug)]
enum Event {
    /// Readings, and the number of samples with them.
    Samples([u16; Heater::COUNT], u16),
    Target(Heater, f32),
    AllOff,
    Restart,
}

/// Readings, most of them of a temperature that a printer has.
fn readings() -> impl Strategy<Value = [u16; Heater::COUNT]> {
    let usual = prop::array::uniform4(0.0_f32..300.0)
        .prop_map(|celsius| Heater::ALL.map(|heater| settings(heater).thermistor.reading(celsius[heater.index()])));
    prop_oneof![3 => usual, 1 => any::<[u16; Heater::COUNT]>()]
}

fn event() -> impl Strategy<Value = Event> {
    let targets = prop_oneof![4 => 0.0_f32..270.0, 1 => any::<f32>()];
    prop_oneof![
        // Up to half a minute, for the slow checks; most often few.
        6 => (readings(), prop_oneof![0..8_u16, 0..3000_u16]).prop_map(|(readings, count)| Event::Samples(readings, count)),
        3 => (prop::sample::select(&Heater::ALL), targets).prop_map(|(heater, target)| Event::Target(heater, target)),
        1 => Just(Event::AllOff),
        1 => Just(Event::Restart),
    ]
}

proptest! {
    /// No heater has power again after a trip before M999, which never switches one on either, and
    /// all fans turn; and powers are powers.
    #[test]
    fn after_a_trip_no_heater_has_power_before_m999(
        start in readings(),
        events in prop::collection::vec(event(), 1..60),
    ) {
        let mut board = AnyBoard { readings: start, powers: [9.0; Heater::COUNT], fans: [0; FanOutput::COUNT] };
        let mut control: HeatControl = HeatControl::new(Heater::ALL.map(settings).map(Some), FANS, &mut board);
        prop_assert_eq!(board.powers, [0.0; Heater::COUNT]);
        let mut tripped = false;
        for event in events {
            match event {
                Event::Samples(readings, count) => {
                    board.readings = readings;
                    for _ in 0..count {
                        let outcome = control.update(&mut board);
                        prop_assert!(!(tripped && outcome.is_err()), "told twice");
                        tripped |= outcome.is_err();
                        prop_assert_eq!(control.fault().is_some(), tripped);
                        prop_assert!(board.powers.iter().all(|power| (0.0..=1.0).contains(power)));
                        if tripped {
                            prop_assert_eq!(board.powers, [0.0; Heater::COUNT]);
                            prop_assert_eq!(board.fans, [255, 255, 255, 255, 0, 0], "all that there are");
                        }
                    }
                }
                Event::Target(heater, target) => control.set_target(heater, target),
                Event::AllOff => {
                    control.all_off();
                    prop_assert!(Heater::ALL.iter().all(|heater| control.status(*heater).power == 0.0));
                }
                Event::Restart => {
                    let reset = control.fault().is_some_and(|fault| fault.trip.needs_reset());
                    tripped = control.restart().is_err();
                    prop_assert!(tripped || !reset);
                    prop_assert!(Heater::ALL.iter().all(|heater| control.status(*heater).target_celsius == 0.0));
                }
            }
        }
    }

    /// No heater is on for longer than the median takes without a valid reading, or at or above
    /// its maximum; nor for longer than its watch period at a reading that does not change,
    /// below its target.
    #[test]
    fn no_heater_stays_on_where_it_must_not(
        reading in any::<u16>(),
        heater in prop::sample::select(&Heater::ALL),
        target in 30.0_f32..120.0,
    ) {
        let room = Heater::ALL.map(|heater| settings(heater).thermistor.reading(22.0));
        let mut board = AnyBoard { readings: room, powers: [0.0; Heater::COUNT], fans: [0; FanOutput::COUNT] };
        let mut control: HeatControl = HeatControl::new(Heater::ALL.map(settings).map(Some), FANS, &mut board);
        control.set_target(heater, target);
        prop_assert!(control.update(&mut board).is_ok());
        prop_assert!(board.powers[heater.index()] > 0.0);
        board.readings[heater.index()] = reading;
        let celsius = settings(heater).thermistor.celsius(reading);
        let HeaterSettings { min_celsius, max_celsius, watch, .. } = settings(heater);
        let healthy = celsius.is_ok_and(|celsius| (min_celsius..max_celsius).contains(&celsius));
        let mut outcome = Ok(());
        for _ in 0..3 {
            outcome = outcome.and(control.update(&mut board));
        }
        prop_assert_eq!(outcome.is_ok(), healthy);
        if celsius.is_ok_and(|celsius| healthy && celsius < target - watch.runaway_celsius) {
            let outcome = (0..watch.watch_ms / SAMPLE_MS).try_for_each(|_| control.update(&mut board));
            prop_assert!(outcome.is_err());
            prop_assert_eq!(board.powers, [0.0; Heater::COUNT]);
        }
    }
}

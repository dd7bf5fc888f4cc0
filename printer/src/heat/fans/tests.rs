//! Powers of the fans, and detection of stalled fans.

use super::*;

/// Samples a second.
const A_SECOND: usize = 1000 / SAMPLE_MS as usize;

/// A board that notes powers, and whose fans have a speed.
struct Board {
    powers: [u8; FanOutput::COUNT],
    pulses: f32,
}

impl Fans for Board {
    fn set_fan_power(&mut self, fan: FanOutput, power: u8) {
        self.powers[fan.index()] = power;
    }
    fn tachometer(&self, fan: FanOutput) -> Option<u16> {
        (fan == FanOutput::HotEnd).then_some((self.pulses as u32 % 65_536) as u16)
    }
}

struct World {
    table: FanTable,
    demand: FanDemand,
    heated: Heated,
    control: FanControl,
    board: Board,
}

impl World {
    fn new(fans: &[(FanOutput, FanSettings)]) -> Self {
        let mut table = FanSettings::USUAL;
        for (output, fan) in fans {
            table[output.index()] = Some(*fan);
        }
        // A pulse count that wraps soon.
        let board = Board { powers: [0; FanOutput::COUNT], pulses: 65_500.0 };
        let heated = Heated {
            nozzle_celsius: Some(25.0),
            bed_is_on: false,
            has_fault: false,
            is_halted: false,
            has_supply: true,
        };
        Self { table, demand: FanDemand::default(), heated, control: FanControl::new(), board }
    }

    /// Powers of a fan over this many samples.
    fn powers(&mut self, fan: FanOutput, samples: usize) -> Vec<u8> {
        let sample = |_| {
            self.control.update(&self.table, &self.demand, &self.heated, &mut self.board);
            self.board.powers[fan.index()]
        };
        (0..samples).map(sample).collect()
    }

    /// Makes the hot end's fan turn at this speed for a while.
    fn turn(&mut self, rpm: f32, seconds: f32) {
        for _ in 0..(seconds * A_SECOND as f32) as usize {
            self.board.pulses += rpm / 60.0 * 2.0 / A_SECOND as f32;
            self.control.update(&self.table, &self.demand, &self.heated, &mut self.board);
        }
    }
}

#[test]
fn the_hot_end_s_fan_turns_above_a_hot_nozzle() {
    let mut world = World::new(&[]);
    // Between the two bounds the fan turns until a reading shows that the nozzle is cold.
    let celsius = [49.9, 20.0, 49.9, 50.0, 49.9, 45.0, 44.9, 49.9];
    let turns = celsius.map(|celsius| {
        world.heated.nozzle_celsius = Some(celsius);
        world.powers(FanOutput::HotEnd, 1)[0] == 255
    });
    assert_eq!(turns, [true, false, false, true, true, true, false, false]);
    for unknown in [None, Some(f32::NAN)] {
        world.heated.nozzle_celsius = unknown;
        assert_eq!(world.powers(FanOutput::HotEnd, 1), [255]);
        world.heated.nozzle_celsius = Some(20.0);
        assert_eq!(world.powers(FanOutput::HotEnd, 1), [0]);
    }
}

#[test]
fn a_fan_starts_with_a_kick_and_gets_its_least_power() {
    let mut world =
        World::new(&[(FanOutput::Part, FanSettings { kick_start_ms: 25, least_power: 40, ..FanSettings::PART })]);
    let mut powers = |power: u8, samples| {
        world.demand = FanDemand::part(power);
        world.powers(FanOutput::Part, samples)
    };
    assert_eq!(powers(0, 2), [0, 0]);
    assert_eq!(powers(100, 5), [255, 255, 255, 100, 100], "25 ms are three samples");
    assert_eq!(powers(10, 2), [40, 40], "it turns already: no kick");
    assert_eq!(powers(0, 2), [0, 0], "off is off");
    assert_eq!(powers(10, 4), [255, 255, 255, 40]);
    // Switched off in the middle of a kick start.
    assert_eq!(powers(0, 1), [0]);
    assert_eq!(powers(10, 1), [255]);
    assert_eq!(powers(0, 1), [0]);
    assert_eq!(powers(255, 4), [255; 4]);
}

#[test]
fn a_controller_s_fan_turns_with_motors_or_bed_and_a_while_after() {
    let rule = FanRule::Controller { power: 128, idle_s: 2 };
    let mut world = World::new(&[(FanOutput::Fan2, FanSettings { name: "board", rule, ..FanSettings::PART })]);
    let on = |powers: &[u8]| powers.iter().filter(|power| **power == 128).count();
    assert_eq!(world.powers(FanOutput::Fan2, 5), [0; 5]);
    world.demand.motors_on = true;
    assert_eq!(on(&world.powers(FanOutput::Fan2, A_SECOND)), A_SECOND);
    world.demand.motors_on = false;
    assert_eq!(on(&world.powers(FanOutput::Fan2, 5 * A_SECOND)), 2 * A_SECOND - 1);
    world.heated.bed_is_on = true;
    assert_eq!(on(&world.powers(FanOutput::Fan2, A_SECOND)), A_SECOND);
    // Commands do not affect it.
    world.demand.powers = [9; FanOutput::COUNT];
    assert_eq!(on(&world.powers(FanOutput::Fan2, A_SECOND)), A_SECOND);
}

#[test]
fn a_fault_lets_every_fan_of_the_machine_blow() {
    let rule = FanRule::Controller { power: 128, idle_s: 2 };
    let mut world = World::new(&[(FanOutput::Fan4, FanSettings { name: "board", rule, ..FanSettings::PART })]);
    world.heated.has_fault = true;
    world.powers(FanOutput::Part, 1);
    assert_eq!(world.board.powers, [255, 255, 0, 0, 255, 0]);
}

#[test]
fn a_fan_that_stands_is_found_and_one_that_turns_is_not() {
    let hot_end = FanSettings { least_rpm: 1000, ..FanSettings::HOT_END };
    let mut world = World::new(&[(FanOutput::HotEnd, hot_end)]);
    let stalled = |world: &World| world.control.stalled();
    // Without power the fan need not turn.
    world.turn(0.0, 30.0);
    assert_eq!((stalled(&world), world.control.rpm(FanOutput::HotEnd)), (None, Some(0)));
    world.heated.nozzle_celsius = Some(210.0);
    world.turn(5_000.0, 60.0);
    assert_eq!(stalled(&world), None);
    let rpm = world.control.rpm(FanOutput::HotEnd).unwrap();
    assert!((4_950..=5_050).contains(&rpm), "{rpm}");
    // A stalled fan is detected within two windows, and not before the first could end.
    world.turn(0.0, 4.5);
    assert_eq!(stalled(&world), Some(FanOutput::HotEnd));
    // A fan that is switched off still counts as failed; once it turns it counts as sound.
    world.heated.nozzle_celsius = Some(20.0);
    world.turn(0.0, 10.0);
    assert_eq!(stalled(&world), Some(FanOutput::HotEnd));
    world.heated.nozzle_celsius = Some(210.0);
    world.turn(1_100.0, 10.0);
    assert_eq!(stalled(&world), None);
    world.turn(900.0, 10.0);
    assert_eq!(stalled(&world), Some(FanOutput::HotEnd));
}

#[test]
fn a_fan_has_time_to_reach_its_speed() {
    let hot_end = FanSettings { least_rpm: 4_000, ..FanSettings::HOT_END };
    for slow_s in [0.5, 1.0, 2.0, 3.0] {
        let mut world = World::new(&[(FanOutput::HotEnd, hot_end)]);
        world.turn(0.0, 1.37);
        world.heated.nozzle_celsius = Some(210.0);
        world.turn(500.0, slow_s);
        for _ in 0..20 {
            world.turn(5_000.0, 0.5);
            assert_eq!(world.control.stalled(), None, "slow for {slow_s} s");
        }
    }
}

#[test]
fn without_a_bound_or_a_tachometer_nothing_is_judged() {
    let mut world = World::new(&[(FanOutput::Part, FanSettings { least_rpm: 1000, ..FanSettings::PART })]);
    world.heated.nozzle_celsius = Some(210.0);
    world.demand = FanDemand::part(255);
    world.turn(0.0, 30.0);
    assert_eq!((world.control.stalled(), world.control.rpm(FanOutput::Part)), (None, None));
}

#[test]
fn an_output_is_no_fan() {
    let light = FanSettings {
        name: "light",
        rule: FanRule::Output { number: Some(1), is_pwm: true, at_start: 40, at_halt: 255, color: None },
        ..FanSettings::PART
    };
    let relay = FanSettings {
        name: "relay",
        rule: FanRule::Output { number: None, is_pwm: false, at_start: 0, at_halt: 0, color: None },
        ..light
    };
    let mut world = World::new(&[(FanOutput::Fan2, light), (FanOutput::Fan3, relay)]);
    assert_eq!(start_powers(&world.table), [0, 0, 40, 0, 0, 0]);
    world.demand.powers = [0, 0, 40, 7, 0, 0];
    assert_eq!(world.powers(FanOutput::Fan2, 1), [40]);
    assert_eq!(world.powers(FanOutput::Fan3, 1), [255], "a relay has no half");
    world.demand.powers = [0; FanOutput::COUNT];
    assert_eq!(world.powers(FanOutput::Fan3, 1), [0]);
    // In a fault the fans blow; outputs get their values for a halt.
    (world.heated.is_halted, world.heated.has_fault) = (true, true);
    world.demand.powers = [0, 0, 40, 255, 0, 0];
    assert_eq!(world.powers(FanOutput::Fan2, 1), [255]);
    assert_eq!(world.powers(FanOutput::Fan3, 1), [0]);
    assert_eq!(world.powers(FanOutput::Part, 1), [255]);
    // After M112 fans keep their powers.
    world.heated.has_fault = false;
    assert_eq!(world.powers(FanOutput::Part, 1), [0]);
    assert_eq!(world.powers(FanOutput::Fan2, 1), [255]);
}

//! Hours of ordinary use, in which no check may trip.
//!
//! Jobs follow each other, each with its material, weather, supply and noise; heat-up, print
//! and cooling are run at the firmware's own 100 samples a second, by its own code. The suite
//! runs 50 hours, the lives of twenty machines, and a run tries its share of them; more, and
//! in less time, with
//!
//! ```text
//! FERROSTEP_HEAT_HOURS=10000 cargo test --release -p ferrostep-profiles ordinary -- --nocapture
//! ```

use ferrostep_hal_shim::Heater;
use ferrostep_printer::FanDemand;
use ferrostep_profiles::load;

use super::Mini;
use super::plant::{Plant, Random, Weather};

/// Machines of the suite, and how long each is in use, hours.
const SUITE_LIVES: u64 = 20;
const SUITE_LIFE_HOURS: f32 = 2.5;

/// Nozzle and bed, degrees Celsius, and the fan's most, of 255: PLA, TPU, PETG, ASA, PC.
const MATERIALS: [(f32, f32, f32); 5] =
    [(215.0, 60.0, 255.0), (230.0, 50.0, 128.0), (240.0, 85.0, 128.0), (260.0, 100.0, 40.0), (275.0, 100.0, 0.0)];

/// Target of the bed, degrees Celsius, up to which draughts add a quarter to its loss; above, 15 %:
/// the MINI's bed does not hold 100 C in more, and in no room below 15 C.
const DRAUGHTY_BED_CELSIUS: f32 = 90.0;

/// Totals of a run.
#[derive(Clone, Copy, Debug, Default)]
struct Report {
    jobs: u32,
    heat_ups: u32,
    hours: f32,
    fan_changes: u32,
    draughts: u32,
    /// Longest time farther below the target than the hysteresis, once it had been reached, s.
    longest_dip_s: [u32; 2],
}

/// A machine in use.
struct Life {
    mini: Mini,
    random: Random,
    targets: [f32; 2],
    reached: [bool; 2],
    dip_s: [u32; 2],
    /// Time until the draught is over, s.
    draught_s: f32,
    hysteresis: [f32; 2],
    report: Report,
}

impl Life {
    fn new(seed: u64) -> Self {
        let profile = load("prusa-mini").unwrap();
        let mut random = Random(seed | 1);
        let dead_s = random.between(2.0, 5.6);
        let hysteresis = [profile.nozzle.watch.runaway_celsius, profile.bed.watch.runaway_celsius];
        Self {
            mini: Mini::new(&profile, dead_s, Weather::STILL, seed),
            random,
            targets: [0.0; 2],
            reached: [false; 2],
            dip_s: [0; 2],
            draught_s: 0.0,
            hysteresis,
            report: Report::default(),
        }
    }

    fn target(&mut self, heater: Heater, celsius: f32) {
        let index = heater.index();
        self.report.heat_ups += u32::from(celsius > self.targets[index] + 20.0);
        self.targets[index] = celsius;
        self.reached[index] = false;
        self.mini.control.set_target(heater, celsius);
    }

    fn happens(&mut self, once_in_s: f32) -> bool {
        self.random.between(0.0, once_in_s) < 1.0
    }

    /// A second, with its changes of the air.
    fn second(&mut self) {
        self.draught_s -= 1.0;
        if self.draught_s <= 0.0 {
            let starts = self.happens(600.0);
            self.report.draughts += u32::from(starts);
            let most = if self.targets[1] > DRAUGHTY_BED_CELSIUS { 1.15 } else { 1.25 };
            let draught =
                if starts { [self.random.between(1.0, 1.2), self.random.between(1.0, most)] } else { [1.0; 2] };
            self.draught_s = if starts { self.random.between(10.0, 600.0) } else { 0.0 };
            self.mini.plant.weather.draught = draught;
        }
        if let Err(fault) = self.mini.run(1.0) {
            let Plant { weather, celsius, powers, fan, .. } = &self.mini.plant;
            let plant = format!("{celsius:?} C, powers {powers:?}, fan {fan}, {weather:?}");
            panic!("{fault} with targets {:?}: {plant}, after {:?}", self.targets, self.report);
        }
        self.report.hours += 1.0 / 3600.0;
        for index in 0..2 {
            let below = self.targets[index] - self.mini.plant.celsius[index];
            self.reached[index] |= below < self.hysteresis[index];
            self.dip_s[index] =
                if self.reached[index] && below > self.hysteresis[index] { self.dip_s[index] + 1 } else { 0 };
            self.report.longest_dip_s[index] = self.report.longest_dip_s[index].max(self.dip_s[index]);
        }
    }

    fn pass(&mut self, seconds: f32) {
        (0..seconds as u32).for_each(|_| self.second());
    }

    fn wait_for(&mut self, heater: Heater, at_most_s: u32) {
        for _ in 0..at_most_s {
            if (self.mini.plant.celsius[heater.index()] - self.targets[heater.index()]).abs() < 1.0 {
                break;
            }
            self.second();
        }
    }

    fn fan(&mut self, power: f32) {
        self.report.fan_changes += 1;
        self.mini.control.set_fan_demand(FanDemand::part(power as u8));
    }

    /// A print, from cold or from where the one before has ended.
    fn job(&mut self) {
        self.report.jobs += 1;
        let random = &mut self.random;
        let (nozzle, bed, most_fan) = MATERIALS[random.between(0.0, MATERIALS.len() as f32 - 0.001) as usize];
        let nozzle = (nozzle + random.between(-10.0, 5.0)).round().min(280.0);
        self.mini.plant.weather = Weather {
            room_celsius: random.between(15.0, 30.0),
            supply: [random.between(0.9, 1.1), random.between(0.9, 1.1)],
            noise: random.one_of(&[0.0, 0.5, 1.5, 3.0]),
            spark_in: 50_000.0,
            ..Weather::STILL
        };
        // As the maker's slicer begins: the bed, a nozzle that does not drip, and then the rest.
        self.target(Heater::Bed, bed);
        self.target(Heater::Nozzle, 170.0);
        self.wait_for(Heater::Bed, 1800);
        self.target(Heater::Nozzle, nozzle);
        self.wait_for(Heater::Nozzle, 300);
        let print_s = self.random.between(600.0, 15_000.0);
        for _ in 0..print_s as u32 {
            // A host that repeats itself.
            self.mini.control.set_target(Heater::Nozzle, self.targets[0]);
            if self.happens(20.0) {
                let share = self.random.one_of(&[0.0, 0.3, 0.5, 1.0, 1.0]);
                self.fan(most_fan * share);
            }
            if self.happens(5.0) {
                self.mini.plant.weather.filament_w = self.random.between(0.0, 4.0);
            }
            if self.happens(1200.0) {
                let change = self.random.one_of(&[-10.0, -5.0, 5.0, 10.0]);
                self.target(Heater::Nozzle, (nozzle + change).min(280.0));
            }
            if self.happens(2000.0) {
                // A pause, of seconds or longer, and on.
                self.target(Heater::Nozzle, 0.0);
                self.mini.plant.weather.filament_w = 0.0;
                let longest_s = self.random.one_of(&[30.0, 900.0]);
                let pause_s = self.random.between(2.0, longest_s);
                self.pass(pause_s);
                self.target(Heater::Nozzle, nozzle);
                self.wait_for(Heater::Nozzle, 300);
            }
            self.second();
        }
        self.mini.plant.weather.filament_w = 0.0;
        let fan = self.random.one_of(&[0.0, 255.0]);
        self.fan(fan);
        self.target(Heater::Nozzle, 0.0);
        self.target(Heater::Bed, 0.0);
        let cool_s = self.random.between(0.0, 3600.0);
        self.pass(cool_s);
        self.fan(0.0);
    }
}

/// This run's share of the suite's machines.
fn live_a_share() -> Report {
    let mut total = Report::default();
    for number in ferrostep_random_cases::share_of(SUITE_LIVES) {
        let mut life = Life::new((number + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
        while life.report.hours < SUITE_LIFE_HOURS {
            life.job();
        }
        add(&mut total, &life.report);
    }
    total
}

/// This many hours, divided among the processors.
fn live(hours: f32) -> Report {
    let threads = std::thread::available_parallelism().map_or(1, usize::from).min(2);
    let each = |thread: usize| {
        move || {
            let mut total = Report::default();
            let mut seed = 1 + thread as u64;
            while total.hours < hours / threads as f32 {
                // A machine, with its own dead time, lives for a few days.
                let mut life = Life::new(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15));
                while life.report.hours < 48.0 && total.hours + life.report.hours < hours / threads as f32 {
                    life.job();
                }
                add(&mut total, &life.report);
                seed += threads as u64;
            }
            total
        }
    };
    let running: Vec<_> = (0..threads).map(|thread| std::thread::spawn(each(thread))).collect();
    let mut total = Report::default();
    running.into_iter().for_each(|thread| add(&mut total, &thread.join().unwrap()));
    total
}

fn add(total: &mut Report, part: &Report) {
    total.jobs += part.jobs;
    total.heat_ups += part.heat_ups;
    total.hours += part.hours;
    total.fan_changes += part.fan_changes;
    total.draughts += part.draughts;
    for (total, part) in total.longest_dip_s.iter_mut().zip(part.longest_dip_s) {
        *total = (*total).max(part);
    }
}

#[test]
fn ordinary_use_trips_nothing() {
    let wanted: Option<f32> = std::env::var("FERROSTEP_HEAT_HOURS").ok().map(|hours| hours.parse().unwrap());
    let report = wanted.map_or_else(live_a_share, live);
    println!("{report:?}");
    let hours = wanted.unwrap_or(SUITE_LIFE_HOURS);
    assert!(report.hours >= hours && report.jobs as f32 > hours / 10.0, "{report:?}");
}

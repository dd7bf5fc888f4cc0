//! Autotune on models of real hot ends and beds, with a noisy converter.

pub(super) mod chart;
pub(super) mod models;

use std::format;
use std::path::{Path, PathBuf};
use std::string::String;
use std::vec::Vec;

use ferrostep_random_cases::share_of;

use super::load::Load;
use super::*;
use chart::{Chart, GREY, Panel, RUST, Row};
use models::{MODELS, Model};

/// Requirements of a tuned heater, degrees.
pub(super) const MAX_OVERSHOOT: f32 = 2.0;
pub(super) const STEADY: f32 = 0.3;
pub(super) const MAX_FAN: f32 = 3.0;

/// Virtual heaters whose converter is noisy.
pub(super) struct Noisy {
    pub board: VirtualHeaters,
    /// Standard deviation, the converter's 4096 steps.
    pub deviation: f32,
    random: u64,
}

impl Noisy {
    pub fn new(board: VirtualHeaters, deviation: f32) -> Self {
        Self { board, deviation, random: 7 }
    }

    /// About normal with a deviation of 1: the sum of twelve even ones.
    fn normal(&mut self) -> f32 {
        let mut sum = -6.0;
        for _ in 0..12 {
            self.random = self.random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            sum += (self.random >> 40) as f32 / (1_u32 << 24) as f32;
        }
        sum
    }
}

impl ThermalBoard for Noisy {
    /// A reading is the sum of sixteen conversions.
    fn reading(&mut self, heater: Heater) -> u16 {
        let noise = self.normal() * self.deviation * 4.0;
        (f32::from(self.board.reading(heater)) + noise) as u16
    }

    fn set_power(&mut self, heater: Heater, power: f32) {
        self.board.set_power(heater, power);
    }
}

impl Fans for Noisy {
    fn set_fan_power(&mut self, fan: FanOutput, power: u8) {
        self.board.set_fan_power(fan, power);
    }
}

/// A heater of [`MODELS`] and its control.
pub(super) struct Bench<'a> {
    pub model: &'a Model,
    pub control: HeatControl,
    pub board: Noisy,
    pub samples: u32,
    pub load: Load,
}

impl<'a> Bench<'a> {
    pub fn new(model: &'a Model, deviation: f32) -> Self {
        let mut all = USUAL.map(settings);
        let own = &mut all[model.heater.index()];
        (own.mass, own.max_celsius) = (model.mass, if model.heater == Heater::Nozzle { 295.0 } else { 125.0 });
        let (control, board) = control_of(all, [None; 2], FanSettings::USUAL);
        Self { model, control, board: Noisy::new(board, deviation), samples: 0, load: Load::default() }
    }

    pub fn sample(&mut self) -> Result<(), HeatFault> {
        self.samples += 1;
        self.board.board.advance(SAMPLE_MS as f32 * 1e-3);
        self.load.pass(self.model.heater, &mut self.board.board);
        self.control.note_filament(self.load.pushed_um as i32);
        self.control.update(&mut self.board)
    }

    /// Temperature that the thermistor would read without noise, degrees Celsius.
    pub fn celsius(&self) -> f32 {
        self.board.board.thermistor_celsius(self.model.heater)
    }

    pub fn begin_relay(&mut self) {
        let is_nozzle = self.model.heater == Heater::Nozzle;
        self.control.begin_relay(self.model.heater, self.model.tuned_at, 5, is_nozzle);
    }

    /// Tunes it, and notes the distance from the target each second.
    pub fn tune(&mut self) -> (RelayFindings, Vec<f32>) {
        self.begin_relay();
        let mut curve = Vec::new();
        loop {
            if self.samples.is_multiple_of(SAMPLES_A_S) {
                curve.push(self.celsius() - self.model.tuned_at);
            }
            self.sample().unwrap();
            match self.control.relay(self.model.heater) {
                Some(RelayProgress::Found(findings)) => return (findings, curve),
                Some(RelayProgress::Cycles { .. }) => {}
                other => panic!("{}: {other:?}", self.model.name),
            }
        }
    }

    /// The distance from the target at each sample; samples are this many seconds apart.
    pub fn follow(&mut self, target: f32, seconds: u32) -> Vec<f32> {
        (0..seconds * SAMPLES_A_S)
            .map(|_| {
                self.sample().unwrap();
                self.celsius() - target
            })
            .collect()
    }
}

/// The largest and the smallest.
pub(super) fn ends(curve: &[f32]) -> [f32; 2] {
    [curve.iter().copied().fold(f32::NEG_INFINITY, f32::max), curve.iter().copied().fold(f32::INFINITY, f32::min)]
}

/// Behaviour of tuned gains at a target.
struct Outcome {
    overshoot: f32,
    steady: f32,
    fan: f32,
    curve: Vec<f32>,
    fan_s: Option<[usize; 2]>,
}

/// Heats up with these gains, waits, and lets the fan blow and stop.
fn use_gains(model: &Model, deviation: f32, gains: PidGains, target: f32) -> Outcome {
    let mut bench = Bench::new(model, deviation);
    bench.control.set_gains(model.heater, gains);
    bench.control.set_target(model.heater, target);
    // A bed of 80 W takes ten minutes to 90 degrees.
    let (wait_s, has_fan) = if model.heater == Heater::Nozzle { (260, true) } else { (900, false) };
    let mut all = bench.follow(target, wait_s);
    let [overshoot, _] = ends(&all);
    let rest = &all[all.len() - 60 * SAMPLES_A_S as usize..];
    let steady = ends(rest).map(f32::abs).into_iter().fold(0.0, f32::max);
    let mut fan = 0.0_f32;
    if has_fan {
        for power in [255, 0] {
            bench.control.set_fan_demand(FanDemand::part(power));
            let part = bench.follow(target, 80);
            fan = ends(&part).map(f32::abs).into_iter().fold(fan, f32::max);
            all.extend(part);
        }
    }
    let curve = all.iter().step_by(SAMPLES_A_S as usize).copied().collect();
    let fan_s = has_fan.then_some([wait_s as usize, wait_s as usize + 80]);
    Outcome { overshoot, steady, fan, curve, fan_s }
}

/// Also with the most noise of the tests of the checks.
#[test]
fn tuned_heaters_overshoot_by_two_degrees_at_most_and_stay() {
    let mut rows = Vec::new();
    let mut table = String::from(
        "| heater | M303 takes | P | I | D | F | overshoot | within, at rest | the fan disturbs by | without F |\n\
         |---|---|---|---|---|---|---|---|---|---|\n",
    );
    for deviation in [1.0, 3.0] {
        for model in &MODELS {
            let mut bench = Bench::new(model, deviation);
            let (findings, tuning) = bench.tune();
            let gains = gains_by_relay(&findings, model.tuned_at);
            let mut worst = [0.0_f32; 3];
            for target in model.targets {
                let Outcome { overshoot, steady, fan, curve, fan_s } = use_gains(model, deviation, gains, target);
                for (worst, one) in worst.iter_mut().zip([overshoot, steady, fan]) {
                    *worst = worst.max(one);
                }
                if deviation == 1.0 && target == model.tuned_at {
                    let panels = [
                        Panel { curves: std::vec![(GREY, tuning.clone())], marked_s: Vec::new() },
                        Panel { curves: std::vec![(RUST, curve)], marked_s: Vec::from_iter(fan_s) },
                    ];
                    rows.push(Row { name: model.name, panels });
                }
            }
            let [overshoot, steady, fan] = worst;
            let what = format!("{} with noise of {deviation}: {worst:?} with {gains:?}", model.name);
            assert!(overshoot <= MAX_OVERSHOOT && steady <= STEADY && fan <= MAX_FAN, "{what}");
            if deviation == 1.0 {
                let [p, i, d, f] = [gains.proportional, gains.integral, gains.derivative, gains.fan]
                    .map(|gain| ferrostep_gcode::Real::short(gain * 255.0, 3));
                let without = PidGains { fan: 0.0, ..gains };
                let unaided = use_gains(model, deviation, without, model.tuned_at).fan;
                let is_nozzle = model.heater == Heater::Nozzle;
                let [fan, unaided] =
                    [fan, unaided].map(|degrees| if is_nozzle { format!("{degrees:.1} °C") } else { String::new() });
                table += &format!(
                    "| {} | {} s | {p} | {i} | {d} | {f} | {overshoot:.1} °C | {steady:.2} °C | {fan} | {unaided} |\n",
                    model.name,
                    bench.samples / SAMPLES_A_S
                );
            }
        }
    }
    let chart = Chart {
        title: "Degrees from the target: while it is tuned, and with the gains found",
        heads: ["M303", "heating up, fan on and off (grey)"],
        ends: [-12.0, 8.0],
        lines: &[-10.0, -5.0, 0.0, 5.0],
    };
    keep("autotune.svg", &chart::svg(&chart, &rows), &[("tuned", &table)]);
}

/// File with the tables of measurements on models.
fn tables_page() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/heaters.md")
}

/// Compares the book's chart and the tables with these, or writes them.
pub(super) fn keep(image: &str, chart: &str, tables: &[(&str, &str)]) {
    use ferrostep_checked_toml::book::{self, REFRESH_VARIABLE};
    let pages = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/src");
    let refresh = std::env::var_os(REFRESH_VARIABLE).is_some();
    let path = pages.join("images").join(image);
    if refresh {
        std::fs::write(&path, chart).unwrap();
    }
    let kept = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(kept == chart, "images/{image} has changed: look at it, then set {REFRESH_VARIABLE} to keep it");
    for (name, table) in tables {
        book::keep(&tables_page(), name, table).unwrap();
    }
}

/// Gains that were found with another block, sock or supply.
#[test]
fn tuned_gains_bear_another_mass_power_and_loss() {
    // Six changes of each model; the first model has all of them in every run.
    let share: Vec<u64> = (0..6).chain(share_of(6 * MODELS.len() as u64)).collect();
    for (number, model) in (0..).zip(&MODELS) {
        let mut cases = (6 * number..).map(|case| share.contains(&case));
        if !share.iter().any(|case| case / 6 == number) {
            continue;
        }
        let (findings, _) = Bench::new(model, 1.0).tune();
        let gains = gains_by_relay(&findings, model.tuned_at);
        for (mass, power, loss, lag) in [
            (0.8, 1.0, 1.0, 1.0),
            (1.25, 1.0, 1.0, 1.0),
            (1.0, 1.1, 1.0, 1.0),
            (1.0, 0.9, 1.0, 1.0),
            (1.0, 1.0, 1.2, 1.0),
            (1.0, 1.0, 1.0, 1.3),
        ] {
            if cases.next() == Some(false) {
                continue;
            }
            let other = HeatedMass {
                heater_w: model.mass.heater_w * power,
                capacity_j_per_k: model.mass.capacity_j_per_k * mass,
                loss_w_per_k: model.mass.loss_w_per_k * loss,
                sensor_lag_s: model.mass.sensor_lag_s * lag,
                ..model.mass
            };
            let other = Model { mass: other, name: model.name, heater: model.heater, ..*model };
            let Outcome { overshoot, steady, .. } = use_gains(&other, 1.0, gains, model.tuned_at);
            let what = (model.name, mass, power, loss, lag);
            assert!(overshoot <= MAX_OVERSHOOT && steady <= STEADY, "{what:?}: {overshoot}, {steady}");
        }
    }
}

/// The relay's two equations describe a heater with a dead time alone.
#[test]
fn the_relay_finds_slope_delay_and_power() {
    for (power_w, dead_time_s) in [(40.0, 2.0), (40.0, 5.0), (60.0, 3.0), (30.0, 4.0)] {
        let mass = HeatedMass { heater_w: power_w, dead_time_s, ..MODELS[4].mass };
        let mass = HeatedMass { sensor_lag_s: 0.0, fan_loss_w_per_k: 0.03, ..mass };
        let model = Model { mass, ..MODELS[4] };
        let (findings, _) = Bench::new(&model, 0.0).tune();
        let slope = mass.heater_w / mass.capacity_j_per_k;
        let rise = model.tuned_at - 22.0;
        let near = |found: f32, is: f32, share: f32| (found / is - 1.0).abs() < share;
        assert!(near(findings.slope_per_power, slope, 0.1), "{findings:?}, {slope}");
        assert!(near(findings.delay_s, dead_time_s, 0.1), "{findings:?}, {dead_time_s}");
        assert!(near(findings.holding_power, mass.loss_w_per_k * rise / power_w, 0.03), "{findings:?}");
        assert!(near(findings.fan_power, mass.fan_loss_w_per_k * rise / power_w, 0.1), "{findings:?}");
    }
}

/// A heater without any delay would get gains without end.
#[test]
fn gains_stay_within_their_ranges() {
    for slope_per_power in [1e-6, 1.0, 1e6] {
        for delay_s in [1e-6, 1.0, 1e6] {
            let findings =
                RelayFindings { slope_per_power, delay_s, holding_power: 0.5, fan_power: 0.9, cycle_s: 10.0 };
            let PidGains { proportional, integral, derivative, fan } = gains_by_relay(&findings, 26.0);
            for (gain, [low, high]) in [
                (proportional, PidGains::PROPORTIONAL),
                (integral, PidGains::INTEGRAL),
                (derivative, PidGains::DERIVATIVE),
                (fan, PidGains::FAN),
            ] {
                assert!((low as f32..=high as f32).contains(&gain), "{gain} of {slope_per_power}, {delay_s}");
            }
        }
    }
}

/// Writes one of the tables of failures while a heater is tuned. `trip` lets it fail, notes
/// the trip, and returns the course for each of two heaters.
pub(super) fn keep_failures(
    table: &str,
    heaters: [&str; 2],
    mut trip: impl FnMut(HeaterFailure, &mut Vec<String>) -> [String; 2],
) {
    use HeaterFailure::*;
    let [nozzle, bed] = heaters;
    let mut text = format!("| what fails | the host reads | {nozzle} | {bed} |\n|---|---|---|---|\n");
    for (failure, words) in [
        (Dead, "no power reaches the heater"),
        (StuckOn, "transistor fails closed"),
        (ThermistorOpen, "thermistor open"),
        (ThermistorShorted, "thermistor shorted"),
        (ThermistorFellOut, "thermistor falls out"),
        (ThermistorFrozen, "reading stands still"),
    ] {
        let mut trips = Vec::new();
        let [nozzle, bed] = trip(failure, &mut trips);
        text += &format!("| {words} | {} | {nozzle} | {bed} |\n", trips.join(", "));
    }
    ferrostep_checked_toml::book::keep(&tables_page(), table, &text).unwrap();
}

/// Notes a trip, once.
pub(super) fn note(trips: &mut Vec<String>, fault: &HeatFault) {
    let trip = format!("`{}`", fault.trip);
    if !trips.contains(&trip) {
        trips.push(trip);
    }
}

/// Each failure at several moments of an autotune: heating up, and in all parts of a cycle. The
/// book has the worst of them.
#[test]
fn failures_trip_while_a_heater_is_tuned() {
    use HeaterFailure::{StuckOn, ThermistorFellOut};
    keep_failures("failures", ["V6 at 215 °C, 40 W", "aluminium and glass at 60 °C, 220 W"], |failure, trips| {
        [&MODELS[0], &MODELS[6]].map(|model| {
            let mut worst = [0.0_f32; 2];
            for at_s in [2, 150, 200, 203, 206, 209] {
                // Noise would thaw the frozen reading.
                let mut bench = Bench::new(model, 0.0);
                bench.begin_relay();
                (0..at_s * SAMPLES_A_S).for_each(|_| bench.sample().unwrap());
                bench.board.board.set_failure(model.heater, Some(failure));
                let fault = (0..400 * SAMPLES_A_S).find_map(|_| bench.sample().err());
                let highest = bench.board.board.true_celsius(model.heater);
                // One that has fallen out is noticed after the runaway period, as at any target.
                let most = if failure == ThermistorFellOut { 70.0 } else { 45.0 };
                assert!(failure == StuckOn || highest < model.tuned_at + most, "{failure:?} after {at_s} s: {highest}");
                let fault = fault.unwrap_or_else(|| panic!("{}: {failure:?} after {at_s} s", model.name));
                assert_eq!(fault.heater, model.heater);
                assert_eq!(bench.board.board.power(model.heater), 0.0);
                assert_eq!(bench.control.relay(model.heater), None, "the fault ends the autotune");
                let after_s = bench.samples as f32 / SAMPLES_A_S as f32 - at_s as f32;
                worst = [worst[0].max(after_s), worst[1].max(highest)];
                note(trips, &fault);
            }
            let [after_s, highest] = worst;
            format!("after {after_s:.1} s, {highest:.0} °C")
        })
    });
}

#[test]
fn a_heater_that_does_not_cool_ends_the_relay_without_gains() {
    let mass = HeatedMass { loss_w_per_k: 0.03, ..MODELS[6].mass };
    let model = Model { mass, ..MODELS[6] };
    let mut bench = Bench::new(&model, 0.0);
    bench.begin_relay();
    for _ in 0..30 * 60 * SAMPLES_A_S {
        bench.sample().unwrap();
    }
    assert_eq!(bench.control.relay(model.heater), Some(RelayProgress::Failed));
    assert_eq!(bench.board.board.power(model.heater), 0.0);
    assert!(bench.celsius() < model.tuned_at + 5.0);
}

#[test]
fn a_target_or_an_end_of_all_heat_ends_the_relay() {
    let ends: [fn(&mut HeatControl); 3] = [
        |control| control.set_target(Heater::Nozzle, 0.0),
        |control| control.set_target(Heater::Nozzle, 180.0),
        HeatControl::all_off,
    ];
    for (end, target) in ends.into_iter().zip([0.0, 180.0, 0.0]) {
        let mut bench = Bench::new(&MODELS[0], 0.0);
        bench.begin_relay();
        (0..50 * SAMPLES_A_S).for_each(|_| bench.sample().unwrap());
        assert_eq!(bench.board.board.power(Heater::Nozzle), 1.0);
        end(&mut bench.control);
        bench.sample().unwrap();
        assert_eq!(bench.control.relay(Heater::Nozzle), None);
        assert_eq!(bench.control.status(Heater::Nozzle).target_celsius, target);
        assert_eq!(bench.board.board.power(Heater::Nozzle) > 0.0, target > 0.0);
    }
}

/// The fan turns for the second half only, and then at M106's power.
#[test]
fn the_relay_turns_the_fan_and_gives_it_back() {
    let mut bench = Bench::new(&MODELS[2], 0.0);
    bench.control.set_fan_demand(FanDemand::part(100));
    bench.begin_relay();
    let mut powers = Vec::new();
    for _ in 0..200 * SAMPLES_A_S {
        bench.sample().unwrap();
        powers.push(bench.board.board.fan_power(FanOutput::Part));
    }
    assert!(matches!(bench.control.relay(Heater::Nozzle), Some(RelayProgress::Found(_))));
    powers.dedup();
    assert_eq!(powers, [100, 255, 100]);
}

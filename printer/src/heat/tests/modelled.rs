//! Control by a model, on the models of real hot ends and beds that the PID loop is tuned on.
//! These have a dead time that the controller's model lacks, and their filament takes another heat
//! than it expects.

use std::format;
use std::string::String;
use std::vec;
use std::vec::Vec;

use ferrostep_random_cases::share_of;

use super::load::SecondMass;
use super::tuning::chart::{Chart, GREY, Panel, RUST, Row};
use super::tuning::models::{MODELS, Model};
use super::tuning::{Bench, MAX_FAN, MAX_OVERSHOOT, STEADY, chart, ends, keep, keep_failures, note};
use super::*;

/// Filament of 1.75 mm for 15 mm^3/s, mm/s.
const FLOW_MM_PER_S: f32 = 6.24;
/// Time for which the nozzle heats up and rests, s; a bed of 80 W takes ten minutes to 90 degrees.
const NOZZLE_S: u32 = 260;
const BED_S: u32 = 900;
/// Time for which the fan blows and rests, and the filament flows and stops, each, s.
const EACH_S: u32 = 80;

/// The profile's model before M306 T.
fn before_tuning(model: &Model) -> HeaterModel {
    HeaterModel {
        power_w: model.mass.heater_w,
        capacity_j_per_k: 100.0,
        loss_w_per_k: 0.1,
        fanned_loss_w_per_k: 0.1,
        sensor_per_s: 0.2,
        filament_j_per_k_mm: HeaterModel::PLA_J_PER_K_MM as f32,
    }
}

fn begin_step(bench: &mut Bench<'_>) {
    let heater = bench.model.heater;
    let is_nozzle = heater == Heater::Nozzle;
    bench.control.set_model(heater, before_tuning(bench.model));
    bench.control.begin_step(heater, if is_nozzle { 200.0 } else { 70.0 }, is_nozzle);
}

/// Returns the result of a step response.
fn tune(bench: &mut Bench<'_>) -> HeaterModel {
    begin_step(bench);
    loop {
        bench.sample().unwrap();
        match bench.control.step(bench.model.heater) {
            Some(StepProgress::Found(found)) => return found,
            Some(StepProgress::Parts { .. }) => {}
            other => panic!("{}: {other:?}", bench.model.name),
        }
        assert!(bench.samples < 3600 * SAMPLES_A_S, "{}", bench.model.name);
    }
}

/// Control of a heater.
#[derive(Clone, Copy)]
enum By {
    Gains(PidGains),
    Model(HeaterModel),
}

/// Behaviour of a control at a target, degrees and s.
#[derive(Clone, Copy, Debug, Default)]
struct Outcome {
    overshoot: f32,
    /// Time until it stays within 1 degree.
    reached_s: f32,
    rest: f32,
    fan: f32,
    flow: f32,
}

impl Outcome {
    fn worst(self, other: Self) -> Self {
        Self {
            overshoot: self.overshoot.max(other.overshoot),
            reached_s: self.reached_s.max(other.reached_s),
            rest: self.rest.max(other.rest),
            fan: self.fan.max(other.fan),
            flow: self.flow.max(other.flow),
        }
    }
}

fn largest(curve: &[f32]) -> f32 {
    ends(curve).map(f32::abs).into_iter().fold(0.0, f32::max)
}

/// Heats up, waits, lets the fan blow and stop, and filament flow and stop: the outcome, and the
/// distance from the target at each second.
fn outcome(model: &Model, by: By, deviation: f32, target: f32, second: Option<SecondMass>) -> (Outcome, Vec<f32>) {
    let mut bench = Bench::new(model, deviation);
    bench.load.second = second;
    match by {
        By::Gains(gains) => bench.control.set_gains(model.heater, gains),
        By::Model(found) => bench.control.set_model(model.heater, found),
    }
    bench.control.set_target(model.heater, target);
    let is_nozzle = model.heater == Heater::Nozzle;
    let mut all = bench.follow(target, if is_nozzle { NOZZLE_S } else { BED_S });
    let reached = all.iter().rposition(|off| off.abs() > 1.0).unwrap_or(0);
    let mut outcome = Outcome {
        overshoot: ends(&all)[0].max(0.0),
        reached_s: reached as f32 / SAMPLES_A_S as f32,
        rest: largest(&all[all.len() - 60 * SAMPLES_A_S as usize..]),
        ..Outcome::default()
    };
    if is_nozzle {
        for power in [255, 0] {
            bench.control.set_fan_demand(FanDemand::part(power));
            let part = bench.follow(target, EACH_S);
            outcome.fan = outcome.fan.max(largest(&part));
            all.extend(part);
        }
        for mm_per_s in [FLOW_MM_PER_S, 0.0] {
            bench.load.filament_mm_per_s = mm_per_s;
            let part = bench.follow(target, EACH_S);
            outcome.flow = outcome.flow.max(largest(&part));
            all.extend(part);
        }
    }
    (outcome, all.iter().step_by(SAMPLES_A_S as usize).copied().collect())
}

/// A row of the table.
fn row(name: &str, control: &str, is_nozzle: bool, worst: &Outcome, reached_s: f32) -> String {
    let Outcome { overshoot, rest, fan, flow, .. } = worst;
    let [fan, flow] = [fan, flow].map(|off| if is_nozzle { format!("{off:.2} °C") } else { String::new() });
    format!("| {name} | {control} | {overshoot:.1} °C | {reached_s:.0} s | {rest:.2} °C | {fan} | {flow} |\n")
}

/// The curves of PID and model: heating up, and what fan and flow do.
fn panels(pid: Vec<f32>, model: Vec<f32>, is_nozzle: bool) -> [Panel; 2] {
    let [begins, each] = [NOZZLE_S as usize, EACH_S as usize];
    let up_to = if is_nozzle { begins } else { pid.len() };
    let part = |from: usize, to: usize| {
        let curves = [(GREY, &pid), (RUST, &model)];
        curves.map(|(colour, curve)| (colour, curve.get(from..to).unwrap_or_default().to_vec())).to_vec()
    };
    let marked_s = if is_nozzle { vec![[10, 10 + each], [10 + 2 * each, 10 + 3 * each]] } else { Vec::new() };
    let loads = if is_nozzle { part(begins - 10, pid.len()) } else { Vec::new() };
    [Panel { curves: part(0, up_to), marked_s: Vec::new() }, Panel { curves: loads, marked_s }]
}

/// Five hot ends and three beds, by the gains of M303 and by the constants of M306 T; also with the
/// most noise that the checks are tried with.
#[test]
fn modelled_heaters_keep_what_is_asked_of_tuned_ones() {
    let mut rows = Vec::new();
    let mut constants = String::from(
        "| heater | M306 T takes | C found, of | A found, of | F found, of | lag (1/R) found, of dead time and lag |\n|---|---|---|---|---|---|\n",
    );
    let mut table = String::from(
        "| heater | control | overshoot | within 1 °C after | within, at rest | the fan disturbs by | 15 mm³/s disturb by |\n\
         |---|---|---|---|---|---|---|\n",
    );
    let mut shares = Vec::new();
    for model in &MODELS {
        let is_nozzle = model.heater == Heater::Nozzle;
        for deviation in [1.0, 3.0] {
            let mut bench = Bench::new(model, deviation);
            let found = tune(&mut bench);
            let (findings, _) = Bench::new(model, deviation).tune();
            let by = [By::Gains(gains_by_relay(&findings, model.tuned_at)), By::Model(found)];
            let [pid, modelled] = by.map(|by| {
                let outcomes = model.targets.map(|target| outcome(model, by, deviation, target, None));
                let worst = outcomes.iter().fold(Outcome::default(), |worst, (one, _)| worst.worst(*one));
                let [_, (at_tuned, curve), _] = outcomes;
                (worst, at_tuned.reached_s, curve)
            });
            let what = format!("{} with noise of {deviation}: {:?} with {found:?}", model.name, modelled.0);
            let Outcome { overshoot, rest, fan, flow, .. } = modelled.0;
            assert!(overshoot <= MAX_OVERSHOOT && rest <= STEADY && fan <= MAX_FAN, "{what}");
            assert!(flow <= pid.0.flow + 0.1, "{what}, and {:?} with PID", pid.0);
            if deviation > 1.0 {
                continue;
            }
            if is_nozzle {
                shares.push(flow / pid.0.flow);
            }
            let mass = model.mass;
            let lag_s = mass.dead_time_s + mass.sensor_lag_s;
            let fanned = if is_nozzle {
                format!("{:.3}, {:.3}", found.fanned_loss_w_per_k, mass.loss_w_per_k + mass.fan_loss_w_per_k)
            } else {
                String::new()
            };
            constants += &format!(
                "| {} | {} s | {:.1}, {} J/K | {:.3}, {} W/K | {fanned} | {:.1}, {lag_s:.1} s |\n",
                model.name,
                bench.samples / SAMPLES_A_S,
                found.capacity_j_per_k,
                mass.capacity_j_per_k,
                found.loss_w_per_k,
                mass.loss_w_per_k,
                1.0 / found.sensor_per_s,
            );
            table += &row(model.name, "PID", is_nozzle, &pid.0, pid.1);
            table += &row("", "model", is_nozzle, &modelled.0, modelled.1);
            rows.push(Row { name: model.name, panels: panels(pid.2, modelled.2, is_nozzle) });
        }
    }
    let mean = shares.iter().sum::<f32>() / shares.len() as f32;
    assert!(mean < 0.7, "flow disturbs by {shares:?} of what it does with PID");
    let chart = Chart {
        title: "Degrees from the target, by PID (grey line) and by the model",
        heads: ["heating up", "fan on and off, then 15 mm³/s on and off (grey)"],
        ends: [-2.5, 2.5],
        lines: &[-2.0, -1.0, 0.0, 1.0, 2.0],
    };
    keep("heater-model.svg", &chart::svg(&chart, &rows), &[("modelled", &table), ("constants", &constants)]);
}

/// The model differs from the heater by a fifth in each of its constants, or by a third
/// in the sensor's.
#[test]
fn a_model_may_be_wrong_by_a_fifth() {
    // Ten errors of each model; the first model has all of them in every run.
    let share: Vec<u64> = (0..10).chain(share_of(10 * MODELS.len() as u64)).collect();
    for (number, model) in (0..).zip(&MODELS) {
        let mut cases = (10 * number..).map(|case| share.contains(&case));
        if !share.iter().any(|case| case / 10 == number) {
            continue;
        }
        let found = tune(&mut Bench::new(model, 1.0));
        let wrong = |capacity: f32, loss: f32, sensor: f32, power: f32, filament: f32| HeaterModel {
            power_w: found.power_w * power,
            capacity_j_per_k: found.capacity_j_per_k * capacity,
            loss_w_per_k: found.loss_w_per_k * loss,
            fanned_loss_w_per_k: found.fanned_loss_w_per_k * loss,
            sensor_per_s: found.sensor_per_s * sensor,
            filament_j_per_k_mm: found.filament_j_per_k_mm * filament,
        };
        for wrong in [
            wrong(0.8, 1.0, 1.0, 1.0, 1.0),
            wrong(1.2, 1.0, 1.0, 1.0, 1.0),
            wrong(1.0, 0.8, 1.0, 1.0, 1.0),
            wrong(1.0, 1.2, 1.0, 1.0, 1.0),
            wrong(1.0, 1.0, 0.75, 1.0, 1.0),
            wrong(1.0, 1.0, 1.33, 1.0, 1.0),
            wrong(1.0, 1.0, 1.0, 0.8, 1.0),
            wrong(1.0, 1.0, 1.0, 1.2, 1.0),
            wrong(1.0, 1.0, 1.0, 1.0, 0.8),
            wrong(1.0, 1.0, 1.0, 1.0, 1.2),
        ] {
            if cases.next() == Some(false) {
                continue;
            }
            let (outcome, _) = outcome(model, By::Model(wrong), 1.0, model.tuned_at, None);
            let Outcome { overshoot, rest, fan, .. } = outcome;
            let what = format!("{}: {outcome:?} with {wrong:?}, found was {found:?}", model.name);
            // With a thermistor of 10 s the last of the error takes minutes.
            assert!(overshoot <= MAX_OVERSHOOT && rest <= 1.0 && fan <= MAX_FAN, "{what}");
        }
    }
}

/// Two masses, and a dead time without a lag, or neither: heaters that the model cannot be.
#[test]
fn other_heaters_than_the_models_are_held() {
    for model in &MODELS {
        let capacity_j_per_k = 0.25 * model.mass.capacity_j_per_k;
        let mass = HeatedMass { capacity_j_per_k: 0.75 * model.mass.capacity_j_per_k, ..model.mass };
        let split = Model { mass, ..*model };
        let second = SecondMass { capacity_j_per_k, coupling_w_per_k: capacity_j_per_k / 8.0, celsius: 22.0 };
        let mut bench = Bench::new(&split, 1.0);
        bench.load.second = Some(second);
        let found = tune(&mut bench);
        let (outcome, _) = outcome(&split, By::Model(found), 1.0, model.tuned_at, Some(second));
        let what = format!("{} in two: {outcome:?} with {found:?}", model.name);
        assert!(outcome.overshoot <= MAX_OVERSHOOT && outcome.rest <= STEADY && outcome.fan <= MAX_FAN, "{what}");
    }
    for dead_time_s in [0.0, 2.0, 4.0, 5.6] {
        let mass = HeatedMass { dead_time_s, sensor_lag_s: 0.0, ..MODELS[4].mass };
        let model = Model { mass, ..MODELS[4] };
        let found = tune(&mut Bench::new(&model, 1.0));
        let (outcome, _) = outcome(&model, By::Model(found), 1.0, model.tuned_at, None);
        let what = format!("a dead time of {dead_time_s} s: {outcome:?} with {found:?}");
        assert!(outcome.overshoot <= MAX_OVERSHOOT && outcome.rest <= STEADY, "{what}");
    }
}

/// Each failure at several moments of M306 T: heating up, at the peak, held without the fan and
/// with it. The book has the worst of them.
#[test]
fn failures_trip_while_a_model_is_found() {
    use HeaterFailure::{StuckOn, ThermistorFrozen};
    keep_failures(
        "model_failures",
        ["V6 at 200 °C, 40 W", "aluminium and glass at 70 °C, 220 W"],
        |failure, trips| {
            [(&MODELS[0], [2, 60, 112, 117, 150, 260]), (&MODELS[6], [2, 100, 250, 300, 400, 450])].map(
                |(model, moments_s)| {
                    let mut worst = [0.0_f32; 2];
                    let mut unnoticed = 0;
                    for at_s in moments_s {
                        // Noise would thaw the frozen reading.
                        let mut bench = Bench::new(model, 0.0);
                        begin_step(&mut bench);
                        (0..at_s * SAMPLES_A_S).for_each(|_| bench.sample().unwrap());
                        assert!(
                            !matches!(bench.control.step(model.heater), Some(StepProgress::Found(_))),
                            "{at_s} s is too late"
                        );
                        bench.board.board.set_failure(model.heater, Some(failure));
                        let mut highest = 0.0_f32;
                        let fault = (0..900 * SAMPLES_A_S).find_map(|_| {
                            highest = highest.max(bench.board.board.true_celsius(model.heater));
                            bench.sample().err()
                        });
                        let target = if model.heater == Heater::Nozzle { 200.0 } else { 70.0 };
                        assert!(failure == StuckOn || highest < target + 70.0, "{failure:?} after {at_s} s: {highest}");
                        assert_eq!(bench.board.board.power(model.heater), 0.0, "{failure:?} after {at_s} s");
                        worst[1] = worst[1].max(highest);
                        let Some(fault) = fault else {
                            // A reading that stays the same at the target, with a power that does
                            // so as well, looks like that of a steady heater.
                            assert_eq!(failure, ThermistorFrozen, "{} after {at_s} s", model.name);
                            unnoticed += 1;
                            continue;
                        };
                        assert_eq!(fault.heater, model.heater);
                        assert_eq!(bench.control.step(model.heater), None, "the fault ends it");
                        worst[0] = worst[0].max(bench.samples as f32 / SAMPLES_A_S as f32 - at_s as f32);
                        note(trips, &fault);
                    }
                    let [after_s, highest] = worst;
                    let unnoticed = if unnoticed > 0 { format!("; not in {unnoticed} of 6") } else { String::new() };
                    format!("after {after_s:.1} s, {highest:.0} °C{unnoticed}")
                },
            )
        },
    );
}

#[test]
fn a_target_or_an_end_of_all_heat_ends_the_step() {
    let ends: [fn(&mut HeatControl); 3] = [
        |control| control.set_target(Heater::Nozzle, 0.0),
        |control| control.set_target(Heater::Nozzle, 180.0),
        HeatControl::all_off,
    ];
    for (end, target) in ends.into_iter().zip([0.0, 180.0, 0.0]) {
        let mut bench = Bench::new(&MODELS[0], 0.0);
        begin_step(&mut bench);
        (0..20 * SAMPLES_A_S).for_each(|_| bench.sample().unwrap());
        end(&mut bench.control);
        assert_eq!(bench.control.step(Heater::Nozzle), None);
        assert_eq!(bench.control.status(Heater::Nozzle).target_celsius, target);
        assert_eq!(bench.control.model(Heater::Nozzle), Some(before_tuning(&MODELS[0])), "the model stays");
    }
}

#[test]
fn a_heater_that_does_not_cool_ends_the_step_without_a_model() {
    let mass = HeatedMass { loss_w_per_k: 0.003, ..MODELS[6].mass };
    let model = Model { mass, ..MODELS[6] };
    let mut bench = Bench::new(&model, 0.0);
    begin_step(&mut bench);
    (0..40 * 60 * SAMPLES_A_S).for_each(|_| bench.sample().unwrap());
    assert_eq!(bench.control.step(model.heater), Some(StepProgress::Failed));
    assert_eq!(bench.board.board.power(model.heater), 0.0);
    assert_eq!(bench.control.status(model.heater).target_celsius, 0.0);
}

/// Every model gives a power at any temperature, and no power without a target.
#[test]
fn every_model_gives_a_power() {
    let cooling = model::Cooling { fan_power: 200, filament_mm_per_s: 30.0 };
    for [power_w, capacity_j_per_k, loss_w_per_k, sensor_per_s] in [0, 1].iter().flat_map(|&power| {
        [0, 1].into_iter().flat_map(move |capacity| {
            [0, 1].into_iter().flat_map(move |loss| {
                [0, 1].map(|sensor| {
                    [
                        HeaterModel::POWER_W[power],
                        HeaterModel::CAPACITY_J_PER_K[capacity],
                        HeaterModel::LOSS_W_PER_K[loss],
                        HeaterModel::SENSOR_PER_S[sensor],
                    ]
                    .map(|constant| constant as f32)
                })
            })
        })
    }) {
        let model = HeaterModel {
            power_w,
            capacity_j_per_k,
            loss_w_per_k,
            fanned_loss_w_per_k: loss_w_per_k,
            sensor_per_s,
            filament_j_per_k_mm: 0.1,
        };
        assert!(model.is_possible());
        let mut modelled = model::ModelLoop::new();
        let mut power = 0.0;
        for sample in 0..20_000_u32 {
            let celsius = if sample % 700 < 350 { 20.0 } else { 300.0 };
            let target = if sample % 2000 < 1500 { 210.0 } else { 0.0 };
            power = modelled.power(&model, celsius, target, power, &cooling);
            assert!((0.0..=1.0).contains(&power) && (target > 0.0 || power == 0.0), "{model:?}: {power}");
        }
    }
    for wrong in [f32::NAN, 0.0, -1.0, f32::INFINITY] {
        let sound = before_tuning(&MODELS[0]);
        for model in [
            HeaterModel { power_w: wrong, ..sound },
            HeaterModel { capacity_j_per_k: wrong, ..sound },
            HeaterModel { loss_w_per_k: wrong, ..sound },
            HeaterModel { fanned_loss_w_per_k: wrong, ..sound },
            HeaterModel { sensor_per_s: wrong, ..sound },
        ] {
            assert!(!model.is_possible(), "{model:?}");
        }
    }
}

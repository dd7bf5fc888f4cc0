//! Autotune on models of real hot ends and beds.

use super::*;
use crate::heat::gains_by_relay;

pub(super) struct Model {
    pub name: &'static str,
    pub heater: Heater,
    pub mass: HeatedMass,
    pub tuned_at: f32,
    pub targets: &'static [f32],
}

const fn hot_end(name: &'static str, mass: HeatedMass) -> Model {
    Model { name, heater: Heater::Nozzle, mass, tuned_at: 215.0, targets: &[170.0, 200.0, 215.0, 250.0] }
}

pub(super) const MODELS: [Model; 8] = [
    hot_end("V6", HeatedMass { heater_w: 40.0, capacity_j_per_k: 16.7, loss_w_per_k: 0.068, fan_loss_w_per_k: 0.029, dead_time_s: 0.3, sensor_lag_s: 1.0 / 0.22 }),
    hot_end("Volcano", HeatedMass { heater_w: 60.0, capacity_j_per_k: 22.3, loss_w_per_k: 0.155, fan_loss_w_per_k: 0.0614, dead_time_s: 0.3, sensor_lag_s: 10.0 }),
    hot_end("Revo", HeatedMass { heater_w: 40.0, capacity_j_per_k: 8.77, loss_w_per_k: 1.0 / 25.3, fan_loss_w_per_k: 1.0 / 15.4 - 1.0 / 25.3, dead_time_s: 0.27, sensor_lag_s: 0.27 / 0.15 }),
    hot_end("Dragon", HeatedMass { heater_w: 60.0, capacity_j_per_k: 13.33, loss_w_per_k: 0.1173, fan_loss_w_per_k: 0.0074, dead_time_s: 0.3, sensor_lag_s: 1.0 / 0.3763 }),
    hot_end("MINI", HeatedMass { heater_w: 40.0, capacity_j_per_k: 11.2, loss_w_per_k: 0.074, fan_loss_w_per_k: 0.074, dead_time_s: 1.6, sensor_lag_s: 4.0 }),
    Model { name: "MINI bed", heater: Heater::Bed, tuned_at: 60.0, targets: &[45.0, 60.0, 90.0], mass: HeatedMass { heater_w: 80.0, capacity_j_per_k: 350.0, loss_w_per_k: 0.95, fan_loss_w_per_k: 0.0, dead_time_s: 2.0, sensor_lag_s: 4.0 } },
    Model { name: "glass bed", heater: Heater::Bed, tuned_at: 60.0, targets: &[45.0, 60.0, 90.0], mass: HeatedMass { heater_w: 220.0, capacity_j_per_k: 866.0, loss_w_per_k: 1.3, fan_loss_w_per_k: 0.0, dead_time_s: 3.0, sensor_lag_s: 8.0 } },
    Model { name: "AC bed", heater: Heater::Bed, tuned_at: 60.0, targets: &[45.0, 60.0, 105.0], mass: HeatedMass { heater_w: 750.0, capacity_j_per_k: 2380.0, loss_w_per_k: 2.4, fan_loss_w_per_k: 0.0, dead_time_s: 3.0, sensor_lag_s: 10.0 } },
];

fn rig(model: &Model) -> Rig {
    let mut all = Heater::ALL.map(settings);
    let own = &mut all[model.heater.index()];
    own.mass = model.mass;
    if model.heater == Heater::Nozzle {
        own.max_celsius = 295.0;
    }
    let [nozzle, bed] = all;
    let mut board = VirtualHeaters::new((nozzle.mass, nozzle.thermistor), (bed.mass, bed.thermistor));
    Rig { control: HeatControl::new(nozzle, bed, &mut board), board, samples: 0 }
}

#[test]
fn explore() {
    let var = |name: &str, or: f32| std::env::var(name).map_or(or, |text| text.parse().unwrap());
    let (a, b, c) = (var("KA", 0.6), var("KB", 5.0), var("KC", 1.0));
    for model in &MODELS {
        let heater = model.heater;
        let mut tuned = rig(model);
        tuned.control.begin_relay(heater, model.tuned_at, 5, heater == Heater::Nozzle);
        let mut highest = 0.0_f32;
        let findings = loop {
            tuned.sample().unwrap();
            highest = highest.max(tuned.control.status(heater).celsius);
            match tuned.control.relay(heater).unwrap() {
                RelayProgress::Found(findings) => break findings,
                RelayProgress::Failed => panic!(),
                RelayProgress::Cycles { .. } => {}
            }
        };
        let took = tuned.samples / SAMPLES_A_S;
        let mut gains = gains_by_relay(&findings, model.tuned_at);
        let RelayFindings { slope_per_power, delay_s, .. } = findings;
        gains.proportional = a / (slope_per_power * delay_s);
        gains.integral = gains.proportional / (b * delay_s);
        gains.derivative = gains.proportional * c * delay_s;
        println!("{:9} took {took:4} s, over {:.1}, k {slope_per_power:.3} (true {:.3}) L {delay_s:.2} x {:.3} fan {:.3} cycle {:.1}", model.name, highest - model.tuned_at, model.mass.heater_w / model.mass.capacity_j_per_k, findings.holding_power, findings.fan_power, findings.cycle_s);
        for target in model.targets {
            let mut rig = rig(model);
            rig.control.set_gains(heater, gains);
            rig.control.set_target(heater, *target);
            let (mut over, mut settled, mut near, mut reached) = (-99.0_f32, 0, 0, 0);
            let wait = if heater == Heater::Nozzle { 400 } else { 1500 };
            for second in 0..wait {
                for _ in 0..SAMPLES_A_S {
                    rig.sample().unwrap();
                    let off = rig.control.status(heater).celsius - target;
                    over = over.max(off);
                    if off.abs() > 0.3 { settled = second + 1; }
                    if off.abs() > 1.0 { near = second + 1; }
                    if off > -5.0 && reached == 0 { reached = second; }
                }
            }
            let (mut low, mut high) = (0.0_f32, 0.0_f32);
            if heater == Heater::Nozzle {
                for fan in [255, 0] {
                    rig.control.set_part_fan_power(fan);
                    for _ in 0..200 * SAMPLES_A_S {
                        rig.sample().unwrap();
                        let off = rig.control.status(heater).celsius - target;
                        low = low.min(off);
                        high = high.max(off);
                    }
                }
            }
            println!("    {target}: over {over:+.2}, -5 at {reached} s, within 1: {near} s, 0.3: {settled} s; fan {low:+.2} {high:+.2}");
        }
    }
}

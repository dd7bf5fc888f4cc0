//! Models of hot ends and beds that people have.
//!
//! Masses, losses and thermistor lags are measured figures where any are published, and else those
//! of the parts' masses: 900 J/(kg K) for aluminium, 840 for glass; a plate loses 10 W/(m^2 K) on
//! each side that is open. The dead time of 0.3 s is the cartridge's.

use ferrostep_hal_shim::Heater;
use ferrostep_virtual_board::HeatedMass;

/// A heater and how it is used.
pub struct Model {
    pub name: &'static str,
    pub heater: Heater,
    pub mass: HeatedMass,
    /// The target of M303, degrees Celsius.
    pub tuned_at: f32,
    /// Targets with the gains that it finds.
    pub targets: [f32; 3],
}

const fn hot_end(name: &'static str, mass: HeatedMass) -> Model {
    Model { name, heater: Heater::Nozzle, mass, tuned_at: 215.0, targets: [180.0, 215.0, 250.0] }
}

const fn bed(name: &'static str, mass: HeatedMass) -> Model {
    Model { name, heater: Heater::Bed, mass, tuned_at: 60.0, targets: [45.0, 60.0, 90.0] }
}

pub const MODELS: [Model; 8] = [
    // Marlin's MPC defaults (Configuration.h): 16.7 J/K, 0.068 and 0.097 W/K, sensor
    // 0.22 K/s for each K.
    hot_end(
        "V6, 40 W",
        HeatedMass {
            heater_w: 40.0,
            capacity_j_per_k: 16.7,
            loss_w_per_k: 0.068,
            fan_loss_w_per_k: 0.029,
            dead_time_s: 0.3,
            sensor_lag_s: 4.5,
        },
    ),
    // The example of Kalico's page on MPC, whose block is of a Volcano's size: 22.31 J/K, 0.155 and
    // 0.216 W/K, sensor 0.0999.
    hot_end(
        "Volcano, 60 W",
        HeatedMass {
            heater_w: 60.0,
            capacity_j_per_k: 22.3,
            loss_w_per_k: 0.155,
            fan_loss_w_per_k: 0.061,
            dead_time_s: 0.3,
            sensor_lag_s: 10.0,
        },
    ),
    // Prusa-Firmware, thermal_model/e3d_REVO.h: 8.77 J/K, 25.3 K/W, 15.4 K/W with the fan, a lag of
    // 0.27 s and a filter of 0.15 at every 0.27 s.
    hot_end(
        "Revo, 40 W",
        HeatedMass {
            heater_w: 40.0,
            capacity_j_per_k: 8.77,
            loss_w_per_k: 0.0395,
            fan_loss_w_per_k: 0.0254,
            dead_time_s: 0.27,
            sensor_lag_s: 1.8,
        },
    ),
    // A copper block of a V6's outline with a strong heater, as the Dragon: an estimate, 13.3
    // J/K, 0.117 W/K bare.
    hot_end(
        "copper block (Dragon), 60 W",
        HeatedMass {
            heater_w: 60.0,
            capacity_j_per_k: 13.3,
            loss_w_per_k: 0.117,
            fan_loss_w_per_k: 0.03,
            dead_time_s: 0.3,
            sensor_lag_s: 2.7,
        },
    ),
    // The profile prusa-mini.toml (its sources are there), with Buddy's 5.6 s in all as a dead time
    // and the thermistor's lag.
    hot_end(
        "MINI, 40 W",
        HeatedMass {
            heater_w: 40.0,
            capacity_j_per_k: 11.2,
            loss_w_per_k: 0.074,
            fan_loss_w_per_k: 0.074,
            dead_time_s: 1.6,
            sensor_lag_s: 4.0,
        },
    ),
    // prusa-mini.toml again.
    bed(
        "MINI's bed, 80 W",
        HeatedMass {
            heater_w: 80.0,
            capacity_j_per_k: 350.0,
            loss_w_per_k: 0.95,
            fan_loss_w_per_k: 0.0,
            dead_time_s: 2.0,
            sensor_lag_s: 4.0,
        },
    ),
    // 235 x 235 mm: 3 mm of aluminium and 4 mm of glass, open on both sides.
    bed(
        "aluminium and glass, 220 W",
        HeatedMass {
            heater_w: 220.0,
            capacity_j_per_k: 866.0,
            loss_w_per_k: 1.1,
            fan_loss_w_per_k: 0.0,
            dead_time_s: 3.0,
            sensor_lag_s: 8.0,
        },
    ),
    // 350 x 350 mm: 8 mm of aluminium over a pad on the mains, as large CoreXY machines have.
    bed(
        "8 mm of aluminium, 750 W",
        HeatedMass {
            heater_w: 750.0,
            capacity_j_per_k: 2380.0,
            loss_w_per_k: 2.4,
            fan_loss_w_per_k: 0.0,
            dead_time_s: 3.0,
            sensor_lag_s: 10.0,
        },
    ),
];

//! The settings of heaters' models.

use ferrostep_hal_shim::Heater;

use super::{Group, setting};
use crate::heat::model::HeaterModel;
use crate::settings::stored::values::{Parts, Place};

impl<M: Parts> Group<M> {
    /// Settings of the heaters' models.
    pub(super) const OF_MODELS: &'static [Self] = &[
        Self {
            code: "M306 E0",
            heading: "echo:; Model predictive control:",
            axes: None,
            settings: &[
                setting("nozzle.control_model.power_w", "P", HeaterModel::POWER_W, |values, _| {
                    values.model_of(Heater::Nozzle).map(|model| Place::Single(&mut model.power_w))
                }),
                setting("nozzle.control_model.capacity_j_per_k", "C", HeaterModel::CAPACITY_J_PER_K, |values, _| {
                    values.model_of(Heater::Nozzle).map(|model| Place::Single(&mut model.capacity_j_per_k))
                }),
                setting("nozzle.control_model.sensor_per_s", "R", HeaterModel::SENSOR_PER_S, |values, _| {
                    values.model_of(Heater::Nozzle).map(|model| Place::Single(&mut model.sensor_per_s))
                }),
                setting("nozzle.control_model.loss_w_per_k", "A", HeaterModel::LOSS_W_PER_K, |values, _| {
                    values.model_of(Heater::Nozzle).map(|model| Place::Single(&mut model.loss_w_per_k))
                }),
                setting("nozzle.control_model.fanned_loss_w_per_k", "F", HeaterModel::LOSS_W_PER_K, |values, _| {
                    values.model_of(Heater::Nozzle).map(|model| Place::Single(&mut model.fanned_loss_w_per_k))
                }),
                setting(
                    "nozzle.control_model.filament_j_per_k_mm",
                    "H",
                    HeaterModel::FILAMENT_J_PER_K_MM,
                    |values, _| {
                        values.model_of(Heater::Nozzle).map(|model| Place::Single(&mut model.filament_j_per_k_mm))
                    },
                ),
            ],
        },
        Self {
            code: "M306 E-1",
            heading: "echo:; Model predictive control of the bed:",
            axes: None,
            settings: &[
                setting("bed.control_model.power_w", "P", HeaterModel::POWER_W, |values, _| {
                    values.model_of(Heater::Bed).map(|model| Place::Single(&mut model.power_w))
                }),
                setting("bed.control_model.capacity_j_per_k", "C", HeaterModel::CAPACITY_J_PER_K, |values, _| {
                    values.model_of(Heater::Bed).map(|model| Place::Single(&mut model.capacity_j_per_k))
                }),
                setting("bed.control_model.sensor_per_s", "R", HeaterModel::SENSOR_PER_S, |values, _| {
                    values.model_of(Heater::Bed).map(|model| Place::Single(&mut model.sensor_per_s))
                }),
                setting("bed.control_model.loss_w_per_k", "A", HeaterModel::LOSS_W_PER_K, |values, _| {
                    values.model_of(Heater::Bed).map(|model| Place::Single(&mut model.loss_w_per_k))
                }),
            ],
        },
    ];

    /// The model of the second tool's heater.
    pub(super) const OF_TOOL_MODELS: &'static [Self] = &[Self {
        code: "M306 E1",
        heading: "echo:; Model predictive control of T1:",
        axes: None,
        settings: &[
            setting("tools.t1.nozzle.control_model.power_w", "P", HeaterModel::POWER_W, |values, _| {
                Some(Place::Single(&mut values.tool()?.model.as_mut()?.power_w))
            }),
            setting(
                "tools.t1.nozzle.control_model.capacity_j_per_k",
                "C",
                HeaterModel::CAPACITY_J_PER_K,
                |values, _| Some(Place::Single(&mut values.tool()?.model.as_mut()?.capacity_j_per_k)),
            ),
            setting("tools.t1.nozzle.control_model.sensor_per_s", "R", HeaterModel::SENSOR_PER_S, |values, _| {
                Some(Place::Single(&mut values.tool()?.model.as_mut()?.sensor_per_s))
            }),
            setting("tools.t1.nozzle.control_model.loss_w_per_k", "A", HeaterModel::LOSS_W_PER_K, |values, _| {
                Some(Place::Single(&mut values.tool()?.model.as_mut()?.loss_w_per_k))
            }),
            setting(
                "tools.t1.nozzle.control_model.fanned_loss_w_per_k",
                "F",
                HeaterModel::LOSS_W_PER_K,
                |values, _| Some(Place::Single(&mut values.tool()?.model.as_mut()?.fanned_loss_w_per_k)),
            ),
            setting(
                "tools.t1.nozzle.control_model.filament_j_per_k_mm",
                "H",
                HeaterModel::FILAMENT_J_PER_K_MM,
                |values, _| Some(Place::Single(&mut values.tool()?.model.as_mut()?.filament_j_per_k_mm)),
            ),
        ],
    }];
}

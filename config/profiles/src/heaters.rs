//! Range, control and checks of the heaters, and their models on the virtual board.

use ferrostep_checked_toml::{Field, Range, Section, range};
use ferrostep_hal_shim::SpareConnector;
use ferrostep_printer::{ChamberSettings, HeaterModel, HeaterSettings, HeaterWatch, PidGains};
use ferrostep_thermistor::{Thermistor, ThermistorType};
use ferrostep_virtual_board::HeatedMass;

const HEATER_MIN: Range = range(-50.0, 50.0, "degrees Celsius");
const NOZZLE_MAX: Range = range(60.0, 500.0, "degrees Celsius");
const BED_MAX: Range = range(60.0, 200.0, "degrees Celsius");
const CHAMBER_MAX: Range = range(50.0, 150.0, "degrees Celsius");
const PROPORTIONAL: Range = gain(PidGains::PROPORTIONAL, "per degree");
const INTEGRAL: Range = gain(PidGains::INTEGRAL, "per degree and second");
const DERIVATIVE: Range = gain(PidGains::DERIVATIVE, "seconds per degree");
const FAN: Range = gain(PidGains::FAN, "per degree");
const MODEL_POWER: Range = gain(HeaterModel::POWER_W, "W");
const MODEL_CAPACITY: Range = gain(HeaterModel::CAPACITY_J_PER_K, "J/K");
const MODEL_LOSS: Range = gain(HeaterModel::LOSS_W_PER_K, "W/K");
const MODEL_SENSOR: Range = gain(HeaterModel::SENSOR_PER_S, "1/s");
const MODEL_FILAMENT: Range = gain(HeaterModel::FILAMENT_J_PER_K_MM, "J/K for each mm");
const RESIDENCY_WINDOW: Range = range(0.1, 20.0, "degrees");
const RESIDENCY: Range = range(0.0, 600.0, "s");
const R25: Range = range(1_000.0, 1_000_000.0, "ohms");
const BETA: Range = range(2_000.0, 6_000.0, "K");
const POINT_CELSIUS: Range = range(-50.0, 500.0, "degrees Celsius");
const POINT_OHM: Range = range(1.0, 10_000_000.0, "ohms");
const PULL_UP: Range = range(100.0, 100_000.0, "ohms");
// Long times and small rises would let a failed heater go unnoticed until something melts; short
// times and large rises trip on a sound one. A weak bed gains a degree a minute, and melts
// nothing in five.
const WATCH: Range = range(5.0, 120.0, "s");
const BED_WATCH: Range = range(5.0, 300.0, "s");
const WATCH_RISE: Range = range(1.0, 20.0, "degrees");
// A chamber gains a degree in minutes, and its door is opened.
const CHAMBER_WATCH: Range = range(30.0, 1_200.0, "s");
const RUNAWAY: Range = range(5.0, 120.0, "s");
const CHAMBER_RUNAWAY: Range = range(5.0, 1_200.0, "s");
const RUNAWAY_HYSTERESIS: Range = range(1.0, 20.0, "degrees");
const BED_RUNAWAY_HYSTERESIS: Range = range(1.0, 30.0, "degrees");
const POWER: Range = range(1.0, 3_000.0, "W");
const CAPACITY: Range = range(1.0, 20_000.0, "J/K");
const LOSS: Range = range(0.001, 100.0, "W/K");
const FAN_LOSS: Range = range(0.0, 100.0, "W/K");
const DEAD_TIME: Range = range(0.0, 30.0, "s");

const fn gain([low, high]: [f64; 2], unit: &'static str) -> Range {
    range(low, high, unit)
}

/// Differences between the heaters of nozzle, bed and chamber.
struct Kind<'a> {
    max_celsius: Range,
    watch_s: Range,
    runaway_s: Range,
    hysteresis: Range,
    /// Default where the profile has no keys for it.
    watch: HeaterWatch,
    mass: HeatedMass,
    mass_in_words: &'static str,
    /// Default where the profile has no keys for it; `None` if it must have them.
    control: Option<Control>,
    /// Another heater, whose values replace missing keys.
    base: Option<&'a HeaterSettings>,
}

/// Control of a heater, and the window around its target within which it counts as near.
struct Control {
    gains: PidGains,
    window_celsius: f64,
    residency_s: f64,
}

/// Text for a key whose default is that of the first nozzle.
const OF_FIRST: &str = "as `nozzle`";

const FAN_GAIN: &str = "power lost to the part-cooling fan, per degree between 25 °C and the target (M303)";

/// A value of single precision as it was written.
fn shortest(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::from(value))
}

const NOZZLE: Kind<'static> = Kind {
    base: None,
    max_celsius: NOZZLE_MAX,
    watch_s: WATCH,
    runaway_s: RUNAWAY,
    hysteresis: RUNAWAY_HYSTERESIS,
    watch: HeaterWatch::NOZZLE,
    mass: HeatedMass::NOZZLE,
    mass_in_words: "40 W on 12 J/K",
    control: None,
};

const BED: Kind<'static> = Kind {
    base: None,
    max_celsius: BED_MAX,
    watch_s: BED_WATCH,
    runaway_s: RUNAWAY,
    hysteresis: BED_RUNAWAY_HYSTERESIS,
    watch: HeaterWatch::BED,
    mass: HeatedMass::BED,
    mass_in_words: "250 W on 500 J/K",
    control: None,
};

const CHAMBER: Kind<'static> = Kind {
    base: None,
    max_celsius: CHAMBER_MAX,
    watch_s: CHAMBER_WATCH,
    runaway_s: CHAMBER_RUNAWAY,
    hysteresis: BED_RUNAWAY_HYSTERESIS,
    watch: HeaterWatch::CHAMBER,
    mass: HeatedMass::CHAMBER,
    mass_in_words: "200 W on 4000 J/K, and what the bed loses",
    // Full power up to 2 degrees below the target: air is slow.
    control: Some(Control {
        gains: PidGains { proportional: 0.5, integral: 0.001, derivative: 0.0, fan: 0.0 },
        window_celsius: 2.0,
        residency_s: 10.0,
    }),
};

/// The chamber, if its temperature is known.
pub(crate) fn chamber(keys: &Section<'_>) -> Option<ChamberSettings> {
    let table = keys.optional_section(
        "chamber",
        "no chamber sensor",
        "the chamber around the printer: [M141 and M191](heaters.md#a-chamber)",
    )?;
    let names = |connectors: [SpareConnector; 3]| connectors.map(|connector| (connector.name(), connector));
    let thermistor = table
        .word("thermistor", SpareConnector::THERMISTORS.map(|connector| (connector.name(), connector)))
        .required("board input of the thermistor");
    let heater = table
        .word("heater", names(SpareConnector::HEATERS))
        .optional("no heater: the bed warms it", "board output of the heater");
    let mut settings = heater_of(&table, "chamber", &CHAMBER);
    settings.is_heated = heater.is_some();
    settings.is_warmed_by_others = true;
    Some(ChamberSettings { thermistor, heater, settings })
}

/// The nozzle of a further tool, and the model that controls it if one does: T0's values
/// replace missing keys.
pub(crate) fn further_nozzle(table: &Section<'_>, first: &HeaterSettings) -> (HeaterSettings, Option<HeaterModel>) {
    const NAME: &str = "tools.t1.nozzle";
    let kind = Kind { watch: first.watch, mass: first.mass, base: Some(first), ..NOZZLE };
    (heater_of(table, NAME, &kind), control_model(&table.apart(), NAME))
}

/// Nozzle and bed, each with the model that controls it if one does.
pub(crate) fn heaters(keys: &Section<'_>) -> [(HeaterSettings, Option<HeaterModel>); 2] {
    [("nozzle", NOZZLE), ("bed", BED)].map(|(name, kind)| {
        let table = keys.section(name, "");
        (heater_of(&table, name, &kind), control_model(&table.apart(), name))
    })
}

/// The model that controls a heater.
fn control_model(heater: &Section<'_>, name: &str) -> Option<HeaterModel> {
    let about = "a [model](heaters.md#control-by-a-model) controls the heater instead of the PID loop, whose gains \
                 have no effect: M306 T finds all but `power_w` and `filament_j_per_k_mm`";
    let model = heater.optional_section("control_model", "PID control", about)?;
    let power_w = model.number("power_w", MODEL_POWER).required("heater power at full output") as f32;
    let capacity_j_per_k =
        model.number("capacity_j_per_k", MODEL_CAPACITY).required("heat capacity of what is heated") as f32;
    let loss = model.number("loss_w_per_k", MODEL_LOSS).required("heat loss to still air");
    let sensor_per_s = model
        .number("sensor_per_s", MODEL_SENSOR)
        .required("response of the thermistor: one over its time constant") as f32;
    let fanned = model
        .number("fanned_loss_w_per_k", MODEL_LOSS.at_least(loss, "at least loss_w_per_k"))
        .optional("`loss_w_per_k`", "heat loss of the nozzle with the part-cooling fan at full power");
    let filament = model
        .number("filament_j_per_k_mm", MODEL_FILAMENT)
        .optional("0.0054, PLA of 1.75 mm", "heat that each millimetre of filament takes from the nozzle");
    if name == "bed" {
        for (key, value) in [("fanned_loss_w_per_k", fanned), ("filament_j_per_k_mm", filament)] {
            if value.is_some() {
                model.refuse(key, "no such key: neither fan nor filament cools the bed");
            }
        }
    }
    let fanned = fanned.unwrap_or(loss);
    let filament = filament.unwrap_or(if name == "bed" { 0.0 } else { HeaterModel::PLA_J_PER_K_MM });
    Some(HeaterModel {
        power_w,
        capacity_j_per_k,
        loss_w_per_k: loss as f32,
        fanned_loss_w_per_k: fanned as f32,
        sensor_per_s,
        filament_j_per_k_mm: filament as f32,
    })
}

fn heater_of(table: &Section<'_>, name: &'static str, kind: &Kind<'_>) -> HeaterSettings {
    let apart = table.apart();
    let thermistor = thermistor(&apart, kind.base.map(|base| &base.thermistor));
    // The other heater's value, or a required key.
    let or_base = |field: Field<'_, f64>, base: Option<f64>, about: &'static str| match base {
        Some(base) => field.optional(OF_FIRST, about).unwrap_or(base),
        None => field.required(about),
    };
    let min_celsius = or_base(
        apart.number("min_celsius", HEATER_MIN),
        kind.base.map(|base| base.min_celsius.into()),
        "below this all heaters are switched off; within what `sensor` can read",
    ) as f32;
    let max_celsius = or_base(
        table.number("max_celsius", kind.max_celsius),
        kind.base.map(|base| base.max_celsius.into()),
        "at or above this all heaters are switched off; within what `sensor` can read",
    ) as f32;
    for (key, celsius) in [("min_celsius", min_celsius), ("max_celsius", max_celsius)] {
        if !thermistor.can_tell(celsius) {
            let [lowest, highest] = readable_celsius(&thermistor);
            let expected = format!(
                "{lowest} to {highest} degrees Celsius, what {name}.sensor can read with pull_up_ohm = {}",
                thermistor.pull_up_ohm
            );
            table.refuse(key, expected);
        }
    }
    let target = range(HEATER_MIN.high, kind.max_celsius.high, "degrees Celsius");
    let max_target_celsius = apart
        .number("max_target_celsius", target.at_most(max_celsius.into(), "at most max_celsius"))
        .optional("`max_celsius`", "maximum target: higher ones are refused (M104, M140, M141)");
    let watch = watch(&apart, kind);
    let or = |field: Field<'_, f64>, default: Option<f64>, base: Option<f64>, about: &'static str| match default {
        Some(default) => field.or(default, about),
        None => or_base(field, base, about),
    };
    let residency_window_celsius = or(
        apart.number("residency_window_celsius", RESIDENCY_WINDOW),
        kind.control.as_ref().map(|control| control.window_celsius),
        kind.base.map(|base| shortest(base.residency_window_celsius)),
        "M109 (M190, M191) waits until the temperature has stayed this near the target; at most `runaway_celsius`",
    ) as f32;
    let residency_s = or(
        apart.number("residency_s", RESIDENCY),
        kind.control.as_ref().map(|control| control.residency_s),
        kind.base.map(|base| f64::from(base.residency_ms) / 1e3),
        "time that the temperature must stay near the target",
    );
    if residency_window_celsius > watch.runaway_celsius {
        // M109 would take a runaway for the reached target.
        let expected = format!("at most {name}.runaway_celsius = {}", watch.runaway_celsius);
        table.refuse("residency_window_celsius", expected);
    }
    HeaterSettings {
        thermistor,
        min_celsius,
        max_celsius,
        max_target_celsius: max_target_celsius.map_or(max_celsius, |celsius| celsius as f32),
        watch,
        gains: gains(&apart, kind),
        residency_window_celsius,
        residency_ms: milliseconds(residency_s),
        mass: mass(&apart, kind),
        is_heated: true,
        is_warmed_by_others: false,
    }
}

/// The number that a person would write for this one: 0.001 rather than 0.0010000000474974513.
fn decimal(number: f32) -> f64 {
    number.to_string().parse().unwrap_or(number.into())
}

/// The gains of a heater's control loop.
fn gains(heater: &Section<'_>, kind: &Kind<'_>) -> PidGains {
    let gain = |key, range, about: &'static str, default: fn(&PidGains) -> f32| {
        let field = heater.number(key, range);
        match (&kind.control, kind.base) {
            (Some(control), _) => field.or(decimal(default(&control.gains)), about) as f32,
            (None, Some(base)) => field.optional(OF_FIRST, about).map_or(default(&base.gains), |gain| gain as f32),
            (None, None) => field.required(about) as f32,
        }
    };
    PidGains {
        proportional: gain(
            "proportional",
            PROPORTIONAL,
            "proportional PID gain, for power from 0 to 1 (M303)",
            |gains| gains.proportional,
        ),
        integral: gain("integral", INTEGRAL, "PID gain (M303)", |gains| gains.integral),
        derivative: gain("derivative", DERIVATIVE, "PID gain (M303)", |gains| gains.derivative),
        fan: match kind.base {
            Some(base) => {
                heater.number("fan_gain", FAN).optional(OF_FIRST, FAN_GAIN).map_or(base.gains.fan, |gain| gain as f32)
            }
            None => heater.number("fan_gain", FAN).or(0.0, FAN_GAIN) as f32,
        },
    }
}

/// Heated mass of the virtual board's heater.
fn mass(heater: &Section<'_>, kind: &Kind<'_>) -> HeatedMass {
    let about = "thermal model of the heater, for the [virtual board](virtual-board.md) only";
    let Some(model) = heater.optional_section("model", kind.mass_in_words, about) else { return kind.mass };
    HeatedMass {
        heater_w: model.number("power_w", POWER).required("") as f32,
        capacity_j_per_k: model.number("capacity_j_per_k", CAPACITY).required("") as f32,
        loss_w_per_k: model.number("loss_w_per_k", LOSS).required("heat loss to the air") as f32,
        fan_loss_w_per_k: model
            .number("fan_loss_w_per_k", FAN_LOSS)
            .or(0.0, "additional heat loss with the part-cooling fan at full power") as f32,
        dead_time_s: model
            .number("dead_time_s", DEAD_TIME)
            .or(0.0, "delay from a change of power to the temperature's response") as f32,
        sensor_lag_s: model.number("sensor_lag_s", DEAD_TIME).or(0.0, "time constant of the thermistor") as f32,
    }
}

/// Thermistor that measures a heater.
fn thermistor(heater: &Section<'_>, base: Option<&Thermistor>) -> Thermistor {
    let named = [
        ("semitec-104gt-2", ThermistorType::Semitec104Gt2),
        // EPCOS B57560G104F.
        ("epcos-100k", ThermistorType::Epcos100k),
        ("pt1000", ThermistorType::Pt1000),
    ];
    let field = heater.word_or_section("sensor", named, "{ r25_ohm = 100000, beta_k = 3950 }", by_data_sheet);
    let about = "the sensor ([below](#thermistors))";
    let kind = match base {
        Some(base) => field.optional(OF_FIRST, about).unwrap_or(base.kind),
        None => field.required(about),
    };
    let field = heater.number("pull_up_ohm", PULL_UP);
    let about = "pull-up resistor from the sensor to the reference voltage";
    let pull_up_ohm = match base {
        Some(base) => field.optional(OF_FIRST, about).map_or(base.pull_up_ohm, |ohm| ohm as f32),
        None => field.or(Thermistor::USUAL_PULL_UP_OHM.into(), about) as f32,
    };
    Thermistor { kind, pull_up_ohm }
}

/// A thermistor by numbers of its data sheet: three points, or a resistance and beta.
fn by_data_sheet(sheet: &Section<'_>) -> ThermistorType {
    let celsius = sheet
        .several("celsius", POINT_CELSIUS, "[25, 150, 250]")
        .optional("`r25_ohm` and `beta_k`", "three rising temperatures that span the heater's use");
    let ohm = sheet
        .several("ohm", POINT_OHM, "[100000, 1642, 226.2]")
        .optional("`r25_ohm` and `beta_k`", "resistances at these temperatures");
    let other = match (celsius, ohm) {
        (None, None) => {
            return ThermistorType::Beta {
                r25_ohm: sheet.number("r25_ohm", R25).required("resistance at 25 °C, with `beta_k`") as f32,
                beta_k: sheet.number("beta_k", BETA).required("beta from the data sheet") as f32,
            };
        }
        (Some(celsius), Some(ohm)) if celsius.is_sorted_by(|lower, upper| lower < upper) => {
            if let Some(kind) = ThermistorType::through(celsius, ohm) {
                return kind;
            }
            let expected = "three resistances that fall as a thermistor's do; or r25_ohm and beta_k";
            ("ohm", expected)
        }
        (Some(_), Some(_)) => ("celsius", "three rising temperatures"),
        (None, Some(_)) => ("ohm", "celsius with it: three temperatures, such as [25, 150, 250]"),
        (Some(_), None) => ("celsius", "ohm with it: three resistances, such as [100000, 1642, 226.2]"),
    };
    sheet.refuse(other.0, other.1);
    ThermistorType::Epcos100k
}

/// The lowest and the highest whole degree that a thermistor can read; the range has no gaps.
fn readable_celsius(thermistor: &Thermistor) -> [i16; 2] {
    let mut readable = (-100..=500_i16).filter(|celsius| thermistor.can_tell(f32::from(*celsius)));
    let lowest = readable.next().unwrap_or_default();
    [lowest, readable.next_back().unwrap_or(lowest)]
}

/// Limits at which a heater counts as failed.
fn watch(heater: &Section<'_>, kind: &Kind<'_>) -> HeaterWatch {
    let default = &kind.watch;
    let seconds = |milliseconds: u32| f64::from(milliseconds) / 1e3;
    HeaterWatch {
        watch_ms: milliseconds(
            heater
                .number("watch_s", kind.watch_s)
                .or(seconds(default.watch_ms), "time in which the temperature must rise while heating up ..."),
        ),
        watch_celsius: heater.number("watch_celsius", WATCH_RISE).or(default.watch_celsius.into(), "... by this amount")
            as f32,
        runaway_ms: milliseconds(heater.number("runaway_s", kind.runaway_s).or(
            seconds(default.runaway_ms),
            "maximum time, once the target is reached, that the temperature may be ...",
        )),
        runaway_celsius: heater.number("runaway_celsius", kind.hysteresis).or(
            default.runaway_celsius.into(),
            "... farther below it than this; [less for low targets](safety.md#what-is-watched)",
        ) as f32,
    }
}

fn milliseconds(seconds: f64) -> u32 {
    (seconds * 1e3).round() as u32
}

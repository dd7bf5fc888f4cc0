//! Several tools on one carriage.

use ferrostep_checked_toml::{Range, Section, range};
use ferrostep_hal_shim::SpareConnector;
use ferrostep_planner::{PressureAdvance, StepsPerMm};
use ferrostep_printer::{
    FanRule, FanSettings, FanTable, FurtherTool, HeaterSettings, Kept, MAX_TOOLS, ToolChange, ToolHeater, Tools,
    ZMotors,
};

use crate::axes::units_10nm;
use crate::macros::A_MACRO;
use crate::z_motors::SOCKETS;
use crate::{drivers, heaters, motion};

const OFFSET: Range = range(-200.0, 200.0, "mm");
const STEPS: Range = range(1.0, 10_000.0, "steps/mm");
const LIFT: Range = range(0.0, 50.0, "mm");
const TRAVEL: Range = range(1.0, 1_000.0, "mm/s");
const FILAMENT: Range = range(0.0, 200.0, "mm");
const FILAMENT_SPEED: Range = range(0.1, 200.0, "mm/s");

/// The names of the further tools' tables.
const TABLES: [&str; MAX_TOOLS - 1] = ["t1"];

/// Defaults of a further tool, from the first one.
pub(crate) struct First<'a> {
    pub steps_per_mm: f64,
    /// The most steps a millimetre that an extruder's motor can make at its largest feed.
    pub most_steps_per_mm: f64,
    pub advance: PressureAdvance,
    pub nozzle: &'a HeaterSettings,
    pub fans: &'a FanTable,
    pub z_motors: Option<Kept<ZMotors>>,
    /// True if both edges of the signal step.
    pub both_edges: bool,
    /// The chamber's connectors.
    pub chamber: [Option<SpareConnector>; 2],
}

/// The tools beside T0.
pub(crate) fn tools(keys: &Section<'_>, first: &First<'_>) -> Option<Kept<Tools>> {
    let table = keys.optional_section(
        "tools",
        "one tool",
        "[several extruders](tools.md) on one carriage: T0 is what the rest of the profile describes",
    )?;
    let length = |key, range, default, about| units_10nm(table.number(key, range).or(default, about));
    let change = ToolChange {
        lift_10nm: length(
            "lift_mm",
            LIFT,
            1.0,
            "height the nozzle is raised before a tool change, plus the amount by which the new one is lower",
        ),
        travel_10nm_per_s: length(
            "travel_mm_per_s",
            TRAVEL,
            100.0,
            "travel speed of the new nozzle to the old one's place",
        ),
        retract_10nm: length(
            "retract_mm",
            FILAMENT,
            0.0,
            "filament retracted when a tool is deselected, if it is hot enough",
        ),
        retract_10nm_per_s: length("retract_mm_per_s", FILAMENT_SPEED, 40.0, "retraction speed"),
        prime_10nm: length(
            "prime_mm",
            FILAMENT,
            0.0,
            "filament primed when a tool is selected, beyond the length retracted",
        ),
        prime_10nm_per_s: length("prime_mm_per_s", FILAMENT_SPEED, 20.0, "speed of recovery and priming"),
        before: name_of_macro(&table, "before_change", "[macro](tools.md#macros-at-a-change) run before a tool change"),
        after: name_of_macro(&table, "after_change", "macro run after a tool change"),
    };
    let mut further = [None; MAX_TOOLS - 1];
    for (tool, name) in further.iter_mut().zip(TABLES) {
        *tool = Some(further_tool(&table.section(name, "the second tool, T1"), name, first));
    }
    // A profile is leaked: its parts are `'static`.
    Some(Kept(Box::leak(Box::new(Tools { further, change }))))
}

/// The name of a macro, leaked as all texts of a profile are. [`macros`](crate::macros) checks it.
fn name_of_macro(table: &Section<'_>, key: &'static str, about: &'static str) -> Option<&'static str> {
    let name = table.text(key, A_MACRO, |name| !name.is_empty()).optional("none", about)?;
    Some(Box::leak(name.into_boxed_str()))
}

fn further_tool(table: &Section<'_>, name: &'static str, first: &First<'_>) -> FurtherTool {
    let socket =
        table.word("motor", SOCKETS.map(|socket| (socket, socket))).required("board socket of its extruder motor");
    let lifts_z = |motors: Kept<ZMotors>| motors.0.further.iter().flatten().any(|motor| motor.socket == socket);
    if first.z_motors.is_some_and(lifts_z) {
        table.refuse("motor", format!("another socket: {socket} is one of z_motors.motors"));
    }
    let is_inverted = table.flag("inverted").or(false, "direction of that motor is inverted");
    let offset_mm = table
        .numbers("offset_mm", ["x", "y", "z"], [OFFSET; 3])
        .required("offset from T0's nozzle to this one: positive to the right, back and upwards (M218)");
    let steps_per_mm = table
        .number("steps_per_mm", STEPS)
        .optional("`steps_per_mm.e`", "steps/mm of its motor (M92 T1 E)")
        .unwrap_or(first.steps_per_mm);
    if steps_per_mm > first.most_steps_per_mm {
        let most = first.most_steps_per_mm.floor();
        table.refuse(
            "steps_per_mm",
            format!("at most {most} steps/mm at max_feed_mm_per_s.e: lower that, or take fewer microsteps"),
        );
    }
    let driver = drivers::driver(table, name, steps_per_mm, first.both_edges);
    FurtherTool {
        socket,
        is_inverted,
        offset_10nm: offset_mm.map(units_10nm),
        steps_per_mm: StepsPerMm::nearest(steps_per_mm),
        advance: motion::pressure_advance(table, "that of T0").unwrap_or(first.advance),
        driver,
        heater: heater(table, first),
        fan: fan(table, first.fans),
    }
}

/// The tool's own heater, with its nozzle's settings; `None` if it shares T0's nozzle.
fn heater(table: &Section<'_>, first: &First<'_>) -> Option<ToolHeater> {
    let named = |connector: SpareConnector| (connector.name(), connector);
    let heater = table
        .word("heater", SpareConnector::HEATERS.map(named))
        .optional("T0's nozzle is shared", "the board's output for the heater of a separate nozzle");
    let thermistor = table
        .word("thermistor", SpareConnector::THERMISTORS.map(named))
        .optional("that of `heater`", "the board's input for its thermistor");
    let about = "only with `heater`; keys left out are as there, except `max_target_celsius` and `control_model`";
    let settings =
        table.optional_section("nozzle", "as T0's", about).map(|keys| heaters::further_nozzle(&keys, first.nozzle));
    let Some(heater) = heater else {
        if thermistor.is_some() {
            table.refuse("thermistor", "heater in the same table");
        }
        if settings.is_some() {
            table.refuse("nozzle", "heater in the same table");
        }
        return None;
    };
    let thermistor = thermistor.unwrap_or(heater);
    for (key, connector) in [("heater", heater), ("thermistor", thermistor)] {
        let [of_thermistor, of_heater] = first.chamber;
        let taken = if key == "heater" { of_heater } else { of_thermistor };
        if taken == Some(connector) {
            table.refuse(key, format!("another one: {} is the chamber's", connector.name()));
        }
    }
    let (settings, control_model) = settings.unwrap_or((*first.nozzle, None));
    Some(ToolHeater { heater, thermistor, settings, control_model })
}

/// The fan that blows at the tool's part.
fn fan(table: &Section<'_>, fans: &FanTable) -> Option<u8> {
    let name = table
        .text("part_fan", "the name of a fan that M106 sets", |name| !name.is_empty())
        .optional("T0's", "fan of `[fans]` that M106 without P sets while this tool is selected")?;
    let is_it = |fan: &Option<FanSettings>| {
        fan.as_ref().is_some_and(|fan| fan.name == name && matches!(fan.rule, FanRule::Commanded { .. }))
    };
    let place = fans.iter().position(is_it).and_then(|place| u8::try_from(place).ok());
    if place.is_none() {
        table.refuse("part_fan", "the name of a fan of [fans] that M106 or SET_FAN_SPEED sets");
    }
    place
}

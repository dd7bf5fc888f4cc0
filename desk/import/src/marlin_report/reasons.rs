//! Reasons for which a profile has no place for a command of a report.

/// Returns the reason for which a profile has no place for a command of a report; `None`
/// for a definition.
pub(crate) fn reason(name: &str) -> Option<&'static str> {
    let (code, _) = name.split_once(' ').filter(|(code, _)| code.starts_with(['M', 'G']))?;
    Some(match code {
        "G21" | "M149" => "units of the report: a profile has millimetres and degrees Celsius",
        "M92" | "M203" | "M201" => "a second extruder's: write its steps as tools.t1.steps_per_mm",
        "M200" => "volumetric extrusion: a job sets it, M200",
        "M145" => "presets of a screen's menu",
        "M206" => "the travel of M115 and M211 has it in it already: a profile's origin is where G-code has it",
        "M211" => "a profile's soft limits are always on",
        "M217" | "M603" | "M600" => "moves of filament changes: the printer's own",
        "M301" | "M306" | "M900" => "another extruder's",
        "M412" | "M591" => "which level says that filament is missing is not told: write filament_sensor by hand",
        "M420" | "M421" => "the bed is measured by G29",
        "M493" | "M494" => "Marlin's motion by fixed times: write input_shaper by hand",
        "M569" => "the kind of driver and its microsteps are not told: write drivers by hand",
        "M906" | "M913" | "M914" => "of a further motor",
        _ => return None,
    })
}

//! Counts look-ups of settings and rows in tests: a file of many sections must not take the square
//! of their number.

#[cfg(test)]
std::thread_local! {
    static LOOK_UPS: std::cell::Cell<usize> = const { std::cell::Cell::new(0) };
}

/// Counts a look-up.
pub(crate) fn count() {
    #[cfg(test)]
    LOOK_UPS.with(|look_ups| look_ups.set(look_ups.get() + 1));
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const MACHINE: &str = "[printer]\nkinematics: corexy\nmax_velocity: 300\nmax_accel: 3000\n";

    /// Look-ups for a file.
    fn look_ups(text: &str) -> usize {
        let before = LOOK_UPS.with(std::cell::Cell::get);
        crate::of_text_with("any", text, &mut |_| Err("none".to_owned()), true).unwrap();
        LOOK_UPS.with(std::cell::Cell::get) - before
    }

    #[test]
    fn look_ups_grow_with_the_number_of_sections() {
        for section in [
            "[gcode_macro M_#]\ngcode:\n  G28\n",
            "[gcode_macro AB#]\ngcode:\n  {% if x %}\n  G1 X#\n  {% endif %}\n",
            "[display_data page #]\nposition: 1, 2\n",
            "[fan_generic f#]\npin: PA1\n",
            "[heater_generic h#]\nmin_temp: 0\n",
            "[filament_switch_sensor s#]\nswitch_pin: PA1\n",
            "[stepper_z#]\ndir_pin: PA1\n",
            "[thermistor t#]\nbeta: 3950\n",
            "[tmc2209 stepper_z#]\nrun_current: 0.5\n",
            "[printer]\nmax_accel: 300#\n",
        ] {
            let file = |sections: usize| {
                let sections: String = (0..sections).map(|number| section.replace('#', &number.to_string())).collect();
                format!("{MACHINE}{sections}")
            };
            let few = look_ups(&file(2000));
            let many = look_ups(&file(20_000));
            assert!(many <= 11 * few && many < 10 * 20_000, "{section}: {few} for 2000, {many} for 20000");
        }
    }

    #[test]
    fn look_ups_grow_with_the_number_of_definitions() {
        let machine = "#define DEFAULT_AXIS_STEPS_PER_UNIT { 80, 80, 400, 93 }\n";
        for definition in ["#define NAME_@ @\n", "#define SAME @\n", "#if ENABLED(N@)\n#define N@ 1\n#endif\n"] {
            let file = |count: usize| {
                let lines: String = (0..count).map(|number| definition.replace('@', &number.to_string())).collect();
                format!("{machine}{lines}")
            };
            let (few, many) = (look_ups(&file(2000)), look_ups(&file(20_000)));
            assert!(many <= 11 * few.max(1), "{definition}: {few} for 2000, {many} for 20000");
        }
    }
}

//! Settings of a machine with a probe and four configurable drivers.

mod models;
mod tool_drivers;

use core::cell::{Cell, RefCell};

use ferrostep_planner::backlash::Backlash;
use ferrostep_settings::{Entry, MemoryFlash, RecordWriter, Slot, Store, StoreError, id_of};
use ferrostep_tmc2209::{DriverReport, DriverSettings, DriverState, DriverStatus, SettingsError};

use crate::job::print_clock::Statistics;
use crate::motion::homing::tests::rig::{MM, Rig, RigPrinter, execute};
use crate::ports::{MotorDrivers, SettingsMemory};
use crate::settings::profile::Profile;
use crate::settings::profile::homing::{HomeSensor, SafeHoming};
use crate::settings::stored::groups::Group;
use crate::settings::stored::values::Values;

const SECTOR: usize = 2048;

const DRIVER: DriverSettings = DriverSettings {
    current_ma: 350,
    hold_percent: 100,
    microsteps: 16,
    interpolate: true,
    stealth_chop: true,
    spread_cycle_above_mm_per_s: 0,
    steps_per_mm: 100.0,
    stall_threshold: 100,
    both_edges: false,
};

/// Drivers that take up to 900 mA.
#[derive(Debug)]
struct Bank<const N: usize>([Cell<DriverSettings>; N]);

impl<const N: usize> MotorDrivers for Bank<N> {
    fn state(&self, _: usize) -> Option<DriverState> {
        Some(DriverState::Confirmed)
    }
    fn report(&self, motor: usize) -> Option<DriverReport> {
        let (state, status) = (DriverState::Confirmed, DriverStatus::default());
        let settings = self.0.get(motor)?.get();
        Some(DriverReport { state, settings, run_ma: 0, hold_ma: 0, status, load: 0, repeated: 0 })
    }
    fn check(&self, _: usize, settings: &DriverSettings) -> Result<(), SettingsError> {
        if settings.current_ma <= 900 { Ok(()) } else { Err(SettingsError::Microsteps(0)) }
    }
    fn set(&self, motor: usize, settings: DriverSettings) -> Result<(), SettingsError> {
        self.check(motor, &settings)?;
        self.0[motor].set(settings);
        Ok(())
    }
    fn take_moved(&self) -> u8 {
        0
    }
}

/// A memory in two sectors, whose power a test may cut.
#[derive(Debug)]
struct Memory(RefCell<Store<MemoryFlash<Vec<u8>, SECTOR>>>);

impl Memory {
    fn new() -> Self {
        Self(RefCell::new(Store::new(MemoryFlash::new(vec![0xff; 2 * SECTOR])).unwrap()))
    }

    /// A memory that contains these values of this profile.
    fn with(profile: &str, entries: &[(&str, u8, f64)]) -> Self {
        let memory = Self::new();
        let mut record = RecordWriter::new(profile);
        for (name, index, value) in entries {
            record.add(Entry { id: id_of(name), index: *index, value: *value });
        }
        memory.save(record.bytes()).unwrap();
        memory
    }
}

impl SettingsMemory for Memory {
    fn load<'s>(&self, slot: &'s mut Slot) -> Result<Option<&'s [u8]>, StoreError> {
        self.0.borrow_mut().load(slot)
    }
    fn save(&self, record: &[u8]) -> Result<(), StoreError> {
        self.0.borrow_mut().save(record)
    }
    fn stalls(&self) -> bool {
        false
    }
}

/// Speeds of firmware retraction, and corners limited for Z and the extruder.
fn usual(profile: &mut Profile) {
    profile.retraction.retract_10nm_per_s = 25 * MM;
    profile.retraction.recover_10nm_per_s = 8 * MM;
    profile.limits.instantaneous_corner_velocity_mm_per_s = [f64::INFINITY, f64::INFINITY, 5.0, 10.0];
}

fn rig() -> (Rig, Bank<4>) {
    let rig = Rig::new(|profile| {
        usual(profile);
        profile.homing[2].sensor = HomeSensor::Probe;
        profile.safe_homing = SafeHoming {
            raise_10nm: 4 * MM,
            home_at_10nm: Some([150 * MM, 30 * MM]),
            probe_offset_10nm: [-29 * MM, -3 * MM, 0],
            bed_10nm: [[0, 200 * MM]; 2],
            is_round: false,
        };
        profile.drivers = [Some(DRIVER); 4];
        profile.backlash = Some(Backlash::NONE);
    });
    (rig, Bank([const { Cell::new(DRIVER) }; 4]))
}

fn printer<'a>(rig: &'a Rig, bank: &'a Bank<4>, memory: Option<&'a Memory>) -> RigPrinter<'a> {
    let mut printer = rig.printer();
    printer.set_drivers(bank);
    if let Some(memory) = memory {
        printer.set_settings_memory(memory);
    }
    printer
}

/// Returns the answer to a line.
fn says(rig: &Rig, printer: &mut RigPrinter<'_>, line: &str) -> Vec<String> {
    rig.last_texts();
    execute(printer, line).unwrap();
    rig.last_texts()
}

/// Commands that change every setting to a value that the profile does not have.
const CHANGES: [&str; 23] = [
    "M92 E104.57",
    "M203 X111 Y112.5 Z13.25 E14.123456",
    "M201 X1111 Y1112 Z113 E1114",
    "M204 P1234 R2345 T3456",
    "M205 J0.012345 Z1.25 E3.5",
    "M207 S1.5 F1000 Z0.3",
    "M208 S-0.25 F1234",
    "M603 U412.5 L50.25",
    "M593 X P\"mzv\" F52.8 D0.06",
    "M593 Y P\"mzv(5,1.999)\" F37 D0.123456",
    "M572 S0.0456 W0.03 L0.02 T4.5",
    "M851 X-30 Y5.25 Z-1.2345",
    "M206 X1.5 Y-2 Z0.025",
    "M852 I0.002 J-0.05 K0.015625",
    "M906 X401 Y402 Z403 E404",
    "M913 X51 Y52 Z53 E54",
    "M914 X41 Y42 Z43 E44",
    "M569 S0 X Z",
    "M569 S1 Y",
    "M569 S0 E",
    "M301 P30.5 I1.25 D76.543 F0.375",
    "M304 P51 I2.5 D255",
    "M425 F0.875 S2.5 X0.1 Y0.125 Z0.03",
];

fn changed(rig: &Rig, printer: &mut RigPrinter<'_>) -> Values<(crate::Present, crate::Present, crate::Present)> {
    for line in CHANGES {
        execute(printer, line).unwrap();
    }
    let (values, mut of_profile) = (printer.live_values(), printer.profile_values());
    // No setting is left out except M569 of Y, which is unchanged.
    let mut live = values;
    for (setting, index) in super::all_values() {
        let [value, other] =
            [&mut live, &mut of_profile].map(|values| (setting.place)(values, index).map(|place| place.get()));
        assert!(
            value != other || setting.name.ends_with("stealth_chop") || value.is_none(),
            "{} {index}",
            setting.name
        );
    }
    rig.last_texts();
    values
}

/// The lines that M503 prints configure the same machine when sent back.
#[test]
fn reported_lines_work_when_sent_back() {
    let (rig, bank) = rig();
    let mut printer = printer(&rig, &bank, None);
    let values = changed(&rig, &mut printer);
    let lines = says(&rig, &mut printer, "M503");
    assert!(lines.iter().all(|line| line.starts_with("echo:; ") || line.starts_with("echo:  ")), "{lines:#?}");
    let commands: Vec<&str> = lines.iter().filter_map(|line| line.strip_prefix("echo:  ")).collect();
    assert_eq!(
        commands,
        [
            "G21 ; (mm)",
            "M92 E104.57",
            "M203 X111.00 Y112.50 Z13.25 E14.123456",
            "M201 X1111.00 Y1112.00 Z113.00 E1114.00",
            "M204 P1234.00 R2345.00 T3456.00",
            "M205 J0.012345 Z1.25 E3.50",
            "M207 S1.50 F1000.00 Z0.30",
            "M208 S-0.25 F1234.00",
            "M603 U412.50 L50.25",
            "M593 X P\"mzv\" F52.80 D0.06",
            "M593 Y P\"mzv(5,1.999)\" F37.00 D0.123456",
            "M572 S0.0456 W0.03 L0.02 T4.50",
            "M851 X-30.00 Y5.25 Z-1.2345",
            "M206 X1.50 Y-2.00 Z0.025",
            "M852 I0.002 J-0.05 K0.015625",
            "M906 X401 Y402 Z403 E404",
            "M913 X51 Y52 Z53 E54",
            "M914 X41 Y42 Z43 E44",
            "M569 X S0",
            "M569 Y S1",
            "M569 Z S0",
            "M569 E S0",
            "M301 P30.50 I1.25 D76.543 F0.375",
            "M304 P51.00 I2.50 D255.00",
            "M425 F0.875 S2.50 X0.10 Y0.125 Z0.03",
        ]
    );
    execute(&mut printer, "M502").unwrap();
    assert_eq!(printer.live_values(), printer.profile_values());
    // This also works while lengths are in inches.
    execute(&mut printer, "G20").unwrap();
    for line in &commands {
        execute(&mut printer, line).unwrap();
    }
    assert_eq!(printer.live_values(), values);
    let short = says(&rig, &mut printer, "M503 S0");
    assert_eq!(short, commands.iter().map(|line| format!("echo:  {line}")).collect::<Vec<_>>());
}

/// The profile's own settings have no effect when sent back.
#[test]
fn a_machine_without_probe_and_drivers_reports_what_it_has() {
    let rig = Rig::new(usual);
    let mut printer = rig.printer();
    let lines = says(&rig, &mut printer, "M503 S0");
    let codes: Vec<&str> = lines.iter().filter_map(|line| line["echo:  ".len()..].split(' ').next()).collect();
    assert_eq!(
        codes,
        [
            "G21", "M92", "M203", "M201", "M204", "M205", "M207", "M208", "M603", "M593", "M593", "M572", "M206",
            "M852", "M301", "M304"
        ]
    );
    let before = printer.live_values();
    for line in &lines {
        execute(&mut printer, &line["echo:  ".len()..]).unwrap();
    }
    assert_eq!(printer.live_values(), before);
}

#[test]
fn settings_survive_the_power() {
    let (rig_before, bank) = rig();
    let memory = Memory::new();
    let mut before = printer(&rig_before, &bank, Some(&memory));
    let values = changed(&rig_before, &mut before);
    let said = says(&rig_before, &mut before, "M500");
    assert_eq!(said, ["echo:Settings Stored (751 bytes: 68 values that differ from the profile's)"]);
    // Switched off and on.
    let (rig_after, bank) = rig();
    let mut after = printer(&rig_after, &bank, Some(&memory));
    assert_eq!(after.live_values(), after.profile_values());
    after.restore_settings();
    let said = rig_after.last_texts();
    assert_eq!(said.len(), 8, "six are named: {said:#?}");
    assert_eq!(said[1], "echo:settings: max_feed_mm_per_s.x is stored as 111.00, the profile has 200.00");
    assert_eq!(
        said[6],
        "echo:settings: what is stored is used in place of the profile's, values that differ: 68 (M503); M502, then M500 \
         takes the profile's"
    );
    assert_eq!(said[7], "echo:stored settings retrieved (68 values, 0 faults)");
    assert_eq!(after.live_values(), values);
    assert_eq!(says(&rig_after, &mut after, "M504"), ["echo:M504: stored are 68 values, 0 faults"]);
    // M502 leaves the memory unchanged, M501 returns to it, M500 after M502 stores settings without
    // differences.
    assert_eq!(says(&rig_after, &mut after, "M502"), ["echo:Hardcoded Default Settings Loaded"]);
    assert_eq!(after.live_values(), after.profile_values());
    execute(&mut after, "M501").unwrap();
    assert_eq!(after.live_values(), values);
    execute(&mut after, "M502").unwrap();
    assert!(says(&rig_after, &mut after, "M500")[0].contains("(3 bytes: 0 values"));
    execute(&mut after, "M203 X5").unwrap();
    execute(&mut after, "M501").unwrap();
    assert_eq!(after.live_values(), after.profile_values());
}

/// Statistics are stored when a print is complete; the settings stay as M500 stored them.
#[test]
fn statistics_survive_the_power_without_m500() {
    let (rig_before, bank) = rig();
    let memory = Memory::new();
    let mut before = printer(&rig_before, &bank, Some(&memory));
    for line in ["M203 X77", "M500", "M203 X88", "M75", "M77", "M75"] {
        execute(&mut before, line).unwrap();
    }
    let (rig_after, bank) = rig();
    let mut after = printer(&rig_after, &bank, Some(&memory));
    after.restore_settings();
    assert_eq!(rig_after.last_texts()[2..], ["echo:stored settings retrieved (1 values, 0 faults)"]);
    assert_eq!(after.live_values().limits.max_feed_mm_per_s[0], 77.0);
    let said = says(&rig_after, &mut after, "M78");
    assert!(said[0].starts_with("Stats: Prints: 1, Finished: 1, Failed: 0\n"), "{said:?}");
    // Loading settings again does not undo a counted print.
    for line in ["M75", "M77", "M501", "M502", "M500"] {
        execute(&mut after, line).unwrap();
    }
    assert!(says(&rig_after, &mut after, "M78")[0].starts_with("Stats: Prints: 2, Finished: 2, Failed: 0\n"));
    let mut again = printer(&rig_after, &bank, Some(&memory));
    again.restore_settings();
    assert!(says(&rig_after, &mut again, "M78")[0].starts_with("Stats: Prints: 2, Finished: 2, Failed: 0\n"));
}

/// A better profile's values apply where no others were set.
#[test]
fn an_update_brings_its_profile_and_keeps_what_was_set() {
    let (rig_before, bank) = rig();
    let memory = Memory::new();
    let mut before = printer(&rig_before, &bank, Some(&memory));
    for line in ["M203 X77", "M900 K0.05", "M500"] {
        execute(&mut before, line).unwrap();
    }
    let (mut rig_after, bank) = rig();
    rig_after.profile.limits.max_feed_mm_per_s[1] = 66.0;
    rig_after.profile.limits.junction_deviation_mm = 0.033;
    let mut after = printer(&rig_after, &bank, Some(&memory));
    after.restore_settings();
    let values = after.live_values();
    assert_eq!(values.limits.max_feed_mm_per_s[..2], [77.0, 66.0]);
    assert_eq!((values.limits.junction_deviation_mm, values.advance[0]), (0.033, Some(0.05)));
}

/// A value out of range is named and replaced by the profile's; the rest is kept. Settings of
/// another version are skipped.
#[test]
fn a_value_out_of_range_costs_itself_alone() {
    let stored = [
        ("max_feed_mm_per_s.*", 0, 0.0),
        ("max_feed_mm_per_s.*", 1, 99.0),
        ("max_feed_mm_per_s.*", 4, 50.0),
        ("max_acceleration_mm_per_s2.*", 2, f64::NAN),
        ("acceleration_mm_per_s2.print", 0, f64::INFINITY),
        ("a_setting_of_another_version", 0, 7.0),
        ("input_shaper.*.kind", 0, 5.0),
        ("input_shaper.*.frequency_hz", 0, 45.0),
        ("input_shaper.*.damping", 0, 0.9),
        ("input_shaper.*.kind", 1, 77.0),
        ("pressure_advance.seconds", 0, 0.04),
        ("homing.probe_offset_mm.*", 0, 60.0),
        ("homing.probe_offset_mm.z", 0, -1.5),
        ("drivers.*.current_ma", 0, 901.0),
        ("drivers.*.current_ma", 1, 500.5),
        ("drivers.*.current_ma", 2, 500.0),
        ("drivers.*.stealth_chop", 3, 2.0),
        ("nozzle.proportional", 0, f64::NAN),
        ("bed.integral", 0, 0.5),
    ];
    let (rig, bank) = rig();
    let memory = Memory::with(rig.profile.name, &stored);
    let mut printer = printer(&rig, &bank, Some(&memory));
    printer.restore_settings();
    let said = rig.last_texts();
    let profile = printer.profile_values();
    let feed = super::Shown(profile.limits.max_feed_mm_per_s[0]).to_string();
    for line in [
        &format!(
            "echo:settings: max_feed_mm_per_s.x is stored as 0.00, expected 0.01 to 1000000.00: the profile's {feed} is used"
        ),
        "echo:settings: input_shaper.x as stored is not possible: the profile's is used",
        "echo:settings: homing.probe_offset_mm.x as stored is not possible: the profile's is used",
        "echo:settings: drivers.x as stored is not possible: the profile's is used",
        "echo:stored settings retrieved (17 values, 10 faults, 2 that this version does not know)",
    ] {
        assert!(said.iter().any(|said| said == line), "{line}: {said:#?}");
    }
    for named in [
        "max_acceleration_mm_per_s2.z is",
        "acceleration_mm_per_s2.print is",
        "input_shaper.y.kind",
        "drivers.y.current_ma",
        "drivers.e.stealth_chop",
        "nozzle.proportional is stored as NaN",
    ] {
        assert!(said.iter().any(|said| said.contains(named)), "{named}: {said:#?}");
    }
    assert_eq!(said.len(), 18, "11 and those that differ: {said:#?}");
    let mut expected = profile;
    expected.limits.max_feed_mm_per_s[1] = 99.0;
    expected.advance[0] = Some(0.04);
    expected.probe_offset_10nm = Some([-29 * MM, -3 * MM, -150_000]);
    expected.drivers[2] = Some(DriverSettings { current_ma: 500, ..DRIVER });
    expected.gains.as_mut().unwrap()[1].integral = 0.5;
    assert_eq!(printer.live_values(), expected);
}

#[test]
fn settings_of_another_machine_are_not_used() {
    let (rig, bank) = rig();
    let memory = Memory::with("another", &[("max_feed_mm_per_s.*", 0, 5.0)]);
    let mut printer = printer(&rig, &bank, Some(&memory));
    printer.restore_settings();
    assert_eq!(
        rig.last_texts(),
        [
            "echo:M501: the stored settings are not used, they are of another profile: the profile's are in force, M500 replaces them"
        ]
    );
    assert_eq!(printer.live_values(), printer.profile_values());
    execute(&mut printer, "M203 X77").unwrap();
    execute(&mut printer, "M500").unwrap();
    assert_eq!(says(&rig, &mut printer, "M501"), ["echo:stored settings retrieved (1 values, 0 faults)"]);
}

#[test]
fn a_machine_without_a_memory_says_so_and_goes_on() {
    let (rig, bank) = rig();
    let mut printer = printer(&rig, &bank, None);
    let expected = "echo:M500, M501, M504: this machine has no memory for settings: write them into the profile";
    for code in ["M500", "M501", "M504"] {
        assert_eq!(says(&rig, &mut printer, code), [expected]);
    }
    execute(&mut printer, "M203 X5").unwrap();
    execute(&mut printer, "M502").unwrap();
    assert_eq!(printer.live_values(), printer.profile_values());
}

/// M500 after motion waits for its end.
#[test]
fn settings_change_at_standstill() {
    let (rig, bank) = rig();
    let memory = Memory::new();
    let mut printer = printer(&rig, &bank, Some(&memory));
    for line in ["M500", "M501", "M502"] {
        execute(&mut printer, "G91").unwrap();
        execute(&mut printer, "G1 X1 F600").unwrap();
        assert!(rig.is_moving());
        execute(&mut printer, line).unwrap();
        assert!(!rig.is_moving(), "{line}");
    }
}

/// Memories identify settings by the hashes of their names: no two may share one, and no name may
/// change.
#[test]
fn names_are_distinct_and_stay() {
    let mut names: Vec<&str> = Group::<(crate::Present, crate::Present, crate::Present)>::all()
        .flat_map(|group| group.settings)
        .map(|setting| setting.name)
        .collect();
    let known = [
        "acceleration_mm_per_s2.print",
        "acceleration_mm_per_s2.retract",
        "acceleration_mm_per_s2.travel",
        "backlash.correction",
        "backlash.play_mm.*",
        "backlash.smoothing_mm",
        "bed.control_model.capacity_j_per_k",
        "bed.control_model.loss_w_per_k",
        "bed.control_model.power_w",
        "bed.control_model.sensor_per_s",
        "bed.derivative",
        "bed.integral",
        "bed.proportional",
        "drivers.*.current_ma",
        "drivers.*.spread_cycle_above_mm_per_s",
        "drivers.*.stall_threshold",
        "drivers.*.stealth_chop",
        "firmware_retraction.extra_recover_mm",
        "firmware_retraction.length_mm",
        "firmware_retraction.lift_mm",
        "firmware_retraction.recover_mm_per_s",
        "firmware_retraction.retract_mm_per_s",
        "homing.home_offset_mm.*",
        "homing.probe_offset_mm.*",
        "homing.probe_offset_mm.z",
        "input_shaper.*.damping",
        "input_shaper.*.frequency_hz",
        "input_shaper.*.kind",
        "instantaneous_corner_velocity_mm_per_s.*",
        "junction_deviation_mm",
        "max_acceleration_mm_per_s2.*",
        "max_feed_mm_per_s.*",
        "nozzle.control_model.capacity_j_per_k",
        "nozzle.control_model.fanned_loss_w_per_k",
        "nozzle.control_model.filament_j_per_k_mm",
        "nozzle.control_model.loss_w_per_k",
        "nozzle.control_model.power_w",
        "nozzle.control_model.sensor_per_s",
        "nozzle.derivative",
        "nozzle.fan_gain",
        "nozzle.integral",
        "nozzle.proportional",
        "pause.load_mm",
        "pause.unload_mm",
        "pressure_advance.above.filament_mm_per_s",
        "pressure_advance.above.seconds",
        "pressure_advance.seconds",
        "pressure_advance.smooth_time_s",
        "skew.xy.factor",
        "skew.xz.factor",
        "skew.yz.factor",
        "steps_per_mm.e",
        "tools.t1.driver.current_ma",
        "tools.t1.driver.spread_cycle_above_mm_per_s",
        "tools.t1.driver.stealth_chop",
        "tools.t1.nozzle.control_model.capacity_j_per_k",
        "tools.t1.nozzle.control_model.fanned_loss_w_per_k",
        "tools.t1.nozzle.control_model.filament_j_per_k_mm",
        "tools.t1.nozzle.control_model.loss_w_per_k",
        "tools.t1.nozzle.control_model.power_w",
        "tools.t1.nozzle.control_model.sensor_per_s",
        "tools.t1.nozzle.derivative",
        "tools.t1.nozzle.fan_gain",
        "tools.t1.nozzle.integral",
        "tools.t1.nozzle.proportional",
        "tools.t1.offset_mm.*",
        "tools.t1.pressure_advance.above.filament_mm_per_s",
        "tools.t1.pressure_advance.above.seconds",
        "tools.t1.pressure_advance.seconds",
        "tools.t1.pressure_advance.smooth_time_s",
        "tools.t1.steps_per_mm",
    ];
    names.sort_unstable();
    assert_eq!(names, known, "a new setting is added here; one that stood here is a setting that printers have stored");
    names.extend(["statistics", "bed_mesh"]);
    let mut ids: Vec<u16> = names.iter().map(|name| id_of(name)).collect();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), names.len(), "two names have the same id: change the new one");
    let statistics = Statistics::default().numbers_mut().len();
    // The values of a second tool and of backlash fit only if not all others differ from the
    // profile's; otherwise M500 says so.
    let optional = ["tools.", "backlash."];
    let of_parts =
        super::all_values().filter(|(setting, _)| optional.iter().any(|part| setting.name.starts_with(part)));
    assert!(super::all_values().count() - of_parts.count() + statistics <= ferrostep_settings::MAX_VALUES);
}

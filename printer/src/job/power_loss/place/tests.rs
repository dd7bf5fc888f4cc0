use ferrostep_card::KEPT_BYTES;
use ferrostep_settings::hash_of;

use super::*;
use crate::motion::machine::tests::profile;
use crate::part::Present;

fn place() -> Place<Present> {
    let profile = profile();
    let mut modal = Modal::new(&profile);
    (modal.units, modal.relative, modal.relative_extruder, modal.retracted) = (Units::Inches, true, true, true);
    (modal.soft_limits, modal.cold_extrusion_allowed, modal.follows_bed) = (false, true, true);
    (modal.feed_percent, modal.flow_percent, modal.kept_feed_percent) = (90, 95, 110);
    (modal.feed_10nm_per_min, modal.extruder_10nm, modal.min_extrusion_celsius) = (1 << 40, -(1 << 45), 171.5);
    modal.machine_10nm = [1, -2, 500_000_000];
    modal.offset_10nm = [-500_000_000, 5, 6];
    modal.home_offset_10nm = [7, 8, -9];
    modal.retraction = FirmwareRetraction {
        length_10nm: 10_000_000,
        retract_10nm_per_s: 100_000_000,
        extra_recover_10nm: -3,
        recover_10nm_per_s: 4,
        lift_10nm: 5,
    };
    (modal.lift_10nm, modal.z.shift_10nm) = (60, -70);
    let mut tools = ToolBox::new(&profile);
    tools.selected = 1;
    tools.tools[0].flow_percent = 103;
    tools.tools[0].steps_per_mm = StepsPerMm::nearest(417.123_45);
    tools.tools[0].advance = PressureAdvance {
        seconds: 0.031,
        above: Some(SecondSlope { filament_mm_per_s: 2.5, seconds: 0.007 }),
        smooth_time_s: Some(0.02),
    };
    (tools.tools[0].retracted, tools.tools[1].drawn_back) = (true, true);
    tools.tools[1].offset_10nm = [1_950_000, -12_345, 20_000];
    Place {
        stands_10nm: -12,
        offset: u32::MAX,
        lines: 77,
        profile: hash_of("cartesian"),
        paused: Paused {
            modal,
            place_10nm: [-1, 2, 3_000_000],
            targets_celsius: [215.5, 60.0, 45.0, 190.25],
            drawn_100pm: 8_000_000,
            load_100pm: 20_000_000_000,
            pushes_more: false,
            until_ms: None,
        },
        fans: [255, 0, 1, 2, 3, 4],
        limits: Limits { instantaneous_corner_velocity_mm_per_s: [f64::INFINITY, 1.0, 0.1, 2.0], ..profile.limits },
        advance: PressureAdvance {
            seconds: 0.05,
            above: Some(SecondSlope { filament_mm_per_s: 3.0, seconds: 0.02 }),
            smooth_time_s: Some(0.04),
        },
        extruder_steps: 1_000_000_000,
        skew: Skew { factors: [i32::MAX, -3, 214_748_364] },
        tools,
    }
}

fn other() -> Place<Present> {
    let profile = profile();
    let advance = PressureAdvance { seconds: 0.0, above: None, smooth_time_s: None };
    let paused = Paused {
        modal: Modal::new(&profile),
        place_10nm: [0; 3],
        targets_celsius: [0.0; 4],
        drawn_100pm: 0,
        load_100pm: 0,
        pushes_more: false,
        until_ms: None,
    };
    Place {
        stands_10nm: 0,
        offset: 0,
        lines: 0,
        profile: 0,
        paused,
        fans: [0; 6],
        limits: profile.limits,
        advance,
        extruder_steps: 1,
        skew: Skew::NONE,
        tools: ToolBox::new(&profile),
    }
}

/// The place as text: fields without `PartialEq` have the same digits.
fn shown(place: &Place<Present>) -> String {
    format!("{place:?}")
}

#[test]
fn what_is_written_is_read() {
    for mut written in [place(), other()] {
        let mut bytes = Kept::new();
        written.write(&mut bytes);
        assert!(bytes.len() <= KEPT_BYTES, "{}", bytes.len());
        let mut read = if shown(&written) == shown(&other()) { place() } else { other() };
        assert!(read.read(&bytes));
        // The values of the selected tool are those in force, and T0 has no offset.
        let selected = usize::from(written.tools.selected);
        let (kept, offset_10nm) = (written.tools.tools[selected], read.tools.tools[selected].offset_10nm);
        let flags = (read.tools.tools[selected].retracted, read.tools.tools[selected].drawn_back);
        assert_eq!((offset_10nm, flags), (kept.offset_10nm, (kept.retracted, kept.drawn_back)));
        read.tools.tools[selected] = kept;
        assert_eq!(shown(&read), shown(&written));
    }
}

#[test]
fn another_height_changes_nothing_else() {
    let (mut bytes, mut read) = (Kept::new(), other());
    place().write(&mut bytes);
    set_stands(&mut bytes, -123_456_789);
    assert!(read.read(&bytes));
    assert_eq!(shown(&read), shown(&Place { stands_10nm: -123_456_789, ..place() }));
}

#[test]
fn other_bytes_are_no_place() {
    let mut bytes = Kept::new();
    place().write(&mut bytes);
    for length in 0..bytes.len() {
        assert!(!other().read(&bytes[..length]), "{length} bytes");
    }
    assert!(bytes.push(0).is_ok());
    assert!(!other().read(&bytes), "one more");
    bytes.pop();
    bytes[0] = VERSION + 1;
    assert!(!other().read(&bytes), "another version");
}

#[test]
fn machines_have_different_numbers() {
    let numbers = ["cartesian", "corexy", "prusa-mini", ""].map(hash_of);
    assert!((0..4).all(|one| (0..one).all(|other| numbers[one] != numbers[other])));
}

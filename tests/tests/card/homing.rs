//! A print from the card whose homing fails, or that a person homes in a pause.

use ferrostep_virtual_board::EndStopFailure;

use crate::card::setup::{Setup, image, profile};

/// The way back to the print does not use the motors' steps from before homing: X was at -50 mm as
/// the motors counted, and truly at 10 mm.
#[test]
fn an_axis_that_is_homed_in_a_pause_goes_back_to_no_place_of_before() {
    let setup = Setup::new(profile("cartesian"), image());
    setup.put("PRINT.GCO", b"G1 X-50 Y20 F3000\nM601\nG1 X30 Y30\n");
    let (mut looks, mut lowest_mm) = (0, f64::INFINITY);
    let said = setup.say(&["M21", "M23 PRINT.GCO", "M24"], &mut |_, _| {
        looks += 1;
        lowest_mm = lowest_mm.min(setup.true_mm()[0]);
        match looks {
            200 => vec!["G28 X".to_owned()],
            400 => vec!["M24".to_owned()],
            _ => Vec::new(),
        }
    });
    assert_eq!(said.last().map(String::as_str), Some("Done printing file"), "{said:?}");
    assert!(lowest_mm > -0.1, "X went to {lowest_mm} mm: {said:?}");
    let [x, ..] = setup.true_mm();
    assert!((x - 30.0).abs() < 0.1, "{x}");
}

/// The line that was refused is tried again.
#[test]
fn a_failed_homing_pauses_the_print_until_it_works() {
    let setup = Setup::new(profile("cartesian"), image());
    setup.put("PRINT.GCO", b"G28\nG1 Z5 F600\nG1 X30 Y30 F3000\n");
    setup.set_end_stop_failure(1, Some(EndStopFailure::NeverTriggers));
    let mut looks = 0;
    let said = setup.say(&["M21", "M23 PRINT.GCO", "M24"], &mut |_, _| {
        looks += 1;
        match looks {
            200 => return vec!["M24".to_owned()],
            400 => {
                setup.set_end_stop_failure(1, None);
                return vec!["G28".to_owned(), "M24".to_owned()];
            }
            _ => {}
        }
        Vec::new()
    });
    let failed = said.iter().filter(|line| line.contains("homing Y failed: its sensor did not trigger")).count();
    assert_eq!(failed, 2, "{said:?}");
    assert_eq!(said.last().map(String::as_str), Some("Done printing file"), "{said:?}");
    let [x, y, z] = setup.true_mm();
    assert!((x - 30.0).abs() + (y - 30.0).abs() + (z - 5.0).abs() < 0.1, "{x} {y} {z}");
}

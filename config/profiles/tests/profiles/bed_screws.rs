//! The levelling screws of the bed: the table `bed_screws`.

use ferrostep_printer::{BedScrew, BedScrews, Profile};
use ferrostep_profiles::{ProfileError, builtin_text, parse};

const SCREWS: &str = "\n[bed_screws]\npitch_mm = 0.5\n[bed_screws.places]\nleft = { x = 10, y = 20 }\nright = { x = 140, y = 20 }\n\
                      back = { x = 75, y = 170 }\n";

fn mini(table: &str) -> Result<Profile, ProfileError> {
    parse(&format!("{}{table}", builtin_text("prusa-mini").unwrap()), "mini.toml")
}

#[test]
fn screws_are_in_the_order_of_the_file() {
    let screws = mini(SCREWS).unwrap().bed_screws.unwrap();
    assert_eq!((screws.pitch_10nm, screws.clockwise_lifts), (50_000, true));
    let [Some(left), Some(right), Some(back), None, ..] = screws.screws else { panic!("{screws:?}") };
    assert_eq!(left, BedScrew { name: "left", place_10nm: [1_000_000, 2_000_000] });
    assert_eq!((right.name, back.name), ("right", "back"));
    assert_eq!(mini("").unwrap().bed_screws, None);
    // Turning screws changes no plan.
    assert_eq!(mini(SCREWS).unwrap().plan_hash, mini("").unwrap().plan_hash);
}

#[test]
fn bad_values_are_refused_by_name() {
    let one = "\n[bed_screws]\npitch_mm = 0.5\n[bed_screws.places]\nleft = { x = 10, y = 20 }\n";
    let nine: String = (0..=BedScrews::MAX).map(|number| format!("s{number} = {{ x = 10, y = 20 }}\n")).collect();
    let nine = format!("\n[bed_screws]\npitch_mm = 0.5\n[bed_screws.places]\n{nine}");
    for (table, says) in [
        (one.to_owned(), "expected 2 to 8 screws"),
        (nine, "expected 2 to 8 screws"),
        (SCREWS.replace("0.5", "0"), "bed_screws.pitch_mm = 0: expected 0.1 to 10 mm"),
        (SCREWS.replace("pitch_mm = 0.5\n", ""), "missing key \"bed_screws.pitch_mm\""),
        (
            SCREWS.replace("x = 140", "x = 152"),
            "bed_screws.places.right.x = 152: expected 0 to 151.4 mm: the probe does not reach it",
        ),
        (SCREWS.replace("right", "\"front right\""), "expected a name of letters, digits and _"),
        (SCREWS.replace(", y = 170", ""), "missing key \"bed_screws.places.back.y\""),
    ] {
        let error = mini(&table).expect_err(&table).to_string();
        assert!(error.contains(says), "{table}: {error}");
    }
    let cartesian = format!("{}{SCREWS}", builtin_text("cartesian").unwrap());
    let error = parse(&cartesian, "own.toml").unwrap_err().to_string();
    assert!(error.contains("expected homing.z.sensor = \"probe\" with it"), "{error}");
}

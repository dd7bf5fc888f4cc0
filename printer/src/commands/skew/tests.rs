//! Skew: the answers to queries, the axes' positions, and the refusals.

use proptest::prelude::*;

use super::*;
use crate::motion::homing::tests::rig::{MM, Rig, RigPrinter, execute};

/// Marlin's formula from its `Configuration.h`, with its functions.
fn marlins(ac: f64, bd: f64, ad: f64) -> f64 {
    let ab = (2.0 * ac * ac + 2.0 * bd * bd - 4.0 * ad * ad).sqrt() / 2.0;
    (std::f64::consts::FRAC_PI_2 - ((ac * ac - ab * ab - ad * ad) / (2.0 * ab * ad)).acos()).tan()
}

/// AC, BD and AD, and the factor to nine decimals. The first row is Marlin's default; the lengths
/// of the second and third are from Klipper's documentation (`Skew_Correction.md`); the last are
/// those of a side of 100 mm and a Y that leans by 1 in 100, either way.
const TABLE: [([f64; 3], f64); 5] = [
    ([282.842_712_474_6, 282.842_712_474_6, 200.0], 0.0),
    ([140.4, 142.8, 99.8], -0.016_950_737),
    ([141.6, 141.4, 99.8], 0.001_413_447),
    ([142.126_668_858, 140.712_508_325, 100.0], 0.010_000_000),
    ([140.712_508_325, 142.126_668_858, 100.0], -0.010_000_000),
];

/// Factor from lengths in mm.
fn of_lengths(lengths_mm: [f64; 3]) -> Option<f64> {
    Skew::factor_of_diagonals(lengths_mm.map(|length| (length * MM as f64).round() as u32)).map(f64::from)
}

#[test]
fn factors_are_those_of_marlins_formula() {
    for ([ac, bd, ad], expected) in TABLE {
        assert!((marlins(ac, bd, ad) - expected).abs() < 1e-9, "{ac} {bd} {ad}: {}", marlins(ac, bd, ad));
        let factor = of_lengths([ac, bd, ad]).unwrap();
        assert!((factor - expected).abs() < 3e-7, "{ac} {bd} {ad}: {factor}, expected {expected}");
    }
    for nothing in [[0.0; 3], [1.0, 1.0, 100.0], [300.0, 100.0, 100.0], [1.0, 0.0, 1.0]] {
        assert_eq!(of_lengths(nothing), None, "{nothing:?}");
    }
}

proptest! {
    /// Any parallelogram, measured: the factor is the tangent of the angle by which its side leans.
    #[test]
    fn a_leaning_parallelogram_has_its_tangent(ad in 50.0f64..300.0, ab in 50.0f64..300.0, lean in -0.05f64..0.05) {
        let (b, d) = ([ab * lean.sin(), ab * lean.cos()], [ad, 0.0]);
        let ac = (b[0] + d[0]).hypot(b[1]);
        let bd = (b[0] - d[0]).hypot(b[1]);
        let factor = of_lengths([ac, bd, ad]).unwrap();
        prop_assert!((factor - lean.tan()).abs() < 2e-6, "{factor} {}", lean.tan());
    }

    /// The axes' map and its inverse cancel exactly; the axes are within about half a unit of
    /// Marlin's map in double precision (`Planner::skew`).
    #[test]
    fn the_axes_go_where_marlins_go(
        asked in proptest::array::uniform3(-400_000_000i64..400_000_000),
        factors in proptest::array::uniform3(-0.05f64..0.05),
    ) {
        let skew = Skew::of_factors(factors);
        let axes = skew.axes(asked);
        prop_assert_eq!(skew.asked(axes), asked);
        let ([xy, xz, yz], [x, y, z]) = (skew.factors(), asked.map(|units| units as f64));
        let expected = [x - y * xy - z * (xz - xy * yz), y - z * yz, z];
        for (axis, expected) in axes.into_iter().zip(expected) {
            prop_assert!((axis as f64 - expected).abs() < 1.3, "{axis} {expected}");
        }
        prop_assert_eq!(Skew::NONE.axes(asked), asked);
        for (factor, of) in factors.into_iter().zip(skew.factors()) {
            prop_assert!((factor - of).abs() < 2.4e-10);
        }
    }
}

fn logical_10nm(printer: &RigPrinter<'_>) -> [i64; 3] {
    let [x, y, z, _] = printer.logical_10nm();
    [x, y, z]
}

fn skew_rig() -> Rig {
    Rig::new(|profile| profile.skew = Skew::of_factors([0.01, 0.02, -0.03]))
}

#[test]
fn motors_go_to_the_axes_places_and_hosts_see_what_is_asked() {
    let rig = skew_rig();
    let mut printer = rig.printer();
    execute(&mut printer, "G28").unwrap();
    assert_eq!(rig.believed_mm(), [0.0; 3]);
    assert_eq!(logical_10nm(&printer), [0; 3]);
    execute(&mut printer, "G1 X100 Y50 Z10 F6000").unwrap();
    assert_eq!(logical_10nm(&printer), [100 * MM, 50 * MM, 10 * MM]);
    // Computed by hand: Y 50 + 0.3, X 100 - 0.5 - 10 * (0.02 + 0.01 * 0.03).
    assert_eq!(rig.believed_mm(), [99.297, 50.3, 10.0]);
    assert_eq!(rig.true_mm(), [99.297, 50.3, 10.0]);
    // A relative move and G92 refer to the requested position.
    for line in ["G91", "G1 X1", "G90", "G92 X0"] {
        execute(&mut printer, line).unwrap();
    }
    assert_eq!(rig.believed_mm(), [100.297, 50.3, 10.0]);
    execute(&mut printer, "G1 X-1").unwrap();
    assert_eq!(rig.believed_mm(), [99.297, 50.3, 10.0]);
}

/// Each axis homes alone, to its own position: the rig refuses a seek that turns another axis.
#[test]
fn homing_finds_the_places_of_the_axes() {
    for ends in 0..4 {
        let rig = Rig::new(|profile| {
            profile.skew = Skew::of_factors([0.01, 0.02, -0.03]);
            for (axis, bit) in [(0, 1), (1, 2)] {
                if ends & bit != 0 {
                    profile.homing[axis].end = crate::settings::profile::homing::HomeEnd::Max;
                    profile.homing[axis].position_10nm = 200 * MM;
                }
            }
        });
        let mut printer = rig.printer();
        for line in ["G28", "G1 X70 Y60 Z20 F6000", "G28 X", "G28 Y", "G1 Z33", "G28 Z", "G28"] {
            execute(&mut printer, line).unwrap();
            let axes = printer.interpreter.skew.axes(printer.interpreter.modal.machine_10nm);
            assert_eq!(axes.map(|units| units as f64 / MM as f64), rig.believed_mm(), "{line}");
            assert_eq!(rig.believed_mm(), rig.true_mm(), "{line}");
        }
        let home = [ends & 1, ends >> 1 & 1].map(|end| f64::from(end) * 200.0);
        assert_eq!(rig.believed_mm(), [home[0], home[1], 0.0]);
        // Y is at its end: there X is where its axis is, shifted by the lean of Y.
        let [x, y, z] = logical_10nm(&printer).map(|units| units as f64 / MM as f64);
        assert_eq!([y, z], [home[1], 0.0]);
        assert!((x - (home[0] + 0.01 * home[1])).abs() < 2e-5, "{x}");
    }
}

/// The soft limits are those of the axes.
#[test]
fn axes_stay_in_their_travel() {
    let rig = Rig::new(|profile| {
        profile.skew = Skew::of_factors([0.05, 0.0, 0.0]);
        profile.retraction.lift_10nm = MM;
    });
    let mut printer = rig.printer();
    execute(&mut printer, "G28").unwrap();
    for (line, axes, text) in [
        ("G1 X0 Y100 F6000", [0.0, 100.0], "X ends at 5.00 (allowed 5.00 to 205.00)"),
        ("G1 X205 Y100", [200.0, 100.0], ""),
        ("G1 X206 Y100", [200.0, 100.0], "X ends at 205.00 (allowed 5.00 to 205.00)"),
        ("G1 X100 Y220", [90.0, 200.0], "Y ends at 200.00 (allowed 0.00 to 200.00)"),
        // An arc of 80 mm around 90, 100: left of the travel where Y is above 200.
        ("G1 X90 Y20", [89.0, 20.0], ""),
        ("G3 X90 Y20 I0 J95", [89.0, 20.0], "X Y"),
    ] {
        rig.last_texts();
        execute(&mut printer, line).unwrap();
        let [x, y, _] = rig.believed_mm();
        assert!((x - axes[0]).abs() < 2e-5 && (y - axes[1]).abs() < 2e-5, "{line}: {x} {y}");
        let said = rig.last_texts().concat();
        match text {
            "" => assert_eq!(said, "", "{line}"),
            "X Y" => assert!(said.contains(" X goes to ") && said.contains(" Y goes to "), "{line}: {said}"),
            _ => assert!(said.contains(text), "{line}: {said}"),
        }
    }
    for event in rig.take_events() {
        if let crate::motion::homing::tests::rig::Event::Placed(place) = event {
            assert!(place.into_iter().all(|place| (0.0..=200.0).contains(&place)), "{place:?}");
        }
    }
}

/// M852 and SET_SKEW: the motors do not move, the coordinates change; the report shows the factors
/// that were set.
#[test]
fn it_is_set_live_and_reported() {
    let rig = Rig::new(|_| {});
    let mut printer = rig.printer();
    for line in ["G28", "G1 X100 Y100 Z50 F6000"] {
        execute(&mut printer, line).unwrap();
    }
    for (line, skewed) in [
        ("M852 I0.01", [101.0, 100.0]),
        ("M852 K-0.02", [101.0, 99.0]),
        ("SET_SKEW CLEAR=1", [100.0, 100.0]),
        ("SET_SKEW XY=142.126668858,140.712508325,100", [101.0, 100.0]),
        ("M852 S0", [100.0, 100.0]),
        ("M852 J0.04", [102.0, 100.0]),
    ] {
        execute(&mut printer, line).unwrap();
        assert_eq!(rig.believed_mm(), [100.0, 100.0, 50.0], "{line}");
        let [x, y, _] = logical_10nm(&printer).map(|units| units as f64 / MM as f64);
        assert!((x - skewed[0]).abs() < 2e-4 && (y - skewed[1]).abs() < 2e-5, "{line}: {x} {y}");
    }
    rig.last_texts();
    execute(&mut printer, "M852").unwrap();
    let says = "echo:  M852 I0.000000 J0.040000 K0.000000 ; XY, XZ, YZ";
    assert_eq!(rig.last_texts().concat(), says);
    execute(&mut printer, "GET_CURRENT_SKEW").unwrap();
    let says = [
        "echo:XY Skew: 0.000000 radians, 0.00 degrees",
        "echo:XZ Skew: 0.040000 radians, 2.29 degrees",
        "echo:YZ Skew: 0.000000 radians, 0.00 degrees",
    ];
    assert_eq!(rig.last_texts(), says);
    execute(&mut printer, "CALC_MEASURED_SKEW AC=142.126668858 BD=140.712508325 AD=100").unwrap();
    assert_eq!(rig.last_texts(), ["echo:Calculated Skew: 0.010000 radians, 0.57 degrees"]);
}

#[test]
fn an_absurd_skew_is_refused_and_nothing_changes() {
    let rig = skew_rig();
    let mut printer = rig.printer();
    execute(&mut printer, "G28").unwrap();
    let before = printer.interpreter.skew;
    for (line, says) in [
        ("M852 I0.051", "XY: the axes are 5.1 % out of square, expected -5 to 5 %: measure again, or mend the frame"),
        ("M852 I0 K-2", "YZ: the axes are -200 % out of square"),
        ("SET_SKEW XZ=150,130,100", "XZ: the axes are 14.36 % out of square"),
        ("SET_SKEW XY=100,100,300", "XY: no parallelogram has these lengths"),
        ("CALC_MEASURED_SKEW AC=100 BD=100 AD=300", "XY: no parallelogram"),
    ] {
        let error = execute(&mut printer, line).unwrap_err();
        assert!(error.to_string().contains(says), "{line}: {error}");
        assert_eq!(printer.interpreter.skew, before, "{line}");
    }
}

/// Babysteps, a lift and a pause, with a skew that changes in between: coordinates and axes agree
/// at each end.
#[test]
fn a_shift_a_lift_and_a_pause_keep_both_sides() {
    let rig = Rig::new(|profile| {
        profile.skew = Skew::of_factors([0.01, 0.05, -0.03]);
        profile.retraction.lift_10nm = 2 * MM;
        profile.retraction.length_10nm = MM;
        profile.retraction.retract_10nm_per_s = 10 * MM;
        profile.retraction.recover_10nm_per_s = 10 * MM;
    });
    let mut printer = rig.printer();
    let agree = |printer: &RigPrinter<'_>, line: &str| {
        let modal = &printer.interpreter.modal;
        let [x, y, z] = modal.machine_10nm;
        let raised = [x, y, z + modal.lift_10nm + modal.z.shift_10nm];
        let axes = printer.interpreter.skew.axes(raised).map(|units| units as f64 / MM as f64);
        assert_eq!(axes, rig.believed_mm(), "{line}");
    };
    execute(&mut printer, "M302 P1").unwrap();
    for line in
        ["G28", "G1 X100 Y100 Z20 F6000", "M290 Z0.5", "G10", "G1 X50", "M601", "M852 I-0.02 J0", "G11", "G28 X"]
    {
        execute(&mut printer, line).unwrap();
        agree(&printer, line);
    }
    execute(&mut printer, "G1 X50 Y60 Z21").unwrap();
    assert_eq!(logical_10nm(&printer), [50 * MM, 60 * MM, 21 * MM]);
    agree(&printer, "the end");
}

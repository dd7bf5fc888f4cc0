//! Temperatures, fans, gains and their search.

use super::*;

#[test]
fn heaters_and_fans() {
    reads("M104 S210 ; set", Command::SetNozzle(None, some("210")));
    reads("M104 T0 S210", Command::SetNozzle(Some(0), some("210")));
    reads("M104 S0 T1", Command::SetNozzle(Some(1), some("0")));
    reads("M104 T-1 S210", Command::SetNozzle(Some(255), some("210")));
    reads("M109 T2 R50", Command::WaitNozzle(Some(2), WaitTarget::HeatingOrCooling(number("50"))));
    reads_with("M104", Command::SetNozzle(None, None), "without S: no effect");
    let says = "a number without its letter is ignored; without S: no effect";
    reads_with("M104 T0 165", Command::SetNozzle(Some(0), None), says);
    reads("M140 S60 T0", Command::SetBed(some("60")));
    reads("M109 S205", Command::WaitNozzle(None, WaitTarget::Heating(number("205"))));
    reads("M109 R40", Command::WaitNozzle(None, WaitTarget::HeatingOrCooling(number("40"))));
    reads("M190 R40 S60", Command::WaitBed(WaitTarget::Heating(number("60"))));
    reads("M190", Command::WaitBed(WaitTarget::Current));
    reads("M141 S50", Command::SetChamber(some("50")));
    reads_with("M141", Command::SetChamber(None), "without S: no effect");
    reads("M191 S50", Command::WaitChamber(WaitTarget::Heating(number("50"))));
    reads("M191 R30", Command::WaitChamber(WaitTarget::HeatingOrCooling(number("30"))));
    // Off, in the end codes of other firmwares.
    let is_off = "a target below 0 is off";
    reads_with("M104 S-5", Command::SetNozzle(None, some("0")), is_off);
    reads_with("M140 S-273.15", Command::SetBed(some("0")), is_off);
    reads_with("M141 S-273", Command::SetChamber(some("0")), is_off);
    reads_with("M109 T1 S-1", Command::WaitNozzle(Some(1), WaitTarget::Heating(number("0"))), is_off);
    reads_with("M190 R-0.5", Command::WaitBed(WaitTarget::HeatingOrCooling(number("0"))), is_off);
    // A second bed, or chamber.
    for text in ["M140 P1 S60", "M190 P1 S60", "M141 P1 S60"] {
        reads_with(text, Command::Accepted, "P has no effect; S has no effect");
    }
    reads("M140 P0 S60", Command::SetBed(some("60")));
    reads("M106", Command::Fan { number: 0, power: 255 });
    reads("M106 S252.45", Command::Fan { number: 0, power: 252 });
    reads("M106 P2 S249.9", Command::Fan { number: 2, power: 250 });
    reads("M107 P1", Command::Fan { number: 1, power: 0 });
    let small = "S: full power is 255, as in Marlin (in RepRapFirmware 1)";
    reads_with("M106 S1", Command::Fan { number: 0, power: 1 }, small);
    reads_with("M106 S0.5", Command::Fan { number: 0, power: 1 }, small);
    reads("M106 S0", Command::Fan { number: 0, power: 0 });
    for text in ["M106 I0", "M106 P0 T128", "M106 P1 H1", "M106 R2", "M106 S255 I1"] {
        let mut remarks = Remarks::default();
        assert_eq!(parse_with_remarks(text, &mut remarks), Ok(Command::Accepted), "{text}");
        assert!(remarks.to_string().ends_with("has no effect; the fan's power stays; S sets it"), "{text}: {remarks}");
    }
    reads("M123", Command::ReportFans);
    reads_with("M123 S5", Command::ReportFans, "S has no effect");
    let full = Command::Fan { number: 0, power: 255 };
    reads_with("M106 S300", full, "S is too large and becomes the largest value");
    reads_with("M106 S", full, "S without a number is ignored");
    assert_eq!(refused("M106 S-.3"), "S: -0.3 is out of range, expected 0 to 255");
    // Other machines' slicers write the power as P.
    let says = "P must be whole, the fraction is dropped";
    reads_with("M106 P127.5", Command::Fan { number: 127, power: 255 }, says);
    reads_with("M106 P1.5 S3", Command::Fan { number: 1, power: 3 }, says);
    assert_eq!(refused("M106 P256"), "P: 256 is out of range, expected 0 to 255");
    // ANCHOR: m302
    reads("M302 S170 P1", Command::ColdExtrusion { minimum: some("170"), allow: Some(true) });
    assert_eq!(refused("M302 P2"), "P: 2 is out of range, expected 0 to 1");
    // ANCHOR_END: m302
}

#[test]
fn gains_of_heaters_and_their_search() {
    let gains = |p: &str, i: &str, d: &str, f: Option<Decimal>| GainWords {
        proportional: some(p),
        integral: some(i),
        derivative: some(d),
        fan: f,
    };
    reads("M301 P22.2 I1.08 D114", Command::NozzleGains(None, gains("22.2", "1.08", "114", None)));
    reads("M301 E0 P22.2 I1.08 D114 F0.2", Command::NozzleGains(Some(0), gains("22.2", "1.08", "114", some("0.2"))));
    reads_with(
        "M301 P22.2 I1.08 D114 C100 L20",
        Command::NozzleGains(None, gains("22.2", "1.08", "114", None)),
        "C has no effect; L has no effect",
    );
    reads("M301 H1 P22.2 I1.08 D114", Command::NozzleGains(None, gains("22.2", "1.08", "114", None)));
    reads("M301 H0 P22.2 I1.08 D114", Command::BedGains(gains("22.2", "1.08", "114", None)));
    assert!(refused("M301 H2 P22").contains("H1 (nozzle) or H0 (bed)"));
    reads("M304 P-1 I0 D600", Command::BedGains(gains("-1", "0", "600", None)));
    reads("M304", Command::BedGains(GainWords::default()));
    reads("M301 E1 P22", Command::NozzleGains(Some(1), GainWords { proportional: some("22"), ..GainWords::default() }));
    assert!(refused("M301 Pnan").contains("nan"), "{}", refused("M301 Pnan"));
    reads("M309 P0.5 I0.01 D20", Command::ChamberGains(gains("0.5", "0.01", "20", None)));
    let tune =
        |of, target: Option<&str>, cycles, uses| Command::Autotune { of, target: target.and_then(some), cycles, uses };
    reads("M303", tune(TunedHeater::Nozzle(None), None, None, false));
    reads("M303 E0 S215 C8", tune(TunedHeater::Nozzle(Some(0)), Some("215"), Some(8), false));
    reads("M303 E-1 S60 U", tune(TunedHeater::Bed, Some("60"), None, true));
    reads("M303 E-1 S60 U0", tune(TunedHeater::Bed, Some("60"), None, false));
    reads("M303 H0 S60 U1", tune(TunedHeater::Bed, Some("60"), None, true));
    reads("M303 H1 S60", tune(TunedHeater::Nozzle(None), Some("60"), None, false));
    reads("M303 T1", tune(TunedHeater::Nozzle(Some(1)), None, None, false));
    reads_with("M303 D", Command::Accepted, "D has no effect");
    reads("M303 E1", tune(TunedHeater::Nozzle(Some(1)), None, None, false));
    reads("M303 E-2 S50", tune(TunedHeater::Chamber, Some("50"), None, false));
    for text in ["M303 E-3", "M303 H2", "M303 E0 H0"] {
        assert!(refused(text).contains("E0 or H1 (nozzle), E-1 or H0 (bed)"), "{text}: {}", refused(text));
    }
    assert_eq!(refused("M303 C21"), "C: 21 is out of range, expected 0 to 20");
}

//! Measuring of the bed: the table `mesh`.

use ferrostep_printer::Profile;
use ferrostep_profiles::{builtin_text, parse};

/// The MINI's table.
pub const MESH: &str = "[mesh]
points = { x = 4, y = 4 }
area_mm = { x = [5, 151], y = [5, 175] }
lift_mm = 2
depth_mm = 1
";

/// The MINI's profile with another table.
fn mini(table: &str) -> String {
    let text = builtin_text("prusa-mini").unwrap();
    assert_eq!(text.matches(MESH).count(), 1);
    text.replace(MESH, table)
}

fn profile(table: &str) -> Profile {
    parse(&mini(table), "mini.toml").unwrap()
}

fn error(table: &str) -> String {
    parse(&mini(table), "mini.toml").expect_err(table).to_string()
}

#[test]
fn a_probe_measures_what_it_reaches() {
    let mesh = profile(MESH).mesh.unwrap();
    assert_eq!((mesh.points, mesh.fade_10nm, mesh.samples), ([4, 4], 1_000_000, 1));
    assert_eq!(mesh.area_10nm, [[500_000, 15_100_000], [500_000, 17_500_000]]);
    // 29 mm to the left of the nozzle and 3 mm in front of it.
    let mesh = profile("").mesh.unwrap();
    assert_eq!((mesh.points, mesh.lift_10nm, mesh.depth_10nm), ([4, 4], 400_000, 100_000));
    // Not at the very ends of the bed, where it may miss the sheet.
    assert_eq!(mesh.area_10nm, [[500_000, 15_140_000], [500_000, 17_500_000]]);
    for name in ["cartesian", "corexy"] {
        assert_eq!(ferrostep_profiles::load(name).unwrap().mesh, None, "{name}");
    }
}

#[test]
fn bad_values_are_refused_by_name() {
    for (table, says) in [
        ("[mesh]\npoints = { x = 16, y = 4 }\n", "mesh.points.x = 16: expected 2 to 15 points"),
        ("[mesh]\npoints = { x = 4, y = 1 }\n", "mesh.points.y = 1: expected 2 to 15 points"),
        ("[mesh]\npoints = { x = 4, y = 3.5 }\n", "mesh.points.y = 3.5: expected a whole number"),
        (
            "[mesh]\narea_mm = { x = [5, 160], y = [5, 175] }\n",
            "mesh.area_mm.x = [5, 160]: expected within 0 to 151.4 mm",
        ),
        (
            "[mesh]\narea_mm = { x = [5, 150], y = [-1, 175] }\n",
            "mesh.area_mm.y = [-1, 175]: expected within 0 to 177 mm",
        ),
        ("[mesh]\narea_mm = { x = [50, 50.5], y = [5, 175] }\n", "mesh.area_mm.x = [50, 50.5]: expected within"),
        ("[mesh]\nfade_mm = -1\n", "mesh.fade_mm = -1: expected 0 to 100 mm"),
        ("[mesh]\ndepth_mm = 4\n", "mesh.depth_mm = 4: expected 0.1 to 3 mm"),
        ("[mesh]\nlift_mm = 0\n", "mesh.lift_mm = 0: expected 0.5 to 50 mm"),
        ("[mesh]\nsamples = 11\n", "mesh.samples = 11: expected 1 to 10"),
        ("[mesh]\npoint = 4\n", "unknown key \"mesh.point\""),
        ("[mesh]\n[mesh.sheet]\nbend_mm = 9\n", "mesh.sheet.bend_mm = 9: expected -5 to 5 mm"),
    ] {
        let error = error(table);
        assert!(error.contains(says), "{table}: {error}");
    }
}

#[test]
fn without_a_probe_or_a_z_of_its_own_there_is_none() {
    let cartesian = builtin_text("cartesian").unwrap();
    let error = parse(&format!("{cartesian}\n{MESH}"), "own.toml").unwrap_err().to_string();
    let says = "expected homing.z.sensor = \"probe\" with it: without a probe the bed cannot be measured";
    assert!(error.contains(says), "{error}");
    let shared = mini(MESH).replace("kinematics = \"cartesian\"", "kinematics = \"corexz\"");
    let error = parse(&shared, "own.toml").unwrap_err().to_string();
    assert!(
        error.contains("kinematics = \"corexz\": expected \"cartesian\" or \"corexy\" with the table [mesh]"),
        "{error}"
    );
}

/// The place of the measurement changes no plan: a prepared job for one is for the other.
#[test]
fn the_table_binds_no_prepared_job() {
    assert_eq!(profile("").plan_hash, profile(MESH).plan_hash);
    assert_eq!(profile("[mesh]\n[mesh.sheet]\nbend_mm = 1\n").plan_hash, profile(MESH).plan_hash);
}

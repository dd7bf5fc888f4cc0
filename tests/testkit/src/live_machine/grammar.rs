//! Actions of a host, made of any bytes: lines of a grammar that is nasty, raw bytes, silences
//! and emergencies.

use std::fmt::Write;

use arbitrary::Unstructured;
use ferrostep_gcode::Emergency;

use crate::board_model::CYCLES_A_MS;
use crate::host_side::checksum;

const CODES: [&str; 106] = [
    "G0",
    "G1",
    "G1",
    "G1",
    "G1",
    "G1",
    "G1",
    "G1",
    "G2",
    "G3",
    "G4",
    "G5",
    "G10",
    "G11",
    "G18",
    "G20",
    "G21",
    "G28",
    "G29",
    "G53",
    "G90",
    "G91",
    "G92",
    "M17",
    "M18",
    "M84",
    "M82",
    "M83",
    "M86",
    "M104",
    "M109",
    "M140",
    "M190",
    "M290",
    "M851",
    "M105",
    "M106",
    "M107",
    "M108",
    "M110",
    "M112",
    "M113",
    "M114",
    "M115",
    "M117",
    "M118",
    "M119",
    "M122",
    "M155",
    "M200",
    "M201",
    "M203",
    "M204",
    "M205",
    "M207",
    "M208",
    "M211",
    "M220",
    "M221",
    "M301",
    "M302",
    "M303",
    "M304",
    "M306",
    "M400",
    "M410",
    "M412",
    "M569",
    "M790",
    "M795",
    "M796",
    "M797",
    "M798",
    "M906",
    "M913",
    "M914",
    "M999",
    "M0",
    "M25",
    "M600",
    "M601",
    "M602",
    "M876",
    "T0",
    "T1",
    "%",
    "M1",
    "M20",
    "M24",
    "M27",
    "M73",
    "M85",
    "M125",
    "M226",
    "M524",
    "M593",
    "M900",
    "M572",
    "M593 P\"mzv\"",
    "M593 P\"ei\"",
    "M862.1",
    "SET_INPUT_SHAPER SHAPER_TYPE=zvd SHAPER_FREQ_X=40",
    "SET_VELOCITY_LIMIT ACCEL=700",
    "TURN_OFF_HEATERS",
    "PAUSE",
    "RESUME",
];

const LETTERS: &[u8] = b"XYZEFXYZEFXYZEFIJRPSTHWDAKLNGM(*;";

const NUMBERS: [&str; 60] = [
    "",
    "0",
    "-0",
    "1",
    "2",
    "3",
    "5",
    "10",
    "20",
    "50",
    "100",
    "0.001",
    "0.002",
    "0.0049",
    "0.00625",
    "0.0125",
    "0.00001",
    "0.000000001",
    "0.01",
    "0.02",
    "0.03",
    "0.1",
    "0.5",
    "1.5",
    "-.8",
    ".",
    "-",
    "+7",
    "1.2.3",
    "1e5",
    "-0.002",
    "-0.004",
    "-0.01",
    "-0.1",
    "-1",
    "-2",
    "-5",
    "-10",
    "-50",
    "99.9",
    "127.5",
    "180",
    "199.999",
    "200",
    "255",
    "300",
    "600",
    "999",
    "1200",
    "3000",
    "6000",
    "9000",
    "60000",
    "1000000",
    "4999",
    "5000",
    "5001",
    "-4999",
    "9223372036",
    "9223372037",
];

/// The next action of a host.
pub(super) enum Said {
    /// Bytes, which may be half a line.
    Bytes(Vec<u8>),
    /// Silence, ms.
    Silence(u64),
    /// M400, and a check of all positions.
    Finish,
    /// An emergency command that acts after this many cycles, regardless of what the board does.
    Emergency(Emergency, u64),
}

/// A line of the grammar.
fn line(bytes: &mut Unstructured<'_>) -> arbitrary::Result<String> {
    let mut line = (*bytes.choose(&CODES)?).to_owned();
    for _ in 0..bytes.int_in_range(0..=5)? {
        let letter = char::from(*bytes.choose(LETTERS)?);
        let number = if bytes.ratio(1, 3)? {
            // A place anywhere on a machine, to a thousandth.
            let thousandths = bytes.int_in_range(-20_000..=320_000i32)?;
            format!("{}", f64::from(thousandths) / 1000.0)
        } else {
            (*bytes.choose(&NUMBERS)?).to_owned()
        };
        // Writing to a string cannot fail.
        let _ = write!(line, " {letter}{number}");
    }
    Ok(line)
}

/// Moves that a machine can do: one across it, or short pieces that continue each other.
fn moves(bytes: &mut Unstructured<'_>) -> arbitrary::Result<String> {
    let mm = |thousandths: i32| f64::from(thousandths) / 1000.0;
    let feed = *bytes.choose(&["", " F300", " F1200", " F3000", " F6000", " F9000", " F30000"])?;
    let mut lines = String::new();
    if bytes.ratio(1, 3)? {
        let [x, y] = [bytes.int_in_range(0..=180_000)?, bytes.int_in_range(0..=180_000)?].map(mm);
        let extrudes = *bytes.choose(&["", " E0.5", " E5", " E-0.8", " E30"])?;
        let _ = writeln!(lines, "G90\nM83\nG1 X{x} Y{y}{extrudes}{feed}");
        return Ok(lines);
    }
    let most = *bytes.choose(&[3, 12, 50, 300, 3000])?;
    let [x, y] = [bytes.int_in_range(-most..=most)?, bytes.int_in_range(-most..=most)?];
    let z = if bytes.ratio(1, 8)? { bytes.int_in_range(-most / 4..=most / 4)? } else { 0 };
    let extruder = if bytes.ratio(1, 2)? { bytes.int_in_range(-most..=most)? } else { 0 };
    let _ = writeln!(lines, "G91\nG1{feed}");
    for _ in 0..bytes.int_in_range(1..=12)? {
        let [x, y, z, extruder] = [x, y, z, extruder].map(mm);
        let times = f64::from(bytes.int_in_range(0..=5u8)?);
        let _ =
            writeln!(lines, "G1 X{:.3} Y{:.3} Z{:.3} E{:.3}{feed}", x * times, y * times, z * times, extruder * times);
    }
    if bytes.ratio(1, 4)? {
        let _ = writeln!(lines, "G1 E{:.3} F600", mm(bytes.int_in_range(-5000..=5000)?));
    }
    Ok(lines)
}

pub(super) fn said(bytes: &mut Unstructured<'_>, number: &mut i64) -> arbitrary::Result<Said> {
    Ok(match bytes.int_in_range(0..=15u8)? {
        0 if bytes.ratio(1, 2)? => Said::Silence(bytes.int_in_range(0..=300)?),
        0 => Said::Finish,
        1 => {
            let emergency = bytes.choose(&[Emergency::EndWait, Emergency::QuickStop, Emergency::Stop])?;
            Said::Emergency(*emergency, bytes.int_in_range(0..=200 * CYCLES_A_MS)?)
        }
        2 => {
            let length = bytes.int_in_range(0..=40)?;
            Said::Bytes(bytes.bytes(length)?.to_vec())
        }
        3 | 4 => {
            let text = format!("N{number} {}", line(bytes)?.split(['*', ';']).next().unwrap_or_default());
            let checksum = checksum(&text);
            // One in sixteen has another number, or another checksum.
            *number += i64::from(!bytes.ratio(1, 16)?);
            let wrong = u8::from(bytes.ratio(1, 16)?);
            Said::Bytes(format!("{text}*{}\n", checksum ^ wrong).into_bytes())
        }
        5..=9 => Said::Bytes(moves(bytes)?.into_bytes()),
        _ => Said::Bytes(format!("{}\n", line(bytes)?).into_bytes()),
    })
}

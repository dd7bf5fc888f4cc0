//! Temperatures and position, read from the printer's lines.

use ferrostep_web::Heat;

/// Source of temperatures and position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Readings {
    /// The printer's lines: its reports (M155), and M114 where it is asked.
    Asked,
    /// The virtual board itself, so that no line is needed.
    Told,
}

/// The temperatures of a report: `T:20.0 /0.0 B:20.0 /0.0 @:0`, alone or after `ok`.
pub fn heat(line: &str) -> Option<Heat> {
    let line = line.strip_prefix("ok").unwrap_or(line).trim_start();
    let (nozzle_celsius, nozzle_target_celsius) = pair(line.strip_prefix("T:")?)?;
    let after = |name| line.split_once(name).and_then(|(_, words)| pair(words));
    let (bed_celsius, bed_target_celsius) = after(" B:").unwrap_or_default();
    let (chamber_celsius, chamber_target_celsius) = after(" C:").unzip();
    Some(Heat {
        nozzle_celsius,
        nozzle_target_celsius,
        bed_celsius,
        bed_target_celsius,
        chamber_celsius,
        chamber_target_celsius,
    })
}

/// A temperature and its target: `20.0 /0.0`.
fn pair(text: &str) -> Option<(f64, f64)> {
    let mut words = text.split_ascii_whitespace();
    let celsius = number(words.next()?)?;
    let target = words.next()?.strip_prefix('/').and_then(number)?;
    Some((celsius, target))
}

/// The position of an answer to M114: `X:1.00 Y:2.00 Z:3.00 E:4.00 Count ...`, mm.
pub fn position_mm(line: &str) -> Option<[f64; 3]> {
    let mut words = line.split_ascii_whitespace();
    let mut axis = |name: &str| words.next()?.strip_prefix(name).and_then(number);
    Some([axis("X:")?, axis("Y:")?, axis("Z:")?])
}

fn number(text: &str) -> Option<f64> {
    text.parse().ok().filter(|number: &f64| number.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reports_are_read() {
        let expected = Heat {
            nozzle_celsius: 201.5,
            nozzle_target_celsius: 215.0,
            bed_celsius: 60.0,
            bed_target_celsius: 0.0,
            chamber_celsius: None,
            chamber_target_celsius: None,
        };
        for line in
            ["ok T:201.50 /215.00 B:60.00 /0.00 @:12 B@:0", " T:201.5 /215 B:60.0 /0.00 @:1", "T:201.5 /215 B:60.0 /0"]
        {
            assert_eq!(heat(line), Some(expected), "{line}");
        }
        let warm = Heat { chamber_celsius: Some(41.5), chamber_target_celsius: Some(50.0), ..expected };
        assert_eq!(heat("ok T:201.5 /215 B:60.0 /0 C:41.5 /50 @:12 B@:0 C@:127"), Some(warm));
        for line in ["ok", "T:", "T:nan /0", "T:20", "echo:T:20 /0", ""] {
            assert_eq!(heat(line), None, "{line}");
        }
        assert_eq!(position_mm("X:55.00 Y:-1.00 Z:0.20 E:4.00 Count X:1 Y:2"), Some([55.0, -1.0, 0.2]));
        assert_eq!(position_mm("X:55.00 Y:inf Z:0"), None);
    }
}

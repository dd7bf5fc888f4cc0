//! Values of arguments, as a person writes them.

#[cfg(unix)]
use std::net::SocketAddr;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use ferrostep_analysis::sweep::{Values, ValuesError};
use ferrostep_profiles::PlannedBy;

/// An end of the part of a print that `--vcd` shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Edge {
    /// Seconds of motion.
    Seconds(f64),
    /// A line of the file, from 1.
    Line(u32),
    /// A layer, from 1.
    Layer(u32),
}

/// Reads `12.5`, `line:120` or `layer:3`.
///
/// # Errors
/// The text has none of these forms.
pub fn edge(text: &str) -> Result<Edge, String> {
    let number = |text: &str| text.parse().ok().filter(|number: &u32| *number > 0);
    let edge = match text.split_once(':') {
        Some(("line", line)) => number(line).map(Edge::Line),
        Some(("layer", layer)) => number(layer).map(Edge::Layer),
        Some(_) => None,
        None => text.parse().ok().filter(|seconds: &f64| seconds.is_finite() && *seconds >= 0.0).map(Edge::Seconds),
    };
    edge.ok_or_else(|| "expected seconds, 0 or more, as 12.5, a line, as line:120, or a layer, as layer:3".to_owned())
}

/// The names of rules.
pub fn rules() -> impl TypedValueParser<Value = PlannedBy> {
    PossibleValuesParser::new(PlannedBy::NAMED.map(|(name, _)| name))
        .map(|name| PlannedBy::named(&name).unwrap_or(PlannedBy::Own))
}

/// A key and its value.
pub fn key_and_value(text: &str) -> Result<(String, f64), String> {
    let (key, value) = text.split_once('=').ok_or("expected KEY=VALUE, as junction_deviation_mm=0.02")?;
    let number = value.trim().parse().ok().filter(|number: &f64| number.is_finite());
    Ok((key.trim().to_owned(), number.ok_or_else(|| format!("\"{}\" is not a number", value.trim()))?))
}

/// A key and its values.
pub fn key_and_values(text: &str) -> Result<(String, Values), String> {
    let (key, values) = text.split_once('=').ok_or("expected KEY=VALUES, as junction_deviation_mm=0.005..0.08")?;
    Ok((key.trim().to_owned(), values.parse().map_err(|error: ValuesError| error.to_string())?))
}

/// The address of a page's server.
#[cfg(unix)]
pub fn web_address(text: &str) -> Result<SocketAddr, String> {
    text.parse().map_err(|_| "write an address of this computer with a port, such as 127.0.0.1:8790".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_are_seconds_lines_or_layers() {
        for (text, expected) in [
            ("12.5", Edge::Seconds(12.5)),
            ("0", Edge::Seconds(0.0)),
            ("line:120", Edge::Line(120)),
            ("layer:3", Edge::Layer(3)),
        ] {
            assert_eq!(edge(text), Ok(expected));
        }
        for text in ["-1", "inf", "nan", "", "line:", "line:0", "layer:-2", "layer:1.5", "row:3", "line 3"] {
            assert!(edge(text).is_err(), "{text}");
        }
    }
}

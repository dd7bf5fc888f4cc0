//! Sensors by numbers of their data sheets, as a profile says them.

use toml::{Table, Value};

/// Reason for which a chamber beside a second nozzle is not kept.
pub(crate) const CONNECTOR_TAKEN: &str =
    "the second nozzle is at the board's nozzle1: write a table chamber by hand, with a connector that is free";

/// Three points of a data sheet, from the coldest on.
pub(crate) fn points(mut points: [(f64, f64); 3]) -> Value {
    points.sort_by(|(colder, _), (hotter, _)| colder.total_cmp(hotter));
    let list = |each: fn(&(f64, f64)) -> f64| points.iter().map(|point| Value::Float(each(point))).collect::<Vec<_>>();
    let (celsius, ohm) = (list(|(celsius, _)| *celsius), list(|(_, ohm)| *ohm));
    Value::Table(Table::from_iter([("celsius".to_owned(), celsius.into()), ("ohm".to_owned(), ohm.into())]))
}

/// A resistance at 25 degrees Celsius, ohms, and a beta, K.
pub(crate) fn beta_table(r25_ohm: f64, beta_k: f64) -> Value {
    Value::Table(Table::from_iter([("r25_ohm".to_owned(), r25_ohm.into()), ("beta_k".to_owned(), beta_k.into())]))
}

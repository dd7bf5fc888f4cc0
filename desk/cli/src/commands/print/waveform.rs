//! The part of a print that `--vcd` shows: from and to seconds, lines or layers.

use std::path::Path;

use ferrostep_session::input::{self, Input};
use ferrostep_session::layer_lines::layer_lines;
use ferrostep_session::record::{Bound, Window};

use crate::arguments::Edge;

/// The part of a file's motion between two edges.
///
/// # Errors
/// The part ends before it begins, or the file does not have this layer.
pub fn window(file: &Path, from: Option<Edge>, to: Option<Edge>) -> Result<Window, String> {
    let layers = match (from, to) {
        (Some(Edge::Layer(_)), _) | (_, Some(Edge::Layer(_))) => layers(file)?,
        _ => Vec::new(),
    };
    let line_of = |layer: u32| {
        let index = usize::try_from(layer - 1).unwrap_or(usize::MAX);
        let count = layers.len();
        layers.get(index).copied().ok_or_else(|| match count {
            0 => format!("layer:{layer}: no comment of {} begins a layer: give lines or seconds", input::name(file)),
            count => format!("layer:{layer}: {} has {count} layers", input::name(file)),
        })
    };
    let begin = match from {
        None => Bound::Seconds(0.0),
        Some(Edge::Seconds(seconds)) => Bound::Seconds(seconds),
        Some(Edge::Line(line)) => Bound::Line(line),
        Some(Edge::Layer(layer)) => Bound::Line(line_of(layer)?),
    };
    let end = match to {
        None => None,
        Some(Edge::Seconds(seconds)) => Some(Bound::Seconds(seconds)),
        Some(Edge::Line(line)) => Some(Bound::Line(line)),
        // Up to the line before the next layer's first.
        Some(Edge::Layer(layer)) => {
            line_of(layer)?;
            line_of(layer.saturating_add(1)).ok().map(|next| Bound::Line(next.saturating_sub(1)))
        }
    };
    let window = Window { from: begin, to: end };
    if window.is_reversed() {
        return Err(format!(
            "--to {}: the waveform ends before it begins (--from {}): write a later place",
            to.map_or_else(String::new, text),
            from.map_or_else(|| "0".to_owned(), text)
        ));
    }
    Ok(window)
}

fn text(edge: Edge) -> String {
    match edge {
        Edge::Seconds(seconds) => seconds.to_string(),
        Edge::Line(line) => format!("line:{line}"),
        Edge::Layer(layer) => format!("layer:{layer}"),
    }
}

/// The lines at which the layers of a file begin.
fn layers(file: &Path) -> Result<Vec<u32>, String> {
    let name = input::name(file);
    if !file.metadata().is_ok_and(|metadata| metadata.is_file()) {
        return Err(format!(
            "{name}: its layers are counted before it is printed, so it must be a file: give lines or seconds"
        ));
    }
    let input = Input::open(file).map_err(|error| format!("{name}: {error}"))?;
    if input.is_prepared() {
        return Err(format!("{name}: this is a prepared job, which does not name its layers: give lines or seconds"));
    }
    layer_lines(input).map_err(|error| format!("{name}: {error}"))
}

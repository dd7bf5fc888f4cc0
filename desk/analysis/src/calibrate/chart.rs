//! The spectrum of a record, and what the recommended shaper leaves of it, drawn.

use std::fmt::Write;

use ferrostep_calibration::Spectrum;
use ferrostep_svg::{escaped, page};

use super::FrameMeasurement;

/// The page, and the part of it that shows numbers, pixels.
const PAGE: [f64; 2] = [750.0, 420.0];
const LEFT: f64 = 60.0;
const RIGHT: f64 = 30.0;
const TOP: f64 = 60.0;
const BOTTOM: f64 = 60.0;
const INNER: [f64; 2] = [PAGE[0] - LEFT - RIGHT, PAGE[1] - TOP - BOTTOM];

/// Frequencies that are drawn, Hz.
const SHOWN_HZ: f64 = 200.0;

/// Colours of the record and of what the recommended shaper leaves.
const COLOURS: [&str; 2] = ["#0072b2", "#d55e00"];

/// The square root of the density over frequency, as recorded and as the recommended shaper leaves
/// it, each as a part of the highest; and where the mode is. `None` without a record.
pub fn draw(measured: &FrameMeasurement) -> Option<String> {
    let spectrum = measured.spectrum.as_ref()?;
    let mode = &measured.mode;
    let title = format!("{}: {}", measured.axis, measured.source);
    let mut content = frame(&title);
    let [low, high] = [-1.0, 1.0].map(|side| across(mode.frequency_hz + side * mode.frequency_uncertainty_hz));
    let _ = writeln!(
        content,
        "<rect x=\"{low:.1}\" y=\"{TOP}\" width=\"{:.1}\" height=\"{}\" fill=\"#8c959f\" fill-opacity=\"0.35\"/>",
        (high - low).max(1.0),
        INNER[1]
    );
    let highest = amplitudes(spectrum).map(|(_, amplitude)| amplitude).fold(f64::MIN_POSITIVE, f64::max);
    let taken = measured.shapers.scores.get(measured.shapers.choice.index())?;
    let shaper = measured.shapers.shaper(taken)?;
    let mut curve = |index: usize, name: &str, left: &dyn Fn(f64) -> f64| {
        let mut path = String::new();
        for (frequency_hz, amplitude) in amplitudes(spectrum) {
            let start = if path.is_empty() { 'M' } else { 'L' };
            let part = left(frequency_hz) * amplitude / highest;
            let y = PAGE[1] - BOTTOM - (INNER[1] - 10.0) * part;
            let _ = write!(path, "{start}{:.1} {y:.1}", across(frequency_hz));
        }
        let (colour, x) = (COLOURS[index], PAGE[0] - RIGHT - 10.0);
        let y = TOP + 20.0 + 20.0 * index as f64;
        let _ = writeln!(
            content,
            "<path d=\"{path}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\"/>\n\
             <text x=\"{x}\" y=\"{y}\" text-anchor=\"end\" fill=\"{colour}\">{}</text>",
            escaped(name)
        );
    };
    curve(0, "as recorded", &|_| 1.0);
    let name = format!("with {} for {:.1} Hz", taken.kind, taken.frequency_hz);
    curve(1, &name, &|frequency_hz| shaper.residual(frequency_hz, mode.damping));
    Some(page(&title, PAGE, 13, content))
}

/// The title, the frame and the frequencies below it.
fn frame(title: &str) -> String {
    let mut content = format!(
        "<text x=\"20\" y=\"28\" font-size=\"15\">{}</text>\n\
         <rect x=\"{LEFT}\" y=\"{TOP}\" width=\"{}\" height=\"{}\" fill=\"none\" stroke=\"#8c959f\"/>\n",
        escaped(title),
        INNER[0],
        INNER[1]
    );
    let bottom = PAGE[1] - BOTTOM;
    for frequency_hz in (0..=200_u8).step_by(25).map(f64::from) {
        let x = across(frequency_hz);
        let _ = writeln!(
            content,
            "<path d=\"M{x:.1} {bottom:.1}v5\" stroke=\"#8c959f\"/>\
             <text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{frequency_hz}</text>",
            bottom + 20.0
        );
    }
    let (middle, centre) = (LEFT + INNER[0] / 2.0, TOP + INNER[1] / 2.0);
    let _ = writeln!(
        content,
        "<text x=\"{middle:.1}\" y=\"{:.1}\" text-anchor=\"middle\">frequency, Hz</text>\n\
         <text x=\"30\" y=\"{centre:.1}\" transform=\"rotate(-90 30 {centre:.1})\" text-anchor=\"middle\">amplitude of \
         vibration</text>",
        PAGE[1] - 15.0
    );
    content
}

/// The place of a frequency, pixels.
fn across(frequency_hz: f64) -> f64 {
    LEFT + INNER[0] * frequency_hz / SHOWN_HZ
}

/// Frequencies, Hz, and the square root of the density there.
fn amplitudes(spectrum: &Spectrum) -> impl Iterator<Item = (f64, f64)> + '_ {
    spectrum.lines([2.0, SHOWN_HZ]).map(|line| (spectrum.frequency_hz(line), spectrum.density[line].sqrt()))
}

//! Slicers' comments: the start of each layer, and the estimated time of the print.

use memchr::memchr;

/// Most bytes kept of a comment: the longest that is read is a time in words.
const KEPT_BYTES: usize = 96;

/// Reads the comments at the start of lines, in a stream of portions of any size.
#[derive(Debug, Default)]
pub(crate) struct Comments {
    /// Layers begun.
    pub layers: u32,
    /// The slicer's time of the print, s.
    pub slicer_time_s: Option<f64>,
    place: Place,
    kept: Vec<u8>,
}

/// The stream's present place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Place {
    /// At the start of a line.
    #[default]
    LineStart,
    /// In a comment that began the line.
    Comment,
    /// In anything else.
    Else,
}

impl Comments {
    /// Reads some bytes.
    pub fn read(&mut self, portion: &[u8]) {
        let mut rest = portion;
        while let Some(&byte) = rest.first() {
            if self.place == Place::LineStart {
                self.place = if byte == b';' { Place::Comment } else { Place::Else };
                self.kept.clear();
            }
            let end = memchr(b'\n', rest);
            let text = rest.get(..end.unwrap_or(rest.len())).unwrap_or_default();
            if self.place == Place::Comment {
                let room = KEPT_BYTES.saturating_sub(self.kept.len());
                self.kept.extend(text.iter().take(room));
            }
            let Some(end) = end else { return };
            rest = rest.get(end + 1..).unwrap_or_default();
            self.end();
        }
    }

    /// Ends the line.
    pub fn end(&mut self) {
        if self.place == Place::Comment {
            let text = String::from_utf8_lossy(&self.kept).into_owned();
            // PrusaSlicer and its family; Cura.
            self.layers += u32::from(text.starts_with(";LAYER_CHANGE") || text.starts_with(";LAYER:"));
            if self.slicer_time_s.is_none() {
                self.slicer_time_s = time_s(&text);
            }
        }
        self.place = Place::LineStart;
    }
}

/// The time in a comment: `;TIME:1234` (Cura), `; estimated printing time (normal mode) = 1h 2m 3s` (PrusaSlicer), `; model printing
/// time: 1h 2m; total estimated time: 1h 5m` (OrcaSlicer, Bambu Studio).
fn time_s(text: &str) -> Option<f64> {
    if let Some(seconds) = text.strip_prefix(";TIME:") {
        return seconds.trim().parse().ok().filter(|seconds: &f64| seconds.is_finite() && *seconds > 0.0);
    }
    let prusa = text.strip_prefix("; estimated printing time (normal mode) = ");
    let orca = || Some(text.split_once("total estimated time: ")?.1);
    in_words_s(prusa.or_else(orca)?)
}

/// `1d 2h 3m 4s`.
fn in_words_s(text: &str) -> Option<f64> {
    let mut total_s = 0.0;
    for word in text.split_whitespace() {
        let unit = word.chars().next_back()?;
        let number: u32 = word.strip_suffix(unit)?.parse().ok()?;
        let unit_s = match unit {
            'd' => 86_400.0,
            'h' => 3_600.0,
            'm' => 60.0,
            's' => 1.0,
            _ => return None,
        };
        total_s += f64::from(number) * unit_s;
    }
    (total_s > 0.0).then_some(total_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn portions_of_any_size() {
        let text = b";x\n;LAYER_CHANGE\r\n;Z:0.2\n\n;LAYER:3\nG1 X1\nG1 ;LAYER:4\n;LAYERS\n;LAYER_CHANGE\n\
                     ; estimated printing time (normal mode) = 1d 2h 3m 4s\n;TIME:5\n";
        for size in 1..text.len() {
            let mut comments = Comments::default();
            text.chunks(size).for_each(|portion| comments.read(portion));
            assert_eq!((comments.layers, comments.slicer_time_s), (3, Some(93_784.0)), "{size}");
        }
    }

    #[test]
    fn times_of_slicers() {
        for (text, time) in [
            (";TIME:1234.5", Some(1234.5)),
            (";TIME:\r", None),
            (";TIME:nan", None),
            (";TIME_ELAPSED:7", None),
            ("; estimated printing time (normal mode) = 21m 40s\r", Some(1300.0)),
            ("; estimated printing time (silent mode) = 21m 40s", None),
            ("; estimated printing time (normal mode) = soon", None),
            ("; model printing time: 1h 2m 3s; total estimated time: 1h 5m 0s", Some(3900.0)),
        ] {
            assert_eq!(time_s(text), time, "{text}");
        }
    }

    #[test]
    fn the_last_line_needs_no_end() {
        let mut comments = Comments::default();
        comments.read(b"G28\n;TIME:60");
        comments.end();
        assert_eq!(comments.slicer_time_s, Some(60.0));
    }
}

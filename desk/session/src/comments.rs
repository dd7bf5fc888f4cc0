//! Slicers' comments in a job: how many layers have begun, and the slicer's time of the print.

use ferrostep_show::{CommentReader, Mark, Marks};

/// Reads a job's comments, in a stream of portions of any size.
#[derive(Debug, Default)]
pub(crate) struct Comments {
    /// Layers begun.
    pub layers: u32,
    /// The slicer's time of the print, s.
    pub slicer_time_s: Option<f64>,
    reader: CommentReader,
    marks: Marks,
}

impl Comments {
    /// Reads some bytes, and reports each mark with its line.
    pub fn read(&mut self, portion: &[u8], mut tell: impl FnMut(u32, &Mark)) {
        let Self { layers, slicer_time_s, reader, marks } = self;
        reader.read(portion, |line, comment| {
            if let Some(mark) = note(marks, layers, slicer_time_s, comment) {
                tell(line, &mark);
            }
        });
    }

    /// Ends the last line.
    pub fn end(&mut self) {
        let Self { layers, slicer_time_s, reader, marks } = self;
        reader.end(|_, comment| {
            note(marks, layers, slicer_time_s, comment);
        });
    }
}

fn note(marks: &mut Marks, layers: &mut u32, slicer_time_s: &mut Option<f64>, comment: &str) -> Option<Mark> {
    let mark = marks.read(comment)?;
    match mark {
        Mark::Layer => *layers = layers.saturating_add(1),
        Mark::Time(seconds) => *slicer_time_s = Some(seconds),
        Mark::Feature(_) | Mark::Height(_) | Mark::Width(_) => {}
    }
    Some(mark)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn portions_of_any_size() {
        let text = b";x\n;LAYER_CHANGE\r\n;Z:0.2\n\n;LAYER_CHANGE\rG1 X1\nG1 ;LAYER_CHANGE\n;LAYERS\n;LAYER_CHANGE\n\
                     ; estimated printing time (normal mode) = 1d 2h 3m 4s\n;TIME:5";
        for size in 1..text.len() {
            let mut comments = Comments::default();
            text.chunks(size).for_each(|portion| comments.read(portion, |_, _| {}));
            comments.end();
            assert_eq!((comments.layers, comments.slicer_time_s), (3, Some(93_784.0)), "{size}");
        }
    }
}

//! Frames that arrive while no job is being received.

use super::FLAG;

/// Separates frames from text while no job is being received. Such frames, whose bytes are not
/// lines, come from a host that has not heard how its job ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StrayFrames {
    mid_line: bool,
    in_frame: bool,
}

/// Kind of the host's next bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stretch {
    /// Text, up to the end of its line at most.
    Text,
    /// Part of a frame. When the frame ends, the receiver answers with the last [`super::Report`].
    Frame {
        /// This part ends the frame.
        ends: bool,
    },
}

impl StrayFrames {
    /// Separator at the start of a line.
    pub const fn new() -> Self {
        Self { mid_line: false, in_frame: false }
    }

    /// Number of leading bytes that belong together, and their kind.
    pub fn next(&mut self, bytes: &[u8]) -> (usize, Stretch) {
        let line_end = bytes.iter().position(|byte| matches!(byte, b'\n' | b'\r'));
        let length = line_end.map_or(bytes.len(), |end| end + 1);
        let is_frame = self.in_frame || !self.mid_line && bytes.first() == Some(&FLAG);
        *self = Self { mid_line: line_end.is_none(), in_frame: is_frame && line_end.is_none() };
        (length, if is_frame { Stretch::Frame { ends: line_end.is_some() } } else { Stretch::Text })
    }

    /// Notes that a job has ended, perhaps in the middle of a frame.
    pub fn job_ended(&mut self, in_frame: bool) {
        *self = Self { mid_line: in_frame, in_frame };
    }
}

impl Default for StrayFrames {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// However the bytes are divided, the same ones are frames.
    #[test]
    fn frames_are_told_from_text() {
        let bytes = b"G1 X~1\n~abc\nM105\r~~\n\n~x";
        let expected = b"ttttttttFFFFFtttttFFFtFF".map(|kind| kind == b'F');
        // The first line is text to its end, although it contains a flag.
        assert_eq!(bytes.len(), expected.len() - 1);
        for portion in 1..=bytes.len() {
            let (mut watch, mut kinds, mut ends) = (StrayFrames::new(), Vec::new(), 0);
            for chunk in bytes.chunks(portion) {
                let mut rest = chunk;
                while !rest.is_empty() {
                    let (length, stretch) = watch.next(rest);
                    assert!(length > 0);
                    kinds.extend(vec![stretch != Stretch::Text; length]);
                    ends += u32::from(stretch == Stretch::Frame { ends: true });
                    rest = &rest[length..];
                }
            }
            assert_eq!(kinds, expected[1..], "{portion}");
            assert_eq!(ends, 2, "{portion}");
        }
    }

    #[test]
    fn the_rest_of_a_job_is_a_frame() {
        let mut watch = StrayFrames::new();
        watch.job_ended(true);
        assert_eq!(watch.next(b"abc\nM105"), (4, Stretch::Frame { ends: true }));
        watch.job_ended(false);
        assert_eq!(watch.next(b"abc\nM105"), (4, Stretch::Text));
    }
}

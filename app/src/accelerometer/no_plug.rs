//! A board without a plug: no driver and no records.

/// In place of the recorder.
pub struct BoardRecorder;

/// The only value.
pub const fn recorder() -> BoardRecorder {
    BoardRecorder
}

//! A board without a plug: no driver and no records.

/// Stand-in for the recorder.
pub struct BoardRecorder;

/// The only value.
pub const fn recorder() -> BoardRecorder {
    BoardRecorder
}

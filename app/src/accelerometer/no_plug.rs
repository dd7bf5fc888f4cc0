//! Boards without an accelerometer connector: no driver and no records.

/// Stand-in for the recorder.
pub struct BoardRecorder;

/// Returns the only value.
pub const fn recorder() -> BoardRecorder {
    BoardRecorder
}

//! Feed against time.

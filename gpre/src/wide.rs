//! The wide encoding.

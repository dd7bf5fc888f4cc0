//! The requests between a reset and an open port.

/// A request of the enumeration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(super) enum Step {
    DescriptorHead,
    SetAddress,
    Device,
    ConfigurationHead,
    Configuration,
    Languages,
    /// One of the three strings.
    Text(u8),
    SetConfiguration,
    LineCoding,
    LineState,
    /// Clears the halt of this endpoint address in an open port.
    ClearHalt(u8),
}

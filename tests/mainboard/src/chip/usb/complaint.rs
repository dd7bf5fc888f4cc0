//! Errors of the firmware's USB driver that the core reports.

/// An error of the driver; the core reports each once until a reset.
#[derive(Debug, Clone, Copy)]
pub(super) enum Complaint {
    AbsentEndpoint,
    UnreadPacket,
    EmptyRead,
    TransmitOverflow,
    ReceiveFull,
    SetupLost,
    Overlap,
    NoPacketsIn,
    NoPacketsOut,
    DisableWithoutNak,
    SetAndClearNak,
    Babble,
    HostMode,
    Speed,
    FifoNumber,
}

impl Complaint {
    /// The register, and the reason with its section of the manual.
    pub(super) fn text(self) -> (&'static str, &'static str) {
        match self {
            Self::AbsentEndpoint => ("DIEPCTL", "this core has endpoints 0 to 3 only, RM0090 34.2"),
            Self::UnreadPacket => {
                ("GRXSTSP", "popped with words of the packet before it unread, which are lost, 34.17.6")
            }
            Self::EmptyRead => ("DFIFO", "read with no packet popped, 34.17.6"),
            Self::TransmitOverflow => ("DFIFO", "written with no room in the transmit FIFO; the word is lost, 34.11"),
            Self::ReceiveFull => ("GRXFSIZ", "no room for an OUT packet, which is NAKed, 34.11.1"),
            Self::SetupLost => ("GRXFSIZ", "no room for a SETUP packet, which is lost, 34.11.1"),
            Self::Overlap => ("DIEPTXF", "FIFOs overlap or end beyond the 320 words of packet memory, 34.11"),
            Self::NoPacketsIn => ("DIEPTSIZ", "enabled with PKTCNT 0: nothing is sent, 34.17.6"),
            Self::NoPacketsOut => ("DOEPTSIZ", "enabled with PKTCNT 0: each packet is taken as a transfer, 34.17.6"),
            Self::DisableWithoutNak => ("DOEPCTL", "disabled without the global OUT NAK in effect, 34.17.6"),
            Self::SetAndClearNak => ("DIEPCTL", "SNAK and CNAK in one write; NAK is set, 34.16.4"),
            Self::Babble => ("DOEPCTL", "a packet longer than MPSIZ is not answered, 34.16.4"),
            Self::HostMode => ("GUSBCFG", "FHMOD forces host mode, which is not modelled, 34.16.2"),
            Self::Speed => ("DCFG", "DSPD is not 3, the one speed of this core, 34.16.4"),
            Self::FifoNumber => ("DIEPCTL", "TXFNUM names a FIFO that this core lacks, 34.16.4"),
        }
    }
}

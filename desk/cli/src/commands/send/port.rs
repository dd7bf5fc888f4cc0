//! The port that a file is sent to.

use ferrostep_host::printer_line::{self, Address, FoundPort};

/// The port to use if none is named: the one with this firmware, or the only one on USB.
pub fn choose() -> Result<Address, String> {
    let ports = printer_line::ports()?;
    let only = |candidates: Vec<&FoundPort>| match candidates.as_slice() {
        [port] => Some(Address::Serial(port.name.clone())),
        _ => None,
    };
    let ours = only(ports.iter().filter(|port| port.is_ours()).collect());
    ours.or_else(|| only(ports.iter().filter(|port| port.usb.is_some()).collect())).ok_or_else(|| {
        "which port? Name it by --port PATH or --port tcp:HOST:PORT; `ferrostep ports` lists those of this computer"
            .to_owned()
    })
}

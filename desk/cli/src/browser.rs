//! The browser of the person at this computer.

use std::io::{IsTerminal, stderr};
use std::path::Path;

use ferrostep_host::printable;

use crate::terminal::tell;

/// Opens the page where a person sits at a desktop.
pub fn open_page(page: &Path) {
    let has_desktop = !cfg!(all(unix, not(target_os = "macos")))
        || ["DISPLAY", "WAYLAND_DISPLAY"]
            .iter()
            .any(|name| std::env::var_os(name).is_some_and(|value| !value.is_empty()));
    if !has_desktop || !stderr().is_terminal() || !page.is_file() {
        return;
    }
    if let Err(error) = open::that_detached(page) {
        tell(format_args!("note: {}: cannot be opened: {error}", printable::name(page)));
    }
}

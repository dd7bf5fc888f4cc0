//! The program of the page, a WASI command: see [`ferrostep_browser`].

use std::io::{self, Write};
use std::process::ExitCode;

use ferrostep_browser::{Event, Request, answer};

fn main() -> ExitCode {
    let tell = |event: &Event| {
        let mut out = io::stdout().lock();
        // The page reads line by line; once it is gone, the rest has no reader.
        if serde_json::to_writer(&mut out, event).is_ok() {
            let _ = out.write_all(b"\n");
        }
    };
    let outcome = Request::of(std::env::args().skip(1)).and_then(|request| answer(&request, tell));
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            tell(&Event::Error(message));
            ExitCode::FAILURE
        }
    }
}

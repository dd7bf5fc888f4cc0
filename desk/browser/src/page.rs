//! The page around the program, in one file.

use std::io::{self, Write};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use ferrostep_profiles::PlannedBy;
use ferrostep_show::Sources;
use flate2::{Compression, GzBuilder};

use crate::OF_JOB;

const PAGE: &str = include_str!("../page/page.html");
const STYLE: &str = include_str!("../page/page.css");
const SCRIPT: &str = concat!("'use strict';\n(() => {\n", include_str!("../page/main.js"), "})();\n");
const WORKER: &str = concat!("'use strict';\n", include_str!("../page/wasi.js"), include_str!("../page/worker.js"));

/// Maximum size of the page, bytes.
pub const MAX_BYTES: usize = 3_000_000;

/// Assembles the page around the compiled program. The same program makes the same bytes.
///
/// # Errors
/// The page would be larger than [`MAX_BYTES`], or a part has no place in it.
pub fn composed(program: &[u8]) -> io::Result<String> {
    let mut packer = GzBuilder::new().mtime(0).write(Vec::new(), Compression::best());
    packer.write_all(program)?;
    let program = STANDARD.encode(packer.finish()?);
    let option = |name: &str| format!("<option>{name}</option>");
    let of_job = format!("<option value=\"{OF_JOB}\">of the file's comments</option>");
    let machines: String = std::iter::once(of_job).chain(ferrostep_profiles::builtin_names().map(option)).collect();
    let rules: String = PlannedBy::NAMED.into_iter().map(|(name, _)| option(name)).collect();
    let mut page = String::new();
    let mut rest = PAGE;
    for (mark, part) in [
        ("{{policy}}", policy().as_str()),
        ("{{style}}", STYLE),
        ("{{version}}", ferrostep_session::VERSION),
        ("{{machines}}", &machines),
        ("{{rules}}", &rules),
        ("{{worker}}", WORKER),
        ("{{program}}", &program),
        ("{{script}}", SCRIPT),
    ] {
        let Some((before, after)) = rest.split_once(mark) else {
            return Err(io::Error::other(format!("the page has no place for {mark}")));
        };
        page += before;
        page += part;
        rest = after;
    }
    page += rest;
    if page.len() > MAX_BYTES {
        return Err(io::Error::other(format!("the page has {} bytes, expected at most {MAX_BYTES}", page.len())));
    }
    Ok(page)
}

/// The page's content security policy: it runs its own parts and shows the pages that it makes, and
/// can send nothing anywhere.
fn policy() -> String {
    let (ours, shown) = (Sources::of(SCRIPT, STYLE), Sources::of_pages());
    format!(
        "default-src 'none'; base-uri 'none'; form-action 'none'; script-src 'wasm-unsafe-eval' {} {}; style-src {} {}; \
         img-src data:; worker-src blob:; frame-src blob:",
        ours.script, shown.script, ours.style, shown.style
    )
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_page_has_everything_and_may_fetch_nothing() {
        let page = composed(b"\0asm").unwrap();
        assert!(!page.contains("{{"), "{page}");
        assert!(page.contains("<option>corexy</option>") && page.contains("<option>klipper</option>"));
        assert!(page.contains("default-src 'none'") && !page.contains("connect-src"));
        assert_eq!(page, composed(b"\0asm").unwrap());
    }

    #[test]
    fn a_page_beyond_the_bound_is_an_error() {
        // Bytes that do not pack: each depends on all before it.
        let mut state = 1_u32;
        let program: Vec<u8> = std::iter::repeat_with(|| {
            state ^= state << 13;
            state ^= state >> 17;
            state ^= state << 5;
            state as u8
        })
        .take(MAX_BYTES)
        .collect();
        assert!(composed(&program).unwrap_err().to_string().contains("expected at most 3000000"));
    }
}

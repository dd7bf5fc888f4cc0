//! Line numbers, checksums and repeat requests of the G-code protocol.

/// Texts in the errors after which a printer asks for a line again.
const TRANSFER_ERRORS: [&str; 2] = ["checksum", "line number"];

/// Formats a numbered line with its checksum.
pub(super) fn numbered(number: u32, text: &str) -> String {
    let line = format!("N{number} {text}");
    let sum = line.bytes().fold(0, |sum, byte| sum ^ byte);
    format!("{line}*{sum}\n")
}

/// Returns true if a line reports a transfer error, after which the printer asks for the line
/// again.
#[must_use]
pub fn is_transfer_error(said: &str) -> bool {
    let lower = said.to_ascii_lowercase();
    lower.starts_with("error:") && TRANSFER_ERRORS.iter().any(|text| lower.contains(text))
}

/// Returns the command, or the start of it, that a printer says it does not know.
pub(super) fn unknown(said: &str) -> Option<&str> {
    let quoted = said.split_once("Unknown command")?.1.split_once('"')?.1;
    Some(quoted.trim_end_matches(['"', '.']))
}

/// Returns the number of the line that a printer asks for.
pub(super) fn resend(said: &str) -> Option<u32> {
    let rest = said.strip_prefix("Resend:").or_else(|| said.strip_prefix("rs "))?;
    rest.trim().trim_start_matches(['N', ':', ' ']).parse().ok()
}

/// Returns true if a line is an automatic temperature report (M155), which says nothing about the
/// current line. Reports during a wait for heat also contain the remaining time, `W:`.
pub(super) fn is_report(said: &str) -> bool {
    said.trim_start().starts_with("T:") && !said.contains(" W:")
}

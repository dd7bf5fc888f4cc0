//! Opens a conversation: from then on every `ok` answers a line of this host.

use super::error::SendError;
use super::packing::Packing;
use super::port::{Patience, Port};
use super::protocol::{numbered, resend};
use super::watch::Watch;

/// Text in the answer of a printer that does not know M118 and does not repeat its text.
const UNKNOWN: &str = "\"M118\"";

/// Result of opening a conversation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Met {
    /// The printer has answered all lines.
    Printer {
        /// True if the printer has repeated the text of M118.
        repeats_text: bool,
    },
    /// [`Watch::wants_end`] returned true.
    EndWanted,
}

/// Sets the printer's line number and waits for all answers that it still owes: to an earlier
/// host's lines, to the unfinished line that it may have left, and to the lines sent here. An `ok`
/// does not say which line it answers, so M118 makes the printer repeat a text that no other host
/// sends; the `ok` after that text is the last one.
///
/// The watch hears every other line. A printer that answers without the text, because it does not
/// know M118, counts as met after a while without an `ok`.
///
/// # Errors
/// The printer does not answer, or is gone.
pub(super) fn meet(
    port: &mut impl Port,
    packing: Packing,
    patience: Patience,
    watch: &mut impl Watch,
) -> Result<Met, SendError> {
    let mut heard_at = port.now();
    let mut attempt = 0_u32;
    loop {
        // The text differs in each attempt, so that the answer to an earlier one is not taken for
        // this one.
        let name = format!("ferrostep {}-{attempt}", std::process::id());
        attempt = attempt.wrapping_add(1);
        let lines = format!("\n{}{}", numbered(0, "M110 N0"), numbered(1, &format!("M118 {name}")));
        port.send(&packing.bytes(&lines))?;
        // Last sign that the printer is working on lines of any host.
        let mut at_work = port.now();
        let (mut is_named, mut has_answered, mut wants_again) = (false, false, false);
        let mut repeats_text = false;
        loop {
            if watch.wants_end() {
                return Ok(Met::EndWanted);
            }
            let now = port.now();
            let Some(said) = port.receive(now + patience.look)? else {
                let now = port.now();
                if now.duration_since(heard_at) > patience.give_up {
                    return Err(SendError::Silent(vec!["(nothing after M110 and M118)".to_owned()]));
                }
                let enough = if wants_again { patience.ask } else { patience.repeat };
                if now.duration_since(at_work) < enough {
                    continue;
                }
                if has_answered && !wants_again {
                    return Ok(Met::Printer { repeats_text });
                }
                break;
            };
            heard_at = port.now();
            let is_ok = said.starts_with("ok");
            // Temperature reports may go on without end; before the first answer they belong to a
            // wait for heat.
            if is_ok || !has_answered || said.starts_with("echo:busy:") {
                at_work = heard_at;
            }
            if said.contains(&name) || said.contains(UNKNOWN) {
                is_named = true;
                repeats_text |= said.starts_with(&name);
                continue;
            }
            watch.hear(&said);
            // A printer that was reset or has rejected a line has not received the others.
            wants_again |= resend(&said).is_some() || said == "start";
            has_answered |= is_ok;
            if is_ok && is_named {
                return Ok(Met::Printer { repeats_text });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::send::scripted::{Scripted, echo};

    /// Meets a printer; returns the result, the number of its lines that were not read, and the
    /// number of lines it was sent.
    fn met(answer: impl FnMut(&str, usize) -> Vec<String>) -> (Result<Met, SendError>, usize, usize) {
        let mut port = Scripted::new(answer);
        let outcome = meet(&mut port, Packing::Plain, Patience::DEFAULT, &mut |_: &str| {});
        (outcome, port.unheard(), port.heard.len())
    }

    fn ok() -> Vec<String> {
        vec!["ok".to_owned()]
    }

    #[test]
    fn all_answers_of_an_earlier_host_are_heard() {
        for earlier in [0, 1, 7] {
            let answer = |line: &str, _| {
                echo(line).unwrap_or_else(|| [vec!["ok T:20.0 /0.0".to_owned(); earlier], ok()].concat())
            };
            assert!(matches!(met(answer), (Ok(Met::Printer { .. }), 0, 2)), "{earlier} answers");
        }
    }

    #[test]
    fn printers_without_m118_are_met() {
        for unknown in
            [&["ok"][..], &["echo:Unknown command: \"N1 M118\"", "ok"], &["// Unknown command:\"M118\"", "ok"]]
        {
            let answer = |line: &str, _| match line.contains("M118") {
                true => unknown.iter().map(|&line| line.to_owned()).collect(),
                false => ok(),
            };
            assert!(matches!(met(answer), (Ok(Met::Printer { .. }), 0, 2)), "{unknown:?}");
        }
    }

    #[test]
    fn a_line_that_is_lost_or_damaged_is_sent_again_with_another_text() {
        for lost in [&[][..], &["Error:checksum mismatch, Last Line: 9", "Resend: 10", "ok"], &["start"]] {
            let mut calls = 0;
            let answer = |line: &str, _| {
                calls += 1;
                match calls {
                    1 | 2 => lost.iter().map(|&line| line.to_owned()).collect(),
                    _ => echo(line).unwrap_or_else(ok),
                }
            };
            assert!(matches!(met(answer), (Ok(Met::Printer { .. }), 0, 4)), "{lost:?}");
        }
    }

    #[test]
    fn a_silent_printer_is_reported() {
        assert!(matches!(met(|_, _| vec![]), (Err(SendError::Silent(_)), 0, _)));
    }
}

//! Messages of a halted board.

/// The errors in what was heard, but for those that follow a refused line at once: every line that
/// a halted board refuses ends in an error, so that its host stops the print.
pub fn errors_by_themselves(heard: &[String]) -> Vec<&str> {
    let is_refusal = |line: &String| line.contains("M999");
    let prompted = |index: usize| index.checked_sub(1).is_some_and(|before| is_refusal(&heard[before]));
    let errors = heard.iter().enumerate().filter(|(_, line)| line.starts_with("Error:"));
    errors.filter(|&(index, _)| !prompted(index)).map(|(_, line)| line.as_str()).collect()
}

#[test]
fn an_error_after_a_refused_line_is_no_news() {
    let heard = ["ok", "echo:line 3: halted, expected M999", "Error:one", "Error:two", "ok"].map(str::to_owned);
    assert_eq!(errors_by_themselves(&heard), ["Error:two"]);
}

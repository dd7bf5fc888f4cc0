//! Replaces the names of C's macros by their values, those with arguments and
//! Marlin's own among them.

use crate::c_tokens::{Token, tokens};
use crate::definitions::Definitions;

/// Maximum number of tokens of a value with all its names replaced, and maximum depth of
/// names within names.
const MAX_TOKENS: usize = 4000;
const MAX_DEPTH: usize = 60;

/// Deepest options whose state depends on another one's.
const MAX_OPTIONS: usize = 8;

/// Beginnings of names that Marlin works out in headers that are not read.
const OWN_NAMES: [&str; 6] = ["HAS_", "IS_", "USE_", "NEED_", "HAL_", "NUM_"];

/// The tokens of a text, with all names replaced; `None` if it has too many, or depends on
/// what is not known.
pub(crate) fn expanded(text: &str, definitions: &Definitions) -> Option<Vec<Token>> {
    expanded_at(text, definitions, 0)
}

fn expanded_at(text: &str, definitions: &Definitions, options: usize) -> Option<Vec<Token>> {
    let mut expansion = Expansion { definitions, left: MAX_TOKENS, options };
    let mut out = Vec::new();
    expansion.expand(&tokens(text), &mut Vec::new(), &mut out)?;
    Some(out)
}

/// Evaluates an option as Marlin does: it is on without a value, with 1 or with true. `None` if
/// Marlin itself works it out.
pub(crate) fn is_enabled(name: &str, definitions: &Definitions) -> Option<bool> {
    is_enabled_at(name, definitions, 0)
}

fn is_enabled_at(name: &str, definitions: &Definitions, options: usize) -> Option<bool> {
    if options > MAX_OPTIONS {
        return None;
    }
    if !definitions.values.contains_key(name) {
        return if OWN_NAMES.iter().any(|start| name.starts_with(start)) { None } else { Some(false) };
    }
    let on = [Token::Name("true".to_owned()), Token::Number("1".to_owned()), Token::Number("0x1".to_owned())];
    match expanded_at(name, definitions, options + 1)?.as_slice() {
        [] => Some(true),
        [one] => Some(on.contains(one)),
        _ => Some(false),
    }
}

struct Expansion<'a> {
    definitions: &'a Definitions,
    left: usize,
    /// Options whose state is being looked for.
    options: usize,
}

impl Expansion<'_> {
    /// `within` are the names that are being replaced: none is replaced within itself.
    fn expand(&mut self, tokens: &[Token], within: &mut Vec<String>, out: &mut Vec<Token>) -> Option<()> {
        if within.len() > MAX_DEPTH {
            return None;
        }
        let mut at = 0;
        while let Some(token) = tokens.get(at) {
            at += 1;
            self.left = self.left.checked_sub(1)?;
            let Token::Name(name) = token else {
                out.push(token.clone());
                continue;
            };
            if within.contains(name) {
                out.push(token.clone());
                continue;
            }
            let call = tokens.get(at..).and_then(arguments);
            if let (Some((parameters, body)), Some((arguments, length))) = (self.definitions.functions.get(name), &call)
            {
                at += length;
                let body = substituted(&crate::c_tokens::tokens(body), parameters, arguments);
                within.push(name.clone());
                self.expand(&body, within, out)?;
                within.pop();
            } else if let Some((arguments, length)) =
                call.as_ref().filter(|_| name.starts_with("TERN") || name.starts_with("IF_"))
            {
                let Some(chosen) = self.chosen(name, arguments)? else {
                    out.push(token.clone());
                    continue;
                };
                at += length;
                within.push(name.clone());
                self.expand(&chosen, within, out)?;
                within.pop();
            } else if let Some((arguments, length)) =
                call.as_ref().filter(|_| ["ENABLED", "DISABLED"].contains(&name.as_str()))
            {
                at += length;
                let mut all = true;
                for argument in arguments {
                    let [Token::Name(option)] = argument.as_slice() else { return None };
                    all &= is_enabled_at(option, self.definitions, self.options)? == (name == "ENABLED");
                }
                out.push(Token::Number(if all { "1" } else { "0" }.to_owned()));
            } else if let Some(value) = self.definitions.values.get(name) {
                within.push(name.clone());
                self.expand(&crate::c_tokens::tokens(value), within, out)?;
                within.pop();
            } else {
                out.push(token.clone());
            }
        }
        Some(())
    }

    /// Expands Marlin's TERN and its like; the inner `None` for another name, the outer one if the
    /// condition is unknown.
    fn chosen(&self, name: &str, arguments: &[Vec<Token>]) -> Option<Option<Vec<Token>>> {
        let [condition, rest @ ..] = arguments else { return Some(None) };
        let [Token::Name(option)] = condition.as_slice() else { return None };
        let is_on = || is_enabled_at(option, self.definitions, self.options);
        let number = |digit: &str| vec![Token::Number(digit.to_owned())];
        let first = || rest.first().cloned().unwrap_or_default();
        Some(Some(match name {
            "TERN" => {
                if is_on()? {
                    first()
                } else {
                    rest.get(1).cloned().unwrap_or_default()
                }
            }
            "TERN0" => {
                if is_on()? {
                    first()
                } else {
                    number("0")
                }
            }
            "TERN1" => {
                if is_on()? {
                    first()
                } else {
                    number("1")
                }
            }
            "TERN_" | "IF_ENABLED" => {
                if is_on()? {
                    first()
                } else {
                    Vec::new()
                }
            }
            "IF_DISABLED" => {
                if is_on()? {
                    Vec::new()
                } else {
                    first()
                }
            }
            _ => return Some(None),
        }))
    }
}

/// The arguments that a text begins with, in brackets, and how many tokens they are.
fn arguments(tokens: &[Token]) -> Option<(Vec<Vec<Token>>, usize)> {
    if tokens.first() != Some(&Token::Sign("(")) {
        return None;
    }
    let (mut list, mut depth) = (vec![Vec::new()], 1_usize);
    for (index, token) in tokens.iter().enumerate().skip(1) {
        match token {
            Token::Sign("(" | "{") => depth += 1,
            Token::Sign(")" | "}") => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth == 0 {
            return Some((list, index + 1));
        }
        if depth == 1 && *token == Token::Sign(",") {
            list.push(Vec::new());
        } else if let Some(last) = list.last_mut() {
            last.push(token.clone());
        }
    }
    None
}

/// A macro's body with its arguments; names that `##` joins are one.
fn substituted(body: &[Token], parameters: &[String], arguments: &[Vec<Token>]) -> Vec<Token> {
    let mut out: Vec<Token> = Vec::new();
    let mut joins = false;
    for token in body {
        if *token == Token::Sign("##") {
            joins = true;
            continue;
        }
        let place = match token {
            Token::Name(name) => parameters.iter().position(|parameter| parameter == name),
            _ => None,
        };
        let part = match place {
            Some(place) => arguments.get(place).cloned().unwrap_or_default(),
            None => vec![token.clone()],
        };
        let mut part = part.into_iter();
        if std::mem::take(&mut joins)
            && let (Some(Token::Name(before)), Some(Token::Name(after) | Token::Number(after))) =
                (out.last_mut(), part.as_slice().first())
        {
            before.push_str(after);
            part.next();
        }
        out.extend(part);
    }
    out
}

//! Words and signs of C.

/// A word or a sign.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Token {
    /// A name.
    Name(String),
    /// Number, as written.
    Number(String),
    /// Text or a letter in quotes.
    Quoted(String),
    /// A sign.
    Sign(&'static str),
    /// Any other character.
    Other(char),
}

/// Signs, the longer ones first.
const SIGNS: [&str; 27] = [
    "&&", "||", "==", "!=", "<=", ">=", "<<", ">>", "##", "(", ")", "{", "}", ",", "?", ":", "+", "-", "*", "/", "%",
    "<", ">", "!", "~", "&", "|",
];

/// Splits a text into tokens.
pub(crate) fn tokens(text: &str) -> Vec<Token> {
    let (mut tokens, mut rest) = (Vec::new(), text.trim_start());
    while let Some(first) = rest.chars().next() {
        let length = if first == '"' || first == '\'' {
            let end = rest.get(1..).and_then(|inner| inner.find(first)).map_or(rest.len(), |end| end + 2);
            tokens.push(Token::Quoted(rest.get(..end).unwrap_or_default().to_owned()));
            end
        } else if first.is_ascii_alphabetic() || first == '_' {
            let end = rest.find(|char: char| !is_of_name(char)).unwrap_or(rest.len());
            tokens.push(Token::Name(rest.get(..end).unwrap_or_default().to_owned()));
            end
        } else if first.is_ascii_digit()
            || (first == '.' && rest.chars().nth(1).is_some_and(|next| next.is_ascii_digit()))
        {
            let end = number_end(rest);
            tokens.push(Token::Number(rest.get(..end).unwrap_or_default().to_owned()));
            end
        } else if let Some(sign) = SIGNS.into_iter().find(|sign| rest.starts_with(sign)) {
            tokens.push(Token::Sign(sign));
            sign.len()
        } else {
            tokens.push(Token::Other(first));
            first.len_utf8()
        };
        rest = rest.get(length..).unwrap_or_default().trim_start();
    }
    tokens
}

/// Returns true if a name may contain this character.
pub(crate) fn is_of_name(char: char) -> bool {
    char.is_ascii_alphanumeric() || char == '_'
}

/// Returns the end of the number that a text begins with, including the sign of an exponent.
fn number_end(text: &str) -> usize {
    let mut before = ' ';
    let is_hex = text.starts_with("0x") || text.starts_with("0X");
    for (at, char) in text.char_indices() {
        let is_exponent = ['+', '-'].contains(&char) && ['e', 'E'].contains(&before) && !is_hex;
        if !(is_of_name(char) || char == '.' || is_exponent) {
            return at;
        }
        before = char;
    }
    text.len()
}

//! Values of Marlin's definitions, as C works them out: integers as integers, all operators,
//! lists in braces.

use crate::c_macros::expanded;
use crate::c_tokens::Token;
use crate::definitions::Definitions;

/// Deepest brackets, signs and choices.
const MAX_DEPTH: usize = 60;

/// Types that a value may be made of: `double(20)`, `(float)20`; those of whole numbers last.
const FLOATS: [&str; 2] = ["double", "float"];
const INTEGERS: [&str; 12] = [
    "int", "long", "short", "char", "bool", "uint8_t", "uint16_t", "uint32_t", "int8_t", "int16_t", "int32_t",
    "unsigned",
];

/// Operators of two values, each with its precedence: the higher, the tighter it binds.
const OPERATORS: [(&str, u8); 17] = [
    ("||", 1),
    ("&&", 2),
    ("|", 3),
    ("&", 5),
    ("==", 6),
    ("!=", 6),
    ("<", 7),
    (">", 7),
    ("<=", 7),
    (">=", 7),
    ("<<", 8),
    (">>", 8),
    ("+", 9),
    ("-", 9),
    ("*", 10),
    ("/", 10),
    ("%", 10),
];

/// Evaluates a number.
pub fn number(text: &str, definitions: &Definitions) -> Option<f64> {
    evaluated(&expanded(text, definitions)?)
}

/// Evaluates a list in braces; each part that is not a number is `None`.
pub fn list(text: &str, definitions: &Definitions) -> Option<Vec<Option<f64>>> {
    let tokens = expanded(text, definitions).or_else(|| Some(crate::c_tokens::tokens(text)))?;
    let [Token::Sign("{"), inner @ .., Token::Sign("}")] = tokens.as_slice() else { return None };
    let (mut parts, mut depth) = (vec![Vec::new()], 0_usize);
    for token in inner {
        match token {
            Token::Sign("(" | "{") => depth += 1,
            Token::Sign(")" | "}") => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth == 0 && *token == Token::Sign(",") {
            parts.push(Vec::new());
        } else if let Some(last) = parts.last_mut() {
            last.push(token.clone());
        }
    }
    // A comma may follow the last one.
    if parts.len() > 1 && parts.last().is_some_and(Vec::is_empty) {
        parts.pop();
    }
    Some(parts.iter().map(|part| evaluated(part)).collect())
}

fn evaluated(tokens: &[Token]) -> Option<f64> {
    let mut reader = Reader { rest: tokens, depth: 0 };
    let value = reader.choice()?.float();
    (reader.rest.is_empty() && value.is_finite()).then_some(value)
}

#[derive(Clone, Copy, Debug)]
enum Value {
    Integer(i64),
    Float(f64),
}

impl Value {
    fn float(self) -> f64 {
        match self {
            Self::Integer(value) => value as f64,
            Self::Float(value) => value,
        }
    }

    fn is_true(self) -> bool {
        self.float() != 0.0
    }
}

impl From<bool> for Value {
    fn from(value: bool) -> Self {
        Self::Integer(value.into())
    }
}

struct Reader<'a> {
    rest: &'a [Token],
    depth: usize,
}

impl Reader<'_> {
    /// Takes a sign if it is next.
    fn take(&mut self, sign: &str) -> bool {
        match self.rest {
            [Token::Sign(next), rest @ ..] if *next == sign => {
                self.rest = rest;
                true
            }
            _ => false,
        }
    }

    fn choice(&mut self) -> Option<Value> {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return None;
        }
        let condition = self.binary(1)?;
        let value = if self.take("?") {
            let yes = self.choice()?;
            if !self.take(":") {
                return None;
            }
            let no = self.choice()?;
            if condition.is_true() { yes } else { no }
        } else {
            condition
        };
        self.depth -= 1;
        Some(value)
    }

    fn binary(&mut self, least: u8) -> Option<Value> {
        let mut left = self.unary()?;
        loop {
            let next = match self.rest.first() {
                Some(Token::Sign(sign)) => OPERATORS.into_iter().find(|(operator, _)| operator == sign),
                _ => None,
            };
            let Some((operator, rank)) = next.filter(|(_, rank)| *rank >= least) else { return Some(left) };
            self.rest = self.rest.get(1..).unwrap_or_default();
            let right = self.binary(rank + 1)?;
            left = applied(operator, left, right)?;
        }
    }

    fn unary(&mut self) -> Option<Value> {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return None;
        }
        let value = if self.take("-") {
            match self.unary()? {
                Value::Integer(value) => Value::Integer(value.checked_neg()?),
                Value::Float(value) => Value::Float(-value),
            }
        } else if self.take("+") {
            self.unary()?
        } else if self.take("!") {
            (!self.unary()?.is_true()).into()
        } else if self.take("~") {
            let Value::Integer(value) = self.unary()? else { return None };
            Value::Integer(!value)
        } else {
            self.primary()?
        };
        self.depth -= 1;
        Some(value)
    }

    fn primary(&mut self) -> Option<Value> {
        if let [Token::Sign("("), Token::Name(kind), Token::Sign(")"), rest @ ..] = self.rest
            && is_type(kind)
        {
            self.rest = rest;
            let value = self.unary()?;
            return cast(kind, value);
        }
        if self.take("(") {
            let value = self.choice()?;
            return self.take(")").then_some(value);
        }
        match self.rest {
            [Token::Number(text), rest @ ..] => {
                self.rest = rest;
                literal(text)
            }
            [Token::Name(name), rest @ ..] => {
                self.rest = rest;
                if self.rest.first() == Some(&Token::Sign("(")) {
                    return self.call(name);
                }
                match name.as_str() {
                    "true" | "HIGH" => Some(Value::Integer(1)),
                    "false" | "LOW" => Some(Value::Integer(0)),
                    "M_PI" | "PI" => Some(Value::Float(std::f64::consts::PI)),
                    _ => None,
                }
            }
            _ => None,
        }
    }

    /// A type's or a function's value.
    fn call(&mut self, name: &str) -> Option<Value> {
        self.take("(");
        let mut values = vec![self.choice()?];
        while self.take(",") {
            values.push(self.choice()?);
        }
        if !self.take(")") {
            return None;
        }
        let first = *values.first()?;
        let nearer = |is: fn(f64, f64) -> bool| {
            values.iter().copied().reduce(|best, value| if is(value.float(), best.float()) { value } else { best })
        };
        match name {
            "_MAX" | "MAX" | "max" => nearer(|value, best| value > best),
            "_MIN" | "MIN" | "min" => nearer(|value, best| value < best),
            "ABS" | "abs" | "fabs" if first.float() < 0.0 => applied("-", Value::Integer(0), first),
            "ABS" | "abs" | "fabs" | "NOT_UNUSED" => Some(first),
            "sq" => applied("*", first, first),
            "SQRT" | "sqrt" | "sqrtf" => Some(Value::Float(first.float().sqrt())),
            "RADIANS" => Some(Value::Float(first.float().to_radians())),
            "FLOOR" | "floor" => Some(Value::Float(first.float().floor())),
            "CEIL" | "ceil" => Some(Value::Float(first.float().ceil())),
            "ROUND" | "round" | "LROUND" => Some(Value::Float(first.float().round())),
            _ if is_type(name) && values.len() == 1 => cast(name, first),
            _ => None,
        }
    }
}

fn is_type(name: &str) -> bool {
    FLOATS.contains(&name) || INTEGERS.contains(&name)
}

fn cast(kind: &str, value: Value) -> Option<Value> {
    if FLOATS.contains(&kind) {
        return Some(Value::Float(value.float()));
    }
    if kind == "bool" {
        return Some(value.is_true().into());
    }
    value.float().is_finite().then(|| Value::Integer(value.float() as i64))
}

fn literal(text: &str) -> Option<Value> {
    let lower = text.to_ascii_lowercase();
    for (start, base) in [("0x", 16), ("0b", 2)] {
        if let Some(digits) = lower.strip_prefix(start) {
            return Some(Value::Integer(i64::from_str_radix(digits.trim_end_matches(['u', 'l']), base).ok()?));
        }
    }
    if lower.contains(['.', 'e', 'f']) {
        return Some(Value::Float(lower.trim_end_matches(['f', 'l']).parse().ok()?));
    }
    let digits = lower.trim_end_matches(['u', 'l']);
    let base = if digits.len() > 1 && digits.starts_with('0') { 8 } else { 10 };
    Some(Value::Integer(i64::from_str_radix(digits, base).ok()?))
}

fn applied(operator: &str, left: Value, right: Value) -> Option<Value> {
    let (a, b) = (left.float(), right.float());
    let compared = match operator {
        "||" => Some(left.is_true() || right.is_true()),
        "&&" => Some(left.is_true() && right.is_true()),
        "==" => Some(a == b),
        "!=" => Some(a != b),
        "<" => Some(a < b),
        ">" => Some(a > b),
        "<=" => Some(a <= b),
        ">=" => Some(a >= b),
        _ => None,
    };
    if let Some(is_true) = compared {
        return Some(is_true.into());
    }
    if let (Value::Integer(a), Value::Integer(b)) = (left, right) {
        let shift = u32::try_from(b).ok().filter(|by| *by < 63);
        return Some(Value::Integer(match operator {
            "+" => a.checked_add(b)?,
            "-" => a.checked_sub(b)?,
            "*" => a.checked_mul(b)?,
            "/" => a.checked_div(b)?,
            "%" => a.checked_rem(b)?,
            "<<" => a.checked_mul(1_i64 << shift?)?,
            ">>" => a >> shift?,
            "&" => a & b,
            _ => a | b,
        }));
    }
    Some(Value::Float(match operator {
        "+" => a + b,
        "-" => a - b,
        "*" => a * b,
        "/" => a / b,
        _ => return None,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn definitions(text: &str) -> Definitions {
        crate::marlin::parse("Configuration.h", text, &mut |_| Err("none".to_owned())).unwrap_or_default()
    }

    #[test]
    fn values_are_worked_out() {
        let names = definitions("#define TEETH 20\n#define STEPS ((200) * (16) / double(2) / double(TEETH))\n");
        assert_eq!(number("STEPS", &names), Some(80.0));
        assert_eq!(list("{ 5.6e-3f, 2E+1-3, 1e, 5e-TEETH }", &names), Some(vec![Some(0.0056), Some(17.0), None, None]));
        assert_eq!(
            list("{ STEPS, 760*1.5, unknown(3), double(1 }", &names),
            Some(vec![Some(80.0), Some(1140.0), None, None])
        );
    }

    #[test]
    fn values_are_cs() {
        let names = definitions(
            "#define US 32\n#define SW LOW\n#define ON\n#define ONE 1\n#define OFF false\n#define TWICE(x) ((x) * 2)\n\
             #define STEPS_OF(full, us) (full*us)\n#define CAT(a, b) a##b\n#define LOOP LOOP\n",
        );
        for (text, expected) in [
            ("3200/33", Some(96.0)),
            ("3200/33.0", Some(3200.0 / 33.0)),
            ("US==32 ? 160 : 80", Some(160.0)),
            ("US<16 ? 1 : US<40 ? 2 : 3", Some(2.0)),
            ("10<<4", Some(160.0)),
            ("+0.5", Some(0.5)),
            ("-(+4)", Some(-4.0)),
            ("!false", Some(1.0)),
            ("SW", Some(0.0)),
            ("(HIGH)", Some(1.0)),
            ("TERN(NOT_THERE, 335, 340)", Some(340.0)),
            ("TERN(ON, 335, 340)", Some(335.0)),
            ("TERN(ONE, TWICE(5), 340)", Some(10.0)),
            ("TERN0(OFF, 5)", Some(0.0)),
            ("TERN1(OFF, 5)", Some(1.0)),
            ("10 + TERN_(ON, 5)", Some(15.0)),
            ("TERN(HAS_BED_PROBE, 1, 2)", None),
            ("ENABLED(ON)", Some(1.0)),
            ("DISABLED(ON)", Some(0.0)),
            ("_MAX(3, 7.5, 2)", Some(7.5)),
            ("_MIN(3, 7)", Some(3.0)),
            ("STEPS_OF(200, US)", Some(6400.0)),
            ("CAT(U, S)", Some(32.0)),
            ("(float)3/2", Some(1.5)),
            ("int(7.9)", Some(7.0)),
            ("0x10 + 010 + 0b11", Some(27.0)),
            ("7 % 4", Some(3.0)),
            ("2 + 3 * 4 - 1", Some(13.0)),
            ("10 - 2 - 3", Some(5.0)),
            ("1 / 0", None),
            ("1.0 / 0", None),
            ("LOOP", None),
            ("9223372036854775807 + 1", None),
            ("", None),
        ] {
            assert_eq!(number(text, &names), expected, "{text}");
        }
        for text in ["(".repeat(5000), "-".repeat(5000), "1?".repeat(5000), "TERN(ON,".repeat(3000)] {
            assert_eq!(number(&text, &names), None);
        }
    }
}

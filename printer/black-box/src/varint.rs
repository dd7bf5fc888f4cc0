//! Integers in as few bytes as they need: seven bits a byte, the lowest first (LEB128).

/// Passes the bytes of a number to `byte`, at most five.
pub fn put(mut value: u32, mut byte: impl FnMut(u8)) {
    while value >= 0x80 {
        byte(value as u8 | 0x80);
        value >>= 7;
    }
    byte(value as u8);
}

/// Takes a number off the front; `None` if the bytes end within it or it has more than 32 bits.
pub fn take(bytes: &mut &[u8]) -> Option<u32> {
    let mut value = 0_u32;
    for shift in (0..35).step_by(7) {
        let (&byte, rest) = bytes.split_first()?;
        *bytes = rest;
        let bits = u32::from(byte & 0x7f);
        if shift == 28 && bits > 0xf {
            return None;
        }
        value |= bits << shift;
        if byte < 0x80 {
            return Some(value);
        }
    }
    None
}

/// Encodes a difference that is small in either direction as a small number (zigzag).
pub fn difference(from: u32, to: u32) -> u32 {
    let difference = to.wrapping_sub(from) as i32;
    (difference << 1 ^ difference >> 31) as u32
}

/// Number at that encoded difference from another.
pub fn moved(from: u32, difference: u32) -> u32 {
    from.wrapping_add(difference >> 1 ^ (difference & 1).wrapping_neg())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn numbers_and_differences_come_back(from: u32, to: u32) {
            let mut bytes = Vec::new();
            put(difference(from, to), |byte| bytes.push(byte));
            prop_assert!(bytes.len() <= 5);
            let mut left = &bytes[..];
            let taken = take(&mut left).map(|difference| moved(from, difference));
            prop_assert_eq!((taken, left), (Some(to), &[][..]));
            bytes.pop();
            prop_assert_eq!(take(&mut &bytes[..]), None);
        }
    }
}

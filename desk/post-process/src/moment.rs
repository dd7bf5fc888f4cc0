//! A moment of a print, as M73 reports it.

/// A moment of a print.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Time since the beginning, s.
    pub elapsed_s: f64,
    /// Time of the whole print, s.
    pub total_s: f64,
    /// Time until the next pause or colour change, s, if one comes.
    pub to_pause_s: Option<f64>,
}

impl Moment {
    /// Time until the end, s.
    pub fn left_s(&self) -> f64 {
        (self.total_s - self.elapsed_s).max(0.0)
    }

    /// The value of a word of M73 with this number of decimals; `None` for a letter that means
    /// no time, and without a pause that comes.
    ///
    /// P and Q are percent and reach 100 at the end only; R and S are minutes to the end, C and D
    /// to the next pause.
    pub fn word(&self, letter: u8, decimals: usize) -> Option<String> {
        match letter.to_ascii_uppercase() {
            b'P' | b'Q' => Some(self.percent(decimals)),
            b'R' | b'S' => Some(minutes(self.left_s(), decimals)),
            b'C' | b'D' => self.to_pause_s.map(|time_s| minutes(time_s, decimals)),
            _ => None,
        }
    }

    fn percent(&self, decimals: usize) -> String {
        let share = if self.total_s > 0.0 { (self.elapsed_s / self.total_s).clamp(0.0, 1.0) } else { 1.0 };
        let scale = 10_f64.powi(decimals as i32);
        format!("{:.decimals$}", (share * 100.0 * scale).floor() / scale)
    }
}

fn minutes(seconds: f64, decimals: usize) -> String {
    let scale = 10_f64.powi(decimals as i32);
    format!("{:.decimals$}", (seconds / 60.0 * scale).round() / scale)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words() {
        let moment = Moment { elapsed_s: 1199.0, total_s: 1200.0, to_pause_s: None };
        let words = |moment: &Moment, decimals| (*b"PqRsCDX").map(|letter| moment.word(letter, decimals));
        let text = |words: [&str; 4]| words.map(|word| Some(word.to_owned()));
        assert_eq!(words(&moment, 0)[..4], text(["99", "99", "0", "0"]), "100 at the end only");
        assert_eq!(words(&moment, 2)[..4], text(["99.91", "99.91", "0.02", "0.02"]));
        assert_eq!(words(&moment, 0)[4..], [None, None, None]);
        let moment = Moment { elapsed_s: 1200.0, total_s: 1200.0, to_pause_s: Some(90.0) };
        assert_eq!(words(&moment, 0)[..4], text(["100", "100", "0", "0"]));
        assert_eq!(words(&moment, 1)[4..6], [Some("1.5".to_owned()), Some("1.5".to_owned())]);
    }
}

//! Reads and writes the names of shapers, as in printers' settings.

use crate::shapers::even_spacing::EvenSpacing;
use crate::shapers::kind::ShaperKind;
use std::fmt;
use std::str::FromStr;

/// Error for a name that no shaper has, with the reason if the name was nearly right.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownShaper(String);

impl fmt::Display for UnknownShaper {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{}: expected ", self.0)?;
        for kind in ShaperKind::ALL {
            write!(out, "{kind}, ")?;
        }
        write!(out, "or mzv(IMPULSES,PERIODS)")
    }
}

impl std::error::Error for UnknownShaper {}

impl fmt::Display for ShaperKind {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = match self {
            Self::None => "none",
            Self::Zv => "zv",
            Self::Mzv => "mzv",
            Self::EvenMzv(spacing) => {
                let (count, periods) = spacing.shape();
                return write!(out, "mzv({count},{periods})");
            }
            Self::Zvd => "zvd",
            Self::Zvdd => "zvdd",
            Self::EiOld => "ei_old",
            Self::Ei => "ei",
            Self::TwoHumpEiOld => "2hump_ei_old",
            Self::TwoHumpEi => "2hump_ei",
            Self::ThreeHumpEiOld => "3hump_ei_old",
            Self::ThreeHumpEi => "3hump_ei",
        };
        out.pad(name)
    }
}

impl FromStr for ShaperKind {
    type Err = UnknownShaper;

    fn from_str(text: &str) -> Result<Self, UnknownShaper> {
        let lower = text.trim().to_ascii_lowercase();
        if let Some(kind) = Self::ALL.into_iter().find(|kind| kind.to_string() == lower) {
            return Ok(kind);
        }
        let Some(numbers) = lower.strip_prefix("mzv(").and_then(|rest| rest.strip_suffix(')')) else {
            return Err(UnknownShaper(format!("{text:?} is not an input shaper")));
        };
        let parsed = numbers.split_once(',').and_then(|(count, periods)| {
            Some((count.trim().parse::<usize>().ok()?, periods.trim().parse::<f64>().ok()?))
        });
        let (count, periods) = parsed.ok_or_else(|| UnknownShaper(format!("{text:?} needs two numbers")))?;
        let spacing = EvenSpacing::new(count, periods).map_err(|error| UnknownShaper(format!("{text:?}: {error}")))?;
        Ok(Self::EvenMzv(spacing))
    }
}

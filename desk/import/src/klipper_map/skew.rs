//! Klipper's skew of the axes, as SKEW_PROFILE has saved it.

use super::Reading;

const SECTION: &str = "skew_correction ";

impl Reading<'_> {
    /// The skew of the one profile that the file has. Of several a command chooses.
    pub(super) fn skew(&mut self) {
        let mut profiles = self.config.sections.iter().filter(|section| section.name.starts_with(SECTION));
        let (Some(profile), None) = (profiles.next(), profiles.next()) else { return };
        for plane in ["xy", "xz", "yz"] {
            self.keep_number(&profile.name, &format!("{plane}_skew"), &[&format!("skew.{plane}.factor")], |factor| {
                factor
            });
        }
    }
}

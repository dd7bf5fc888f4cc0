//! The motors' letters in a record.

use ferrostep_printer::Profile;

/// Letters of a machine's motors, as traces and waveforms have them.
pub(super) fn motor_names(profile: &Profile) -> [char; 4] {
    let [first, second, third] = profile.kinematics.motor_names().map(|name| name.to_ascii_lowercase());
    [first, second, third, 'e']
}

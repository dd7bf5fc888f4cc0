//! The machine this firmware is for.

use ferrostep_printer::Profile;
pub use ferrostep_profile_constant::StepSignals;

/// The profile.
pub static PROFILE: Profile = ferrostep_profile_constant::PROFILE;

const _: () = assert!(
    cfg!(feature = "papers") || PROFILE.motion.is_standard(),
    "the profile asks for a method of motion that only the desk and the bench contain: a printer's image has \
     interpolation = \"step-bresenham\" with acceleration = \"trapezoid\" or \"s-curve\""
);

//! Profile of the machine that this firmware is built for.

use ferrostep_printer::Profile;
pub use ferrostep_profile_constant::StepSignals;

/// Static profile of the machine.
pub static PROFILE: Profile = ferrostep_profile_constant::PROFILE;

const _: () = assert!(
    cfg!(feature = "papers") || PROFILE.motion.is_standard(),
    "the profile asks for a method of motion that only the desk and the bench contain: a printer's image has \
     interpolation = \"step-bresenham\" with acceleration = \"trapezoid\" or \"s-curve\""
);

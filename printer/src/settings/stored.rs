//! Settings that survive the power: their values, and their groups by the commands that show them.

pub(crate) mod groups;
pub(crate) mod values;

use groups::Group;

use crate::part::Present;

/// The keys of a profile that M500 stores, with `*` for the axis, and the command of each.
pub fn stored_keys() -> impl Iterator<Item = (&'static str, &'static str)> {
    Group::<(Present, Present, Present)>::all()
        .flat_map(|group| group.settings.iter().map(|setting| (setting.name, group.code)))
}

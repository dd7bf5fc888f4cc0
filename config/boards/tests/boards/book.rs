//! The table of keys.

use std::path::Path;

use ferrostep_boards::schema;
use ferrostep_checked_toml::book;

#[test]
fn the_table_of_keys_is_current() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("keys.md");
    // A board's keys bind no other file to it.
    book::keep(&page, "keys", &schema().markdown(&[]).replace(" ●", "").replace("](", "](../../docs/src/")).unwrap();
}

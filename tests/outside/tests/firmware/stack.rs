//! Each image's stack is large enough for its tasks, however they interrupt each other.

use ferrostep_image_code::code::Code;
use ferrostep_image_code::stack_need::StackNeed;
use ferrostep_testkit::boards::BOARDS;

use crate::firmware::image::image_of;

#[test]
fn the_stack_holds_all_tasks_nested() {
    for board in &BOARDS {
        let need = StackNeed::of(&Code::of(&image_of(board.name)).unwrap()).unwrap();
        eprintln!("{}: {need}\n{}", board.name, need.ways);
        assert!(need.priorities.len() >= 8, "{}: only {} priorities", board.name, need.priorities.len());
        need.check().unwrap_or_else(|reason| panic!("{}: {reason}", board.name));
    }
}

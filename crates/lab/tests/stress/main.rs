//! The cases of `gs2e stress` as a library: naive forms miss them, and the renderer meets them with little
//! room.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on panics")]
#![expect(clippy::print_stdout, reason = "the figures")]

mod laws;
mod naive;
mod small_lists;

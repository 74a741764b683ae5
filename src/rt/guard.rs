//! The proof that a tick allocates nothing.

/// Runs `turn` and, in builds with debug assertions whose global allocator is
/// `assert_no_alloc::AllocDisabler`, aborts when it allocates or frees.
pub fn no_alloc<T>(turn: impl FnOnce() -> T) -> T {
    if cfg!(debug_assertions) { assert_no_alloc::assert_no_alloc(turn) } else { turn() }
}

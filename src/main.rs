//! The `hapticd` command.

/// Debug builds prove on every tick that nothing allocates.
#[cfg(debug_assertions)]
#[global_allocator]
static ALLOCATOR: assert_no_alloc::AllocDisabler = assert_no_alloc::AllocDisabler;

fn main() -> std::process::ExitCode {
    hapticd::cli::run()
}

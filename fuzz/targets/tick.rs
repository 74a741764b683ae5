//! Inputs for `hapticd_fuzz::ticks`; a tick that allocates aborts.
#![no_main]

#[global_allocator]
static ALLOCATOR: assert_no_alloc::AllocDisabler = assert_no_alloc::AllocDisabler;

libfuzzer_sys::fuzz_target!(|data: &[u8]| hapticd_fuzz::ticks::check(data));

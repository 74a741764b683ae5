//! Inputs for `hapticd_fuzz::accesses`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| hapticd_fuzz::accesses::check(data));

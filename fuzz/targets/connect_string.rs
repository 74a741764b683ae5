//! Inputs for `hapticd_fuzz::connect_strings`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| hapticd_fuzz::connect_strings::check(data));

//! Inputs for `hapticd_fuzz::settings`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| hapticd_fuzz::settings::check(data));

//! Inputs for `hapticd_fuzz::recordings`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| hapticd_fuzz::recordings::check(data));

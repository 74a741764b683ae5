//! Inputs for `hapticd_fuzz::packets`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| hapticd_fuzz::packets::check(data));

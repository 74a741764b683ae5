//! Inputs for `hapticd_fuzz::states`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| hapticd_fuzz::states::check(data));

//! Inputs for `hapticd_fuzz::texts`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| hapticd_fuzz::texts::check_server_file(data));

//! Inputs for `hapticd_fuzz::datagrams`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| hapticd_fuzz::datagrams::check(data));

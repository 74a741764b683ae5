//! Generated from `proto/hapticd/v1`: the public contract as Rust types, nothing else.
#![allow(missing_docs, clippy::all, rustdoc::all)]

include!(concat!(env!("OUT_DIR"), "/hapticd.v1.rs"));

/// The contract as an encoded `FileDescriptorSet`, for gRPC reflection.
pub const DESCRIPTOR_SET: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/hapticd.bin"));

//! Compiles `proto/` with protox, so that no system `protoc` is needed.
//!
//! Messages always; service traits and clients with feature `net` or `client`.
//! The descriptor set is written beside them for gRPC reflection.

use std::{env, error::Error, fs, path::PathBuf};

use prost::Message;

const PROTOS: [&str; 10] = [
    "proto/hapticd/v1/common.proto",
    "proto/hapticd/v1/stream.proto",
    "proto/hapticd/v1/settings.proto",
    "proto/hapticd/v1/explain.proto",
    "proto/hapticd/v1/watch.proto",
    "proto/hapticd/v1/manipulability.proto",
    "proto/hapticd/v1/device.proto",
    "proto/hapticd/v1/scene.proto",
    "proto/hapticd/v1/session.proto",
    "proto/hapticd/v1/record.proto",
];

/// Rare and large beside the others of its message.
const BOXED: &str = ".hapticd.v1.Welcome.example_wall";

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed=proto");
    println!("cargo:rerun-if-changed=build.rs");
    let descriptors = protox::compile(PROTOS, ["proto"])?;
    let out_dir = PathBuf::from(env::var("OUT_DIR")?);
    fs::write(out_dir.join("hapticd.bin"), descriptors.encode_to_vec())?;
    generate(descriptors)
}

#[cfg(feature = "client")]
fn generate(descriptors: prost_types::FileDescriptorSet) -> Result<(), Box<dyn Error>> {
    tonic_prost_build::configure()
        .build_server(env::var_os("CARGO_FEATURE_NET").is_some())
        .boxed(BOXED)
        .compile_fds(descriptors)?;
    Ok(())
}

#[cfg(not(feature = "client"))]
fn generate(descriptors: prost_types::FileDescriptorSet) -> Result<(), Box<dyn Error>> {
    prost_build::Config::new().boxed(BOXED).compile_fds(descriptors)?;
    Ok(())
}

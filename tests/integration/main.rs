//! All integration tests, in one binary.
#![allow(non_snake_case)] // names carry frames: `p_BH`, `F_BH_N`

mod vectors;

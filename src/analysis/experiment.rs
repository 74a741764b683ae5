//! Whole studies, in virtual time and on all processors, each a report with tables and pictures.
//!
//! A study is a grid of experiments; its result does not depend on the number of threads. It
//! knows no clock and writes no file: whoever runs it says how far it has come and when to stop.

pub mod force_distribution;
pub mod wall_following;

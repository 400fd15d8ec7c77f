//! The program as its users run it, and what measures by it.

#[path = "../../../../tests/common/mod.rs"]
mod common;
#[path = "../../../../tests/fake_renderer/mod.rs"]
mod fake_renderer;

mod bench_programs;
mod command_line;
mod compare_study;
mod devices_why;
mod diff;
mod facts;
mod farm;
mod films;
mod labels;
mod outputs;
mod progress;
mod selftest;
mod trace;
mod tradeoff_study;
mod tune;

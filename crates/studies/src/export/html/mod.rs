//! One self-contained page: no network, no fonts or scripts but its own.
//!
//! The page forbids itself the network by a content security policy. Its plots are drawn here, so
//! that it can be read without JavaScript; sorting, tabs and the image slider need it.

pub mod compare;
pub mod envelope;
mod images;
mod page;
mod plots;
mod svg;
mod table;
pub mod tradeoff;

pub use page::Page;

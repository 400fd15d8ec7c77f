//! Measuring on a device: the renderer of studies, start-up, tuning, and what belongs to an image.
//!
//! A library: it prints nothing. What is worth a word and keeps nothing from going on goes to a `warn` of whoever asks.

mod film;
mod host;
mod kernels;
mod record;
mod references;
mod renderer;
mod start_up;
mod tune;
pub mod tuning;

pub use film::{AboutFilm, Counters, OtherRender, is_portable};
pub use host::{available_memory, cache_folder, sign};
pub use kernels::compiled_kernels;
pub use record::{record, samples_by_rows, settings_record};
pub use references::References;
pub use renderer::{Asked, DeviceRenderer, SettingsOf};
pub use start_up::{ChildFailed, Contrast, FirstSample, StartUp, StartUps, first_sample_of};
pub use tune::{Frozen, Measured, Plan, TuningStudy, tune};
pub use tuning::{Key as TuningKey, Tuning, describe};

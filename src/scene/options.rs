//! What a user may say of how a scene is loaded.

use serde::{Deserialize, Serialize};

/// How a scene is loaded. Defaults suit a scene that is whole and says everything.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct LoadOptions {
    /// The name of the camera through which the scene is seen, of several in a file. Without, its first.
    pub camera: Option<String>,
    /// Which way is up where the file has no camera and the scene is seen whole; of any length but 0. Without, +y.
    pub up: Option<[f64; 3]>,
    /// Whether files outside of the scene's folder are read if the scene names them.
    pub allow_outside: bool,
    /// Whether what a file requires and raywave lacks is left out with a warning, not refused.
    pub lenient: bool,
}

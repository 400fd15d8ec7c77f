//! What a user may say of how a scene is loaded.

/// How a scene is loaded. Defaults suit a scene that is whole and says everything.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LoadOptions {
    /// Whether what a file requires and raywave lacks is left out with a warning, not refused.
    pub lenient: bool,
}

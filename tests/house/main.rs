//! What the sources are: the map that they keep to, and the scripts that they come with. It stays where they are.

#[path = "../common/install.rs"]
mod install;
#[path = "../common/project.rs"]
mod project;

mod bundle;
mod rooms;

//! Renders against closed forms: scenes so simple that their radiance can be written down, with
//! all integrators wherever both can find the light.
//!
//! Where every sample must have one value, each is compared alone. Elsewhere the closed form is
//! averaged over each pixel and compared by z-tests of block means. Seeds are fixed, so a test
//! that passes keeps passing until the renderer changes.

mod camera;
mod check;
mod energy;
mod glass;
mod light;
mod reflection;
mod robustness;
mod stage;
mod turned;

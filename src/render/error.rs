//! Why a render fails.

use thiserror::Error;

use super::prepare::PrepareError;
use crate::gpu::GpuError;
use crate::settings::SettingsError;

/// A render that failed.
#[derive(Debug, Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum RenderError {
    #[error(transparent)]
    Settings(#[from] SettingsError),
    #[error(transparent)]
    Prepare(#[from] PrepareError),
    #[error(transparent)]
    Gpu(#[from] GpuError),
    #[error(
        "the driver leaves a kernel's loops before their end, so the image would be wrong; use another --scheduler than megakernel, or a smaller --shading-cost"
    )]
    CutLoops,
    #[error(
        "the driver does not promise that lanes which part in a loop meet again, as the rays of a packet must; leave out --packets"
    )]
    NoPackets,
    #[error("the megakernel keeps no queues, so there are no rays to dump; use --scheduler wavefront")]
    NoQueues,
    #[error(
        "shadow rays that are traced at once are in no queue, so there are none to dump; use --shadow-rays deferred"
    )]
    NoShadowQueue,
    #[error("there are no {rays} rays at bounce {bounce}{}", of_last(*last))]
    NoRays { rays: &'static str, bounce: u32, last: Option<u32> },
    #[error(
        "ray {ray} of the dump: {kernel} finds {found} where the CPU finds {expected}, so its speed means nothing; report this with device and driver"
    )]
    WrongAnswer { ray: u64, kernel: &'static str, found: String, expected: String },
    #[error("ray {ray} of the dump: {kernel} finds {first} and, when run again, {again}; the device cannot be trusted")]
    Unstable { ray: u64, kernel: &'static str, first: String, again: String },
}

/// Where there are rays, for a message. The camera's are always there.
fn of_last(last: Option<u32>) -> String {
    match last {
        Some(0) => "; there are some at bounce 0".to_owned(),
        Some(last) => format!("; there are some up to bounce {last}"),
        None => ", nor before it; they need --integrator explicit or mis, and a light".to_owned(),
    }
}

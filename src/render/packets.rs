//! Which kernel traces a class of rays.

use crate::rays::RayClass;
use crate::settings::Packets;

impl Packets {
    /// The kernel that takes rays after so many bounces to their next surface.
    pub(super) fn kernel_at(self, bounce: u32, single: &'static str, packets: &'static str) -> &'static str {
        let class = if bounce == 0 { RayClass::Camera } else { RayClass::Bounce };
        if self.has(class) { packets } else { single }
    }

    /// Those kernels.
    pub(super) fn kernels(self, single: &'static str, packets: &'static str) -> Vec<&'static str> {
        let mut kernels = vec![self.kernel_at(0, single, packets), self.kernel_at(1, single, packets)];
        kernels.dedup();
        kernels
    }

    /// The kernel that traces the rays to lights.
    pub(super) fn connect(self) -> &'static str {
        if self.shadow { "connect_packets" } else { "connect" }
    }
}

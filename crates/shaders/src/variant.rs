//! What a kernel is built for beside what its scene needs: specialization constants of this crate, which stand for code
//! that a device may be unable to run or that a render has no use for. Drivers never see that code.

/// What a build of a kernel is for.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Edition {
    /// To render.
    #[default]
    Plain,
    /// Counts what traversal and shading do, and computes the same. Slower.
    Counting,
}

/// How kernels reach memory. Whatever it is, they compute the same bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Access {
    /// Scene buffers are read by texels, not as storage buffers.
    pub texel_fetch: bool,
    /// Queues are appended to once a subgroup, not once an invocation, and packets are subgroups.
    pub subgroup_ballot: bool,
}

/// A specialization constant of this crate: a truth, false in a module that nobody specialized.
#[derive(Debug, Clone, Copy)]
pub struct Switch {
    /// Its name in GLSL.
    pub name: &'static str,
    /// Its id, above those of the host and at most 2047, where the GLSL compiler ends.
    pub id: u32,
    /// What it means.
    pub meaning: &'static str,
}

/// Whether lanes of a subgroup append to queues together.
pub const HAS_BALLOTS: Switch =
    Switch { name: "HAS_BALLOTS", id: 2000, meaning: "Whether lanes of a subgroup may act together." };
/// Whether the rays of a subgroup traverse a tree together.
pub const IN_PACKETS: Switch =
    Switch { name: "IN_PACKETS", id: 2001, meaning: "Whether the rays of a subgroup traverse a tree together." };
/// Whether the kernel counts what it does.
pub const COUNTS_WORK: Switch =
    Switch { name: "COUNTS_WORK", id: 2002, meaning: "Whether traversal and shading count what they do." };

/// Every switch.
pub const SWITCHES: [Switch; 3] = [HAS_BALLOTS, IN_PACKETS, COUNTS_WORK];

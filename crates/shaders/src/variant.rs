//! The variants that a kernel is built in. The build compiles them in the order of this file, by which they are found.

/// What a build of a kernel is for.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Edition {
    /// To render.
    #[default]
    Plain,
    /// Counts what traversal and shading do, and computes the same. Slower.
    Counting,
}

impl Edition {
    /// Every edition.
    pub const ALL: [Self; 2] = [Self::Plain, Self::Counting];

    /// The macro that makes it of a shader.
    pub fn macro_name(self) -> Option<&'static str> {
        (self == Self::Counting).then_some("COUNTING")
    }
}

/// How kernels reach memory. Whatever it is, they compute the same bits. It cannot be a specialization constant, because
/// it changes a descriptor's type or a required capability.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Access {
    /// Scene buffers are read by texels, not as storage buffers.
    pub texel_fetch: bool,
    /// Queues are appended to once a subgroup, not once an invocation, and packets are subgroups.
    pub subgroup_ballot: bool,
}

impl Access {
    /// Every access.
    pub const ALL: [Self; 4] = [
        Self { texel_fetch: false, subgroup_ballot: false },
        Self { texel_fetch: true, subgroup_ballot: false },
        Self { texel_fetch: false, subgroup_ballot: true },
        Self { texel_fetch: true, subgroup_ballot: true },
    ];

    /// The macro that makes it of a shader. Texels are fetched by a pass over its SPIR-V.
    pub fn macro_name(self) -> Option<&'static str> {
        self.subgroup_ballot.then_some("SUBGROUP_BALLOT")
    }
}

/// The variants of some editions, in the order of a kernel's table.
pub fn variants(editions: &[Edition]) -> impl Iterator<Item = (Edition, Access)> {
    editions.iter().flat_map(|edition| Access::ALL.map(|access| (*edition, access)))
}

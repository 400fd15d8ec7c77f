//! Whether the buffers of a render fit a device, and how its kernels read them: arithmetic without a
//! device.

use super::error::GpuError;
use super::roles::{BufferRole, BufferUse};

/// What decides whether buffers fit.
#[derive(Debug, Clone, Copy)]
pub(super) struct MemoryLimits {
    /// Most bytes of a storage buffer.
    pub storage_buffer_bytes: u64,
    /// Most texels of a texel buffer.
    pub texels: u64,
    /// Bytes of the heap that buffers lie in.
    pub heap_bytes: u64,
    /// Bytes of it in use already, by any process, as far as the driver reports them.
    pub used_bytes: u64,
}

/// Where buffers go.
#[derive(Debug, PartialEq)]
pub(super) struct MemoryPlan {
    /// Whether scene buffers are read by texels.
    pub texel_fetch: bool,
    /// Bytes of all buffers.
    pub bytes: u64,
}

/// Plans memory for `roles` and `staging_bytes` more. Scene buffers are read by texels where
/// `wants_texels`, else as storage buffers; the other way where only that one is wide enough.
pub(super) fn plan_memory(
    roles: &[BufferRole<'_>],
    staging_bytes: u64,
    wants_texels: bool,
    limits: &MemoryLimits,
) -> Result<MemoryPlan, GpuError> {
    let fits_storage = |role: &BufferRole<'_>| role.size <= limits.storage_buffer_bytes;
    let most_by_texels = |texel_bytes: u64| limits.texels.saturating_mul(texel_bytes);
    let scene = || {
        roles.iter().filter_map(|role| match role.usage {
            BufferUse::Scene { texel_bytes } => Some((role, texel_bytes)),
            _ => None,
        })
    };
    let all_texels = scene().all(|(role, texel_bytes)| role.size <= most_by_texels(texel_bytes));
    let all_storage = scene().all(|(role, _)| fits_storage(role));
    let texel_fetch = all_texels && (wants_texels || !all_storage);
    if !all_texels && !all_storage {
        // One way has to serve all of them: name the buffer that is furthest over the wider one.
        let allowed = |texel_bytes| most_by_texels(texel_bytes).max(limits.storage_buffer_bytes);
        let over = |(role, texel_bytes): &(&BufferRole<'_>, u64)| role.size as f64 / allowed(*texel_bytes) as f64;
        let worst = scene().max_by(|a, b| over(a).total_cmp(&over(b)));
        let (role, texel_bytes) = worst.expect("a buffer is too large");
        let (buffer, needed, allowed) = (role.name, role.size, allowed(texel_bytes));
        return Err(GpuError::BufferTooLarge { buffer, needed, allowed, advice: "use a smaller scene" });
    }
    if let Some(role) = roles.iter().find(|role| !matches!(role.usage, BufferUse::Scene { .. }) && !fits_storage(role))
    {
        let (buffer, needed, allowed) = (role.name, role.size, limits.storage_buffer_bytes);
        return Err(GpuError::BufferTooLarge { buffer, needed, allowed, advice: "use a smaller --in-flight" });
    }

    let bytes = roles.iter().map(|role| role.size).sum::<u64>() + staging_bytes;
    let free = limits.heap_bytes.saturating_sub(limits.used_bytes);
    if bytes > free {
        return Err(GpuError::OutOfMemory {
            needed: bytes,
            roles: largest_roles(roles, bytes),
            free,
            used: limits.used_bytes,
        });
    }
    Ok(MemoryPlan { texel_fetch, bytes })
}

/// Buffers that make up nine tenths of `bytes`, the largest first, and what is left.
fn largest_roles(roles: &[BufferRole<'_>], bytes: u64) -> String {
    let mut sorted: Vec<_> = roles.iter().map(|role| (role.name, role.size)).collect();
    sorted.sort_by_key(|(_, size)| std::cmp::Reverse(*size));
    let mut rest = bytes;
    let mut parts = Vec::new();
    for (name, size) in sorted {
        if rest <= bytes / 10 {
            break;
        }
        parts.push(format!("{name} {size}"));
        rest -= size;
    }
    parts.push(format!("all else {rest}"));
    parts.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: MemoryLimits =
        MemoryLimits { storage_buffer_bytes: 1000, texels: 100, heap_bytes: 10_000, used_bytes: 0 };

    fn scene(name: &'static str, size: u64) -> BufferRole<'static> {
        BufferRole { name, usage: BufferUse::Scene { texel_bytes: 16 }, size, contents: None }
    }

    fn state(name: &'static str, size: u64) -> BufferRole<'static> {
        BufferRole { name, usage: BufferUse::State, size, contents: None }
    }

    #[test]
    fn scene_buffers_are_read_by_the_way_that_is_wide_enough() {
        let fetch = |size, wants_texels, limits: MemoryLimits| {
            plan_memory(&[scene("nodes", size)], 0, wants_texels, &limits).map(|plan| plan.texel_fetch).ok()
        };
        // 100 texels of 16 bytes are wider than a storage buffer of 1000.
        assert_eq!([true, false].map(|wants| fetch(1000, wants, LIMITS)), [Some(true), Some(false)]);
        assert_eq!([true, false].map(|wants| fetch(1600, wants, LIMITS)), [Some(true); 2]);
        assert_eq!([true, false].map(|wants| fetch(1601, wants, LIMITS)), [None; 2]);
        let few_texels = MemoryLimits { texels: 10, ..LIMITS };
        assert_eq!([true, false].map(|wants| fetch(1000, wants, few_texels)), [Some(false); 2]);
        assert_eq!(fetch(1001, true, few_texels), None);
    }

    #[test]
    fn a_buffer_that_neither_way_can_hold_is_named() {
        let roles = [scene("triangles", 1500), scene("nodes", 1700)];
        let error = plan_memory(&roles, 0, true, &LIMITS).expect_err("the nodes are too large");
        assert!(matches!(error, GpuError::BufferTooLarge { buffer: "nodes", needed: 1700, allowed: 1600, .. }));
        // State is never read by texels.
        let error = plan_memory(&[state("hits", 1001)], 0, true, &LIMITS).expect_err("the hits are too large");
        assert!(matches!(error, GpuError::BufferTooLarge { buffer: "hits", needed: 1001, allowed: 1000, .. }));
    }

    #[test]
    fn a_heap_that_is_too_small_is_reported_with_the_bytes_of_each_role() {
        let roles = [scene("nodes", 1600), scene("triangles", 900), state("hits", 200), state("bins", 100)];
        let plan =
            |heap_bytes, used_bytes| plan_memory(&roles, 50, true, &MemoryLimits { heap_bytes, used_bytes, ..LIMITS });
        assert_eq!(plan(2850, 0).ok(), Some(MemoryPlan { texel_fetch: true, bytes: 2850 }));
        assert!(plan(3000, 150).is_ok());
        assert_eq!(
            plan(2849, 0).expect_err("a byte is missing").to_string(),
            "the render needs 2850 bytes of device memory (nodes 1600, triangles 900, hits 200, all else 150) and the \
             device has 2849; use a smaller scene or --in-flight"
        );
        assert_eq!(
            plan(3000, 151).expect_err("a byte is taken").to_string(),
            "the render needs 2850 bytes of device memory (nodes 1600, triangles 900, hits 200, all else 150) and the \
             device has 2849 (151 more are in use); use a smaller scene or --in-flight"
        );
        // More in use than there is.
        assert!(matches!(plan(100, 200), Err(GpuError::OutOfMemory { free: 0, .. })));
    }
}

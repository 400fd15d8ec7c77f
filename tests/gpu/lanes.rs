//! What the lanes of a subgroup and the invocations of a launch share, and must not.

use crate::common::device;
use crate::probe::{Bench, any_scene};
use raywave::shaders::Access;
use raywave_studies::stats::SplitMix64;

#[test]
fn each_invocation_has_a_stack_of_its_own() {
    let device = device();
    let largest = device.description().max_workgroup_size.min(256);
    for workgroup_size in [1, 8, 32, 64, largest] {
        // The last workgroup is not full.
        let items = 5 * workgroup_size + workgroup_size.div_ceil(3);
        let mut bench = Bench::new(&device, &any_scene());
        bench.workgroup_size = Some(workgroup_size);
        let places: Vec<[u32; 4]> = bench.run("stack_places", &vec![[0_u32; 4]; items as usize]);
        let stacks = items.div_ceil(workgroup_size) * workgroup_size;
        let mut all = places.into_flattened();
        assert!(all.iter().all(|place| *place < 4 * stacks), "of {workgroup_size} invocations one has a place outside");
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len(), 4 * items as usize, "of {workgroup_size} invocations some share a place");
    }
}

#[test]
fn lanes_that_parted_append_each_to_a_place_of_their_own() {
    let device = device();
    let mut random = SplitMix64::new(5);
    let queries: Vec<[u32; 4]> = (0..50_000)
        .map(|_| {
            let bits = random.next_u64() as u32;
            [bits & 31, u32::from(bits >> 8 & 3 == 0), bits >> 10 & 1, bits >> 11 & 1]
        })
        .collect();
    for subgroup_ballot in [false, true] {
        let mut bench = Bench::new(&device, &any_scene());
        bench.access = Some(Access { texel_fetch: false, subgroup_ballot });
        let answers: Vec<[u32; 4]> = bench.run("append", &queries);
        for queue in 0..2 {
            let appends = |query: &[u32; 4]| query[1] == 0 && query[2 + queue] != 0;
            let mut places: Vec<u32> = Vec::new();
            for (query, answer) in queries.iter().zip(&answers) {
                assert_eq!(
                    answer[queue] != u32::MAX,
                    appends(query),
                    "{query:?} {answer:?}, ballots: {subgroup_ballot}"
                );
                places.extend(appends(query).then_some(answer[queue]));
            }
            places.sort_unstable();
            assert!(
                places.iter().copied().eq(0..places.len() as u32),
                "places are given once, ballots: {subgroup_ballot}"
            );
        }
    }
}

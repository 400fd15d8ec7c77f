//! Numbers to test arithmetic with.

use crate::stats::SplitMix64;

/// Numbers where arithmetic may differ: zeros, denormals, the ends of the range and of binades, infinities and NaN,
/// each with both signs.
const EDGES: [u32; 25] = [
    0x0000_0000, // zero
    0x0000_0001, // the smallest denormal
    0x0000_0002,
    0x0040_0000, // one with the highest bit of its significand
    0x007f_fffe,
    0x007f_ffff, // the largest denormal
    0x0080_0000, // the smallest normal number
    0x0080_0001,
    0x00ff_ffff,
    0x0100_0000,
    0x3380_0000, // half a unit of the last place of 1
    0x33ff_ffff,
    0x3eaa_aaab, // a third
    0x3f7f_ffff, // before, at and after 1
    0x3f80_0000,
    0x3f80_0001,
    0x4000_0000,
    0x4049_0fdb, // pi
    0x4b00_0000, // 2^23, where integers begin
    0x7e80_0000, // 2^126, above which reciprocals are denormals
    0x7eff_ffff,
    0x7f00_0000,
    0x7f7f_ffff, // the largest
    0x7f80_0000, // infinity
    0x7fc0_0000, // NaN
];

/// Random words that are tried in addition to the edges.
const RANDOM: usize = 1 << 18;

/// The edges with both signs.
fn edges() -> impl Iterator<Item = u32> + Clone {
    EDGES.into_iter().flat_map(|bits| [bits, bits | 0x8000_0000])
}

/// All pairs of edges.
fn edge_pairs() -> Vec<[u32; 2]> {
    edges().flat_map(|a| edges().map(move |b| [a, b])).collect()
}

/// Three numbers each: all pairs of edges with an edge, then random ones. Of the random ones a third are any bits, a
/// third have exponents near each other, so that sums round, and a third have short significands, so that products and
/// sums hit ties.
pub fn operands() -> Vec<[f32; 3]> {
    let mut random = SplitMix64::new(1);
    let edges = edge_pairs().into_iter().zip(EDGES.into_iter().cycle());
    let mut cases: Vec<[u32; 3]> = edges.map(|([a, b], c)| [a, b, c]).collect();
    cases.extend((0..RANDOM).map(|i| match i % 3 {
        0 => [(); 3].map(|()| random.next_u64() as u32),
        1 => [0x7f_ffff; 3].map(|kept| near_one(&mut random, kept)),
        _ => [0x7f_f800, 0x7f_f000, 0x7f_ffff].map(|kept| near_one(&mut random, kept)),
    }));
    cases.into_iter().map(|case| case.map(f32::from_bits)).collect()
}

/// Bits of a number of either sign from 2^-27 to 2, whose significand has only bits of `kept`.
fn near_one(random: &mut SplitMix64, kept: u32) -> u32 {
    let bits = random.next_u64();
    let exponent = 100 + (bits >> 32) as u32 % 28;
    (bits as u32 & (0x8000_0000 | kept)) | exponent << 23
}

/// Pairs of words: all pairs of edges, then random ones.
pub fn pairs() -> Vec<[u32; 2]> {
    let mut random = SplitMix64::new(2);
    let mut pairs = edge_pairs();
    pairs.extend((0..RANDOM).map(|_| {
        let bits = random.next_u64();
        [bits as u32, (bits >> 32) as u32]
    }));
    pairs
}

/// Words: those of 16 bits, edges, and random ones. Every second random one has the exponent of a half, or of an
/// integer.
pub fn words() -> Vec<u32> {
    let mut random = SplitMix64::new(3);
    let mut words: Vec<u32> = (0..1 << 16).collect();
    words.extend(edges());
    words.extend((0..RANDOM).map(|i| {
        let bits = random.next_u64();
        let (word, choice) = (bits as u32, (bits >> 32) as u32);
        match i % 4 {
            0 => (word & 0x807f_ffff) | (127 - 26 + choice % 44) << 23,
            2 => (word & 0x807f_ffff) | (127 + choice % 31) << 23,
            _ => word,
        }
    }));
    words
}

/// Whether both are the same number, to the bit, or both are NaN.
pub fn same(found: u32, right: f32) -> bool {
    found == right.to_bits() || (f32::from_bits(found).is_nan() && right.is_nan())
}

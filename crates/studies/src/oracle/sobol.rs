//! The Sobol sampler from its papers, one bit at a time: the oracle of `random.glsl`.

use super::pcg4d;

/// Direction numbers of the first two dimensions. (Sobol 1967; Joe and Kuo 2008)
fn directions(dimension: usize) -> [u32; 32] {
    let mut v = [0; 32];
    v[0] = 1 << 31;
    for k in 1..32 {
        v[k] = match dimension {
            0 => v[k - 1] >> 1,
            // The primitive polynomial x + 1.
            1 => v[k - 1] ^ v[k - 1] >> 1,
            _ => unreachable!("pairs have two dimensions"),
        };
    }
    v
}

/// A coordinate of a point, as a 32-bit fraction.
pub fn sobol(index: u32, dimension: usize) -> u32 {
    (directions(dimension).iter().enumerate()).fold(0, |x, (k, v)| if index >> k & 1 == 1 { x ^ v } else { x })
}

/// A nested uniform scramble: a hash of the higher bits decides whether a bit is flipped. (Burley 2020, listing 2, with
/// the hash of Vegdahl 2021)
pub fn scramble(x: u32, seed: u32) -> u32 {
    let mut x = x.reverse_bits();
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul(seed >> 16 | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^= x.wrapping_mul(0x53a2_2864);
    x.reverse_bits()
}

/// Four numbers in [0, 1), multiples of 2^-24, of pixel, sample, block and seed.
pub fn sobol4([pixel, sample, block, seed]: [u32; 4]) -> [f64; 4] {
    let pair = |which| {
        let [order, x, y, _] = pcg4d([pixel, block, seed, which]);
        let index = scramble(sample, order);
        [scramble(sobol(index, 0), x), scramble(sobol(index, 1), y)]
    };
    let [[a, b], [c, d]] = [0, 1].map(pair);
    [a, b, c, d].map(|bits| f64::from(bits >> 8) * (-24_f64).exp2())
}

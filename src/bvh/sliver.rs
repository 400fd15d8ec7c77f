//! Thin triangles, and on which side of one a point lies: `sliver.glsl` in the same arithmetic.

use glam::Vec3;

/// Longest edge times aspect, that edge over the height on it, beyond which a triangle is thin. As in `sliver.glsl`.
const THIN: f32 = 32.0;

/// Whether the triangle of these corners, in normalised space, is so thin that rounding may move it past the origin of a
/// ray that leaves its neighbour.
pub fn is_thin([a, b, c]: &[Vec3; 3]) -> bool {
    let longest = (b - a).length_squared().max((c - a).length_squared()).max((c - b).length_squared());
    // The normal is as long as the longest edge times its height.
    THIN * THIN * (b - a).cross(c - a).length_squared() < longest * longest * longest
}

/// A number as an unevaluated sum of two. (Dekker 1971)
#[derive(Clone, Copy)]
struct Sum {
    high: f32,
    low: f32,
}

impl Sum {
    fn normalised(high: f32, low: f32) -> Self {
        let sum = high + low;
        Self { high: sum, low: low - (sum - high) }
    }

    /// The product, exactly: it fits a number of twice the width.
    fn product(a: f32, b: f32) -> Self {
        let exact = f64::from(a) * f64::from(b);
        let high = exact as f32;
        Self { high, low: (exact - f64::from(high)) as f32 }
    }

    fn add(self, other: Self) -> Self {
        let sum = self.high + other.high;
        let of_other = sum - self.high;
        let lost = (self.high - (sum - of_other)) + (other.high - of_other);
        Self::normalised(sum, lost + self.low + other.low)
    }

    /// a b - c d.
    fn difference_of_products(a: f32, b: f32, c: f32, d: f32) -> Self {
        Self::product(a, b).add(Self::product(-c, d))
    }

    fn times(self, by: f32) -> Self {
        let product = Self::product(self.high, by);
        Self::normalised(product.high, product.low + self.low * by)
    }
}

/// Six volumes of the tetrahedron of three points and the origin: a . (b x c), to some 2^-44 of its terms.
pub(super) fn signed_volume([a, b, c]: [Vec3; 3]) -> f32 {
    let x = Sum::difference_of_products(b.y, c.z, b.z, c.y).times(a.x);
    let y = Sum::difference_of_products(b.z, c.x, b.x, c.z).times(a.y);
    let z = Sum::difference_of_products(b.x, c.y, b.y, c.x).times(a.z);
    x.add(y).add(z).high
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of whole numbers, whose volume integers tell.
    fn points(seed: &mut u64, bits: u32) -> [[i128; 3]; 3] {
        let mut next = || {
            *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            i128::from(*seed >> 40) % (1 << bits) - (1 << (bits - 1))
        };
        std::array::from_fn(|_| std::array::from_fn(|_| next()))
    }

    fn exact_volume([a, b, c]: [[i128; 3]; 3]) -> i128 {
        a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    }

    #[test]
    fn volumes_have_the_sign_of_exact_ones() {
        let mut seed = 1;
        let (mut checked, mut rounded_wrong) = (0, 0);
        for round in 0..200_000 {
            let [a, b, mut c] = points(&mut seed, 20);
            // Next to the plane through the origin and the others, where the volume is of the size of a rounding.
            if round % 2 == 0 {
                c = std::array::from_fn(|axis| a[axis] / 3 + b[axis] / 5 + i128::from(axis == round / 2 % 3));
            }
            let exact = exact_volume([a, b, c]);
            let [a, b, c] = [a, b, c].map(|p| Vec3::from(p.map(|x| x as f32)));
            let volume = signed_volume([a, b, c]);
            assert_eq!(volume.partial_cmp(&0.0), exact.partial_cmp(&0), "{a} {b} {c}: {volume}, not {exact}");
            checked += 1;
            rounded_wrong += usize::from(a.dot(b.cross(c)).partial_cmp(&0.0) != exact.partial_cmp(&0));
        }
        assert!(rounded_wrong > checked / 1000, "rounded once they would be wrong: {rounded_wrong} of {checked}");
    }

    #[test]
    fn thin_is_what_is_long_and_low() {
        let triangle = |length: f32, height: f32| [Vec3::ZERO, Vec3::X * length, Vec3::new(0.3 * length, height, 0.0)];
        assert!(!is_thin(&triangle(1.0, 1.0 / 31.0)) && is_thin(&triangle(1.0, 1.0 / 33.0)));
        assert!(!is_thin(&triangle(0.1, 0.01 / 31.0)) && is_thin(&triangle(0.1, 0.01 / 33.0)));
        assert!(is_thin(&triangle(1.0, 0.0)) && !is_thin(&[Vec3::ONE; 3]));
    }
}

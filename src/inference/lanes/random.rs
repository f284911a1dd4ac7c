//! Random numbers in lanes, each lane with a generator of its own.

use rand::Rng;
use rand_chacha::ChaCha12Rng;

use super::LANES;
use super::elementary::{ln, sine_and_cosine};

/// A generator xoshiro256++ (Blackman & Vigna 2021) in each lane.
///
/// Its state is drawn from ChaCha12, lane after lane, so lanes and streams are unrelated points of a cycle of
/// 2²⁵⁶ − 1 numbers: no two of them meet in practice. ChaCha itself is slower than the density that it would serve.
#[derive(Debug, Clone)]
pub struct LaneRandom {
    state: [[u64; LANES]; 4],
}

impl LaneRandom {
    /// Generators with states from this stream.
    pub fn new(seeds: &mut ChaCha12Rng) -> Self {
        let mut state = [[0; LANES]; 4];
        for lane in 0..LANES {
            for word in &mut state {
                word[lane] = seeds.next_u64();
            }
        }
        Self { state }
    }

    /// The next 64 random bits of each lane.
    #[inline(always)]
    pub fn next_bits(&mut self) -> [u64; LANES] {
        let [a, b, c, d] = &mut self.state;
        let mut bits = [0; LANES];
        for lane in 0..LANES {
            bits[lane] = a[lane]
                .wrapping_add(d[lane])
                .rotate_left(23)
                .wrapping_add(a[lane]);
            let shifted = b[lane] << 17;
            c[lane] ^= a[lane];
            d[lane] ^= b[lane];
            b[lane] ^= c[lane];
            a[lane] ^= d[lane];
            c[lane] ^= shifted;
            d[lane] = d[lane].rotate_left(45);
        }
        bits
    }

    /// Fills blocks of lanes with numbers uniform on (0, 1]: multiples of 2⁻⁵².
    #[inline(always)]
    pub fn fill_uniform<const W: usize>(&mut self, numbers: &mut [f64; W]) {
        for lanes in numbers.as_chunks_mut::<LANES>().0 {
            let bits = self.next_bits();
            for lane in 0..LANES {
                lanes[lane] = share_of(bits[lane]);
            }
        }
    }

    /// Fills blocks of lanes with random bits.
    #[inline(always)]
    pub fn fill_bits<const W: usize>(&mut self, numbers: &mut [u64; W]) {
        for lanes in numbers.as_chunks_mut::<LANES>().0 {
            *lanes = self.next_bits();
        }
    }
}

/// The upper 52 bits as a number on (0, 1].
#[inline(always)]
fn share_of(bits: u64) -> f64 {
    2.0 - f64::from_bits((bits >> 12) | 0x3ff0_0000_0000_0000)
}

/// Fills arrays of lanes with standard normal numbers (Box & Muller 1958).
///
/// ```text
/// √(−2 ln u) · (cos φ, sin φ),   u uniform on (0, 1], φ uniform on the circle
/// ```
///
/// The angle is uniform on a quarter of the circle; three more random bits mirror it onto the others.
#[inline(always)]
pub fn fill_normals<const W: usize>(random: &mut LaneRandom, normals: &mut [[f64; W]]) {
    let mut shares = [0.0; W];
    let mut bits = [0; W];
    for pair in normals.chunks_mut(2) {
        random.fill_uniform(&mut shares);
        random.fill_bits(&mut bits);
        let (first, second) = pair.split_at_mut(1);
        let mut other = [0.0; W];
        for lane in 0..W {
            let radius = (-2.0 * ln(shares[lane])).sqrt();
            let angle = (share_of(bits[lane]) - 0.5) * std::f64::consts::FRAC_PI_2;
            let (sine, cosine) = sine_and_cosine(angle);
            let is_swapped = bits[lane] & 1 == 0;
            let x = if is_swapped { sine } else { cosine };
            let y = if is_swapped { cosine } else { sine };
            // The sign goes where the sign of the radius is.
            first[0][lane] = x * f64::from_bits(radius.to_bits() | (bits[lane] & 2) << 62);
            other[lane] = y * f64::from_bits(radius.to_bits() | (bits[lane] & 4) << 61);
        }
        if let Some(second) = second.first_mut() {
            *second = other;
        }
    }
}

#[cfg(test)]
mod tests {
    use rand_chacha::rand_core::SeedableRng;

    use super::*;
    use crate::inference::diagnostics::{mean, variance};

    /// First outputs of the reference implementation for the state 1, 2, 3, 4 (rand_xoshiro's test vector).
    #[test]
    fn it_is_xoshiro256_plus_plus() {
        let mut random = LaneRandom {
            state: [[1; LANES], [2; LANES], [3; LANES], [4; LANES]],
        };
        for expected in [
            41_943_041,
            58_720_359,
            3_588_806_011_781_223,
            3_591_011_842_654_386,
            9_228_616_714_210_784_205,
        ] {
            assert_eq!(random.next_bits(), [expected; LANES]);
        }
    }

    #[test]
    fn normal_numbers_have_the_moments_and_tails_of_a_normal_distribution() {
        let mut random = LaneRandom::new(&mut ChaCha12Rng::seed_from_u64(3));
        let mut columns = vec![Vec::new(); 3];
        for _ in 0..2000 {
            let mut normals = [[0.0; 32]; 3];
            fill_normals(&mut random, &mut normals);
            for (column, numbers) in columns.iter_mut().zip(&normals) {
                column.extend_from_slice(numbers);
            }
        }
        let n = columns[0].len() as f64;
        for column in &columns {
            assert!(mean(column).abs() < 4.0 / n.sqrt());
            assert!((variance(column) - 1.0).abs() < 4.0 * (2.0 / n).sqrt());
            for (bound, share) in [
                (-2.0, 0.022_750_13),
                (-0.5, 0.308_537_5),
                (1.0, 0.841_344_7),
            ] {
                let found = column.iter().filter(|z| **z < bound).count() as f64 / n;
                assert!((found - share).abs() < 4.0 * (share * (1.0 - share) / n).sqrt());
            }
        }
        let product: f64 = columns[0].iter().zip(&columns[1]).map(|(x, y)| x * y).sum();
        assert!((product / n).abs() < 4.0 / n.sqrt());
    }
}

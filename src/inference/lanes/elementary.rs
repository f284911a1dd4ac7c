//! exp and ln without branches, tables or fused operations.

use std::f64::consts::LOG2_E;

/// Adding and taking away 1.5 · 2⁵² rounds to the nearest integer, which then stands in the lowest bits.
const ROUND: f64 = 6_755_399_441_055_744.0;

/// ln 2 in two parts, the first with enough zero bits behind for exact multiples.
const LN_2_HIGH: f64 = 6.931_471_803_691_238e-1;
const LN_2_LOW: f64 = 1.908_214_929_270_587_7e-10;

/// The bits of 1.
const ONE: u64 = 0x3ff0_0000_0000_0000;

/// 1/k! for k = 2 … 13.
const EXP: [f64; 12] = [
    5.0e-1,
    1.666_666_666_666_666_6e-1,
    4.166_666_666_666_666_4e-2,
    8.333_333_333_333_333e-3,
    1.388_888_888_888_889e-3,
    1.984_126_984_126_984e-4,
    2.480_158_730_158_73e-5,
    2.755_731_922_398_589_3e-6,
    2.755_731_922_398_589e-7,
    2.505_210_838_544_172e-8,
    2.087_675_698_786_81e-9,
    1.605_904_383_682_161_3e-10,
];

/// The coefficients of ln (1 + s)/(1 − s) beyond 2 s, in even powers of s, of FreeBSD's `e_log.c` (Sun Microsystems 1993).
const LN: [f64; 7] = [
    6.666_666_666_666_735e-1,
    3.999_999_999_940_942e-1,
    2.857_142_874_366_239e-1,
    2.222_219_843_214_978_4e-1,
    1.818_357_216_161_805e-1,
    1.531_383_769_920_937_3e-1,
    1.479_819_860_511_658_6e-1,
];

/// e to the power of x, within 2 units of the last place; 0 and ∞ beyond its range, NaN for NaN.
///
/// ```text
/// e^x = 2^n e^r,   n = round(x / ln 2),   |r| ≤ ½ ln 2
/// ```
#[inline(always)]
pub fn exp(x: f64) -> f64 {
    // Written so that NaN passes through.
    let x = if x > 710.0 { 710.0 } else { x };
    let x = if x < -746.0 { -746.0 } else { x };
    let n = (x * LOG2_E + ROUND) - ROUND;
    let r = (x - n * LN_2_HIGH) - n * LN_2_LOW;
    let r2 = r * r;
    let r4 = r2 * r2;
    let low = (EXP[0] + EXP[1] * r) + (EXP[2] + EXP[3] * r) * r2;
    let middle = (EXP[4] + EXP[5] * r) + (EXP[6] + EXP[7] * r) * r2;
    let high = (EXP[8] + EXP[9] * r) + (EXP[10] + EXP[11] * r) * r2;
    let power = 1.0 + (r + r2 * (low + r4 * (middle + r4 * high)));
    // 2^n in two factors, since it may lie beyond the largest number or below the smallest normal one.
    let half = (n * 0.5 + ROUND) - ROUND;
    power * power_of_two(half) * power_of_two(n - half)
}

/// 2^n for an integer n from −1022 to 1023.
#[inline(always)]
fn power_of_two(n: f64) -> f64 {
    f64::from_bits(((n + ROUND).to_bits() << 52).wrapping_add(ONE))
}

/// The natural logarithm, within 1 unit of the last place; −∞ at 0, NaN below.
///
/// ```text
/// ln x = k ln 2 + ln m,   m from √½ to √2,   ln m = ln (1 + s)/(1 − s),   s = (m − 1)/(m + 1)
/// ```
#[inline(always)]
pub fn ln(x: f64) -> f64 {
    const SQRT_HALF: u64 = 0x3fe6_a09e_0000_0000;
    const TWO_TO_54: f64 = 18_014_398_509_481_984.0;
    const TWO_TO_52_BITS: u64 = 0x4330_0000_0000_0000;
    const TWO_TO_52: f64 = 4_503_599_627_370_496.0;
    let is_subnormal = x < f64::MIN_POSITIVE;
    let scaled = if is_subnormal { x * TWO_TO_54 } else { x };
    let offset = if is_subnormal { 1077.0 } else { 1023.0 };
    let bits = scaled.to_bits().wrapping_add(ONE - SQRT_HALF);
    let k = (f64::from_bits((bits >> 52) | TWO_TO_52_BITS) - TWO_TO_52) - offset;
    let m = f64::from_bits((bits & 0x000f_ffff_ffff_ffff).wrapping_add(SQRT_HALF));
    let f = m - 1.0;
    let s = f / (2.0 + f);
    let z = s * s;
    let w = z * z;
    let even = w * (LN[1] + w * (LN[3] + w * LN[5]));
    let odd = z * (LN[0] + w * (LN[2] + w * (LN[4] + w * LN[6])));
    let half_square = 0.5 * f * f;
    let value =
        k * LN_2_HIGH - ((half_square - (s * (half_square + (even + odd)) + k * LN_2_LOW)) - f);
    let value = if x == f64::INFINITY { x } else { value };
    let value = if x == 0.0 { f64::NEG_INFINITY } else { value };
    if x >= 0.0 { value } else { f64::NAN }
}

/// ln(1 + x) for x in [0, 1], accurate however small x is.
#[inline(always)]
pub fn ln_1p_of_share(x: f64) -> f64 {
    let sum = 1.0 + x;
    // What the sum lost by rounding.
    ln(sum) + (x - (sum - 1.0)) / sum
}

/// Sine and cosine of an angle from −π/4 to π/4.
#[inline(always)]
pub(super) fn sine_and_cosine(angle: f64) -> (f64, f64) {
    let z = angle * angle;
    let w = z * z;
    // Taylor series up to angle^17 and angle^16.
    let sine = 1.0
        - z * ((1.0 / 6.0 - z / 120.0)
            + w * (1.0 / 5_040.0 - z / 362_880.0)
            + w * w
                * ((1.0 / 39_916_800.0 - z / 6_227_020_800.0) + w * (1.0 / 1_307_674_368_000.0)));
    let cosine = (1.0 - z * 0.5)
        + w * ((1.0 / 24.0 - z / 720.0)
            + w * (1.0 / 40_320.0 - z / 3_628_800.0)
            + w * w
                * ((1.0 / 479_001_600.0 - z / 87_178_291_200.0)
                    + w * (1.0 / 20_922_789_888_000.0)));
    (angle * sine, cosine)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use std::f64::consts::FRAC_PI_4;

    use super::*;
    use crate::inference::lanes::{InstructionSet, Kernel};

    #[track_caller]
    fn check(found: f64, expected: f64, tolerance: f64) {
        let close = (found - expected).abs() <= tolerance * expected.abs();
        let same = found == expected || found.is_nan() && expected.is_nan();
        assert!(same || close, "{found:e}, expected {expected:e}");
    }

    #[test]
    fn special_values_are_those_of_the_standard_library() {
        for x in [
            f64::NEG_INFINITY,
            -746.0,
            -745.2,
            -0.0,
            0.0,
            709.78,
            709.79,
            f64::INFINITY,
            f64::NAN,
        ] {
            check(exp(x), x.exp(), 1e-15);
        }
        for x in [
            f64::NEG_INFINITY,
            -1.0,
            -0.0,
            0.0,
            5e-324,
            1e-310,
            f64::MIN_POSITIVE,
            1.0,
            f64::MAX,
            f64::INFINITY,
            f64::NAN,
        ] {
            check(ln(x), x.ln(), 4e-16);
        }
        // Near the smallest number there are fewer digits.
        assert!((exp(-730.0) - (-730.0_f64).exp()).abs() <= 2.0 * 5e-324);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        #[test]
        fn exp_is_that_of_the_standard_library(x in -708.0..709.0, small in -1.0..1.0) {
            check(exp(x), x.exp(), 4.5e-16);
            check(exp(small), small.exp(), 4.5e-16);
        }

        #[test]
        fn ln_is_that_of_the_standard_library(exponent in -745.0..709.0, near in 0.5..2.0) {
            let x: f64 = f64::exp(exponent);
            check(ln(x), x.ln(), 4e-16);
            check(ln(near), near.ln(), 4e-16);
        }

        #[test]
        fn small_shares_keep_their_digits(exponent in -700.0..0.0) {
            let x: f64 = f64::exp(exponent);
            check(ln_1p_of_share(x), x.ln_1p(), 6e-16);
        }

        #[test]
        fn angles_have_their_sine_and_cosine(angle in -FRAC_PI_4..FRAC_PI_4) {
            let (sine, cosine) = sine_and_cosine(angle);
            check(sine, angle.sin(), 4.5e-16);
            check(cosine, angle.cos(), 4.5e-16);
        }
    }

    struct Both<'a> {
        values: &'a mut [[f64; 16]],
    }

    impl Kernel for Both<'_> {
        type Output = ();

        #[inline(always)]
        fn run(self) {
            for value in self.values.iter_mut().flatten() {
                *value = ln(*value) + exp(-*value);
            }
        }
    }

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        let values: Vec<[f64; 16]> = (0..100)
            .map(|row| std::array::from_fn(|lane| f64::from(1 + row * 16 + lane as i32) * 0.37))
            .collect();
        let results: Vec<Vec<[f64; 16]>> = InstructionSet::available()
            .into_iter()
            .map(|set| {
                let mut values = values.clone();
                set.run(Both {
                    values: &mut values,
                });
                values
            })
            .collect();
        assert!(results.iter().all(|result| *result == results[0]));
    }
}

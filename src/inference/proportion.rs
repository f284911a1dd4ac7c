//! Intervals for shares of people.

/// Wilson's 95 % interval for a share.
///
/// ```text
/// (p̂ + z²/2n ± z sqrt(p̂(1 − p̂)/n + z²/4n²)) / (1 + z²/n),   z = 1.959964
/// ```
///
/// * `count`: how many of `n` chose the action. With n = 0 nothing is known: (0, 1).
///
/// Source: Wilson (1927), *Probable inference, the law of succession, and statistical inference*.
pub fn wilson_interval(count: u64, n: u64) -> (f64, f64) {
    const Z: f64 = 1.959_963_984_540_054;
    if n == 0 {
        return (0.0, 1.0);
    }
    let n_float = n as f64;
    let share = count as f64 / n_float;
    let squared = Z * Z / n_float;
    let centre = share + squared / 2.0;
    let half = Z * (share * (1.0 - share) / n_float + squared / (4.0 * n_float)).sqrt();
    // At the ends the equation gives 0 and 1 exactly, but for rounding.
    let low = if count == 0 {
        0.0
    } else {
        (centre - half) / (1.0 + squared)
    };
    let high = if count == n {
        1.0
    } else {
        (centre + half) / (1.0 + squared)
    };
    (low, high)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Newcombe (1998), *Two-sided confidence intervals for the single proportion*, table I, method 3:
    /// 81/263, 15/148, 0/20, 1/29.
    #[test]
    fn intervals_of_newcombe() {
        for (count, n, low, high) in [
            (81, 263, 0.2553, 0.3662),
            (15, 148, 0.0624, 0.1605),
            (0, 20, 0.0, 0.1611),
            (1, 29, 0.0061, 0.1718),
        ] {
            let found = wilson_interval(count, n);
            assert!(
                (found.0 - low).abs() < 5e-5 && (found.1 - high).abs() < 5e-5,
                "{found:?}"
            );
        }
    }

    #[test]
    fn the_ends_are_exact() {
        assert_eq!(wilson_interval(0, 0), (0.0, 1.0));
        assert_eq!(wilson_interval(0, 7).0, 0.0);
        assert_eq!(wilson_interval(7, 7).1, 1.0);
    }
}

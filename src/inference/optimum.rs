//! The highest point of a function of a few variables, from several starts.
//!
//! Source: Nelder & Mead (1965), with the coefficients of Gao & Han (2012) that depend on the dimension.

/// A point and the function's value there.
#[derive(Debug, Clone, PartialEq)]
pub struct Optimum {
    /// The point.
    pub position: Vec<f64>,
    /// The value.
    pub value: f64,
}

/// Evaluations that one climb may take.
const MAX_EVALUATIONS: usize = 4000;

/// A climb ends when the simplex differs by less than this in value.
const TOLERANCE: f64 = 1e-10;

/// Climbs again from the best point, with a fresh simplex, as long as that gains this much: a simplex may collapse
/// before it arrives.
const RESTART_GAIN: f64 = 1e-8;

/// Most climbs from one start.
const MAX_RESTARTS: usize = 20;

/// The highest point found from any of the starts.
///
/// * `function`: may be −∞ (not allowed there), never NaN.
/// * `starts`: at least one; each is climbed from with a simplex of edge `step`, and the best is refined.
pub fn maximise(
    function: &mut dyn FnMut(&[f64]) -> f64,
    starts: &[Vec<f64>],
    step: f64,
) -> Optimum {
    let mut best = Optimum {
        position: starts[0].clone(),
        value: f64::NEG_INFINITY,
    };
    for start in starts {
        let found = climb(function, start, step);
        if found.value > best.value {
            best = found;
        }
    }
    for restart in 0..MAX_RESTARTS {
        // Alternating sizes: a large simplex to leave a ridge's side, a small one to settle.
        let size = if restart % 2 == 0 { step } else { step / 10.0 };
        let found = climb(function, &best.position, size);
        let gain = found.value - best.value;
        if gain > 0.0 {
            best = found;
        }
        if restart % 2 == 1 && gain < RESTART_GAIN {
            break;
        }
    }
    best
}

/// One climb of a simplex.
fn climb(function: &mut dyn FnMut(&[f64]) -> f64, start: &[f64], step: f64) -> Optimum {
    let dimension = start.len();
    let n = dimension as f64;
    // With one variable the dimension-dependent coefficients degenerate; the classic ones do not.
    let (expand, contract, shrink) = if dimension == 1 {
        (2.0, 0.5, 0.5)
    } else {
        (1.0 + 2.0 / n, 0.75 - 0.5 / n, 1.0 - 1.0 / n)
    };
    let mut evaluations = 0;
    let mut evaluate = |position: Vec<f64>| {
        evaluations += 1;
        let value = function(&position);
        (Optimum { position, value }, evaluations)
    };
    let mut simplex = vec![evaluate(start.to_vec()).0];
    for coordinate in 0..dimension {
        let mut position = start.to_vec();
        position[coordinate] += step;
        simplex.push(evaluate(position).0);
    }
    loop {
        simplex.sort_by(|left, right| right.value.total_cmp(&left.value));
        let (best, worst) = (&simplex[0], &simplex[dimension]);
        let width = (0..dimension)
            .map(|i| (best.position[i] - worst.position[i]).abs())
            .fold(0.0, f64::max);
        if best.value - worst.value <= TOLERANCE && width < 1e-5 {
            break;
        }
        let centre: Vec<f64> = (0..dimension)
            .map(|i| {
                simplex[..dimension]
                    .iter()
                    .map(|vertex| vertex.position[i])
                    .sum::<f64>()
                    / n
            })
            .collect();
        let along = |factor: f64| -> Vec<f64> {
            centre
                .iter()
                .zip(&worst.position)
                .map(|(c, w)| c + factor * (c - w))
                .collect()
        };
        let second_worst = simplex[dimension - 1].value;
        let (reflected, count) = evaluate(along(1.0));
        if count > MAX_EVALUATIONS {
            break;
        }
        let replacement = if reflected.value > best.value {
            let expanded = evaluate(along(expand)).0;
            Some(if expanded.value > reflected.value {
                expanded
            } else {
                reflected
            })
        } else if reflected.value > second_worst {
            Some(reflected)
        } else {
            let outside = reflected.value > worst.value;
            let contracted = evaluate(along(if outside { contract } else { -contract })).0;
            (contracted.value > worst.value.max(reflected.value)).then_some(contracted)
        };
        match replacement {
            Some(vertex) => simplex[dimension] = vertex,
            None => {
                let anchor = simplex[0].position.clone();
                for vertex in &mut simplex[1..] {
                    let moved = anchor.iter().zip(&vertex.position);
                    *vertex = evaluate(moved.map(|(a, x)| a + shrink * (x - a)).collect()).0;
                }
            }
        }
    }
    simplex.swap_remove(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rosenbrocks_valley_is_followed_to_its_end() {
        let mut valley = |x: &[f64]| -(100.0 * (x[1] - x[0] * x[0]).powi(2) + (1.0 - x[0]).powi(2));
        let found = maximise(&mut valley, &[vec![-1.2, 1.0]], 0.5);
        assert!(found.value > -1e-9, "{found:?}");
        assert!((found.position[0] - 1.0).abs() < 1e-4);
    }

    #[test]
    fn one_variable_is_enough() {
        let found = maximise(&mut |x: &[f64]| -(x[0] - 3.0).powi(2), &[vec![-5.0]], 1.0);
        assert!((found.position[0] - 3.0).abs() < 1e-4);
    }

    /// Two hills: the lower one is nearer to the first start.
    #[test]
    fn the_higher_of_two_hills_is_found() {
        let hill = |x: &[f64], at: f64| -> f64 {
            (-x.iter().map(|x| (x - at).powi(2)).sum::<f64>()).exp()
        };
        let mut hills = |x: &[f64]| hill(x, -3.0) + 2.0 * hill(x, 3.0);
        let found = maximise(&mut hills, &[vec![-2.5; 3], vec![2.0; 3]], 0.3);
        assert!((found.value - 2.0).abs() < 1e-6, "{found:?}");
    }
}

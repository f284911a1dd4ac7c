//! Lower triangles of small matrices, packed row by row.

/// The lower triangle L of a covariance L Lᵀ: entry (row, column) stands at row (row + 1)/2 + column.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Triangle {
    pub(super) entries: Vec<f64>,
    dimension: usize,
}

impl Triangle {
    /// Factors a covariance given as packed lower triangle; where it has no extent, a tiny one is put in its place.
    pub(super) fn of(covariance: &[f64], dimension: usize) -> Self {
        let mut lower = Self {
            entries: vec![0.0; covariance.len()],
            dimension,
        };
        for row in 0..dimension {
            for column in 0..=row {
                let dot: f64 = (0..column)
                    .map(|k| lower.at(row, k) * lower.at(column, k))
                    .sum();
                let rest = covariance[place(row, column)] - dot;
                lower.entries[place(row, column)] = if row == column {
                    rest.max(1e-10 * covariance[place(row, row)])
                        .max(1e-20)
                        .sqrt()
                } else {
                    rest / lower.at(column, column)
                };
            }
        }
        lower
    }

    /// L⁻¹, a lower triangle too.
    pub(super) fn inverse(&self) -> Self {
        let mut inverse = Self {
            entries: vec![0.0; self.entries.len()],
            dimension: self.dimension,
        };
        for column in 0..self.dimension {
            for row in column..self.dimension {
                let unit = f64::from(u8::from(row == column));
                let dot: f64 = (column..row)
                    .map(|k| self.at(row, k) * inverse.at(k, column))
                    .sum();
                inverse.entries[place(row, column)] = (unit - dot) / self.at(row, row);
            }
        }
        inverse
    }

    /// L with every entry multiplied.
    pub(super) fn scaled(mut self, factor: f64) -> Self {
        for entry in &mut self.entries {
            *entry *= factor;
        }
        self
    }

    /// L x.
    pub(super) fn times(&self, x: &[f64]) -> Vec<f64> {
        let row = |row: usize| (0..=row).map(|k| self.at(row, k) * x[k]).sum();
        (0..self.dimension).map(row).collect()
    }

    /// The product of the diagonal: the determinant.
    pub(super) fn determinant(&self) -> f64 {
        (0..self.dimension).map(|row| self.at(row, row)).product()
    }

    fn at(&self, row: usize, column: usize) -> f64 {
        self.entries[place(row, column)]
    }
}

fn place(row: usize, column: usize) -> usize {
    row * (row + 1) / 2 + column
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_and_inverses_are_those_of_the_covariance() {
        let factor = Triangle::of(&[4.0, 2.0, 3.0], 2);
        assert!((factor.determinant() - 8.0_f64.sqrt()).abs() < 1e-12);
        // Inverse of [[4, 2], [2, 3]] is [[3, -2], [-2, 4]] / 8.
        let whitened = factor.inverse().times(&[1.0, 2.0]);
        let distance: f64 = whitened.iter().map(|x| x * x).sum();
        assert!((distance - (3.0 - 8.0 + 16.0) / 8.0).abs() < 1e-12);
    }
}

//! Weighted points that a proposal is fitted to.

/// Points with weights, one column per coordinate.
#[derive(Debug, Clone)]
pub struct Cloud {
    pub(super) coordinates: Vec<Vec<f64>>,
    pub(super) weights: Vec<f64>,
}

impl Cloud {
    /// Points of equal weight: `coordinates[coordinate][point]`.
    pub fn new(coordinates: Vec<Vec<f64>>) -> Self {
        let weights = vec![1.0; coordinates.first().map_or(0, Vec::len)];
        Self {
            coordinates,
            weights,
        }
    }

    /// How many points there are.
    pub fn len(&self) -> usize {
        self.weights.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.weights.is_empty()
    }

    /// One point.
    pub fn point(&self, index: usize) -> Vec<f64> {
        self.coordinates
            .iter()
            .map(|column| column[index])
            .collect()
    }

    /// `W` positions from an index on, `block[coordinate][lane]`; those beyond the last point stand on it.
    pub fn block<const W: usize>(&self, start: usize) -> Vec<[f64; W]> {
        let last = self.len() - 1;
        self.coordinates
            .iter()
            .map(|column| std::array::from_fn(|lane| column[(start + lane).min(last)]))
            .collect()
    }

    /// All points, one by one.
    pub fn points(&self) -> Vec<Vec<f64>> {
        (0..self.len()).map(|index| self.point(index)).collect()
    }

    /// These points and others.
    pub fn extend(&mut self, other: &Self) {
        for (column, more) in self.coordinates.iter_mut().zip(&other.coordinates) {
            column.extend_from_slice(more);
        }
        self.weights.extend_from_slice(&other.weights);
    }

    /// Weighted mean and covariance, the latter as packed lower triangle.
    pub(super) fn moments(&self) -> (Vec<f64>, Vec<f64>) {
        let total: f64 = self.weights.iter().sum();
        let mean = |column: &Vec<f64>| -> f64 {
            let sum: f64 = column.iter().zip(&self.weights).map(|(x, w)| w * x).sum();
            sum / total
        };
        let centre: Vec<f64> = self.coordinates.iter().map(mean).collect();
        let mut covariance = Vec::new();
        for (row, left) in self.coordinates.iter().enumerate() {
            for (column, right) in self.coordinates[..=row].iter().enumerate() {
                let sum: f64 = left
                    .iter()
                    .zip(right)
                    .zip(&self.weights)
                    .map(|((x, y), w)| w * (x - centre[row]) * (y - centre[column]))
                    .sum();
                covariance.push(sum / total);
            }
        }
        (centre, covariance)
    }
}

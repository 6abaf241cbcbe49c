use super::{StatisticsError, check_finite};

/// One measure of several people under several conditions.
#[derive(Clone, Debug, PartialEq)]
pub struct RepeatedMeasures {
    conditions: Vec<String>,
    rows: Vec<Vec<Option<f64>>>,
}

impl RepeatedMeasures {
    /// `rows`: `[people][conditions]`; none where a value is missing.
    ///
    /// # Errors
    /// [`StatisticsError::Ragged`], [`StatisticsError::NotFinite`].
    pub fn new(conditions: Vec<String>, rows: Vec<Vec<Option<f64>>>) -> Result<Self, StatisticsError> {
        for (row, values) in rows.iter().enumerate() {
            if values.len() != conditions.len() {
                let (got, expected) = (values.len(), conditions.len());
                return Err(StatisticsError::Ragged { row, got, expected });
            }
            check_finite(row, &values.iter().copied().flatten().collect::<Vec<_>>())?;
        }
        Ok(Self { conditions, rows })
    }

    /// Names of the conditions.
    pub fn conditions(&self) -> &[String] {
        &self.conditions
    }

    /// How many people.
    pub fn participant_count(&self) -> usize {
        self.rows.len()
    }

    /// The values of those people who have one under every condition: `[people][conditions]`.
    pub fn complete(&self) -> Vec<Vec<f64>> {
        self.rows.iter().filter_map(|row| row.iter().copied().collect()).collect()
    }

    /// The values of those who have one under both conditions `a` and `b`.
    ///
    /// # Panics
    /// If there is no such condition.
    pub fn pairs(&self, a: usize, b: usize) -> Vec<[f64; 2]> {
        self.rows.iter().filter_map(|row| Some([row[a]?, row[b]?])).collect()
    }
}

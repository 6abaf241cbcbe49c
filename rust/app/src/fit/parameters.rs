use proact_participants::Population;

/// A value of the population that is fitted.
pub struct Parameter {
    /// Its key in `population.toml`.
    pub name: &'static str,
    /// The search begins here: what was chosen before there was a fit.
    pub start: f64,
    /// The search stays between these.
    pub low: f64,
    /// The search stays between these.
    pub high: f64,
    /// The value.
    pub value: fn(&mut Population) -> &mut f64,
}

/// What is fitted. All other values keep what their sources, or assumptions, say.
pub const PARAMETERS: [Parameter; 5] = [
    Parameter {
        name: "decision_time_ms.median",
        start: 1000.0,
        low: 100.0,
        high: 6000.0,
        value: |p| &mut p.decision_time_ms.median,
    },
    Parameter {
        name: "decision_time_ms.log_sd",
        start: 0.9,
        low: 0.2,
        high: 1.6,
        value: |p| &mut p.decision_time_ms.log_sd,
    },
    Parameter {
        name: "confusions_per_min.median",
        start: 0.8,
        low: 0.05,
        high: 8.0,
        value: |p| &mut p.confusions_per_min.median,
    },
    Parameter {
        name: "person.forward_model_relative_error",
        start: 0.05,
        low: 0.005,
        high: 0.3,
        value: |p| &mut p.person.forward_model_relative_error,
    },
    Parameter {
        name: "person.wrong_direction_probability",
        start: 0.02,
        low: 0.002,
        high: 0.3,
        value: |p| &mut p.person.wrong_direction_probability,
    },
];

impl Parameter {
    /// The value as the search has it: any number, of which 0 is half way between the bounds, by ratio.
    pub fn to_coordinate(&self, value: f64) -> f64 {
        let share = (value / self.low).ln() / (self.high / self.low).ln();
        let share = share.clamp(1e-6, 1.0 - 1e-6);
        (share / (1.0 - share)).ln()
    }

    /// The value at `coordinate`, to three digits: what is written down is what was run.
    pub fn from_coordinate(&self, coordinate: f64) -> f64 {
        let share = 1.0 / (1.0 + (-coordinate).exp());
        let value = self.low * (self.high / self.low).powf(share);
        let digit = 10_f64.powf(value.log10().floor() - 2.0);
        let rounded = (value / digit).round() * digit;
        // Without what a product of powers of ten leaves behind the last digit.
        format!("{rounded:.6}").parse().expect("it was written as a number")
    }
}

/// `from` with what the search begins at.
pub fn population_at_start(from: &Population) -> Population {
    let mut population = *from;
    for parameter in &PARAMETERS {
        *(parameter.value)(&mut population) = parameter.start;
    }
    population
}

/// `from` with the fitted values at `coordinates`.
pub fn population_at(from: &Population, coordinates: &[f64]) -> Population {
    let mut population = *from;
    for (parameter, coordinate) in PARAMETERS.iter().zip(coordinates) {
        *(parameter.value)(&mut population) = parameter.from_coordinate(*coordinate);
    }
    population
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_search_stays_within_the_bounds_and_finds_what_it_began_with() {
        let mut population = Population::standard();
        for parameter in &PARAMETERS {
            let value = *(parameter.value)(&mut population);
            let again = parameter.from_coordinate(parameter.to_coordinate(value));
            assert!((again / value - 1.0).abs() < 0.01, "{}: {again} of {value}", parameter.name);
            assert!(
                parameter.from_coordinate(-50.0) >= parameter.low * 0.99
                    && parameter.from_coordinate(50.0) <= parameter.high * 1.01
            );
        }
        let coordinates = [0.0; PARAMETERS.len()];
        population_at(&population, &coordinates).check().unwrap();
    }
}

use crate::{EmgError, EmgModel, extract_features};
use nalgebra::{DMatrix, SymmetricEigen};
use proact_types::{EmgSample, Gesture};
use serde::Serialize;

/// Variances below this share of the largest, of standardised features, count as zero.
const TOLERANCE: f64 = 1e-9;

/// What the two axes of a [`FeatureSpace`] are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FeatureSpaceAxes {
    /// The two directions in which the means of the gestures lie furthest apart beside the spread within a gesture (Fisher's
    /// linear discriminants).
    LinearDiscriminants,
    /// The two directions of the largest variance of standardised features, where there are fewer than three gestures, or
    /// nothing that varies within them.
    PrincipalComponents,
}

/// The windows of a training in two dimensions: how far gestures lie apart.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FeatureSpace {
    /// What the axes are.
    pub axes: FeatureSpaceAxes,
    /// Share of the spread between gestures (of the variance, with principal components) that each axis has, 0 to 1.
    #[serde(rename = "shares")]
    pub explained_variance_ratio: [f64; 2],
    /// The gesture of each window.
    pub gestures: Vec<Gesture>,
    /// `[windows][2]`; of linear discriminants in standard deviations within a gesture.
    pub points: Vec<[f64; 2]>,
}

/// The windows of `recordings`, each of one gesture and before centring, along the two axes that tell most. Deterministic; the
/// sign of an axis is that which makes its largest weight positive.
///
/// # Errors
/// What [`extract_features`] refuses, fewer than two gestures, or no convergence.
pub fn feature_space(
    model: &EmgModel,
    recordings: &[(Gesture, &[EmgSample])],
) -> Result<FeatureSpace, EmgError> {
    let (mut windows, mut gestures) = (Vec::new(), Vec::new());
    for (gesture, samples) in recordings.iter().filter(|(gesture, _)| model.config.trains_on(*gesture)) {
        let centered: Vec<EmgSample> =
            samples.iter().map(|sample| model.subtract_dc_offset(sample)).collect();
        windows.extend(extract_features(&model.config, &centered)?);
        gestures.resize(windows.len(), *gesture);
    }
    let rows: Vec<&[f64]> = windows.iter().map(|window| &window[..]).collect();
    project(&rows, &gestures)
}

fn project(rows: &[&[f64]], gestures: &[Gesture]) -> Result<FeatureSpace, EmgError> {
    let classes = crate::classifier::distinct(gestures.iter().copied());
    if classes.len() < 2 {
        return Err(EmgError::TooFewClasses { got: classes.len() });
    }
    let features = rows.first().map_or(0, |row| row.len());
    let values = standardize(&DMatrix::from_fn(rows.len(), features, |i, j| rows[i][j]));
    let labels: Vec<usize> = gestures.iter().filter_map(|g| classes.binary_search(g).ok()).collect();
    let found = match classes.len() {
        0..=2 => None,
        count => linear_discriminants(&values, &labels, count)?,
    };
    let (axes, Projection { directions, explained_variance_ratio: shares }) = match found {
        Some(found) => (FeatureSpaceAxes::LinearDiscriminants, found),
        None => (
            FeatureSpaceAxes::PrincipalComponents,
            principal_components(&(values.tr_mul(&values) / rows.len() as f64))?,
        ),
    };
    let points = &values * directions;
    let points = points.row_iter().map(|row| [row[0], row[1]]).collect();
    Ok(FeatureSpace { axes, explained_variance_ratio: shares, gestures: gestures.to_vec(), points })
}

/// Two directions in the features, `[features][2]`, and what each has a share of.
struct Projection {
    directions: DMatrix<f64>,
    explained_variance_ratio: [f64; 2],
}

/// Mean 0 and deviation 1 of each column; a constant one is zero.
fn standardize(values: &DMatrix<f64>) -> DMatrix<f64> {
    let mut out = values.clone();
    for mut column in out.column_iter_mut() {
        let mean = column.mean();
        column.add_scalar_mut(-mean);
        let spread = (column.norm_squared() / column.len().max(1) as f64).sqrt();
        if spread > 0.0 {
            column /= spread;
        }
    }
    out
}

/// The two directions of the largest variance in `covariance`, and their shares of all of it.
fn principal_components(covariance: &DMatrix<f64>) -> Result<Projection, EmgError> {
    let eigen =
        SymmetricEigen::try_new(covariance.clone(), f64::EPSILON, 100_000).ok_or(EmgError::NoConvergence)?;
    let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let total: f64 = eigen.eigenvalues.iter().map(|v| v.max(0.0)).sum();
    let mut directions = DMatrix::zeros(covariance.nrows(), 2);
    let mut shares = [0.0; 2];
    for (axis, &feature_index) in order.iter().take(2).enumerate() {
        let column = eigen.eigenvectors.column(feature_index);
        let largest = column.iter().fold(0.0, |max: f64, v| if v.abs() > max.abs() { *v } else { max });
        directions.set_column(axis, &(column * largest.signum()));
        shares[axis] = if total > 0.0 { eigen.eigenvalues[feature_index].max(0.0) / total } else { 0.0 };
    }
    Ok(Projection { directions, explained_variance_ratio: shares })
}

/// Fisher's discriminants: the windows are whitened by the covariance within classes, and the means of the classes then tell
/// the directions. None if nothing varies within classes.
fn linear_discriminants(
    values: &DMatrix<f64>,
    labels: &[usize],
    classes: usize,
) -> Result<Option<Projection>, EmgError> {
    let (count, features) = values.shape();
    let mut means = DMatrix::zeros(classes, features);
    let mut counts: Vec<f64> = vec![0.0; classes];
    for (row, &label) in values.row_iter().zip(labels) {
        counts[label] += 1.0;
        let mut mean = means.row_mut(label);
        mean += row;
    }
    for (label, total) in counts.iter().enumerate() {
        let mut mean = means.row_mut(label);
        mean /= total.max(1.0);
    }
    let within = DMatrix::from_fn(count, features, |i, j| values[(i, j)] - means[(labels[i], j)]);
    let covariance = within.tr_mul(&within) / count as f64;
    let eigen = SymmetricEigen::try_new(covariance, f64::EPSILON, 100_000).ok_or(EmgError::NoConvergence)?;
    let largest = eigen.eigenvalues.max();
    if largest.is_nan() || largest <= 0.0 {
        return Ok(None);
    }
    let kept: Vec<usize> = (0..features).filter(|k| eigen.eigenvalues[*k] > TOLERANCE * largest).collect();
    let whitening = DMatrix::from_fn(features, kept.len(), |j, k| {
        eigen.eigenvectors[(j, kept[k])] / eigen.eigenvalues[kept[k]].sqrt()
    });
    // Weighted by their windows; the mean of all is zero, since the features are standardised.
    let weighted =
        DMatrix::from_fn(classes, features, |k, j| means[(k, j)] * (counts[k] / count as f64).sqrt());
    let whitened = weighted * &whitening;
    let Projection { directions, explained_variance_ratio: shares } =
        principal_components(&whitened.tr_mul(&whitened))?;
    Ok(Some(Projection { directions: whitening * directions, explained_variance_ratio: shares }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::Command;

    /// Windows of four features: two tell three classes apart, the third is loud and says nothing, the fourth is constant.
    fn rows() -> (Vec<[f64; 4]>, Vec<Gesture>) {
        let gestures = [Command::NoMotion, Command::HandClose, Command::HandOpen];
        let means = [[0.0, 0.0], [4.0, 0.0], [0.0, 3.0]];
        let window = |k: usize| {
            let (a, b) = ((k as f64 * 1.7).sin(), (k as f64 * 2.9).cos());
            let mean = means[k % 3];
            [mean[0] + 0.3 * a, mean[1] + 0.3 * b, 500.0 * (k as f64 * 0.7).sin(), 7.0]
        };
        ((0..240).map(window).collect(), (0..240).map(|k| gestures[k % 3].into()).collect())
    }

    fn separation(space: &FeatureSpace) -> f64 {
        let of = |gesture: Command| {
            let own: Vec<[f64; 2]> = space
                .gestures
                .iter()
                .zip(&space.points)
                .filter(|(g, _)| **g == gesture)
                .map(|(_, p)| *p)
                .collect();
            let mean = [0, 1].map(|k| own.iter().map(|p| p[k]).sum::<f64>() / own.len() as f64);
            let far = own.iter().map(|p| (p[0] - mean[0]).hypot(p[1] - mean[1])).fold(0.0, f64::max);
            (mean, far)
        };
        let (a, b, c) = (of(Command::NoMotion), of(Command::HandClose), of(Command::HandOpen));
        let distance =
            |x: ([f64; 2], f64), y: ([f64; 2], f64)| (x.0[0] - y.0[0]).hypot(x.0[1] - y.0[1]) / (x.1 + y.1);
        distance(a, b).min(distance(a, c)).min(distance(b, c))
    }

    #[test]
    fn discriminants_part_the_gestures_that_a_loud_feature_hides_from_principal_components() {
        let (rows, gestures) = rows();
        let rows: Vec<&[f64]> = rows.iter().map(<[f64; 4]>::as_slice).collect();
        let space = project(&rows, &gestures).expect("three gestures");
        assert_eq!(space.axes, FeatureSpaceAxes::LinearDiscriminants);
        assert!(separation(&space) > 2.0, "{}", separation(&space));
        assert!(
            (space.explained_variance_ratio.iter().sum::<f64>() - 1.0).abs() < 1e-9,
            "three means lie in a plane"
        );
        // Within a gesture the spread along each axis is one.
        let values = |axis: usize| {
            let own = space.gestures.iter().zip(&space.points).filter(|(g, _)| **g == Command::HandOpen);
            own.map(|(_, p)| p[axis]).collect::<Vec<f64>>()
        };
        for axis in [0, 1] {
            let own = values(axis);
            let mean = own.iter().sum::<f64>() / own.len() as f64;
            let variance = own.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / own.len() as f64;
            assert!((0.8..1.25).contains(&variance), "axis {axis}: {variance}");
        }
        assert_eq!(project(&rows, &gestures), Ok(space), "the same windows, the same picture");
    }

    #[test]
    fn two_gestures_are_shown_by_principal_components_and_one_is_refused() {
        let (rows, gestures) = rows();
        let two: Vec<usize> = (0..rows.len()).filter(|k| k % 3 < 2).collect();
        let own: Vec<&[f64]> = two.iter().map(|k| rows[*k].as_slice()).collect();
        let names: Vec<Gesture> = two.iter().map(|k| gestures[*k]).collect();
        let space = project(&own, &names).expect("two gestures");
        assert_eq!(space.axes, FeatureSpaceAxes::PrincipalComponents);
        assert!(
            space.explained_variance_ratio[0] >= space.explained_variance_ratio[1]
                && space.explained_variance_ratio[0] + space.explained_variance_ratio[1] <= 1.0
        );
        let one = vec![names[0]; own.len()];
        assert_eq!(project(&own, &one), Err(EmgError::TooFewClasses { got: 1 }));
    }
}

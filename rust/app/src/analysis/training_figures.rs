//! Figures of a training: what is taken for what, and how far the gestures lie apart.

use super::charts::{ChartError, ChartSpec, Charts};
use proact_emg::{FeatureSpace, FeatureSpaceAxes};
use proact_types::Gesture;
use serde_json::json;

/// Dots of a gesture: more say no more, and make the file large.
const MAX_POINTS_PER_GESTURE: usize = 150;

/// A figure of a training.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingFigure {
    /// For the file's name: `confusion` or `feature_space`.
    pub name: &'static str,
    /// What it is.
    pub title: &'static str,
    /// How it is to be read.
    pub caption: String,
    /// To be put into a page: words and lines have the colour of the words around it.
    pub inline_svg: String,
    /// The SVG as a file of its own.
    pub svg: String,
}

/// The confusion of classes, `[asked][recognised]` in numbers of windows, if it is known, and the feature space.
///
/// # Errors
/// [`ChartError`].
pub fn training_figures(
    confusion_matrix: Option<(&[Gesture], &[Vec<usize>])>,
    space: &FeatureSpace,
) -> Result<Vec<TrainingFigure>, ChartError> {
    let charts = Charts::new()?;
    let figure = |name, title, caption: String, spec: ChartSpec| {
        let drawing = charts.draw(&spec)?;
        // A file says itself what it shows.
        let title_and_caption = format!("><title>{title}</title><desc>{caption}</desc>");
        let svg = charts.svg_and_png(&drawing)?.0.replacen('>', &title_and_caption, 1);
        Ok(TrainingFigure { name, title, caption, inline_svg: drawing, svg })
    };
    let mut figures = Vec::new();
    if let Some((classes, confusion)) = confusion_matrix {
        let windows: usize = confusion.iter().flatten().sum();
        figures.push(figure(
            "confusion",
            "Confusion",
            format!(
                "Share of the windows of each gesture that was asked for (rows) by what was recognised (columns), each repetition \
                 recognised after learning from the others; {windows} windows."
            ),
            confusion_spec(classes, confusion),
        )?);
    }
    figures.push(figure("feature_space", "Feature space", space_caption(space), space_spec(space))?);
    Ok(figures)
}

fn confusion_spec(classes: &[Gesture], confusion: &[Vec<usize>]) -> ChartSpec {
    let cell = |truth: &Gesture, row: &[usize], column: usize| {
        let share = row[column] as f64 / row.iter().sum::<usize>().max(1) as f64;
        let letter = if row[column] == 0 { String::new() } else { format!("{:.0} %", 100.0 * share) };
        json!({"x": classes[column], "y": truth, "value": share, "letter": letter})
    };
    let rows = classes.iter().zip(confusion).filter(|(_, row)| row.iter().any(|count| *count > 0));
    ChartSpec {
        kind: "confusion",
        rows: rows.flat_map(|(truth, row)| (0..classes.len()).map(move |k| cell(truth, row, k))).collect(),
        x: "recognised".into(),
        y: "asked".into(),
        order: classes.iter().map(ToString::to_string).collect(),
        axis_max: Some(1.0),
        ..ChartSpec::default()
    }
}

fn space_caption(space: &FeatureSpace) -> String {
    let [first, second] = space.explained_variance_ratio.map(|share| 100.0 * share);
    let (axes, of) = match space.axes {
        FeatureSpaceAxes::LinearDiscriminants => (
            "first two linear discriminants, in standard deviations within a gesture",
            "spread between gestures",
        ),
        FeatureSpaceAxes::PrincipalComponents => {
            ("first two principal components of standardised features", "variance")
        }
    };
    format!(
        "The windows of the training along the {axes}: {first:.0} % and {second:.0} % of the {of}. At most {MAX_POINTS_PER_GESTURE} windows of a \
         gesture are drawn. They are those that were learnt from: gestures lie further apart here than they will."
    )
}

fn space_spec(space: &FeatureSpace) -> ChartSpec {
    let mut parts: Vec<Gesture> = space.gestures.clone();
    parts.sort_unstable();
    parts.dedup();
    let mut rows = Vec::new();
    for part in &parts {
        let own: Vec<&[f64; 2]> =
            space.gestures.iter().zip(&space.points).filter(|(g, _)| *g == part).map(|(_, p)| p).collect();
        let step = own.len().div_ceil(MAX_POINTS_PER_GESTURE).max(1);
        rows.extend(own.iter().step_by(step).map(|[x, y]| json!({"x": x, "y": y, "part": part})));
    }
    let axis = |k: usize| match space.axes {
        FeatureSpaceAxes::LinearDiscriminants => format!("linear discriminant {}", k + 1),
        FeatureSpaceAxes::PrincipalComponents => format!("principal component {}", k + 1),
    };
    ChartSpec {
        kind: "cloud",
        rows,
        x: axis(0),
        y: axis(1),
        parts: parts.iter().map(ToString::to_string).collect(),
        ..ChartSpec::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::Command;

    #[test]
    fn both_figures_are_drawn_with_every_gesture_and_say_what_their_axes_are() {
        let gestures: Vec<Gesture> =
            [Command::HandClose, Command::HandOpen, Command::NoMotion].map(Gesture::from).into();
        let confusion = vec![vec![9, 1, 0], vec![0, 10, 0], vec![0, 0, 10]];
        let space = FeatureSpace {
            axes: FeatureSpaceAxes::LinearDiscriminants,
            explained_variance_ratio: [0.75, 0.25],
            gestures: (0..3000).map(|k| gestures[k % 3]).collect(),
            points: (0..3000).map(|k| [k as f64 % 3.0, (k as f64).sin()]).collect(),
        };
        let figures = training_figures(Some((&gestures, &confusion)), &space).expect("there is a font");
        let [first, second] = figures.as_slice() else { panic!("{} figures", figures.len()) };
        assert!(second.svg.contains(&format!("<desc>{}</desc>", second.caption)));
        assert!(first.svg.contains("90 %") && first.svg.contains("10 %") && first.svg.contains("100 %"));
        assert!(first.caption.contains("30 windows"));
        assert!(second.caption.contains("linear discriminants") && second.caption.contains("75 % and 25 %"));
        assert!(second.svg.contains("linear discriminant 2"));
        for gesture in &gestures {
            assert!(first.svg.contains(gesture.as_str()) && second.svg.contains(gesture.as_str()));
        }
        let dots = second.svg.matches("<path").count() + second.svg.matches("<circle").count();
        assert!((300..=600).contains(&dots), "{dots} dots");
        assert!(!second.svg.contains("currentColor") && second.inline_svg.contains("currentColor"));
    }
}

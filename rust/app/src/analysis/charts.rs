//! Figures by the charting library of the pages (Observable Plot), run here in a small script engine; PNG from the SVG.

use proact_bridge::FIGURES_SCRIPT;
use resvg::{tiny_skia, usvg};
use rquickjs::{CatchResultExt, Context, Function, Runtime};
use serde::Serialize;
use serde_json::Value;

/// More memory than this a script does not get, bytes.
const MAX_SCRIPT_MEMORY_BYTES: usize = 1 << 28;
/// Deep enough for the library's nested marks, bytes.
const SCRIPT_STACK_BYTES: usize = 4 << 20;
/// Dots of a PNG for each unit of the SVG: 288 an inch.
const PNG_PIXELS_PER_SVG_UNIT: f32 = 3.0;
/// Words and lines in a file, where nobody says what colour they have.
const DEFAULT_TEXT_COLOR: &str = "#1a1a1a";
const FONT: &str = "DejaVu Sans";

/// What to draw. The fields are those of `figures.ts`.
#[derive(Clone, Debug, Default, Serialize)]
pub(super) struct ChartSpec {
    pub(super) kind: &'static str,
    pub(super) rows: Vec<Value>,
    /// What is on the axes.
    pub(super) x: String,
    pub(super) y: String,
    /// Of what is on x.
    pub(super) order: Vec<String>,
    /// Of what has a colour.
    pub(super) parts: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[serde(rename = "most")]
    pub(super) axis_max: Option<f64>,
}

/// A figure that could not be drawn.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ChartError {
    /// The script failed.
    #[error("the figure cannot be drawn: {0}")]
    Script(String),
    /// The SVG is not one.
    #[error("the figure cannot be made a picture: {0}")]
    InvalidSvg(String),
    /// No font.
    #[error("there is no font to write figures with; install one: apt-get install fonts-dejavu-core")]
    NoFont,
}

/// Draws figures one after the other.
pub(super) struct Charts {
    // Before the runtime that it lives in.
    context: Context,
    _runtime: Runtime,
    fonts: usvg::Options<'static>,
}

impl Charts {
    /// Loads the charting library.
    pub(super) fn new() -> Result<Self, ChartError> {
        let failed = |error: rquickjs::Error| ChartError::Script(error.to_string());
        let runtime = Runtime::new().map_err(failed)?;
        runtime.set_memory_limit(MAX_SCRIPT_MEMORY_BYTES);
        runtime.set_max_stack_size(SCRIPT_STACK_BYTES);
        let context = Context::full(&runtime).map_err(failed)?;
        context.with(|ctx| {
            ctx.eval::<(), _>(FIGURES_SCRIPT)
                .catch(&ctx)
                .map_err(|error| ChartError::Script(error.to_string()))
        })?;
        let mut fonts = usvg::Options { font_family: FONT.to_owned(), ..usvg::Options::default() };
        fonts.fontdb_mut().load_system_fonts();
        fonts.fontdb_mut().set_sans_serif_family(FONT);
        if fonts.fontdb.is_empty() {
            return Err(ChartError::NoFont);
        }
        Ok(Self { context, _runtime: runtime, fonts })
    }

    /// The SVG of a figure for a page, whose words and lines have the colour of the words around it.
    pub(super) fn draw(&self, spec: &ChartSpec) -> Result<String, ChartError> {
        let spec = proact_types::to_json(spec).map_err(|error| ChartError::Script(error.to_string()))?;
        self.context.with(|ctx| {
            let draw: Function<'_> =
                ctx.globals().get("figure").map_err(|error| ChartError::Script(error.to_string()))?;
            draw.call((spec,)).catch(&ctx).map_err(|error| ChartError::Script(error.to_string()))
        })
    }

    /// The same as a file of its own, and as a PNG on white.
    pub(super) fn svg_and_png(&self, svg: &str) -> Result<(String, Vec<u8>), ChartError> {
        let svg = svg.replace("currentColor", DEFAULT_TEXT_COLOR);
        let failed = |error: &dyn std::fmt::Display| ChartError::InvalidSvg(error.to_string());
        let tree = usvg::Tree::from_str(&svg, &self.fonts).map_err(|error| failed(&error))?;
        let [width, height] = [tree.size().width(), tree.size().height()]
            .map(|side| (side * PNG_PIXELS_PER_SVG_UNIT).ceil() as u32);
        let mut picture = tiny_skia::Pixmap::new(width, height).ok_or_else(|| failed(&"it has no size"))?;
        picture.fill(tiny_skia::Color::WHITE);
        resvg::render(
            &tree,
            tiny_skia::Transform::from_scale(PNG_PIXELS_PER_SVG_UNIT, PNG_PIXELS_PER_SVG_UNIT),
            &mut picture.as_mut(),
        );
        let png = picture.encode_png().map_err(|error| failed(&error))?;
        Ok((svg, png))
    }
}

/// A curve of power over people, as SVG and PNG: of each pair of conditions and number of people the chance, 0 to 1.
///
/// # Errors
/// [`ChartError`].
pub fn power_curve(points: &[(usize, String, f64)]) -> Result<(String, Vec<u8>), ChartError> {
    let mut parts: Vec<String> = Vec::new();
    for (_, part, _) in points {
        if !parts.contains(part) {
            parts.push(part.clone());
        }
    }
    let rows =
        points.iter().map(|(people, part, share)| serde_json::json!({"x": people, "y": share, "part": part}));
    let spec = ChartSpec {
        kind: "curve",
        rows: rows.collect(),
        x: "people".into(),
        y: "chance to find a difference".into(),
        parts,
        axis_max: Some(1.0),
        ..ChartSpec::default()
    };
    let charts = Charts::new()?;
    charts.svg_and_png(&charts.draw(&spec)?)
}

/// How costs grow: lines of name, size and cost, on axes of equal ratios, as SVG and PNG. All numbers are above zero.
///
/// # Errors
/// [`ChartError`].
pub fn growth_curve(
    of: &str,
    cost: &str,
    points: &[(String, f64, f64)],
) -> Result<(String, Vec<u8>), ChartError> {
    let mut parts: Vec<String> = points.iter().map(|point| point.0.clone()).collect();
    parts.dedup();
    let rows =
        points.iter().map(|(part, size, cost)| serde_json::json!({"x": size, "y": cost, "part": part}));
    let spec = ChartSpec {
        kind: "growth",
        rows: rows.collect(),
        x: of.into(),
        y: cost.into(),
        parts,
        ..ChartSpec::default()
    };
    let charts = Charts::new()?;
    charts.svg_and_png(&charts.draw(&spec)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn spec() -> ChartSpec {
        ChartSpec {
            kind: "strip",
            rows: (0..12).map(|i| json!({"x": if i % 2 == 0 { "A" } else { "D" }, "y": i})).collect(),
            x: "method".into(),
            y: "blocks <on> target".into(),
            order: vec!["A".into(), "D".into()],
            ..ChartSpec::default()
        }
    }

    #[test]
    fn a_figure_is_drawn_the_same_each_time_and_its_words_are_letters() {
        let charts = Charts::new().unwrap();
        let svg = charts.draw(&spec()).unwrap();
        assert_eq!(svg, charts.draw(&spec()).unwrap());
        assert!(svg.contains("blocks &lt;on&gt; target") && svg.contains("currentColor"), "{svg}");
        let (file, png) = charts.svg_and_png(&svg).unwrap();
        assert!(!file.contains("currentColor") && png.starts_with(b"\x89PNG"));
        let other = ChartSpec { y: "another word".into(), ..spec() };
        assert_ne!(
            charts.svg_and_png(&charts.draw(&other).unwrap()).unwrap().1,
            png,
            "the words are in the picture"
        );
    }

    #[test]
    fn values_that_are_all_zero_stand_on_an_axis_from_zero_to_one() {
        let charts = Charts::new().unwrap();
        for (kind, x) in
            [("strip", json!("A")), ("bars", json!("A")), ("lines", json!(1)), ("curve", json!(1))]
        {
            let rows = vec![json!({"x": x, "y": 0, "value": 0, "part": "A"})];
            let spec = ChartSpec { kind, rows, parts: vec!["A".into()], order: vec!["A".into()], ..spec() };
            let svg = charts.draw(&spec).unwrap();
            // Without a length each tick is zero with as many digits as there are.
            assert!(!svg.contains(">0.0000") && svg.contains(">1.0<"), "{kind}: {svg}");
        }
    }

    #[test]
    fn what_cannot_be_drawn_is_an_error_and_the_next_one_is_drawn() {
        let charts = Charts::new().unwrap();
        assert!(matches!(charts.draw(&ChartSpec { kind: "none", ..spec() }), Err(ChartError::Script(_))));
        assert!(charts.draw(&spec()).is_ok());
        assert!(matches!(charts.svg_and_png("no picture"), Err(ChartError::InvalidSvg(_))));
    }
}

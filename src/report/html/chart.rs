//! Charts as data, so that the page and the SVG files draw the same, and their form for plotly.js.

use serde_json::{Value, json};

/// Colours that can be told apart on white and on black, also by the colour-blind (Okabe and Ito).
pub(super) const COLOURS: [&str; 6] = ["#e69f00", "#0072b2", "#009e73", "#cc79a7", "#56b4e9", "#888888"];

/// Pixels from one side of a bar to the other.
const BAR_WIDTH: u32 = 12;

/// An axis of a [`Chart`].
#[derive(Clone, Debug, Default)]
pub(super) struct Axis {
    pub(super) label: String,
    pub(super) logarithmic: bool,
    /// Names for the values 0, 1, 2, ...; numbers if empty.
    pub(super) names: Vec<String>,
}

/// How the points of a [`Series`] are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Style {
    Line,
    /// Each value holds until the next point; filled down to 0.
    Steps,
    Points,
    /// Bars from the left to x, at the height y.
    Bars,
}

/// Points that belong together.
#[derive(Clone, Debug)]
pub(super) struct Series {
    pub(super) name: String,
    /// An index of [`COLOURS`].
    pub(super) colour: usize,
    pub(super) style: Style,
    pub(super) points: Vec<[f64; 2]>,
    /// What is shown at each point when the mouse is there; the values if empty.
    pub(super) hover: Vec<String>,
}

/// A chart.
#[derive(Clone, Debug)]
pub(super) struct Chart {
    /// The name of its file and of its place in the page.
    pub(super) id: String,
    pub(super) title: String,
    pub(super) x: Axis,
    pub(super) y: Axis,
    pub(super) series: Vec<Series>,
}

/// The factor between the least and the largest of the positive values; 0 if there are none.
fn spanned(values: impl Iterator<Item = f64>) -> f64 {
    let positive = values.filter(|x| x.is_finite() && *x > 0.0);
    let (least, most) = positive.fold((f64::INFINITY, 0.0), |(least, most): (f64, f64), x| (x.min(least), x.max(most)));
    most / least
}

impl Axis {
    pub(super) fn linear(label: &str) -> Self {
        Self { label: label.into(), ..Self::default() }
    }

    /// Logarithmic where the positive values span more than that factor.
    pub(super) fn logarithmic_beyond(factor: f64, label: &str, values: impl Iterator<Item = f64>) -> Self {
        Self { label: label.into(), logarithmic: spanned(values) > factor, names: Vec::new() }
    }

    /// For `values` on it.
    fn for_plotly(&self, values: impl Iterator<Item = f64>) -> Value {
        let mut axis = json!({"title": {"text": self.label}, "automargin": true});
        if self.logarithmic {
            axis["type"] = json!("log");
            axis["tickformat"] = json!("~r");
            // Near and beyond a decade the ticks would be at all multiples of its powers; few of them are 1, 2, 5, 10, ...
            if spanned(values) > 6.0 {
                axis["nticks"] = json!(3);
            }
        } else if self.names.is_empty() {
            axis["type"] = json!("linear");
        } else {
            axis["tickvals"] = json!((0..self.names.len()).collect::<Vec<usize>>());
            axis["ticktext"] = json!(self.names);
        }
        axis
    }
}

impl Series {
    pub(super) fn new(name: impl Into<String>, colour: usize, style: Style, points: Vec<[f64; 2]>) -> Self {
        Self { name: name.into(), colour, style, points, hover: Vec::new() }
    }

    pub(super) fn colour(&self) -> &'static str {
        COLOURS[self.colour % COLOURS.len()]
    }

    /// As a trace whose bars start at `left`.
    fn for_plotly(&self, left: f64) -> Value {
        let [x, y]: [Vec<f64>; 2] = [0, 1].map(|axis| self.points.iter().map(|point| point[axis]).collect());
        let mut trace = json!({
            "type": "scatter", "name": self.name, "x": x, "y": y, "mode": "lines",
            "line": {"color": self.colour(), "width": 2}, "marker": {"color": self.colour(), "size": 7},
        });
        let mut hover = self.hover.clone();
        match self.style {
            Style::Line => {}
            Style::Points => trace["mode"] = json!("markers"),
            Style::Steps => {
                trace["line"]["shape"] = json!("hv");
                trace["fill"] = json!("tozeroy");
            }
            // The bundle of plotly.js in use has no bars: thick lines with a gap after each.
            Style::Bars => {
                trace["line"]["width"] = json!(BAR_WIDTH);
                trace["x"] = x.iter().flat_map(|&x| [json!(left), json!(x), Value::Null]).collect();
                trace["y"] = y.iter().flat_map(|&y| [json!(y), json!(y), Value::Null]).collect();
                hover = self.hover.iter().flat_map(|text| [text.clone(), text.clone(), String::new()]).collect();
            }
        }
        if !hover.is_empty() {
            trace["hovertext"] = json!(hover);
            trace["hovertemplate"] = json!("%{hovertext}<extra></extra>");
        }
        trace
    }
}

impl Chart {
    /// The figure that plotly.js draws, as JSON.
    pub(super) fn for_plotly(&self) -> String {
        let values =
            |axis: usize| self.series.iter().flat_map(move |one| one.points.iter().map(move |point| point[axis]));
        // What has bars on a logarithmic axis are ratios, which are all one at least.
        // Bars are of K, of which 1 is the least there is.
        let left = 1.0;
        json!({
            "data": self.series.iter().map(|series| series.for_plotly(left)).collect::<Vec<Value>>(),
            "layout": {
                "xaxis": self.x.for_plotly(values(0)), "yaxis": self.y.for_plotly(values(1)),
                "showlegend": true, "hovermode": "closest", "margin": {"l": 60, "r": 16, "t": 40, "b": 48},
            },
        })
        .to_string()
    }
}

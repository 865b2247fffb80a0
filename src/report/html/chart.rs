//! Charts as data, so that the page and the SVG files draw the same, and their form for plotly.js.

use plotly::common::{Fill, Line, LineShape, Marker, Mode, Orientation};
use plotly::layout::{Axis as PlotlyAxis, AxisType, Margin};
use plotly::{Bar, Layout, Plot, Scatter};

/// Colours that can be told apart on white and on black, also by the colour-blind (Okabe and Ito).
pub(super) const COLOURS: [&str; 6] = ["#e69f00", "#0072b2", "#009e73", "#cc79a7", "#56b4e9", "#888888"];

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
    fn for_plotly(&self, values: impl Iterator<Item = f64>) -> PlotlyAxis {
        let axis = PlotlyAxis::new().title(self.label.as_str()).auto_margin(true);
        match self {
            Self { logarithmic: true, .. } => {
                let axis = axis.type_(AxisType::Log).tick_format("~r");
                // Near and beyond a decade the ticks would be at all multiples of its powers; few of them are 1, 2, 5, 10, ...
                if spanned(values) > 6.0 { axis.n_ticks(3) } else { axis }
            }
            Self { names, .. } if names.is_empty() => axis.type_(AxisType::Linear),
            Self { names, .. } => {
                axis.tick_values((0..names.len()).map(|index| index as f64).collect()).tick_text(names.clone())
            }
        }
    }
}

impl Series {
    pub(super) fn new(name: impl Into<String>, colour: usize, style: Style, points: Vec<[f64; 2]>) -> Self {
        Self { name: name.into(), colour, style, points, hover: Vec::new() }
    }

    pub(super) fn colour(&self) -> &'static str {
        COLOURS[self.colour % COLOURS.len()]
    }

    fn for_plotly(&self) -> Box<dyn plotly::Trace> {
        const TEXT: &str = "%{hovertext}<extra></extra>";
        let [x, y]: [Vec<f64>; 2] = [0, 1].map(|axis| self.points.iter().map(|point| point[axis]).collect());
        if self.style == Style::Bars {
            let bar = Bar::new(x, y).orientation(Orientation::Horizontal).name(&self.name);
            let bar = bar.marker(Marker::new().color(self.colour())).hover_text_array(self.hover.clone());
            return bar.hover_template(TEXT);
        }
        let line = Line::new().color(self.colour()).width(2.0);
        let scatter = Scatter::new(x, y).name(&self.name).marker(Marker::new().color(self.colour()).size(7));
        let scatter = match self.style {
            Style::Points => scatter.mode(Mode::Markers),
            Style::Steps => scatter.mode(Mode::Lines).line(line.shape(LineShape::Hv)).fill(Fill::ToZeroY),
            Style::Line | Style::Bars => scatter.mode(Mode::Lines).line(line),
        };
        if self.hover.is_empty() {
            return scatter;
        }
        scatter.hover_text_array(self.hover.clone()).hover_template(TEXT)
    }
}

impl Chart {
    /// The figure that plotly.js draws, as JSON.
    pub(super) fn for_plotly(&self) -> String {
        let mut plot = Plot::new();
        self.series.iter().for_each(|series| plot.add_trace(series.for_plotly()));
        let values =
            |axis: usize| self.series.iter().flat_map(move |one| one.points.iter().map(move |point| point[axis]));
        let layout = Layout::new().x_axis(self.x.for_plotly(values(0))).y_axis(self.y.for_plotly(values(1)));
        plot.set_layout(layout.show_legend(true).margin(Margin::new().left(60).right(16).top(40).bottom(48)));
        plot.to_json()
    }
}

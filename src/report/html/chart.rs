//! Charts as data, so that the page and the SVG files draw the same, and their form for plotly.js.

use serde_json::{Value, json};

/// The colours of series in pictures and in the light theme of a page, `--series-0` and so on of page.css, which has others for the
/// dark one. All have a contrast of 3 to the page, and are told apart by the colour-blind.
pub(super) const COLOURS: [&str; 6] = ["#dd6718", "#3230bc", "#327138", "#b0668f", "#2898ea", "#444444"];

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
            // Near and beyond a decade the ticks would be at all multiples of its powers; few of them are 1, 2, 5, 10, ..., and one a
            // decade where there are many.
            let span = spanned(values);
            if span > 6.0 {
                axis["nticks"] = json!(span.log10().ceil().max(3.0));
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
            "line": {"width": 2}, "marker": {"size": 7},
            // The script of the page colours it by the theme.
            "meta": self.colour % COLOURS.len(),
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

#[cfg(test)]
mod tests {
    use super::*;

    /// The value of a property in a rule of page.css.
    fn property<'a>(rule: &'a str, name: &str) -> &'a str {
        let from = rule.find(&format!("{name}: ")).unwrap() + name.len() + 2;
        &rule[from..from + 7]
    }

    /// Red, green and blue, linear.
    fn linear(colour: &str) -> [f64; 3] {
        let part = |at: usize| f64::from(u8::from_str_radix(&colour[at..at + 2], 16).unwrap()) / 255.0;
        let linear = |x: f64| if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) };
        [1, 3, 5].map(|at| linear(part(at)))
    }

    /// WCAG 2.2.
    fn contrast(one: &str, other: &str) -> f64 {
        let luminance = |colour: &str| {
            let [red, green, blue] = linear(colour);
            0.2126 * red + 0.7152 * green + 0.0722 * blue + 0.05
        };
        let [one, other] = [one, other].map(luminance);
        one.max(other) / one.min(other)
    }

    /// CIE L*a*b* of what is seen of linear red, green and blue.
    fn lab(seen: [[f64; 3]; 3], colour: [f64; 3]) -> [f64; 3] {
        let times = |matrix: [[f64; 3]; 3], of: [f64; 3]| {
            matrix.map(|row| row.iter().zip(of).map(|(factor, part)| factor * part).sum::<f64>().clamp(0.0, 1.1))
        };
        let xyz =
            times([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]], times(seen, colour));
        let [x, y, z] = [xyz[0] / 0.95047, xyz[1], xyz[2] / 1.08883]
            .map(|t| if t > 0.008856 { t.cbrt() } else { 7.787 * t + 16.0 / 116.0 });
        [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
    }

    /// What is seen of linear colours with all cones, and with one kind missing: Machado, Oliveira and Fernandes 2009,
    /// doi 10.1109/TVCG.2009.113, at severity 1.
    const SEEN: [[[f64; 3]; 3]; 4] = [
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
    ];

    #[test]
    fn the_colours_of_both_themes_have_contrast_and_differ_for_the_colour_blind() {
        let mut rules = include_str!("page.css").lines().filter(|line| line.starts_with(":root"));
        let rules = [rules.next().unwrap(), rules.next().unwrap()];
        let themes = rules.map(|rule| {
            COLOURS
                .iter()
                .enumerate()
                .map(|(index, _)| property(rule, &format!("--series-{index}")))
                .collect::<Vec<_>>()
        });
        assert_eq!(themes[0], COLOURS);
        for (rule, colours) in rules.iter().zip(&themes) {
            let page = property(rule, "--page");
            // WCAG 2.2, 1.4.11 for graphics and 1.4.3 for text.
            assert!(colours.iter().all(|colour| contrast(colour, page) >= 3.0), "{colours:?}");
            for text in ["--text", "--dim", "--accent", "--warn"] {
                assert!(
                    ["--page", "--panel"]
                        .iter()
                        .all(|behind| contrast(property(rule, text), property(rule, behind)) >= 4.5)
                );
            }
            for seen in SEEN {
                for (index, one) in colours.iter().enumerate() {
                    for other in &colours[..index] {
                        let [one, other] = [one, other].map(|colour| lab(seen, linear(colour)));
                        let far = one.iter().zip(other).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
                        // Ten times what is just told apart.
                        assert!(far > 23.0, "{far}");
                    }
                }
            }
        }
    }
}

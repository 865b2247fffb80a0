//! The charts as SVG files, for papers.

use std::ops::Range;

use plotters::coord::Shift;
use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint};
use plotters::prelude::*;

use super::chart::{Axis, Chart, Series, Style};

/// Width and height in pixels.
const SIZE: (u32, u32) = (720, 420);

/// The chart as an SVG file's text, or why it cannot be drawn.
pub(super) fn svg(chart: &Chart) -> Result<String, String> {
    let mut text = String::new();
    draw(chart, SVGBackend::with_string(&mut text, SIZE).into_drawing_area()).map_err(|error| error.to_string())?;
    Ok(text)
}

/// An axis with ticks of our choice, in the coordinates that are drawn: the logarithms of those that are labelled, if it is logarithmic.
#[derive(Clone)]
struct Scale {
    logarithmic: bool,
    range: Range<f64>,
    ticks: Vec<f64>,
    names: Vec<String>,
}

impl Scale {
    /// `from`: a value that the axis shows whatever the others are, unless it is logarithmic.
    fn of(axis: &Axis, values: impl Iterator<Item = f64>, from: Option<f64>) -> Self {
        let logarithmic = axis.logarithmic;
        let drawn = values.map(|x| if logarithmic { x.ln() } else { x }).filter(|x| x.is_finite());
        let (mut least, mut most) =
            drawn.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), x| (x.min(least), x.max(most)));
        if let Some(from) = from.filter(|_| !logarithmic) {
            least = least.min(from);
        }
        if least > most {
            (least, most) = (0.0, 1.0);
        }
        let margin = if axis.names.is_empty() { 0.04 * (most - least).max(1e-9) } else { 0.5 };
        let low = if from == Some(least) && axis.names.is_empty() { least } else { least - margin };
        let range = low..most + margin;
        let ticks = match () {
            () if !axis.names.is_empty() => (0..axis.names.len()).map(|index| index as f64).collect(),
            () if logarithmic => logarithmic_ticks(&range),
            () => linear_ticks(&range),
        };
        Self { logarithmic, range, ticks, names: axis.names.clone() }
    }

    fn drawn(&self, x: f64) -> f64 {
        // Nothing below the axis, where the logarithm of 0 would be.
        let x = if self.logarithmic { x.ln() } else { x };
        x.max(self.range.start)
    }

    fn label(&self, x: f64) -> String {
        if !self.names.is_empty() {
            return self.names.get(x.round() as usize).cloned().unwrap_or_default();
        }
        let x = if self.logarithmic { x.exp() } else { x };
        // Ticks have two digits at most.
        if x != 0.0 && !(1e-3..1e5).contains(&x.abs()) {
            format!("{x:.0e}")
        } else {
            ((x * 1e6).round() / 1e6).to_string()
        }
    }
}

impl Ranged for Scale {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (from, to): (i32, i32)) -> i32 {
        let fraction = (value - self.range.start) / (self.range.end - self.range.start);
        from + (fraction * f64::from(to - from)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _hint: Hint) -> Vec<f64> {
        self.ticks.clone()
    }

    fn range(&self) -> Range<f64> {
        self.range.clone()
    }
}

/// Some five multiples of 1, 2 or 5 times a power of ten.
fn linear_ticks(range: &Range<f64>) -> Vec<f64> {
    let rough = (range.end - range.start) / 5.0;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|x| x * power).into_iter().find(|&step| step >= rough).unwrap_or(rough);
    let first = (range.start / step).ceil() as i64;
    (first..first + 12).map(|index| index as f64 * step).take_while(|&tick| tick <= range.end).collect()
}

/// Logarithms of round numbers; the closer the narrower the range is.
fn logarithmic_ticks(range: &Range<f64>) -> Vec<f64> {
    let decades = (range.end - range.start) / std::f64::consts::LN_10;
    let steps: &[f64] = match decades {
        d if d < 0.3 => {
            &[1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.7, 1.8, 1.9, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]
        }
        d if d < 1.2 => &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0],
        d if d < 3.0 => &[1.0, 2.0, 5.0],
        _ => &[1.0],
    };
    let powers = (range.start / std::f64::consts::LN_10).floor() as i32..=(range.end / std::f64::consts::LN_10) as i32;
    let values = powers.flat_map(|power| steps.iter().map(move |step| (step * 10f64.powi(power)).ln()));
    values.filter(|x| range.contains(x)).collect()
}

fn draw(chart: &Chart, area: DrawingArea<SVGBackend<'_>, Shift>) -> Result<(), Box<dyn std::error::Error>> {
    let along = |axis: usize| chart.series.iter().flat_map(move |s| s.points.iter().map(move |point| point[axis]));
    let has = |style: Style| chart.series.iter().any(|series| series.style == style);
    let (x, y) = (
        // Bars are of K, of which 1 is the least there is.
        Scale::of(&chart.x, along(0), has(Style::Bars).then_some(1.0)),
        Scale::of(&chart.y, along(1), (has(Style::Steps) && chart.y.names.is_empty()).then_some(0.0)),
    );
    area.fill(&WHITE)?;
    let longest = y.ticks.iter().map(|&tick| y.label(tick).chars().count()).max().unwrap_or(0) as u32;
    let mut context = ChartBuilder::on(&area)
        .margin(12)
        .caption(&chart.title, ("sans-serif", 18))
        .x_label_area_size(44)
        .y_label_area_size(40 + 7 * longest.max(4))
        .build_cartesian_2d(x.clone(), y.clone())?;
    context
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(BLACK.mix(0.12))
        .x_desc(&chart.x.label)
        .y_desc(&chart.y.label)
        .x_label_formatter(&|value| x.label(*value))
        .y_label_formatter(&|value| y.label(*value))
        .label_style(("sans-serif", 13))
        .draw()?;
    for series in &chart.series {
        let colour = rgb(series);
        let finite = |point: &&[f64; 2]| point.iter().all(|x| x.is_finite());
        let points = series.points.iter().filter(finite).map(|&[a, b]| (x.drawn(a), y.drawn(b)));
        let annotation = match series.style {
            Style::Points => context.draw_series(points.map(|point| Circle::new(point, 3, colour.filled())))?,
            Style::Bars => context.draw_series(
                points.map(|(a, b)| Rectangle::new([(x.range.start, b - 0.35), (a, b + 0.35)], colour.filled())),
            )?,
            Style::Line => context.draw_series(LineSeries::new(points, colour.stroke_width(2)))?,
            Style::Steps => {
                let points: Vec<(f64, f64)> = points.collect();
                let corners = points.windows(2).flat_map(|pair| [pair[0], (pair[1].0, pair[0].1)]);
                context.draw_series(LineSeries::new(corners.chain(points.last().copied()), colour.stroke_width(2)))?
            }
        };
        annotation
            .label(&series.name)
            .legend(move |(a, b)| Rectangle::new([(a, b - 4), (a + 14, b + 4)], colour.filled()));
    }
    context
        .configure_series_labels()
        .position(if has(Style::Bars) { SeriesLabelPosition::LowerRight } else { SeriesLabelPosition::UpperRight })
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK.mix(0.3))
        .label_font(("sans-serif", 13))
        .draw()?;
    area.present()?;
    Ok(())
}

fn rgb(series: &Series) -> RGBColor {
    let digits = u32::from_str_radix(&series.colour()[1..], 16).unwrap_or(0);
    let [_, red, green, blue] = digits.to_be_bytes();
    RGBColor(red, green, blue)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_range_has_a_few_round_ticks_within_it() {
        for (low, high) in [(0.0, 1e-3), (0.0, 7.2), (-3.0, 55.0), (0.0, 1e6)] {
            let ticks = linear_ticks(&(low..high));
            // The step is at least a fifth of the range and less than 2.5 times that.
            assert!(
                (2..=6).contains(&ticks.len()) && ticks.iter().all(|tick| (low..=high).contains(tick)),
                "{ticks:?}"
            );
        }
        for (low, high) in [(1.0f64, 1.9f64), (1.0, 6.0), (0.9, 100.0), (1.0, 1e7)] {
            let ticks = logarithmic_ticks(&(low.ln()..high.ln() + 1e-9));
            assert!((3..=19).contains(&ticks.len()), "{low} to {high}: {ticks:?}");
        }
    }

    #[test]
    fn charts_without_points_and_with_infinities_are_drawn() {
        let series = |points| Series::new("K", 0, Style::Line, points);
        for points in [vec![], vec![[1.0, f64::INFINITY]], vec![[1.0, 2.0], [2.0, f64::INFINITY], [3.0, 4.0]]] {
            for axis in [Axis::linear("x"), Axis { logarithmic: true, ..Axis::linear("x") }] {
                let (x, y, id, title) = (axis.clone(), axis, "a".into(), "a < b".into());
                let picture = svg(&Chart { id, title, x, y, series: vec![series(points.clone())] }).unwrap();
                assert!(
                    picture.starts_with("<svg") && picture.trim_end().ends_with("</svg>") && !picture.contains("NaN")
                );
                assert!(picture.contains("a &lt; b"));
            }
        }
    }
}

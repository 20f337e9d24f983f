//! The histograms as a picture.

use std::path::Path;
use std::time::Duration;

use mesa_hal::runner::{Histogram, Latency as Recorder};
use plotters::coord::Shift;
use plotters::prelude::*;

use super::measure::Measured;
use super::name;
use crate::context::Failure;
use crate::files;

/// Size of the picture of one pace, in pixels.
const SIZE: (u32, u32) = (800, 340);
/// Font of the axes, and its size in pixels.
const AXIS_FONT: (&str, u32) = ("sans-serif", 15);
/// Room right of the last number of the time axis, which is centred below its line, in pixels.
const RIGHT_MARGIN: u32 = 40;
/// Columns for each doubling of the time.
const COLUMNS: f64 = 4.0;
/// Room above the highest column for the legend, as a factor.
const HEADROOM: f64 = 300.0;
/// Range of times shown, in microseconds.
const SHOWN: [f64; 2] = [0.5, 4e6];

const LATE: RGBColor = RGBColor(31, 119, 180);
const USED: RGBColor = RGBColor(230, 126, 34);
const PERIOD: RGBColor = RGBColor(192, 57, 43);

/// Writes the picture of the histograms into a file.
pub fn draw(file: &Path, rate: u32, all: &[Measured]) -> Result<(), Failure> {
    let svg = svg(rate, all);
    let svg = svg.map_err(|error| failure(file, &error))?;
    files::write(file, svg.as_bytes())
}

/// Draws the histograms of each pace, one below the other.
pub fn svg(rate: u32, all: &[Measured]) -> Result<String, Box<dyn std::error::Error>> {
    let mut text = String::new();
    let size = (SIZE.0, SIZE.1 * all.len().max(1) as u32);
    let shown = Shown::of(rate, all);
    {
        let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
        area.fill(&WHITE)?;
        for (area, one) in area.split_evenly((all.len().max(1), 1)).iter().zip(all) {
            let title = format!(
                "{}, {} cycles at {rate} Hz, paced by the {}",
                one.board,
                one.cycles,
                name(one.recorder.pace())
            );
            chart(area, &title, &shown, &one.recorder)?;
        }
        area.present()?;
    }
    Ok(text)
}

/// The ranges of the axes, which all charts have in common: times in microseconds, and cycles.
struct Shown {
    period: f64,
    least: f64,
    longest: f64,
    most: f64,
}

impl Shown {
    fn of(rate: u32, all: &[Measured]) -> Self {
        let period = 1e6 / f64::from(rate);
        let histograms = all
            .iter()
            .flat_map(|one| [one.recorder.late(), one.recorder.used()]);
        let columns: Vec<Column> = histograms.flat_map(columns).collect();
        let columns = || columns.iter();
        Self {
            period,
            least: columns().map(|column| column.from).fold(period, f64::min),
            longest: columns().map(|column| column.to).fold(period, f64::max),
            most: columns().map(|column| column.count).fold(1.0, f64::max),
        }
    }
}

fn chart(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    title: &str,
    shown: &Shown,
    recorder: &Recorder,
) -> Result<(), Box<dyn std::error::Error>> {
    let mut chart = ChartBuilder::on(area)
        .caption(title, ("sans-serif", 18))
        .margin(10)
        .margin_right(RIGHT_MARGIN)
        .x_label_area_size(50)
        .y_label_area_size(80)
        .build_cartesian_2d(
            (shown.least * 0.8..shown.longest * 1.25).log_scale(),
            (0.7..shown.most * HEADROOM).log_scale(),
        )?;
    chart
        .configure_mesh()
        .label_style(AXIS_FONT)
        .axis_desc_style(AXIS_FONT)
        .x_desc("time in us")
        .y_desc("cycles")
        .x_label_formatter(&|time| format!("{time}"))
        .y_label_formatter(&|cycles| format!("{cycles:.0}"))
        .light_line_style(TRANSPARENT)
        .bold_line_style(BLACK.mix(0.15))
        .draw()?;
    let late = columns(recorder.late());
    bars(&mut chart, &late, LATE, "late: how late a cycle begins")?;
    let used = columns(recorder.used());
    let label = "used: how long after its planned begin it is over";
    bars(&mut chart, &used, USED, label)?;
    let line = [(shown.period, 0.7), (shown.period, shown.most * HEADROOM)];
    let end = chart.draw_series([PathElement::new(line, PERIOD.stroke_width(2))])?;
    end.label("the period")
        .legend(|(x, y)| PathElement::new([(x, y), (x + 10, y)], PERIOD.stroke_width(2)));
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .label_font(AXIS_FONT)
        .background_style(WHITE.filled())
        .border_style(BLACK.mix(0.3))
        .draw()?;
    Ok(())
}

/// A chart with logarithmic axes.
type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<LogCoord<f64>, LogCoord<f64>>>;

/// Draws the columns of a histogram.
fn bars(
    chart: &mut Chart<'_, '_>,
    columns: &[Column],
    colour: RGBColor,
    label: &str,
) -> Result<(), Box<dyn std::error::Error>> {
    let bars = columns.iter().map(|column| {
        let corners = [(column.from, 0.7), (column.to, column.count)];
        Rectangle::new(corners, colour.mix(0.5).filled())
    });
    let square = move |(x, y)| Rectangle::new([(x, y - 5), (x + 10, y + 5)], colour.filled());
    chart.draw_series(bars)?.label(label).legend(square);
    Ok(())
}

/// A bar of the picture, in microseconds.
struct Column {
    from: f64,
    to: f64,
    count: f64,
}

/// Columns that are not empty.
fn columns(histogram: &Histogram) -> Vec<Column> {
    let [least, most] = SHOWN;
    let count = ((most / least).log2() * COLUMNS) as u32;
    let begin = |n: u32| least * (f64::from(n) / COLUMNS).exp2();
    let edges = (0..count).map(|n| Duration::from_secs_f64(begin(n) * 1e-6));
    let edges: Vec<Duration> = edges.collect();
    let all = (0..count).zip(histogram.between(&edges));
    let columns = all.map(|(n, count)| Column {
        from: begin(n),
        to: begin(n + 1),
        count: count as f64,
    });
    columns.filter(|column| column.count > 0.0).collect()
}

fn failure(file: &Path, error: &dyn std::fmt::Display) -> Failure {
    Failure::refused(format_args!("{}: {error}", file.display()))
}

//! The histograms of all paces on one axis, and the verdicts below them, as a picture.

use std::path::Path;
use std::time::{Duration, SystemTime};

use mesa_hal::driver::Pace;
use mesa_hal::runner::{Histogram, RateJudgement};
use mesa_tools::Counted;
use plotters::prelude::*;

use super::measure::{Measured, name};
use super::report::LatencyReport;
use crate::ui::context::Failure;
use crate::ui::files;
use crate::ui::picture::{self, Area, GREEN, GREY, RED, SMALL, TRACES, YELLOW, failed, text, tick};
use crate::ui::stamp;

/// Sizes, in pixels.
const WIDTH: u32 = 1000;
const HEADER: u32 = 66;
const CHART: u32 = 400;
const LINE: u32 = 22;
const FOOTER: u32 = 16;
/// Room right of the last number of the time axis, which is centred below its line.
const RIGHT: u32 = 40;
/// Characters of a line below the chart.
const CHARACTERS: usize = 140;
/// Columns for each doubling of the time.
const COLUMNS: f64 = 4.0;
/// Lower end of the axis of cycles, below one cycle.
const BASE: f64 = 0.7;
/// Room above the highest column for the legend, as a factor.
const HEADROOM: f64 = 100.0;
/// Range of times shown, in microseconds.
const SHOWN: [f64; 2] = [0.5, 4e6];

/// Draws the picture into a file.
pub fn draw(file: &Path, report: &LatencyReport, all: &[Measured]) -> Result<(), Failure> {
    files::write(file, svg(report, all)?.as_bytes())
}

/// Draws the histograms and the verdicts, as SVG.
pub fn svg(report: &LatencyReport, all: &[Measured]) -> Result<String, Failure> {
    let lines = Line::all(report);
    let height = lines.iter().map(|line| line.texts.len() as u32 * LINE);
    let size = (WIDTH, HEADER + CHART + height.sum::<u32>() + FOOTER);
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        root.fill(&WHITE).map_err(failed)?;
        let (header, rest) = root.split_vertically(HEADER);
        let (area, below) = rest.split_vertically(CHART);
        let title = format!("{}: cycles at {} Hz", report.board, report.rate_hz);
        picture::write(&header, &title, (14, 10), text(20, BLACK))?;
        let made = format!(
            "{}, {}",
            stamp::computer(),
            stamp::on_paper(SystemTime::now())
        );
        picture::write(&header, &made, (14, 38), text(SMALL, GREY))?;
        chart(&area, report.rate_hz, all)?;
        Line::write(&lines, &below)?;
        root.present().map_err(failed)?;
    }
    Ok(svg)
}

/// A text below the chart, broken into lines.
struct Line {
    texts: Vec<String>,
    /// Judgement of a rate; `None` for the head of a pace.
    judgement: Option<RateJudgement>,
}

impl Line {
    fn all(report: &LatencyReport) -> Vec<Self> {
        let mut all = Vec::new();
        for run in &report.runs {
            let cycles = Counted(run.cycles, "cycle");
            let packets = run.packets.loss();
            let head = format!("paced by the {}: {cycles}, {packets}", run.pace);
            all.push(Self::new(&head, None));
            for judged in &run.verdicts {
                let (rate, holds, reason) = (judged.rate_hz, judged.holds, &judged.reason);
                let line = format!("{rate} Hz: {holds}: {reason}");
                all.push(Self::new(&line, Some(holds)));
            }
        }
        all
    }

    fn new(line: &str, judgement: Option<RateJudgement>) -> Self {
        let texts = picture::lines(line, CHARACTERS);
        Self { texts, judgement }
    }

    fn write(all: &[Self], area: &Area<'_>) -> Result<(), Failure> {
        let mut y = 0;
        for Self { texts, judgement } in all {
            if let Some(judgement) = judgement {
                let colour = match judgement {
                    RateJudgement::Yes => GREEN,
                    RateJudgement::Almost => YELLOW,
                    RateJudgement::No => RED,
                };
                let corners = [(24, y - 1), (36, y + 11)];
                area.draw(&Rectangle::new(corners, colour.filled()))
                    .map_err(failed)?;
            }
            let x = if judgement.is_some() { 46 } else { 14 };
            for line in texts {
                picture::write(area, line, (x, y), text(SMALL, BLACK))?;
                y += LINE as i32;
            }
        }
        Ok(())
    }
}

/// A histogram and its look.
struct Series {
    label: String,
    colour: RGBColor,
    /// The time used is filled, the lateness is a line.
    is_filled: bool,
    columns: Vec<Column>,
}

impl Series {
    fn all(all: &[Measured]) -> Vec<Self> {
        let series = all.iter().flat_map(|one| {
            let pace = one.recorder.pace();
            let label = |what: &str| format!("paced by the {}: {what}", name(pace));
            let (used, late) = match pace {
                Pace::Host => (TRACES[0], RGBColor(10, 60, 110)),
                Pace::Board => (RGBColor(240, 150, 50), RGBColor(150, 60, 0)),
            };
            [
                Self {
                    label: label("time until a cycle is over"),
                    colour: used,
                    is_filled: true,
                    columns: columns(one.recorder.used()),
                },
                Self {
                    label: label("lateness of its begin"),
                    colour: late,
                    is_filled: false,
                    columns: columns(one.recorder.late()),
                },
            ]
        });
        let mut series: Vec<Self> = series.collect();
        // Lines over areas.
        series.sort_by_key(|one| !one.is_filled);
        series
    }
}

fn chart(area: &Area<'_>, rate: u32, all: &[Measured]) -> Result<(), Failure> {
    let period = 1e6 / f64::from(rate);
    let series = Series::all(all);
    let shown = || series.iter().flat_map(|one| &one.columns);
    let least = shown().map(|column| column.from).fold(period, f64::min);
    let longest = shown().map(|column| column.to).fold(period, f64::max);
    let most = shown().map(|column| column.count).fold(1.0, f64::max);
    let top = most * HEADROOM;
    let mut chart = ChartBuilder::on(area)
        .margin(10)
        .margin_right(RIGHT)
        .x_label_area_size(50)
        .y_label_area_size(80)
        .build_cartesian_2d(
            (least * 0.8..longest * 1.25).log_scale(),
            (BASE..top).log_scale(),
        )
        .map_err(failed)?;
    chart
        .configure_mesh()
        .label_style(text(SMALL, BLACK))
        .axis_desc_style(text(SMALL, GREY))
        .x_desc("time in us")
        .y_desc("cycles")
        .x_label_formatter(&|time| tick(*time))
        .y_label_formatter(&|cycles| tick(*cycles))
        .axis_style(BLACK.mix(0.4))
        .light_line_style(TRANSPARENT)
        .bold_line_style(BLACK.mix(0.12))
        .draw()
        .map_err(failed)?;
    for one in &series {
        draw_series(&mut chart, one)?;
    }
    let line = [(period, BASE), (period, top)];
    let end = PathElement::new(line, RED.stroke_width(2));
    let end = chart.draw_series([end]).map_err(failed)?;
    end.label("the period")
        .legend(|(x, y)| PathElement::new([(x, y), (x + 12, y)], RED.stroke_width(2)));
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperLeft)
        .margin(8)
        .label_font(text(SMALL, BLACK))
        .background_style(WHITE.mix(0.85).filled())
        .border_style(BLACK.mix(0.3))
        .draw()
        .map_err(failed)
}

/// A chart with logarithmic axes.
type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<LogCoord<f64>, LogCoord<f64>>>;

/// Draws the outline of a histogram, filled or not.
fn draw_series(chart: &mut Chart<'_, '_>, series: &Series) -> Result<(), Failure> {
    let colour = series.colour;
    if series.is_filled {
        let bars = series.columns.iter().map(|column| {
            let corners = [(column.from, BASE), (column.to, column.count)];
            Rectangle::new(corners, colour.mix(0.3).filled())
        });
        chart.draw_series(bars).map_err(failed)?;
    }
    let width = if series.is_filled { 1 } else { 2 };
    let outlines = outlines(&series.columns);
    let lines = outlines
        .into_iter()
        .map(|line| PathElement::new(line, colour.stroke_width(width)));
    let drawn = chart.draw_series(lines).map_err(failed)?;
    let is_filled = series.is_filled;
    drawn.label(&series.label).legend(move |(x, y)| {
        let (height, fill) = if is_filled {
            (5, colour.mix(0.5).filled())
        } else {
            (1, colour.filled())
        };
        Rectangle::new([(x, y - height), (x + 12, y + height)], fill)
    });
    Ok(())
}

/// The outlines of columns that follow each other.
fn outlines(columns: &[Column]) -> Vec<Vec<(f64, f64)>> {
    let mut outlines: Vec<Vec<(f64, f64)>> = Vec::new();
    let mut end = None;
    for column in columns {
        let is_next = end.is_some_and(|end: f64| (end / column.from - 1.0).abs() < 1e-9);
        match outlines.last_mut().filter(|_| is_next) {
            Some(line) => {
                line.pop();
            }
            None => outlines.push(vec![(column.from, BASE)]),
        }
        if let Some(line) = outlines.last_mut() {
            line.extend([
                (column.from, column.count),
                (column.to, column.count),
                (column.to, BASE),
            ]);
        }
        end = Some(column.to);
    }
    outlines
}

/// A column of the picture, in microseconds.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_side_by_side_have_one_outline() {
        let column = |from, to, count| Column { from, to, count };
        let columns = [
            column(1.0, 2.0, 5.0),
            column(2.0, 4.0, 9.0),
            column(8.0, 16.0, 1.0),
        ];
        let found = outlines(&columns);
        let first = vec![
            (1.0, BASE),
            (1.0, 5.0),
            (2.0, 5.0),
            (2.0, 9.0),
            (4.0, 9.0),
            (4.0, BASE),
        ];
        let second = vec![(8.0, BASE), (8.0, 1.0), (16.0, 1.0), (16.0, BASE)];
        assert_eq!(found, [first, second]);
    }
}

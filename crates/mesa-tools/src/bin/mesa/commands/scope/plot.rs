//! The picture of a recording: a panel for each number, and below them a line for each bit.

use std::ops::Range;

use mesa_hal::hal::{AnyValue, HalType, PinInfo};
use plotters::prelude::*;

use super::table::times;
use super::{Recording, TriggerMark};
use crate::ui::context::Failure;
use crate::ui::picture::{self, Area, GREY, RED, SMALL, TRACES, failed, text, tick};

/// Sizes, in pixels.
const WIDTH: u32 = 1000;
const HEADER: u32 = 66;
const PANEL: u32 = 160;
const ROW: u32 = 44;
const AXIS: u32 = 46;
/// Room for the numbers of the axes, and right of the last number of the time axis.
const LEFT: u32 = 80;
const RIGHT: u32 = 30;
/// Columns of the picture; more points show nothing more.
const COLUMNS: usize = 1000;

/// A pin's values in the unit of the time axis; cycles without a valid value are gaps.
struct Trace<'a> {
    info: &'a PinInfo,
    name: String,
    colour: RGBColor,
    parts: Vec<Vec<(f64, f64)>>,
    /// Level of the trigger, for its pin.
    level: Option<f64>,
}

/// The time axis.
struct Axis {
    first: f64,
    last: f64,
    unit: &'static str,
}

pub fn draw(recording: &Recording) -> Result<String, Failure> {
    let axis = Axis::of(recording);
    let traces = Trace::all(recording, &axis);
    let (bits, numbers): (Vec<_>, Vec<_>) = traces
        .iter()
        .partition(|trace| trace.info.hal_type == HalType::Bit);
    let panels = numbers.len() as u32 * PANEL + bits.len() as u32 * ROW;
    let mut svg = String::new();
    {
        let size = (WIDTH, HEADER + panels + AXIS);
        let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        root.fill(&WHITE).map_err(failed)?;
        let (header, mut rest) = root.split_vertically(HEADER);
        draw_header(&header, recording)?;
        for (number, trace) in numbers.iter().enumerate() {
            let is_last = bits.is_empty() && number + 1 == numbers.len();
            let height = PANEL + if is_last { AXIS } else { 0 };
            let (panel, below) = rest.split_vertically(height);
            draw_number(&panel, trace, &axis, is_last)?;
            rest = below;
        }
        if !bits.is_empty() {
            draw_bits(&rest, &bits, &axis)?;
        }
        root.present().map_err(failed)?;
    }
    Ok(svg)
}

impl Axis {
    fn of(recording: &Recording) -> Self {
        let mut all = times(&recording.scope);
        let first = all.next().unwrap_or(0.0);
        let last = all.last().unwrap_or(first).max(first + 1e-6);
        let (unit, factor) = match last - first {
            ..0.002 => ("us", 1e6),
            0.002..2.0 => ("ms", 1e3),
            _ => ("s", 1.0),
        };
        Self {
            first: first * factor,
            last: last * factor,
            unit,
        }
    }

    fn factor(&self) -> f64 {
        match self.unit {
            "us" => 1e6,
            "ms" => 1e3,
            _ => 1.0,
        }
    }
}

impl<'a> Trace<'a> {
    fn all(recording: &'a Recording, axis: &Axis) -> Vec<Self> {
        let Recording {
            board,
            infos,
            scope,
            trigger,
        } = recording;
        let times: Vec<f64> = times(scope).map(|time| time * axis.factor()).collect();
        let colours = TRACES.iter().cycle();
        let traces = infos.iter().zip(colours).enumerate();
        let traces = traces.map(|(number, (info, &colour))| {
            let values = scope.rows().map(|row| row.values().nth(number).flatten());
            let values: Vec<_> = values.map(|value| value.map(AnyValue::as_f64)).collect();
            Self {
                info,
                name: label(board, info),
                colour,
                parts: parts(times.iter().copied().zip(values)),
                level: (info.name == trigger.pin).then_some(trigger.level),
            }
        });
        traces.collect()
    }

    fn values(&self) -> impl Iterator<Item = f64> + '_ {
        let points = self.parts.iter().flatten().map(|(_, value)| *value);
        points.chain(self.level)
    }
}

/// Name of a trace: the pin without its board, its unit, its terminal.
fn label(board: &str, info: &PinInfo) -> String {
    let name = info.name.strip_prefix(board);
    let name = name.and_then(|name| name.strip_prefix('.'));
    let mut label = name.unwrap_or(&info.name).to_owned();
    if !info.unit.is_empty() {
        label.extend([" [", info.unit.as_str(), "]"]);
    }
    // A counter has several terminals.
    let terminal = &info.place.terminal;
    if !terminal.is_empty() && !terminal.contains(',') {
        label.extend([" (", terminal.as_str(), ")"]);
    }
    label
}

/// The values between two gaps each, with no more points than the picture shows: of those in a
/// column the first, the least, the greatest and the last.
fn parts(values: impl ExactSizeIterator<Item = (f64, Option<f64>)>) -> Vec<Vec<(f64, f64)>> {
    let column = values.len().div_ceil(COLUMNS).max(1);
    let mut parts: Vec<Vec<(f64, f64)>> = vec![Vec::new()];
    for (time, value) in values {
        match (value, parts.last_mut()) {
            (Some(value), Some(part)) => part.push((time, value)),
            (None, Some(part)) if !part.is_empty() => parts.push(Vec::new()),
            _ => {}
        }
    }
    let thinned = parts.into_iter().filter(|part| !part.is_empty());
    thinned.map(|part| thin(&part, column)).collect()
}

fn thin(part: &[(f64, f64)], column: usize) -> Vec<(f64, f64)> {
    if column < 5 {
        return part.to_vec();
    }
    let columns = part.chunks(column).flat_map(|points| {
        let by_value = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        let ends = [points.first(), points.last()];
        let least = points.iter().min_by(by_value);
        let most = points.iter().max_by(by_value);
        let all = ends.into_iter().chain([least, most]).flatten();
        let mut all: Vec<(f64, f64)> = all.copied().collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        all.dedup();
        all
    });
    columns.collect()
}

fn draw_header(area: &Area<'_>, recording: &Recording) -> Result<(), Failure> {
    let Recording {
        board,
        scope,
        trigger,
        ..
    } = recording;
    let title = format!("{board}: {} cycles", scope.rows().count());
    picture::write(area, &title, (14, 10), text(20, BLACK))?;
    let TriggerMark { pin, .. } = trigger;
    let name = pin.strip_prefix(&format!("{board}.")).unwrap_or(pin);
    let trigger = trigger.to_string().replace(pin, name);
    let line = format!("trigger: {trigger}");
    picture::write(area, &line, (14, 38), text(SMALL, RED))
}

/// Draws the panel of a number.
fn draw_number(
    panel: &Area<'_>,
    trace: &Trace<'_>,
    axis: &Axis,
    has_times: bool,
) -> Result<(), Failure> {
    let least = trace.values().fold(f64::INFINITY, f64::min);
    let most = trace.values().fold(f64::NEG_INFINITY, f64::max);
    let (least, most) = if least <= most {
        (least, most)
    } else {
        (0.0, 1.0)
    };
    let span = match most - least {
        0.0 => most.abs().max(1.0) * 0.5,
        span => span,
    };
    // Above the trace is room for its name.
    let (bottom, top) = (least - span * 0.1, most + span * 0.3);
    let mut chart = ChartBuilder::on(panel)
        .margin_top(4)
        .margin_bottom(4)
        .margin_right(RIGHT)
        .x_label_area_size(if has_times { AXIS } else { 0 })
        .y_label_area_size(LEFT)
        .build_cartesian_2d(axis.first..axis.last, bottom..top)
        .map_err(failed)?;
    mesh(&mut chart, axis, has_times, 5)?;
    if let Some(level) = trace.level {
        let line = [(axis.first, level), (axis.last, level)];
        let level = PathElement::new(line.to_vec(), RED.mix(0.5));
        chart.draw_series([level]).map_err(failed)?;
    }
    for part in &trace.parts {
        let line = LineSeries::new(part.iter().copied(), trace.colour.stroke_width(2));
        chart.draw_series(line).map_err(failed)?;
    }
    mark(&mut chart, bottom..top)?;
    name(&mut chart, trace, (axis.first, top))
}

/// Draws a line for each bit.
fn draw_bits(area: &Area<'_>, bits: &[&Trace<'_>], axis: &Axis) -> Result<(), Failure> {
    /// Heights in a row.
    const LOW: f64 = 0.1;
    const HIGH: f64 = 0.55;
    let rows = bits.len() as f64;
    let mut chart = ChartBuilder::on(area)
        .margin_right(RIGHT)
        .x_label_area_size(AXIS)
        .y_label_area_size(LEFT)
        .build_cartesian_2d(axis.first..axis.last, 0.0..rows)
        .map_err(failed)?;
    mesh(&mut chart, axis, true, 0)?;
    for (number, trace) in bits.iter().enumerate() {
        let bottom = rows - 1.0 - number as f64;
        let height = |value: f64| bottom + if value > 0.5 { HIGH } else { LOW };
        for part in &trace.parts {
            let spans = part.windows(2).filter_map(|pair| match pair {
                [(from, value), (to, _)] if *value > 0.5 => Some((*from, *to)),
                _ => None,
            });
            let fill = trace.colour.mix(0.2).filled();
            let on = merged(spans).into_iter().map(|(from, to)| {
                Rectangle::new([(from, bottom + LOW), (to, bottom + HIGH)], fill)
            });
            chart.draw_series(on).map_err(failed)?;
            let line = steps(part).into_iter();
            let line = line.map(|(time, value)| (time, height(value)));
            let line = LineSeries::new(line, trace.colour.stroke_width(2));
            chart.draw_series(line).map_err(failed)?;
        }
        name(&mut chart, trace, (axis.first, bottom + 1.0))?;
    }
    mark(&mut chart, 0.0..rows)
}

/// Joins spans that follow each other.
fn merged(spans: impl Iterator<Item = (f64, f64)>) -> Vec<(f64, f64)> {
    let mut merged: Vec<(f64, f64)> = Vec::new();
    for (from, to) in spans {
        match merged.last_mut() {
            Some((_, end)) if *end >= from => *end = to,
            _ => merged.push((from, to)),
        }
    }
    merged
}

/// The corners of a line that changes at once, and the two ends.
fn steps(part: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut steps: Vec<(f64, f64)> = part.first().copied().into_iter().collect();
    for pair in part.windows(2) {
        if let [(_, before), (time, value)] = *pair
            && before != value
        {
            steps.extend([(time, before), (time, value)]);
        }
    }
    steps.extend(part.last());
    steps
}

type Chart<'a, 'b> = ChartContext<
    'a,
    SVGBackend<'b>,
    Cartesian2d<plotters::coord::types::RangedCoordf64, plotters::coord::types::RangedCoordf64>,
>;

fn mesh(
    chart: &mut Chart<'_, '_>,
    axis: &Axis,
    has_times: bool,
    values: usize,
) -> Result<(), Failure> {
    let times = format!("time since the trigger, {}", axis.unit);
    let x_labels = |time: &f64| tick(*time);
    let y_labels = |value: &f64| tick(*value);
    let mut mesh = chart.configure_mesh();
    mesh.label_style(text(SMALL, BLACK))
        .axis_desc_style(text(SMALL, GREY))
        .axis_style(BLACK.mix(0.4))
        .light_line_style(TRANSPARENT)
        .bold_line_style(BLACK.mix(0.12))
        .x_labels(12)
        .y_labels(values)
        .x_label_formatter(&x_labels)
        .y_label_formatter(&y_labels);
    if has_times {
        mesh.x_desc(&times);
    }
    if values == 0 {
        mesh.disable_y_mesh().disable_y_axis();
    }
    mesh.draw().map_err(failed)
}

/// Marks the time of the trigger by a line with a point at its upper end.
fn mark(chart: &mut Chart<'_, '_>, height: Range<f64>) -> Result<(), Failure> {
    let line = vec![(0.0, height.start), (0.0, height.end)];
    let line = PathElement::new(line, RED.stroke_width(1));
    chart.draw_series([line]).map_err(failed)?;
    let point = TriangleMarker::new((0.0, height.end), -6, RED.filled());
    chart.draw_series([point]).map_err(failed)?;
    Ok(())
}

/// Writes the name of a trace below and right of a point.
fn name(chart: &mut Chart<'_, '_>, trace: &Trace<'_>, at: (f64, f64)) -> Result<(), Failure> {
    let style = text(SMALL, trace.colour);
    let name = EmptyElement::at(at) + Text::new(trace.name.clone(), (8, 3), style);
    chart.draw_series([name]).map_err(failed)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_stay_gaps_and_peaks_stay_peaks() {
        let values = [Some(1.0), Some(2.0), None, None, Some(3.0)];
        let values = values.into_iter().enumerate();
        let values: Vec<_> = values.map(|(at, value)| (at as f64, value)).collect();
        let found = parts(values.into_iter());
        assert_eq!(found, [vec![(0.0, 1.0), (1.0, 2.0)], vec![(4.0, 3.0)]]);

        let mut values = vec![(0.0, Some(0.0)); 100_000];
        for (number, value) in values.iter_mut().enumerate() {
            value.0 = number as f64;
        }
        values[54_321].1 = Some(9.0);
        values[77_777].1 = Some(-9.0);
        let found = parts(values.into_iter());
        assert!(found[0].len() <= 4 * COLUMNS, "{}", found[0].len());
        assert!(found[0].contains(&(54_321.0, 9.0)) && found[0].contains(&(77_777.0, -9.0)));
        assert_eq!(
            (found[0][0].0, found[0][found[0].len() - 1].0),
            (0.0, 99_999.0)
        );
    }

    #[test]
    fn bit_has_vertical_edges_and_is_filled_while_it_is_on() {
        let part = [(0.0, 0.0), (1.0, 1.0), (2.0, 1.0), (3.0, 0.0)];
        let corners = [
            (0.0, 0.0),
            (1.0, 0.0),
            (1.0, 1.0),
            (3.0, 1.0),
            (3.0, 0.0),
            (3.0, 0.0),
        ];
        assert_eq!(steps(&part), corners);
        let spans = [(1.0, 2.0), (2.0, 3.0), (5.0, 6.0)];
        assert_eq!(merged(spans.into_iter()), [(1.0, 3.0), (5.0, 6.0)]);
    }
}

//! The picture of a recording: one panel for each pin.

use mesa_hal::hal::PinInfo;
use mesa_hal::runner::Scope;
use plotters::prelude::*;

use super::times;
use crate::context::Failure;

const WIDTH: u32 = 1000;
const PANEL: u32 = 160;
/// Maximum number of points in a panel; more points than the picture has columns show nothing more.
const POINTS: usize = 10_000;

pub fn draw(infos: &[PinInfo], scope: &Scope) -> Result<String, Failure> {
    let mut text = String::new();
    let size = (WIDTH, PANEL * infos.len().max(1) as u32);
    {
        let root = SVGBackend::with_string(&mut text, size).into_drawing_area();
        root.fill(&WHITE).map_err(failed)?;
        let panels = root.split_evenly((infos.len().max(1), 1));
        for ((number, info), panel) in infos.iter().enumerate().zip(&panels) {
            draw_panel(panel, info, &points(scope, number))?;
        }
        root.present().map_err(failed)?;
    }
    Ok(text)
}

/// Milliseconds since the trigger, and values; those that were not valid are left out.
fn points(scope: &Scope, number: usize) -> Vec<(f64, f64)> {
    let step = scope.rows().count() / POINTS + 1;
    let rows = times(scope).zip(scope.rows()).step_by(step);
    let points = rows.filter_map(|(seconds, row)| {
        let value = row.values().nth(number).flatten()?;
        Some((seconds * 1e3, value.as_f64()))
    });
    points.collect()
}

fn draw_panel(
    panel: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>,
    info: &PinInfo,
    points: &[(f64, f64)],
) -> Result<(), Failure> {
    let ends = |values: &mut dyn Iterator<Item = f64>| {
        let (least, most) = values.fold((f64::MAX, f64::MIN), |(least, most), value| {
            (least.min(value), most.max(value))
        });
        if least > most {
            (0.0, 1.0)
        } else {
            (least, most)
        }
    };
    let (first, last) = ends(&mut points.iter().map(|point| point.0));
    let (least, most) = ends(&mut points.iter().map(|point| point.1));
    let margin = ((most - least) * 0.1).max(0.1);
    let (bottom, top) = (least - margin, most + margin);
    let caption = format!("{} {}", info.name, info.unit);
    let mut chart = ChartBuilder::on(panel)
        .caption(caption.trim_end(), ("sans-serif", 14))
        .margin(6)
        .x_label_area_size(24)
        .y_label_area_size(70)
        .build_cartesian_2d(first..last.max(first + 1e-3), bottom..top)
        .map_err(failed)?;
    let mut mesh = chart.configure_mesh();
    mesh.x_desc("ms").y_labels(4).draw().map_err(failed)?;
    let trigger = LineSeries::new([(0.0, bottom), (0.0, top)], &RED);
    chart.draw_series(trigger).map_err(failed)?;
    let line = LineSeries::new(points.iter().copied(), &BLUE);
    chart.draw_series(line).map_err(failed)?;
    Ok(())
}

fn failed(error: impl std::fmt::Display) -> Failure {
    Failure::refused(format_args!("the picture: {error}"))
}

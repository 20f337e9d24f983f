//! The axes of a description: servo and stepper motors.

use mesa_hal_sim::{Motor, MotorConfig, MotorError, Stepper, StepperConfig};
use serde::Deserialize;
use toml::Spanned;

use super::check::Lines;
use crate::machine::boards::Board;
use crate::machine::description::{Axis, Mover};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisTable {
    name: Spanned<String>,
    output: Option<Spanned<i64>>,
    stepgen: Option<Spanned<i64>>,
    encoder: Option<Spanned<i64>>,
    max_speed: Option<Spanned<f64>>,
    full_scale: Option<Spanned<f64>>,
    time_constant: Option<Spanned<f64>>,
    dead_band: Option<Spanned<f64>>,
    counts_per_unit: Option<Spanned<f64>>,
    counts_per_index: Option<u32>,
    inertia: Option<Spanned<f64>>,
    max_force: Option<Spanned<f64>>,
    friction: Option<Spanned<f64>>,
    stops: Option<Spanned<[f64; 2]>>,
    position: Option<Spanned<f64>>,
    steps_per_unit: Option<Spanned<f64>>,
    max_acceleration: Option<Spanned<f64>>,
    start_speed: Option<Spanned<f64>>,
    min_pulse: Option<Spanned<u32>>,
    min_space: Option<Spanned<u32>>,
    dir_setup: Option<Spanned<u32>>,
    dir_hold: Option<Spanned<u32>>,
}

/// The axes of a board.
pub fn axes(lines: &Lines<'_>, tables: &[AxisTable], board: &Board) -> Result<Vec<Axis>, String> {
    let mut axes: Vec<Axis> = Vec::new();
    for (number, table) in tables.iter().enumerate() {
        let names = axes.iter().map(|axis| axis.name.as_str());
        let name = lines.name(&table.name, "axis.name", names)?;
        let mover = match &table.stepgen {
            Some(generator) => stepper(lines, table, generator, board)?,
            None => servo(lines, table, number, board)?,
        };
        let is_taken = |other: &&Axis| have_a_place_in_common(&other.mover, &mover);
        if let Some(other) = axes.iter().find(is_taken) {
            let reason = format!("{} belongs to axis {} already", places(&mover), other.name);
            return Err(lines.wrong(&table.name, "axis.name", &reason));
        }
        axes.push(Axis { name, mover });
    }
    Ok(axes)
}

/// True if two motors have the same output, generator or encoder.
fn have_a_place_in_common(one: &Mover, other: &Mover) -> bool {
    let driven = match (one, other) {
        (Mover::Servo { output: one, .. }, Mover::Servo { output: other, .. }) => one == other,
        (
            Mover::Stepper { generator: one, .. },
            Mover::Stepper {
                generator: other, ..
            },
        ) => one == other,
        _ => false,
    };
    driven || (one.encoder().is_some() && one.encoder() == other.encoder())
}

/// The output or generator, and the encoder, of a motor.
fn places(mover: &Mover) -> String {
    match mover {
        Mover::Servo {
            output, encoder, ..
        } => format!("output {output} or encoder {encoder}"),
        Mover::Stepper {
            generator,
            encoder: Some(encoder),
            ..
        } => format!("step generator {generator} or encoder {encoder}"),
        Mover::Stepper { generator, .. } => format!("step generator {generator}"),
    }
}

/// A number from 0 to `count` - 1.
fn place(
    lines: &Lines<'_>,
    value: &Spanned<i64>,
    key: &str,
    count: usize,
) -> Result<usize, String> {
    let index = usize::try_from(*value.get_ref()).ok();
    let index = index.filter(|&index| index < count);
    index.ok_or_else(|| {
        let allowed = match count {
            0 => "this board has none".to_owned(),
            _ => format!("allowed are 0 to {}", count - 1),
        };
        lines.wrong(value, key, &allowed)
    })
}

/// Refuses a key that the other kind of motor has.
fn refused<T>(
    lines: &Lines<'_>,
    value: Option<&Spanned<T>>,
    key: &str,
    why: &str,
) -> Result<(), String> {
    value.map_or(Ok(()), |value| {
        Err(lines.wrong(value, &format!("axis.{key}"), why))
    })
}

/// A motor on an analog output.
fn servo(
    lines: &Lines<'_>,
    table: &AxisTable,
    number: usize,
    board: &Board,
) -> Result<Mover, String> {
    let why = "only a stepper motor has it, which has the key `stepgen`";
    for (key, value) in [
        ("steps_per_unit", &table.steps_per_unit),
        ("max_acceleration", &table.max_acceleration),
        ("start_speed", &table.start_speed),
    ] {
        refused(lines, value.as_ref(), key, why)?;
    }
    for (key, value, _) in times(table, &StepperConfig::default()) {
        refused(lines, value.as_ref(), key, why)?;
    }
    let count = board.outputs.into();
    let or_number = |value: Option<&Spanned<i64>>, key: &str| match value {
        Some(value) => place(lines, value, key, count),
        None => Ok(number),
    };
    let output = or_number(table.output.as_ref(), "axis.output")?;
    let encoder = or_number(table.encoder.as_ref(), "axis.encoder")?;
    if output >= count || encoder >= count {
        let reason = format!("there are {count} outputs and {count} encoders");
        return Err(lines.wrong(&table.name, "axis.name", &reason));
    }
    Ok(Mover::Servo {
        output: output as u8,
        encoder,
        motor: motor(lines, table)?,
    })
}

fn number(value: Option<&Spanned<f64>>, usual: f64) -> f64 {
    value.map_or(usual, |value| *value.get_ref())
}

/// The motor of an axis. The library checks the motor's values; this function finds the key and the
/// line of a refused one.
fn motor(lines: &Lines<'_>, table: &AxisTable) -> Result<Motor, String> {
    let usual = MotorConfig::default();
    let made = Motor::new(MotorConfig {
        max_speed: number(table.max_speed.as_ref(), usual.max_speed),
        full_scale: number(table.full_scale.as_ref(), usual.full_scale),
        time_constant: number(table.time_constant.as_ref(), usual.time_constant),
        friction: number(table.dead_band.as_ref(), usual.friction),
        counts_per_unit: number(table.counts_per_unit.as_ref(), usual.counts_per_unit),
        counts_per_revolution: table
            .counts_per_index
            .unwrap_or(usual.counts_per_revolution),
        inertia: number(table.inertia.as_ref(), usual.inertia),
        max_force: number(table.max_force.as_ref(), usual.max_force),
        drag: number(table.friction.as_ref(), usual.drag),
        stops: table
            .stops
            .as_ref()
            .map_or(usual.stops, |stops| *stops.get_ref()),
        position: number(table.position.as_ref(), usual.position),
    });
    let motor = made.map_err(|error| wrong_motor(lines, table, &error))?;
    match &table.position {
        Some(value) if motor.position() != *value.get_ref() => {
            Err(lines.wrong(value, "axis.position", "it must be between the stops"))
        }
        _ => Ok(motor),
    }
}

/// A motor on a step generator.
fn stepper(
    lines: &Lines<'_>,
    table: &AxisTable,
    generator: &Spanned<i64>,
    board: &Board,
) -> Result<Mover, String> {
    let why = "a stepper motor does not have it";
    refused(lines, table.output.as_ref(), "output", why)?;
    refused(lines, table.stops.as_ref(), "stops", why)?;
    for (key, value) in [
        ("full_scale", &table.full_scale),
        ("time_constant", &table.time_constant),
        ("dead_band", &table.dead_band),
        ("inertia", &table.inertia),
        ("max_force", &table.max_force),
        ("friction", &table.friction),
    ] {
        refused(lines, value.as_ref(), key, why)?;
    }
    let encoder = table.encoder.as_ref();
    let encoder = encoder.map(|value| place(lines, value, "axis.encoder", board.outputs.into()));
    Ok(Mover::Stepper {
        generator: place(lines, generator, "axis.stepgen", board.generators)?,
        encoder: encoder.transpose()?,
        motor: stepper_motor(lines, table)?,
    })
}

/// The times in ns that a drive needs: key, value, and default.
fn times<'a>(
    table: &'a AxisTable,
    usual: &StepperConfig,
) -> [(&'static str, &'a Option<Spanned<u32>>, u64); 4] {
    [
        ("min_pulse", &table.min_pulse, usual.min_pulse),
        ("min_space", &table.min_space, usual.min_space),
        ("dir_setup", &table.dir_setup, usual.dir_setup),
        ("dir_hold", &table.dir_hold, usual.dir_hold),
    ]
}

fn stepper_motor(lines: &Lines<'_>, table: &AxisTable) -> Result<Stepper, String> {
    let usual = StepperConfig::default();
    let steps_per_unit = number(table.steps_per_unit.as_ref(), usual.steps_per_unit);
    let [min_pulse, min_space, dir_setup, dir_hold] = times(table, &usual)
        .map(|(_, value, usual)| value.as_ref().map_or(usual, |ns| (*ns.get_ref()).into()));
    let made = Stepper::new(StepperConfig {
        steps_per_unit,
        counts_per_unit: number(table.counts_per_unit.as_ref(), steps_per_unit),
        counts_per_revolution: table
            .counts_per_index
            .unwrap_or(usual.counts_per_revolution),
        max_acceleration: number(table.max_acceleration.as_ref(), usual.max_acceleration),
        start_speed: number(table.start_speed.as_ref(), usual.start_speed),
        max_speed: number(table.max_speed.as_ref(), usual.max_speed),
        min_pulse,
        min_space,
        dir_setup,
        dir_hold,
        position: number(table.position.as_ref(), usual.position),
    });
    made.map_err(|error| wrong_motor(lines, table, &error))
}

/// Error text, with its line, for a value that the motor refused.
fn wrong_motor(lines: &Lines<'_>, table: &AxisTable, error: &MotorError) -> String {
    let MotorError::OutOfRange { field, allowed, .. } = *error else {
        let stops = table.stops.as_ref();
        let allowed = "allowed are two positions, the lower one first; -inf and inf for none";
        let wrong = |stops| lines.wrong(stops, "axis.stops", allowed);
        return stops.map_or_else(|| error.to_string(), wrong);
    };
    let (key, value) = match field {
        "max_speed" => ("axis.max_speed", &table.max_speed),
        "full_scale" => ("axis.full_scale", &table.full_scale),
        "time_constant" => ("axis.time_constant", &table.time_constant),
        "friction" => ("axis.dead_band", &table.dead_band),
        "counts_per_unit" => ("axis.counts_per_unit", &table.counts_per_unit),
        "inertia" => ("axis.inertia", &table.inertia),
        "max_force" => ("axis.max_force", &table.max_force),
        "drag" => ("axis.friction", &table.friction),
        "position" => ("axis.position", &table.position),
        "steps_per_unit" => ("axis.steps_per_unit", &table.steps_per_unit),
        "max_acceleration" => ("axis.max_acceleration", &table.max_acceleration),
        "start_speed" => ("axis.start_speed", &table.start_speed),
        _ => return lines.wrong(&table.name, "axis", &error.to_string()),
    };
    let Some(value) = value else {
        return lines.wrong(&table.name, "axis", &error.to_string());
    };
    lines.wrong(value, key, &format!("allowed is {allowed}"))
}

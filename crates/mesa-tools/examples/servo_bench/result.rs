//! Summary of a run.

use std::fmt::{self, Write};
use std::time::Duration;

use mesa_hal::bus::RegisterBus;
use mesa_hal::driver::{Failure, Pace, PortStatistics, RemoteStatus, SerialPort};
use mesa_hal::runner::Ended;

use crate::args::Args;
use crate::control::Control;
use crate::machine::World;
use crate::timed::Timed;

/// A loop has held if its error never exceeded this, in units of position.
const HOLDS: f64 = 0.25;

/// Smallest share of cycles with valid inputs: on a network that loses, delays and duplicates a few
/// percent of the packets, each such packet costs new inputs for two or three cycles.
const FIELD_IO_HOLDS: f64 = 0.5;
/// The inputs count as present if they were valid in one of this number of last cycles.
const RECENT: u64 = 100;

/// Summary of a run.
pub struct Summary {
    pub text: String,
    /// True if all loops held, and the field I/O with them.
    pub all_held: bool,
}

impl Summary {
    /// The summary of a run, whatever ended it.
    pub fn of<B: World>(control: &Control, ended: &Ended<Timed<B>>, args: &Args) -> Self {
        let mut text = String::new();
        // Writing to a string does not fail.
        let all_held = write_all(&mut text, control, ended, args).unwrap_or(false);
        Self { text, all_held }
    }
}

fn write_all<B: World>(
    out: &mut String,
    control: &Control,
    ended: &Ended<Timed<B>>,
    args: &Args,
) -> Result<bool, fmt::Error> {
    let loops = write_axes(out, control)?;
    for (number, port) in ended.driver.ports().iter().enumerate() {
        write_port(out, number, port, args.period())?;
    }
    let field_io = write_field_io(out, control)?;
    write_cycles(out, control, ended, args)?;
    let cycles = ended.statistics.cycles;
    let until = if cycles < args.cycles() {
        let by = ended
            .signal
            .map(|signal| format!(" by {signal}"))
            .unwrap_or_default();
        format!(" Ended{by} after {cycles} of {} cycles.", args.cycles())
    } else {
        String::new()
    };
    let verdict = match (loops, field_io) {
        (None, _) => "Too short to say whether the loops hold.",
        (Some(true), true) => "All loops held.",
        (Some(true), false) => "The loops held, the field I/O did NOT.",
        (Some(false), _) => "NOT all loops held.",
    };
    writeln!(out, "\n{verdict}{until}")?;
    Ok(loops == Some(true) && field_io)
}

/// True if all loops held; `None` if none ran long enough to be judged.
fn write_axes(out: &mut String, control: &Control) -> Result<Option<bool>, fmt::Error> {
    writeln!(
        out,
        "\nAxes on {}. Following error after the start, in units (held: below {HOLDS}):",
        control.drives.name
    )?;
    writeln!(out, "  axis      rms      worst")?;
    let mut held = true;
    for (n, axis) in control.axes.iter().enumerate() {
        let holds = axis.samples > 0 && axis.worst < HOLDS;
        held &= holds;
        let verdict = match (holds, axis.samples) {
            (true, _) => "",
            (false, 0) => "  not judged",
            (false, _) => "  NOT HELD",
        };
        writeln!(
            out,
            "  {n:>4} {:>8.4} {:>10.4}{verdict}",
            axis.rms(),
            axis.worst
        )?;
    }
    let is_judged = control.axes.iter().any(|axis| axis.samples > 0);
    Ok(is_judged.then_some(held))
}

fn write_port(out: &mut String, number: usize, port: &SerialPort, period: Duration) -> fmt::Result {
    let statistics = port.statistics();
    writeln!(
        out,
        "\nPort {number}: {} transfers, {}",
        statistics.transfers,
        doit(statistics, period)
    )?;
    writeln!(
        out,
        "  busy when read {}, not known {}, freed {}, restarts {}",
        statistics.too_short, statistics.unknown, statistics.stuck, statistics.starts
    )?;
    for remote in port.remotes() {
        write_remote(out, &remote)?;
    }
    Ok(())
}

fn doit(statistics: &PortStatistics, period: Duration) -> String {
    let times = &statistics.doit;
    match (times.range(), times.percentile(50)) {
        (Some((min, max)), Some(median)) => format!(
            "DOIT min {:.1} us, median {:.0} us, max {:.1} us; margin {:.1} us of {:.0} us",
            micros(min),
            micros(median),
            micros(max),
            micros(period.saturating_sub(max)),
            micros(period)
        ),
        _ => String::from("DOIT not measured"),
    }
}

fn write_remote(out: &mut String, remote: &RemoteStatus<'_>) -> fmt::Result {
    let failures = remote.failures;
    let counted: Vec<String> = failures
        .iter()
        .filter(|&(failure, count)| count > 0 && failure != Failure::Doubtful)
        .map(|(failure, count)| format!("{failure} {count}"))
        .collect();
    let counted = if counted.is_empty() {
        String::from("no failures")
    } else {
        counted.join(", ")
    };
    writeln!(
        out,
        "  channel {} {}: {} transfers, {counted}; faults: {}",
        remote.started.channel, remote.started.name, remote.transfers, remote.faults
    )
}

/// True if the field I/O worked as required.
fn write_field_io(out: &mut String, control: &Control) -> Result<bool, fmt::Error> {
    let counted = control.field_io;
    if !control.has_field() {
        let is_needed = control.drives.needs_field_io;
        let missing = if is_needed {
            "MISSING; see above for why"
        } else {
            "none of a 7I77"
        };
        writeln!(out, "\nField I/O: {missing}.")?;
        return Ok(!is_needed);
    }
    let share = counted.valid as f64 / counted.cycles.max(1) as f64;
    let is_there = counted.cycles == 0 || (counted.since_valid < RECENT && share >= FIELD_IO_HOLDS);
    writeln!(
        out,
        "\nField I/O: inputs valid in {} of {} cycles{}.",
        counted.valid,
        counted.cycles,
        if is_there {
            ""
        } else {
            ", and that is NOT enough"
        }
    )?;
    if counted.loop_backs == 0 {
        writeln!(
            out,
            "  Outputs toggled; nothing is wired back, so what they do was not compared."
        )?;
        return Ok(is_there);
    }
    writeln!(
        out,
        "  16 outputs wired back to inputs, {} differences in {} cycles.",
        counted.loop_back_errors, counted.loop_backs
    )?;
    Ok(is_there && counted.loop_back_errors == 0)
}

fn write_cycles<B: World>(
    out: &mut String,
    control: &Control,
    ended: &Ended<Timed<B>>,
    args: &Args,
) -> fmt::Result {
    let driver = &ended.driver;
    let cycles = ended.statistics.cycles.max(1) as f64;
    writeln!(
        out,
        "Cycles: {} ({} with a failure). Host time per cycle: {:.2} us in driver and loops, {:.2} us in the bus.",
        ended.statistics.cycles,
        control.bad_cycles,
        micros(control.spent.above) / cycles,
        micros(control.spent.below) / cycles
    )?;
    let counted = driver.statistics();
    writeln!(
        out,
        "Board: {:?}; {} bites of its watchdog, {} resets, bus given up {} times.",
        driver.board_state(),
        counted.watchdog_bites,
        counted.resets,
        counted.bus_down
    )?;
    let packets = driver.bus().statistics();
    if packets.bytes_sent > 0 {
        writeln!(
            out,
            "Packets: {} lost, {} late, {} twice, {} stale, {} short, {} foreign; \
             writes: {} lost, {} late, {} twice, {} unconfirmed.",
            packets.lost,
            packets.late,
            packets.duplicate,
            packets.stale,
            packets.short,
            packets.foreign,
            packets.lost_writes,
            packets.late_writes,
            packets.repeated_writes,
            packets.unconfirmed_writes,
        )?;
    }
    if args.pace == Pace::Board {
        let missed = counted.missed_periods;
        let least = control.least_slack.map_or(0.0, micros);
        writeln!(
            out,
            "Paced by the board: {missed} periods missed, {least:.0} us left of the tightest."
        )?;
    }
    let rejections = driver.pins().total_rejections();
    writeln!(
        out,
        "Values that were not used as set: {} not finite, {} out of range.",
        rejections.not_finite, rejections.out_of_range
    )
}

fn micros(time: Duration) -> f64 {
    time.as_secs_f64() * 1e6
}

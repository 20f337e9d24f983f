//! The table at the end.

use std::time::Duration;

use mesa_hal::bus::RegisterBus;
use mesa_hal::driver::{Failure, Pace, PortStatistics, RemoteStatus, SerialPort};

use crate::args::Args;
use crate::control::Control;
use crate::machine::World;

/// A loop has held if it never was further away than this, in units of position.
const HOLDS: f64 = 0.25;

/// Prints the table; whether all loops held.
pub fn print<B: World>(control: &Control<B>, args: &Args) -> bool {
    println!(
        "\nAxes on {}. Following error after the start, in units (held: below {HOLDS}):",
        control.drives.name()
    );
    println!("  axis      rms      worst");
    let mut held = true;
    for (n, axis) in control.axes.iter().enumerate() {
        let holds = axis.samples > 0 && axis.worst < HOLDS;
        held &= holds;
        let verdict = if holds { "" } else { "  NOT HELD" };
        println!("  {n:>4} {:>8.4} {:>10.4}{verdict}", axis.rms(), axis.worst);
    }
    for (number, port) in control.driver.ports().iter().enumerate() {
        print_port(number, port, args.period());
    }
    held &= print_loop_back(control);
    print_cycles(control, args);
    println!(
        "\n{}",
        if held {
            "All loops held."
        } else {
            "NOT all loops held."
        }
    );
    held
}

fn print_port(number: usize, port: &SerialPort, period: Duration) {
    let statistics = port.statistics();
    println!(
        "\nPort {number}: {} transfers, {}",
        statistics.transfers,
        doit(statistics, period)
    );
    println!(
        "  busy when read {}, not known {}, freed {}, restarts {}",
        statistics.too_short, statistics.unknown, statistics.stuck, statistics.starts
    );
    for remote in port.remotes() {
        print_remote(&remote);
    }
}

fn doit(statistics: &PortStatistics, period: Duration) -> String {
    let times = &statistics.doit;
    match (times.min(), times.median(), times.max()) {
        (Some(min), Some(median), Some(max)) => format!(
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

fn print_remote(remote: &RemoteStatus<'_>) {
    let failures = remote.failures();
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
    println!(
        "  channel {} {}: {} transfers, {counted}; faults: {}",
        remote.started().channel,
        remote.started().name,
        remote.transfers(),
        remote.faults()
    );
}

fn print_loop_back<B: World>(control: &Control<B>) -> bool {
    if !control.has_field() {
        println!("\nField I/O: there is none of a 7I77.");
        return true;
    }
    if control.loop_backs == 0 {
        println!(
            "\nField I/O: outputs toggled; nothing is wired back, so inputs were not compared."
        );
        return true;
    }
    println!(
        "\nField I/O: 16 outputs wired back to inputs, {} differences in {} cycles.",
        control.loop_back_errors, control.loop_backs
    );
    control.loop_back_errors == 0
}

fn print_cycles<B: World>(control: &Control<B>, args: &Args) {
    let cycles = control.cycles.max(1) as f64;
    let below = control.driver.bus().spent();
    println!(
        "Cycles: {} ({} with a failure). Host time per cycle: {:.2} us in driver and loops, {:.2} us in the bus.",
        control.cycles,
        control.bad_cycles,
        micros(control.host_time) / cycles,
        micros(below) / cycles
    );
    let counted = control.driver.statistics();
    println!(
        "Board: {:?}; {} bites of its watchdog, {} resets, bus given up {} times.",
        control.driver.board_state(),
        counted.watchdog_bites,
        counted.resets,
        counted.bus_down
    );
    let packets = control.driver.bus().statistics();
    if packets.bytes_sent > 0 {
        println!(
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
        );
    }
    if args.pace == Pace::Board {
        let missed = counted.missed_periods;
        let least = control.least_slack.map_or(0.0, micros);
        println!(
            "Paced by the board: {missed} periods missed, {least:.0} us left of the tightest."
        );
    }
    let rejections = control.driver.pins().total_rejections();
    println!(
        "Values that were not used as set: {} not finite, {} out of range.",
        rejections.not_finite, rejections.out_of_range
    );
}

fn micros(time: Duration) -> f64 {
    time.as_secs_f64() * 1e6
}

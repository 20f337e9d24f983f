//! Report of a measurement, as text and for programs.

use std::fmt::{self, Display};
use std::time::Duration;

use mesa_hal::driver::Pace;
use mesa_hal::runner::{Distribution, Histogram, RateJudgement};
use mesa_tools::diagnosis::Packets;
use serde::Serialize;

use super::advice;
use super::measure::{Mark, Measured, Offline, name};

/// Rates to judge, in Hz.
const RATES: [u32; 3] = [1000, 2000, 4000];
/// Lower ends of the rows of the histograms, in microseconds.
const ROWS: [u64; 19] = [
    0, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000,
    200_000, 500_000,
];
/// Characters of the longest bar.
const WIDTH: f64 = 30.0;

/// Report of a measurement.
#[derive(Debug, Serialize)]
pub struct LatencyReport {
    pub board: String,
    pub rate_hz: u32,
    pub runs: Vec<Run>,
    /// Socket options that would shorten or steady the round trip, and were refused.
    socket_options_refused: Vec<&'static str>,
}

/// Result at one pace.
#[derive(Debug, Serialize)]
pub struct Run {
    pub pace: &'static str,
    pub cycles: u64,
    failed_reads: u64,
    /// Skipped periods at the host's pace, periods without inputs at the board's.
    missed_periods: u64,
    late_us: Option<Times>,
    round_trip_us: Option<Times>,
    used_us: Option<Times>,
    transfer_us: f64,
    cpu_us_per_cycle: f64,
    packets_out_per_cycle: f64,
    bytes_out_per_cycle: f64,
    bytes_back_per_cycle: f64,
    pub verdicts: Vec<Judged>,
    offline: Vec<Offline>,
    /// Packets from the first cycle to the end.
    pub packets: Packets,
    histogram: Vec<Row>,
}

#[derive(Debug, Serialize)]
struct Times {
    min: f64,
    median: f64,
    p99: f64,
    p99_99: f64,
    max: f64,
    mean: f64,
}

#[derive(Debug, Serialize)]
pub struct Judged {
    pub rate_hz: u32,
    pub holds: RateJudgement,
    pub reason: String,
}

/// Cycles with a time from here up to the next row.
#[derive(Debug, Serialize)]
struct Row {
    from_us: u64,
    late: u64,
    used: u64,
}

impl LatencyReport {
    pub fn of(rate: u32, all: &[Measured]) -> Self {
        let first = all.first();
        Self {
            board: first.map(|one| one.board.clone()).unwrap_or_default(),
            rate_hz: rate,
            runs: all.iter().map(|one| Run::of(rate, one)).collect(),
            socket_options_refused: first.map(|one| one.refused.clone()).unwrap_or_default(),
        }
    }
}

impl Run {
    fn of(rate: u32, measured: &Measured) -> Self {
        let (recorder, begin, end) = (&measured.recorder, &measured.begin, &measured.end);
        let per_cycle = |total: u64| total as f64 / measured.cycles.max(1) as f64;
        let missed = |mark: &Mark| match recorder.pace() {
            Pace::Host => mark.run.skipped_periods,
            Pace::Board => mark.driver.missed_periods,
        };
        let mut rates = RATES.to_vec();
        if !rates.contains(&rate) {
            rates.push(rate);
        }
        let cpu = end.cpu.saturating_sub(begin.cpu);
        let counted = |of: fn(&mesa_hal::bus::BusStatistics) -> u64| {
            per_cycle(of(&end.bus).saturating_sub(of(&begin.bus)))
        };
        Self {
            pace: name(recorder.pace()),
            cycles: measured.cycles,
            failed_reads: recorder.failed(),
            missed_periods: missed(end).saturating_sub(missed(begin)),
            late_us: Times::of(recorder.late()),
            round_trip_us: Times::of(recorder.round_trip()),
            used_us: Times::of(recorder.used()),
            transfer_us: micros(recorder.transfer()),
            cpu_us_per_cycle: per_cycle(cpu.as_nanos() as u64) / 1000.0,
            packets_out_per_cycle: counted(|bus| bus.exchanges),
            bytes_out_per_cycle: counted(|bus| bus.bytes_sent),
            bytes_back_per_cycle: counted(|bus| bus.bytes_received),
            verdicts: rates
                .iter()
                .map(|&rate| Judged::of(rate, measured))
                .collect(),
            offline: measured.offline.clone(),
            packets: measured.packets,
            histogram: rows(recorder.late(), recorder.used()),
        }
    }
}

impl Times {
    fn of(histogram: &Histogram) -> Option<Self> {
        let all: Distribution = histogram.distribution();
        (all.count > 0).then(|| Self {
            min: micros(all.min),
            median: micros(all.median),
            p99: micros(all.p99),
            p99_99: micros(all.p99_99),
            max: micros(all.max),
            mean: micros(all.mean),
        })
    }
}

impl Judged {
    fn of(rate: u32, measured: &Measured) -> Self {
        if !measured.offline.is_empty() {
            let reason = "a remote was offline meanwhile, and what brings it back takes time in the \
                          cycle: measure again while it runs";
            return Self {
                rate_hz: rate,
                holds: RateJudgement::No,
                reason: reason.to_owned(),
            };
        }
        let verdict = measured.recorder.verdict(rate);
        Self {
            rate_hz: rate,
            holds: verdict.judgement,
            reason: advice::reason(&verdict, measured),
        }
    }
}

/// Rows from the first to the last that is not empty.
fn rows(late: &Histogram, used: &Histogram) -> Vec<Row> {
    let edges = ROWS.map(Duration::from_micros);
    let counts = late.between(&edges).zip(used.between(&edges));
    let all = ROWS.into_iter().zip(counts);
    let mut rows: Vec<Row> = all
        .map(|(from_us, (late, used))| Row {
            from_us,
            late,
            used,
        })
        .collect();
    let is_empty = |row: &Row| row.late == 0 && row.used == 0;
    while rows.pop_if(|row| is_empty(row)).is_some() {}
    let first = rows.iter().position(|row| !is_empty(row));
    rows.split_off(first.unwrap_or(0))
}

fn micros(time: Duration) -> f64 {
    time.as_nanos() as f64 / 1000.0
}

impl Display for LatencyReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for run in &self.runs {
            let (board, rate, pace) = (&self.board, self.rate_hz, run.pace);
            writeln!(
                f,
                "{board}: {} cycles at {rate} Hz, paced by the {pace}",
                run.cycles
            )?;
            writeln!(f, "{run}")?;
        }
        for option in &self.socket_options_refused {
            writeln!(f, "this host does not allow {option}")?;
        }
        Ok(())
    }
}

impl Display for Run {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.times(f)?;
        self.bars(f)?;
        let (failed, missed) = (self.failed_reads, self.missed_periods);
        writeln!(
            f,
            "reads that failed: {failed}; periods without a cycle: {missed}"
        )?;
        writeln!(
            f,
            "{}",
            self.packets
                .trouble()
                .unwrap_or_else(|| { self.packets.loss().to_string() })
        )?;
        writeln!(
            f,
            "packets out per cycle: {:.3}",
            self.packets_out_per_cycle
        )?;
        let (out, back) = (self.bytes_out_per_cycle, self.bytes_back_per_cycle);
        writeln!(f, "bytes per cycle: {out:.1} out, {back:.1} back")?;
        writeln!(f, "CPU per cycle: {:.1} us", self.cpu_us_per_cycle)?;
        for remote in &self.offline {
            let Offline {
                remote,
                is_back,
                reason,
            } = remote;
            let state = if *is_back {
                "was offline"
            } else {
                "is OFFLINE"
            };
            writeln!(f, "{remote} {state}: {reason}")?;
        }
        for verdict in &self.verdicts {
            let Judged {
                rate_hz,
                holds,
                reason,
            } = verdict;
            writeln!(f, "{rate_hz} Hz: {holds}: {reason}")?;
        }
        Ok(())
    }
}

impl Run {
    /// Table of percentiles.
    fn times(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let titles = ["min", "median", "99 %", "99.99 %", "max"];
        write!(f, "{:<14}", "us")?;
        titles
            .iter()
            .try_for_each(|title| write!(f, "{title:>10}"))?;
        writeln!(f)?;
        let rows = [
            ("late", &self.late_us),
            ("round trip", &self.round_trip_us),
            ("used", &self.used_us),
        ];
        for (title, times) in rows {
            if let Some(times) = times {
                writeln!(f, "{title:<14}{times}")?;
            }
        }
        Ok(())
    }

    /// Histograms as bars.
    fn bars(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let counts = self.histogram.iter().flat_map(|row| [row.late, row.used]);
        let Some(most) = counts.max() else {
            return Ok(());
        };
        // Logarithmic bars, so that one cycle is visible beside a million.
        let height = |count: u64| (count as f64).ln_1p();
        let bar = |count: u64| "#".repeat((height(count) / height(most) * WIDTH).ceil() as usize);
        let width = WIDTH as usize + 10;
        writeln!(
            f,
            "\nfrom (us)  {:<width$}  used (log scale)",
            "late (log scale)"
        )?;
        for row in &self.histogram {
            let cell = |count| match count {
                0 => String::new(),
                _ => format!("{} {count}", bar(count)),
            };
            let (late, used) = (cell(row.late), cell(row.used));
            let line = format!("{:>9}  {late:<width$}  {used}", row.from_us);
            writeln!(f, "{}", line.trim_end())?;
        }
        writeln!(f)
    }
}

impl Display for Times {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let all = [self.min, self.median, self.p99, self.p99_99, self.max];
        all.iter().try_for_each(|time| write!(f, "{time:>10.1}"))
    }
}

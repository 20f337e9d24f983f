//! `mesa doctor`: checks of all that may keep a machine from running well, each with a figure, a
//! verdict and advice.

mod pci;
mod report;

use std::fmt::{self, Display};
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::driver::Pace;
use mesa_hal::ethernet::EthernetBoard;
use mesa_hal::hostmot2::HostMot2;
use mesa_hal::modules::watchdog::WatchdogRegisters;
use mesa_hal::transport::Recording;
use mesa_hal::transport::udp::UdpConfig;
use mesa_hal::{BoardState, Driver, Settings};
use mesa_tools::Counted;
use mesa_tools::diagnosis::network::Network;
use mesa_tools::diagnosis::{
    self, FigureVerdict, Finding, Host, PacketMark, Packets, RoundTrips, board, computer, network,
};
use serde::Serialize;

use crate::board::bus::Bus;
use crate::board::bus_log::BusLogFile;
use crate::board::consent::{Asks, Plan};
use crate::board::modes::Modes;
use crate::board::running;
use crate::board::target::{Found, Target};
use crate::ui::colours::Tone;
use crate::ui::context::{Context, Ending, Failure};
use crate::ui::files;
use crate::ui::output::complain;
use mesa_tools::advice::told;

const AFTER_HELP: &str = "\
Reads files of this computer and registers of the board. Then starts the machine with all outputs
off, to check its remotes, their faults and their field power; --passive leaves that out. Exits with
1 if anything is bad.

Example:
  mesa doctor --addr 10.10.10.10 --period 1000 --passive";

/// Diagnose what may keep a machine from running well, with advice
#[derive(Debug, Args)]
#[command(after_help = AFTER_HELP)]
pub struct Doctor {
    #[command(flatten)]
    target: Target,
    #[command(flatten)]
    modes: Modes,
    /// Planned period of the machine, in microseconds, 100 to 10000
    #[arg(long, value_name = "MICROSECONDS", default_value_t = 1000,
        value_parser = clap::value_parser!(u64).range(100..=10_000))]
    period: u64,
    /// Number of test exchanges with the board, one in each period, 10 to 100000
    #[arg(long, default_value_t = 500, value_parser = clap::value_parser!(u32).range(10..=100_000))]
    exchanges: u32,
    /// Do not start the machine
    #[arg(long)]
    passive: bool,
    /// Write to FILE, as JSON, the data of a real board that would settle what the documents list
    /// as not confirmed on hardware. No memory is written; remotes are read unless --passive is
    /// given
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    #[command(flatten)]
    bus_log: BusLogFile,
    #[command(flatten)]
    asks: Asks,
    /// Directory that contains this computer's /proc and /sys
    #[arg(long, value_name = "DIRECTORY", default_value = "/", hide = true)]
    root: PathBuf,
}

/// Findings of all checks.
#[derive(Debug, Serialize)]
struct Diagnosis {
    address: String,
    /// Worst verdict of the findings.
    verdict: FigureVerdict,
    findings: Vec<Finding>,
}

/// Run time of the started machine: longer than a remote needs to report a fault.
const CYCLES: Duration = Duration::from_millis(300);

impl Doctor {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let found = self.target.find(context)?;
        if !self.passive {
            let plan = Plan::at(
                found.address,
                "start the machine with all outputs off, and stop it again (not with --passive)",
            );
            // The board is opened after the consent, and an error from then on becomes a finding.
            self.asks.consent(context, &plan, None)?;
        }
        if let Some(path) = &self.report {
            self.asks.replaces(context, path)?;
        }
        if let Some(path) = &self.bus_log.path {
            self.asks.replaces(context, path)?;
        }
        let address = found.address.ip();
        let here = Network::below(&self.root).unwrap_or_default();
        let host = Host::below(&self.root);
        let way = address.map(|address| network::way(&here, address));
        let mut findings: Vec<_> = way.into_iter().collect();
        findings.extend(found.on_pci().map(pci::place));
        self.look_at_the_board(context, &found, &mut findings);
        let mut gathered = Ok(());
        if let Some(path) = self
            .report
            .as_ref()
            .filter(|_| context.stop.signal().is_none())
        {
            gathered = self.gather(context, &found, path);
        }
        findings.extend(computer::all(
            &host,
            address.and_then(|address| network::interface(&here, address)),
        ));
        let verdict = diagnosis::worst(&findings);
        if let Some(signal) = context.stop.signal() {
            complain(format_args!(
                "mesa: ended by {signal}; nothing was left running, and not all was looked at"
            ));
        }
        context.print(&Diagnosis {
            address: found.address.to_string(),
            verdict,
            findings,
        })?;
        gathered?;
        Ok(match context.ending() {
            Ending::Done if verdict == FigureVerdict::Bad => Ending::Refused,
            ending => ending,
        })
    }

    /// Gathers the data and writes the report.
    fn gather(&self, context: &Context, found: &Found, path: &Path) -> Result<(), Failure> {
        let mut bus = found.open()?;
        let address = found.address.to_string();
        let device = found.on_pci();
        let report = report::gather(&mut bus, address, device, &context.stop, !self.passive)?;
        files::write(
            path,
            serde_json::to_string_pretty(&report)
                .map_err(Failure::refused)?
                .as_bytes(),
        )?;
        let (answered, all) = report.answered();
        complain(format_args!(
            "mesa: {}: {answered} of {all} questions not confirmed so far are answered by this board",
            path.display()
        ));
        Ok(())
    }

    fn period(&self) -> Duration {
        Duration::from_micros(self.period)
    }

    /// Adds the findings about the board; an error becomes a finding too.
    fn look_at_the_board(&self, context: &Context, found: &Found, findings: &mut Vec<Finding>) {
        let bad = |check: &str, error: Failure| {
            let advice = "fix that first, then run this again";
            Finding::new(FigureVerdict::Bad, check, error.to_string(), advice)
        };
        let mut bus = match found.open() {
            Ok(bus) => bus,
            Err(error) => {
                findings.push(bad("board", error));
                return;
            }
        };
        let asked = self.ask(context, &mut bus, findings);
        let mut alone = running::check_alone(&bus);
        // The measured exchanges leave another deadline than that of a cycle.
        drop(bus);
        if let Err(error) = asked {
            findings.push(bad("board", error));
        } else if !self.passive && context.stop.signal().is_none() {
            let started = found.open_with(UdpConfig::default());
            let started = started.and_then(|bus| self.start(context, bus, findings));
            match started {
                Ok(during) => alone = alone.and(during),
                Err(error) => findings.push(bad("start of the machine", error)),
            }
        }
        findings.push(match alone {
            Ok(()) => Finding::good("second master", "none seen"),
            Err(error) => bad("second master", error),
        });
    }

    /// Adds the findings that need reads only.
    fn ask(
        &self,
        context: &Context,
        bus: &mut Bus,
        findings: &mut Vec<Finding>,
    ) -> Result<(), Failure> {
        if !bus.is_on_ethernet() {
            return pci::ask(bus, self.exchanges, findings);
        }
        let mut board = EthernetBoard::new(bus);
        let mut identity = board.identity()?;
        let counters = board.counters()?;
        let firmware = HostMot2::identify(bus)?;
        if firmware.idrom.is_7i97t() {
            identity.set_7i97t();
        }
        findings.push(board::firmware(&identity));
        findings.extend(board::generation(&identity.card, &firmware.idrom));
        findings.push(board::errors(&counters));
        findings.push(bite(bus, &firmware)?);
        let go_on = || context.stop.signal().is_none();
        let begin = PacketMark::take(bus);
        let trips = RoundTrips::measure(bus, self.exchanges, self.period(), go_on)?;
        findings.push(board::loss(&begin.packets_since(bus, Pace::Host)));
        findings.push(board::latency(&trips, self.period()));
        Ok(())
    }

    /// Runs the machine for a short time, with nothing set, and adds the findings about its
    /// remotes. The inner result is an error if another program drove the board meanwhile.
    fn start(
        &self,
        context: &Context,
        bus: Bus,
        findings: &mut Vec<Finding>,
    ) -> Result<Result<(), Failure>, Failure> {
        let mut settings = Settings {
            period: self.period(),
            ..Settings::default()
        };
        self.modes.put(&mut settings);
        let watchdog = settings.watchdog_time();
        let mut driver = running::start(self.bus_log.around(bus), settings)?;
        if let Err(error) = driver.prove_watchdogs() {
            findings.push(Finding::new(
                FigureVerdict::Unknown,
                "remotes: proof of their watchdogs",
                told(&error),
                "fix that first, then run this again",
            ));
        }
        let mark = PacketMark::take(&mut driver.bus_mut().inner);
        let cycles = self.cycle(context, &mut driver);
        let state = driver.board_state();
        let remotes = judge(&driver, self.period(), watchdog);
        let saved = self.bus_log.save(&driver.bus().log, driver.firmware());
        let (Recording { inner: mut bus, .. }, stopped) = driver.shutdown();
        let packets = mark.packets_since(&mut bus, Pace::Host);
        findings.push(judge_cycles(cycles, state, &packets));
        findings.extend(remotes);
        stopped?;
        saved?;
        complain("mesa: the machine is stopped; no output was ever on");
        Ok(running::check_alone(&bus))
    }

    /// Runs cycles, and counts them.
    fn cycle(&self, context: &Context, driver: &mut Driver<Recording<Bus>>) -> CycleCounts {
        let begun = driver.bus_mut().now();
        let mut cycles = CycleCounts::default();
        while driver.bus_mut().now().since(begun) < CYCLES && context.stop.signal().is_none() {
            let start = driver.bus_mut().now();
            let is_good = driver.read().is_ok() & driver.write().is_ok();
            cycles.all += 1;
            cycles.failed += u32::from(!is_good);
            let bus = driver.bus_mut();
            let left = start.after(self.period()).since(bus.now());
            bus.wait(left);
        }
        cycles
    }
}

/// Numbers of cycles of a short run.
#[derive(Clone, Copy, Debug, Default)]
struct CycleCounts {
    all: u32,
    failed: u32,
}

/// Finding about the cycles of a short run, and their packets.
fn judge_cycles(cycles: CycleCounts, state: BoardState, packets: &Packets) -> Finding {
    let check = "cycles";
    let mut figure = format!(
        "{} of {} failed",
        cycles.failed,
        Counted(cycles.all.into(), "cycle")
    );
    let state = running::trouble(state).map(|state| state.to_string());
    let trouble = packets.trouble();
    for trouble in state.iter().chain(&trouble) {
        figure.push_str("; ");
        figure.push_str(trouble);
    }
    if cycles.failed == 0 && state.is_none() && trouble.is_none() {
        return Finding::good(check, figure);
    }
    let advice = match packets.lost {
        0 => "no packet was lost: see latency",
        _ => "see packet loss",
    };
    Finding::new(FigureVerdict::Look, check, figure, advice)
}

/// Findings about a machine that has run for a short time.
fn judge(driver: &Driver<Recording<Bus>>, period: Duration, watchdog: Duration) -> Vec<Finding> {
    let mut findings = vec![board::watchdog("board: watchdog", Some(watchdog), period)];
    for port in driver.ports() {
        let remotes = port.remotes();
        findings.extend(remotes.flat_map(|remote| board::remote(&remote, period)));
    }
    findings.extend(driver.missing().iter().map(board::missing));
    findings.extend(driver.remarks().iter().map(board::odd));
    findings
}

/// Finding about bites of the board's watchdog since its last set-up.
fn bite(bus: &mut Bus, firmware: &HostMot2) -> Result<Finding, Failure> {
    let registers = WatchdogRegisters::locate(firmware)?;
    let status = bus.read(registers.status)?;
    if status & WatchdogRegisters::HAS_BIT == 0 {
        return Ok(Finding::good(
            "board: watchdog bites",
            "none since it was last set up",
        ));
    }
    Ok(Finding::new(
        FigureVerdict::Look,
        "board: watchdog bites",
        "it has bitten since it was last set up",
        "normal after a program that ended; in a machine that ran, packets were lost or the program hung",
    ))
}

impl Display for Diagnosis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let verdict = word(self.verdict);
        writeln!(f, "{}: {}", self.address, tone(self.verdict).of(verdict))?;
        for finding in &self.findings {
            let Finding {
                check,
                figure,
                verdict,
                advice,
            } = finding;
            let word = format!("{:<8}", word(*verdict));
            writeln!(f, "{} {check}: {figure}", tone(*verdict).of(&word))?;
            if let Some(advice) = advice {
                writeln!(f, "         -> {advice}")?;
            }
        }
        Ok(())
    }
}

fn tone(verdict: FigureVerdict) -> Tone {
    match verdict {
        FigureVerdict::Ok => Tone::Good,
        FigureVerdict::Unknown | FigureVerdict::Look => Tone::Doubt,
        FigureVerdict::Bad => Tone::Bad,
    }
}

fn word(verdict: FigureVerdict) -> &'static str {
    match verdict {
        FigureVerdict::Ok => "ok",
        FigureVerdict::Unknown => "unknown",
        FigureVerdict::Look => "look",
        FigureVerdict::Bad => "BAD",
    }
}

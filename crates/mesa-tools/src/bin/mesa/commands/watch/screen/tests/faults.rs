//! What the screen says after sequences of faults. The truth is the simulated machine: its cables,
//! its field power, and how often its board was reset.

use std::time::Duration;

use super::picture;
use crate::board::running::Keeper;
use crate::commands::watch::screen::Pins;
use mesa_hal::bus::{BusErrorKind, Fault};
use mesa_hal::runner::SnapshotWriter;
use mesa_hal::transport::Faulty;
use mesa_hal::{Clock, Driver, Settings};
use mesa_hal_sim::devices::{find_cable, find_mut};
use mesa_hal_sim::{Motor, SimFpga, machines};

const PERIOD: Duration = Duration::from_millis(5);
/// Cycles after which the driver has tried to restart each remote, and has set up the board.
const SETTLED: usize = 600;
/// The network fails in each exchange.
const CUT: Fault = Fault::NotExecuted(BusErrorKind::Lost);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Deed {
    Unplug,
    PlugIn,
    FieldPowerOff,
    FieldPowerOn,
    /// The board loses its configuration, and has it again after 1.3 s.
    PowerCycle,
    Reset,
    NetworkOff,
    NetworkOn,
}

impl Deed {
    const ALL: [Self; 8] = [
        Self::Unplug,
        Self::PlugIn,
        Self::FieldPowerOff,
        Self::FieldPowerOn,
        Self::PowerCycle,
        Self::Reset,
        Self::NetworkOff,
        Self::NetworkOn,
    ];
}

/// What is true about the machine.
#[derive(Clone, Copy, Debug)]
struct Truth {
    is_plugged_in: bool,
    has_field_power: bool,
    has_network: bool,
    resets: u32,
    /// Resets while the network was off, of which one can be seen later.
    unseen_resets: u32,
}

impl Truth {
    const AT_START: Self = Self {
        is_plugged_in: true,
        has_field_power: true,
        has_network: true,
        resets: 0,
        unseen_resets: 0,
    };

    /// The truth after a deed, unless it would change nothing.
    fn after(mut self, deed: Deed) -> Option<Self> {
        let can_happen = match deed {
            Deed::Unplug => self.is_plugged_in,
            Deed::PlugIn => !self.is_plugged_in,
            Deed::FieldPowerOff => self.has_field_power,
            Deed::FieldPowerOn => !self.has_field_power,
            Deed::PowerCycle | Deed::Reset => true,
            Deed::NetworkOff => self.has_network,
            Deed::NetworkOn => !self.has_network,
        };
        match deed {
            Deed::Unplug | Deed::PlugIn => self.is_plugged_in = deed == Deed::PlugIn,
            Deed::FieldPowerOff => self.has_field_power = false,
            Deed::FieldPowerOn => self.has_field_power = true,
            Deed::PowerCycle | Deed::Reset if self.has_network => self.resets += 1,
            Deed::PowerCycle | Deed::Reset => self.unseen_resets = 1,
            Deed::NetworkOff => self.has_network = false,
            Deed::NetworkOn => {
                self.resets += std::mem::take(&mut self.unseen_resets);
                self.has_network = true;
            }
        }
        can_happen.then_some(self)
    }
}

/// A machine with its screen.
struct Stage {
    driver: Driver<Faulty<SimFpga>>,
    writer: SnapshotWriter,
    keeper: Keeper,
    screen: Pins,
    truth: Truth,
}

impl Stage {
    fn new() -> Self {
        let fpga = machines::six_axes_7i92(Motor::default());
        let mut settings = Settings {
            period: PERIOD,
            watchdog: Some(crate::board::running::WATCHDOG),
            ..Settings::default()
        };
        settings.fault_policy.longest_backoff = Duration::from_millis(200);
        let driver = Driver::start(Faulty::new(fpga, 1), settings).unwrap();
        Self {
            writer: SnapshotWriter::new(&driver),
            driver,
            keeper: Keeper::default(),
            screen: Pins::new("hm2_7i92.0", PERIOD, String::new(), false),
            truth: Truth::AT_START,
        }
    }

    fn run(&mut self, cycles: usize) {
        for _ in 0..cycles {
            let _ = self.driver.read();
            let (state, period) = (self.driver.board_state(), self.driver.period());
            if self.keeper.pass_cycle(state, period) {
                let _ = self.driver.rearm();
            }
            let _ = self.driver.write();
            self.driver.bus_mut().wait(PERIOD);
            self.writer.publish(&self.driver).unwrap();
        }
    }

    fn happen(&mut self, deed: Deed) {
        let bus = self.driver.bus_mut();
        let now = SimFpga::now(&bus.inner);
        let field = bus.inner.remote_mut(0, 0).unwrap();
        match deed {
            Deed::Unplug => find_cable(field).unwrap().unplug(),
            Deed::PlugIn => find_cable(field).unwrap().replug(),
            Deed::FieldPowerOff | Deed::FieldPowerOn => {
                let volts = if deed == Deed::FieldPowerOn {
                    24.0
                } else {
                    0.0
                };
                let device = find_mut(field).unwrap();
                device.set_field_volts(now, volts).unwrap();
            }
            Deed::PowerCycle => bus.inner.reset_for(1_300_000_000),
            Deed::Reset => bus.inner.reset_for(3_000_000),
            Deed::NetworkOff => bus.fail_randomly(CUT, 1.0),
            Deed::NetworkOn => bus.heal(),
        }
        self.truth = self.truth.after(deed).expect("it changes something");
    }

    fn shown(&mut self) -> String {
        self.screen.take(&self.writer.reader().read().unwrap());
        picture(&mut self.screen)
    }

    fn check(&mut self, deeds: &[Deed]) {
        let shown = self.shown();
        let line = |begin: &str| {
            let lines = shown.lines().map(|line| line.trim_matches(['"', '│', ' ']));
            let lines = lines.skip_while(|line| !line.starts_with(begin));
            lines.take(2).collect::<Vec<_>>().join(" ")
        };
        let field = line("7i77.0.0");
        let says = |text: &str| field.starts_with(&format!("7i77.0.0  {text}"));
        let what = format!("{deeds:?}:\n{shown}");
        if !self.truth.has_network {
            assert!(shown.contains("board     NOT REACHED for "), "{what}");
            assert!(says("UNKNOWN "), "{what}");
            assert!(line("7i77.0.1").starts_with("7i77.0.1  UNKNOWN "), "{what}");
            return;
        }
        assert!(shown.contains("board     running for "), "{what}");
        let resets = match self.truth.resets {
            1 => "board reset 1 time, ".to_owned(),
            count => format!("board reset {count} times, "),
        };
        assert!(shown.contains(&resets), "{what}");
        assert!(line("7i77.0.1").starts_with("7i77.0.1  running "), "{what}");
        let present = field.split("; ").next().unwrap_or_default();
        match (self.truth.is_plugged_in, self.truth.has_field_power) {
            (true, true) => assert!(says("running "), "{what}"),
            (true, false) => {
                assert!(says("OFFLINE ") || says("RESTARTING "), "{what}");
                assert!(present.contains("voltage"), "{what}");
            }
            (false, _) => {
                assert!(says("OFFLINE ") || says("RESTARTING "), "{what}");
                let is_true = ["too many failed transfers", "the remote does not start"];
                assert!(is_true.iter().any(|text| present.contains(text)), "{what}");
                assert!(
                    !field
                        .split("first fault")
                        .next()
                        .unwrap()
                        .contains("voltage"),
                    "{what}"
                );
            }
        }
    }
}

/// Checks the screen after each of the sequences of three deeds that begin with one of `first`.
fn check_three(first: &[Deed]) {
    let mut sequences = 0;
    for &a in first {
        for [b, c] in Deed::ALL
            .into_iter()
            .flat_map(|b| Deed::ALL.map(|c| [b, c]))
        {
            let deeds = [a, b, c];
            let is_sequence = deeds
                .iter()
                .try_fold(Truth::AT_START, |t, deed| t.after(*deed));
            if is_sequence.is_none() {
                continue;
            }
            let mut stage = Stage::new();
            stage.run(20);
            for (n, deed) in deeds.into_iter().enumerate() {
                stage.happen(deed);
                stage.run(SETTLED);
                stage.check(&deeds[..=n]);
            }
            sequences += 1;
        }
    }
    assert!(sequences > 40, "{sequences}");
}

#[test]
fn screen_is_correct_after_a_remote_fault_and_two_others() {
    check_three(&[Deed::Unplug, Deed::FieldPowerOff]);
}

#[test]
fn screen_is_correct_after_a_board_fault_and_two_others() {
    check_three(&[Deed::PowerCycle, Deed::Reset, Deed::NetworkOff]);
}

#[test]
fn unknown_time_is_not_counted_as_running_time_of_a_remote() {
    let mut stage = Stage::new();
    stage.run(2000);
    assert!(stage.shown().contains("7i77.0.0  running    for 10 s"));
    stage.happen(Deed::NetworkOff);
    stage.run(420);
    let shown = stage.shown();
    assert!(shown.contains("board     NOT REACHED for 2 s"), "{shown}");
    for channel in 0..2 {
        let unknown = format!("7i77.0.{channel}  UNKNOWN    for 2 s ");
        assert!(shown.contains(&unknown), "{shown}");
    }
    assert!(shown.contains("before that: running"), "{shown}");
    stage.happen(Deed::NetworkOn);
    stage.run(500);
    let shown = stage.shown();
    for channel in 0..2 {
        let begin = format!("7i77.0.{channel}  running    for ");
        let since = shown
            .split(&begin)
            .nth(1)
            .unwrap_or_else(|| panic!("{shown}"));
        assert!(
            since.starts_with("1 s") || since.starts_with("2 s"),
            "{shown}"
        );
    }
}

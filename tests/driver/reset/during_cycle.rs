//! A reset or a bite that the driver has not detected yet, at every time of a cycle whose write
//! holds a part of the set-up: nothing is driven before everything is re-armed, no input is
//! published that was read from a board without its set-up, and re-arming recovers everything. The
//! truth is the outputs of the simulated FPGA at every access, recorded by a director.

mod late_write;

use std::time::Duration;

use crate::common::ethernet::{self, WIRE, good, is_request};
use crate::common::machine::{World, start};
use crate::common::watch::Watch;
use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::driver::{BoardState, Driver, SerialConfig};
use mesa_hal::hal::{Input, Output, Pins, Value};
use mesa_hal::hostmot2::HostMot2;
use mesa_hal_sim::{DEFAULT_ACCESS_COST, Motor, SimFpga, machines};

const BOARD: &str = "hm2_7i97.0";
const PINS: usize = 51;
/// Writes of the whole set-up from the first direction on.
const SET_UP_AFTER_DRIVE: usize = 9;

/// A part of the set-up that the next write holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Change {
    Nothing,
    Led,
    Filter,
    Sampling,
    PwmFrequency,
    DriveRate,
    WatchdogTime,
    Direction,
    OpenDrain,
    Inversion,
    TimeAndDirection,
    TimeAndDriveRate,
    Restart,
}

const CHANGES: [Change; 13] = [
    Change::Nothing,
    Change::Led,
    Change::Filter,
    Change::Sampling,
    Change::PwmFrequency,
    Change::DriveRate,
    Change::WatchdogTime,
    Change::Direction,
    Change::OpenDrain,
    Change::Inversion,
    Change::TimeAndDirection,
    Change::TimeAndDriveRate,
    Change::Restart,
];

impl Change {
    fn make<B: RegisterBus + Clock>(self, driver: &mut Driver<B>) {
        match self {
            Self::Restart => assert!(driver.restart((0, 0))),
            Self::TimeAndDirection | Self::TimeAndDriveRate => Self::WatchdogTime.make(driver),
            _ => {}
        }
        let pins = driver.pins_mut();
        match self {
            Self::Nothing | Self::Restart => {}
            Self::Led => set(pins, "led.CR01", true),
            Self::Filter => set_param(pins, "inmux.00.fast_scans", 9_u32),
            Self::Sampling => set(pins, "encoder.muxed-sample-frequency", 3_000_000_u32),
            Self::PwmFrequency => set_param(pins, "pwmgen.pwm_frequency", 24_000_u32),
            Self::DriveRate | Self::TimeAndDriveRate => set(pins, "ssr.00.rate", 500_000_u32),
            Self::WatchdogTime => set_param(pins, "watchdog.timeout_ns", 6_000_000_u32),
            Self::Direction | Self::TimeAndDirection => {
                set_param(pins, "gpio.040.is_output", true);
            }
            Self::OpenDrain => set_param(pins, "gpio.041.is_opendrain", true),
            Self::Inversion => set_param(pins, "gpio.040.invert_output", true),
        }
    }

    /// True if the change contains what pins drive. A board cannot be made to reject it when it has
    /// lost its set-up within the preceding microsecond; then the pins must not be driven for
    /// longer.
    fn drives_pins(self) -> bool {
        matches!(
            self,
            Self::Direction | Self::TimeAndDirection | Self::OpenDrain
        )
    }
}

fn set<T: Value>(pins: &mut Pins, name: &str, value: T) {
    let pin: Output<T> = pins.output(&format!("{BOARD}.{name}")).expect(name);
    pins.set(pin, value);
}

fn set_param<T: Value>(pins: &mut Pins, name: &str, value: T) {
    let param = pins.parameter(&format!("{BOARD}.{name}")).expect(name);
    pins.set_param::<T>(param, value).expect("in range");
}

fn world(remotes: bool) -> SimFpga {
    if remotes {
        return machines::six_axes_7i97(Motor::default());
    }
    let mut fpga = machines::i7i97(1);
    machines::wire_7i97(&mut fpga, |_| Motor::default());
    fpga
}

struct Machine<B: World> {
    driver: Driver<B>,
    watch: Watch,
    counts: [Input<i32>; 6],
    name: String,
}

impl<B: World> Machine<B> {
    /// A machine that runs and drives, with counts that are far from 0.
    fn running(bus: B, remotes: bool, name: String) -> Self {
        let serial = if remotes {
            SerialConfig::default()
        } else {
            SerialConfig {
                channels: [].into(),
            }
        };
        let driver = start(bus, |s| s.serial_ports = [(0, serial)].into());
        let driver = driver.expect("the board is complete");
        let count = |n| format!("{BOARD}.encoder.{n:02}.count");
        let counts = [0, 1, 2, 3, 4, 5].map(|n| driver.pins().input(&count(n)).expect("a pin"));
        let mut this = Self {
            driver,
            watch: Watch::default(),
            counts,
            name,
        };
        this.turn(Some(30.0));
        this.command();
        for _ in 0..20 {
            this.cycle();
        }
        this.turn(Some(0.0));
        for _ in 0..3 {
            this.cycle();
        }
        assert!(
            this.counts()
                .iter()
                .all(|count| count.is_some_and(|c| c.abs() > 100))
        );
        this.assert_drives();
        this.watch = Watch::since_a_loss(this.fpga());
        this
    }

    fn turn(&mut self, velocity: Option<f64>) {
        for axis in 0..6 {
            self.fpga()
                .motor(axis)
                .expect("an axis")
                .turn_by_hand(velocity);
        }
    }

    fn fpga(&mut self) -> &mut SimFpga {
        self.driver.bus_mut().fpga()
    }

    fn command(&mut self) {
        let pins = self.driver.pins_mut();
        for n in 0..6 {
            set(pins, &format!("pwmgen.{n:02}.value"), 5.0);
            set(pins, &format!("pwmgen.{n:02}.enable"), true);
            set(pins, &format!("ssr.00.out-{n:02}"), true);
        }
    }

    fn assert_drives(&mut self) {
        for n in 0..6 {
            let drive = self.fpga().analog_output(n);
            assert!(
                drive.enabled && (drive.volts - 5.0).abs() < 0.1,
                "{}: {drive:?}",
                self.name
            );
            assert!(self.fpga().isolated_output(n), "{}: output {n}", self.name);
        }
    }

    fn counts(&self) -> [Option<i32>; 6] {
        self.counts.map(|pin| {
            let reading = self.driver.pins().read(pin);
            reading.valid.then_some(reading.value)
        })
    }

    fn rest(&mut self) {
        let bus = self.driver.bus_mut();
        let rest = 1_000_000 - bus.now().as_nanos() % 1_000_000;
        bus.wait(Duration::from_nanos(rest));
    }

    fn cycle(&mut self) {
        let _ = self.driver.read();
        let _ = self.driver.write();
        self.rest();
    }

    /// Checks a board that has lost its set-up, or will lose it in the next cycle.
    fn must_fall(mut self, before: [Option<i32>; 6], drives_pins: bool) {
        let mut noticed = None;
        for n in 0..100 {
            let _ = self.driver.read();
            for (count, before) in self.counts().into_iter().zip(before) {
                assert!(
                    count.is_none() || count == before,
                    "{}, read {n}: {count:?}",
                    self.name
                );
            }
            if self.driver.board_state() != BoardState::Running {
                noticed.get_or_insert(n);
                assert_eq!(self.counts(), [None; 6], "{}, read {n}", self.name);
            }
            self.command();
            let _ = self.driver.write();
            self.rest();
        }
        assert!(
            noticed.is_some_and(|n| n < 2),
            "{}: noticed in read {noticed:?}",
            self.name
        );
        let seen = std::mem::take(&mut *self.watch.seen());
        assert!(
            seen.switched_on.is_empty(),
            "{}: {:#?}",
            self.name,
            seen.switched_on
        );
        if drives_pins {
            assert!(seen.driven.len() <= 2, "{}: {:#?}", self.name, seen.driven);
        } else {
            assert!(seen.driven.is_empty(), "{}: {:#?}", self.name, seen.driven);
        }
        self.comes_back();
    }

    fn comes_back(mut self) {
        for _ in 0..3 {
            let _ = self.driver.rearm().expect("the bus does not fail");
            self.cycle();
        }
        let drive = self.fpga().analog_output(0);
        assert!(
            !drive.enabled,
            "{}: nothing set since: {drive:?}",
            self.name
        );
        self.command();
        for _ in 0..3 {
            self.cycle();
        }
        assert_eq!(
            self.driver.board_state(),
            BoardState::Running,
            "{}",
            self.name
        );
        self.assert_drives();
        let before = self.counts();
        assert!(
            before.iter().all(Option::is_some),
            "{}: {before:?}",
            self.name
        );
        self.turn(Some(30.0));
        for _ in 0..20 {
            self.cycle();
        }
        for (now, before) in self.counts().into_iter().zip(before) {
            let moved = now.zip(before).map(|(now, before)| (now - before).abs());
            assert!(
                moved.is_some_and(|moved| moved > 100),
                "{}: {moved:?}",
                self.name
            );
        }
    }
}

/// A reset this number of nanoseconds after the read begins, in a cycle whose write holds `change`.
fn reset_at<B: World>(bus: B, remotes: bool, change: Change, delay: u64, name: String) {
    let mut machine = Machine::running(bus, remotes, name);
    let before = machine.counts();
    let at = machine.driver.bus_mut().now().as_nanos() + delay;
    machine.watch.seen().reset_at = Some(at);
    let _ = machine.driver.read();
    for (count, before) in machine.counts().into_iter().zip(before) {
        assert!(
            count.is_none() || count == before,
            "{}: {count:?}",
            machine.name
        );
    }
    change.make(&mut machine.driver);
    machine.command();
    let _ = machine.driver.write();
    machine.rest();
    machine.must_fall(before, change.drives_pins());
}

#[test]
fn reset_at_any_moment_of_a_cycle_is_detected_for_any_write() {
    for (n, change) in CHANGES.into_iter().enumerate() {
        let remotes = change == Change::Restart;
        let mut probe = Machine::running(world(remotes), remotes, "probe".into());
        let begin = SimFpga::now(probe.fpga());
        let _ = probe.driver.read();
        change.make(&mut probe.driver);
        let _ = probe.driver.write();
        let cycle = SimFpga::now(probe.fpga()) - begin;
        let mut delay = 30 * n as u64;
        while delay < cycle + 1_000 {
            let name = format!("{change:?}, reset after {delay} of {cycle} ns");
            reset_at(world(remotes), remotes, change, delay, name);
            delay += if remotes { 7_300 } else { 1_730 };
        }
    }
}

#[test]
fn reset_at_any_moment_over_ethernet_is_detected_for_any_write() {
    for (n, change) in CHANGES.into_iter().enumerate() {
        let remotes = change == Change::Restart;
        let mut delay = 3_000 * n as u64;
        while delay < 300_000 {
            let name = format!("{change:?}, reset after {delay} ns");
            reset_at(ethernet::bus(world(remotes)), remotes, change, delay, name);
            delay += if remotes { 70_000 } else { 29_000 };
        }
    }
}

#[test]
fn reset_right_after_the_set_up_was_restored_is_seen_as_well() {
    // From the first write of the set-up on, which follows a read of the cookie, of the firmware's
    // description and of all registers: an earlier loss is repaired by the set-up itself.
    let mut machine = Machine::running(world(false), false, "a look".into());
    let begin = SimFpga::now(machine.fpga());
    HostMot2::identify(machine.fpga()).expect("a firmware");
    let looks = SimFpga::now(machine.fpga()) - begin + 12 * DEFAULT_ACCESS_COST;
    machine.fpga().reload();
    let _ = machine.driver.read();
    let begin = SimFpga::now(machine.fpga());
    let _ = machine.driver.read();
    let looks = looks + SimFpga::now(machine.fpga()) - begin;
    for delay in (looks..looks + 40_000).step_by(1_300) {
        let mut machine = Machine::running(world(false), false, format!("{delay} ns"));
        let before = machine.counts();
        machine.fpga().reload();
        machine.cycle();
        assert_eq!(machine.driver.board_state(), BoardState::Reset, "{delay}");
        let at = SimFpga::now(machine.fpga()) + delay;
        machine.watch.seen().reset_at = Some(at);
        let _ = machine.driver.rearm().expect("the bus does not fail");
        // In the middle of the set-up: the rest of it drives pins, but not for long.
        let mut seen = machine.watch.seen();
        assert!(
            seen.driven.len() <= SET_UP_AFTER_DRIVE,
            "{delay}: {:#?}",
            seen.driven
        );
        (seen.driven, seen.switched_on) = Default::default();
        drop(seen);
        let is_driven = (0..PINS).any(|pin| machine.fpga().driven_level(pin).is_some());
        assert!(
            !is_driven || machine.driver.board_state() == BoardState::Running,
            "{delay}"
        );
        machine.command();
        let _ = machine.driver.write();
        machine.rest();
        machine.must_fall(before, false);
    }
}

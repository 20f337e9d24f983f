//! The driver on simulated boards in mapped memory, in real time.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use allocation_counter::measure;
use mesa_hal::bus::{BusErrorKind, Clock};
use mesa_hal::driver::Events;
use mesa_hal::modules::stepgen::{StepgenPins, Stepgens};
use mesa_hal::{CycleError, Driver, Settings};
use mesa_hal_sim::devices::{SignalValue, find, find_mut};
use mesa_hal_sim::{Motor, SimFpga, Stepper, machines};
use mesa_pci::PciBus;
use mesa_pci::simulated::SimulatedRegisters;

use crate::folder::{Folder, Fpga, Served, device};
use crate::tools::realtime_thread;

/// A board that the test can look at while it is served.
#[derive(Clone)]
struct Seen(Arc<Mutex<Fpga>>);

impl Seen {
    fn with<T>(&self, look: impl FnOnce(&mut SimFpga) -> T) -> T {
        look(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner).0)
    }

    fn output(&self, channel: usize, output: usize) -> bool {
        let output = format!("output-{output:02}");
        self.with(|fpga| {
            let device = find(fpga.remote(0, channel).expect("a remote"));
            let outputs = device.expect("a device").outputs();
            outputs.contains(&(output, SignalValue::Bool(true)))
        })
    }

    fn set_input(&self, channel: usize, input: usize, on: bool) {
        self.with(|fpga| {
            let device = find_mut(fpga.remote_mut(0, channel).expect("a remote"));
            device
                .expect("a device")
                .set_input(input, on)
                .expect("an input");
        });
    }
}

impl SimulatedRegisters for Seen {
    fn advance_to(&mut self, nanos: u64) {
        self.with(|fpga| fpga.advance_to(nanos));
    }

    fn read(&mut self, address: u16) -> u32 {
        self.with(|fpga| fpga.read_register(address))
    }

    fn write(&mut self, address: u16, value: u32) {
        self.with(|fpga| fpga.write_register(address, value));
    }
}

/// Nothing is given up because a busy computer lets the simulator wait. A remote whose watchdog has
/// bitten meanwhile comes back, and its outputs are armed again.
fn settings() -> Settings {
    let mut settings = Settings {
        watchdog: Some(Duration::from_secs(4)),
        ..Settings::default()
    };
    settings.fault_policy.stale_after = 1000;
    settings
}

struct Bench {
    driver: Driver<PciBus>,
    /// For the reason of a failure.
    events: Events,
    board: Seen,
    served: Served<Seen>,
    _root: Folder,
}

impl Bench {
    fn start() -> Self {
        let mut fpga = machines::i5i25_7i77();
        machines::plug_7i77(&mut fpga, 0, 0);
        Self::with(fpga)
    }

    fn with(fpga: SimFpga) -> Self {
        realtime_thread();
        let root = Folder::new();
        let board = Seen(Arc::new(Mutex::new(Fpga(fpga))));
        let served = Served::start(root.path(), board.clone());
        let bus = device(root.path()).open().expect("a board");
        let driver = Driver::start(bus, settings()).expect("a machine");
        let events = driver.events();
        Self {
            driver,
            events,
            board,
            served,
            _root: root,
        }
    }

    /// Cycles until `done`; panics after 20 s.
    fn until(&mut self, what: &str, mut done: impl FnMut(&mut Self) -> bool) {
        for _ in 0..20_000 {
            let _ = self.driver.read().expect("read");
            if done(self) {
                return;
            }
            let _ = self.driver.rearm().expect("rearmed");
            self.driver.write().expect("written");
            self.driver.bus_mut().wait(Duration::from_millis(1));
        }
        let events: Vec<_> = self.events.by_ref().collect();
        panic!("not within 20,000 cycles: {what}; {events:#?}");
    }
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn a_7i77_on_a_5i25_follows_its_outputs_and_shows_its_inputs() {
    let mut bench = Bench::start();
    let pins = bench.driver.pins();
    let output = pins.output::<bool>("hm2_5i25.0.7i77.0.0.output-03");
    let output = output.expect("an output");
    let input = pins.input::<bool>("hm2_5i25.0.7i77.0.0.input-05");
    let input = input.expect("an input");
    for on in [true, false, true] {
        // Inputs and outputs share their registers, so that the same word is often there already.
        bench.board.set_input(0, 5, on);
        bench.until("an output and an input", |bench| {
            bench.driver.pins_mut().set(output, on);
            let seen = bench.driver.pins().read(input);
            bench.board.output(0, 3) == on && seen.valid && seen.value == on
        });
    }
    let (bus, result) = bench.driver.shutdown();
    result.expect("everything is off");
    assert!(!bench.board.output(0, 3));
    drop(bus);
    drop(bench.served.end());
}

/// Pulses are counted, and not what a rotor makes of them: on a busy computer a rate is in force
/// for longer than a period, and its correction is more than a motor follows.
#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn steppers_of_a_7i76_beside_a_7i77_arrive_at_their_commands() {
    let board = machines::eleven_axes_5i25(Motor::default(), Stepper::default());
    let mut bench = Bench::with(board);
    assert_eq!(bench.driver.remarks(), []);
    let module = bench.driver.modules::<Stepgens>().next();
    let generators: Vec<StepgenPins> = module.expect("generators").pins().collect();
    assert_eq!(generators.len(), 5);
    for one in &generators {
        let pins = bench.driver.pins_mut();
        for (param, value) in [
            (one.position_scale, 1000.0),
            (one.maxvel, 2.0),
            (one.maxaccel, 10.0),
        ] {
            pins.set_param(param, value).expect("a value");
        }
        for (param, ns) in [
            (one.steplen, 5_000),
            (one.stepspace, 5_000),
            (one.dirsetup, 10_000),
            (one.dirhold, 10_000),
        ] {
            pins.set_param(param, ns).expect("a time");
        }
    }
    for target in [0.5, -0.25] {
        bench.until("all are there", |bench| {
            let pins = bench.driver.pins_mut();
            for (n, one) in (0..).zip(&generators) {
                pins.set(one.enable, true);
                pins.set(one.position_cmd, target + 0.01 * f64::from(n));
            }
            (0..).zip(&generators).all(|(n, one)| {
                let shown = bench.driver.pins().read(one.position_fb);
                let motor = bench
                    .board
                    .with(|fpga| fpga.stepper(6 + n).map(|motor| *motor));
                let command = target + 0.01 * n as f64;
                // A step is 0.001; the motor has not made it if less than a sub-count is missing.
                let near = |position: f64| (position - command).abs() < 0.0015;
                let motor = motor.expect("a motor");
                shown.valid && near(shown.value) && near(motor.commanded() as f64 / 1000.0)
            })
        });
    }
    let (_, result) = bench.driver.shutdown();
    result.expect("everything is off");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn vanished_board_is_a_cycle_error_and_changes_no_input() {
    let mut bench = Bench::start();
    let [on, off] = ["05", "06"].map(|number| {
        let name = format!("hm2_5i25.0.7i77.0.0.input-{number}");
        bench.driver.pins().input::<bool>(&name).expect("an input")
    });
    bench.board.set_input(0, 5, true);
    bench.until("an input", |bench| {
        let seen = [on, off].map(|input| bench.driver.pins().read(input));
        seen.iter().all(|seen| seen.valid) && seen.map(|seen| seen.value) == [true, false]
    });
    bench.served.unplug(true);
    let error = (0..20_000).find_map(|_| {
        let error = bench.driver.read().err();
        bench.driver.bus_mut().wait(Duration::from_millis(1));
        error
    });
    match error {
        Some(CycleError::Read { source, .. }) => {
            assert_eq!(source.kind(), BusErrorKind::Lost);
        }
        other => panic!("{other:?}"),
    }
    // All ones would be true, and its age that of this cycle.
    let seen = [on, off].map(|input| bench.driver.pins().read(input));
    assert_eq!(seen.map(|seen| seen.value), [true, false]);
    assert!(seen.iter().all(|seen| seen.age.cycles > 0));
    let stale_after = settings().fault_policy.stale_after;
    for _ in 0..=stale_after {
        assert!(bench.driver.read().is_err());
    }
    let seen = bench.driver.pins().read(on);
    assert!(!seen.valid && seen.value, "{seen:?}");
}

#[cfg_attr(not(feature = "interop"), ignore = "real clock: --all-features")]
#[test]
fn cycle_makes_no_allocation_on_the_bus() {
    let mut bench = Bench::start();
    let mut cycles = 0;
    bench.until("ten cycles", |_| {
        cycles += 1;
        cycles > 10
    });
    for _ in 0..100 {
        let driver = &mut bench.driver;
        let info = measure(|| {
            let _ = driver.read().expect("read");
            driver.write().expect("written");
        });
        assert_eq!(info.count_total, 0);
        driver.bus_mut().wait(Duration::from_millis(1));
    }
}

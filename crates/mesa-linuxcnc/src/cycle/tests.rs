//! A board's cycle on virtual time, over a HAL that is a vector.

mod bus_log;
mod fresh;
mod manual;
mod messages;
mod outages;
mod page_faults;
mod period;
mod positions;

use std::collections::HashMap;
use std::sync::{Arc, Mutex};

use mesa_hal::Settings;
use mesa_hal::bus::{BusErrorKind, Fault};
use mesa_hal::driver::BoardState;
use mesa_hal::transport::Faulty;
use mesa_hal_sim::devices::{SignalValue, find, find_cable, find_mut};
use mesa_hal_sim::{Motor, SimFpga, machines};

use super::*;
use crate::config::Config;
use crate::table::tests::FakeMemory;
use page_faults::PageFaults;

const PERIOD: Duration = Duration::from_millis(1);
const FIELD: usize = 0;
const OUTPUTS: usize = 2;

/// Messages so far.
type Heard = Arc<Mutex<Vec<(Level, String)>>>;

struct Bench {
    cycle: Cycle<Faulty<SimFpga>, FakeMemory>,
    numbers: HashMap<String, usize>,
    heard: Heard,
    period: Duration,
}

/// The cycle of a driver, the numbers of its pins in HAL, and its messages.
/// The settings of a word of `config=`.
fn settings(config: &str) -> Settings {
    Config::parse(config).expect(config).settings
}

fn cycle_of<B: RegisterBus + Clock>(
    driver: Driver<B>,
) -> (Cycle<B, FakeMemory>, HashMap<String, usize>, Heard) {
    let wanted = wanted(&driver);
    let numbers = wanted.iter().map(|pin| pin.name.clone()).zip(0..);
    let heard = Heard::default();
    let copy = heard.clone();
    let log = Log::new(
        "board",
        Box::new(move |level, text| {
            let text = text.to_str().expect("UTF-8").to_owned();
            copy.lock().expect("no panic").push((level, text));
        }),
    );
    let memory = FakeMemory(vec![0; wanted.len()]);
    let mut cycle = Cycle::new(driver, memory, log);
    cycle.look();
    (cycle, numbers.collect(), heard)
}

impl Bench {
    /// A 7I97 with a 7I77 and a 7I72.
    fn new() -> Self {
        Self::with(Settings::default())
    }

    fn with(settings: Settings) -> Self {
        Self::on(machines::six_axes_7i97(Motor::default()), settings)
    }

    fn on(fpga: SimFpga, settings: Settings) -> Self {
        let bus = Faulty::new(fpga, 1);
        let driver = Driver::start(bus, settings).expect("the machine is complete");
        let (cycle, numbers, heard) = cycle_of(driver);
        Self {
            cycle,
            numbers,
            heard,
            period: PERIOD,
        }
    }

    /// A bench whose thread has run.
    fn running() -> Self {
        let mut bench = Self::new();
        bench.run(100);
        bench
    }

    fn number(&self, name: &str) -> usize {
        self.numbers[&format!("hm2_7i97.0.{name}")]
    }

    fn bits(&self, name: &str) -> u64 {
        self.cycle.memory.load(self.number(name))
    }

    fn is_on(&self, name: &str) -> bool {
        self.bits(name) != 0
    }

    /// `setp`.
    fn set<T: Value>(&mut self, name: &str, value: T) {
        let number = self.number(name);
        self.cycle.memory.store(number, value.to_bits());
    }

    fn fpga(&mut self) -> &mut SimFpga {
        &mut self.cycle.driver.bus_mut().inner
    }

    fn lose_packets(&mut self) {
        let bus = self.cycle.driver.bus_mut();
        bus.fail_randomly(Fault::NotExecuted(BusErrorKind::Lost), 1.0);
    }

    fn wait(&mut self, time: Duration) {
        self.cycle.driver.bus_mut().wait(time);
    }

    fn run(&mut self, cycles: u32) {
        for _ in 0..cycles {
            self.cycle.read(self.period);
            self.cycle.write(self.period);
            self.wait(self.period);
        }
    }

    /// State of a digital output at its terminal.
    fn output(&mut self, channel: usize, number: usize) -> bool {
        let device = find(self.fpga().remote(0, channel).expect("a remote")).expect("a device");
        let (_, value) = device.outputs()[number].clone();
        value == SignalValue::Bool(true)
    }

    fn pull(&mut self, channel: usize) {
        let remote = self.fpga().remote_mut(0, channel).expect("a remote");
        find_cable(remote).expect("a cable").unplug();
    }

    fn put_back(&mut self, channel: usize) {
        let remote = self.fpga().remote_mut(0, channel).expect("a remote");
        find_cable(remote).expect("a cable").replug();
    }

    /// Outputs 3 of the 7I77, 17 of the 7I72, and 2 of the board are on.
    fn switch_on(&mut self) {
        self.set("7i77.0.0.output-03", true);
        self.set("7i72.0.2.output-17", true);
        self.set("ssr.00.out-02", true);
        self.run(5);
        assert_eq!(self.outputs(), [true; 3]);
    }

    fn outputs(&mut self) -> [bool; 3] {
        let board = self.fpga().isolated_output(2);
        [self.output(FIELD, 3), self.output(OUTPUTS, 17), board]
    }

    fn heard(&self, level: Level) -> Vec<String> {
        let heard = self.heard.lock().expect("no panic");
        let heard = heard.iter().filter(|(of, _)| *of == level);
        heard.map(|(_, text)| text.clone()).collect()
    }
}

/// Number of exchanges that the bus was asked for.
fn exchanges(bench: &Bench) -> u64 {
    bench.cycle.driver.bus().exchanges()
}

#[test]
fn hal_has_the_values_of_the_driver_at_first() {
    let bench = Bench::new();
    let pins = bench.cycle.driver.pins();
    assert!(bench.numbers.len() > 700);
    for (info, id) in pins.infos().iter().zip(pins.ids()) {
        let bits = bench.cycle.memory.load(bench.numbers[&info.name]);
        let reading = pins.read_any(id);
        if reading.valid || info.role != Role::Input {
            assert_eq!(bits, reading.value.bits, "{}", info.name);
        }
    }
    assert!(bench.is_on("gpio.050.in"), "a pull-up");
}

#[test]
fn names_are_there_once_and_fit_hal() {
    let bench = Bench::new();
    let wanted = wanted(&bench.cycle.driver);
    assert_eq!(wanted.len(), bench.numbers.len());
    assert!(
        wanted
            .iter()
            .all(|pin| pin.name.len() <= mesa_hal::hal::MAX_NAME)
    );
}

#[test]
fn outputs_follow_hal_and_inputs_come_to_it() {
    let mut bench = Bench::running();
    bench.switch_on();
    let remote = bench.fpga().remote_mut(0, FIELD).expect("a remote");
    let device = find_mut(remote).expect("a device");
    device.set_input(7, true).expect("an input");
    bench.run(5);
    assert!(bench.is_on("7i77.0.0.input-07"));
    assert!(!bench.is_on("7i77.0.0.input-07-not"));
    for name in ["valid", "7i77.0.0.valid", "7i72.0.2.armed"] {
        assert!(bench.is_on(name), "{name}");
    }
    bench.set("7i77.0.0.output-03", false);
    bench.run(3);
    assert_eq!(bench.outputs(), [false, true, true]);
    assert_eq!(bench.heard(Level::Error), [""; 0]);
}

#[test]
fn long_wait_before_the_thread_starts_is_no_fault() {
    let mut bench = Bench::new();
    bench.set("7i72.0.2.output-17", true);
    // Much longer than the watchdogs of the remotes.
    bench.wait(Duration::from_secs(60));
    bench.run(1_000);
    bench.switch_on();
    assert_eq!(bench.heard(Level::Error), [""; 0]);
}

#[test]
fn period_of_the_thread_is_the_drivers() {
    let mut bench = Bench::new();
    bench.period = Duration::from_millis(2);
    bench.run(1);
    assert_eq!(bench.cycle.driver.period(), bench.period);
    assert_eq!(bench.bits("watchdog.timeout_ns"), 10_000_000);

    let mut bench = Bench::new();
    bench.set("watchdog.timeout_ns", 50_000_000_u32);
    bench.period = Duration::from_millis(2);
    bench.run(1);
    assert_eq!(bench.bits("watchdog.timeout_ns"), 50_000_000);
}

/// As hostmot2 does, with the allowed range.
#[test]
fn impossible_value_is_corrected_in_hal_with_a_message() {
    let mut bench = Bench::running();
    bench.set("pwmgen.00.output-type", 5_i32);
    bench.set("pwmgen.pwm_frequency", 10_000_000_u32);
    bench.set("pwmgen.pdm_frequency", 0_u32);
    bench.run(5);
    for (name, value, allowed) in [
        ("pwmgen.00.output-type", 1, "1 to 4"),
        ("pwmgen.pwm_frequency", 390_619, "1 to 390619"),
        ("pwmgen.pdm_frequency", 1, "1 to 199996948"),
    ] {
        assert_eq!(bench.bits(name), value, "{name}");
        let errors = bench.heard(Level::Error);
        let about = |text: &&String| text.contains(name) && text.contains(allowed);
        assert_eq!(errors.iter().filter(about).count(), 1, "{errors:?}");
    }
}

/// The level of HAL's pin stays the same, and is no command of the new position.
#[test]
fn position_that_hal_repeats_is_no_new_command_after_a_reset() {
    let board = machines::i7i92_7i76();
    let settings = settings("num_stepgens=1 sserial_port_0=xxxxxxxx");
    let driver = Driver::start(Faulty::new(board, 1), settings);
    let (cycle, numbers, heard) = cycle_of(driver.expect("the machine is complete"));
    let mut bench = Bench {
        cycle,
        numbers,
        heard,
        period: PERIOD,
    };
    let number =
        |bench: &Bench, name: &str| bench.numbers[&format!("hm2_7i92.0.stepgen.00.{name}")];
    let set = |bench: &mut Bench, name: &str, bits: u64| {
        let number = number(bench, name);
        bench.cycle.memory.store(number, bits);
    };
    for (name, value) in [
        ("position-scale", 1_000.0),
        ("maxvel", 20.0),
        ("maxaccel", 100.0),
    ] {
        set(&mut bench, name, f64::to_bits(value));
    }
    for name in ["steplen", "stepspace", "dirsetup", "dirhold"] {
        set(&mut bench, name, 5_000);
    }
    bench.run(20);
    set(&mut bench, "enable", 1);
    set(&mut bench, "position-cmd", 1.0_f64.to_bits());
    bench.run(1_000);
    let place =
        |bench: &Bench| f64::from_bits(bench.cycle.memory.load(number(bench, "position-fb")));
    assert!((place(&bench) - 1.0).abs() < 1e-3);
    for resets in [1, 0] {
        set(&mut bench, "position-reset", resets);
        bench.run(500);
        assert!(place(&bench).abs() < 1e-3, "{}", place(&bench));
    }
    // The same value after another one is a command.
    for command in [0.5_f64, 1.0] {
        set(&mut bench, "position-cmd", command.to_bits());
        bench.run(1_000);
        assert!((place(&bench) - command).abs() < 1e-3, "{}", place(&bench));
    }
}

#[test]
fn inputs_that_are_not_valid_keep_their_last_values() {
    let mut bench = Bench::running();
    let remote = bench.fpga().remote_mut(0, FIELD).expect("a remote");
    find_mut(remote)
        .expect("a device")
        .set_input(7, true)
        .expect("an input");
    bench.run(5);
    bench.pull(FIELD);
    bench.run(200);
    assert!(!bench.is_on("7i77.0.0.valid"));
    assert!(bench.is_on("7i77.0.0.input-07"));
}

#[test]
fn setting_that_cannot_be_is_put_back_with_its_name() {
    let mut bench = Bench::running();
    let before = bench.bits("encoder.00.scale");
    bench.set("encoder.00.scale", 0.0);
    bench.run(5);
    assert_eq!(bench.bits("encoder.00.scale"), before);
    let errors = bench.heard(Level::Error);
    assert_eq!(errors.len(), 1);
    assert!(
        errors[0].contains("hm2_7i97.0.encoder.00.scale"),
        "{errors:?}"
    );
}

/// Page faults that the kernel may cause in memory that is not locked, as this test's: it moves
/// pages. A cycle that met one each time would have thousands.
const UNLOCKED: u64 = 20;

/// Page faults are those of the second round: the first one meets each page of code and memory for
/// the first time, where `rtapi_app` has locked them.
#[test]
fn cycle_neither_allocates_nor_faults_as_a_card_is_replugged() {
    let mut bench = Bench::running();
    bench.switch_on();
    // Messages of the test allocate, those of LinuxCNC do not.
    bench.cycle.log = Log::new("board", Box::new(|_, _| {}));
    let faults = PageFaults::of_this_thread();
    for round in 0..2 {
        let (mut allocations, mut page_faults) = (0, 0);
        for cycle in 0..20_000 {
            match cycle {
                1_000 => bench.pull(OUTPUTS),
                3_000 => bench.put_back(OUTPUTS),
                12_000 => bench.set("7i72.0.2.rearm", true),
                12_500 => bench.set("7i72.0.2.rearm", false),
                13_000 => bench.set("encoder.00.scale", 0.0),
                14_000 => bench.wait(Duration::from_secs(1)),
                15_000 => bench.set("watchdog.has_bit", false),
                // It is away, and is then followed until the user acts.
                16_000 => bench.lose_packets(),
                16_500 => bench.cycle.driver.bus_mut().heal(),
                18_000 => bench.set("io_error", false),
                _ => {}
            }
            let info = allocation_counter::measure(|| {
                let before = faults.count();
                bench.cycle.read(PERIOD);
                bench.cycle.write(PERIOD);
                page_faults += faults.count() - before;
            });
            allocations += info.count_total;
            bench.wait(PERIOD);
        }
        assert_eq!(allocations, 0);
        assert_eq!(bench.outputs(), [true; 3]);
        println!("round {round}: {page_faults} page faults");
        assert!(round == 0 || page_faults <= UNLOCKED, "{page_faults}");
    }
}

#[test]
fn end_switches_everything_off() {
    let mut bench = Bench::running();
    bench.switch_on();
    let heard = bench.heard.clone();
    bench.cycle.stop();
    let heard = heard.lock().expect("no panic");
    assert!(
        heard.iter().all(|(level, _)| *level != Level::Error),
        "{heard:?}"
    );
}

#[test]
fn remote_parameter_is_written_at_the_next_rising_edge_of_run() {
    const NAME: &str = "7i72.0.2.nvwatchdogtimeout";
    let mut bench = Bench::running();
    bench.switch_on();
    bench.set(NAME, 100_u32);
    bench.run(50);
    let kept = |bench: &mut Bench| {
        let remote = bench.fpga().remote(0, OUTPUTS).expect("a remote");
        let parameters = find(remote).expect("a device").parameters();
        let found = parameters
            .into_iter()
            .find(|(name, _)| name == "nvwatchdogtimeout");
        found.expect("a parameter").1
    };
    assert_eq!((kept(&mut bench), bench.bits(NAME)), (50, 100));
    bench.set("sserial.port-0.run", false);
    bench.run(100);
    bench.set("sserial.port-0.run", true);
    bench.run(300);
    assert_eq!((kept(&mut bench), bench.bits(NAME)), (100, 100));
    assert_eq!(bench.outputs(), [true; 3]);
    // What the remote cannot have is put back at once.
    bench.set(NAME, 70_000_u32);
    bench.run(2);
    assert_eq!(bench.bits(NAME), 100);
    let errors = bench.heard(Level::Error);
    assert!(
        errors
            .last()
            .is_some_and(|error| error.contains("70000 does not fit")),
        "{errors:?}"
    );
}

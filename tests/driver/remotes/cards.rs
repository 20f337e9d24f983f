//! Each card of public machines that is newer in the simulator, in each of its modes: found,
//! started, with the names of its pins, each input and output through in its direction. FACTS 8.7
//! and 8.8 say what is known of a card, and what is assumed.

use std::any::Any;
use std::collections::BTreeSet;

use mesa_hal::Settings;
use mesa_hal::driver::{Driver, RemoteState, SerialConfig};
use mesa_hal::hal::{PinId, Role};
use mesa_hal_sim::devices::{
    DescriptionError, Device, FieldIo, Outputs48, Plain, SignalValue, find, find_mut,
};
use mesa_hal_sim::remote::SimRemote;
use mesa_hal_sim::wire::RemoteEnd;
use mesa_hal_sim::{SimFpga, machines};

type End = Result<Box<dyn RemoteEnd>, DescriptionError>;

/// A card.
struct Card {
    make: fn() -> End,
    /// Its name in pins.
    name: &'static str,
    /// The elements of each software mode: `name:N` are N bits `name-00` and so on, `name*N` are
    /// the values `name0` and so on, with the greatest value of an analog one behind `=`.
    modes: &'static [&'static str],
}

macro_rules! card {
    ($make:expr, $name:literal, $modes:expr) => {
        Card {
            make: || Ok(Box::new($make?)),
            name: $name,
            modes: &$modes,
        }
    };
}

const MODES_7I84: [&str; 3] = [
    "input:32 output:16",
    "input:32 output:16 analogin*4=36.3 fieldvoltage=36.3",
    "input:32 output:16 analogin*4=36.3 enc*2",
];

const MODES_7I76: [&str; 3] = [
    "input:32 output:16 spinout=100 spinena spindir",
    "input:32 output:16 spinout=100 spinena spindir analogin*4=36.3",
    "input:32 output:16 spinout=100 spinena spindir analogin*4=36.3 fieldvoltage=36.3 enc*2",
];

const CARDS: [Card; 12] = [
    card!(
        Plain::i7i69(),
        "7i69",
        [
            "input:48 output:48",
            "input:48",
            "output:48",
            "input:24 output:24",
            "input:48 output:48 enc*4",
        ]
    ),
    card!(
        Plain::i7i70(),
        "7i70",
        [
            "input:48",
            "input:48 analog*6=36.3",
            "input:48 fieldvoltage=36.3"
        ]
    ),
    card!(
        Outputs48::i7i71(),
        "7i71",
        ["output:48", "output:48 fieldvoltage=36.3"]
    ),
    card!(
        Plain::i7i73(),
        "7i73",
        [
            "input:24 output:22 enc*4",
            "input:24 output:22 enc*4 analogin*4=3.3",
            "input:24 output:22 enc*4 analogin*4=3.3",
        ]
    ),
    card!(
        Plain::i7i73_display(),
        "7i73",
        [
            "input:24 output:12 enc*4 display",
            "input:24 output:12 enc*4 analogin*4=3.3 display",
            "input:24 output:12 enc*4 analogin*4=3.3 display32",
        ]
    ),
    card!(FieldIo::i7i76_of_revision_14(), "7i76", MODES_7I76),
    card!(FieldIo::i7i76e(), "7i76", MODES_7I76),
    card!(FieldIo::i7i76eu(), "7i76", MODES_7I76),
    card!(FieldIo::i7i76u(), "7i76", MODES_7I76),
    card!(FieldIo::i7i84(), "7i84", MODES_7I84),
    card!(FieldIo::i7i84u(), "7i84", MODES_7I84),
    card!(Plain::i7i87(), "7i87", ["analogin*8=10"]),
];

/// A pin that a mode has.
struct Expected {
    name: String,
    /// The greatest value of an analog one.
    greatest: Option<f64>,
}

fn expected(elements: &str) -> Vec<Expected> {
    let mut all = Vec::new();
    for element in elements.split(' ') {
        let (element, greatest) = match element.split_once('=') {
            Some((element, greatest)) => (element, Some(greatest.parse().expect("a number"))),
            None => (element, None),
        };
        let number = |text: &str| text.parse::<u8>().expect("a number");
        let names: Vec<String> = match (element.split_once(':'), element.split_once('*')) {
            (Some((name, count)), _) => (0..number(count))
                .map(|n| format!("{name}-{n:02}"))
                .collect(),
            (_, Some((name, count))) => (0..number(count)).map(|n| format!("{name}{n}")).collect(),
            (None, None) => vec![element.to_owned()],
        };
        all.extend(names.into_iter().map(|name| Expected { name, greatest }));
    }
    all
}

/// A driver with the card on channel 2 of its port.
struct Bench {
    driver: Driver<SimFpga>,
    prefix: String,
}

const CHANNEL: usize = 2;

impl Bench {
    fn new(card: &Card, mode: usize) -> Self {
        let mut fpga = SimFpga::new(machines::firmware_serial(&[8]));
        fpga.plug(
            0,
            CHANNEL,
            Some((card.make)().expect("a valid description")),
        );
        let modes: SerialConfig = format!("xx{mode}xxxxx").parse().expect("modes");
        let settings = Settings {
            serial_ports: [(0, modes)].into(),
            ..Settings::default()
        };
        let driver = Driver::start(fpga, settings).expect("it starts");
        assert_eq!(driver.missing(), []);
        let remote = driver.ports()[0].remotes().next().expect("it is found");
        assert_eq!(remote.state, RemoteState::Running);
        assert_eq!(usize::from(remote.started.software_mode), mode);
        let prefix = remote.pins.prefix.clone();
        assert!(
            prefix.ends_with(&format!(".{}.0.{CHANNEL}", card.name)),
            "{prefix}"
        );
        let mut bench = Self { driver, prefix };
        let _ = bench.driver.rearm().expect("the bus works");
        bench.run();
        bench
    }

    /// Runs until inputs and outputs are through.
    fn run(&mut self) {
        for _ in 0..5 {
            let _ = self.driver.read().expect("the bus works");
            self.driver.write().expect("the bus works");
            let now = SimFpga::now(self.driver.bus());
            self.driver.bus_mut().advance_to(now + 1_000_000);
        }
    }

    /// The pins of the card without those that come with others: names, and true for outputs.
    fn names(&self) -> BTreeSet<(String, bool)> {
        let infos = self.driver.pins().infos().iter();
        let own = infos.filter(|info| !info.role.is_param());
        own.filter_map(|info| {
            let name = info.name.strip_prefix(&self.prefix)?.strip_prefix('.')?;
            let name = match name.split_once('.') {
                Some((encoder, "count")) => encoder,
                Some(_) => return None,
                None => name,
            };
            // Pins that each remote has.
            let is_of_all = ["failures", "restarts", "running"].contains(&name);
            let is_extra = is_of_all || name.starts_with("fault-") || name.ends_with("-not");
            (!is_extra).then(|| (name.to_owned(), info.role == Role::Output))
        })
        .collect()
    }

    fn id(&self, name: &str) -> PinId {
        let pin = format!("{}.{name}", self.prefix);
        self.driver.pins().id(&pin).expect("a pin")
    }

    fn number(&self, name: &str) -> f64 {
        let reading = self.driver.pins().read_any(self.id(name));
        assert!(reading.valid, "{name}");
        reading.value.to_string().parse().expect("a number")
    }

    fn is_on(&self, name: &str) -> bool {
        let reading = self.driver.pins().read_any(self.id(name));
        assert!(reading.valid, "{name}");
        reading.value == true.into()
    }

    fn set_on(&mut self, name: &str, on: bool) {
        let id = self.id(name);
        self.driver
            .pins_mut()
            .set_any(id, on.into())
            .expect("a bit");
    }

    fn end(&mut self) -> &mut dyn RemoteEnd {
        let end = self.driver.bus_mut().remote_mut(0, CHANNEL);
        end.expect("a remote")
    }

    /// What the outputs do at the terminals.
    fn outputs(&mut self) -> Vec<(String, SignalValue)> {
        find(self.end()).expect("a device").outputs()
    }

    fn output(&mut self, name: &str) -> f64 {
        let found = self.outputs().into_iter().find(|(found, _)| found == name);
        match found.expect("an output").1 {
            SignalValue::Volts(value) | SignalValue::Number(value) => value,
            SignalValue::Count(count) => count as f64,
            SignalValue::Bool(on) => f64::from(u8::from(on)),
        }
    }
}

/// Switches each digital output on alone.
fn digital_outputs(bench: &mut Bench, names: &[String]) {
    for on in names {
        bench.set_on(on, true);
        bench.run();
        let conducting = bench
            .outputs()
            .into_iter()
            .filter_map(|(name, value)| (value == SignalValue::Bool(true)).then_some(name));
        assert!(conducting.eq([on.clone()]), "{on} alone");
        bench.set_on(on, false);
    }
    bench.run();
}

/// Switches each digital input on alone.
fn digital_inputs(bench: &mut Bench, names: &[String]) {
    for (n, on) in names.iter().enumerate() {
        let switch = |bench: &mut Bench, is_on| {
            let device = find_mut(bench.end()).expect("a device");
            device.set_input(n, is_on).expect("an input");
        };
        switch(bench, true);
        bench.run();
        for name in names {
            assert_eq!(bench.is_on(name), name == on, "{on}: {name}");
            assert_eq!(
                bench.is_on(&format!("{name}-not")),
                name != on,
                "{on}: {name}"
            );
        }
        switch(bench, false);
    }
    bench.run();
}

/// Gives each analog input a voltage of its own.
fn analog_inputs(bench: &mut Bench, inputs: &[Expected]) {
    // A field voltage that is no fault.
    let volts = |n: usize, input: &Expected| match input.greatest.expect("an analog one") {
        greatest if input.name == "fieldvoltage" => greatest / 1.5,
        greatest => greatest * (n + 1) as f64 / 10.0,
    };
    for (n, input) in inputs.iter().enumerate() {
        let volts = volts(n, input);
        let now = SimFpga::now(bench.driver.bus());
        let device = find_mut(bench.end()).expect("a device");
        let all = device.inputs();
        let analog = all
            .iter()
            .filter(|(_, value)| matches!(value, SignalValue::Volts(_) | SignalValue::Number(_)));
        let index = analog
            .map(|(name, _)| name)
            .position(|name| *name == input.name);
        let is_field = input.name == "fieldvoltage";
        if !is_field || device.set_field_volts(now, volts).is_err() {
            let done = device.set_input_volts(index.expect("an input"), volts);
            done.expect("an input");
        }
    }
    bench.run();
    for (n, input) in inputs.iter().enumerate() {
        let greatest = input.greatest.expect("an analog one");
        let (found, volts) = (bench.number(&input.name), volts(n, input));
        assert!(
            (found - volts).abs() < greatest / 200.0,
            "{}: {found}, {volts}",
            input.name
        );
    }
}

/// An analog output follows its share of the full scale.
fn analog_output(bench: &mut Bench, name: &str, greatest: f64) {
    let mut at = |share: f64| {
        let id = bench.id(name);
        let set = bench
            .driver
            .pins_mut()
            .set_any(id, (share * greatest).into());
        set.expect("a number");
        bench.run();
        bench.output(name)
    };
    let [full, half, none] = [1.0, 0.5, 0.0].map(&mut at);
    assert!(full > 1.0 && none.abs() < 0.01, "{name}: {full}, {none}");
    assert!(
        (half - full / 2.0).abs() < full / 100.0,
        "{name}: {half} of {full}"
    );
}

/// Turns each MPG of a card without terminals of its own kind.
fn counters(bench: &mut Bench, names: &[String]) {
    for (n, name) in names.iter().enumerate() {
        let steps = n as u8 + 3;
        let before = bench.number(&format!("{name}.count"));
        let element = format!("Enc{n}");
        let any: &mut dyn Any = bench.end();
        if let Some(card) = any.downcast_mut::<SimRemote<Device<Plain>>>() {
            let world = card.application_mut().world_mut();
            world.set_raw(&element, &[steps]).expect("a counter");
            bench.run();
            assert_eq!(
                bench.number(&format!("{name}.count")) - before,
                steps.into()
            );
            continue;
        }
        // The terminals of a field I/O: A and B of each MPG.
        for (a, b) in [(true, false), (true, true), (false, true), (false, false)] {
            let device = find_mut(bench.end()).expect("a device");
            for (input, on) in [(16 + 2 * n, a), (17 + 2 * n, b)] {
                device.set_input(input, on).expect("an input");
            }
            bench.run();
        }
        assert_eq!(bench.number(&format!("{name}.count")) - before, 1.0);
    }
}

#[test]
fn each_card_runs_in_each_mode_in_both_directions() {
    for card in &CARDS {
        for (mode, elements) in card.modes.iter().enumerate() {
            eprintln!("{} in mode {mode}", card.name);
            let mut bench = Bench::new(card, mode);
            let expected = expected(elements);
            let is_output = |name: &str| {
                ["output", "spin", "display"]
                    .iter()
                    .any(|start| name.starts_with(start))
            };
            let names = expected.iter().map(|pin| pin.name.clone());
            let directed = names.map(|name| (name.clone(), is_output(&name)));
            assert_eq!(bench.names(), directed.collect());

            let (analog, others): (Vec<_>, Vec<_>) =
                expected.into_iter().partition(|pin| pin.greatest.is_some());
            let of = |start: &str| {
                let names = others.iter().map(|pin| pin.name.clone());
                names
                    .filter(|name| name.starts_with(start))
                    .collect::<Vec<_>>()
            };
            digital_outputs(&mut bench, &[of("output"), of("spin")].concat());
            digital_inputs(&mut bench, &of("input"));
            counters(&mut bench, &of("enc"));
            for name in of("display") {
                let id = bench.id(&name);
                bench
                    .driver
                    .pins_mut()
                    .set_any(id, 0x41_u32.into())
                    .expect("a character");
                bench.run();
                assert_eq!(bench.output(&name), 65.0);
            }
            let (outputs, inputs): (Vec<_>, Vec<_>) =
                analog.into_iter().partition(|pin| is_output(&pin.name));
            for output in outputs {
                bench.set_on("spinena", true);
                analog_output(
                    &mut bench,
                    &output.name,
                    output.greatest.expect("an analog one"),
                );
            }
            analog_inputs(&mut bench, &inputs);
        }
    }
}

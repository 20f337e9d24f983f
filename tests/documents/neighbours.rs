//! Cost of the trouble of one remote for the others of its port: the table of `docs/neighbours.md`,
//! measured again. Virtual time, so that every figure is the same on every machine.

use crate::common::machine::{ANALOG, FIELD, Machine, OUTPUTS};
use mesa_hal_sim::remote::{Toward, WireFault};

const MINUTE: u64 = 60_000;

/// Trouble of the field I/O of a 7I77: `step` acts in each millisecond of a minute, after two
/// healthy seconds.
struct Trouble {
    name: &'static str,
    step: fn(&mut Machine, u64),
}

/// Cost for the analog section on the same port.
#[derive(Debug)]
struct Cost {
    attempts: u64,
    lost: u64,
    /// Microseconds.
    longest_gap: u64,
    running: u64,
    /// Milliseconds from the end of the trouble until its inputs are valid again.
    back: u64,
}

fn plugged(machine: &mut Machine, is_in: bool) {
    let cable = machine.cable(FIELD);
    if is_in {
        cable.replug();
    } else {
        cable.unplug();
    }
}

/// From the first millisecond on, this share of the replies has a bad CRC.
fn corrupted(machine: &mut Machine, ms: u64, part: f64) {
    if ms == 0 {
        let cable = machine.cable(FIELD);
        cable.inject_by_chance(Toward::Fpga, WireFault::Corrupted, part);
    }
}

const TROUBLES: [Trouble; 10] = [
    Trouble {
        name: "none",
        step: |_, _| {},
    },
    Trouble {
        name: "absent",
        step: |machine, ms| {
            if ms == 0 {
                plugged(machine, false);
            }
        },
    },
    Trouble {
        name: "absent, and one more",
        step: |machine, ms| match ms {
            0 => plugged(machine, false),
            700 => machine.cable(OUTPUTS).unplug(),
            _ => {}
        },
    },
    Trouble {
        name: "corrupt: no reply has a good CRC",
        step: |machine, ms| corrupted(machine, ms, 1.0),
    },
    Trouble {
        name: "corrupt: one reply in five has a bad CRC",
        step: |machine, ms| corrupted(machine, ms, 0.2),
    },
    Trouble {
        name: "flapping: 0.5 s out, 0.5 s in",
        step: |machine, ms| plugged(machine, ms % 1000 >= 500),
    },
    Trouble {
        name: "flapping: 0.7 s out, 3 s in",
        step: |machine, ms| plugged(machine, ms % 3700 >= 700),
    },
    Trouble {
        name: "faulty: over-temperature",
        step: |machine, ms| {
            if ms == 0 {
                machine
                    .device_mut(FIELD)
                    .set_over_temperature(3, true)
                    .unwrap();
            }
        },
    },
    Trouble {
        name: "faulty: over-current, re-armed at once each time",
        step: |machine, ms| {
            if ms == 0 {
                machine.device_mut(FIELD).set_over_current(3, true).unwrap();
            }
            let _ = machine.driver.rearm().unwrap();
            let output = machine.cards.field.outputs[3].pin;
            machine.driver.pins_mut().set(output, true);
        },
    },
    Trouble {
        name: "faulty: no field power",
        step: |machine, ms| {
            if ms == 0 {
                let now = machine.now();
                machine.device_mut(FIELD).set_field_volts(now, 0.0).unwrap();
            }
        },
    },
];

fn repair(machine: &mut Machine) {
    let now = machine.now();
    for channel in [FIELD, OUTPUTS] {
        machine.cable(channel).replug();
        machine.cable(channel).heal();
    }
    let field = machine.device_mut(FIELD);
    field.set_over_temperature(3, false).unwrap();
    field.set_over_current(3, false).unwrap();
    field.set_field_volts(now, 24.0).unwrap();
}

fn measure(trouble: &Trouble) -> Cost {
    let mut machine = Machine::new();
    machine.cycles(2000);
    let starts = |machine: &Machine| machine.driver.ports()[0].statistics().starts;
    let transfers = |machine: &Machine| {
        let status = machine.status(ANALOG);
        status.transfers - status.failures.total()
    };
    let before = (starts(&machine), transfers(&machine));
    let (mut longest_gap, mut running) = (0, 0);
    for ms in 0..MINUTE {
        (trouble.step)(&mut machine, ms);
        let _ = machine.cycle();
        let group = machine.status(ANALOG).pins.group;
        let age = machine.driver.pins().group_state(group).unwrap().age;
        longest_gap = longest_gap.max(age.time.as_micros() as u64);
        running += u64::from(machine.is_valid(FIELD));
        assert!(machine.is_armed(ANALOG), "{}: {ms} ms", trouble.name);
    }
    let (attempts, done) = (starts(&machine), transfers(&machine));
    repair(&mut machine);
    let back = machine.until(10_000, |machine| machine.is_valid(FIELD));
    Cost {
        attempts: attempts - before.0,
        lost: MINUTE - (done - before.1),
        longest_gap,
        running,
        back: back as u64,
    }
}

impl Cost {
    fn per_cent(&self) -> f64 {
        self.lost as f64 * 100.0 / MINUTE as f64
    }

    fn row(&self, name: &str) -> String {
        let Self { attempts, .. } = self;
        let (lost, gap) = (self.per_cent(), self.longest_gap.div_ceil(1000));
        let running = self.running as f64 * 100.0 / MINUTE as f64;
        let back = self.back.div_ceil(100) as f64 / 10.0;
        format!("| {name} | {attempts} | {lost:.2} % | {gap} ms | {running:.0} % | {back:.1} s |\n")
    }
}

const PAGE: &str = "docs/neighbours.md";

/// Run with `UPDATE_NEIGHBOURS=1` to write the page anew.
#[test]
fn table_of_what_neighbours_lose_is_what_is_measured() {
    let path = crate::root().join(PAGE);
    let page = std::fs::read_to_string(&path).expect(PAGE);
    let start = page.find("| trouble |").expect("a table");
    let mut table = String::from(
        "| trouble | attempts | neighbour's cycles lost | longest gap | its own inputs valid | back after |\n\
         |---|---|---|---|---|---|\n",
    );
    let costs: Vec<Cost> = std::thread::scope(|scope| {
        let runs = TROUBLES
            .each_ref()
            .map(|trouble| scope.spawn(|| measure(trouble)));
        runs.map(|run| run.join().expect("measured")).into()
    });
    for (trouble, cost) in TROUBLES.iter().zip(costs) {
        println!("{}: {cost:?}", trouble.name);
        assert!(cost.per_cent() < 0.6, "{}: {cost:?}", trouble.name);
        // 17 ms, as long as the gateware takes, and the cycles before and after.
        assert!(cost.longest_gap < 20_000, "{}: {cost:?}", trouble.name);
        assert!(cost.back < 5_100, "{}: {cost:?}", trouble.name);
        table.push_str(&cost.row(trouble.name));
    }
    let head = page.get(..start).expect("a table");
    if std::env::var_os("UPDATE_NEIGHBOURS").is_some() {
        std::fs::write(&path, format!("{head}{table}")).expect(PAGE);
        return;
    }
    let written = page.get(start..).expect("a table");
    assert!(
        agrees(written, &table),
        "{PAGE} is out of date, write it anew with UPDATE_NEIGHBOURS=1:\n{table}"
    );
}

/// True if the names are equal, and the figures too, except for one in the last digit, or two
/// tenths of a second until the remote is back: a change of some microseconds in the simulator
/// moves the phase in which a remote comes and goes.
fn agrees(written: &str, measured: &str) -> bool {
    const TOLERANCES: [f64; 5] = [0.0, 0.0101, 0.0, 1.0, 0.201];
    let row = |line: &str| -> (String, Vec<f64>) {
        let mut cells = line.trim_matches('|').split('|').map(str::trim);
        let name = cells.next().unwrap_or_default().to_owned();
        let number = |cell: &str| cell.split(' ').next().and_then(|n| n.parse().ok());
        (name, cells.filter_map(number).collect())
    };
    let pairs = || written.lines().map(row).zip(measured.lines().map(row));
    written.lines().count() == measured.lines().count()
        && pairs().all(|((name, known), (other, new))| {
            let mut near = known.iter().zip(&new).zip(TOLERANCES);
            name == other
                && known.len() == new.len()
                && near.all(|((known, new), tolerance)| (known - new).abs() <= tolerance)
        })
}

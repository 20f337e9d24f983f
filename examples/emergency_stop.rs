//! Follows an emergency-stop chain on a simulated 7I77: an axis moves only while the chain is
//! closed, its limit switch is free and its outputs are armed, and starts again only when a button
//! is pressed.
//!
//! The chain itself removes the power of the drives by its own contacts. A program only follows it:
//! no software is a safety function.
//!
//! - An input counts while it is valid, or was a few cycles ago; without it the chain is open.
//! - Nothing starts by itself: after a stop or a fault the button must be pressed.
//! - A board that was reset gets its set-up back at once, so that its inputs are read, but its
//!   outputs stay off until the button is pressed.

use std::error::Error;
use std::mem::replace;
use std::ops::ControlFlow::{Break, Continue};
use std::process::ExitCode;

use mesa_hal::driver::BoardState;
use mesa_hal::hal::{Age, AnalogOut, GroupId};
use mesa_hal::runner::Runner;
use mesa_hal::{Driver, I7i77Analog, I7i77Field, Settings};
use mesa_hal_sim::devices::find_mut;
use mesa_hal_sim::{Motor, SimFpga, machines};

/// Inputs of the 7I77. The chain and the limit switch are closed, and on, as long as all is well.
const CHAIN: usize = 0; // TB8 pin 1
const LIMIT: usize = 2; // TB8 pin 3
const BUTTON: usize = 5; // TB8 pin 6

/// What happens at the machine, by cycle of 1 ms.
const STORY: [(u64, &str, Act); 14] = [
    (100, "the button is pressed", Act::Input(BUTTON, true)),
    (200, "and released", Act::Input(BUTTON, false)),
    (
        500,
        "the emergency stop is pressed",
        Act::Input(CHAIN, false),
    ),
    (700, "and released", Act::Input(CHAIN, true)),
    (900, "the button is pressed", Act::Input(BUTTON, true)),
    (1000, "and released", Act::Input(BUTTON, false)),
    (
        1200,
        "the axis reaches its limit switch",
        Act::Input(LIMIT, false),
    ),
    (1300, "and leaves it", Act::Input(LIMIT, true)),
    (1490, "the button is held", Act::Input(BUTTON, true)),
    (1500, "while the board is reset", Act::Reset),
    (1900, "and released", Act::Input(BUTTON, false)),
    (2000, "the button is pressed", Act::Input(BUTTON, true)),
    (2100, "and released", Act::Input(BUTTON, false)),
    (2500, "the end", Act::End),
];

#[derive(Clone, Copy)]
enum Act {
    Input(usize, bool),
    Reset,
    End,
}

struct Machine {
    field: I7i77Field,
    drive: AnalogOut,
    /// The outputs of the drive, which are armed together.
    group: GroupId,
    is_released: bool,
    is_on: bool,
    starts: u32,
}

impl Machine {
    /// The machine's logic, between the read and the write of a cycle.
    fn step(&mut self, driver: &mut Driver<SimFpga>, has_read: bool) {
        if has_read && driver.board_state() != BoardState::Running {
            let _ = driver.restore(); // if it fails, it is tried again in the next cycle
        }
        let pins = driver.pins();
        let input = |n: usize| {
            self.field.inputs[n]
                .read(pins)
                .within(Age::NEIGHBOUR_RESTART)
        };
        let is_chain_closed = input(CHAIN) == Some(true);
        let is_limit_free = input(LIMIT) == Some(true);
        // Only a press after a release that was seen counts, not a button that was held meanwhile.
        let button = input(BUTTON);
        let was_released = replace(&mut self.is_released, button == Some(false));
        if was_released && button == Some(true) && is_chain_closed && !self.is_on {
            self.is_on = driver.rearm().is_ok_and(|rearmed| rearmed.waiting == 0);
            self.starts += u32::from(self.is_on);
        }
        let group = driver.pins().group_state(self.group);
        self.is_on &= is_chain_closed && group.is_some_and(|group| group.armed);
        let volts = if is_limit_free { 1.5 } else { 0.0 };
        self.drive.enable(driver.pins_mut(), self.is_on);
        self.drive
            .set(driver.pins_mut(), if self.is_on { volts } else { 0.0 });
    }
}

fn main() -> ExitCode {
    run().unwrap_or_else(|error| {
        eprintln!("emergency_stop: {error}");
        ExitCode::FAILURE
    })
}

fn run() -> Result<ExitCode, Box<dyn Error>> {
    let mut board = machines::six_axes_7i92(Motor::default());
    for input in [CHAIN, LIMIT] {
        set_input(&mut board, input, true)?;
    }
    let driver = Driver::start(board, Settings::default())?; // 1 ms
    let mut events = driver.events();
    let mut machine = Machine {
        field: driver.attach((0, 0))?,
        drive: driver.attach::<I7i77Analog>((0, 1))?.analog_out[0],
        group: driver.remote((0, 1)).ok_or("no 7I77")?.pins.group,
        is_released: false,
        is_on: false,
        starts: 0,
    };
    let ended = Runner::new(driver).run(|cycle| {
        let (number, was_on) = (cycle.number, machine.is_on);
        let has_read = cycle.read.is_ok();
        for (_, text, act) in STORY.iter().filter(|(at, ..)| *at == number) {
            println!("cycle {number}: {text}");
            let is_over = match *act {
                Act::Input(input, on) => set_input(cycle.driver.bus_mut(), input, on).is_err(),
                Act::Reset => {
                    cycle.driver.bus_mut().reload();
                    false
                }
                Act::End => true,
            };
            if is_over {
                return Break(());
            }
        }
        machine.step(cycle.driver, has_read);
        for event in events.by_ref() {
            println!("  {}", event.with_advice());
        }
        if was_on != machine.is_on {
            println!("  axis {}", if machine.is_on { "on" } else { "OFF" });
        }
        Continue(())
    });
    ended.stopped?; // outputs off, ports stopped
    println!("started {} times, each time by the button", machine.starts);
    Ok(ExitCode::from(u8::from(machine.starts != 3)))
}

fn set_input(board: &mut SimFpga, input: usize, on: bool) -> Result<(), Box<dyn Error>> {
    let card = board.remote_mut(0, 0).and_then(find_mut).ok_or("no card")?;
    Ok(card.set_input(input, on)?)
}

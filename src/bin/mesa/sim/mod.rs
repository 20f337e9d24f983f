//! `mesa sim`: a simulated Ethernet board on UDP, for real clients, in real time.

mod console;
mod devices;
pub mod machine;
mod options;
mod remotes;
pub mod store;

use std::error::Error;
use std::time::Duration;

use mesa_hal::sim::UdpFace;

use crate::context::{Context, Ending, Failure};
use crate::output::say;
use machine::Machine;
pub use options::Options;
use store::Store;

/// The longest time between two looks at everything that is no packet.
const TICK: Duration = Duration::from_micros(200);

/// Runs until it is told to stop, which is no failure.
pub fn run(options: &Options, context: &Context) -> Result<Ending, Failure> {
    options::check_channels(options.board, &options.remotes).map_err(Failure::usage)?;
    let address = options.address();
    let mut machine = Machine::new(&options.machine())?;
    let mut store = open_store(options, &mut machine)?;
    let mut face = UdpFace::bind(address, options.mishaps())
        .map_err(|error| Failure::refused(format_args!("{address}: {error}")))?;
    let lines = console::read_lines();
    say(format_args!(
        "{} listening on {}\n{}",
        machine.name(),
        face.local_addr()?,
        machine.inventory()
    ));
    while context.stop.signal().is_none() {
        face.step(&mut machine.board, TICK)?;
        if let Ok(line) = lines.try_recv() {
            let answer = console::answer(&mut machine, &face, &line);
            say(&answer.text);
            if answer.quit {
                break;
            }
        }
        if let Some(store) = &mut store {
            store.keep(machine.changes(), || machine.state());
        }
    }
    if let Some(store) = store {
        store.close(machine.state());
    }
    say(console::summary(&mut machine, &face));
    Ok(Ending::Done)
}

fn open_store(options: &Options, machine: &mut Machine) -> Result<Option<Store>, Failure> {
    let Some(path) = &options.state else {
        return Ok(None);
    };
    let in_file = |error: &dyn Error| Failure::refused(format_args!("{}: {error}", path.display()));
    let (store, old) = Store::open(path).map_err(|error| in_file(&error))?;
    if let Some(old) = old {
        machine.restore(&old).map_err(|error| in_file(&*error))?;
    }
    Ok(Some(store))
}

//! A simulated Mesa Ethernet board on UDP, for real clients, in real time.
//!
//! `cargo run --release --example sim_board -- --board 7i97 --listen 127.0.0.1`

mod console;
mod devices;
mod machine;
mod options;
mod remotes;
mod store;

use std::{
    error::Error,
    io::{self, Write},
    process::ExitCode,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

use mesa_hal::sim::UdpFace;
use signal_hook::consts::{SIGINT, SIGTERM};

use crate::{machine::Machine, options::Options, store::Store};

/// The longest time between two looks at everything that is no packet.
const TICK: Duration = Duration::from_micros(200);

fn main() -> ExitCode {
    let options = match options::parse(lexopt::Parser::from_env()) {
        Ok(Some(options)) => options,
        Ok(None) => {
            say(options::HELP);
            return ExitCode::SUCCESS;
        }
        Err(error) => {
            complain(&format!("{error}\nTry --help."));
            return ExitCode::from(2);
        }
    };
    match run(&options) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            complain(&error.to_string());
            ExitCode::FAILURE
        }
    }
}

fn run(options: &Options) -> Result<(), Box<dyn Error>> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGTERM, SIGINT] {
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    let mut machine = Machine::new(options)?;
    let mut store = open_store(options, &mut machine)?;
    let mut face = UdpFace::bind(options.listen, options.mishaps)
        .map_err(|error| format!("{}: {error}", options.listen))?;
    let lines = console::read_lines();
    say(&format!(
        "{} listening on {}\n{}",
        machine.name(),
        face.local_addr()?,
        machine.inventory()
    ));
    while !stop.load(Ordering::Relaxed) {
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
    say(&console::summary(&mut machine, &face));
    Ok(())
}

fn open_store(options: &Options, machine: &mut Machine) -> Result<Option<Store>, Box<dyn Error>> {
    let Some(path) = &options.state else {
        return Ok(None);
    };
    let in_file = |error: &dyn Error| format!("{}: {error}", path.display());
    let (store, old) = Store::open(path).map_err(|error| in_file(&error))?;
    if let Some(old) = old {
        machine.restore(&old).map_err(|error| in_file(&*error))?;
    }
    Ok(Some(store))
}

fn complain(error: &str) {
    let _ = writeln!(io::stderr(), "sim_board: {error}");
}

/// Prints, also when nobody listens any more.
fn say(text: &str) {
    let mut out = io::stdout().lock();
    let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
}

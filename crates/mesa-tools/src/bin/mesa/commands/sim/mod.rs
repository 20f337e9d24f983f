//! `mesa sim`: simulated boards on UDP or in a folder like sysfs's, for real clients, in real time.

mod agenda;
mod answer;
mod capture;
mod console;
mod control;
mod face;
mod mechanics;
mod network;
mod options;
mod remotes;
mod station;
mod store;
mod watch;

use std::error::Error;
use std::fmt::Write;
use std::net::SocketAddrV4;
use std::sync::Arc;
use std::sync::atomic::AtomicUsize;
use std::thread;
use std::time::Duration;

use mesa_hal_sim::UdpFace;

use crate::machine::built::Machine;
use crate::ui::context::{Context, Ending, Failure};
use crate::ui::full_screen;
use crate::ui::input;
use crate::ui::output::{complain, say};
use capture::Capture;
use control::Socket;
use face::Face;
use network::Network;
pub use options::Options;
use options::{Wanted, Where};
use station::{Link, Running, Station};
use store::Store;
use watch::Watch;

/// Longest time between a signal and the end of the process.
const TICK: Duration = Duration::from_millis(10);

/// Bytes in a megabyte.
const MEGABYTE: u64 = 1_000_000;

/// Runs the simulation until a signal or the command `quit`, neither of which is a failure.
pub fn run(options: &Options, context: &Context) -> Result<Ending, Failure> {
    if options.watch {
        full_screen::check(
            context,
            "without --watch it takes commands on standard input",
        )?;
    }
    let mut greeting = String::new();
    let (mut sockets, stations, network) = build_all(options, &mut greeting)?;
    if !options.watch {
        let _ = writeln!(greeting, "type `help` for what can be done to it");
    }
    say(greeting);
    let clients = Arc::new(AtomicUsize::new(0));
    for socket in &mut sockets {
        socket.serve(&network, &clients);
    }
    let running = Running::start(stations, &network.shared);
    if options.watch {
        let shown = full_screen::show(context, &mut Watch::new(&network, &running));
        running.end()?;
        shown?;
        complain("mesa: the simulated boards have ended");
        return Ok(Ending::Done);
    }
    take_lines(network.clone());
    while context.stop.signal().is_none() && running.goes_on() {
        thread::sleep(TICK);
    }
    for summary in running.end()? {
        say(summary);
    }
    Ok(Ending::Done)
}

/// Binds the control sockets, and builds all boards with their network.
fn build_all(
    options: &Options,
    greeting: &mut String,
) -> Result<(Vec<Socket>, Vec<Station>, Network), Failure> {
    let wanted = options.wanted().map_err(Failure::usage)?;
    if wanted.len() > 1 && options.state.is_some() {
        return Err(Failure::usage(
            "--state keeps one board; run a process for each",
        ));
    }
    let capture = options.pcap.as_deref();
    let capture = capture
        .map(|path| Capture::create(path, options.pcap_limit.saturating_mul(MEGABYTE)))
        .transpose()?;
    let sockets = listen(options, greeting)?;
    let (mut stations, mut links) = (Vec::new(), Vec::new());
    for board in wanted {
        let (station, link) = build(options, board, capture.as_ref(), greeting)?;
        stations.push(station);
        links.push(link);
    }
    let network = Network {
        boards: links.into(),
        shared: Arc::default(),
    };
    Ok((sockets, stations, network))
}

/// Binds all control sockets.
fn listen(options: &Options, greeting: &mut String) -> Result<Vec<Socket>, Failure> {
    let mut sockets = Vec::new();
    for control in &options.control {
        let socket = Socket::bind(control)
            .map_err(|error| Failure::refused(format_args!("--control {control}: {error}")))?;
        let _ = writeln!(greeting, "control on {}", socket.place);
        sockets.push(socket);
    }
    Ok(sockets)
}

/// Builds a board that listens on its address.
fn build(
    options: &Options,
    board: Wanted,
    capture: Option<&Capture>,
    greeting: &mut String,
) -> Result<(Station, Link), Failure> {
    let Wanted {
        name,
        machine: described,
        place,
    } = board;
    let mut machine = Machine::new(&described).map_err(Failure::refused)?;
    let store = open_store(options, &mut machine)?;
    let face = match place {
        Where::Ethernet(address) => bind(options, address, capture)?,
        Where::Pci { root, index } => {
            let name = machine.name().to_owned();
            Face::on_pci(&root, index, &name, &mut machine.board).map_err(Failure::refused)?
        }
    };
    let way = match face {
        Face::Ethernet(_) => "listening on",
        Face::Pci(_) => "on the PCI bus:",
    };
    let _ = write!(
        greeting,
        "{} {way} {}\n{}",
        machine.name(),
        face.place()?,
        machine.inventory()
    );
    Station::new(name, described, machine, face, store)
}

/// The socket of a board.
fn bind(
    options: &Options,
    address: SocketAddrV4,
    capture: Option<&Capture>,
) -> Result<Face, Failure> {
    let mut face = UdpFace::bind(address, options.mishaps())
        .map_err(|error| Failure::refused(format_args!("{address}: {error}")))?;
    if let Some(capture) = capture {
        face.set_tap(Some(Box::new(capture.clone())));
    }
    Ok(Face::Ethernet(face))
}

/// Executes the command lines of standard input, in a thread of its own.
fn take_lines(network: Network) {
    input::read_lines(move |line| {
        let answer = network.answer(line);
        say(&answer.text);
        if answer.quit {
            network.shared.end();
        }
        !answer.quit
    });
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

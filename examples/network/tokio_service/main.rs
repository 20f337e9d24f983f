//! Tokio beside the thread of the cycle: a task serves the state of the machine, and takes
//! commands, by lines of text over TCP. The cycle does not wait for it.
//!
//! ```sh
//! cargo run --example tokio_service                  # until Ctrl-C, or `quit` from a client
//! cargo run --example tokio_service -- --demo        # with a client of its own, which ends it
//! ```
//!
//! A client, for example `nc`, sends a line and gets a line:
//!
//! | line | answer |
//! |---|---|
//! | `state` | the state of the board and its groups |
//! | `get NAME` | the value of a pin, or why there is none |
//! | `set NAME VALUE` | the outcome of the command, in the cycle that has taken it |
//! | `rearm` | the outcome; everything is armed as soon as it runs |
//! | `quit` | ends the cycle, with all outputs off |
//!
//! The board is the embedded simulated one; each of its cycles takes a period of real time.

mod client;
mod print;
mod service;

use std::error::Error;
use std::ops::ControlFlow;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use mesa_hal::runner::{Ended, Runner, Stop};
use mesa_hal::{Board, I7i77Field, Input, Settings};
use mesa_hal_sim::{Motor, SimFpga, machines};
use print::{print, print_error};
use service::Service;
use tokio::net::TcpListener;
use tokio::sync::oneshot;

type Failure = Box<dyn Error + Send + Sync>;

/// Cycles of a run with `--demo` that its client does not end.
const DEMO_CYCLES: u64 = 20_000;

fn main() -> ExitCode {
    let is_demo = match std::env::args().nth(1).as_deref() {
        None => false,
        Some("--demo") => true,
        Some(other) => {
            print_error(format_args!(
                "tokio_service: {other} is no option; there is --demo"
            ));
            return ExitCode::from(2);
        }
    };
    match run(is_demo) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            print_error(format_args!("tokio_service: {error}"));
            ExitCode::FAILURE
        }
    }
}

fn run(is_demo: bool) -> Result<(), Failure> {
    let bus = machines::six_axes_7i92(Motor::default());
    let mut board = Board::identify(bus, Settings::default())?;
    // A value of the application, which clients see as the board's pins.
    let uptime: Input<f64> = board.own_pins("demo")?.input("uptime")?;
    let driver = board.start()?;
    print(format_args!("{driver}\n"));
    let field: I7i77Field = driver.attach((0, 0))?;
    let names = service::names(driver.pins());
    let mut runner = Runner::new(driver).stop_on(Stop::on_signals()?);

    let quit = Arc::new(AtomicBool::new(false));
    let service = Service::new(&mut runner, names, Arc::clone(&quit));
    let (over, is_over) = oneshot::channel();
    let limit = if is_demo { DEMO_CYCLES } else { u64::MAX };
    // Its own thread: on a real machine with `Realtime::apply` first.
    let cycle = thread::spawn(move || {
        let ended = runner.run(|cycle| {
            let seconds = cycle.pins().now().as_nanos() as f64 * 1e-9;
            cycle.pins_mut().show(uptime, seconds);
            // Output 0 follows input 0, unless a client has set it.
            if field.inputs[0].read(cycle.pins()).ok() == Some(true) {
                field.outputs[0].set(cycle.pins_mut(), true);
            }
            // The simulated board has virtual time. A real one needs no pause here.
            thread::sleep(cycle.dt);
            if quit.load(Ordering::Relaxed) || cycle.number == limit {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        });
        let _ = over.send(());
        ended
    });

    let tokio = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    let served = tokio.block_on(serve(service, is_over, is_demo));
    let ended: Ended<SimFpga> = cycle
        .join()
        .map_err(|_| "the thread of the cycle has panicked")?;
    ended.stopped?;
    print(format_args!(
        "{} cycles, all outputs off\n",
        ended.statistics.cycles
    ));
    served
}

/// Serves clients until the cycle is over.
async fn serve(
    service: Service,
    is_over: oneshot::Receiver<()>,
    is_demo: bool,
) -> Result<(), Failure> {
    let listener = TcpListener::bind(("127.0.0.1", 0)).await?;
    let address = listener.local_addr()?;
    print(format_args!("listening on {address}\n"));
    let demo = is_demo.then(|| tokio::spawn(client::session(address)));
    let clients = async {
        loop {
            // A connection that fails before it is taken is none.
            if let Ok((client, _)) = listener.accept().await {
                tokio::spawn(service.clone().answer(client));
            }
        }
    };
    tokio::select! {
        () = clients => {}
        _ = is_over => {}
    }
    match demo {
        Some(session) => session.await?,
        None => Ok(()),
    }
}

//! A look at a board that another program drives: the bus, its errors, and the time between looks.

use std::time::Duration;

use mesa_hal::bus::{Clock, Instant};
use mesa_hal::{Advice, AdviceTopic, MesaError};
use mesa_tools::passive::PassiveBus;

use crate::board::address::BoardAddress;
use crate::board::link::BoardLink;
use crate::ui::context::{Context, Failure};
use crate::ui::number;
use mesa_tools::advice::told;

/// The bus of a look at a running machine.
pub type LookBus = PassiveBus<BoardLink>;

/// Longest wait for a signal to be noticed.
pub const NOTICE: Duration = Duration::from_millis(100);

/// Failure of a look, with the way through the firewall that LinuxCNC's own driver sets up for the
/// interface of its board.
pub fn failed(address: BoardAddress, error: &dyn MesaError) -> Failure {
    let of_error = || Failure::of(error, format_args!("{address}: {}", told(error)));
    let Some(address) = address.on_ethernet() else {
        return of_error();
    };
    let topic = error.advice().map(Advice::topic);
    if topic != Some(AdviceTopic::Firewall) {
        return of_error();
    }
    let (ip, port) = (address.ip(), address.port());
    let advice = format!(
        "LinuxCNC on this computer keeps its board for itself. Until it ends, `sudo iptables -I \
         hm2-eth-rules-output -p udp -d {ip} --dport {port} -j ACCEPT` lets a look through; another \
         computer in this network needs nothing"
    );
    Failure::refused(format_args!("{address}: {error}; {advice}")).advising(advice)
}

/// Waits until `until`, or until a signal asks for the end; `false` after a signal.
pub fn wait(context: &Context, bus: &mut LookBus, until: Instant) -> bool {
    while context.stop.signal().is_none() {
        let left = until.since(bus.now());
        if left.is_zero() {
            return true;
        }
        bus.sleep(left.min(NOTICE));
    }
    false
}

/// Parses the time between two looks.
pub fn parse_every(text: &str) -> Result<Duration, String> {
    number::time(text, 0.05..=3600.0)
}

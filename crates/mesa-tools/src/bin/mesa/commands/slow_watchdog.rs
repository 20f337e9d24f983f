//! Outputs that nothing switches off when the cable of their remote breaks, or not for long.

use clap::Args;
use mesa_hal::driver::{FoundRemote, RemoteWatchdog, SerialPort};
use mesa_hal::hal::GroupId;
use mesa_hal::{Board, Driver, Rounded};

use crate::context::Failure;
use crate::link::Bus;
use crate::output::complain;

/// Of a command that drives outputs of remotes.
#[derive(Clone, Copy, Debug, Args)]
pub struct SlowWatchdog {
    /// Let an output be set whose remote has its own watchdog off, or longer than 1 s, or does not
    /// show that it bites: when its cable breaks, nothing else switches the output off
    #[arg(long)]
    slow_watchdog: bool,
}

impl SlowWatchdog {
    /// Looks at what the remotes of these outputs keep. What to say of those that take long.
    pub fn check(self, board: &Board<Bus>, groups: &[GroupId]) -> Result<String, Failure> {
        let driven = |remote: &FoundRemote| groups.contains(&remote.pins.group);
        let remotes = board.remotes().filter(|(_, remote)| driven(remote));
        let slow = remotes.filter_map(|(port, remote)| {
            let watchdog = Some(remote.watchdog()).filter(|watchdog| watchdog.is_slow())?;
            let how = match watchdog {
                RemoteWatchdog::Off => {
                    "is off (NVWatchDogTimeout 0): when its cable breaks, what is on stays on"
                        .to_owned()
                }
                _ => format!(
                    "is slow (NVWatchDogTimeout): when its cable breaks, what is on stays on for {}",
                    Rounded(&watchdog.time().unwrap_or_default())
                ),
            };
            let (name, channel) = (&remote.descriptor.name, remote.started.channel.index());
            Some(format!(
                "the own watchdog of the {name} on port {port}, channel {channel} {how}"
            ))
        });
        let slow: Vec<_> = slow.collect();
        match &*slow.join("; ") {
            "" => Ok(String::new()),
            said if self.slow_watchdog => Ok(format!(". Beware: {said}")),
            said => Err(refused(said)),
        }
    }

    /// Lets the watchdogs bite, with all outputs off: what a remote keeps may not be what it uses. All
    /// groups have to be re-armed then.
    pub fn prove(self, driver: &mut Driver<Bus>, groups: &[GroupId]) -> Result<(), Failure> {
        let slow = |driver: &Driver<Bus>| {
            let remotes = driver.ports().iter().flat_map(|port| {
                let number = port.layout().instance;
                port.remotes().map(move |remote| (number, remote))
            });
            let slow = remotes.filter(|(_, remote)| {
                groups.contains(&remote.pins.group) && remote.watchdog.is_slow()
            });
            let slow = slow.map(|(port, remote)| {
                let (name, channel) = (&remote.descriptor.name, remote.started.channel.index());
                format!("the {name} on port {port}, channel {channel}")
            });
            slow.collect::<Vec<_>>()
        };
        let is_driven = {
            let mut remotes = driver.ports().iter().flat_map(SerialPort::remotes);
            remotes.any(|remote| groups.contains(&remote.pins.group))
        };
        if !is_driven {
            return Ok(());
        }
        let known = slow(driver);
        driver.prove_watchdogs()?;
        let mut found = slow(driver);
        found.retain(|place| !known.contains(place));
        if found.is_empty() {
            return Ok(());
        }
        let said = format!(
            "the own watchdog of {} has not shown that it bites within the time that \
             NVWatchDogTimeout says: what was written is used from the next power-up on, and until \
             then another time, or none. When its cable breaks, what is on may stay on",
            found.join(" and ")
        );
        if self.slow_watchdog {
            complain(format_args!("mesa: BEWARE: {said}"));
            return Ok(());
        }
        Err(refused(&said))
    }
}

fn refused(said: &str) -> Failure {
    Failure::refused(format_args!(
        "{said}. Set it (`mesa param set`) and switch the remote off and on, or give --slow-watchdog \
         if that is meant; nothing was set"
    ))
}

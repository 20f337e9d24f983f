//! Outputs that stay on for long, or for ever, after the cable of their remote has broken.

use clap::Args;
use mesa_hal::driver::{RemotePart, RemoteWatchdog, SerialPort};
use mesa_hal::hal::GroupId;
use mesa_hal::{Configured, Driver, RemoteLabel, Rounded};

use crate::board::bus::Bus;
use crate::ui::context::Failure;
use crate::ui::output::complain;

/// Argument of a command that drives outputs of remotes.
#[derive(Clone, Copy, Debug, Args)]
pub struct SlowWatchdog {
    /// Allow outputs of a remote whose own watchdog is off, longer than 1 s, or not shown to bite:
    /// when its cable breaks, nothing else switches them off
    #[arg(long)]
    slow_watchdog: bool,
}

impl SlowWatchdog {
    /// Checks the watchdog times that the remotes of these outputs store. Returns a warning about
    /// slow watchdogs, or fails if they were not allowed.
    pub fn check(self, board: &Configured<Bus>, groups: &[GroupId]) -> Result<String, Failure> {
        let driven = |remote: &RemotePart| groups.contains(&remote.pins.group);
        let remotes = board.remotes().filter(|(_, remote)| driven(remote));
        let slow = remotes.filter_map(|(_, remote)| {
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
            Some(format!("the own watchdog of {} {how}", remote.label()))
        });
        let slow: Vec<_> = slow.collect();
        match &*slow.join("; ") {
            "" => Ok(String::new()),
            said if self.slow_watchdog => Ok(format!(". Beware: {said}")),
            said => Err(refused(said)),
        }
    }

    /// Lets the watchdogs bite, with all outputs off, because the time that a remote stores may not
    /// be the one in use. All groups have to be re-armed afterwards.
    pub fn prove(self, driver: &mut Driver<Bus>, groups: &[GroupId]) -> Result<(), Failure> {
        let slow = |driver: &Driver<Bus>| {
            let remotes = driver.ports().iter().flat_map(SerialPort::remotes);
            let slow = remotes
                .filter(|remote| groups.contains(&remote.pins.group) && remote.watchdog.is_slow());
            slow.map(|remote| remote.label).collect::<Vec<_>>()
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
        found.retain(|remote| !known.contains(remote));
        if found.is_empty() {
            return Ok(());
        }
        let said = format!(
            "the own watchdog of {} has not shown that it bites within the time of NVWatchDogTimeout: \
             a new value is used from the next power-up on, and until then another one, or none. \
             When its cable breaks, what is on may stay on",
            found
                .iter()
                .map(RemoteLabel::to_string)
                .collect::<Vec<_>>()
                .join(" and ")
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
         to allow it; nothing was set"
    ))
}

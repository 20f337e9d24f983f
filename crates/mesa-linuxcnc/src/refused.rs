//! The message that the driver does not take the period of the thread.

use core::fmt;

use mesa_hal::{MesaError, Rounded};

use mesa_hal::driver::DriverError;

use crate::advice::words;
use crate::report::Names;

/// A period that the driver does not take, and what to do.
pub(crate) struct RefusedPeriod<'a> {
    pub names: &'a Names,
    pub error: &'a DriverError,
}

impl fmt::Display for RefusedPeriod<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let board = self.names.board();
        if let DriverError::WatchdogTooShort {
            remote,
            watchdog,
            needed,
            period,
            ..
        } = self.error
        {
            let [watchdog, needed, period] = [watchdog, needed, period].map(Rounded);
            write!(
                f,
                "{}: all outputs off: its watchdog bites after {watchdog}, and a thread of {period} needs \
                 {needed}; ",
                self.names.subject(*remote)
            )?;
            f.write_str(if remote.is_some() {
                "choose a faster thread, or set NVWatchDogTimeout by `mesa param`"
            } else {
                "choose a faster thread, or set watchdog.timeout_ns"
            })?;
        } else {
            let error = self.error.with_advice().in_words(words);
            write!(f, "{board}: all outputs off: {error}")?;
        }
        write!(f, "; then set {board}.io_error to FALSE to try again")
    }
}

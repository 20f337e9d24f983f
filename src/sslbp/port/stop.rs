//! Reset and stop.

use super::{PortResult, SetupPort};
use crate::{
    advice,
    bus::{Clock, RegisterBus},
    sslbp::{ChannelMask, PortError, PortOperation, PortParameters},
};
use core::time::Duration;

/// Content of DATA after STOPALL or reset: the port is initialised, or about to be.
const INITIALISED: u8 = 0xAA;

/// The initialisation takes 142 us at 100 MHz, and a command in the first 22 us is lost (FACTS
/// 2.5). On a 33 MHz card these times are three times as long.
const INITIALISE: Duration = Duration::from_micros(500);
const INITIALISE_LIMIT: Duration = Duration::from_millis(20);
const INITIALISE_ATTEMPTS: u8 = 20;

impl<B: RegisterBus + Clock> SetupPort<'_, B> {
    /// Resets the port's processor, waits until it is initialised and reads its parameters.
    ///
    /// COMMAND is written regardless of its present content: a reset is for a port that does not
    /// respond. Afterwards, all channels are stopped and have the default baud rate.
    ///
    /// FACTS 2.5.
    pub fn reset(&mut self) -> PortResult<PortParameters> {
        self.port.parameters = None;
        self.issue(PortOperation::Reset, &[])?;
        self.bus.wait(PortOperation::Reset.times().usual);
        self.run(PortOperation::Release, &[])?;
        self.await_initialised()?;
        self.identify()
    }

    /// Reads local parameter 3 until the result is valid: DATA reads AA as long as reads are lost.
    fn await_initialised(&mut self) -> PortResult<()> {
        let begin = self.bus.now();
        for _ in 0..INITIALISE_ATTEMPTS {
            match self.local_read(PortParameters::MINOR) {
                Ok(INITIALISED) => {}
                Ok(_) => return Ok(()),
                // A read during the first microseconds never completes.
                Err(PortError::Timeout { .. }) => self.free()?,
                Err(other) => return Err(other),
            }
            if self.bus.now().since(begin) >= INITIALISE_LIMIT {
                break;
            }
            self.bus.wait(INITIALISE);
        }
        let waited = self.bus.now().since(begin);
        let waiting_for = format_args!("the processor to initialise after a reset");
        Err(self.timeout(waited, waiting_for, false)?)
    }

    /// Frees a port whose COMMAND never clears, with the one write that is allowed while it is
    /// busy.
    ///
    /// The operation that kept it busy must be over: this write ends the waiting and not the
    /// transfer (FACTS 3.2), and the STOPALL that follows would get stuck again.
    fn free(&mut self) -> PortResult<()> {
        self.run(PortOperation::Free, &[])?;
        Ok(())
    }

    /// Stops all channels and initialises everything, baud rates included.
    ///
    /// First waits for COMMAND to be 0. If it never is, or if STOPALL gets stuck, recovers with
    /// 08FF, a wait, and 0800 (FACTS 3.1). Then checks that every channel is stopped.
    ///
    /// Manual: 7I77, "STOP ALL".
    pub fn stop_all(&mut self) -> PortResult<()> {
        // Another host may write COMMAND as well, and a network may deliver its write late.
        self.port.machine.not_observed();
        match self.stop_with(PortOperation::StopAll) {
            Err(PortError::Timeout { .. }) => {
                self.free()?;
                self.stop_with(PortOperation::StopAll)
            }
            result => result,
        }
    }

    /// Stops the channels of `mask`; the others continue to run. The baud rate is kept.
    ///
    /// For recovery of single channels; does nothing if `mask` is empty.
    ///
    /// Manual: 7I77, "STOP INDIVIDUAL CHANNELS".
    pub fn stop(&mut self, mask: ChannelMask) -> PortResult<()> {
        self.require_existing(mask)?;
        if mask.is_empty() {
            return Ok(());
        }
        self.stop_with(PortOperation::Stop(mask))
    }

    fn stop_with(&mut self, operation: PortOperation) -> PortResult<()> {
        let (complete, snapshot) = self.run(operation, &[])?;
        let Some(channel) = complete.bad.iter().next() else {
            return Ok(());
        };
        Err(PortError::Channel {
            port: self.port.layout.instance,
            channel,
            failed: "not stopped by a stop".into(),
            cs: snapshot.status(channel),
            advice: Some(advice::RESET_PORT),
        })
    }
}

//! Reset and stop.

use super::{Port, PortResult};
use crate::{
    bus::{Clock, RegisterBus},
    sslbp::{ChannelMask, Operation, PortError, PortParameters},
};
use core::time::Duration;

/// What DATA reads after STOPALL or reset: the port is initialised, or about to be.
const INITIALISED: u8 = 0xAA;

/// The initialisation takes 142 us at 100 MHz, and a command in the first 22 us is lost (FACTS
/// 2.5). On a 33 MHz card all that takes three times as long.
const INITIALISE: Duration = Duration::from_micros(500);
const INITIALISE_LIMIT: Duration = Duration::from_millis(20);
const INITIALISE_ATTEMPTS: u8 = 20;

impl Port {
    /// Resets the port's processor, waits until it is initialised and reads its parameters.
    ///
    /// COMMAND is written whatever it is at that time: a reset is for a port that does not listen.
    /// All channels are stopped then, with the default baud rate.
    ///
    /// FACTS 2.5.
    pub fn reset<B: RegisterBus + Clock>(&mut self, bus: &mut B) -> PortResult<PortParameters, B> {
        self.parameters = None;
        self.issue(bus, Operation::Reset, &[])?;
        bus.wait(Operation::Reset.times().usual);
        self.run(bus, Operation::Release, &[])?;
        self.await_initialised(bus)?;
        self.identify(bus)
    }

    /// Reads local parameter 3 until it is one: DATA reads AA as long as reads are lost.
    fn await_initialised<B: RegisterBus + Clock>(&mut self, bus: &mut B) -> PortResult<(), B> {
        let begin = bus.now();
        for _ in 0..INITIALISE_ATTEMPTS {
            match self.local_read(bus, PortParameters::MINOR) {
                Ok(INITIALISED) => {}
                Ok(_) => return Ok(()),
                // A read that fell into the first microseconds never completes.
                Err(PortError::Timeout { .. }) => self.free(bus)?,
                Err(other) => return Err(other),
            }
            if bus.now().since(begin) >= INITIALISE_LIMIT {
                break;
            }
            bus.wait(INITIALISE);
        }
        let waited = bus.now().since(begin);
        let waiting_for = format_args!("the processor to initialise after a reset");
        Err(self.timeout(bus, waited, waiting_for, false)?)
    }

    /// Frees a port whose COMMAND never clears: the one write that is allowed while it is busy.
    ///
    /// What kept it busy must be over: the way out ends the waiting and not the transfer (FACTS
    /// 3.2), and the STOPALL that follows would stick again.
    fn free<B: RegisterBus + Clock>(&mut self, bus: &mut B) -> PortResult<(), B> {
        self.run(bus, Operation::Free, &[])?;
        Ok(())
    }

    /// Stops all channels and initialises everything, baud rates included.
    ///
    /// Waits for COMMAND to be 0 first. If it never is, or if STOPALL sticks, takes the way out:
    /// 08FF, wait, 0800 (FACTS 3.1). Then checks that every channel is stopped.
    ///
    /// Manual: 7I77, "STOP ALL".
    pub fn stop_all<B: RegisterBus + Clock>(&mut self, bus: &mut B) -> PortResult<(), B> {
        // Another host may write COMMAND as well, and a network may do it late.
        self.machine.not_observed();
        match self.stop_with(bus, Operation::StopAll) {
            Err(PortError::Timeout { .. }) => {
                self.free(bus)?;
                self.stop_with(bus, Operation::StopAll)
            }
            result => result,
        }
    }

    /// Stops the channels of `mask`; the others go on. The baud rate is kept.
    ///
    /// For recovery of single channels; does nothing if `mask` is empty.
    ///
    /// Manual: 7I77, "STOP INDIVIDUAL CHANNELS".
    pub fn stop<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        mask: ChannelMask,
    ) -> PortResult<(), B> {
        self.require_existing(mask)?;
        if mask.is_empty() {
            return Ok(());
        }
        self.stop_with(bus, Operation::Stop(mask))
    }

    fn stop_with<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
        operation: Operation,
    ) -> PortResult<(), B> {
        let (complete, snapshot) = self.run(bus, operation, &[])?;
        let Some(channel) = complete.bad.iter().next() else {
            return Ok(());
        };
        Err(PortError::Channel {
            port: self.layout.instance,
            channel,
            failed: "not stopped by a stop".into(),
            cs: snapshot.status(channel),
            hint: "reset the port",
        })
    }
}

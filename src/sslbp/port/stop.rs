//! Reset and stop.

use super::{
    Port, PortResult,
    wait::{Expected, Poll},
};
use crate::{
    bus::{BusError, Clock, RegisterBus},
    sslbp::{
        Channel, ChannelMask, Command, CsStatus, DataStatus, LocalAddress, MAX_CHANNELS, PortError,
        PortParameters, PortState, ProcessDataSizes, WaitingFor,
    },
};
use core::time::Duration;

/// FACTS 3: 120 us with 8 channels at 100 MHz, three times that on a card with 33 MHz.
const STOP_ALL: Expected = Expected {
    usual: Duration::from_micros(125),
    limit: Duration::from_millis(10),
};

/// FACTS 3: 3 to 7 us.
const STOP_SOME: Expected = Expected {
    usual: Duration::from_micros(5),
    limit: Duration::from_millis(10),
};

/// From COMMAND = 0 to the last wiped register: 6 us after STOPALL (FACTS 3), and less than the
/// 50 us that the transcript waits after stopping some.
const WIPE: Duration = Duration::from_micros(50);

/// How long the processor is held in reset.
const HOLD_RESET: Duration = Duration::from_micros(20);

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
        self.forget(PortState::Unknown);
        self.parameters = None;
        self.issue(bus, Command::RESET, &[])?;
        bus.wait(HOLD_RESET);
        self.issue(bus, Command::RELEASE, &[])?;
        bus.wait(INITIALISE);
        self.await_initialised(bus)?;
        self.state = PortState::Stopped;
        self.identify(bus)
    }

    /// Reads local parameter 3 until it is one: DATA reads AA as long as reads are lost.
    fn await_initialised<B: RegisterBus + Clock>(&mut self, bus: &mut B) -> PortResult<(), B> {
        let begin = bus.now();
        let minor = LocalAddress::MINOR;
        for _ in 0..INITIALISE_ATTEMPTS {
            match self.local_read(bus, minor) {
                Ok(DataStatus::INITIALISED) => {}
                Ok(_) => return Ok(()),
                // A read that fell into the first microseconds never completes.
                Err(PortError::Wait(_)) => self.free(bus)?,
                Err(other) => return Err(other),
            }
            if bus.now().since(begin) >= INITIALISE_LIMIT {
                break;
            }
            bus.wait(INITIALISE);
        }
        let waited = bus.now().since(begin);
        let waiting_for = WaitingFor::Initialisation;
        Err(self.wait_error(bus, waiting_for, waited)?.into())
    }

    /// Stops all channels and initialises everything, baud rates included.
    ///
    /// Waits for COMMAND to be 0 first. If it never is, or if STOPALL sticks, takes the way out:
    /// 08FF, wait, 0800 (FACTS 3.1). Then checks that every channel is stopped.
    ///
    /// Manual: 7I77, "STOP ALL".
    pub fn stop_all<B: RegisterBus + Clock>(&mut self, bus: &mut B) -> PortResult<(), B> {
        self.forget(PortState::Unknown);
        // A cycle writes COMMAND as well.
        self.idle = false;
        if let Err(error) = self.stop_all_once(bus) {
            if !matches!(error, PortError::Wait(_)) {
                return Err(error);
            }
            self.free(bus)?;
            self.stop_all_once(bus)?;
        }
        bus.wait(WIPE);
        self.check_stopped(bus, self.layout.mask())?;
        self.forget(PortState::Stopped);
        Ok(())
    }

    fn stop_all_once<B: RegisterBus + Clock>(&mut self, bus: &mut B) -> PortResult<Poll, B> {
        self.execute(bus, Command::STOP_ALL, &[], [], STOP_ALL)
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
        let Some(command) = Command::stop(mask) else {
            return Ok(());
        };
        self.execute(bus, command, &[], [], STOP_SOME)?;
        self.running = self.running.difference(mask);
        bus.wait(WIPE);
        self.check_stopped(bus, mask)
    }

    fn check_stopped<B: RegisterBus + Clock>(
        &self,
        bus: &mut B,
        mask: ChannelMask,
    ) -> PortResult<(), B> {
        let registers = self.snapshot(bus)?;
        for (channel, &cs) in self.layout.mask().iter().zip(&registers.cs) {
            if mask.contains(channel) && !cs.is_stopped() {
                return Err(self.not_stopped(channel, cs));
            }
        }
        Ok(())
    }

    fn not_stopped<E: BusError>(&self, channel: Channel, cs: CsStatus) -> PortError<E> {
        PortError::NotStopped {
            port: self.layout.instance(),
            channel,
            cs,
        }
    }

    fn forget(&mut self, state: PortState) {
        self.state = state;
        self.running = ChannelMask::NONE;
        self.sizes = [ProcessDataSizes::default(); MAX_CHANNELS as usize];
    }
}

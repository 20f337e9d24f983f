//! The eight serial lines of a port, as seen from inside the FPGA.

use crate::wire::{Burst, Nanos, RemoteEnd};

/// The far ends of a port's serial lines.
///
/// The port makes its calls in time order: [`transmit`](Self::transmit) when the last stop bit of a
/// burst has left the FPGA, then immediately [`receive`](Self::receive) until it returns `None`. A
/// burst towards the FPGA may begin (much) later than that; bursts of one channel must be in order.
pub trait Lines {
    /// A burst of the FPGA on `channel` has ended, at `burst.end()`.
    fn transmit(&mut self, channel: usize, burst: &Burst);

    /// The next burst towards the FPGA on `channel`, if there is one.
    fn receive(&mut self, channel: usize) -> Option<Burst>;

    /// True if the line towards the FPGA is held low at `now`.
    fn held_low(&mut self, channel: usize, now: Nanos) -> bool {
        let _ = (channel, now);
        false
    }

    /// Advances the far ends to `now`, also those without any communication.
    fn advance(&mut self, now: Nanos) {
        let _ = now;
    }
}

/// Lines with nothing plugged in: every burst is lost, and there are no replies.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoLines;

impl Lines for NoLines {
    fn transmit(&mut self, _channel: usize, _burst: &Burst) {}

    fn receive(&mut self, _channel: usize) -> Option<Burst> {
        None
    }
}

/// One socket per channel, with or without a remote in it.
impl<const N: usize> Lines for [Option<Box<dyn RemoteEnd>>; N] {
    fn transmit(&mut self, channel: usize, burst: &Burst) {
        if let Some(Some(remote)) = self.get_mut(channel) {
            remote.advance(burst.end());
            remote.receive(burst);
        }
    }

    fn receive(&mut self, channel: usize) -> Option<Burst> {
        self.get_mut(channel)?.as_mut()?.transmit()
    }

    fn held_low(&mut self, channel: usize, now: Nanos) -> bool {
        match self.get_mut(channel) {
            Some(Some(remote)) => {
                remote.advance(now);
                remote.holds_line_low()
            }
            _ => false,
        }
    }

    fn advance(&mut self, now: Nanos) {
        for remote in self.iter_mut().flatten() {
            remote.advance(now);
        }
    }
}

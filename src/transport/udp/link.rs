//! Transport of the packets: a socket, the network stack of a microcontroller, or the simulated
//! network of a test.

use core::time::Duration;

use crate::bus::{Instant, LinkError};

/// Carries datagrams to one board and back, and provides the time.
///
/// [`UdpBus`](super::UdpBus) is generic over it: the bus runs on any network stack, and losses,
/// delays and duplicates are tested on virtual time.
///
/// # Real time
/// The cycle calls all methods but the two sleeps. They must not allocate, and only
/// [`receive`](Self::receive) may wait.
pub trait PacketLink {
    /// Sends one datagram to the board. Returns without waiting: the network or the stack may
    /// still lose it.
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError>;

    /// The next datagram from the board, or `None` if none arrives until `deadline`. If the
    /// deadline has passed, it returns a datagram that has already arrived, without waiting.
    ///
    /// A datagram longer than `buffer` is truncated; provide room for more than any reply.
    /// Datagrams of other senders should be left out; those that are not are counted as
    /// [foreign](crate::bus::BusStatistics::foreign), unless they look like a reply.
    fn receive(&mut self, buffer: &mut [u8], deadline: Instant)
    -> Result<Option<usize>, LinkError>;

    /// The time. Never goes back. The replies of a cycle are measured with it: a resolution of
    /// 10 us or better is needed.
    fn now(&mut self) -> Instant;

    /// Waits until `deadline`. Datagrams that arrive meanwhile are kept for
    /// [`receive`](Self::receive).
    fn sleep_until(&mut self, deadline: Instant);

    /// Waits for at least `duration` without using the CPU: [`Clock::sleep`](crate::Clock::sleep).
    fn sleep(&mut self, duration: Duration) {
        let deadline = self.now().after(duration);
        self.sleep_until(deadline);
    }
}

impl<L: PacketLink + ?Sized> PacketLink for &mut L {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        (**self).send(packet)
    }

    fn receive(
        &mut self,
        buffer: &mut [u8],
        deadline: Instant,
    ) -> Result<Option<usize>, LinkError> {
        (**self).receive(buffer, deadline)
    }

    fn now(&mut self) -> Instant {
        (**self).now()
    }

    fn sleep_until(&mut self, deadline: Instant) {
        (**self).sleep_until(deadline);
    }

    fn sleep(&mut self, duration: Duration) {
        (**self).sleep(duration);
    }
}

//! Detection of a restart.

use super::{Counters, EthernetBoard, EthernetError, Lbp16Board};

impl<B: Lbp16Board> EthernetBoard<'_, B> {
    /// Checks that the board has restarted since `before` was read, by its count of packets, which
    /// starts again at 0. Returns the current counters.
    ///
    /// Call it again, a bounded number of times, while the board does not answer yet.
    ///
    /// # Errors
    /// [`EthernetError::NotRestarted`] if the count has grown: the packet with the command was
    /// lost. Errors of the bus while the board does not answer.
    pub fn restarted(&mut self, before: &Counters) -> Result<Counters, EthernetError> {
        let after = self.counters()?;
        if after.received_udp > before.received_udp {
            return Err(EthernetError::NotRestarted {
                before: before.received_udp,
                after: after.received_udp,
            });
        }
        Ok(after)
    }
}

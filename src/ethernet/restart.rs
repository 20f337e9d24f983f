//! Whether a board has restarted.

use super::{Counters, EthernetBoard, EthernetError, Lbp16Board};

impl<B: Lbp16Board> EthernetBoard<'_, B> {
    /// Whether the board has restarted since it counted `before`, by its count of packets, which
    /// begins at 0 again. Returns what it has counted since.
    ///
    /// Call it again, a bounded number of times, while the board does not answer yet.
    ///
    /// # Errors
    /// [`EthernetError::NotRestarted`] if it goes on counting: the packet with the command was lost.
    /// Those of the bus while it does not answer.
    pub fn restarted(&mut self, before: &Counters) -> Result<Counters, EthernetError<B::Error>> {
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

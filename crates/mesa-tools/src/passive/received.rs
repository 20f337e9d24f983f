//! Packets that the board receives, of all programs.

use core::time::Duration;

use mesa_hal::bus::{Clock, Instant};
use mesa_hal::lbp16::Space;
use mesa_hal::lbp16::registers::control;
use mesa_hal::transport::udp::PacketLink;

use super::{PassiveBus, PassiveError, Read};

/// Interval over which packets of other programs are counted, at least: each count costs a packet.
pub(super) const COUNTED: Duration = Duration::from_millis(200);

/// Packet count of the board, and the packets of the bus, at a time.
#[derive(Clone, Copy, Debug)]
pub(super) struct Received {
    pub at: Instant,
    counted: u16,
    own: u64,
}

impl Received {
    /// The register with the count.
    const REGISTER: Read = Read {
        space: Space::Control,
        address: control::RX_UDP,
        count: 1,
    };

    pub fn read<L: PacketLink>(bus: &mut PassiveBus<L>) -> Result<Self, PassiveError> {
        let words = bus.read_all(&[Self::REGISTER])?;
        Ok(Self {
            at: bus.now(),
            counted: words.first().copied().unwrap_or_default() as u16,
            own: bus.packets().packets,
        })
    }

    /// Packets of other programs in a second. The count has 16 bits: correct if fewer than 65,536
    /// packets arrived in between.
    pub fn others_since(self, before: Self) -> f64 {
        let all = self.counted.wrapping_sub(before.counted);
        let others = u64::from(all).saturating_sub(self.own - before.own);
        others as f64
            / self
                .at
                .since(before.at)
                .as_secs_f64()
                .max(f64::MIN_POSITIVE)
    }
}

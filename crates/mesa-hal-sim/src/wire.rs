//! The serial line between an FPGA channel and its remote: bursts of characters with times.

/// Nanoseconds of virtual time since the simulation's power-up.
pub type Nanos = u64;

/// Maximum number of characters of a [`Burst`]; the longest SSLBP frame has 14.
pub const MAX_BURST: usize = 32;

/// One bit at 2.5 Mbaud.
pub const BIT_2M5: Nanos = 400;

/// A run of characters without gaps (8N1: ten bits each), or a break.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Burst {
    /// Falling edge of the first start bit.
    pub start: Nanos,
    /// Length of one bit in nanoseconds.
    pub bit: Nanos,
    /// The line is held low for the length of the burst instead of sending its characters.
    pub is_break: bool,
    bytes: [u8; MAX_BURST],
    len: u8,
}

impl Burst {
    /// A burst that begins at `start`; characters past [`MAX_BURST`] are dropped.
    pub fn new(start: Nanos, bit: Nanos, data: &[u8]) -> Self {
        let mut burst = Self {
            start,
            bit,
            is_break: false,
            bytes: [0; MAX_BURST],
            len: 0,
        };
        for &byte in data {
            burst.push(byte);
        }
        burst
    }

    /// Appends one character, unless the burst is full.
    pub fn push(&mut self, byte: u8) {
        if let Some(slot) = self.bytes.get_mut(usize::from(self.len)) {
            *slot = byte;
            self.len += 1;
        }
    }

    /// The characters.
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.len)).unwrap_or(&[])
    }

    /// The characters, mutable to corrupt them.
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        self.bytes
            .get_mut(..usize::from(self.len))
            .unwrap_or_default()
    }

    /// Cuts characters off the end until at most `len` remain.
    pub fn truncate(&mut self, len: usize) {
        if len < usize::from(self.len) {
            self.len = len as u8;
        }
    }

    /// Number of characters.
    pub fn len(&self) -> usize {
        usize::from(self.len)
    }

    /// True if the burst has no characters.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// End of the stop bit of character `index`.
    pub fn end_of(&self, index: usize) -> Nanos {
        self.start + (index as Nanos + 1) * 10 * self.bit
    }

    /// End of the last stop bit.
    pub fn end(&self) -> Nanos {
        self.start + self.len() as Nanos * 10 * self.bit
    }
}

/// A device on a channel's serial line: the far end of the RS-422 cable.
///
/// The channel makes its calls in time order: [`advance`](Self::advance) to a time, then
/// [`receive`](Self::receive) when a burst from the FPGA has ended. A reply is fetched with
/// [`transmit`](Self::transmit) directly after `receive`; it begins at or after that time.
///
/// The trait requires [`Any`](core::any::Any), so that a plugged device can be accessed by its own
/// type.
pub trait RemoteEnd: core::any::Any + core::fmt::Debug + Send {
    /// Advances to `now`: watchdogs, frame timeouts, slow non-volatile writes.
    fn advance(&mut self, now: Nanos);

    /// Receives a burst from the FPGA that has ended at `burst.end()`.
    fn receive(&mut self, burst: &Burst);

    /// The next burst towards the FPGA, if there is one. Called until it returns `None`.
    fn transmit(&mut self) -> Option<Burst>;

    /// True if the line towards the FPGA is held low (no receiver bias, a stuck break).
    fn holds_line_low(&self) -> bool {
        false
    }

    /// Time of the next spontaneous event: the watchdog bites, a write to the EEPROM ends. The
    /// simulation calls [`advance`](Self::advance) for that time, even without communication.
    /// `None` if nothing is due.
    fn next_event(&self) -> Option<Nanos> {
        self.inner().and_then(RemoteEnd::next_event)
    }

    /// The device behind this one, if this one is only a wrapper (wire faults, a recorder).
    fn inner(&self) -> Option<&dyn RemoteEnd> {
        None
    }

    /// Mutable access to [`inner`](Self::inner).
    fn inner_mut(&mut self) -> Option<&mut dyn RemoteEnd> {
        None
    }
}

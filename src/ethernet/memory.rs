//! Direct access to registers of any space.

use alloc::{vec, vec::Vec};

use super::packets::QUICK;
use super::{EthernetBoard, EthernetError, Lbp16Board};
use crate::lbp16::registers::{control, eeprom, timer};
use crate::lbp16::{ElementSize, MAX_COUNT, Space, elements};

/// Error counters of the board, which are read before and after an access.
const COUNTERS: u8 = 3;
/// Their size in bytes.
const COUNTED: usize = 2 * COUNTERS as usize;

/// Direct access to registers.
impl<B: Lbp16Board> EthernetBoard<'_, B> {
    /// Reads `count` neighbouring registers of a space, 1 or more, each of the space's [own
    /// size](Space::element).
    ///
    /// Reading has side effects in some places: the data port of the flash memory increments its
    /// address, and registers of the timer space wait.
    ///
    /// # Errors
    /// [`EthernetError::NoRegister`] if the registers are not inside of the 64 KB that an address
    /// covers, or if the board counts an error during the access, and errors of the bus.
    pub fn peek(
        &mut self,
        space: Space,
        address: u16,
        count: u16,
    ) -> Result<Vec<u32>, EthernetError> {
        check(space, address, usize::from(count))?;
        let mut values = Vec::with_capacity(usize::from(count));
        let size = space.element().bytes() as u16;
        for done in (0..count).step_by(MAX_COUNT.into()) {
            let part = count.saturating_sub(done).min(MAX_COUNT.into()) as u8;
            // Inside of the 64 KB, as checked above.
            let at = address.saturating_add(done.saturating_mul(size));
            values.extend(self.access(space, at, part, None)?);
        }
        Ok(values)
    }

    /// Writes neighbouring registers of a space, 1 to 127, in one packet, and reads them back. For
    /// 16-bit registers the low half of each value is used.
    ///
    /// Writes to the EEPROM are enabled first. A packet whose reply is lost is sent again: for
    /// writes that must not happen twice, and for `HostMot2`'s registers, use
    /// [`RegisterBus`](crate::bus::RegisterBus).
    ///
    /// # Errors
    /// [`EthernetError::NoRegister`] as for [`peek`](Self::peek), and for registers that cannot be
    /// written: the spaces 5 and 7, the first 0x20 bytes of the EEPROM, the scratch registers of
    /// the timer space, in which buses number their packets (FACTS 10.1), and the flash memory,
    /// which is written through [`Flash`](super::Flash); and errors of the bus.
    pub fn poke(
        &mut self,
        space: Space,
        address: u16,
        values: &[u32],
    ) -> Result<Vec<u32>, EthernetError> {
        Self::check_poke(space, address, values.len())?;
        let count = u8::try_from(values.len()).unwrap_or(u8::MAX);
        debug_assert_eq!(usize::from(count), values.len(), "checked before");
        self.access(space, address, count, Some(values))
    }

    /// Checks that [`poke`](Self::poke) accepts `count` registers from an address on, without
    /// writing any.
    ///
    /// # Errors
    /// [`EthernetError::NoRegister`], as for [`poke`](Self::poke).
    pub fn check_poke(space: Space, address: u16, count: usize) -> Result<(), EthernetError> {
        check(space, address, count)?;
        let reason = match space {
            Space::ReadOnly | Space::Unused => Some("its space cannot be written"),
            Space::Flash => Some("the flash memory is written by its own commands"),
            Space::Timer if end(space, address, count) > timer::SCRATCH.into() => {
                Some("the bus numbers its packets there")
            }
            Space::Eeprom if address < eeprom::FIRST_WRITABLE => {
                Some("the EEPROM can be written from 0x20 on")
            }
            _ => None,
        };
        reason.map_or(Ok(()), |reason| {
            Err(EthernetError::NoRegister {
                space,
                address,
                reason,
            })
        })
    }

    /// Runs one packet: the error counters, the write, the read, and the counters again.
    fn access(
        &mut self,
        space: Space,
        address: u16,
        count: u8,
        values: Option<&[u32]>,
    ) -> Result<Vec<u32>, EthernetError> {
        let size = space.element().bytes();
        let len = usize::from(count).saturating_mul(size);
        let mut reply = vec![0; len.saturating_add(2 * COUNTED)];
        self.run(&mut reply, QUICK, |request| {
            request.read(Space::Control, control::PARSE_ERRORS, COUNTERS)?;
            if let Some(values) = values {
                if space == Space::Eeprom {
                    let enable = control::ENABLE_EEPROM.to_le_bytes();
                    request.write(Space::Control, control::WRITE_ENABLE, &enable)?;
                }
                let bytes = values.iter().map(|value| value.to_le_bytes());
                let bytes = bytes.flat_map(|bytes| bytes.into_iter().take(size));
                request.write(space, address, &bytes.collect::<Vec<u8>>())?;
            }
            request.read(space, address, count)?;
            request.read(Space::Control, control::PARSE_ERRORS, COUNTERS)
        })?;
        let (before, rest) = reply.split_at_checked(COUNTED).unwrap_or_default();
        let (read, after) = rest.split_at_checked(len).unwrap_or_default();
        debug_assert_eq!((before.len(), after.len()), (COUNTED, COUNTED), "as read");
        // The write may have changed the counters themselves.
        if before != after && space != Space::Control {
            return Err(EthernetError::NoRegister {
                space,
                address,
                reason: "the board counts an error",
            });
        }
        let registers = elements(read, space.element());
        Ok(registers.map(|register| register as u32).collect())
    }
}

/// The address behind `count` registers.
fn end(space: Space, address: u16, count: usize) -> usize {
    let bytes = count.saturating_mul(space.element().bytes());
    bytes.saturating_add(address.into())
}

/// Checks that `count` registers can exist from an address on.
fn check(space: Space, address: u16, count: usize) -> Result<(), EthernetError> {
    let size = space.element().bytes();
    let reason = if !usize::from(address).is_multiple_of(size) {
        match space.element() {
            ElementSize::Double => "addresses of this space are multiples of 4",
            _ => "addresses of this space are multiples of 2",
        }
    } else if count == 0 {
        "one register is the least"
    } else if end(space, address, count) > 0x1_0000 {
        "a space ends at 0x10000"
    } else {
        return Ok(());
    };
    Err(EthernetError::NoRegister {
        space,
        address,
        reason,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_count_is_so_great_that_it_looks_small() {
        for count in [usize::MAX, usize::MAX / 2 + 2, usize::MAX / 4 + 2] {
            for space in [Space::HostMot2, Space::Control] {
                let checked = check(space, 0, count);
                assert!(checked.is_err(), "{count} registers of space {space}");
            }
        }
    }
}

//! The address pointers of a board.

use super::{Operation, Space};

/// The address pointers: one for each space, and one for each info area.
///
/// "Each memory space has its own address pointer" (manual 7I97, "LBP16 COMMANDS"). An info area
/// can show its space's pointer at address 6, which only makes sense if looking does not move it:
/// so info areas have pointers of their own here.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AddressPointers {
    spaces: [u16; 8],
    infos: [u16; 8],
}

impl AddressPointers {
    /// All pointers at 0.
    pub fn new() -> Self {
        Self::default()
    }

    /// Where the pointer of a space stands.
    pub fn get(&self, space: Space) -> u16 {
        let numbered = self.spaces.iter().zip(Space::ALL);
        numbered
            .filter(|(_, other)| *other == space)
            .map(|(pointer, _)| *pointer)
            .sum()
    }

    /// Loads the pointer of an operation's space, if the operation has an address.
    pub fn begin(&mut self, operation: &Operation<'_>) {
        if let (Some(address), Some(pointer)) = (operation.address, self.pointer(operation)) {
            *pointer = address;
        }
    }

    /// The address of the next element of an operation. Moves the pointer on, if the command
    /// increments.
    pub fn next(&mut self, operation: &Operation<'_>) -> u16 {
        let Some(pointer) = self.pointer(operation) else {
            return 0;
        };
        let address = *pointer;
        if operation.command.increment {
            *pointer = address.wrapping_add(operation.command.size.bytes() as u16);
        }
        address
    }

    fn pointer(&mut self, operation: &Operation<'_>) -> Option<&mut u16> {
        let pointers = if operation.command.info {
            &mut self.infos
        } else {
            &mut self.spaces
        };
        pointers.get_mut(usize::from(operation.command.space.number()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lbp16::Operations;

    fn addresses(pointers: &mut AddressPointers, request: &[u8]) -> Vec<u16> {
        let mut all = Vec::new();
        for operation in Operations::new(request) {
            let operation = operation.unwrap();
            pointers.begin(&operation);
            for _ in 0..operation.command.count() {
                all.push(pointers.next(&operation));
            }
        }
        all
    }

    #[test]
    fn a_pointer_moves_by_the_element_size_or_stands() {
        let mut pointers = AddressPointers::new();
        // Manual: 7I97, "LBP16 COMMANDS", bit I.
        let request = [0x83, 0x42, 0x00, 0x04, 0x01, 0x02, 0x01, 0x02];
        assert_eq!(
            addresses(&mut pointers, &request),
            [0x400, 0x404, 0x408, 0x40C, 0x40C]
        );
        assert_eq!(addresses(&mut pointers, &[0x82, 0x1D]), [0, 2]);
        assert_eq!(pointers.get(Space::ReadOnly), 4);
        assert_eq!(pointers.get(Space::HostMot2), 0x40C);
    }

    #[test]
    fn looking_at_an_info_area_leaves_the_pointer_of_the_space() {
        let mut pointers = AddressPointers::new();
        addresses(&mut pointers, &[0x01, 0x42, 0x34, 0x12]);
        assert_eq!(addresses(&mut pointers, &[0x82, 0x61, 0x06, 0x00]), [6, 8]);
        assert_eq!(pointers.get(Space::HostMot2), 0x1234);
    }

    #[test]
    fn a_pointer_wraps_at_the_end_of_the_space() {
        let mut pointers = AddressPointers::new();
        assert_eq!(
            addresses(&mut pointers, &[0x82, 0x42, 0xFC, 0xFF]),
            [0xFFFC, 0]
        );
    }
}

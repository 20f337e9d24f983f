//! Address pointers: the address of a command that has none.

use mesa_wire::lbp16::{Operation, Space};

/// The address pointers of a board: one for each space, and one for each info area.
///
/// "Each memory space has its own address pointer" (manual 7I97, "LBP16 COMMANDS"). An info area
/// can show its space's pointer at address 6, which only makes sense if reading the area does not
/// move the pointer: info areas therefore have pointers of their own here.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct AddressPointers([[u16; 8]; 2]);

impl AddressPointers {
    /// The pointer of a space.
    pub fn get(&self, space: Space) -> u16 {
        let [spaces, _] = &self.0;
        spaces.get(space as usize).copied().unwrap_or(0)
    }

    /// The addresses of the elements of an operation. Loads the pointer if the operation has an
    /// address, and moves it past the last element if the command increments.
    pub fn addresses(&mut self, operation: &Operation<'_>) -> impl Iterator<Item = u16> + use<> {
        let command = operation.command;
        let [spaces, infos] = &mut self.0;
        let pointers = if command.info { infos } else { spaces };
        let mut unused = 0;
        let pointer = pointers.get_mut(command.space as usize);
        let pointer = pointer.unwrap_or(&mut unused);
        let first = operation.address.unwrap_or(*pointer);
        let step = u16::from(command.increment) * command.size.bytes() as u16;
        *pointer = first.wrapping_add(step * u16::from(command.count));
        (0..command.count).map(move |n| first.wrapping_add(step * u16::from(n)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesa_wire::lbp16::Operations;

    fn addresses(pointers: &mut AddressPointers, request: &[u8]) -> Vec<u16> {
        let operations = Operations::new(request).map(Result::unwrap);
        operations
            .flat_map(|operation| pointers.addresses(&operation))
            .collect()
    }

    #[test]
    fn pointer_moves_by_the_element_size_or_stands() {
        let mut pointers = AddressPointers::default();
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
        let mut pointers = AddressPointers::default();
        addresses(&mut pointers, &[0x01, 0x42, 0x34, 0x12]);
        assert_eq!(addresses(&mut pointers, &[0x82, 0x61, 0x06, 0x00]), [6, 8]);
        assert_eq!(pointers.get(Space::HostMot2), 0x1234);
    }

    #[test]
    fn pointer_wraps_at_the_end_of_the_space() {
        let mut pointers = AddressPointers::default();
        assert_eq!(
            addresses(&mut pointers, &[0x82, 0x42, 0xFC, 0xFF]),
            [0xFFFC, 0]
        );
    }
}

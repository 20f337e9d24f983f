//! A director: acts on the world around the FPGA at exact times, and observes the driven outputs.

use super::SimFpga;
use crate::wire::Nanos;

/// Cause of a possible change of the driven outputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ChangeCause {
    /// The host wrote a register that outputs depend on, or a written word takes effect.
    Write,
    /// The watchdog has bitten.
    Bite,
    /// The FPGA lost its configuration: see [`SimFpga::reload`] and [`SimFpga::reset_for`].
    Reset,
}

/// Acts on the simulated world at set times, also in the middle of an exchange, and observes every
/// change of the driven outputs when it happens.
///
/// A test that only looks between two calls of a driver misses outputs that were on in between, and
/// can inject faults only while no driver is running.
pub trait Director: core::fmt::Debug + Send {
    /// Time of the next action; `None` if none is scheduled. A time in the past means now.
    fn due(&self) -> Option<Nanos>;

    /// Acts at the due time. The next due time must be later.
    fn act(&mut self, fpga: &mut SimFpga);

    /// Called when the driven outputs may have changed.
    fn drives(&mut self, fpga: &SimFpga, cause: ChangeCause);
}

impl SimFpga {
    /// Sets the director, and returns the previous one.
    pub fn set_director(&mut self, director: Box<dyn Director>) -> Option<Box<dyn Director>> {
        self.director.replace(director)
    }

    /// Time of the director's next action, if it is not later than `to`.
    pub(super) fn scene(&self, to: Nanos) -> Option<Nanos> {
        let due = self.director.as_ref()?.due()?;
        (due <= to).then_some(due.max(self.now()))
    }

    /// Lets the director act. Changes that it makes itself are not reported to it.
    pub(super) fn play(&mut self) {
        if let Some(mut director) = self.director.take() {
            director.act(self);
            self.director.get_or_insert(director);
        }
    }

    /// Reports the driven outputs to the director.
    pub(super) fn show(&mut self, cause: ChangeCause) {
        if let Some(mut director) = self.director.take() {
            director.drives(self, cause);
            self.director.get_or_insert(director);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use super::*;
    use crate::machines;
    use mesa_wire::bus::{Access, RegisterBus};

    #[derive(Debug, Default)]
    struct Notes {
        seen: Vec<(Nanos, bool, ChangeCause)>,
        acted: Vec<Nanos>,
    }

    #[derive(Debug)]
    struct Player {
        notes: Arc<Mutex<Notes>>,
        due: Option<Nanos>,
    }

    impl Director for Player {
        fn due(&self) -> Option<Nanos> {
            self.due
        }

        fn act(&mut self, fpga: &mut SimFpga) {
            self.due = None;
            self.notes.lock().unwrap().acted.push(SimFpga::now(fpga));
            fpga.drive_pin(33, Some(false));
        }

        fn drives(&mut self, fpga: &SimFpga, cause: ChangeCause) {
            let driven = fpga.is_driven(20);
            let mut notes = self.notes.lock().unwrap();
            notes.seen.push((fpga.now(), driven, cause));
        }
    }

    fn played(due: Option<Nanos>) -> (SimFpga, Arc<Mutex<Notes>>) {
        let mut fpga = machines::i7i92_7i77();
        let notes = Arc::<Mutex<Notes>>::default();
        let player = Player {
            notes: Arc::clone(&notes),
            due,
        };
        assert!(fpga.set_director(Box::new(player)).is_none());
        (fpga, notes)
    }

    #[test]
    fn director_acts_in_the_middle_of_an_exchange() {
        let (mut fpga, notes) = played(Some(1_500));
        fpga.set_access_cost(1_000);
        let mut words = [0, 0];
        let list = [Access::read(0x1004, 0, 1), Access::read(0x1004, 1, 1)];
        fpga.exchange(&list, &mut words).unwrap();
        // Pin 33 is bit 16 of the second port.
        assert_eq!(words.map(|word| word >> 16 & 1), [1, 0]);
        assert_eq!(notes.lock().unwrap().acted, [1_500]);
    }

    #[test]
    fn director_sees_writes_bites_and_resets_as_they_happen() {
        let (mut fpga, notes) = played(None);
        fpga.write_register(0x1104, 1 << 3);
        fpga.write_register(0x0C00, 100);
        fpga.advance_to(5_000);
        fpga.write_register(0x1104, 1 << 3);
        fpga.advance_to(6_000);
        fpga.reset_for(2_000);
        let seen = notes.lock().unwrap().seen.clone();
        let causes: Vec<_> = seen
            .iter()
            .map(|(_, driven, cause)| (*driven, *cause))
            .collect();
        let expected = [
            (true, ChangeCause::Write),
            (false, ChangeCause::Bite),
            (true, ChangeCause::Write),
            (false, ChangeCause::Reset),
        ];
        assert_eq!(causes, expected);
        assert!((1_000..1_100).contains(&seen[1].0), "{seen:?}");
    }

    #[test]
    fn fpga_in_reset_neither_replies_nor_takes_writes() {
        let mut fpga = machines::i7i92_7i77();
        fpga.reset_for(2_000);
        assert!(fpga.is_in_reset());
        fpga.write_register(0x1104, 1 << 3);
        assert_eq!(fpga.read_register(0x0100), u32::MAX);
        fpga.advance_to(2_000);
        assert!(!fpga.is_in_reset());
        assert_eq!(fpga.read_register(0x0100), 0x55AA_CAFE);
        assert_eq!(fpga.read_register(0x1104), 0);
    }
}

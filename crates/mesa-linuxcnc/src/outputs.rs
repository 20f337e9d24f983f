//! What HAL has on: the machine, and the outputs of its cards.

use mesa_hal::Driver;
use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::driver::SerialPort;
use mesa_hal::hal::Role;

use crate::rearm::{BOARD, RemoteMask};
use crate::table::Memory;

/// Numbers in HAL of the outputs that count.
#[derive(Clone, Debug)]
pub(crate) struct Outputs {
    /// The enables of axes and spindles: LinuxCNC sets them while the machine is on.
    enables: Vec<usize>,
    /// The outputs of each remote.
    of_remotes: Vec<Vec<usize>>,
}

impl Outputs {
    pub fn new<B: RegisterBus + Clock>(driver: &Driver<B>) -> Self {
        let infos = driver.pins().infos();
        let is_output = |index: usize| infos.get(index).is_some_and(|i| i.role == Role::Output);
        let enabled_by = infos
            .iter()
            .filter_map(|info| Some(info.enabled_by?.index()));
        let mut enables: Vec<_> = enabled_by.filter(|&index| is_output(index)).collect();
        enables.sort_unstable();
        enables.dedup();
        let remotes = driver.ports().iter().flat_map(SerialPort::remotes);
        let of_remotes = remotes.map(|remote| {
            let all = infos.iter().zip(0..);
            let own = all.filter(|(i, _)| i.group == remote.pins.group && i.role == Role::Output);
            own.map(|(_, index)| index).collect()
        });
        Self {
            enables,
            of_remotes: of_remotes.take(BOARD).collect(),
        }
    }

    /// True while LinuxCNC has an axis or a spindle enabled. Never true for a board without
    /// enables.
    pub fn is_machine_on(&self, memory: &impl Memory) -> bool {
        self.enables.iter().any(|&index| memory.load(index) != 0)
    }

    /// Those of these remotes with an output that HAL has on.
    pub fn in_use(&self, remotes: RemoteMask, memory: &impl Memory) -> RemoteMask {
        let mut in_use = 0;
        for (number, outputs) in self.of_remotes.iter().enumerate() {
            let bit = 1 << number;
            if remotes & bit != 0 && outputs.iter().any(|&index| memory.load(index) != 0) {
                in_use |= bit;
            }
        }
        in_use
    }
}

#[cfg(test)]
mod tests {
    use mesa_hal::Settings;
    use mesa_hal_sim::{Motor, Stepper, machines};

    use super::*;

    /// Those of a 5I25 with a 7I77 and a 7I76, which LinuxCNC ties to `amp-enable-out` and
    /// `spindle.0.on`.
    #[test]
    fn enables_are_those_of_axes_and_spindles() {
        let board = machines::eleven_axes_5i25(Motor::default(), Stepper::default());
        let driver = Driver::start(board, Settings::default()).expect("the machine is complete");
        let outputs = Outputs::new(&driver);
        let infos = driver.pins().infos();
        let names = outputs.enables.iter().map(|&index| {
            let name = infos[index].name.strip_prefix("hm2_5i25.0.");
            name.expect("of the board")
        });
        let names: Vec<_> = names.filter(|name| !name.ends_with("out")).collect();
        let expected = [
            "stepgen.00.enable",
            "stepgen.01.enable",
            "stepgen.02.enable",
            "stepgen.03.enable",
            "stepgen.04.enable",
            "7i77.0.1.analogena",
            "7i77.0.1.spinena",
        ];
        for name in expected {
            assert!(names.contains(&name), "{name}: {names:?}");
        }
        assert_eq!(names.len(), expected.len(), "{names:?}");
    }
}

//! Outputs that follow again after what the user does in HAL.

/// Remotes of a board as bits, in the order of the table of its remotes; and [`BOARD`].
pub(crate) type RemoteMask = u64;

/// Number of the bit of the board's own outputs, which have no port.
pub(crate) const BOARD: usize = 63;

/// The values of HAL that matter, in a cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Inputs {
    /// The user has cleared `watchdog.has_bit` or `io_error` since the last cycle.
    pub is_cleared: bool,
    /// The pins `sserial.port-N.run` that are on, as bits.
    pub run: u8,
    /// The pins `rearm` that are on.
    pub rearm: RemoteMask,
    /// Those whose outputs are safe, and not to follow as soon as they run.
    pub waiting: RemoteMask,
    /// Those whose outputs follow, with one that is on.
    pub in_use: RemoteMask,
    /// LinuxCNC has an axis or a spindle enabled.
    pub is_machine_on: bool,
}

/// The outputs that should follow, at once or as soon as they can.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct ArmRequest {
    /// Everything.
    pub all: bool,
    /// These remotes.
    pub remotes: RemoteMask,
    /// The machine is switched on in this cycle.
    pub is_switched_on: bool,
    /// The machine is switched on while the outputs of these remotes stay off.
    pub left_off: RemoteMask,
}

/// Finds what the user asks for.
///
/// - The first cycle, and a cleared `watchdog.has_bit` or `io_error`: everything.
/// - A rising edge of `sserial.port-N.run`: the remotes of the port.
/// - A rising edge of a pin `rearm`: that remote, or the board's own outputs.
/// - The machine is switched on for the first time: everything that has failed before. Until then
///   also a remote of which no output was ever on: a computer that is busy with the load of
///   LinuxCNC must not leave a card off.
///
/// A remote that has failed alone and comes back is in none of these later, and stays safe.
#[derive(Clone, Debug)]
pub(crate) struct Rearming {
    /// The remotes of each port.
    ports: Vec<RemoteMask>,
    is_first: bool,
    run: u8,
    rearm: RemoteMask,
    is_machine_on: bool,
    has_machine_been_on: bool,
    /// Remotes of which an output was on, and the board.
    used: RemoteMask,
}

impl Rearming {
    /// The remotes of each port, and the pins `run` that are on at first.
    pub fn new(ports: Vec<RemoteMask>, run: u8) -> Self {
        Self {
            ports,
            is_first: true,
            run,
            rearm: 0,
            is_machine_on: false,
            has_machine_been_on: false,
            // It has settings among its outputs, which are never all 0.
            used: 1 << BOARD,
        }
    }

    /// True if the outputs of these remotes follow after a fault without an act of the user.
    pub fn follow_by_themselves(&self, remotes: RemoteMask) -> bool {
        !self.has_machine_been_on && self.used & remotes == 0
    }

    /// What is asked for in this cycle.
    pub fn step(&mut self, seen: Inputs) -> ArmRequest {
        let switched_on = seen.run & !self.run;
        let mut remotes = seen.rearm & !self.rearm;
        // Nothing is armed in a port that is switched off.
        let mut running = 1 << BOARD;
        for (port, of_port) in self.ports.iter().enumerate() {
            let of_port_if = |mask: u8| if mask >> port & 1 == 1 { *of_port } else { 0 };
            remotes |= of_port_if(switched_on);
            running |= of_port_if(seen.run);
        }
        self.used |= seen.in_use;
        let is_switched_on = seen.is_machine_on && !self.is_machine_on;
        if !self.has_machine_been_on {
            let failed_before = if is_switched_on { !0 } else { !self.used };
            remotes |= seen.waiting & running & failed_before;
        }
        (self.run, self.rearm) = (seen.run, seen.rearm);
        self.is_machine_on = seen.is_machine_on;
        self.has_machine_been_on |= seen.is_machine_on;
        let all = core::mem::take(&mut self.is_first) || seen.is_cleared;
        let left_off = if is_switched_on && !all {
            seen.waiting & !remotes
        } else {
            0
        };
        ArmRequest {
            all,
            remotes,
            is_switched_on,
            left_off,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A cycle: cleared, `run`, `rearm`, waiting, in use, and the machine is on.
    type Cycle = (bool, u8, u64, u64, u64, bool);

    fn cycle() -> impl Strategy<Value = Cycle> {
        let mask = (0..32_u64).prop_map(|bits| bits & 15 | (bits >> 4) << BOARD);
        let (rearm, waiting) = (mask.clone(), mask.clone());
        let machine = proptest::bool::weighted(0.1);
        (any::<bool>(), 0..16_u8, rearm, waiting, mask, machine)
    }

    proptest! {
        /// Against the whole history, instead of the last state.
        #[test]
        fn rearm_requests_match_the_edges_of_any_history(
            ports in proptest::collection::vec(0..16_u64, 0..4),
            run: u8,
            history in proptest::collection::vec(cycle(), 1..40),
        ) {
            let mut rearming = Rearming::new(ports.clone(), run);
            let mut before = (run, 0);
            for (number, &(is_cleared, run, rearm, waiting, in_use, is_machine_on)) in
                history.iter().enumerate()
            {
                let wishes = rearming.step(Inputs {
                    is_cleared, run, rearm, waiting, in_use, is_machine_on,
                });
                prop_assert_eq!(wishes.all, number == 0 || is_cleared);
                let earlier = &history[..number];
                let was_on = earlier.iter().any(|cycle| cycle.5);
                let is_edge = is_machine_on && !earlier.last().is_some_and(|cycle| cycle.5);
                for remote in (0..4).chain([BOARD]) {
                    let is_on = |mask: u64| mask >> remote & 1 == 1;
                    let own = is_on(rearm) && !is_on(before.1);
                    let of_port = |without_port: bool, condition: &dyn Fn(usize) -> bool| {
                        if remote == BOARD {
                            return without_port;
                        }
                        let mut ports = ports.iter().enumerate();
                        ports.any(|(port, &remotes)| is_on(remotes) && condition(port))
                    };
                    let rises = of_port(false, &|port| run >> port & 1 == 1 && before.0 >> port & 1 == 0);
                    let was_used = remote == BOARD || history[..=number].iter().any(|cycle| is_on(cycle.4));
                    let failed_before = is_on(waiting)
                        && !was_on
                        && (is_edge || !was_used)
                        && of_port(true, &|port| run >> port & 1 == 1);
                    prop_assert_eq!(is_on(wishes.remotes), own || rises || failed_before);
                    prop_assert_eq!(wishes.is_switched_on, is_edge);
                    let is_left_off = is_edge && !wishes.all && is_on(waiting & !wishes.remotes);
                    prop_assert_eq!(is_on(wishes.left_off), is_left_off);
                }
                before = (run, rearm);
            }
        }
    }
}

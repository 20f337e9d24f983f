//! Outputs that follow again after what the user does in HAL.

/// Remotes of a board as bits, in the order of the table of its remotes.
pub(crate) type RemoteMask = u64;

/// The values of HAL that matter, in a cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Seen {
    /// The user has cleared `watchdog.has_bit` or `io_error` since the last cycle.
    pub is_cleared: bool,
    /// The pins `sserial.port-N.run` that are on, as bits.
    pub run: u8,
    /// The pins `REMOTE.rearm` that are on.
    pub rearm: RemoteMask,
}

/// The outputs that should follow, at once or as soon as they can.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Wishes {
    /// Everything.
    pub all: bool,
    /// These remotes.
    pub remotes: RemoteMask,
}

/// Finds what the user asks for.
///
/// - The first cycle, and a cleared `watchdog.has_bit` or `io_error`: everything.
/// - A rising edge of `sserial.port-N.run`: the remotes of the port.
/// - A rising edge of `REMOTE.rearm`: that remote.
///
/// A remote that has failed alone and comes back is in none of these, and stays safe.
#[derive(Clone, Debug)]
pub(crate) struct Rearming {
    /// The remotes of each port.
    ports: Vec<RemoteMask>,
    is_first: bool,
    run: u8,
    rearm: RemoteMask,
}

impl Rearming {
    /// The remotes of each port, and the pins `run` that are on at first.
    pub fn new(ports: Vec<RemoteMask>, run: u8) -> Self {
        Self {
            ports,
            is_first: true,
            run,
            rearm: 0,
        }
    }

    /// What is asked for in this cycle.
    pub fn step(&mut self, seen: Seen) -> Wishes {
        let switched_on = seen.run & !self.run;
        let mut remotes = seen.rearm & !self.rearm;
        for (port, of_port) in self.ports.iter().enumerate() {
            if switched_on >> port & 1 == 1 {
                remotes |= of_port;
            }
        }
        (self.run, self.rearm) = (seen.run, seen.rearm);
        let is_first = core::mem::take(&mut self.is_first);
        Wishes {
            all: is_first || seen.is_cleared,
            remotes,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Against the whole history, instead of the last state.
        #[test]
        fn any_history_asks_for_what_its_edges_say(
            ports in proptest::collection::vec(0..16_u64, 0..4),
            run: u8,
            history in proptest::collection::vec((any::<bool>(), 0..16_u8, 0..16_u64), 1..40),
        ) {
            let mut rearming = Rearming::new(ports.clone(), run);
            let mut before = (run, 0);
            for (cycle, &(is_cleared, run, rearm)) in history.iter().enumerate() {
                let wishes = rearming.step(Seen { is_cleared, run, rearm });
                prop_assert_eq!(wishes.all, cycle == 0 || is_cleared);
                for remote in 0..4 {
                    let is_on = |mask: u64| mask >> remote & 1 == 1;
                    let own = is_on(rearm) && !is_on(before.1);
                    let of_port = ports.iter().enumerate().any(|(port, &remotes)| {
                        is_on(remotes) && run >> port & 1 == 1 && before.0 >> port & 1 == 0
                    });
                    prop_assert_eq!(is_on(wishes.remotes), own || of_port);
                }
                before = (run, rearm);
            }
        }
    }
}

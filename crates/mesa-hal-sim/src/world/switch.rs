//! Switches that an axis actuates.

use crate::wire::Nanos;

/// Destination of a signal: a terminal of the machine's electronics.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SimTerminal {
    /// A digital input of a remote.
    Remote {
        /// Smart serial port.
        port: usize,
        /// Channel of the port.
        channel: usize,
        /// Input of the remote.
        input: usize,
    },
    /// An isolated input of the board.
    Board {
        /// Its number.
        input: usize,
    },
    /// An I/O pin of the FPGA; on is high.
    Pin {
        /// Its number.
        pin: usize,
    },
}

/// A change of a signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Change {
    pub(crate) at: Nanos,
    pub(crate) terminal: SimTerminal,
    pub(crate) on: bool,
}

/// A home or limit switch, and the input it is wired to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SwitchConfig {
    /// The axis whose position actuates it.
    pub axis: usize,
    /// First position in units at which the switch is actuated.
    pub from: f64,
    /// Last position at which it is actuated; infinite for no end.
    pub to: f64,
    /// Distance in units by which the axis must leave before the switch is released. 0 or more.
    pub hysteresis: f64,
    /// Bounce time of the contact after a change: it opens and closes twice more, in equal parts of
    /// this time. 0 for no bounce.
    pub bounce: Nanos,
    /// True if its input is on while the switch is not actuated (normally closed).
    pub normally_closed: bool,
    /// The input.
    pub terminal: SimTerminal,
}

/// A switch on an axis.
#[derive(Clone, Debug)]
pub struct Switch {
    config: SwitchConfig,
    actuated: bool,
}

/// Number of changes of a bouncing contact, the first and the last included.
const CHANGES: u64 = 5;

impl Switch {
    /// A switch on an axis that is at a position.
    pub(crate) fn new(config: SwitchConfig, position: f64) -> Self {
        Self {
            actuated: (config.from..=config.to).contains(&position),
            config,
        }
    }

    /// The configuration of the switch.
    pub fn config(&self) -> &SwitchConfig {
        &self.config
    }

    /// True if the axis actuates it.
    pub fn is_actuated(&self) -> bool {
        self.actuated
    }

    /// True if its contact is closed: its input is on.
    pub fn is_closed(&self) -> bool {
        self.actuated != self.config.normally_closed
    }

    /// Follows a movement of the axis in one direction, and reports the changes of the contact.
    pub(crate) fn follow(
        &mut self,
        times: [Nanos; 2],
        positions: [f64; 2],
        mut changed: impl FnMut(Change),
    ) {
        let [start, end] = times;
        let [from, to] = positions;
        let mut reached = from;
        // In and out again: at most two changes in one direction.
        for _ in 0..2 {
            let Some(border) = self.border(reached, to) else {
                return;
            };
            self.actuated = !self.actuated;
            reached = border;
            let part = ((border - from) / (to - from)).clamp(0.0, 1.0);
            let at = start + libm::round(part * (end - start) as f64) as Nanos;
            self.make(at, &mut changed);
        }
    }

    /// The next position on the path at which the switch changes.
    fn border(&self, from: f64, to: f64) -> Option<f64> {
        let SwitchConfig {
            from: low,
            to: high,
            hysteresis,
            ..
        } = self.config;
        let rising = to > from;
        match (self.actuated, rising) {
            (false, true) => (from < low && to >= low).then_some(low),
            (false, false) => (from > high && to <= high).then_some(high),
            (true, true) => (to > high + hysteresis).then_some(high + hysteresis),
            (true, false) => (to < low - hysteresis).then_some(low - hysteresis),
        }
    }

    fn make(&self, at: Nanos, changed: &mut impl FnMut(Change)) {
        let SwitchConfig {
            terminal, bounce, ..
        } = self.config;
        let closed = self.is_closed();
        let changes = if bounce == 0 { 1 } else { CHANGES };
        for n in 0..changes {
            changed(Change {
                at: at + bounce * n / (CHANGES - 1),
                terminal,
                on: closed == (n % 2 == 0),
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TERMINAL: SimTerminal = SimTerminal::Board { input: 3 };

    fn switch(from: f64, to: f64, hysteresis: f64, bounce: Nanos) -> Switch {
        let config = SwitchConfig {
            axis: 0,
            from,
            to,
            hysteresis,
            bounce,
            normally_closed: false,
            terminal: TERMINAL,
        };
        Switch::new(config, 0.0)
    }

    /// Moves one unit per microsecond; returns the changes with their times.
    fn go(switch: &mut Switch, from: f64, to: f64) -> Vec<(Nanos, bool)> {
        let mut changes = Vec::new();
        let end = ((to - from).abs() * 1e3).round() as Nanos;
        switch.follow([0, end], [from, to], |change| {
            assert_eq!(change.terminal, TERMINAL);
            changes.push((change.at, change.on));
        });
        changes
    }

    #[test]
    fn switch_changes_once_at_its_position_in_both_directions() {
        let mut switch = switch(10.0, f64::INFINITY, 0.0, 0);
        assert_eq!(go(&mut switch, 0.0, 9.9), []);
        assert_eq!(go(&mut switch, 9.9, 10.0), [(100, true)]);
        assert_eq!(go(&mut switch, 10.0, 50.0), []);
        assert_eq!(go(&mut switch, 50.0, 10.0), []);
        assert_eq!(go(&mut switch, 10.0, 0.0), [(0, false)]);
        assert_eq!(go(&mut switch, 0.0, 20.0), [(10_000, true)]);
        assert_eq!(go(&mut switch, 20.0, 0.0), [(10_000, false)]);
    }

    #[test]
    fn cam_is_passed_both_ways_and_hysteresis_releases_later() {
        let mut cam = switch(10.0, 12.0, 0.5, 0);
        assert_eq!(go(&mut cam, 0.0, 20.0), [(10_000, true), (12_500, false)]);
        assert_eq!(go(&mut cam, 20.0, 0.0), [(8_000, true), (10_500, false)]);
        assert_eq!(go(&mut cam, 0.0, 10.5), [(10_000, true)]);
        assert_eq!(go(&mut cam, 10.5, 9.6), []);
        assert!(cam.is_actuated());
        assert_eq!(go(&mut cam, 9.6, 10.5), []);
    }

    #[test]
    fn normally_closed_contact_opens_with_bounce_when_actuated() {
        let mut switch = switch(10.0, 20.0, 0.0, 400);
        switch.config.normally_closed = true;
        assert!(switch.is_closed());
        let changes = [
            (10_000, false),
            (10_100, true),
            (10_200, false),
            (10_300, true),
            (10_400, false),
        ];
        assert_eq!(go(&mut switch, 0.0, 15.0), changes);
    }
}

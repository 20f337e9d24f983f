//! The faults that are not played on the machine itself: those of the host, the bus and the
//! network, and the replacement of the board.

use mesa_hal::driver::{Driver, Pace};
use mesa_hal::transport::udp::PacketLink;
use mesa_hal_sim::{FaultKind, FaultPlace};

use super::super::network::{Bad, Host, Life, Sim};
use super::super::plan::{MICRO, MILLI, Planned};
use super::Scenario;

impl Scenario {
    pub(super) fn schedule(&mut self, fault: Planned, at: u64) {
        let Planned {
            kind, lasts, dice, ..
        } = fault;
        match (kind.place(), &self.sim) {
            (FaultPlace::Bus, _) if fault.in_build => {
                // By the number of the exchange: no time-based fault can start while the driver is
                // built.
                self.host.push((0, fault));
                return;
            }
            (FaultPlace::Bus | FaultPlace::Host, _) => self.host.push((at, fault)),
            (FaultPlace::Network, Sim::Network(network)) => {
                let one_in = [1, 2, 5, 20][(dice % 4) as usize];
                let longest = match self.plan.pace {
                    Pace::Host if self.plan.is_homing => self.plan.period * 7 / 2,
                    Pace::Host => self.plan.period * 3 / 2,
                    // Where packets also wait in the board, longer delays make a write later than
                    // can be reported.
                    Pace::Board => self.plan.period / 2,
                };
                network.borrow_mut().add(Bad {
                    kind,
                    from: at,
                    until: at + lasts,
                    one_in: if kind == FaultKind::NetworkDown {
                        1
                    } else {
                        one_in
                    },
                    delay: longest,
                });
            }
            (FaultPlace::Fpga, Sim::Network(network)) => match kind {
                FaultKind::FpgaReset => network.borrow_mut().link.resets.push((at, 0)),
                FaultKind::FpgaResetLong => network.borrow_mut().link.resets.push((at, lasts)),
                _ => {}
            },
            _ => {}
        }
        self.stage.schedule(fault, at);
    }

    /// Replaces the board from the middle of the first fault on, or restores the own board.
    pub(super) fn strangers(&mut self, comes: bool) {
        let (at, is_there) = self.stranger;
        if is_there != comes && (!comes || self.sim.now() >= at) {
            self.stranger.1 = comes;
            self.sim.exchange(self.plan.extras.stranger, !comes);
        }
    }

    /// The application is late or stops, after its write, before it, or in an exchange.
    pub(super) fn host_faults(&mut self, life: &Life, after_write: bool) {
        let now = self.sim.now();
        let due = |(at, fault): &mut (u64, Planned)| {
            *at > 0
                && *at <= now
                && (fault.dice & 1 == 1) == after_write
                && matches!(fault.kind, FaultKind::HostLate | FaultKind::HostStall)
        };
        let due: Vec<_> = self.host.extract_if(.., due).collect();
        for (_, fault) in due {
            let time = if fault.kind == FaultKind::HostLate {
                self.plan.watchdog / 2
            } else {
                2 * self.plan.watchdog + fault.lasts.min(100 * MILLI)
            };
            // After the write the next exchange is a read.
            let more = self.plan.more;
            if after_write && fault.dice & 2 != 0 {
                life.pause(time, more.stalls_before);
                continue;
            }
            if !after_write && more.stalls_in_write {
                life.pause(time, more.stalls_before);
                continue;
            }
            // The simulation is observed all the time, though not by the application.
            for _ in 0..time / MILLI {
                self.sim.pass(MILLI);
            }
        }
    }

    /// True if the other program writes in this cycle. With a write in every cycle, data that
    /// depend on a write would never be taken.
    fn other_writes(&mut self) -> bool {
        self.others.cycles += 1;
        if self.plan.more.master_stays {
            return self.others.cycles.is_multiple_of(3);
        }
        self.chance.one_in(6)
    }

    /// Another program switches an LED of the board; its reply does not arrive here.
    pub(super) fn other_master(&mut self) {
        if !self.plan.extras.second_master || !self.other_writes() {
            return;
        }
        if let Sim::Network(network) = &self.sim {
            self.others.sent += 1;
            let packet = [0x81, 0xC2, 0x00, 0x02, self.chance.below(2) as u8, 0, 0, 0];
            let _ = network.borrow_mut().link.send(&packet);
        }
    }

    pub(super) fn bus_faults<B: Host>(&mut self, driver: &mut Driver<B>, now: u64) {
        let due = |(at, fault): &mut (u64, Planned)| {
            *at > 0 && *at <= now && fault.kind.place() == FaultPlace::Bus
        };
        for (_, fault) in self.host.extract_if(.., due) {
            let count = (fault.lasts / self.plan.period).clamp(1, 12);
            driver.bus_mut().fail(fault.kind, fault.dice % 2, count);
        }
    }

    pub(super) fn end_faults(&mut self) {
        let now = self.sim.now();
        self.stage.end_all(now);
        self.host.clear();
        self.strangers(false);
        if let Sim::Network(network) = &self.sim {
            let mut network = network.borrow_mut();
            network.heal();
            network.link.resets.clear();
        }
        self.sim.pass(MICRO);
        while self.sim.is_in_reset() {
            self.sim.pass(MILLI);
        }
    }
}

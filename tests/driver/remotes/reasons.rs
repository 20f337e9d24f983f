//! The reason of a remote that is offline is the present one, whatever faults came before. The
//! truth is the simulated remote: its cable, its field power, and the resets of its board.

use std::time::Duration;

use crate::common::ethernet::{SimLink, bus, cut, good};
use crate::common::machine::{FIELD, Machine, fpga};
use mesa_hal::UdpBus;
use mesa_hal::driver::{BoardState, OfflineReason, RemoteState};

const MS: u64 = 1_000_000;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Deed {
    Unplug,
    PlugIn,
    FieldPowerOff,
    FieldPowerOn,
    /// The board loses its configuration for 30 ms.
    Reset,
    /// The network delivers nothing for 100 ms.
    Cut,
}

impl Deed {
    const ALL: [Self; 6] = [
        Self::Unplug,
        Self::PlugIn,
        Self::FieldPowerOff,
        Self::FieldPowerOn,
        Self::Reset,
        Self::Cut,
    ];
}

/// What is true about the remote.
#[derive(Clone, Copy, Debug)]
struct Truth {
    is_plugged_in: bool,
    has_field_power: bool,
}

impl Truth {
    const AT_START: Self = Self {
        is_plugged_in: true,
        has_field_power: true,
    };

    /// The truth after a deed, unless it would change nothing.
    fn after(mut self, deed: Deed) -> Option<Self> {
        let before = self;
        match deed {
            Deed::Unplug | Deed::PlugIn => self.is_plugged_in = deed == Deed::PlugIn,
            Deed::FieldPowerOff | Deed::FieldPowerOn => {
                self.has_field_power = deed == Deed::FieldPowerOn;
            }
            Deed::Reset | Deed::Cut => return Some(self),
        }
        let is_same = self.is_plugged_in == before.is_plugged_in
            && self.has_field_power == before.has_field_power;
        (!is_same).then_some(self)
    }
}

/// A machine whose outputs nothing re-arms, other than with the set-up of its board.
struct Shop {
    machine: Machine<UdpBus<SimLink>>,
    truth: Truth,
}

impl Shop {
    fn new() -> Self {
        let machine = Machine::on(bus(fpga()), |settings| {
            settings.fault_policy.longest_backoff = Duration::from_millis(200);
        });
        let mut shop = Self {
            machine,
            truth: Truth::AT_START,
        };
        shop.run(100);
        shop
    }

    fn run(&mut self, cycles: usize) {
        for _ in 0..cycles {
            let driver = &mut self.machine.driver;
            let _ = driver.read();
            if driver.board_state() != BoardState::Running {
                let _ = driver.rearm();
            }
            let _ = driver.write();
            self.machine.rest();
        }
    }

    fn happen(&mut self, deed: Deed) {
        match deed {
            Deed::Unplug => self.machine.cable(FIELD).unplug(),
            Deed::PlugIn => self.machine.cable(FIELD).replug(),
            Deed::FieldPowerOff => self.set_field_volts(0.0),
            Deed::FieldPowerOn => self.set_field_volts(24.0),
            Deed::Reset => {
                let link = self.machine.driver.bus_mut().link();
                let now = link.time();
                link.resets.push((now, 30 * MS));
            }
            Deed::Cut => {
                self.machine.driver.bus_mut().link().to_board = cut();
                self.run(100);
                self.machine.driver.bus_mut().link().to_board = good();
            }
        }
        self.truth = self.truth.after(deed).expect("it changes something");
    }

    fn set_field_volts(&mut self, volts: f64) {
        let now = self.machine.driver.bus_mut().link().time();
        let device = self.machine.device_mut(FIELD);
        device.set_field_volts(now, volts).expect("field power");
    }

    fn check(&self, deeds: &[Deed]) {
        assert_eq!(self.machine.driver.board_state(), BoardState::Running);
        let state = self.machine.status(FIELD).state;
        let (RemoteState::Offline { reason, .. } | RemoteState::Restarting { reason }) = state
        else {
            assert!(
                self.truth.is_plugged_in && self.truth.has_field_power,
                "{deeds:?}"
            );
            return;
        };
        let is_true = match reason {
            OfflineReason::FieldPower(_) => self.truth.is_plugged_in && !self.truth.has_field_power,
            OfflineReason::TooManyFailures(_) => !self.truth.is_plugged_in,
            // Faults reported before must not be taken for present ones.
            OfflineReason::DidNotStart(_) => {
                !self.truth.is_plugged_in && !reason.to_string().contains("the remote says")
            }
            _ => false,
        };
        assert!(is_true, "{deeds:?}: {reason}");
    }
}

#[test]
fn reason_is_the_present_one_after_any_three_faults() {
    let mut sequences = 0;
    for number in 0..Deed::ALL.len().pow(3) {
        let deeds = [number / 36, number / 6 % 6, number % 6].map(|n| Deed::ALL[n]);
        let is_sequence = deeds
            .iter()
            .try_fold(Truth::AT_START, |truth, deed| truth.after(*deed));
        if is_sequence.is_none() {
            continue;
        }
        let mut shop = Shop::new();
        for (n, deed) in deeds.into_iter().enumerate() {
            shop.happen(deed);
            shop.run(700);
            shop.check(&deeds[..=n]);
        }
        sequences += 1;
    }
    assert!(sequences > 50, "{sequences}");
}

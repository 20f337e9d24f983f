//! Readings of an output while its group is not armed.

use std::time::Duration;

use mesa_hal::bus::{Access, BusError, Direction, RegisterBus};
use mesa_hal::driver::RemoteState;
use mesa_hal::hal::{PinId, Pins, Role};
use mesa_hal::runner::SnapshotWriter;
use mesa_hal::{Clock, Driver, I7i77Field, Settings};
use mesa_hal_sim::{Motor, SimFpga, machines};

use crate::common::bus::{Around, Between};
use crate::common::machine;

fn cycles(driver: &mut Driver<SimFpga>, field: &I7i77Field, count: usize) {
    for _ in 0..count {
        let _ = driver.read().expect("the bus does not fail");
        for output in field.outputs {
            output.set(driver.pins_mut(), true);
        }
        driver.write().expect("the bus does not fail");
        driver.bus_mut().wait(Duration::from_millis(1));
    }
}

/// The state of the simulated terminals.
fn terminals(driver: &mut Driver<SimFpga>) -> [bool; 16] {
    let card = driver
        .bus_mut()
        .remote_mut(0, 0)
        .and_then(mesa_hal_sim::devices::find_mut);
    let card = card.expect("a 7I77");
    core::array::from_fn(|n| card.world().output(n) == Some(true))
}

/// Checks that no output that reads as on and valid is off at its terminal, nor the other way
/// round.
fn check(driver: &mut Driver<SimFpga>, field: &I7i77Field, writer: &mut SnapshotWriter, on: bool) {
    assert_eq!(terminals(driver), [on; 16]);
    writer.publish(driver).expect("its driver");
    let seen = writer.reader().read().expect("one was published");
    for output in field.outputs {
        let reading = driver.pins().read_any(output.pin.into());
        assert_eq!(reading.valid, on, "{reading:?}");
        let reading = seen.read(output.pin);
        assert_eq!(reading.valid, on, "in the snapshot: {reading:?}");
    }
}

fn others(pins: &Pins, field: &I7i77Field) -> Vec<PinId> {
    let own = pins.info(field.outputs[0].pin).expect("a pin").group;
    let pairs = pins.ids().zip(pins.infos());
    let others = pairs.filter(|(_, info)| info.group != own && info.role == Role::Output);
    others.map(|(pin, _)| pin).collect()
}

#[test]
fn output_that_is_not_armed_is_not_valid_whatever_it_is_set_to() {
    let board = machines::six_axes_7i92(Motor::default());
    let mut driver = Driver::start(board, Settings::default()).expect("a 7I92");
    let field: I7i77Field = driver.attach((0, 0)).expect("a 7I77");
    let mut writer = SnapshotWriter::new(&driver);
    cycles(&mut driver, &field, 10);
    check(&mut driver, &field, &mut writer, true);
    for over_current in [true, false] {
        let card = driver
            .bus_mut()
            .remote_mut(0, 0)
            .and_then(mesa_hal_sim::devices::find_mut);
        let set = card.expect("a 7I77").set_over_current(3, over_current);
        set.expect("an output");
        cycles(&mut driver, &field, 500);
        check(&mut driver, &field, &mut writer, false);
        let pins = driver.pins();
        assert!(pins.commanded(field.outputs[0].pin), "what was set");
        let others = others(pins, &field);
        assert!(others.len() > 6);
        assert!(others.iter().all(|pin| pins.read_any(*pin).valid));
    }
    let _ = driver.rearm().expect("the bus does not fail");
    cycles(&mut driver, &field, 10);
    check(&mut driver, &field, &mut writer, true);
}

/// The word last written to interface register 0 of channel 0.
#[derive(Debug, Default)]
struct LastOutputs(u32);

impl Between for LastOutputs {
    fn exchange(
        &mut self,
        fpga: &mut SimFpga,
        accesses: &[Access],
        words: &mut [u32],
    ) -> Result<(), BusError> {
        for access in accesses {
            if access.direction == Direction::Write && access.address == 0x5E00 {
                self.0 = words[access.words().start];
            }
        }
        fpga.exchange(accesses, words)
    }
}

/// A network can deliver a packet again after newer ones: none from the time before a restart may
/// contain outputs that were on.
#[test]
fn outputs_of_a_remote_that_is_offline_are_written_as_off() {
    let mut board = machine::fpga();
    let cards = [machine::ANALOG, machine::OUTPUTS].map(|channel| board.plug(0, channel, None));
    assert!(cards.iter().all(Option::is_some));
    let bus = Around {
        fpga: board,
        between: LastOutputs::default(),
    };
    let mut driver = Driver::start(bus, Settings::default()).expect("a 7I92");
    let field: I7i77Field = driver.attach((0, 0)).expect("a 7I77");
    let cycle = |driver: &mut Driver<Around<LastOutputs>>| {
        let _ = driver.read().expect("the bus does not fail");
        field.outputs[3].set(driver.pins_mut(), true);
        driver.write().expect("the bus does not fail");
        driver.bus_mut().wait(Duration::from_millis(1));
    };
    (0..10).for_each(|_| cycle(&mut driver));
    assert_eq!(driver.bus().between.0, 1 << 3);
    let card = driver.bus_mut().fpga.plug(0, 0, None);
    (0..60).for_each(|_| cycle(&mut driver));
    let remote = driver.remote((0, 0)).expect("a 7I77");
    assert!(matches!(remote.state, RemoteState::Offline { .. }));
    assert_eq!(driver.bus().between.0, 0);
    driver.bus_mut().fpga.plug(0, 0, card);
    (0..500).for_each(|_| cycle(&mut driver));
    assert_eq!(driver.bus().between.0, 0, "not re-armed");
    let _ = driver.rearm().expect("the bus does not fail");
    (0..10).for_each(|_| cycle(&mut driver));
    assert_eq!(driver.bus().between.0, 1 << 3);
}

//! Another program writes the time of the board's watchdog: everything becomes safe, and the event
//! does not name the host or the supply as the only cause.

use crate::common::ethernet;
use crate::common::machine::{ANALOG, FIELD, Machine, OUTPUTS, World, device, fpga};
use mesa_hal::bus::RegisterBus;
use mesa_hal::driver::{BoardState, EventMask};

/// The watchdog's time: FACTS 13.2.
const TIME: u16 = 0x0C00;

fn are_on<B: World>(machine: &mut Machine<B>) -> [bool; 3] {
    let fpga = &*machine.fpga();
    let world = |channel| device(fpga, channel).world();
    let field = world(FIELD).output(3) == Some(true);
    let analog = world(ANALOG)
        .analog_output(1)
        .is_some_and(|volts| volts > 4.9);
    [field, analog, world(OUTPUTS).output(7) == Some(true)]
}

/// Another program writes a time.
fn written<B: World>(bus: B, time: u32, write: impl Fn(&mut B, u32)) {
    let mut machine: Machine<B> = Machine::on(bus, |_| {});
    let cards = machine.cards.clone();
    let run = |machine: &mut Machine<B>, cycles| {
        for _ in 0..cycles {
            cards.set_one_of_each(machine.driver.pins_mut());
            machine.cycles(1);
        }
    };
    run(&mut machine, 20);
    assert_eq!(are_on(&mut machine), [true; 3]);
    let mut events = machine.driver.events();
    write(machine.driver.bus_mut(), time);
    run(&mut machine, 3);
    let state = machine.driver.board_state();
    assert_ne!(state, BoardState::Running, "{time:#X}");
    let told = events.find(|event| EventMask::OUTPUTS_SAFE.contains(event.kind.mask()));
    let told = told.expect("an event").to_string();
    assert!(told.contains("other program"), "{time:#X}: {told}");
    run(&mut machine, 70);
    assert_eq!(are_on(&mut machine), [false; 3], "{time:#X}");
    machine.rearm_all(1000);
    run(&mut machine, 20);
    assert_eq!(are_on(&mut machine), [true; 3], "{time:#X}");
}

#[test]
fn foreign_watchdog_time_makes_all_safe_and_is_no_mere_reset() {
    // Let it bite, as LinuxCNC does at its end; switch it off, which bites; a longer time.
    for time in [1, u32::MAX, 0x7FFF_FFFE] {
        written(fpga(), time, |bus, time| {
            bus.write(TIME, time).expect("a register");
        });
        written(ethernet::bus(fpga()), time, |bus, time| {
            let [low, high] = TIME.to_le_bytes();
            let [a, b, c, d] = time.to_le_bytes();
            let link = bus.link();
            let now = link.board.time();
            // Without a reply.
            let packet = [0x81, 0xC2, low, high, a, b, c, d];
            let _ = link.board.handle_packet(now, &packet, &mut Vec::new());
        });
    }
}

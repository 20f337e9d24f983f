//! A write that arrives after a bite drives nothing.

use super::*;

#[test]
fn write_after_an_undetected_bite_drives_no_pin() {
    for change in CHANGES {
        for over_ethernet in [false, true] {
            let name = format!("{change:?}, over Ethernet: {over_ethernet}");
            let remotes = change == Change::Restart;
            if over_ethernet {
                bitten(ethernet::bus(world(remotes)), remotes, change, name);
            } else {
                bitten(world(remotes), remotes, change, name);
            }
        }
    }
}

fn bitten<B: World>(bus: B, remotes: bool, change: Change, name: String) {
    let mut machine = Machine::running(bus, remotes, name);
    let before = machine.counts();
    let _ = machine.driver.read();
    machine.driver.bus_mut().wait(Duration::from_millis(20));
    assert!(machine.fpga().watchdog().has_bitten());
    change.make(&mut machine.driver);
    machine.command();
    let _ = machine.driver.write();
    machine.rest();
    // The board is queried before a setting that drives pins is written.
    machine.must_fall(before, false);
}

/// The packets of one cycle's writes arrive when the watchdog has bitten.
#[test]
fn write_held_by_the_network_until_after_a_bite_drives_no_pin() {
    for change in CHANGES {
        if change.drives_pins() {
            // The board is queried first, and the answer is awaited.
            continue;
        }
        let remotes = change == Change::Restart;
        let name = format!("{change:?}");
        let mut machine = Machine::running(ethernet::bus(world(remotes)), remotes, name);
        let before = machine.counts();
        let _ = machine.driver.read();
        change.make(&mut machine.driver);
        machine.command();
        machine.driver.bus_mut().link().to_board = Box::new(|_, packet| {
            let late = if is_request(packet) { 0 } else { 10_000_000 };
            vec![WIRE + late]
        });
        let _ = machine.driver.write();
        machine.driver.bus_mut().link().to_board = good();
        machine.driver.bus_mut().wait(Duration::from_millis(11));
        assert!(machine.fpga().watchdog().has_bitten());
        machine.must_fall(before, false);
    }
}

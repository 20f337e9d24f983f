//! The program of a controller: moves an axis of a 7I97.

use core::error::Error;

use mesa_hal::driver::{Driver, Pace, Settings};
use mesa_hal::{Clock, I7i97, UdpBus, UdpConfig};
use smoltcp::phy::Device;
use smoltcp::wire::{EthernetAddress, IpAddress, IpCidr, IpEndpoint};

use super::link::{Own, SmoltcpLink};

pub fn drive(interface: impl Device, clock: impl Clock) -> Result<(), Box<dyn Error>> {
    let own = Own {
        mac: EthernetAddress([0x02, 0, 0, 0, 0, 0x01]),
        address: IpCidr::new(IpAddress::v4(10, 10, 10, 1), 24),
        port: 27181,
    };
    let board = IpEndpoint::new(IpAddress::v4(10, 10, 10, 10), 27181);
    let link = SmoltcpLink::new(interface, clock, own, board)?;
    let bus = UdpBus::new(link, UdpConfig::default())?;
    let settings = Settings {
        pace: Pace::Board,
        ..Settings::default()
    };
    let mut driver = Driver::start(bus, settings)?;
    let board: I7i97 = driver.attach_board()?;
    for _ in 0..1000 {
        // Returns when the board's next period begins: no timer is needed.
        let _ = driver.read()?;
        let pins = driver.pins_mut();
        let limit = board.inputs[2].read(pins);
        let may_move = limit.valid && !limit.value;
        board.analog_out[0].enable(pins, may_move);
        board.analog_out[0].set(pins, if may_move { 1.5 } else { 0.0 });
        driver.write()?;
    }
    let (_, stopped) = driver.shutdown();
    Ok(stopped?)
}

//! The memory of a driver with its UDP bus: what it keeps, and the most that its start needs. That
//! of the simulated board is not counted.

use allocation_counter::measure;
use mesa_hal::Driver;
use mesa_hal::driver::Settings;
use mesa_hal::transport::udp::{UdpBus, UdpConfig};
use mesa_hal_sim::{Motor, SimFpga, machines};

use super::udp::Uncounted;

/// A machine, and the limits of its driver in bytes.
struct Limits {
    card: &'static str,
    machine: fn() -> SimFpga,
    lasting: i64,
    peak: u64,
}

/// A 7I97 and a 7I92, each with a 7I77 and a 7I72. `docs/microcontroller.md` has the limits.
const MACHINES: [Limits; 2] = [
    Limits {
        card: "7I97",
        machine: || machines::six_axes_7i97(Motor::default()),
        lasting: 265_000,
        peak: 360_000,
    },
    Limits {
        card: "7I92",
        machine: || machines::six_axes_7i92(Motor::default()),
        lasting: 225_000,
        peak: 300_000,
    },
];

#[test]
fn driver_keeps_and_needs_no_more_memory_than_documented() {
    let page = include_str!("../../docs/microcontroller.md");
    for limits in MACHINES {
        let card = limits.card;
        let board = Uncounted::new((limits.machine)());
        let mut driver = None;
        let info = measure(|| {
            let bus = UdpBus::new(board, UdpConfig::default()).expect("it answers");
            driver = Some(Driver::start(bus, Settings::default()).expect("complete"));
        });
        let driver = driver.expect("started");
        let pins = driver.pins().infos().len();
        let (lasting, peak) = (info.bytes_current, info.bytes_max);
        let pieces = info.count_current;
        println!("{card}: {pins} pins, {lasting} bytes in {pieces} pieces, {peak} at most");
        assert!(lasting <= limits.lasting, "{card}: {lasting} bytes");
        assert!(peak <= limits.peak, "{card}: {peak} bytes at most");
        let [lasting, peak] = [limits.lasting as u64, limits.peak].map(|bytes| bytes / 1000);
        let row = format!("| {card} with a 7I77 and a 7I72 | {lasting} KB | {peak} KB |");
        assert!(page.contains(&row), "{card}: {row}");
    }
}

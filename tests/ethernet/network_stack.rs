//! The bus over a network stack instead of a socket: smoltcp at both ends of a cable, on virtual
//! time. The link and the cable are those of the example `microcontroller`.

use std::time::Duration;

use mesa_hal::boards::{I7i77Analog, I7i77Field};
use mesa_hal::bus::{BusError, BusErrorKind, BusStatistics, Clock, RegisterBus};
use mesa_hal::driver::{CycleError, Driver};
use mesa_hal::transport::udp::{UdpBus, UdpConfig};
use mesa_hal::{MesaError, advice};
use mesa_hal_sim::devices::{find, find_mut};
use mesa_hal_sim::{BoardConfig, Motor, SimBoard, machines};
use smoltcp::wire::{EthernetAddress, IpAddress, IpCidr, IpEndpoint};

use super::common::machine::{ANALOG, FIELD, fpga, start};
use cable::{BOARD, Cable, Fate, Port};
use link::{Own, SmoltcpLink};

#[path = "../../examples/network/microcontroller/cable.rs"]
mod cable;
#[path = "../../examples/network/microcontroller/drive.rs"]
mod drive;
#[path = "../../examples/network/microcontroller/link.rs"]
mod link;

type Bus = UdpBus<SmoltcpLink<Port, Cable>>;

const PERIOD: Duration = Duration::from_millis(1);

fn link(cable: &Cable, board: IpEndpoint) -> SmoltcpLink<Port, Cable> {
    let own = Own {
        mac: EthernetAddress([0x02, 0, 0, 0, 0, 0x01]),
        address: IpCidr::new(IpAddress::v4(10, 10, 10, 1), 24),
        port: 27181,
    };
    SmoltcpLink::new(cable.host(), cable.clone(), own, board).expect("a port")
}

fn cable() -> Cable {
    Cable::to(SimBoard::new(BoardConfig::new("7I92"), fpga()))
}

fn bus(cable: &Cable) -> Bus {
    UdpBus::new(link(cable, BOARD.into()), UdpConfig::default()).expect("the board answers")
}

/// A driver of a 7I92 with a 7I77, and the cable between them.
struct Controller {
    driver: Driver<Bus>,
    cable: Cable,
    field: I7i77Field,
    analog: I7i77Analog,
}

impl Controller {
    fn start() -> Self {
        let cable = cable();
        let driver = start(bus(&cable), |_| {}).expect("the machine is complete");
        Self {
            field: driver.attach((0, FIELD as u8)).expect("field I/O"),
            analog: driver.attach((0, ANALOG as u8)).expect("outputs"),
            driver,
            cable,
        }
    }

    /// A cycle that commands `volts`; returns the result of the read.
    fn cycle(&mut self, volts: f64) -> Result<(), CycleError> {
        let result = self.driver.read().map(drop);
        let (pins, drive) = (self.driver.pins_mut(), self.analog.analog_out[0]);
        drive.enable(pins, true);
        drive.set(pins, volts);
        self.driver.write().expect("sent");
        self.driver.bus_mut().wait(PERIOD);
        result
    }

    fn cycles(&mut self, count: u32, volts: f64) {
        for n in 0..count {
            assert!(self.cycle(volts).is_ok(), "cycle {n}");
        }
    }

    /// Volts at the terminal of the simulated card.
    fn volts(&self) -> f64 {
        self.cable.look(|board| {
            let remote = board.gateware().remote(0, ANALOG).and_then(find);
            let world = remote.expect("plugged").world();
            world.analog_output(0).expect("an analog output")
        })
    }

    fn set_input(&self, on: bool) {
        self.cable.look(|board| {
            let remote = board.gateware_mut().remote_mut(0, FIELD);
            let device = find_mut(remote.expect("plugged")).expect("a device");
            device.set_input(5, on).expect("an input");
        });
    }

    fn input(&self) -> (bool, bool) {
        let input = self.field.inputs[5].read(self.driver.pins());
        (input.value, input.valid)
    }

    /// Age of the inputs, in cycles.
    fn age(&self) -> u64 {
        self.field.inputs[5].read(self.driver.pins()).age.cycles
    }

    fn statistics(&self) -> BusStatistics {
        self.driver.bus().statistics()
    }
}

#[test]
fn program_of_the_page_is_the_one_that_moves_an_axis_here() {
    let page = include_str!("../../docs/microcontroller.md");
    let program = include_str!("../../examples/network/microcontroller/drive.rs");
    let (_, program) = program.split_once("\n\n").expect("its description");
    assert!(page.contains(&format!("```rust,ignore\n{program}```\n")));
    let fpga = machines::six_axes_7i97(Motor::default());
    let cable = Cable::to(SimBoard::new(BoardConfig::new("7I97"), fpga));
    drive::drive(cable.host(), cable.clone()).expect("the machine is complete");
    // 1.5 V are 15 units a second, for a second.
    let moved = |axis| {
        cable.look(|board| {
            board
                .gateware_mut()
                .motor(axis)
                .expect("a motor")
                .position()
        })
    };
    assert!((14.0..16.0).contains(&moved(0)), "{} units", moved(0));
    assert!((1..6).all(|axis| moved(axis).abs() < 1e-9));
}

#[test]
fn machine_is_driven_over_a_stack_that_is_no_socket() {
    let mut controller = Controller::start();
    for (on, volts) in [(true, 2.5), (false, -7.5), (true, 0.0)] {
        controller.set_input(on);
        controller.cycles(20, volts);
        let is = controller.volts();
        assert!((is - volts).abs() < 0.01, "{is} V, expected {volts} V");
        assert_eq!(controller.input(), (on, true));
    }
    let counted = controller.statistics();
    assert_eq!((counted.lost, counted.late, counted.lost_writes), (0, 0, 0));
    let (_, stopped) = controller.driver.shutdown();
    assert!(stopped.is_ok(), "{stopped:?}");
    let volts = controller.cable.look(|board| {
        let remote = board.gateware().remote(0, ANALOG).and_then(find);
        remote.expect("plugged").world().analog_output(0)
    });
    assert!(volts.is_some_and(|volts| volts.abs() < 0.01), "{volts:?}");
}

#[test]
fn lost_packet_is_exactly_one_failed_read_or_one_lost_write() {
    let mut controller = Controller::start();
    controller.cycles(20, 1.0);
    let usual = controller.age();
    for (requests, replies) in [(&[Fate::Lost][..], &[][..]), (&[][..], &[Fate::Lost][..])] {
        let before = controller.statistics();
        controller.cable.requests(requests);
        controller.cable.replies(replies);
        let error = controller.cycle(1.0).expect_err("no reply");
        assert_eq!(error.kind(), BusErrorKind::Lost, "{error}");
        assert_eq!(controller.age(), usual + 1, "an input ages");
        controller.cycles(5, 1.0);
        assert_eq!(controller.age(), usual);
        assert_eq!(controller.statistics().lost, before.lost + 1);
    }
    let before = controller.statistics();
    // The request of the read arrives, the write does not.
    controller.cable.requests(&[Fate::Good, Fate::Lost]);
    assert!(controller.cycle(3.0).is_ok());
    controller.cycles(20, 3.0);
    assert_eq!(controller.statistics().lost_writes, before.lost_writes + 1);
    assert!((controller.volts() - 3.0).abs() < 0.01);
}

#[test]
fn late_reply_is_not_taken_for_the_next_one() {
    let mut controller = Controller::start();
    controller.cycles(20, 1.0);
    let before = controller.statistics();
    controller.cable.replies(&[Fate::Late(1_500_000)]);
    let started = controller.driver.bus_mut().now();
    let error = controller.cycle(1.0).expect_err("too late");
    let waited = controller.driver.bus_mut().now().since(started);
    assert_eq!(error.kind(), BusErrorKind::Lost, "{error}");
    assert!(waited < 2 * PERIOD, "{waited:?}");
    controller.set_input(true);
    controller.cycles(20, 1.0);
    assert_eq!(controller.input(), (true, true));
    let after = controller.statistics();
    assert_eq!((after.lost, after.late), (before.lost, before.late + 1));
}

#[test]
fn address_of_a_board_that_answers_is_not_asked_for_again() {
    let mut bus = bus(&cable());
    // The stack forgets the MAC address of a neighbour that is silent for a minute.
    for _ in 0..7 {
        bus.sleep(Duration::from_secs(10));
        assert_eq!(bus.read(0x0100), Ok(0x55AA_CAFE));
    }
    assert_eq!(bus.statistics().lost, 0);
}

#[test]
fn board_that_is_not_there_is_no_reply_and_not_a_full_buffer() {
    let cable = cable();
    let absent = IpEndpoint::new(IpAddress::v4(10, 10, 10, 11), BOARD.1);
    let error = UdpBus::new(link(&cable, absent), UdpConfig::default())
        .err()
        .expect("nobody");
    assert!(
        matches!(error, BusError::GaveUp { tries: 10, .. }),
        "{error}"
    );
    assert_eq!(error.advice(), Some(advice::CHECK_BOARD));
    let nowhere = IpEndpoint::new(IpAddress::v4(0, 0, 0, 0), BOARD.1);
    let error = UdpBus::new(link(&cable, nowhere), UdpConfig::default())
        .err()
        .expect("nowhere");
    assert_eq!(error.kind(), BusErrorKind::Unreachable);
    assert!(
        error.to_string().starts_with("smoltcp cannot send: "),
        "{error}"
    );
}

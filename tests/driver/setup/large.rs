//! A firmware whose set-up is larger than a packet: twelve step generators with tables. The truth
//! is the simulated board.

use std::time::Duration;

use crate::common::ethernet::{self, bus};
use crate::common::machine::World;
use mesa_hal::Settings;
use mesa_hal::bus::Clock;
use mesa_hal::driver::{BoardState, Driver};
use mesa_hal::modules::stepgen::{StepgenPins, Stepgens};
use mesa_hal::transport::udp::UdpBus;
use mesa_hal_sim::{FirmwareImage, SimFpga};

const ST12: &str = include_str!("../../transcripts/firmwares/7I90-ST12_72-2016.txt");
const MS: Duration = Duration::from_millis(1);

fn board() -> SimFpga {
    let image = FirmwareImage::parse(ST12).expect("an image");
    SimFpga::from_image(&image).expect("a board")
}

type Machine = Driver<UdpBus<ethernet::SimLink>>;

fn machine() -> Machine {
    Driver::start(bus(board()), Settings::default()).expect("it starts")
}

fn generators(driver: &Machine) -> Vec<StepgenPins> {
    driver
        .modules::<Stepgens>()
        .flat_map(Stepgens::pins)
        .collect()
}

fn cycle(driver: &mut Machine) -> BoardState {
    let report = driver.read();
    let _ = driver.write();
    driver.bus_mut().wait(MS);
    report.map_or(BoardState::BusDown, |report| report.board)
}

/// The levels of the outputs of each generator, which follow the present entry of its table.
fn outputs(driver: &mut Machine) -> Vec<u32> {
    let fpga = driver.bus_mut().fpga();
    let pins = fpga.firmware().pins.clone();
    let of_generator = |n: u8| {
        let outputs = pins
            .iter()
            .enumerate()
            .filter(|(_, pin)| (pin.secondary, pin.unit) == (0x05, n) && pin.pin > 0x80);
        outputs.fold(0, |all, (number, pin)| {
            all | u32::from(fpga.pin_level(number)) << (pin.pin - 0x81)
        })
    };
    (0..12).map(of_generator).collect()
}

#[test]
fn set_up_larger_than_a_packet_is_written_in_parts() {
    let mut driver = machine();
    assert_eq!(generators(&driver).len(), 12);
    for _ in 0..20 {
        assert_eq!(cycle(&mut driver), BoardState::Running);
    }
    // After a bite it is written again.
    driver.bus_mut().wait(30 * MS);
    let mut states: Vec<_> = (0..3).map(|_| cycle(&mut driver)).collect();
    assert_eq!(states.pop(), Some(BoardState::WatchdogBitten));
    let _ = driver.rearm_when_running();
    for _ in 0..20 {
        states.push(cycle(&mut driver));
    }
    assert_eq!(states.last(), Some(&BoardState::Running));
    let group = driver.group();
    assert!(driver.pins().group_state(group).expect("its own").armed);
}

/// 17 words and more for each of them.
#[test]
fn all_tables_that_change_at_once_arrive() {
    let settings = Settings {
        stepgen_width: 6,
        ..Settings::default()
    };
    let mut driver = Driver::start(bus(board()), settings).expect("it starts");
    for _ in 0..10 {
        cycle(&mut driver);
    }
    set_tables(&mut driver);
    for _ in 0..150 {
        assert_eq!(cycle(&mut driver), BoardState::Running);
    }
    assert_eq!(driver.statistics().write_errors, 0);
    let expected: Vec<u32> = (1..13).collect();
    assert_eq!(outputs(&mut driver), expected);
}

/// Gives each generator a table whose first entry is its number, counted from 1.
fn set_tables(driver: &mut Machine) {
    for (n, pins) in (0..).zip(generators(driver)) {
        let of_driver = driver.pins_mut();
        of_driver
            .set_param(pins.step_type, 5 + n % 8)
            .expect("a table");
        for (k, param) in (0..).zip(pins.table_data.expect("a table")) {
            let word = 0x2A15_2A01 + n + (k << 16);
            of_driver.set_param(param, word).expect("a word");
        }
    }
}

#[test]
fn lost_part_of_the_set_up_is_made_good() {
    for lost in 0..12 {
        let settings = Settings {
            stepgen_width: 6,
            ..Settings::default()
        };
        let mut driver = Driver::start(bus(board()), settings).expect("it starts");
        set_tables(&mut driver);
        for _ in 0..150 {
            cycle(&mut driver);
        }
        driver.bus_mut().wait(30 * MS);
        for _ in 0..6 {
            cycle(&mut driver);
        }
        let group = driver.group();
        let _ = driver.rearm_when_running();
        // A part of the set-up is lost, with all that follows for ten packets.
        let mut left = lost;
        driver.bus_mut().link().to_board = Box::new(move |_, _| {
            left -= 1;
            if (-10..0).contains(&left) {
                vec![]
            } else {
                vec![ethernet::WIRE]
            }
        });
        for _ in 0..60 {
            cycle(&mut driver);
        }
        let _ = driver.rearm_when_running();
        for _ in 0..150 {
            cycle(&mut driver);
        }
        let state = driver.pins().group_state(group).expect("its own");
        assert!(state.valid && state.armed, "packet {lost}");
        let expected: Vec<u32> = (1..13).collect();
        assert_eq!(outputs(&mut driver), expected, "packet {lost}");
    }
}

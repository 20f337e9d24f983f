//! A kind of card that this crate does not know, and remotes that may be absent at the start: they
//! start when they are plugged in, and any other card does not.

use std::time::Duration;

use crate::common::machine::{ANALOG, Cards, FIELD, Machine, OUTPUTS, World, fpga};
use crate::common::valves::{VALVES, Valves, valve_block};
use mesa_hal::boards::{AttachError, I7i72, I7i77Field, i7i72, i7i77};
use mesa_hal::discovery::{DataType, ElementTable, RemoteTable, TableAddresses};
use mesa_hal::driver::{
    Board, Driver, Presence, RemoteConfig, RemoteState, SerialConfig, Settings,
};
use mesa_hal::{MesaError, advice};
use mesa_hal_sim::SimFpga;
use mesa_hal_sim::devices::{FieldIo, Outputs48};
use mesa_hal_sim::remote::Cable;
use mesa_hal_sim::wire::RemoteEnd;

/// The valve block, with the place of the tables of the firmware that the machine was built with.
const VALVES_OF_FIRMWARE_1: RemoteTable = RemoteTable {
    contents: &[TableAddresses {
        mode: 0,
        ptoc: 0x1234,
        gtoc: 0x1240,
    }],
    ..VALVES
};

fn outputs_48() -> Box<dyn RemoteEnd> {
    Box::new(Cable::new(Box::new(Outputs48::i7i72().expect("a 7I72")), 8))
}

impl Cards for Valves {
    fn of<B: World>(driver: &Driver<B>) -> Self {
        driver.attach((0, OUTPUTS as u8)).expect("valves")
    }
}

pub type Shop = Machine<SimFpga, Valves>;

/// Settings for a remote of this kind in this mode, on this channel, that may be absent.
fn optional(channel: usize, mode: u8, kind: &'static RemoteTable) -> Settings {
    let remote = RemoteConfig {
        mode,
        kind: Some(kind),
        presence: Presence::Optional,
        ..RemoteConfig::default()
    };
    let mut config = SerialConfig::default();
    config.channels.insert(channel as u8, remote);
    Settings {
        serial_ports: [(0, config)].into(),
        ..Settings::default()
    }
}

fn board(end: Option<Box<dyn RemoteEnd>>, mut settings: Settings) -> Board<SimFpga> {
    let mut fpga = fpga();
    let _ = fpga.plug(0, OUTPUTS, end);
    settings.remotes.push(&VALVES);
    Board::identify(fpga, settings).expect("a 7I92")
}

/// A machine whose valve block is absent.
fn shop() -> Shop {
    let board = board(None, optional(OUTPUTS, 0, &VALVES));
    let board = board.discover().expect("two remotes");
    assert_eq!(board.remotes().count(), 3);
    assert_eq!(board.missing(), []);
    let absent = board.attach::<Valves>((0, OUTPUTS as u8));
    let absent = absent.expect("its pins are made");
    let shop = Shop::of(board.start().expect("two remotes run"));
    assert_eq!(shop.cards, absent);
    assert_eq!(shop.driver.missing(), []);
    shop
}

/// The same machine, and the valve block that belongs to it.
pub fn shop_and_its_valves() -> (Shop, Box<dyn RemoteEnd>) {
    (shop(), valve_block(""))
}

fn plug(shop: &mut Shop, end: Option<Box<dyn RemoteEnd>>) {
    let _ = shop.fpga().plug(0, OUTPUTS, end);
}

fn open_valves(shop: &mut Shop) {
    let valves = shop.cards.outputs;
    for valve in valves {
        valve.set(shop.driver.pins_mut(), true);
    }
}

fn are_open(shop: &Shop) -> bool {
    let world = shop.device(OUTPUTS).world();
    let open = [0, 1, 2, 3].map(|n| world.output(n) == Some(true));
    assert!(open == [true; 4] || open == [false; 4], "{open:?}");
    open[0]
}

/// Reason for not running.
fn reason(shop: &Shop) -> String {
    match shop.status(OUTPUTS).state {
        RemoteState::Offline { reason, .. } | RemoteState::Restarting { reason } => {
            reason.with_advice().to_string()
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn card_of_an_unknown_kind_has_typed_handles() {
    let mut shop = {
        // A remote that is present is used with its own tables, optional or not.
        let board = board(Some(valve_block("")), optional(OUTPUTS, 0, &VALVES));
        let mut board = board.discover().expect("three remotes");
        assert_eq!(board.remotes().count(), 3);
        assert_eq!(board.remarks(), []);
        let channel = OUTPUTS as u8;
        let written = board.write_remote_parameter((0, channel), "NVWatchDogTimeout", 100);
        written.expect("it takes it");
        let watchdog = board.read_remote_parameter((0, channel), "nvwatchdogtimeout");
        let watchdog = watchdog.expect("it tells it");
        assert_eq!(watchdog.raw, 100);
        let valves = board.attach::<Valves>((0, OUTPUTS as u8));
        valves.expect("valves");
        Shop::of(board.start().expect("all of it runs"))
    };
    let handles = shop.cards;
    shop.device_mut(OUTPUTS)
        .set_input(2, true)
        .expect("an input");
    shop.device_mut(OUTPUTS)
        .set_input_volts(0, 24.0)
        .expect("a supply");
    open_valves(&mut shop);
    shop.cycles(4);
    assert!(are_open(&shop));
    let pins = shop.driver.pins();
    let closed = handles.closed.map(|input| input.read(pins).ok());
    assert_eq!(closed, [false, false, true, false].map(Some));
    let volts = handles.supply.read(pins).ok().expect("a voltage");
    assert!((volts - 24.0).abs() < 0.1, "{volts}");
    let info = pins.info(handles.outputs[3].pin).expect("a pin");
    assert_eq!((&*info.place.terminal, &*info.place.signal), ("X2.6", "Y3"));
    // The handles are for this card only.
    let other = shop.driver.attach::<Valves>((0, FIELD as u8)).unwrap_err();
    assert_eq!(
        other.to_string(),
        "7i77.0.0: a 7I77 answers, expected a VLV4"
    );
    assert_eq!(other.advice(), Some(advice::CHECK_SWAPPED_CABLES));
    let other = shop.driver.attach::<I7i72>((0, OUTPUTS as u8)).unwrap_err();
    assert!(other.to_string().contains("a VLV4 answers"), "{other}");
    let nothing = shop.driver.attach::<Valves>((0, 5)).unwrap_err();
    assert!(
        nothing
            .to_string()
            .contains("channel 5: no valve block takes part"),
        "{nothing}"
    );
}

#[test]
fn remote_absent_at_start_and_not_optional_stays_missing() {
    let board = board(None, Settings::default());
    let mut board = board.discover().expect("two remotes");
    let error = board
        .read_remote_parameter((0, OUTPUTS as u8), "nvwatchdogtimeout")
        .unwrap_err();
    assert!(error.to_string().contains("channel 2"), "{error}");
    let attached = board.attach::<Valves>((0, OUTPUTS as u8));
    assert!(matches!(attached, Err(AttachError::NoRemote { .. })));
    let mut driver = board.start().expect("two remotes run");
    let _ = driver.bus_mut().plug(0, OUTPUTS, Some(valve_block("")));
    for _ in 0..10_000 {
        let _ = driver.read().expect("the bus does not fail");
        driver.write().expect("the bus does not fail");
        mesa_hal::bus::Clock::wait(driver.bus_mut(), Duration::from_micros(900));
    }
    assert_eq!(driver.missing().len(), 1);
    assert_eq!(driver.ports()[0].remotes().count(), 2);
}

#[test]
fn optional_remote_starts_when_plugged_in_and_waits_to_be_armed() {
    let mut shop = shop();
    let handles = shop.cards;
    assert_eq!(
        reason(&shop),
        "absent at the start; plug the remote in, and check its power (field power too, where it is powered from there)"
    );
    for _ in 0..300 {
        open_valves(&mut shop);
        shop.cycles(1);
        let rearmed = shop.driver.rearm().expect("the bus does not fail");
        assert_eq!((rearmed.armed, rearmed.waiting), (0, 1));
        assert!(!shop.is_valid(OUTPUTS) && !shop.is_armed(OUTPUTS));
        assert!(!shop.driver.pins().read(handles.supply.volts).valid);
    }
    for _ in 0..2 {
        plug(&mut shop, Some(valve_block("")));
        shop.device_mut(OUTPUTS)
            .set_input_volts(0, 12.0)
            .expect("a supply");
        let cycles = shop.until(6_000, |shop| {
            open_valves(shop);
            shop.is_running(OUTPUTS) && shop.is_valid(OUTPUTS)
        });
        assert!(cycles > 1, "it takes a START");
        for _ in 0..50 {
            open_valves(&mut shop);
            shop.cycles(1);
            assert!(!are_open(&shop), "it was not armed");
        }
        let volts = handles.supply.read(shop.driver.pins()).ok();
        assert!(volts.is_some_and(|volts| (volts - 12.0).abs() < 0.1));
        let _ = shop.driver.rearm().expect("the bus does not fail");
        shop.cycles(3);
        assert!(!are_open(&shop), "what was set before is forgotten");
        open_valves(&mut shop);
        shop.cycles(3);
        assert!(are_open(&shop) && shop.is_valid(OUTPUTS));
        assert!(!shop.status(OUTPUTS).descriptor.process_data.is_empty());

        plug(&mut shop, None);
        shop.until(2_000, |shop| !shop.is_running(OUTPUTS));
        shop.cycles(10);
        assert!(!shop.is_valid(OUTPUTS) && !shop.is_armed(OUTPUTS));
    }
}

#[test]
fn other_card_at_an_optional_remote_stays_offline_with_a_reason() {
    let mut shop = shop();
    let stays_offline = |shop: &mut Shop, text: &[&str]| {
        shop.until(12_000, |shop| reason(shop).contains(text[0]));
        for _ in 0..200 {
            open_valves(shop);
            shop.cycles(1);
            assert!(!shop.is_running(OUTPUTS) && !shop.is_valid(OUTPUTS));
        }
        let reason = reason(shop);
        assert!(text.iter().all(|&part| reason.contains(part)), "{reason}");
    };
    plug(&mut shop, Some(outputs_48()));
    stays_offline(
        &mut shop,
        &["another card answers: 7I72 (", "plug the right remote in"],
    );
    assert!(!are_open_somewhere(&shop));
    plug(&mut shop, Some(valve_block("data More 12 bits in\n")));
    stays_offline(
        &mut shop,
        &["RX 5, TX 1", "expected RX 3, TX 1", "firmware"],
    );
    plug(&mut shop, Some(valve_block("")));
    shop.until(12_000, |shop| shop.is_running(OUTPUTS));
}

/// Neither one that is present at the start nor one that is plugged in later.
#[test]
fn optional_remote_with_another_unit_number_is_not_taken() {
    for is_there in [false, true] {
        let shop_of = |unit_number| {
            let mut settings = optional(OUTPUTS, 0, &VALVES);
            let port = settings.serial_ports.get_mut(&0).expect("the port");
            let remote = port.channels.get_mut(&(OUTPUTS as u8));
            remote.expect("the channel").unit_number = Some(unit_number);
            let end = is_there.then(|| valve_block(""));
            let mut shop = Shop::of(board(end, settings).start().expect("two remotes run"));
            plug(&mut shop, Some(valve_block("")));
            shop
        };
        let mut shop = shop_of(0x56);
        shop.until(12_000, |shop| {
            assert!(!shop.is_running(OUTPUTS), "{is_there}");
            reason(shop).contains("another card answers: VLV4 (unit number 0x00000055)")
        });
        let mut shop = shop_of(0x55);
        shop.until(12_000, |shop| shop.is_running(OUTPUTS));
    }
}

fn are_open_somewhere(shop: &Shop) -> bool {
    let world = shop.device(OUTPUTS).world();
    (0..48).any(|n| world.output(n) == Some(true))
}

#[test]
fn table_that_knows_its_firmware_takes_no_other() {
    let mut fpga = fpga();
    let _ = fpga.plug(0, OUTPUTS, None);
    let driver = Driver::start(fpga, optional(OUTPUTS, 0, &VALVES_OF_FIRMWARE_1));
    let mut shop = Shop::of(driver.expect("two remotes run"));
    plug(&mut shop, Some(valve_block("")));
    shop.until(12_000, |shop| reason(shop).contains("tables"));
    let reason = reason(&shop);
    assert!(reason.contains("expected 12401234"), "{reason}");
    assert!(reason.contains("another firmware"), "{reason}");
}

#[test]
fn field_io_of_a_7i77_plugged_in_later_runs_in_configured_mode() {
    let mut fpga = fpga();
    let _ = fpga.plug(0, FIELD, None);
    let driver = Driver::start(fpga, optional(FIELD, 2, &i7i77::FIELD));
    let mut machine: Machine = Machine::of(driver.expect("the others run"));
    let field: I7i77Field = machine.driver.attach((0, FIELD as u8)).expect("field I/O");
    let supply = field.field_voltage.expect("mode 2");
    let device = FieldIo::i7i77().expect("field I/O");
    let _ = machine
        .fpga()
        .plug(0, FIELD, Some(Box::new(Cable::new(Box::new(device), 9))));
    machine.until(6_000, |machine| machine.is_valid(FIELD));
    machine
        .device_mut(FIELD)
        .set_input(31, true)
        .expect("an input");
    machine.cycles(3);
    let pins = machine.driver.pins();
    assert_eq!(field.inputs[31].read(pins).ok(), Some(true));
    assert!(supply.read(pins).valid);
}

/// FACTS 5.7: an attempt at a channel without a remote takes the port for 17 ms.
#[test]
fn absent_remote_costs_neighbours_under_1_percent_and_no_output() {
    let mut shop = shop();
    let field: I7i77Field = shop.driver.attach((0, FIELD as u8)).expect("field I/O");
    shop.cycles(5);
    let before = [FIELD, ANALOG].map(|channel| shop.status(channel).transfers);
    let cycles = 60_000;
    let mut without = [0_u64; 2];
    for _ in 0..cycles {
        let seen = [FIELD, ANALOG].map(|channel| shop.status(channel).transfers);
        shop.cycles(1);
        for (n, channel) in [FIELD, ANALOG].into_iter().enumerate() {
            let status = shop.status(channel);
            let is_new = status.transfers > seen[n];
            without[n] = if is_new { 0 } else { without[n] + 1 };
            assert!(without[n] <= 20, "no gap longer than an attempt");
            // What README and guides recommend for an axis and its switches.
            let limit = field.inputs[2].read(shop.driver.pins()).within(25);
            assert!(limit.is_some());
            assert_eq!(status.failures.total(), 0);
            assert!(shop.is_running(channel) && shop.is_armed(channel));
        }
    }
    for (n, channel) in [FIELD, ANALOG].into_iter().enumerate() {
        let done = shop.status(channel).transfers - before[n];
        assert!(done > cycles - cycles / 100, "{done} of {cycles}");
    }
    assert!(!shop.is_running(OUTPUTS));
}

#[test]
fn optional_remote_with_an_incomplete_table_is_refused() {
    let mut fpga = fpga();
    let _ = fpga.plug(0, OUTPUTS, None);
    let error = Driver::start(fpga, optional(OUTPUTS, 1, &i7i72::REMOTE)).unwrap_err();
    let text = error.to_string();
    assert!(
        text.contains("7I72") && text.contains("software mode 1"),
        "{text}"
    );
}

/// With limits that are not finite, full scale would silently be 1. FACTS 11.10: floating-point
/// numbers may have such limits.
#[test]
fn optional_remote_with_non_finite_limits_is_refused() {
    const fn meter(elements: &'static [ElementTable; 1]) -> RemoteTable {
        RemoteTable::new("meter", *b"METR", elements)
    }
    const fn number(data_type: DataType, bits: u8, limits: (f32, f32)) -> [ElementTable; 1] {
        let (min, max) = limits;
        [ElementTable::input("Supply", bits, data_type).range(min, max, "V")]
    }
    const INFINITE: (f32, f32) = (f32::NEG_INFINITY, f32::INFINITY);
    static REFUSED: [RemoteTable; 4] = [
        meter(&const { number(DataType::Unsigned, 8, (0.0, f32::INFINITY)) }),
        meter(&const { number(DataType::Signed, 16, INFINITE) }),
        meter(&const { number(DataType::Unsigned, 8, (0.0, f32::NAN)) }),
        meter(&const { number(DataType::Signed, 16, (f32::NAN, 1.0)) }),
    ];
    static TAKEN: [RemoteTable; 2] = [
        meter(&const { number(DataType::Unsigned, 8, (0.0, 36.3)) }),
        meter(&const { number(DataType::Float, 32, INFINITE) }),
    ];
    let start = |kind| {
        let mut fpga = fpga();
        let _ = fpga.plug(0, OUTPUTS, None);
        Driver::start(fpga, optional(OUTPUTS, 0, kind))
    };
    for kind in &TAKEN {
        let driver = start(kind).expect("two remotes run");
        assert_eq!(driver.ports()[0].remotes().count(), 3);
    }
    for kind in &REFUSED {
        let text = start(kind).unwrap_err().to_string();
        assert!(text.contains("meter") && text.contains("finite"), "{text}");
    }
}

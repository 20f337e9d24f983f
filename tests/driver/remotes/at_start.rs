//! Remotes that are found at the start and cannot run: offline from then on, with all their pins,
//! and tried again. The truth is the terminal of the simulated card.

use crate::common::machine::{FIELD, Machine, fpga};
use mesa_hal::Settings;
use mesa_hal::driver::{
    Board, EventKind, OfflineReason, Presence, RemarkKind, RemoteConfig, RemoteState, SerialConfig,
};
use mesa_hal::hal::{Input, Output};
use mesa_hal_sim::SimFpga;
use mesa_hal_sim::devices::{Plain, find_mut};
use mesa_hal_sim::remote::Cable;

/// The machine of the README, whose 7I77 has no field power, as after an E-stop that cuts it.
fn without_field_power() -> SimFpga {
    let mut fpga = fpga();
    set_field_volts(&mut fpga, 0.0);
    fpga
}

fn set_field_volts(fpga: &mut SimFpga, volts: f64) {
    let now = SimFpga::now(fpga);
    let remote = fpga.remote_mut(0, FIELD).expect("a remote");
    let device = find_mut(remote).expect("a device");
    device.set_field_volts(now, volts).expect("field power");
}

fn input(machine: &Machine, name: &str) -> (bool, bool) {
    let pin: Input<bool> = machine.input(name);
    let reading = machine.driver.pins().read(pin);
    (reading.value, reading.valid)
}

fn required() -> SerialConfig {
    let remote = RemoteConfig {
        presence: Presence::Required,
        ..RemoteConfig::default()
    };
    let mut config = SerialConfig::default();
    config.channels.insert(FIELD as u8, remote);
    config
}

#[test]
fn card_without_field_power_is_offline_with_all_its_pins() {
    for is_required in [false, true] {
        let mut machine: Machine = Machine::on(without_field_power(), |settings| {
            if is_required {
                settings.serial_ports = [(0, required())].into();
            }
        });
        let remarks = machine.driver.remarks();
        let is_offline = |kind: &RemarkKind| matches!(kind, RemarkKind::Offline { .. });
        assert!(
            remarks.iter().any(|one| is_offline(&one.kind)),
            "{remarks:?}"
        );
        let mut events = machine.driver.events();
        let told: Vec<_> = events.by_ref().map(|event| event.kind).collect();
        let [EventKind::RemoteOffline { remote, reason }] = told[..] else {
            panic!("{told:?}");
        };
        assert_eq!(remote.to_string(), "7i77.0.0");
        assert!(matches!(reason, OfflineReason::FieldPower(_)), "{reason}");
        // As a normally-closed switch that is tripped, or off its wire.
        assert_eq!(input(&machine, "7i77.0.0.input-03"), (false, false));
        assert_eq!(input(&machine, "7i77.0.0.input-03-not"), (true, false));
        machine.cycles(1000);
        assert_eq!(input(&machine, "7i77.0.0.input-03-not"), (true, false));
        assert!(!machine.is_armed(FIELD) && !machine.is_valid(FIELD));
        assert!(machine.is_running(1) && machine.is_running(2));
        assert_eq!(events.by_ref().count(), 0, "attempts that fail as before");
        let state = machine.status(FIELD);
        assert!(matches!(
            state.state,
            RemoteState::Offline {
                reason: OfflineReason::FieldPower(_),
                ..
            }
        ));

        // It comes up by itself, and waits to be armed.
        set_field_volts(machine.fpga(), 24.0);
        let device = machine.device_mut(FIELD);
        device.set_input(3, true).expect("an input");
        machine.until(6_000, |machine| machine.is_valid(FIELD));
        assert_eq!(input(&machine, "7i77.0.0.input-03"), (true, true));
        assert_eq!(input(&machine, "7i77.0.0.input-03-not"), (false, true));
        let told: Vec<_> = events.by_ref().map(|event| event.kind).collect();
        assert_eq!(told, [EventKind::RemoteBack { remote }]);
        let output: Output<bool> = machine.output("7i77.0.0.output-03");
        machine.driver.pins_mut().set(output, true);
        machine.cycles(3);
        assert!(!machine.is_armed(FIELD));
        assert_eq!(machine.device(FIELD).world().output(3), Some(false));
        let rearmed = machine.driver.rearm().expect("a board");
        assert_eq!(rearmed.waiting, 0);
        machine.driver.pins_mut().set(output, true);
        machine.cycles(3);
        assert_eq!(machine.device(FIELD).world().output(3), Some(true));
    }
}

#[test]
fn run_off_and_on_tries_such_a_card_at_once() {
    let mut machine: Machine = Machine::on(without_field_power(), |_| {});
    // By now the next attempt is seconds away.
    machine.cycles(5_500);
    set_field_volts(machine.fpga(), 24.0);
    let run: Output<bool> = machine.output("sserial.port-0.run");
    machine.driver.pins_mut().set(run, false);
    machine.cycles(100);
    machine.driver.pins_mut().set(run, true);
    machine.until(100, |machine| machine.is_valid(FIELD));
}

/// A remote that describes two elements by one name, the second after eight inputs.
const TWICE: &str = "
remote DUPL
unit 0x73000043
mode 0 standard
  data Input 8 bits in
  data AnalogIn0 8 unsigned in 0 3.3 volts
  data AnalogIn0 8 unsigned in 0 3.3 volts
";

#[test]
fn description_that_cannot_be_used_makes_no_pin() {
    let mut fpga = fpga();
    let twice = Plain::from_description(TWICE).expect("a description");
    fpga.plug(0, FIELD, Some(Box::new(Cable::new(Box::new(twice), 0))));
    let board = Board::identify(fpga, Settings::default()).expect("a 7I92");
    let board = board.discover().expect("two remotes");
    let [missing] = board.missing() else {
        panic!("{:?}", board.missing());
    };
    assert!(
        missing
            .to_string()
            .contains("two of its elements are named analogin0"),
        "{missing}"
    );
    let made = board.pins().infos().iter();
    let names: Vec<_> = made.filter(|info| info.name.contains("dupl")).collect();
    assert!(names.is_empty(), "{names:?}");
    let driver = board.start().expect("two remotes");
    let infos = driver.pins().infos();
    for info in infos {
        assert!(driver.pins().has(&info.name), "{}", info.name);
    }
    assert_eq!(driver.pins().groups().count(), 4, "board, driver, remotes");
}

//! World remotes run on virtual time independently: their watchdogs bite whatever accesses the
//! FPGA, and however often.

use crate::common::machine::{ANALOG, FIELD, FieldRemote, Machine, OUTPUTS, fpga};
use mesa_hal::Settings;
use mesa_hal::driver::Driver;
use mesa_hal::lbp::{RemoteFaults, crc8};
use mesa_hal_sim::devices::{Outputs48, SignalValue, SimDevice};
use mesa_hal_sim::wire::{Burst, RemoteEnd};
use mesa_hal_sim::{Motor, SimFpga, machines};

const MS: u64 = 1_000_000;

/// A machine with six motors on its 7I77, all of whose outputs are on.
fn running() -> Machine {
    let mut fpga = fpga();
    machines::wire_7i77(&mut fpga, 0, ANALOG, 0, |_| Motor::default());
    let mut machine = Machine::with(Driver::start(fpga, Settings::default()).expect("complete"));
    let _ = machine.driver.rearm();
    machine.cycles(3);
    machine.cards.set_all(machine.driver.pins_mut());
    machine.cycles(100);
    for channel in [FIELD, ANALOG, OUTPUTS] {
        assert!(all_on(machine.device(channel)), "channel {channel}");
    }
    machine
}

fn is_on(value: &SignalValue) -> bool {
    match value {
        SignalValue::Bool(on) => *on,
        SignalValue::Volts(volts) | SignalValue::Number(volts) => *volts != 0.0,
        SignalValue::Count(count) => *count != 0,
    }
}

fn all_on(device: &dyn SimDevice) -> bool {
    device.outputs().iter().all(|(_, value)| is_on(value))
}

fn all_off(device: &dyn SimDevice) -> bool {
    device.outputs().iter().all(|(_, value)| !is_on(value))
}

fn speeds(fpga: &mut SimFpga) -> [f64; 6] {
    core::array::from_fn(|axis| fpga.motor(axis).expect("axis").velocity())
}

/// Encoders are read and pins are written every 5 us, and nothing is sent to the remotes.
#[test]
fn watchdog_of_an_unplugged_7i77_stops_motors_despite_accesses() {
    let mut machine = running();
    machine.cable(ANALOG).unplug();
    machine.cable(FIELD).unplug();
    let begin = machine.now();
    let fpga = machine.driver.bus_mut();
    let mut off_at = None;
    while fpga.now() < begin + 60 * MS {
        fpga.advance_to(fpga.now() + 5_000);
        fpga.read_register(0x3600);
        fpga.write_register(0x1000, 0);
        let devices = [FIELD, ANALOG].map(|channel| {
            let end = fpga.remote(0, channel).expect("remote");
            all_off(mesa_hal_sim::devices::find(end).expect("device"))
        });
        if devices == [true; 2] && off_at.is_none() {
            off_at = Some(fpga.now() - begin);
        }
    }
    let off_at = off_at.expect("the outputs never go off");
    assert!((48 * MS..=50 * MS).contains(&off_at), "{off_at}");
    fpga.advance_to(fpga.now() + 200 * MS);
    let speeds = speeds(fpga);
    assert!(speeds.iter().all(|v| v.abs() < 1e-3), "{speeds:?}");
}

#[test]
fn every_fault_bit_is_set_alone_and_only_watchdog_switches_off() {
    for bit in RemoteFaults::all().iter() {
        let mut machine = running();
        let remote = machine.driver.bus_mut().device_mut::<FieldRemote>(0, FIELD);
        remote.expect("field I/O").set_faults(bit);
        machine.pass_nanos(1_000);
        let device = machine.device(FIELD);
        assert_eq!(device.faults(), bit);
        assert_eq!(all_off(device), bit == RemoteFaults::WATCHDOG, "{bit:?}");
        assert_eq!(all_on(device), bit != RemoteFaults::WATCHDOG, "{bit:?}");
    }
}

/// Sends E7 FF, which clears the faults.
fn clear_faults(remote: &mut dyn SimDevice, at: u64) {
    let mut frame = vec![0xE7, 0xFF];
    frame.push(crc8(&frame));
    let burst = Burst::new(at, 400, &frame);
    remote.advance(burst.end());
    remote.receive(&burst);
    assert!(remote.transmit().is_some(), "the request is answered");
}

#[test]
fn cause_that_lasts_can_not_be_cleared_until_it_ends() {
    let mut remote = Outputs48::i7i72().expect("7I72");
    let fault = RemoteFaults::NO_ENABLE;
    clear_faults(&mut remote, 0);
    assert!(remote.faults().is_empty());
    remote.set_faults(fault);
    remote.configure(|config| config.stuck_faults = fault);
    clear_faults(&mut remote, 2 * MS);
    assert_eq!(remote.faults(), fault);
    remote.configure(|config| config.stuck_faults = RemoteFaults::empty());
    remote.advance(5 * MS);
    assert_eq!(remote.faults(), fault, "it is not cleared");
    clear_faults(&mut remote, 6 * MS);
    assert!(remote.faults().is_empty());
}

#[test]
fn faults_last_as_long_as_their_cause_and_bits_until_cleared() {
    use RemoteFaults as F;
    let mut machine = running();
    let seen = |machine: &mut Machine| {
        machine.pass_nanos(1_000);
        let device = machine.device(FIELD);
        let on = device.outputs().iter().filter(|(_, v)| is_on(v)).count();
        (on, device.faults())
    };
    let device = machine.device_mut(FIELD);
    device.set_over_current(3, true).expect("output");
    assert_eq!(seen(&mut machine), (15, F::OVER_CURRENT));
    let device = machine.device_mut(FIELD);
    device.set_over_temperature(9, true).expect("output");
    let both = F::OVER_CURRENT | F::OVER_TEMPERATURE;
    assert_eq!(seen(&mut machine), (7, both));
    let device = machine.device_mut(FIELD);
    device.set_over_temperature(9, false).expect("output");
    assert_eq!(seen(&mut machine), (15, both), "it has cooled down");
    let now = machine.now();
    for (volts, fault) in [(40.0, F::HIGH_VOLTAGE), (24.0, F::HIGH_VOLTAGE)] {
        let device = machine.device_mut(FIELD);
        device.set_field_volts(now, volts).expect("field power");
        assert_eq!(seen(&mut machine), (15, both | fault));
    }
}

#[test]
fn remote_is_off_without_power_and_then_waits_for_the_host() {
    let mut machine = running();
    let now = machine.now();
    machine.device_mut(ANALOG).set_power(now, false);
    assert!(all_off(machine.device(ANALOG)));
    machine.driver.bus_mut().advance_to(now + 200 * MS);
    let stopped = speeds(machine.driver.bus_mut());
    assert!(stopped.iter().all(|v| v.abs() < 1e-3), "{stopped:?}");
    let now = machine.now();
    machine.device_mut(ANALOG).set_power(now, true);
    assert_eq!(machine.device(ANALOG).faults(), RemoteFaults::WATCHDOG);
    assert!(all_off(machine.device(ANALOG)));
}

#[test]
fn watchdogs_of_all_remotes_bite_during_a_long_fpga_reset() {
    let mut machine = running();
    let fpga = machine.driver.bus_mut();
    fpga.reset_for(80 * MS);
    fpga.advance_to(fpga.now() + 40 * MS);
    for channel in [FIELD, ANALOG, OUTPUTS] {
        assert!(all_on(machine.device(channel)), "channel {channel}");
    }
    let fpga = machine.driver.bus_mut();
    fpga.advance_to(fpga.now() + 11 * MS);
    assert!(fpga.is_in_reset());
    for channel in [FIELD, ANALOG, OUTPUTS] {
        assert!(all_off(machine.device(channel)), "channel {channel}");
    }
}

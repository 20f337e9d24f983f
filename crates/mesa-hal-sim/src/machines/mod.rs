//! Ready-made machines: boards with their firmware, and with remotes and motors on them.
//!
//! Their properties, also for `mesa sim` and `--sim`, unless other values are requested:
//!
//! | item | value | source |
//! |---|---|---|
//! | each of six motors | 100 units/s at 10 V, velocity loop of 5 ms, at 0 | [motor] |
//! | its encoder | 1000 counts per unit, an index every 4000 counts | [motor] |
//! | its axis | no friction, no hard stops, unlimited force | [motor] |
//! | each of five stepper motors | 1000 steps per unit, at most 100 units/s, at 0 | [stepper] |
//! | the spindle of a 7I76 | a motor on its analog output | [motor] |
//! | field power of a remote | 24 V; its inputs at 0 V | manual: 7I77 |
//! | an FPGA's clocks | ClockLow 100 MHz (5I25: 33.33 MHz), ClockHigh 200 MHz | FACTS 9.3 |
//! | multiplexed encoders | sampled at ClockLow/8 (7I77) or ClockLow/16 (7I97) | the manuals |
//! | a register access, embedded | 600 ns | [`DEFAULT_ACCESS_COST`] |
//! | a packet, on Ethernet | 15 us, and 80 ns per element; not confirmed | [`BoardConfig`] |
//! | a board after a reset, a reload | silent for 200 ms, 300 ms | [`BoardConfig`] |
//! | a late packet, on request | 0.5 to 3 ms | [`Mishaps`] |
//!
//! [motor]: crate::MotorConfig::default
//! [stepper]: crate::StepperConfig::default
//! [`DEFAULT_ACCESS_COST`]: crate::DEFAULT_ACCESS_COST
//! [`BoardConfig`]: crate::BoardConfig
//! [`Mishaps`]: crate::Mishaps

mod firmware;

pub use firmware::*;

use crate::devices::{Analog, DescriptionError, Device, FieldIo, Outputs48};
use crate::fpga::{AxisWiring, DriveSignal, DriveSource, SimFpga, StepperWiring, device};
use crate::remote::{Application, Cable, SimRemote};
use crate::wire::RemoteEnd;
use crate::world::{Motor, Stepper};

/// Channel of a 7I77's field I/O, counted from the card's first channel. FACTS 8.1.
pub const FIELD_IO: usize = 0;
/// Channel of a 7I77's analog section, counted from the card's first channel.
pub const ANALOG: usize = 1;
/// Channel of a 7I77's RS-422 terminals, counted from the card's first channel.
pub const EXPANSION: usize = 2;

/// Maximum number of channels of one smart serial port.
const MAX_CHANNELS: u8 = 8;

/// A 7I92 for a 7I77, with nothing plugged in.
pub fn i7i92_7i77() -> SimFpga {
    SimFpga::new(firmware_7i92_7i77())
}

/// A 5I25 for a 7I77, with nothing plugged in.
pub fn i5i25_7i77() -> SimFpga {
    SimFpga::new(firmware_5i25_7i77())
}

/// A 5I25 for two 7I77, with nothing plugged in.
pub fn i5i25_7i77x2() -> SimFpga {
    SimFpga::new(firmware_5i25_7i77x2())
}

/// A 5I25 for a 7I77 and a 7I76, with nothing plugged in.
pub fn i5i25_7i77_7i76() -> SimFpga {
    SimFpga::new(firmware_5i25_7i77_7i76())
}

/// A 7I80DB with older firmware: see [`firmware_7i80_of_2016`]. Nothing is plugged in.
pub fn i7i80_of_2016() -> SimFpga {
    SimFpga::new(firmware_7i80_of_2016())
}

/// A 7I97 with `channels` serial channels, with nothing plugged in.
pub fn i7i97(channels: u8) -> SimFpga {
    SimFpga::new(firmware_7i97(channels))
}

/// A 7I97T with `channels` serial channels, with nothing plugged in.
pub fn i7i97t(channels: u8) -> SimFpga {
    SimFpga::new(firmware_7i97t(channels))
}

/// A 7I97 for a 7I77 on P1, with nothing plugged in.
pub fn i7i97_7i77() -> SimFpga {
    SimFpga::new(firmware_7i97_7i77())
}

/// A 7I92 for a 7I76, with nothing plugged in.
pub fn i7i92_7i76() -> SimFpga {
    SimFpga::new(firmware_7i92_7i76())
}

/// A 7I97 for a 7I76 on P1, with nothing plugged in.
pub fn i7i97_7i76() -> SimFpga {
    SimFpga::new(firmware_7i97_7i76())
}

/// A 7I97 with InM and OutM: see [`firmware_7i97_inm_outm`].
pub fn i7i97_inm_outm(channels: u8) -> SimFpga {
    SimFpga::new(firmware_7i97_inm_outm(channels))
}

/// A 7I92 with a 7I77 and a 7I72 on the 7I77's expansion port, each remote behind a [`Cable`].
pub fn i7i92_with_cards() -> SimFpga {
    with_cards(i7i92_7i77())
}

/// A 7I92 with a 7I77, a 7I72 on the 7I77's expansion port, and six motors.
pub fn six_axes_7i92(motor: Motor) -> SimFpga {
    six_axes_7i77(i7i92_7i77(), motor)
}

/// A 5I25 with a 7I77, a 7I72 on the 7I77's expansion port, and six motors.
pub fn six_axes_5i25(motor: Motor) -> SimFpga {
    six_axes_7i77(i5i25_7i77(), motor)
}

/// A 7I80DB with older firmware, a 7I77, a 7I72 on the 7I77's expansion port, and six motors.
pub fn six_axes_7i80_of_2016(motor: Motor) -> SimFpga {
    six_axes_7i77(i7i80_of_2016(), motor)
}

/// A 7I97 with six motors, and on three serial channels a 7I77's two remotes and a 7I72.
pub fn six_axes_7i97(motor: Motor) -> SimFpga {
    let mut fpga = with_cards(i7i97(3));
    wire_7i97(&mut fpga, |_| motor);
    fpga
}

/// A 7I97 with a 7I77 on P1, a 7I72 on the 7I77's expansion port (channel 3), and twelve motors: 0
/// to 5 on the board, 6 to 11 on the card. `motor` is called with the number of each.
pub fn twelve_axes_7i97(motor: impl Fn(usize) -> Motor) -> SimFpga {
    let mut fpga = i7i97_7i77();
    plug_7i77(&mut fpga, 0, 1);
    plug_7i72(&mut fpga, 0, 1 + EXPANSION);
    wire_7i97(&mut fpga, &motor);
    wire_7i77(&mut fpga, 0, 1 + ANALOG, 6, |axis| motor(6 + axis));
    fpga
}

/// A 7I92 with a 7I76, a stepper motor on each of its five step generators, and a spindle. `motor`
/// is called with the number of each.
pub fn five_axes_7i92(motor: impl Fn(usize) -> Stepper) -> SimFpga {
    with_7i76(i7i92_7i76(), FIELD_IO, motor, 0)
}

/// A 7I97 with a 7I76 on P1, a stepper motor on each of the card's five step generators, and a
/// spindle. `motor` is called with the number of each.
pub fn five_axes_7i97(motor: impl Fn(usize) -> Stepper) -> SimFpga {
    with_7i76(i7i97_7i76(), FIELD_IO, motor, 6)
}

/// A 5I25 with a 7I77 on P3 and a 7I76 on P2: axes 0 to 5 are motors on the 7I77's analog outputs,
/// 6 to 10 stepper motors on the step generators, and 11 is the 7I76's spindle with encoder 6.
pub fn eleven_axes_5i25(servo: Motor, stepper: Stepper) -> SimFpga {
    let mut fpga = i5i25_7i77_7i76();
    plug_7i77(&mut fpga, 0, FIELD_IO);
    wire_7i77(&mut fpga, 0, ANALOG, 0, |_| servo);
    with_7i76(fpga, 3, |_| stepper, 6)
}

/// Ports with the given numbers of channels, at most four of eight, and a 7I72 on each channel.
pub fn outputs_everywhere(channels: &[u8]) -> SimFpga {
    let mut fpga = SimFpga::new(firmware_serial(channels));
    for (port, &count) in channels.iter().take(4).enumerate() {
        for channel in 0..usize::from(count.min(MAX_CHANNELS)) {
            plug_7i72(&mut fpga, port, channel);
        }
    }
    fpga
}

/// Plugs the two remotes of a 7I77 into a port, from channel `first` on.
pub fn plug_7i77(fpga: &mut SimFpga, port: usize, first: usize) {
    plug(fpga, port, first + FIELD_IO, FieldIo::i7i77());
    plug(fpga, port, first + ANALOG, Analog::i7i77());
}

/// Plugs a 7I72 into a channel of a port.
pub fn plug_7i72(fpga: &mut SimFpga, port: usize, channel: usize) {
    plug(fpga, port, channel, Outputs48::i7i72());
}

/// Wires a motor to each of the six analog outputs of the 7I77 whose analog section is on
/// `channel`, and its encoder to the card's inputs, from encoder `first_encoder` on. `motor` is
/// called with the number of each.
pub fn wire_7i77(
    fpga: &mut SimFpga,
    port: usize,
    channel: usize,
    first_encoder: usize,
    motor: impl Fn(usize) -> Motor,
) {
    for output in 0..6 {
        fpga.wire_axis(AxisWiring {
            source: output_7i77(port, channel, output),
            encoder: first_encoder + usize::from(output),
            motor: motor(usize::from(output)),
        });
    }
}

/// An analog output of the 7I77 whose analog section is on `channel`, as the source of a drive.
pub fn output_7i77(port: usize, channel: usize, output: u8) -> DriveSource {
    DriveSource::Remote {
        port,
        channel,
        output,
        readout: analog_output,
    }
}

/// Plugs a 7I76 into a channel of a port.
pub fn plug_7i76(fpga: &mut SimFpga, port: usize, channel: usize) {
    plug(fpga, port, channel, FieldIo::i7i76());
}

/// Wires a stepper motor without an encoder to each of the five step generators of a 7I76, from
/// generator `first` on. `motor` is called with the number of each.
pub fn wire_7i76(fpga: &mut SimFpga, first: usize, motor: impl Fn(usize) -> Stepper) {
    for number in 0..5 {
        fpga.wire_stepper(StepperWiring {
            generator: first + number,
            encoder: None,
            motor: motor(number),
        });
    }
}

/// The spindle output of the 7I76 on a channel, as the source of a drive: negative while `spindir`
/// is on.
pub fn spindle_7i76(port: usize, channel: usize) -> DriveSource {
    DriveSource::Remote {
        port,
        channel,
        output: 0,
        readout: spindle_output,
    }
}

/// Wires a motor to each of the six analog outputs of a 7I97, and its encoder to the board's
/// inputs. `motor` is called with the number of each.
pub fn wire_7i97(fpga: &mut SimFpga, motor: impl Fn(usize) -> Motor) {
    for unit in 0..6 {
        fpga.wire_axis(AxisWiring {
            source: DriveSource::Pwm { unit },
            encoder: unit,
            motor: motor(unit),
        });
    }
}

fn with_cards(mut fpga: SimFpga) -> SimFpga {
    plug_7i77(&mut fpga, 0, 0);
    plug_7i72(&mut fpga, 0, EXPANSION);
    fpga
}

/// Plugs a 7I76 into a channel of port 0 and wires its motors; its own encoder is on the spindle.
fn with_7i76(
    mut fpga: SimFpga,
    channel: usize,
    motor: impl Fn(usize) -> Stepper,
    encoder: usize,
) -> SimFpga {
    plug_7i76(&mut fpga, 0, channel);
    wire_7i76(&mut fpga, 0, motor);
    fpga.wire_axis(AxisWiring {
        source: spindle_7i76(0, channel),
        encoder,
        motor: Motor::default(),
    });
    fpga
}

fn six_axes_7i77(fpga: SimFpga, motor: Motor) -> SimFpga {
    let mut fpga = with_cards(fpga);
    wire_7i77(&mut fpga, 0, ANALOG, 0, |_| motor);
    fpga
}

/// Plugs a built-in remote. Its description is valid, as a test proves, so the error never occurs.
fn plug<A: Application>(
    fpga: &mut SimFpga,
    port: usize,
    channel: usize,
    remote: Result<SimRemote<A>, DescriptionError>,
) {
    if let Ok(remote) = remote {
        let seed = (port * usize::from(MAX_CHANNELS) + channel) as u64;
        let cable = Cable::new(Box::new(remote), seed);
        fpga.plug(port, channel, Some(Box::new(cable)));
    }
}

/// Reads an analog output of a 7I77 and its enable, as a drive sees them.
fn analog_output(end: &dyn RemoteEnd, output: u8) -> DriveSignal {
    let Some(remote) = device::<SimRemote<Device<Analog>>>(end) else {
        return DriveSignal::default();
    };
    let analog = remote.application().world();
    DriveSignal {
        volts: analog.volts(output.into()).unwrap_or(0.0),
        enabled: analog.enable(output.into()).unwrap_or(false),
    }
}

/// Reads the spindle output of a 7I76, as a frequency converter sees it.
fn spindle_output(end: &dyn RemoteEnd, _: u8) -> DriveSignal {
    let remote = device::<SimRemote<Device<FieldIo>>>(end);
    let spindle = remote.and_then(|remote| remote.application().world().spindle());
    spindle.unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_machine_has_all_its_remotes() {
        let motor = Motor::default();
        for fpga in [
            six_axes_7i92(motor),
            six_axes_5i25(motor),
            six_axes_7i97(motor),
        ] {
            assert!(
                fpga.device::<SimRemote<Device<FieldIo>>>(0, FIELD_IO)
                    .is_some()
            );
            assert!(
                fpga.device::<SimRemote<Device<Analog>>>(0, ANALOG)
                    .is_some()
            );
            assert!(
                fpga.device::<SimRemote<Device<Outputs48>>>(0, EXPANSION)
                    .is_some()
            );
            assert_eq!(fpga.axes(), 6);
        }
        let fpga = outputs_everywhere(&[8, 8, 8, 8]);
        assert_eq!(fpga.serial_ports(), 4);
        for port in 0..4 {
            assert!((0..8).all(|channel| fpga.remote(port, channel).is_some()));
        }
    }
}

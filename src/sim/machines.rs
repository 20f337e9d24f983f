//! Ready-made machines: boards with their firmware, and with remotes and motors on them.
//!
//! What they are like, and `mesa sim` and `--sim` with them, unless something else is asked for:
//!
//! | of | constant | from |
//! |---|---|---|
//! | each of six motors | 100 units/s at 10 V, velocity loop of 5 ms, 1000 counts a unit, an index every 4000 counts, at 0; no friction, no hard stops, as much force as it takes | [`MotorConfig::default`](crate::sim::MotorConfig::default) |
//! | field power of a remote | 24 V; its inputs at 0 V | manual: 7I77 |
//! | an FPGA's clocks | ClockLow 100 MHz (5I25: 33.33 MHz), ClockHigh 200 MHz | FACTS 9.3 |
//! | multiplexed encoders | sampled at ClockLow/8 (7I77) or ClockLow/16 (7I97) | the manuals |
//! | a register access, embedded | 600 ns | [`DEFAULT_ACCESS_COST`](crate::sim::DEFAULT_ACCESS_COST) |
//! | a packet, on an Ethernet board | 15 us, and 80 ns for each element of a command; not confirmed | [`BoardConfig`](crate::sim::BoardConfig) |
//! | a board after a reset, a reload | silent for 200 ms, 300 ms | [`BoardConfig`](crate::sim::BoardConfig) |
//! | a late packet, on request | 0.5 to 3 ms | [`Mishaps`](crate::sim::Mishaps) |

use crate::sim::devices::{Analog, DescriptionError, Device, FieldIo, Outputs48};
use crate::sim::fpga::{
    AxisWiring, DriveSignal, DriveSource, Firmware, ModuleDescriptor, OUTPUT_PIN, PinDescriptor,
    SimFpga, device, gtag,
};
use crate::sim::remote::{Application, Cable, Remote};
use crate::sim::sslbp::MINOR_REVISION;
use crate::sim::wire::RemoteEnd;
use crate::sim::world::Motor;

/// Channel of a 7I77's field I/O, counted from the card's first channel. FACTS 8.1.
pub const FIELD_IO: usize = 0;
/// Channel of a 7I77's analog section, counted from the card's first channel.
pub const ANALOG: usize = 1;
/// Channel of a 7I77's RS-422 terminals, counted from the card's first channel.
pub const EXPANSION: usize = 2;

/// The most channels of one smart serial port.
const MAX_CHANNELS: u8 = 8;

/// TX of channel 0 in a secondary pin; RX is without [`OUTPUT_PIN`].
const TX: u8 = OUTPUT_PIN | 0x01;
const RX: u8 = 0x01;
/// TXEN of channel 0 in a secondary pin.
const TXEN: u8 = OUTPUT_PIN | 0x11;

const fn module(
    (gtag, version, clock, instances): (u8, u8, u8, u8),
    (base, registers, strides, multiple): (u16, u8, u8, u32),
) -> ModuleDescriptor {
    ModuleDescriptor::new(
        gtag, version, clock, instances, base, registers, strides, multiple,
    )
}

const fn watchdog() -> ModuleDescriptor {
    module((gtag::WATCHDOG, 0, 1, 1), (0x0C00, 3, 0x00, 0))
}

const fn io_ports(ports: u8) -> ModuleDescriptor {
    module((gtag::IO_PORT, 0, 1, ports), (0x1000, 5, 0x00, 0x1F))
}

const fn muxed_encoders(count: u8) -> ModuleDescriptor {
    module((gtag::MUXED_ENCODER, 4, 1, count), (0x3600, 5, 0x00, 0x03))
}

const fn mux_select() -> ModuleDescriptor {
    module((gtag::MUX_SELECT, 0, 1, 1), (0, 0, 0x00, 0))
}

const fn smart_serial(ports: u8) -> ModuleDescriptor {
    module((gtag::SSERIAL, 0, 1, ports), (0x5B00, 6, 0x10, 0x3C))
}

const fn dpll() -> ModuleDescriptor {
    module((gtag::DPLL, 0, 1, 1), (0x7000, 7, 0x00, 0))
}

const fn pwm(count: u8) -> ModuleDescriptor {
    module((gtag::PWM, 0, 2, count), (0x4100, 5, 0x00, 0x03))
}

const fn led() -> ModuleDescriptor {
    module((gtag::LED, 0, 1, 1), (0x0200, 1, 0x00, 0))
}

/// The firmware of a 7I92 with a 7I77 on its first connector; the second is general-purpose I/O.
/// It has a DPLL, and a PWM descriptor without instances, as firmware in use has. FACTS 8.1, 9.3.
pub fn firmware_7i92_7i77() -> Firmware {
    let mut firmware = two_connectors(*b"MESA7I92", 100_000_000, 1);
    firmware.modules.insert(0, dpll());
    let led = firmware.modules.len() - 1;
    firmware.modules.insert(led, pwm(0));
    firmware
}

/// The firmware of a 7I92 with a 7I77 on each of its connectors: six serial channels.
pub fn firmware_7i92_7i77x2() -> Firmware {
    two_connectors(*b"MESA7I92", 100_000_000, 2)
}

/// The firmware of a 5I25 (PCI, ClockLow 33.33 MHz) with a 7I77 on its first connector.
pub fn firmware_5i25_7i77() -> Firmware {
    two_connectors(*b"MESA5I25", 33_333_333, 1)
}

/// The firmware of a 7I97. FACTS 9.2.
///
/// Its serial port has one channel, on TB4. With more `channels` (up to 8) the port is extended
/// over pins of P1, two for each channel.
pub fn firmware_7i97(channels: u8) -> Firmware {
    let mut pins = Vec::with_capacity(51);
    for unit in 0..4 {
        pins.push(PinDescriptor::new(gtag::PWM, unit, 0x81));
    }
    for unit in 4..6 {
        pins.push(PinDescriptor::new(gtag::PWM, unit, 0x81));
        pins.push(PinDescriptor::new(gtag::PWM, unit, 0x83));
    }
    // ENA0 to ENA3 are switched in common, by the enable of output 0.
    pins.push(PinDescriptor::new(gtag::PWM, 0, 0x83));
    for unit in 0..3 {
        pins.extend(encoder_pins(unit));
    }
    pins.push(PinDescriptor::new(gtag::MUX_SELECT, 0, 0x81));
    for output in 0..6 {
        pins.push(PinDescriptor::new(gtag::SSR, 0, 0x81 + output));
    }
    pins.push(PinDescriptor::new(gtag::SSR, 0, 0xA0));
    for address in 0..4 {
        pins.push(PinDescriptor::new(gtag::IN_MUX, 0, 0x81 + address));
    }
    pins.push(PinDescriptor::new(gtag::IN_MUX, 0, 0x01));
    for pin in [RX, TX, TXEN] {
        pins.push(PinDescriptor::new(gtag::SSERIAL, 0, pin));
    }
    for channel in 1..channels.min(MAX_CHANNELS) {
        pins.push(PinDescriptor::new(gtag::SSERIAL, 0, RX + channel));
        pins.push(PinDescriptor::new(gtag::SSERIAL, 0, TX + channel));
    }
    pins.resize(51, PinDescriptor::gpio());
    Firmware {
        idrom_type: 3,
        board: *b"MESA7I97",
        fpga_size: 9,
        fpga_pins: 144,
        ports: 3,
        port_width: 17,
        clock_low: 100_000_000,
        clock_high: 200_000_000,
        // Manual: 7I97, "MAXIMUM ENCODER COUNT RATE": ClockLow/16.
        mux_rate: 14,
        starts_bitten: false,
        sslbp_minor: MINOR_REVISION,
        modules: vec![
            dpll(),
            watchdog(),
            io_ports(3),
            muxed_encoders(6),
            mux_select(),
            smart_serial(1),
            pwm(6),
            module((gtag::SSR, 0, 1, 1), (0x7D00, 2, 0x00, 0x03)),
            module((gtag::IN_MUX, 0, 1, 1), (0x8000, 5, 0x00, 0x1F)),
            led(),
        ],
        behind_end: vec![
            (
                30,
                module((gtag::CP_DRIVE, 0, 1, 1), (0x1E00, 1, 0x00, 0x01)),
            ),
            (
                31,
                module((gtag::IN_MUX_WIDTH, 0, 0, 0), (0, 0, 0x00, 0x10)),
            ),
        ],
        pins,
        local_pins: vec![
            PinDescriptor::local(gtag::CP_DRIVE, 0, 0x82),
            PinDescriptor::local(gtag::CP_DRIVE, 0, 0x81),
        ],
    }
}

/// The firmware of a 7I97T: a 7I97 with a larger FPGA of another maker, ClockHigh 160 MHz, and PWM
/// generators that can dither (version 1). In the IDROM it is a 7I97 by name.
///
/// Its identification follows what such a board printed; FACTS 9.6.
pub fn firmware_7i97t(channels: u8) -> Firmware {
    let mut firmware = firmware_7i97(channels);
    firmware.fpga_size = 20;
    firmware.fpga_pins = 256;
    firmware.clock_high = 160_000_000;
    if let Some(pwm) = firmware.module_mut(gtag::PWM) {
        pwm.version = 1;
    }
    firmware
}

/// The firmware of a 7I97 with a 7I77 on P1: twelve encoders, and the card's three channels behind
/// the board's own. No such firmware is public; that of a 7I97 with a 7I74 keeps channel 0 on TB4 as
/// well, and that of a 7I92 numbers the encoders and select lines of a second 7I77 so.
pub fn firmware_7i97_7i77() -> Firmware {
    let mut firmware = firmware_7i97(1);
    if let Some(encoders) = firmware.module_mut(gtag::MUXED_ENCODER) {
        *encoders = muxed_encoders(12);
    }
    let connector = firmware.pins.iter_mut().skip(34);
    for (pin, card) in connector.zip(card_7i77(1, 1)) {
        *pin = card;
    }
    firmware
}

/// The firmware of a 7I97 with InM instead of InMux, and OutM instead of SSR.
///
/// Without multiplexing the 16 inputs have a pin each, on a fourth port behind the expansion pins;
/// the pins of multiplexer and SSR reference are free. All else is as in [`firmware_7i97`]. Which
/// pins a real firmware takes is not known.
pub fn firmware_7i97_inm_outm(channels: u8) -> Firmware {
    let mut firmware = firmware_7i97(channels);
    firmware.ports = 4;
    if let Some(ports) = firmware.module_mut(gtag::IO_PORT) {
        *ports = io_ports(4);
    }
    // Without InMux there is no width of it.
    firmware
        .behind_end
        .retain(|(_, module)| module.gtag != gtag::IN_MUX_WIDTH);
    if let Some(inputs) = firmware.module_mut(gtag::IN_MUX) {
        *inputs = module((gtag::IN_M, 0, 1, 1), (0x8500, 5, 0x00, 0));
    }
    if let Some(outputs) = firmware.module_mut(gtag::SSR) {
        *outputs = module((gtag::OUT_M, 0, 1, 1), (0xB000, 1, 0x00, 0));
    }
    for pin in &mut firmware.pins {
        match (pin.secondary, pin.pin) {
            (gtag::SSR, 0xA0) | (gtag::IN_MUX, _) => *pin = PinDescriptor::gpio(),
            (gtag::SSR, output) => *pin = PinDescriptor::new(gtag::OUT_M, 0, output),
            _ => {}
        }
    }
    for input in 0..16 {
        firmware
            .pins
            .push(PinDescriptor::new(gtag::IN_M, 0, 0x01 + input));
    }
    firmware.pins.push(PinDescriptor::gpio());
    firmware
}

/// A firmware that has smart serial ports only, at most four, with the given numbers of channels.
pub fn firmware_serial(channels: &[u8]) -> Firmware {
    let mut pins = Vec::with_capacity(72);
    for (unit, &count) in channels.iter().take(4).enumerate() {
        for channel in 0..count.min(MAX_CHANNELS) {
            pins.push(PinDescriptor::new(gtag::SSERIAL, unit as u8, RX + channel));
            pins.push(PinDescriptor::new(gtag::SSERIAL, unit as u8, TX + channel));
        }
    }
    pins.resize(72, PinDescriptor::gpio());
    let mut firmware = two_connectors(*b"MESA7I80", 100_000_000, 0);
    firmware.ports = 3;
    firmware.port_width = 24;
    firmware.pins = pins;
    firmware.modules = vec![
        watchdog(),
        io_ports(3),
        smart_serial(channels.len().clamp(1, 4) as u8),
        led(),
    ];
    firmware
}

/// An older firmware of a 7I80DB, with the addresses and versions that Mesa's firmware had until
/// about 2016: a 7I77 on the first of its four connectors, and two PWM generators on the second
/// (output, direction and enable of each). Which pins a real firmware gives to PWM is not known.
pub fn firmware_7i80_of_2016() -> Firmware {
    let mut firmware = two_connectors(*b"MESA7I80", 100_000_000, 1);
    firmware.fpga_size = 16;
    firmware.fpga_pins = 256;
    firmware.ports = 4;
    for (pin, (unit, signal)) in firmware.pins.iter_mut().skip(17).zip([
        (0, 0x81),
        (0, 0x82),
        (0, 0x83),
        (1, 0x81),
        (1, 0x82),
        (1, 0x83),
    ]) {
        *pin = PinDescriptor::new(gtag::PWM, unit, signal);
    }
    firmware.pins.resize(4 * 17, PinDescriptor::gpio());
    firmware.modules = vec![
        watchdog(),
        io_ports(4),
        module((gtag::MUXED_ENCODER, 3, 1, 6), (0x3500, 5, 0x00, 0x03)),
        mux_select(),
        module((gtag::SSERIAL, 0, 1, 1), (0x5A00, 6, 0x10, 0x3C)),
        module((gtag::PWM, 0, 2, 2), (0x4000, 5, 0x00, 0x03)),
        led(),
    ];
    firmware
}

/// The same firmware with the newer smart serial module: seven interface registers, GTAG 0xC6.
/// FACTS 2.1.
#[must_use]
pub fn with_seven_interface_registers(mut firmware: Firmware) -> Firmware {
    if let Some(module) = firmware.module_mut(gtag::SSERIAL) {
        module.gtag = gtag::SSERIAL_B;
        module.registers = 10;
        module.multiple = 0x3FC;
    }
    for pin in &mut firmware.pins {
        if pin.secondary == gtag::SSERIAL {
            pin.secondary = gtag::SSERIAL_B;
        }
    }
    firmware
}

/// A board with two connectors of 17 pins, the first `cards` of which carry a 7I77.
fn two_connectors(board: [u8; 8], clock_low: u32, cards: u8) -> Firmware {
    let mut pins = Vec::with_capacity(34);
    for card in 0..cards {
        pins.extend(card_7i77(card, 3 * card));
    }
    pins.resize(34, PinDescriptor::gpio());
    Firmware {
        idrom_type: 3,
        board,
        fpga_size: 9,
        fpga_pins: 144,
        ports: 2,
        port_width: 17,
        clock_low,
        clock_high: 200_000_000,
        // Manual: 7I77, "MAXIMUM ENCODER COUNT RATE": ClockLow/8.
        mux_rate: 6,
        starts_bitten: false,
        sslbp_minor: MINOR_REVISION,
        modules: vec![
            watchdog(),
            io_ports(2),
            muxed_encoders(6 * cards),
            mux_select(),
            smart_serial(1),
            led(),
        ],
        behind_end: Vec::new(),
        pins,
        local_pins: Vec::new(),
    }
}

/// The seventeen pins of a 7I77 whose encoders are the `card`th six of the firmware, and whose serial
/// channels begin at `first`. FACTS 8.1; manual: 7I77, "P1 HOST INTERFACE CONNECTOR".
fn card_7i77(card: u8, first: u8) -> Vec<PinDescriptor> {
    let serial = |pin: u8, channel: u8| PinDescriptor::new(gtag::SSERIAL, 0, pin + first + channel);
    let mut pins = vec![
        serial(TXEN, 2),
        serial(TX, 2),
        serial(RX, 2),
        serial(TX, 1),
        serial(RX, 1),
        serial(TX, 0),
        serial(RX, 0),
        // The same signal on both cards, but another unit: FACTS 12.7.
        PinDescriptor::new(gtag::MUX_SELECT, 6 * card, 0x81),
    ];
    for pair in 0..3 {
        pins.extend(encoder_pins(3 * card + pair));
    }
    pins
}

/// A, B and index of a pair of multiplexed encoders.
fn encoder_pins(pair: u8) -> [PinDescriptor; 3] {
    [1, 2, 3].map(|pin| PinDescriptor::new(gtag::MUXED_ENCODER, pair, pin))
}

/// A 7I92 made for a 7I77, with nothing plugged in.
pub fn i7i92_7i77() -> SimFpga {
    SimFpga::new(firmware_7i92_7i77())
}

/// A 5I25 made for a 7I77, with nothing plugged in.
pub fn i5i25_7i77() -> SimFpga {
    SimFpga::new(firmware_5i25_7i77())
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

/// A 7I97 made for a 7I77 on P1, with nothing plugged in.
pub fn i7i97_7i77() -> SimFpga {
    SimFpga::new(firmware_7i97_7i77())
}

/// A 7I97 with InM and OutM: see [`firmware_7i97_inm_outm`].
pub fn i7i97_inm_outm(channels: u8) -> SimFpga {
    SimFpga::new(firmware_7i97_inm_outm(channels))
}

/// A 7I92 with a 7I77 and a 7I72 on the 7I77's expansion port, each remote behind a
/// [`Cable`].
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

/// A 7I97 with a 7I77 on P1, a 7I72 on the 7I77's expansion port (channel 3), and twelve motors: 0 to
/// 5 on the board, 6 to 11 on the card. `motor` gets the number.
pub fn twelve_axes_7i97(motor: impl Fn(usize) -> Motor) -> SimFpga {
    let mut fpga = i7i97_7i77();
    plug_7i77(&mut fpga, 0, 1);
    plug_7i72(&mut fpga, 0, 1 + EXPANSION);
    wire_7i97(&mut fpga, &motor);
    wire_7i77(&mut fpga, 0, 1 + ANALOG, 6, |axis| motor(6 + axis));
    fpga
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

/// Puts a motor on each of the six analog outputs of the 7I77 whose analog section is on `channel`,
/// and its encoder on the card's inputs, from encoder `first_encoder` on. `motor` gets its number.
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

/// An analog output of the 7I77 whose analog section is on `channel`, as what drives an axis.
pub fn output_7i77(port: usize, channel: usize, output: u8) -> DriveSource {
    DriveSource::Remote {
        port,
        channel,
        output,
        readout: analog_output,
    }
}

/// Puts a motor on each of the six analog outputs of a 7I97, and its encoder on the board's inputs.
/// `motor` gets its number.
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

fn six_axes_7i77(fpga: SimFpga, motor: Motor) -> SimFpga {
    let mut fpga = with_cards(fpga);
    wire_7i77(&mut fpga, 0, ANALOG, 0, |_| motor);
    fpga
}

/// The built-in descriptions are sound, which a test holds; so nothing is ever left out.
fn plug<A: Application>(
    fpga: &mut SimFpga,
    port: usize,
    channel: usize,
    remote: Result<Remote<A>, DescriptionError>,
) {
    if let Ok(remote) = remote {
        let seed = (port * usize::from(MAX_CHANNELS) + channel) as u64;
        let cable = Cable::new(Box::new(remote), seed);
        fpga.plug(port, channel, Some(Box::new(cable)));
    }
}

/// How a drive sees an analog output of a 7I77 and its enable.
fn analog_output(end: &dyn RemoteEnd, output: u8) -> DriveSignal {
    let Some(remote) = device::<Remote<Device<Analog>>>(end) else {
        return DriveSignal::default();
    };
    let analog = remote.application().world();
    DriveSignal {
        volts: analog.volts(output.into()).unwrap_or(0.0),
        enabled: analog.enable(output.into()).unwrap_or(false),
    }
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
                fpga.device::<Remote<Device<FieldIo>>>(0, FIELD_IO)
                    .is_some()
            );
            assert!(fpga.device::<Remote<Device<Analog>>>(0, ANALOG).is_some());
            assert!(
                fpga.device::<Remote<Device<Outputs48>>>(0, EXPANSION)
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

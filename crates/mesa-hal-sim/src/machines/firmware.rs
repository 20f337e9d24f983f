//! The firmware of the machines.

mod i5i25;

pub use i5i25::*;

use super::MAX_CHANNELS;
use crate::fpga::{OUTPUT_PIN, SimFirmware, SimModuleDescriptor, SimPinDescriptor, gtag};
use crate::sslbp::MINOR_REVISION;

/// TX of channel 0 in a secondary pin; RX is without [`OUTPUT_PIN`].
const TX: u8 = OUTPUT_PIN | 0x01;
const RX: u8 = 0x01;
/// TXEN of channel 0 in a secondary pin.
const TXEN: u8 = OUTPUT_PIN | 0x11;

fn watchdog() -> SimModuleDescriptor {
    SimModuleDescriptor {
        gtag: gtag::WATCHDOG,
        base: 0x0C00,
        registers: 3,
        ..SimModuleDescriptor::default()
    }
}

fn io_ports(ports: u8) -> SimModuleDescriptor {
    SimModuleDescriptor {
        gtag: gtag::IO_PORT,
        instances: ports,
        base: 0x1000,
        registers: 5,
        multiple: 0x1F,
        ..SimModuleDescriptor::default()
    }
}

fn muxed_encoders(count: u8) -> SimModuleDescriptor {
    SimModuleDescriptor {
        gtag: gtag::MUXED_ENCODER,
        version: 4,
        instances: count,
        base: 0x3600,
        registers: 5,
        multiple: 0x03,
        ..SimModuleDescriptor::default()
    }
}

fn encoders(count: u8) -> SimModuleDescriptor {
    SimModuleDescriptor {
        gtag: gtag::ENCODER,
        version: 2,
        instances: count,
        base: 0x3000,
        registers: 5,
        multiple: 0x03,
        ..SimModuleDescriptor::default()
    }
}

/// Step generators. FACTS 14.1.
fn step_generators(count: u8, version: u8) -> SimModuleDescriptor {
    SimModuleDescriptor {
        gtag: gtag::STEPGEN,
        version,
        instances: count,
        base: 0x2000,
        registers: 10,
        multiple: 0x1FF,
        ..SimModuleDescriptor::default()
    }
}

fn mux_select() -> SimModuleDescriptor {
    SimModuleDescriptor {
        gtag: gtag::MUX_SELECT,
        ..SimModuleDescriptor::default()
    }
}

fn smart_serial(ports: u8) -> SimModuleDescriptor {
    SimModuleDescriptor {
        gtag: gtag::SSERIAL,
        instances: ports,
        base: 0x5B00,
        registers: 6,
        strides: 0x10,
        multiple: 0x3C,
        ..SimModuleDescriptor::default()
    }
}

fn dpll() -> SimModuleDescriptor {
    SimModuleDescriptor {
        gtag: gtag::DPLL,
        base: 0x7000,
        registers: 7,
        ..SimModuleDescriptor::default()
    }
}

fn pwm(count: u8) -> SimModuleDescriptor {
    SimModuleDescriptor {
        gtag: gtag::PWM,
        clock: 2,
        instances: count,
        base: 0x4100,
        registers: 5,
        multiple: 0x03,
        ..SimModuleDescriptor::default()
    }
}

fn ssr() -> SimModuleDescriptor {
    SimModuleDescriptor {
        gtag: gtag::SSR,
        base: 0x7D00,
        registers: 2,
        multiple: 0x03,
        ..SimModuleDescriptor::default()
    }
}

fn in_mux() -> SimModuleDescriptor {
    SimModuleDescriptor {
        gtag: gtag::IN_MUX,
        base: 0x8000,
        registers: 5,
        multiple: 0x1F,
        ..SimModuleDescriptor::default()
    }
}

fn cp_drive() -> SimModuleDescriptor {
    SimModuleDescriptor {
        gtag: gtag::CP_DRIVE,
        base: 0x1E00,
        registers: 1,
        multiple: 0x01,
        ..SimModuleDescriptor::default()
    }
}

/// The entry with the number of inputs of InMux, which is no module.
fn in_mux_width(inputs: u32) -> SimModuleDescriptor {
    SimModuleDescriptor {
        gtag: gtag::IN_MUX_WIDTH,
        clock: 0,
        instances: 0,
        multiple: inputs,
        ..SimModuleDescriptor::default()
    }
}

fn led() -> SimModuleDescriptor {
    SimModuleDescriptor {
        gtag: gtag::LED,
        base: 0x0200,
        registers: 1,
        ..SimModuleDescriptor::default()
    }
}

/// The firmware of a 7I92 with a 7I77 on its first connector; the second is general-purpose I/O. It
/// has a DPLL, and a PWM descriptor without instances, like firmware in use. FACTS 8.1, 9.3.
pub fn firmware_7i92_7i77() -> SimFirmware {
    let mut firmware = two_connectors(*b"MESA7I92", 100_000_000, 1);
    firmware.modules.insert(0, dpll());
    let led = firmware.modules.len() - 1;
    firmware.modules.insert(led, pwm(0));
    firmware
}

/// The firmware of a 7I92 with a 7I77 on each of its connectors: six serial channels.
pub fn firmware_7i92_7i77x2() -> SimFirmware {
    two_connectors(*b"MESA7I92", 100_000_000, 2)
}

/// The firmware of a 7I92 with a 7I76 on its first connector; the second is general-purpose I/O:
/// five step generators that can swap their outputs, an encoder, and two serial channels.
///
/// Modules and pins are those of Mesa's public pin file PIN_7I76x1D_34, in which the step
/// generators have version 2: the gateware of that time can swap, too (FACTS 14.2).
pub fn firmware_7i92_7i76() -> SimFirmware {
    let mut firmware = two_connectors(*b"MESA7I92", 100_000_000, 0);
    firmware.modules = vec![
        dpll(),
        watchdog(),
        io_ports(2),
        encoders(1),
        smart_serial(1),
        step_generators(5, 0x42),
        led(),
    ];
    for (pin, card) in firmware.pins.iter_mut().zip(card_7i76(0)) {
        *pin = card;
    }
    let first_encoder = 14;
    for (pin, signal) in firmware.pins.iter_mut().skip(first_encoder).zip([3, 2, 1]) {
        *pin = SimPinDescriptor::new(gtag::ENCODER, 0, signal);
    }
    firmware
}

/// The firmware of a 7I97. FACTS 9.2.
///
/// Its serial port has one channel, on TB4. With more `channels` (up to 8) the port is extended
/// over pins of P1, two for each channel.
pub fn firmware_7i97(channels: u8) -> SimFirmware {
    SimFirmware {
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
            ssr(),
            in_mux(),
            led(),
        ],
        behind_end: vec![(30, cp_drive()), (31, in_mux_width(16))],
        pins: pins_7i97(channels),
        local_pins: vec![
            SimPinDescriptor::local(gtag::CP_DRIVE, 0, 0x82),
            SimPinDescriptor::local(gtag::CP_DRIVE, 0, 0x81),
        ],
    }
}

fn pins_7i97(channels: u8) -> Vec<SimPinDescriptor> {
    let mut pins = Vec::with_capacity(51);
    for unit in 0..4 {
        pins.push(SimPinDescriptor::new(gtag::PWM, unit, 0x81));
    }
    for unit in 4..6 {
        pins.push(SimPinDescriptor::new(gtag::PWM, unit, 0x81));
        pins.push(SimPinDescriptor::new(gtag::PWM, unit, 0x83));
    }
    // ENA0 to ENA3 have a common switch, the enable of output 0.
    pins.push(SimPinDescriptor::new(gtag::PWM, 0, 0x83));
    for unit in 0..3 {
        pins.extend(encoder_pins(unit));
    }
    pins.push(SimPinDescriptor::new(gtag::MUX_SELECT, 0, 0x81));
    for output in 0..6 {
        pins.push(SimPinDescriptor::new(gtag::SSR, 0, 0x81 + output));
    }
    pins.push(SimPinDescriptor::new(gtag::SSR, 0, 0xA0));
    for address in 0..4 {
        pins.push(SimPinDescriptor::new(gtag::IN_MUX, 0, 0x81 + address));
    }
    pins.push(SimPinDescriptor::new(gtag::IN_MUX, 0, 0x01));
    for pin in [RX, TX, TXEN] {
        pins.push(SimPinDescriptor::new(gtag::SSERIAL, 0, pin));
    }
    for channel in 1..channels.min(MAX_CHANNELS) {
        pins.push(SimPinDescriptor::new(gtag::SSERIAL, 0, RX + channel));
        pins.push(SimPinDescriptor::new(gtag::SSERIAL, 0, TX + channel));
    }
    pins.resize(51, SimPinDescriptor::gpio());
    pins
}

/// The firmware of a 7I97T: a 7I97 with a larger FPGA of another maker, ClockHigh 160 MHz, and PWM
/// generators that can dither (version 1). The name in its IDROM is that of a 7I97.
///
/// Its identification follows the output of such a board; FACTS 9.6.
pub fn firmware_7i97t(channels: u8) -> SimFirmware {
    let mut firmware = firmware_7i97(channels);
    firmware.fpga_size = 20;
    firmware.fpga_pins = 256;
    firmware.clock_high = 160_000_000;
    if let Some(pwm) = firmware.module_mut(gtag::PWM) {
        pwm.version = 1;
    }
    firmware
}

/// The firmware of a 7I97 with a 7I77 on P1: twelve encoders, and the card's three channels after
/// the board's own. No such firmware is public. Firmware of a 7I97 with a 7I74 keeps channel 0 on
/// TB4 as well, and firmware of a 7I92 numbers the encoders and select lines of a second 7I77 in
/// this way.
pub fn firmware_7i97_7i77() -> SimFirmware {
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

/// The firmware of a 7I97 with a 7I76 on P1: five step generators, eight encoders, and the card's
/// two serial channels. TB4 has none.
///
/// Modules and pins are those of Mesa's public pin file PIN_7I97_7I76D_51.
pub fn firmware_7i97_7i76() -> SimFirmware {
    let mut firmware = firmware_7i97(1);
    if let Some(encoders) = firmware.module_mut(gtag::MUXED_ENCODER) {
        *encoders = muxed_encoders(8);
    }
    let pwm = firmware.modules.iter();
    let pwm = pwm.take_while(|module| module.gtag != gtag::PWM).count();
    firmware.modules.insert(pwm, step_generators(5, 2));
    for pin in &mut firmware.pins {
        if pin.secondary == gtag::SSERIAL {
            *pin = SimPinDescriptor::gpio();
        }
    }
    let connector = firmware.pins.iter_mut().skip(34);
    let card = card_7i76(0).into_iter().chain(encoder_pins(3));
    for (pin, card) in connector.zip(card) {
        *pin = card;
    }
    firmware
}

/// The firmware of a 7I97 with InM instead of InMux, and OutM instead of SSR.
///
/// Without multiplexing the 16 inputs have a pin each, on a fourth port after the expansion pins;
/// the pins of multiplexer and SSR reference are free. Everything else is as in [`firmware_7i97`].
/// The pins of a real firmware are unknown.
pub fn firmware_7i97_inm_outm(channels: u8) -> SimFirmware {
    let mut firmware = firmware_7i97(channels);
    firmware.ports = 4;
    if let Some(ports) = firmware.module_mut(gtag::IO_PORT) {
        *ports = io_ports(4);
    }
    // The descriptor of InMux's width does not exist without InMux.
    firmware
        .behind_end
        .retain(|(_, module)| module.gtag != gtag::IN_MUX_WIDTH);
    if let Some(inputs) = firmware.module_mut(gtag::IN_MUX) {
        *inputs = SimModuleDescriptor {
            gtag: gtag::IN_M,
            base: 0x8500,
            registers: 5,
            ..SimModuleDescriptor::default()
        };
    }
    if let Some(outputs) = firmware.module_mut(gtag::SSR) {
        *outputs = SimModuleDescriptor {
            gtag: gtag::OUT_M,
            base: 0xB000,
            registers: 1,
            ..SimModuleDescriptor::default()
        };
    }
    for pin in &mut firmware.pins {
        match (pin.secondary, pin.pin) {
            (gtag::SSR, 0xA0) | (gtag::IN_MUX, _) => *pin = SimPinDescriptor::gpio(),
            (gtag::SSR, output) => *pin = SimPinDescriptor::new(gtag::OUT_M, 0, output),
            _ => {}
        }
    }
    for input in 0..16 {
        firmware
            .pins
            .push(SimPinDescriptor::new(gtag::IN_M, 0, 0x01 + input));
    }
    firmware.pins.push(SimPinDescriptor::gpio());
    firmware
}

/// A firmware with only smart serial ports, at most four, with the given numbers of channels.
pub fn firmware_serial(channels: &[u8]) -> SimFirmware {
    let mut pins = Vec::with_capacity(72);
    for (unit, &count) in channels.iter().take(4).enumerate() {
        for channel in 0..count.min(MAX_CHANNELS) {
            pins.push(SimPinDescriptor::new(
                gtag::SSERIAL,
                unit as u8,
                RX + channel,
            ));
            pins.push(SimPinDescriptor::new(
                gtag::SSERIAL,
                unit as u8,
                TX + channel,
            ));
        }
    }
    pins.resize(72, SimPinDescriptor::gpio());
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

/// An older firmware of a 7I80DB, with the addresses and versions of Mesa's firmware until about
/// 2016: a 7I77 on the first of its four connectors, and two PWM generators on the second (output,
/// direction and enable of each). The PWM pins of a real firmware are unknown.
pub fn firmware_7i80_of_2016() -> SimFirmware {
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
        *pin = SimPinDescriptor::new(gtag::PWM, unit, signal);
    }
    firmware.pins.resize(4 * 17, SimPinDescriptor::gpio());
    firmware.modules = vec![
        watchdog(),
        io_ports(4),
        SimModuleDescriptor {
            gtag: gtag::MUXED_ENCODER,
            version: 3,
            instances: 6,
            base: 0x3500,
            registers: 5,
            multiple: 0x03,
            ..SimModuleDescriptor::default()
        },
        mux_select(),
        SimModuleDescriptor {
            gtag: gtag::SSERIAL,
            base: 0x5A00,
            registers: 6,
            strides: 0x10,
            multiple: 0x3C,
            ..SimModuleDescriptor::default()
        },
        SimModuleDescriptor {
            gtag: gtag::PWM,
            clock: 2,
            instances: 2,
            base: 0x4000,
            registers: 5,
            multiple: 0x03,
            ..SimModuleDescriptor::default()
        },
        led(),
    ];
    firmware
}

/// The same firmware with the newer smart serial module: seven interface registers, GTAG 0xC6.
/// FACTS 2.1.
#[must_use]
pub fn with_seven_interface_registers(mut firmware: SimFirmware) -> SimFirmware {
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

/// A board with two connectors of 17 pins; a 7I77 is on the first `cards` of them.
fn two_connectors(board: [u8; 8], clock_low: u32, cards: u8) -> SimFirmware {
    let mut pins = Vec::with_capacity(34);
    for card in 0..cards {
        pins.extend(card_7i77(card, 3 * card));
    }
    pins.resize(34, SimPinDescriptor::gpio());
    SimFirmware {
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

/// The seventeen pins of a 7I77 with the `card`th six encoders of the firmware, and serial channels
/// from `first` on. FACTS 8.1; manual: 7I77, "P1 HOST INTERFACE CONNECTOR".
fn card_7i77(card: u8, first: u8) -> Vec<SimPinDescriptor> {
    let serial =
        |pin: u8, channel: u8| SimPinDescriptor::new(gtag::SSERIAL, 0, pin + first + channel);
    let mut pins = vec![
        serial(TXEN, 2),
        serial(TX, 2),
        serial(RX, 2),
        serial(TX, 1),
        serial(RX, 1),
        serial(TX, 0),
        serial(RX, 0),
        // The same signal on both cards, but with another unit: FACTS 12.7.
        SimPinDescriptor::new(gtag::MUX_SELECT, 6 * card, 0x81),
    ];
    for pair in 0..3 {
        pins.extend(encoder_pins(3 * card + pair));
    }
    pins
}

/// The first fourteen pins of a 7I76: five step generators, direction before step, and two serial
/// channels from `first` on. FACTS 14.3.
fn card_7i76(first: u8) -> Vec<SimPinDescriptor> {
    let outputs = (0..5).flat_map(|unit| [(unit, 0x82), (unit, 0x81)]);
    let mut pins: Vec<_> = outputs
        .map(|(unit, pin)| SimPinDescriptor::new(gtag::STEPGEN, unit, pin))
        .collect();
    for channel in first..first + 2 {
        pins.push(SimPinDescriptor::new(gtag::SSERIAL, 0, TX + channel));
        pins.push(SimPinDescriptor::new(gtag::SSERIAL, 0, RX + channel));
    }
    pins
}

/// A, B and index of a pair of multiplexed encoders.
fn encoder_pins(pair: u8) -> [SimPinDescriptor; 3] {
    [1, 2, 3].map(|pin| SimPinDescriptor::new(gtag::MUXED_ENCODER, pair, pin))
}

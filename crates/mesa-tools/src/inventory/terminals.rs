//! Terminals of the FPGA's I/O pins.

use mesa_hal::boards::BoardTable;
use mesa_hal::hal::{Place, Terminals};
use mesa_hal::hostmot2::{Gtag, HostMot2, ModuleInstance, PinDescriptor};

/// Terminals of I/O pin `number`: those of the board itself, or port and pin of the gateware for a
/// board whose connectors are not known; and those of a card on it. Empty for a pin without a
/// direct way to a terminal.
pub fn of(firmware: &HostMot2, number: usize, pin: PinDescriptor) -> String {
    let board = BoardTable::for_firmware(firmware, &[]);
    let card = of_card(board, firmware, pin);
    if !board.terminals.is_empty() {
        let number = u16::try_from(number).unwrap_or(u16::MAX);
        let ports = ModuleInstance::new(Gtag::IO_PORT, 0);
        let expansion = board.place(firmware, ports, number);
        if expansion != Place::default() {
            return list(&[expansion, card]);
        }
        return list(&of_module(board, firmware, pin));
    }
    // Ports of the gateware: which connector or terminal a port is at depends on the board.
    let width = firmware.idrom.port_width.max(1) as usize;
    let terminal = format!("port {} pin {}", number / width, number % width);
    if card == Place::default() {
        terminal
    } else {
        format!("{terminal}, {}", list(&[card]))
    }
}

/// Terminals of a step or direction pin on a card.
fn of_card(board: &BoardTable, firmware: &HostMot2, pin: PinDescriptor) -> Place {
    let [step, direction] = match pin.secondary {
        Gtag::STEPGEN => board.step_places(firmware, pin.unit),
        _ => return Place::default(),
    };
    match pin.secondary_pin {
        0x81 => step,
        0x82 => direction,
        _ => Place::default(),
    }
}

/// Terminals of a pin that a module of the board uses.
fn of_module(board: &BoardTable, firmware: &HostMot2, pin: PinDescriptor) -> Vec<Place> {
    let unit = u16::from(pin.unit);
    let function = u16::from(pin.secondary_pin & 0x7F);
    let ranges = board.ranges(firmware, pin.secondary);
    let nth = |ranges: &[Terminals], n| Terminals::each_of(ranges, n).collect();
    match (pin.secondary, function) {
        (Gtag::PWM, 1) => nth(board.pwm.outputs, unit),
        (Gtag::PWM, 3) => nth(board.pwm.enables, unit),
        (Gtag::SSR | Gtag::OUT_M, 1..) => nth(ranges, function - 1),
        // Two encoders share a pin.
        (Gtag::MUXED_ENCODER, 1..=3) => [2 * unit, 2 * unit + 1]
            .into_iter()
            .flat_map(|encoder| Terminals::of_signal(ranges, encoder, usize::from(function) - 1))
            .collect(),
        // RX+, RX-, TX+, TX-.
        (Gtag::SSERIAL | Gtag::SSERIAL_B, 1) => {
            let first = if pin.is_output() { 2 } else { 0 };
            Terminals::each_of(ranges, 0).skip(first).take(2).collect()
        }
        (Gtag::IN_MUX, 1) if !pin.is_output() => {
            Terminals::each(ranges).map(|(_, place)| place).collect()
        }
        _ => Vec::new(),
    }
}

fn list(places: &[Place]) -> String {
    let texts: Vec<String> = places
        .iter()
        .filter(|place| **place != Place::default())
        .map(|place| format!("{} {}", place.terminal, place.signal))
        .collect();
    texts.join(", ")
}

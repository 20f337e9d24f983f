//! Where the FPGA's I/O pins come out of the board.

use mesa_hal::boards::{Terminal, i7i97};
use mesa_hal::hostmot2::{Gtag, HostMot2, PinDescriptor};

/// DB25 pins of a connector of 17 I/O pins, in their order (manuals 7I77 and 7I97).
const DB25: [u8; 17] = [1, 14, 2, 15, 3, 16, 4, 17, 5, 6, 7, 8, 9, 10, 11, 12, 13];

/// What I/O pin `number` is at: terminals of the board itself, or the pin of a DB25 connector;
/// empty where it does not leave the board as it is.
pub fn of(firmware: &HostMot2, number: usize, pin: PinDescriptor) -> String {
    if i7i97::is_firmware_of(firmware) {
        return match number.checked_sub(i7i97::FIRST_EXPANSION_PIN) {
            Some(n) => list(i7i97::EXPANSION.get(n..=n).unwrap_or(&[])),
            None => list(&on_7i97(pin)),
        };
    }
    match DB25.get(number % firmware.idrom().port_width.max(1) as usize) {
        Some(db25) if firmware.idrom().port_width == 17 => format!("DB25 pin {db25}"),
        _ => String::new(),
    }
}

/// The terminals behind a pin that a module of the 7I97 uses.
fn on_7i97(pin: PinDescriptor) -> Vec<Terminal> {
    let unit = usize::from(pin.unit);
    let function = pin.secondary_pin & 0x7F;
    let nth =
        |table: &[&'static [Terminal]], n: usize| table.get(n).copied().unwrap_or(&[]).to_vec();
    match (pin.secondary, function) {
        (Gtag::PWM, 1) => nth(&i7i97::ANALOG_TERMINALS, unit),
        // The board switches enables 0 to 3 together.
        (Gtag::PWM, 3) if unit == 0 => i7i97::ENABLE_TERMINALS[..4].concat(),
        (Gtag::PWM, 3) => nth(&i7i97::ENABLE_TERMINALS, unit),
        (Gtag::SSR | Gtag::OUT_M, 1..=6) => {
            nth(&i7i97::OUTPUT_TERMINALS, usize::from(function) - 1)
        }
        // Two encoders share a pin: A, B and index have two terminals each.
        (Gtag::MUXED_ENCODER, 1..=3) => [2 * unit, 2 * unit + 1]
            .into_iter()
            .flat_map(|encoder| {
                let first = 2 * (usize::from(function) - 1);
                nth(&i7i97::ENCODER_TERMINALS, encoder)
                    .into_iter()
                    .skip(first)
                    .take(2)
            })
            .collect(),
        (Gtag::SSERIAL | Gtag::SSERIAL_B, 1) if pin.is_output() => {
            i7i97::SERIAL_TERMINALS[2..].to_vec()
        }
        (Gtag::SSERIAL | Gtag::SSERIAL_B, 1) => i7i97::SERIAL_TERMINALS[..2].to_vec(),
        (Gtag::IN_MUX, 1) if !pin.is_output() => i7i97::INPUT_TERMINALS.to_vec(),
        _ => Vec::new(),
    }
}

fn list(terminals: &[Terminal]) -> String {
    let texts: Vec<String> = terminals
        .iter()
        .map(|terminal| format!("{} {}", terminal.place, terminal.signal))
        .collect();
    texts.join(", ")
}

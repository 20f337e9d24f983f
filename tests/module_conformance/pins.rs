//! I/O ports, watchdog, LEDs and solid-state relays.

use mesa_hal::sim::{Firmware, PinDescriptor, gtag, machines};

use crate::Replay;
use crate::bench::FpgaBench;
use crate::outcome::Outcome;
use crate::runner::{self, Rules};
use crate::transcript::Transcript;

/// The pins of the PWM generators; the others of the I/O port files have no module.
const PWM_PINS: usize = 9;

/// Where the recorded firmware has the second pins of PWM generators 0 to 3.
const SECOND_PWM_PINS: usize = 34;

/// Everything exact, to the clock.
pub const REPLAY: Option<Replay> = Some(replay);

fn replay(transcript: &Transcript) -> Outcome {
    let firmware = match transcript.name.get(..2) {
        Some("io" | "wd") => pwm_firmware(),
        _ => machines::firmware_7i97(1),
    };
    let mut bench = FpgaBench::new(firmware);
    runner::replay(transcript, &mut bench, Rules::default())
}

/// The pins of a 7I97's PWM generators, and the second pins of four of them on IO34 to IO37.
pub fn pwm_firmware() -> Firmware {
    let mut firmware = machines::firmware_7i97(1);
    for pin in &mut firmware.pins[PWM_PINS..] {
        *pin = PinDescriptor::gpio();
    }
    for unit in 0..4 {
        firmware.pins[SECOND_PWM_PINS + usize::from(unit)] =
            PinDescriptor::new(gtag::PWM, unit, 0x82);
    }
    firmware
}

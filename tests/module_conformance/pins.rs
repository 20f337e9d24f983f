//! I/O ports, watchdog, LEDs and solid-state relays; the driver's watchdog time.

use core::time::Duration;

use mesa_hal::modules::watchdog::WatchdogRegisters;
use mesa_hal_sim::wire::Nanos;
use mesa_hal_sim::{SimFirmware, SimPinDescriptor, gtag, machines};

use crate::Replay;
use crate::bench::FpgaBench;
use crate::common::recording::Outcome;
use crate::runner::{self, Rules};
use crate::transcript::{Event, Level, Transcript};

/// ClockLow, and its period.
const CLOCK_HZ: u32 = 100_000_000;
const CLOCK: Nanos = 10;

/// The pins of the PWM generators; the others of the I/O port files have no module.
const PWM_PINS: usize = 9;

/// The second pins of PWM generators 0 to 3 in the recorded firmware.
const SECOND_PWM_PINS: usize = 34;

/// Everything exact, to the clock.
pub const REPLAY: Replay = replay;

fn replay(transcript: &Transcript) -> Outcome {
    let firmware = match transcript.name.get(..2) {
        Some("io" | "wd") => pwm_firmware(),
        _ => machines::firmware_7i97(1),
    };
    let mut bench = FpgaBench::new(firmware);
    let mut outcome = runner::replay(transcript, &mut bench, Rules::default());
    compare_driver(transcript, &mut outcome);
    outcome
}

/// Checks the driver's arithmetic of the watchdog: from each time that is written and runs out, to
/// the bite. The pins are released a clock after it.
fn compare_driver(transcript: &Transcript, outcome: &mut Outcome) {
    let watchdog = WatchdogRegisters {
        clock_hz: CLOCK_HZ,
        ..WatchdogRegisters::default()
    };
    let (mut started, mut written) = (None, 0);
    for entry in &transcript.entries {
        match &entry.event {
            Event::Write { register, value } if register.kind.name == "WD_TIME" => {
                started = (value >> 31 == 0).then_some((entry.time, *value));
                written = entry.time;
            }
            Event::Write { register, .. } if register.kind.name == "WD_RESET" => started = None,
            Event::Write { .. } | Event::Drive { .. } => written = entry.time,
            // Pins that go at a write are released by it, not by a bite; and a bite does not come
            // sooner than three clocks after the time.
            Event::Pin { level, .. } if *level == Level::Released && entry.time > written => {
                let ended = started.take_if(|(since, _)| entry.time >= *since + 3 * CLOCK);
                let Some((since, word)) = ended else {
                    continue;
                };
                let recorded = Duration::from_nanos(entry.time - since - CLOCK);
                let time = watchdog.time_for(recorded);
                let timeout = watchdog.timeout_of(word);
                outcome.compare(
                    (time, timeout) == (word, Some(recorded)),
                    entry.line,
                    || {
                        (
                            format!("the driver's word for {recorded:?} {word:#010X}, and back"),
                            format!("{time:#010X}, {timeout:?}"),
                        )
                    },
                );
            }
            _ => {}
        }
    }
}

/// The pins of a 7I97's PWM generators, and the second pins of four of them on IO34 to IO37.
pub fn pwm_firmware() -> SimFirmware {
    let mut firmware = machines::firmware_7i97(1);
    for pin in &mut firmware.pins[PWM_PINS..] {
        *pin = SimPinDescriptor::gpio();
    }
    for unit in 0..4 {
        firmware.pins[SECOND_PWM_PINS + usize::from(unit)] =
            SimPinDescriptor::new(gtag::PWM, unit, 0x82);
    }
    firmware
}

//! The outside of a port, towards the rest of the FPGA.

use super::firmware::Firmware;
use super::{Lines, PortConfig, Register};
use crate::wire::Nanos;

/// A simulated SSLBP instance.
///
/// Drive it in time order: [`advance`](Self::advance) up to a time, then read and write registers
/// at that time. Behaviour is deterministic, the state has a fixed size, and nothing allocates.
#[derive(Clone, Debug)]
pub struct SslbpPort {
    firmware: Firmware,
    now: Nanos,
}

impl SslbpPort {
    /// A port at power-up: the firmware first initialises itself, which takes 37 us with one
    /// channel and 142 us with eight (at 100 MHz).
    pub fn new(config: PortConfig) -> Self {
        Self {
            firmware: Firmware::new(config),
            now: 0,
        }
    }

    /// A port at the time `now`, in an FPGA that is configured from `configured` on: not before
    /// `now`. Until its firmware is ready, all its registers read 0.
    pub fn configured_at(config: PortConfig, now: Nanos, configured: Nanos) -> Self {
        Self {
            firmware: Firmware::new(config).begun_at(configured.max(now)),
            now,
        }
    }

    /// The build options.
    pub fn config(&self) -> &PortConfig {
        &self.firmware.config
    }

    /// The time to which the port has been advanced.
    pub fn now(&self) -> Nanos {
        self.now
    }

    /// Host write at `now`; call [`advance`](Self::advance) up to `now` before.
    ///
    /// Writing DATA while COMMAND bit 14 is set would load a program word into the processor; other
    /// programs are not simulated, and the write is lost.
    pub fn write(&mut self, now: Nanos, register: Register, value: u32) {
        self.now = self.now.max(now);
        let firmware = &mut self.firmware;
        match register {
            Register::Command => {
                if firmware.host.write_command(self.now, value) {
                    firmware.command_written(self.now);
                }
            }
            Register::Data => firmware.host.data_in = value as u8,
            Register::Cs(channel) => firmware.host.write_inward(channel, 0, value),
            Register::Interface(channel, n) => {
                let n = usize::from(n);
                if n < firmware.config.interface_registers().count() {
                    firmware.host.write_inward(channel, n + 1, value);
                }
            }
        }
    }

    /// Host read at `now`; call [`advance`](Self::advance) up to `now` before.
    pub fn read(&mut self, now: Nanos, register: Register) -> u32 {
        self.now = self.now.max(now);
        let host = &self.firmware.host;
        match register {
            Register::Command => u32::from(host.command(self.now)),
            Register::Data if self.firmware.in_reset() => {
                program_word(host.command(self.now) & 0x7FF)
            }
            Register::Data => u32::from(host.data(self.now)),
            Register::Cs(channel) => host.cs(self.now, usize::from(channel)),
            Register::Interface(channel, n) => {
                host.outward(usize::from(channel), usize::from(n) + 1)
            }
        }
    }

    /// Time of the next event without the host, if there is one.
    pub fn next_event(&self) -> Option<Nanos> {
        let burst = self.next_burst_end().map(|(end, _)| end);
        let change = self.firmware.host.next_change(self.now);
        let step = self.firmware.next_step();
        burst.into_iter().chain(step).chain(change).min()
    }

    /// Moves the time to `now` without any event before, as [`next_event`](Self::next_event) must
    /// have returned: changes of the lines from here on count from `now`.
    pub fn skip_to(&mut self, now: Nanos) {
        self.now = self.now.max(now);
    }

    /// Advances to `to`, inclusive.
    ///
    /// # Real time
    /// Steps through events only: while every channel waits for the host, any span of time is one
    /// jump. Allocates: no (except for the remotes behind `lines`).
    pub fn advance(&mut self, to: Nanos, lines: &mut dyn Lines) {
        self.listen_to_levels(lines);
        let mut next_end = self.next_burst_end();
        loop {
            if self.firmware.take_has_sent() {
                next_end = self.next_burst_end();
            }
            let step = self.firmware.next_step().filter(|&time| time <= to);
            let burst = next_end.filter(|&(time, _)| time <= to);
            match (step, burst) {
                (_, Some((end, channel))) if step.is_none_or(|time| end <= time) => {
                    self.burst_ended(channel, lines);
                    next_end = self.next_burst_end();
                }
                (Some(_), _) => self.firmware.step(),
                _ => break,
            }
        }
        self.now = self.now.max(to);
        lines.advance(self.now);
    }

    fn next_burst_end(&self) -> Option<(Nanos, usize)> {
        self.firmware
            .uarts
            .iter()
            .enumerate()
            .filter_map(|(channel, uart)| Some((uart.transmitter.next_end()?, channel)))
            .min()
    }

    fn burst_ended(&mut self, channel: usize, lines: &mut dyn Lines) {
        let Some(uart) = self.firmware.uarts.get_mut(channel) else {
            return;
        };
        let Some(burst) = uart.transmitter.take_ended() else {
            return;
        };
        lines.transmit(channel, &burst);
        while let Some(reply) = lines.receive(channel) {
            uart.receiver.expect(reply);
        }
    }

    fn listen_to_levels(&mut self, lines: &mut dyn Lines) {
        let channels = self.firmware.config.channels();
        for (channel, uart) in self.firmware.uarts.iter_mut().enumerate().take(channels) {
            let low = lines.held_low(channel, self.now);
            uart.receiver.hold_low(self.now, low);
        }
    }
}

/// Words of the processor's program, as DATA shows them while the processor is held in reset. Only
/// these are known (T:t01, t01b); all others read as zero here.
fn program_word(address: u16) -> u32 {
    match address {
        0x026 => 0xB002,
        0x027 => 0x012B,
        0x028 => 0xB003,
        0x7FF => 0xABCD,
        _ => 0,
    }
}

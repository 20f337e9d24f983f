//! A port as the rest of the FPGA sees it.

use super::{Lines, MAX_CHANNELS, MAX_INTERFACE_REGISTERS, PortConfig, Register};
use crate::sim::wire::Nanos;

/// One simulated SSLBP instance.
#[derive(Clone, Debug)]
pub struct SslbpPort {
    config: PortConfig,
    now: Nanos,
    command: u16,
    data_in: u8,
    data_out: u8,
    host: [[u32; MAX_INTERFACE_REGISTERS + 1]; MAX_CHANNELS],
    local: [[u32; MAX_INTERFACE_REGISTERS + 1]; MAX_CHANNELS],
}

impl SslbpPort {
    /// A port at power-up.
    pub fn new(config: PortConfig) -> Self {
        Self {
            config,
            now: 0,
            command: 0,
            data_in: 0,
            data_out: 0,
            host: [[0; MAX_INTERFACE_REGISTERS + 1]; MAX_CHANNELS],
            local: [[0; MAX_INTERFACE_REGISTERS + 1]; MAX_CHANNELS],
        }
    }

    /// The build options.
    pub fn config(&self) -> &PortConfig {
        &self.config
    }

    /// Host write at `now`; call [`advance`](Self::advance) up to `now` before.
    pub fn write(&mut self, now: Nanos, register: Register, value: u32) {
        self.now = self.now.max(now);
        match register {
            Register::Command if value & 0x8000_0000 == 0 => self.command = value as u16,
            Register::Command => {}
            Register::Data => self.data_in = value as u8,
            Register::Cs(channel) => Self::store(&mut self.host, channel, 0, value),
            Register::Interface(channel, n) => {
                Self::store(&mut self.host, channel, usize::from(n) + 1, value);
            }
        }
    }

    /// Host read at `now`; call [`advance`](Self::advance) up to `now` before.
    pub fn read(&mut self, now: Nanos, register: Register) -> u32 {
        self.now = self.now.max(now);
        let fetch = |channel: u8, n: usize| {
            self.local
                .get(usize::from(channel))
                .and_then(|registers| registers.get(n))
                .copied()
                .unwrap_or(0)
        };
        match register {
            Register::Command => u32::from(self.command),
            Register::Data => u32::from(self.data_out),
            Register::Cs(channel) => fetch(channel, 0),
            Register::Interface(channel, n) => fetch(channel, usize::from(n) + 1),
        }
    }

    /// When something can happen next without the host, if anything can.
    pub fn next_event(&self) -> Option<Nanos> {
        None
    }

    /// Lets time pass up to `to`.
    pub fn advance(&mut self, to: Nanos, _lines: &mut dyn Lines) {
        self.now = self.now.max(to);
    }

    fn store(
        bank: &mut [[u32; MAX_INTERFACE_REGISTERS + 1]; MAX_CHANNELS],
        channel: u8,
        n: usize,
        value: u32,
    ) {
        if let Some(slot) = bank
            .get_mut(usize::from(channel))
            .and_then(|registers| registers.get_mut(n))
        {
            *slot = value;
        }
    }
}

//! Build options of a port in an FPGA's firmware image: channels, clock, registers.

/// Maximum number of channels of one SSLBP instance.
pub const MAX_CHANNELS: usize = 8;

/// Maximum number of interface registers of a channel (GTAG 0xC6).
pub const MAX_INTERFACE_REGISTERS: usize = 7;

/// Number of interface registers of each channel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum InterfaceRegisters {
    /// Three, 96 bits (GTAG 0xC1).
    #[default]
    Three,
    /// Seven, 224 bits (GTAG 0xC6).
    Seven,
}

impl InterfaceRegisters {
    /// The number.
    pub const fn count(self) -> usize {
        match self {
            Self::Three => 3,
            Self::Seven => 7,
        }
    }
}

/// The build options of a simulated port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PortConfig {
    channels: u8,
    clock_hz: u32,
    interface_registers: InterfaceRegisters,
    minor_revision: u8,
}

/// The minor revision of the firmware whose behaviour is simulated: 1.43.
pub const MINOR_REVISION: u8 = 43;

impl PortConfig {
    /// A port with `channels` channels (limited to 1..=8), three interface registers, and a
    /// processor clock of `clock_hz` (at least 1 MHz).
    pub fn new(channels: u8, clock_hz: u32) -> Self {
        Self {
            channels: channels.clamp(1, MAX_CHANNELS as u8),
            clock_hz: clock_hz.max(1_000_000),
            interface_registers: InterfaceRegisters::Three,
            minor_revision: MINOR_REVISION,
        }
    }

    /// The same port with another minor revision in its local parameters. The behaviour stays that
    /// of 1.43: the differences of older firmware are unknown.
    #[must_use]
    pub const fn with_minor_revision(mut self, minor: u8) -> Self {
        self.minor_revision = minor;
        self
    }

    /// The minor revision in its local parameters.
    pub const fn minor_revision(&self) -> u8 {
        self.minor_revision
    }

    /// The same port with another register layout.
    #[must_use]
    pub const fn with_interface_registers(mut self, registers: InterfaceRegisters) -> Self {
        self.interface_registers = registers;
        self
    }

    /// Number of channels, 1..=8.
    pub const fn channels(&self) -> usize {
        self.channels as usize
    }

    /// Processor and UART clock in hertz.
    pub const fn clock_hz(&self) -> u32 {
        self.clock_hz
    }

    /// The register layout.
    pub const fn interface_registers(&self) -> InterfaceRegisters {
        self.interface_registers
    }
}

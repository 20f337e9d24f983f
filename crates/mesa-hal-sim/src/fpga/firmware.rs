//! The identity of a HostMot2 firmware image, and its words as the host reads them.

/// GTAGs: HostMot2's numbers for kinds of modules.
pub mod gtag {
    /// Watchdog.
    pub const WATCHDOG: u8 = 0x02;
    /// I/O port; also the primary tag of every pin.
    pub const IO_PORT: u8 = 0x03;
    /// Quadrature encoder.
    pub const ENCODER: u8 = 0x04;
    /// Step generator.
    pub const STEPGEN: u8 = 0x05;
    /// PWM generator.
    pub const PWM: u8 = 0x06;
    /// Multiplexed quadrature encoder.
    pub const MUXED_ENCODER: u8 = 0x0C;
    /// Select line of the multiplexed encoders.
    pub const MUX_SELECT: u8 = 0x0D;
    /// Phase-locked loop on the host's cycle.
    pub const DPLL: u8 = 0x1A;
    /// Multiplexed inputs.
    pub const IN_MUX: u8 = 0x1E;
    /// Inputs.
    pub const IN_M: u8 = 0x23;
    /// Outputs.
    pub const OUT_M: u8 = 0x2D;
    /// Width of InMux: a hint, without registers.
    pub const IN_MUX_WIDTH: u8 = 0x1F;
    /// Local I/O port: the primary tag of pins that belong to no I/O port.
    pub const LOCAL_IO_PORT: u8 = 0x40;
    /// LEDs.
    pub const LED: u8 = 0x80;
    /// Smart serial with three interface registers.
    pub const SSERIAL: u8 = 0xC1;
    /// Solid-state relays.
    pub const SSR: u8 = 0xC3;
    /// Charge pump.
    pub const CP_DRIVE: u8 = 0xC4;
    /// Smart serial with seven interface registers.
    pub const SSERIAL_B: u8 = 0xC6;
}

/// Set in the secondary pin of a pin that its module drives.
pub const OUTPUT_PIN: u8 = 0x80;

/// Address of the identification.
pub(crate) const COOKIE_ADDRESS: u16 = 0x0100;
/// Address of the IDROM.
pub(crate) const IDROM_ADDRESS: u16 = 0x0400;

pub(crate) const COOKIE: u32 = 0x55AA_CAFE;
const MODULES_OFFSET: u32 = 0x40;
/// Offset in all public firmware images, although their comments give 0x200. FACTS 9.1.
const PINS_OFFSET: u32 = 0x1C0;
/// Slots for module descriptors: the space before the pin descriptors.
const MODULE_SLOTS: usize = 32;
const MODULE_WORDS: usize = 3;
/// Slots for pin descriptors, those of local I/O included.
const PIN_SLOTS: usize = 144;
/// The memory of the IDROM: 0400 to 07FF.
pub(crate) const IDROM_WORDS: usize = 256;

/// A module descriptor. FACTS 9.1.
///
/// ```
/// use mesa_hal_sim::{SimModuleDescriptor, gtag};
///
/// let step_generators = SimModuleDescriptor {
///     gtag: gtag::STEPGEN,
///     instances: 4,
///     base: 0x2000,
///     registers: 10,
///     multiple: 0x1FF,
///     ..SimModuleDescriptor::default()
/// };
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SimModuleDescriptor {
    /// Kind of module; see [`gtag`].
    pub gtag: u8,
    /// Version of the module.
    pub version: u8,
    /// 1: runs on ClockLow, 2: runs on ClockHigh.
    pub clock: u8,
    /// Number of instances.
    pub instances: u8,
    /// Address of register 0 of instance 0.
    pub base: u16,
    /// Number of registers.
    pub registers: u8,
    /// Selects the strides: register stride in the low nibble, instance stride in the high nibble.
    pub strides: u8,
    /// Bit n: register n exists once for each instance.
    pub multiple: u32,
}

impl Default for SimModuleDescriptor {
    /// One instance on ClockLow, in version 0 and with the usual strides, without registers.
    fn default() -> Self {
        Self {
            gtag: 0,
            version: 0,
            clock: 1,
            instances: 1,
            base: 0,
            registers: 0,
            strides: 0x00,
            multiple: 0,
        }
    }
}

impl SimModuleDescriptor {
    fn words(&self) -> [u32; 3] {
        [
            u32::from_le_bytes([self.gtag, self.version, self.clock, self.instances]),
            u32::from(self.base) | u32::from(self.registers) << 16 | u32::from(self.strides) << 24,
            self.multiple,
        ]
    }
}

/// A pin descriptor. FACTS 9.1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SimPinDescriptor {
    /// Primary tag; 3 (I/O port) on every pin of a valid firmware.
    pub primary: u8,
    /// GTAG of the module that can use the pin instead, or 0.
    pub secondary: u8,
    /// Instance of that module.
    pub unit: u8,
    /// Signal of that instance; [`OUTPUT_PIN`] is set if the module drives it.
    pub pin: u8,
}

impl SimPinDescriptor {
    /// A pin that a module can use.
    pub const fn new(secondary: u8, unit: u8, pin: u8) -> Self {
        Self {
            primary: gtag::IO_PORT,
            secondary,
            unit,
            pin,
        }
    }

    /// A pin that is general-purpose I/O only.
    pub const fn gpio() -> Self {
        Self::new(0, 0, 0)
    }

    /// A pin of the board that belongs to no I/O port.
    pub const fn local(secondary: u8, unit: u8, pin: u8) -> Self {
        Self {
            primary: gtag::LOCAL_IO_PORT,
            ..Self::new(secondary, unit, pin)
        }
    }

    fn word(self) -> u32 {
        u32::from_le_bytes([self.pin, self.secondary, self.unit, self.primary])
    }
}

/// A firmware image: the contents of the IDROM, which also determine the simulated modules.
///
/// The image is not validated: a test of a driver may need an inconsistent one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SimFirmware {
    /// Type of the IDROM: 2 or 3.
    pub idrom_type: u32,
    /// Name of the board, eight characters.
    pub board: [u8; 8],
    /// Size of the FPGA in thousands of gates.
    pub fpga_size: u32,
    /// Pins of the FPGA's package.
    pub fpga_pins: u32,
    /// Number of I/O ports.
    pub ports: u32,
    /// Pins of each port.
    pub port_width: u32,
    /// ClockLow in hertz.
    pub clock_low: u32,
    /// ClockHigh in hertz.
    pub clock_high: u32,
    /// The multiplex rate register of the encoders at power-up: ClockLow/(n+2).
    pub mux_rate: u32,
    /// True if the watchdog's status is set after configuration, as in older firmware. FACTS 12.1.
    pub starts_bitten: bool,
    /// Minor version of the serial ports' own firmware: 43, or 38 on boards before 2015, of which
    /// only the number is simulated.
    pub sslbp_minor: u8,
    /// The modules, at most 31, up to the null descriptor that ends the list.
    pub modules: Vec<SimModuleDescriptor>,
    /// Descriptors after that end, each with its slot (0 to 31): charge pump and hints. They are
    /// only listed, not simulated.
    pub behind_end: Vec<(u8, SimModuleDescriptor)>,
    /// The pins, port by port, at most 144.
    pub pins: Vec<SimPinDescriptor>,
    /// Pins of the board itself, which follow those of the ports: at most 144 together. They are
    /// only listed, not simulated.
    pub local_pins: Vec<SimPinDescriptor>,
}

impl SimFirmware {
    /// The frequency of a clock tag in hertz; ClockLow for a tag that does not exist.
    pub fn clock(&self, tag: u8) -> u32 {
        if tag == 2 {
            self.clock_high
        } else {
            self.clock_low
        }
    }

    /// The first module with this GTAG that has instances: a descriptor without instances is not a
    /// module.
    pub fn module(&self, gtag: u8) -> Option<&SimModuleDescriptor> {
        let mut modules = self.modules.iter();
        modules.find(|module| module.gtag == gtag && module.instances > 0)
    }

    /// Mutable access to the first descriptor with this GTAG.
    pub fn module_mut(&mut self, gtag: u8) -> Option<&mut SimModuleDescriptor> {
        self.modules.iter_mut().find(|module| module.gtag == gtag)
    }

    /// The number of the I/O pin that carries a signal of a module.
    pub fn pin(&self, secondary: u8, unit: u8, pin: u8) -> Option<usize> {
        self.pins.iter().position(|descriptor| {
            descriptor.secondary == secondary && descriptor.unit == unit && descriptor.pin == pin
        })
    }

    /// Register stride and instance stride of a module in bytes.
    pub(crate) fn strides(module: &SimModuleDescriptor) -> (u16, u16) {
        // FACTS 9.1: instance strides 4 and 0x40; both register strides are 0x100.
        let instance = if module.strides >> 4 == 0 { 4 } else { 0x40 };
        (0x100, instance)
    }

    /// Cookie, configuration name and IDROM pointer, from [`COOKIE_ADDRESS`] on.
    pub(crate) fn identification() -> [u32; 4] {
        [
            COOKIE,
            u32::from_le_bytes(*b"HOST"),
            u32::from_le_bytes(*b"MOT2"),
            u32::from(IDROM_ADDRESS),
        ]
    }

    /// The IDROM, from [`IDROM_ADDRESS`] on.
    pub(crate) fn idrom(&self) -> Vec<u32> {
        let [b0, b1, b2, b3, b4, b5, b6, b7] = self.board;
        let mut words = vec![
            self.idrom_type,
            MODULES_OFFSET,
            PINS_OFFSET,
            u32::from_le_bytes([b0, b1, b2, b3]),
            u32::from_le_bytes([b4, b5, b6, b7]),
            self.fpga_size,
            self.fpga_pins,
            self.ports,
            self.ports * self.port_width,
            self.port_width,
            self.clock_low,
            self.clock_high,
            4,
            0x40,
            0x100,
            0x100,
        ];
        let mut slots = [[0; MODULE_WORDS]; MODULE_SLOTS];
        // The last slot stays empty as the end of the list.
        let modules = self.modules.iter().take(MODULE_SLOTS - 1);
        for (slot, module) in slots.iter_mut().zip(modules) {
            *slot = module.words();
        }
        for (slot, module) in &self.behind_end {
            if let Some(slot) = slots.get_mut(usize::from(*slot)) {
                *slot = module.words();
            }
        }
        words.extend(slots.as_flattened());
        let pins = self.pins.iter().chain(&self.local_pins).take(PIN_SLOTS);
        words.extend(pins.map(|pin| pin.word()));
        // A host reads up to the end of the memory.
        words.resize(IDROM_WORDS, 0);
        words
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn descriptor_words_have_the_layout_of_facts_9_1() {
        let encoder = SimModuleDescriptor {
            gtag: 0x0C,
            version: 4,
            instances: 6,
            base: 0x3600,
            registers: 5,
            multiple: 3,
            ..SimModuleDescriptor::default()
        };
        assert_eq!(encoder.words(), [0x0601_040C, 0x0005_3600, 3]);
        let sserial = SimModuleDescriptor {
            gtag: 0xC1,
            instances: 2,
            base: 0x5B00,
            registers: 6,
            strides: 0x10,
            multiple: 0x3C,
            ..SimModuleDescriptor::default()
        };
        assert_eq!(sserial.words(), [0x0201_00C1, 0x1006_5B00, 0x3C]);
        assert_eq!(SimPinDescriptor::new(0xC1, 0, 0x91).word(), 0x0300_C191);
        assert_eq!(SimPinDescriptor::gpio().word(), 0x0300_0000);
        assert_eq!(SimPinDescriptor::local(0xC4, 0, 0x82).word(), 0x4000_C482);
    }
}

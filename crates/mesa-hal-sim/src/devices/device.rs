//! A remote from a description, with a world around it.

use thiserror::Error;

use super::{Description, DescriptionError, SimLayout, image};
use crate::{
    remote::{Application, ReplyFaults, SimFlash, SimMemory, SimRemote},
    wire::{BIT_2M5, Nanos, RemoteEnd},
};
use mesa_wire::lbp::RemoteFaults;

/// An action that is not possible on this device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum WorldError {
    /// The input does not exist.
    #[error("the device has {count} of these inputs, there is no number {index}")]
    NoSuchInput {
        /// The requested number.
        index: usize,
        /// Number of inputs.
        count: usize,
    },
    /// The output does not exist.
    #[error("the device has {count} of these outputs, there is no number {index}")]
    NoSuchOutput {
        /// The requested number.
        index: usize,
        /// Number of outputs.
        count: usize,
    },
    /// The device has nothing of the kind.
    #[error("the device has nothing of that kind; see what its mode has")]
    NotThere,
    /// A voltage is not finite.
    #[error("a voltage must be a finite number")]
    NotFinite,
}

/// A value on a terminal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SignalValue {
    /// A digital input as sensed, or an output as driven: on, or conducting.
    Bool(bool),
    /// Volts.
    Volts(f64),
    /// A counter.
    Count(u64),
    /// A number in the unit of its record.
    Number(f64),
}

impl core::fmt::Display for SignalValue {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Bool(true) => f.write_str("on"),
            Self::Bool(false) => f.write_str("off"),
            Self::Volts(volts) => write!(f, "{volts:.3} V"),
            Self::Count(count) => write!(f, "{count}"),
            Self::Number(number) => write!(f, "{number}"),
        }
    }
}

/// The world side of a device: its terminals.
///
/// Voltages and other inputs apply from the time at which they are set.
pub trait World: core::fmt::Debug + Send + 'static {
    /// Called after power-up.
    fn power_up(&mut self, layout: &SimLayout, memory: &SimMemory) {
        let _ = (layout, memory);
    }

    /// Copies the inputs into memory, at the addresses of their layout.
    fn sample(&mut self, mode: u8, layout: &SimLayout, memory: &mut SimMemory);

    /// Applies the outputs in memory.
    fn drive(&mut self, layout: &SimLayout, memory: &SimMemory);

    /// Switches all outputs off.
    fn off(&mut self);

    /// Faults that are present now.
    fn faults(&self) -> RemoteFaults {
        RemoteFaults::empty()
    }

    /// Called after the host cleared the faults: tripped outputs may be tried again.
    fn faults_cleared(&mut self) {}

    /// True if the remote's processor is supplied.
    fn is_supplied(&self) -> bool {
        true
    }

    /// Sets digital input `n` fully on or off.
    fn set_input(&mut self, n: usize, on: bool) -> Result<(), WorldError> {
        let _ = (n, on);
        Err(WorldError::NotThere)
    }

    /// Sets the voltage on input `n`.
    fn set_input_volts(&mut self, n: usize, volts: f64) -> Result<(), WorldError> {
        let _ = (n, volts);
        Err(WorldError::NotThere)
    }

    /// Sets the field voltage.
    fn set_field_volts(&mut self, volts: f64) -> Result<(), WorldError> {
        let _ = volts;
        Err(WorldError::NotThere)
    }

    /// Short-circuits the load of output `n`, or repairs it.
    fn set_over_current(&mut self, n: usize, shorted: bool) -> Result<(), WorldError> {
        let _ = (n, shorted);
        Err(WorldError::NotThere)
    }

    /// Overheats the driver chip of output `n`, or lets it cool down.
    fn set_over_temperature(&mut self, n: usize, hot: bool) -> Result<(), WorldError> {
        let _ = (n, hot);
        Err(WorldError::NotThere)
    }

    /// The inputs by name, as sensed.
    fn inputs(&self, layout: &SimLayout) -> Vec<(String, SignalValue)>;

    /// The outputs by name, as driven: faults and power considered.
    fn outputs(&self, layout: &SimLayout) -> Vec<(String, SignalValue)>;

    /// Digital output `n` as driven.
    fn output(&self, n: usize) -> Option<bool> {
        let _ = n;
        None
    }

    /// Analog output `n` as driven, in volts.
    fn analog_output(&self, n: usize) -> Option<f64> {
        let _ = n;
        None
    }
}

/// The application of a described remote: its layout and its world.
#[derive(Clone, Debug)]
pub struct Device<W> {
    layout: SimLayout,
    world: W,
}

impl<W: World> Device<W> {
    /// Creates a remote from `description`, in `world`.
    pub fn remote(
        description: &Description,
        world: W,
    ) -> Result<SimRemote<Self>, DescriptionError> {
        let (config, layout) = image::build(description)?;
        Ok(SimRemote::new(config, Self { layout, world }))
    }

    /// Addresses of its values in memory.
    pub const fn layout(&self) -> &SimLayout {
        &self.layout
    }

    /// The world at its terminals.
    pub const fn world(&self) -> &W {
        &self.world
    }

    /// Mutable access to the world at its terminals.
    pub const fn world_mut(&mut self) -> &mut W {
        &mut self.world
    }
}

impl<W: World> Application for Device<W> {
    fn power_up(&mut self, memory: &mut SimMemory) {
        self.world.power_up(&self.layout, memory);
    }

    fn sample(&mut self, mode: u8, memory: &mut SimMemory) {
        self.world.sample(mode, &self.layout, memory);
    }

    fn inputs(&mut self, mode: u8, memory: &mut SimMemory, data: &mut [u8]) {
        self.layout.pack(mode, memory, data);
    }

    fn clears_faults(&self, data: &[u8]) -> bool {
        self.layout.clear_faults.is_some_and(|(byte, bit)| {
            let byte = data.get(usize::from(byte));
            byte.is_some_and(|byte| byte >> bit & 1 != 0)
        })
    }

    fn outputs(&mut self, mode: u8, memory: &mut SimMemory, data: &[u8]) {
        self.layout.unpack(mode, memory, data);
        self.world.drive(&self.layout, memory);
    }

    fn written(&mut self, _mode: u8, memory: &mut SimMemory, faulty: bool) {
        if !faulty {
            self.world.drive(&self.layout, memory);
        }
    }

    fn outputs_off(&mut self, memory: &mut SimMemory) {
        self.layout.clear_outputs(memory);
        self.world.off();
    }

    fn faults(&self) -> RemoteFaults {
        self.world.faults()
    }

    fn faults_cleared(&mut self) {
        self.world.faults_cleared();
    }
}

/// A simulated device with terminals, independent of its type: the interface for a command shell.
pub trait SimDevice: RemoteEnd {
    /// The four characters of its name.
    fn card(&self) -> [u8; 4];

    /// The world at its terminals.
    fn world(&self) -> &dyn World;

    /// Sets digital input `n` fully on or off.
    fn set_input(&mut self, n: usize, on: bool) -> Result<(), WorldError>;

    /// Sets the voltage on input `n`.
    fn set_input_volts(&mut self, n: usize, volts: f64) -> Result<(), WorldError>;

    /// Sets the field voltage at `now`; a remote that it supplies may lose its power.
    fn set_field_volts(&mut self, now: Nanos, volts: f64) -> Result<(), WorldError>;

    /// Short-circuits the load of output `n`, or repairs it.
    fn set_over_current(&mut self, n: usize, shorted: bool) -> Result<(), WorldError>;

    /// Overheats the driver chip of output `n`, or lets it cool down.
    fn set_over_temperature(&mut self, n: usize, hot: bool) -> Result<(), WorldError>;

    /// The inputs by name, as sensed.
    fn inputs(&self) -> Vec<(String, SignalValue)>;

    /// The outputs by name, as driven.
    fn outputs(&self) -> Vec<(String, SignalValue)>;

    /// Switches its supply at `now`.
    fn set_power(&mut self, now: Nanos, on: bool);

    /// True if it has power.
    fn is_powered(&self) -> bool;

    /// The current software mode.
    fn mode(&self) -> u8;

    /// Selects the software mode at power-up; false if the device does not have that mode.
    fn set_initial_mode(&mut self, now: Nanos, mode: u8) -> bool;

    /// Moves its jumper to the setup position, or back, and switches it off and on at `now`.
    fn set_setup_jumper(&mut self, now: Nanos, setup: bool);

    /// True if its program is missing or truncated, so that only its bootloader replies.
    fn is_in_bootloader(&self) -> bool;

    /// True if its flash memory holds a valid program, which its bootloader would start.
    fn is_program_whole(&self) -> bool;

    /// D5: the revision of the running program; 0 in the bootloader.
    fn revision(&self) -> u8;

    /// Its fault byte.
    fn faults(&self) -> RemoteFaults;

    /// The faults of its next replies.
    fn inject(&mut self) -> &mut ReplyFaults;

    /// The raw values of the parameters by name; non-volatile ones from the EEPROM.
    fn parameters(&self) -> Vec<(String, u64)>;

    /// The cells of its EEPROM.
    fn nonvolatile(&self) -> &SimMemory;

    /// Mutable access to the cells of its EEPROM, to restore them.
    fn nonvolatile_mut(&mut self) -> &mut SimMemory;

    /// The cells of its program flash, if it can be updated.
    fn program(&self) -> Option<&[u8]>;

    /// Restores the cells of its program flash; the program runs from the next power-up on.
    fn load_program(&mut self, cells: &[u8]);

    /// Number of changes of EEPROM and program by the host; save them when it has increased.
    fn nonvolatile_changes(&self) -> u64;
}

impl<W: World> SimDevice for SimRemote<Device<W>> {
    fn card(&self) -> [u8; 4] {
        self.config().name
    }

    fn world(&self) -> &dyn World {
        self.application().world()
    }

    fn set_input(&mut self, n: usize, on: bool) -> Result<(), WorldError> {
        self.application_mut().world_mut().set_input(n, on)
    }

    fn set_input_volts(&mut self, n: usize, volts: f64) -> Result<(), WorldError> {
        let world = self.application_mut().world_mut();
        world.set_input_volts(n, finite(volts)?)
    }

    fn set_field_volts(&mut self, now: Nanos, volts: f64) -> Result<(), WorldError> {
        let world = self.application_mut().world_mut();
        let before = world.is_supplied();
        world.set_field_volts(finite(volts)?)?;
        let after = world.is_supplied();
        if before != after {
            Self::set_power(self, now, after);
        }
        Ok(())
    }

    fn set_over_current(&mut self, n: usize, shorted: bool) -> Result<(), WorldError> {
        let world = self.application_mut().world_mut();
        world.set_over_current(n, shorted)
    }

    fn set_over_temperature(&mut self, n: usize, hot: bool) -> Result<(), WorldError> {
        self.application_mut()
            .world_mut()
            .set_over_temperature(n, hot)
    }

    fn inputs(&self) -> Vec<(String, SignalValue)> {
        let device = self.application();
        device.world.inputs(&device.layout)
    }

    fn outputs(&self) -> Vec<(String, SignalValue)> {
        let device = self.application();
        device.world.outputs(&device.layout)
    }

    fn set_power(&mut self, now: Nanos, on: bool) {
        Self::set_power(self, now, on);
    }

    fn is_powered(&self) -> bool {
        Self::is_powered(self)
    }

    fn mode(&self) -> u8 {
        Self::mode(self)
    }

    fn set_initial_mode(&mut self, now: Nanos, mode: u8) -> bool {
        if self.config().mode(mode).is_none() {
            return false;
        }
        self.configure(|config| config.initial_mode = mode);
        if Self::is_powered(self) {
            Self::set_power(self, now, false);
            Self::set_power(self, now, true);
        }
        true
    }

    fn set_setup_jumper(&mut self, now: Nanos, setup: bool) {
        self.configure(|config| config.setup_jumper = setup);
        Self::set_power(self, now, false);
        if !setup && self.config().baud_address.is_none() {
            self.configure(|config| config.bit = BIT_2M5);
        }
        Self::set_power(self, now, true);
    }

    fn is_in_bootloader(&self) -> bool {
        Self::is_in_bootloader(self)
    }

    fn is_program_whole(&self) -> bool {
        Self::is_program_whole(self)
    }

    fn revision(&self) -> u8 {
        Self::revision(self)
    }

    fn faults(&self) -> RemoteFaults {
        Self::faults(self)
    }

    fn inject(&mut self) -> &mut ReplyFaults {
        self.reply_faults()
    }

    fn parameters(&self) -> Vec<(String, u64)> {
        let elements = self.application().layout().parameters().iter();
        elements
            .map(|element| {
                let cells = if element.record.is_nonvolatile() {
                    self.eeprom().cells()
                } else {
                    self.memory()
                };
                let name = element.record.name.to_ascii_lowercase();
                (name, cells.word(element.address, element.record.bytes()))
            })
            .collect()
    }

    fn nonvolatile(&self) -> &SimMemory {
        self.eeprom().cells()
    }

    fn nonvolatile_mut(&mut self) -> &mut SimMemory {
        self.eeprom_mut().cells_mut()
    }

    fn program(&self) -> Option<&[u8]> {
        self.flash().map(SimFlash::cells)
    }

    fn load_program(&mut self, cells: &[u8]) {
        if let Some(flash) = self.flash_mut() {
            flash.load(cells);
        }
    }

    fn nonvolatile_changes(&self) -> u64 {
        self.eeprom().changes() + self.flash().map_or(0, SimFlash::changes)
    }
}

fn finite(volts: f64) -> Result<f64, WorldError> {
    if volts.is_finite() {
        Ok(volts)
    } else {
        Err(WorldError::NotFinite)
    }
}

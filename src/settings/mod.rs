//! The settings of an application, given before a board is configured.

mod policy;

use alloc::collections::BTreeMap;
use alloc::vec::Vec;
use core::str::FromStr;
use core::time::Duration;

use crate::ParseError;
use crate::discovery::RemoteTable;
use crate::hostmot2::board_table::BoardTable;
use crate::hostmot2::{CountedKind, GpioConfig, Gtag, TickRate};
use crate::sslbp::MAX_CHANNELS;

pub use policy::FaultPolicy;

/// Settings of a driver.
///
/// With the feature `serde` they can be kept in a file: times in seconds, kinds of remotes by the
/// titles of their tables; omitted fields have their default. The application's own tables are not
/// included.
///
/// All fields have defaults that fit a board on the bench: all ports with all their channels in
/// mode 0, all encoders, 1 ms.
/// A later version may add fields; with `..Settings::default()` at its end a program compiles
/// nevertheless.
///
/// ```
/// use mesa_hal::{Pace, Settings};
///
/// let settings = Settings {
///     pace: Pace::Board,
///     serial_ports: [(0, "20xxxxxx".parse()?)].into(),
///     ..Settings::default()
/// };
/// # Ok::<(), mesa_hal::ParseError>(())
/// ```
#[derive(Clone, Debug)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct Settings {
    /// The number of the board in pin names, for several boards of a kind; 0 by default.
    /// [`Board::identify_then`](crate::Board::identify_then) sets it when the kind is known.
    pub board_number: u8,
    /// The source of the initial values of pins and parameters; the board by default.
    pub defaults: Defaults,
    /// The period of the cycle, in which the transfers must fit and the watchdogs are fed. 1 us to
    /// 800 ms; 1 ms by default.
    ///
    /// Unless set otherwise, these follow the period: the board's [`watchdog`](Self::watchdog), and
    /// the deadline of a reply, which is 80 % of the period.
    #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::seconds"))]
    pub period: Duration,
    /// The source of the cycle's timing; the host by default.
    pub pace: Pace,
    /// The time without a write after which the board's watchdog bites. `None`, the default: five
    /// periods, and at least 5 ms. The watchdog runs from the first write on.
    ///
    /// Less than two periods are refused, because a single lost write must not cause a bite; more
    /// than 4.29 s are refused too.
    #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::some_seconds"))]
    pub watchdog: Option<Duration>,
    /// The channels of serial ports in use and their configuration, by the number of the port.
    ///
    /// A port without an entry uses the default: any remotes, in mode 0. A port that the firmware
    /// does not have is refused.
    pub serial_ports: BTreeMap<u8, SerialConfig>,
    /// Number of instances in use of each kind of module, the first ones; a kind without an entry
    /// is used with all its instances. The I/O pins of the others are plain I/O. A number beyond
    /// that of the firmware is refused.
    ///
    /// The keys, in a file with LinuxCNC's names: [`Gtag::ENCODER`] (`encoder`) counts encoders of
    /// both kinds together, [`Gtag::SSERIAL`] (`sserial`) serial ports, [`Gtag::LED`] (`led`) LEDs;
    /// further ones are [`Gtag::PWM`] (`pwmgen`), [`Gtag::STEPGEN`] (`stepgen`), [`Gtag::IN_MUX`]
    /// (`inmux`), [`Gtag::IN_M`] (`inm`), [`Gtag::SSR`] (`ssr`) and [`Gtag::OUT_M`] (`outm`). With
    /// 0 of [`Gtag::HM2DPLL`] (`dpll`) the phase-locked loop is left alone: for a period that it
    /// cannot follow.
    ///
    /// ```
    /// use mesa_hal::Settings;
    /// use mesa_hal::hostmot2::Gtag;
    ///
    /// let settings = Settings {
    ///     instances: [(Gtag::ENCODER, 4), (Gtag::HM2DPLL, 0)].into(),
    ///     ..Settings::default()
    /// };
    /// # let _ = settings;
    /// ```
    #[cfg_attr(feature = "serde", serde(with = "crate::serial_form::instances"))]
    pub instances: BTreeMap<Gtag, u8>,
    /// Limits at which remotes go offline, and their recovery.
    pub fault_policy: FaultPolicy,
    /// Rate of the multiplexer or of the filters of all encoders, at the slowest
    /// [`TickRate::SLOWEST`]; `None` for the rate of the board's table, or of LinuxCNC: see
    /// [`defaults`](Self::defaults).
    pub encoder_rate: Option<TickRate>,
    /// The PWM frequency of all generators in Hz. `None`, the default, is the board's usual
    /// frequency: on a 7I97 48 kHz, or 96 kHz with dither where the firmware has it (75 kHz on a
    /// 7I97T); else, and with [`Defaults::LinuxCnc`], 20 kHz. A frequency that the firmware's clock
    /// does not allow is refused.
    pub pwm_hz: Option<u32>,
    /// Initial parameters of PWM generators, by their number. Generators without an entry begin as
    /// the board needs them if they drive its analog outputs, and else, or with
    /// [`Defaults::LinuxCnc`], with LinuxCNC's values: sign and magnitude, scale 1. A generator
    /// that the firmware does not have is refused.
    pub pwm: BTreeMap<u8, PwmConfig>,
    /// Number of outputs of a step generator in use, the first ones: 2 by default, step and
    /// direction. Further outputs of the firmware, for tables, are plain I/O.
    pub stepgen_width: u8,
    /// Initial state of I/O pins that no module uses, by their number. Pins without an entry are
    /// inputs.
    pub gpio: Vec<(u16, GpioConfig)>,
    /// The number of consecutive failed reads or writes that makes everything safe; at least 1, and
    /// 5 by default.
    ///
    /// Fewer consecutive failures are enough if others happened shortly before: failures are
    /// counted as in LinuxCNC, on the pin `packet-error-level`. A failure adds
    /// `packet-error-increment` (2), a successful read subtracts `packet-error-decrement` (1), and
    /// `packet-error-limit` is set to this number of increments: 10.
    pub bus_error_limit: u32,
    /// Number of [events](crate::driver::Driver::events) that are kept until they are taken,
    /// rounded up to a power of two; 255 by default. Each takes 28 bytes.
    pub event_room: u16,
    /// Kinds of boards that this crate does not know. They take precedence over the built-in ones.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub boards: Vec<&'static BoardTable>,
    /// Kinds of remotes that this crate does not know, with their terminals, units and safe values.
    /// They take precedence over the built-in ones.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub remotes: Vec<&'static RemoteTable>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            board_number: 0,
            defaults: Defaults::default(),
            period: Duration::from_millis(1),
            pace: Pace::default(),
            watchdog: None,
            serial_ports: BTreeMap::new(),
            instances: BTreeMap::new(),
            fault_policy: FaultPolicy::default(),
            encoder_rate: None,
            pwm_hz: None,
            pwm: BTreeMap::new(),
            stepgen_width: 2,
            gpio: Vec::new(),
            bus_error_limit: 5,
            event_room: 255,
            boards: Vec::new(),
            remotes: Vec::new(),
        }
    }
}

impl Settings {
    /// Returns the time after which the board's watchdog bites: the one that is set, or else five
    /// periods, and at least 5 ms.
    pub fn watchdog_time(&self) -> Duration {
        self.watchdog
            .unwrap_or_else(|| usual_watchdog_time(self.period))
    }

    /// Number of instances of the kind of this module that are used; `None` for all.
    pub(crate) fn limit(&self, gtag: Gtag) -> Option<u8> {
        let key = CountedKind::of(gtag)?.key();
        self.instances.get(&key).copied()
    }
}

/// The time of a watchdog that follows from a period: five periods, and at least 5 ms.
pub(crate) fn usual_watchdog_time(period: Duration) -> Duration {
    period.saturating_mul(5).max(SHORTEST_USUAL_WATCHDOG)
}

/// The shortest time of a watchdog that follows from a period: the usual one of LinuxCNC.
pub(crate) const SHORTEST_USUAL_WATCHDOG: Duration = Duration::from_millis(5);

/// The source of the initial values of pins and parameters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
pub enum Defaults {
    /// The manual of the board: values that fit its outputs and the encoders of its connectors.
    #[default]
    Board,
    /// A fresh load of LinuxCNC's driver: a HAL file that does not set a value means this one. All
    /// I/O pins have their level, those that modules drive as well (`gpio.NNN.in` and `in_not`),
    /// and parameters of pins that modules drive have a [second name](crate::hal::Pins::aliases).
    ///
    /// | name | `LinuxCnc` | `Board` |
    /// |---|---|---|
    /// | `pwmgen.NN.scale` | 1 | 10 for the analog outputs of a 7I97 |
    /// | `pwmgen.NN.offset-mode` | FALSE | TRUE for these outputs |
    /// | `pwmgen.NN.dither` | FALSE | TRUE, in firmware that has it |
    /// | `pwmgen.pwm_frequency` | 20000 | 48000 on a 7I97, 96000 or 75000 with dither |
    /// | `encoder.NN.filter` | TRUE | FALSE for multiplexed encoders |
    /// | `encoder.muxed-sample-frequency` | about 8 MHz | the rate in the manual of board or card |
    /// | `encoder.sample-frequency` | about 25 MHz | the same |
    /// | `dpll.base-freq-khz` | -1, which is that of the period | that of the period |
    LinuxCnc,
}

/// Initial parameters of a PWM generator. `None` is the value that the board needs, or LinuxCNC's.
///
/// ```
/// use mesa_hal::Settings;
/// use mesa_hal::driver::PwmConfig;
///
/// // Generator 6, on an expansion connector: a spindle of 24000 rpm with a direction pin.
/// let spindle = PwmConfig {
///     scale: Some(24_000.0),
///     ..PwmConfig::default()
/// };
/// let settings = Settings {
///     pwm: [(6, spindle)].into(),
///     ..Settings::default()
/// };
/// # let _ = settings;
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct PwmConfig {
    /// The parameter [`output-type`](crate::modules::pwm::PwmPins::output_type).
    pub output_type: Option<i32>,
    /// The parameter [`offset-mode`](crate::modules::pwm::PwmPins::offset_mode): with it the pin
    /// is high half of the time while the value is 0 and while the generator is not enabled.
    pub offset_mode: Option<bool>,
    /// The parameter [`scale`](crate::modules::pwm::PwmPins::scale): the value at full scale. Its
    /// magnitude is also the limit of the value.
    pub scale: Option<f64>,
}

/// The source of the cycle's timing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum Pace {
    /// The application, which waits for its own period, then calls [`Driver::read`]. A DPLL on the
    /// board follows these reads; [`CycleReport::locked`] is true when it does.
    ///
    /// [`CycleReport::locked`]: crate::driver::CycleReport::locked
    /// [`Driver::read`]: crate::driver::Driver::read
    #[default]
    Host,
    /// The board's clock. [`Driver::write`] asks for the next inputs at once, the board holds the
    /// request back until its DPLL begins the next period, and [`Driver::read`] returns when the
    /// inputs have arrived: the application needs no wait of its own.
    ///
    /// The board's clock samples the inputs, independent of the host's scheduler, and the cycle is
    /// cheaper with one timer less on the host. Needs a bus with this function (Ethernet), and a
    /// firmware with a DPLL, which then runs free. [`Driver::wait_transfers`] does not wait in
    /// such a cycle.
    ///
    /// A host that is late misses the beginning of a period, and gets the next one:
    /// [`CycleReport::missed_periods`]. [`CycleReport::slack`] is the rest of the period.
    /// [`CycleReport::unpaced`] indicates a clock that stands still, or that was set to another
    /// frequency than the driver was built for. When the host has kept pace for 120 periods,
    /// [`CycleReport::locked`] is true.
    ///
    /// A cycle is one packet out and one back: its reply acknowledges its own writes. When a
    /// setting has changed, a cycle is two packets out: the setting is written ahead together with
    /// all outputs. The first read, with no write before it, is held back alone. After two
    /// consecutive failed reads, outputs are written alone and nothing is held back until a read
    /// succeeds: otherwise the packets that a stalled network delivers at once would queue up in
    /// the board.
    ///
    /// Manual: 7I97, "SPACE 4 LBP TIMER/UTILITY AREA", WaitForHM2RefTime.
    ///
    /// [`CycleReport::locked`]: crate::driver::CycleReport::locked
    /// [`CycleReport::missed_periods`]: crate::driver::CycleReport::missed_periods
    /// [`CycleReport::slack`]: crate::driver::CycleReport::slack
    /// [`CycleReport::unpaced`]: crate::driver::CycleReport::unpaced
    /// [`Driver::read`]: crate::driver::Driver::read
    /// [`Driver::wait_transfers`]: crate::driver::Driver::wait_transfers
    /// [`Driver::write`]: crate::driver::Driver::write
    Board,
}

/// The channels of a serial port in use, and their configuration.
///
/// Can be parsed from the value of LinuxCNC's `sserial_port_0=`: a digit for each channel, its
/// software mode, or `x` for an unused channel. Channels beyond the end of the text are used in
/// mode 0. The I/O pins of an unused channel (RX, TX, TXEN) are plain I/O pins.
///
/// ```
/// use mesa_hal::boards::i7i77;
/// use mesa_hal::driver::{Presence, RemoteConfig, SerialConfig};
///
/// let mut port: SerialConfig = "20xxxxxx".parse()?;
/// assert_eq!(port.channels[&0].mode, 2);
/// assert_eq!(port.channels.get(&2), None);
/// let analog = RemoteConfig {
///     kind: Some(&i7i77::ANALOG),
///     presence: Presence::Required,
///     ..RemoteConfig::default()
/// };
/// port.channels.insert(1, analog);
/// # Ok::<(), mesa_hal::ParseError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct SerialConfig {
    /// The channels in use, 0 to 7. Other numbers are refused at the start.
    pub channels: BTreeMap<u8, RemoteConfig>,
}

impl Default for SerialConfig {
    /// All channels, in mode 0, none of them required.
    fn default() -> Self {
        let channels = (0..MAX_CHANNELS).map(|channel| (channel, RemoteConfig::default()));
        Self {
            channels: channels.collect(),
        }
    }
}

/// The expected remote on a channel. By default any remote, or none, is accepted; it is started in
/// software mode 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct RemoteConfig {
    /// The software mode in which the remote is started.
    pub mode: u8,
    /// Handling of an absent or different remote.
    pub presence: Presence,
    /// The required kind: name and part of the card, which distinguishes parts of a card that share
    /// a name, as a 7I77's field I/O and analog part do. Swapped channels are then reported as
    /// such. `None`: any kind.
    #[cfg_attr(
        feature = "serde",
        serde(deserialize_with = "crate::serial_form::kind::deserialize")
    )]
    pub kind: Option<&'static RemoteTable>,
    /// The required unit number, which is printed on the card's label.
    pub unit_number: Option<u32>,
}

/// Handling of a remote that is absent at the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum Presence {
    /// The rest runs, and the remote is reported as missing. One that was found, and does not run,
    /// is offline: with all its pins, not valid, and tried again.
    #[default]
    Any,
    /// The driver does not start: the machine cannot do without the remote. One that is there and
    /// reports a fault, such as missing field power, is offline as with [`Any`](Self::Any).
    Required,
    /// The pins of the remote are made from the table of its kind, invalid and with safe outputs.
    /// The remote comes up when it is plugged in later, and then waits to be armed.
    ///
    /// A remote that is plugged in must match the table: name, part of the card, size of the
    /// process data, and the position of its tables of contents if the table contains it; and it
    /// must have the unit number, if one is given. Any other remote stays offline, with the
    /// expected and found values in the reason. Another firmware with process data of the same size
    /// is detected only by the position of its tables, which the built-in tables do not contain: if
    /// its data may have another meaning, use a table of your own with
    /// [`TableAddresses`](crate::discovery::TableAddresses). Parameters of the remote have no pins.
    Optional,
}

/// `host` or `board`, as on a command line.
impl FromStr for Pace {
    type Err = ParseError;

    fn from_str(text: &str) -> Result<Self, ParseError> {
        match text {
            "host" => Ok(Self::Host),
            "board" => Ok(Self::Board),
            _ => Err(ParseError {
                what: "pace",
                found: text.into(),
                expected: "'host' or 'board'",
            }),
        }
    }
}

impl FromStr for SerialConfig {
    type Err = ParseError;

    fn from_str(text: &str) -> Result<Self, ParseError> {
        let mut config = Self::default();
        for (channel, character) in (0..).zip(text.chars()) {
            let remote = config.channels.get_mut(&channel);
            match (remote, character, character.to_digit(10)) {
                (Some(_), 'x' | 'X', _) => drop(config.channels.remove(&channel)),
                (Some(remote), _, Some(digit)) => remote.mode = digit as u8,
                _ => {
                    return Err(ParseError {
                        what: "channels of a serial port",
                        found: text.into(),
                        expected: "up to 8 characters, one a channel: its software mode (0 to 9), or x if it is not used",
                    });
                }
            }
        }
        Ok(config)
    }
}

#[cfg(test)]
mod tests;

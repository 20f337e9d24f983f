//! The remote model of the gateware transcripts, set up by its `key=value` lines.

use thiserror::Error;

use super::{FixedData, MAX_MODES, SimRemote, SimRemoteConfig};
use crate::wire::Nanos;
use mesa_wire::lbp::{DiscoveryReply, LbpStatus, RemoteFaults};

/// An error in a line for the remote model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ModelError {
    /// A word is not of the form `key=value`.
    #[error("word {word} of the line is no key=value")]
    NotAPair {
        /// Index of the word, from 1.
        word: usize,
    },
    /// An unknown key.
    #[error("word {word} of the line has a key that the remote model does not know")]
    UnknownKey {
        /// Index of the word, from 1.
        word: usize,
    },
    /// The value does not fit its key.
    #[error("word {word} of the line has a value that does not fit its key")]
    BadValue {
        /// Index of the word, from 1.
        word: usize,
    },
    /// `mem` or `nvm` without address and bytes.
    #[error("mem and nvm take an address and hexadecimal bytes")]
    BadMemory,
}

impl SimRemote<FixedData> {
    /// An absent remote; [`apply`](Self::apply) configures it.
    pub fn model() -> Self {
        let config = SimRemoteConfig {
            present: false,
            ..SimRemoteConfig::default()
        };
        Self::new(config, FixedData::default())
    }

    /// Configures the model from a line: `mem <address> <hex>`, `nvm <address> <hex>`, or
    /// `key=value` pairs. An invalid line changes nothing.
    pub fn apply(&mut self, line: &str) -> Result<(), ModelError> {
        let mut words = line.split_whitespace();
        if let Some(which @ ("mem" | "nvm")) = words.next() {
            let (address, bytes) = (words.next(), words.next());
            let bad = ModelError::BadMemory;
            if words.next().is_some() {
                return Err(bad);
            }
            let address = address.and_then(number).ok_or(bad)?;
            let address = u16::try_from(address).map_err(|_| bad)?;
            let bytes = bytes.and_then(hex).ok_or(bad)?;
            self.load(which == "nvm", address, &bytes);
            return Ok(());
        }
        for pass in [Pass::Check, Pass::Apply] {
            for (word, pair) in line.split_whitespace().enumerate() {
                self.pair(pass, word + 1, pair)?;
            }
        }
        Ok(())
    }

    fn load(&mut self, nonvolatile: bool, address: u16, bytes: &[u8]) {
        if nonvolatile {
            self.eeprom.cells_mut().load(address, bytes);
        } else {
            self.memory.load(address, bytes);
            self.config.image.load(address, bytes);
        }
    }

    fn pair(&mut self, pass: Pass, word: usize, pair: &str) -> Result<(), ModelError> {
        let (key, value) = pair.split_once('=').ok_or(ModelError::NotAPair { word })?;
        let setting = setting(key, value).map_err(|refusal| match refusal {
            Refusal::Key => ModelError::UnknownKey { word },
            Refusal::Value => ModelError::BadValue { word },
        })?;
        if pass == Pass::Apply {
            self.set(setting);
        }
        Ok(())
    }

    fn set(&mut self, setting: Setting) {
        let faults = &mut self.reply_faults;
        match setting {
            Setting::Config(change) => change.apply(&mut self.config),
            Setting::Bit(bit) => self.configure(|config| config.bit = bit),
            Setting::Inputs(data) => self.application.set_inputs(&data),
            Setting::Fault(value) => {
                self.state.faults = RemoteFaults::from_bits_retain(value);
            }
            Setting::Status(value) => {
                self.state.status = LbpStatus::from_bits_retain(value);
                self.config.initial_status = self.state.status;
            }
            Setting::Drop(n) => faults.drop = n,
            Setting::BadCrc(n) => faults.bad_crc = n,
            Setting::Extra(n) => faults.extra = n,
            Setting::Short(n) => faults.short = n,
            Setting::Late(time) => faults.late = time,
            Setting::Break(n) => faults.breaks = n,
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Pass {
    Check,
    Apply,
}

enum Setting {
    Config(Change),
    Bit(Nanos),
    Inputs(Vec<u8>),
    Fault(u8),
    Status(u8),
    Drop(u32),
    BadCrc(u32),
    Extra(u32),
    Short(u32),
    Late(Option<Nanos>),
    Break(u32),
}

enum Change {
    Present(bool),
    Name([u8; 4]),
    Unit(u32),
    Mode(usize, DiscoveryReply),
    Latency(Nanos),
    Watchdog(Nanos),
    ClearDelay(u32),
    StuckFault(u8),
    Cookie(u8),
    StatusStuck(bool),
    NoUnitNumber(bool),
    NoDiscovery(bool),
    IdlesLow(bool),
}

impl Change {
    fn apply(self, config: &mut SimRemoteConfig) {
        match self {
            Self::Present(value) => config.present = value,
            Self::Name(value) => config.name = value,
            Self::Unit(value) => config.unit_number = value,
            Self::Mode(mode, value) => {
                if let Some(slot) = config.modes.get_mut(mode) {
                    *slot = Some(value);
                }
            }
            Self::Latency(value) => config.latency = value,
            Self::Watchdog(value) => config.watchdog = value,
            Self::ClearDelay(value) => config.clear_delay = value,
            Self::StuckFault(value) => {
                config.stuck_faults = RemoteFaults::from_bits_retain(value);
            }
            Self::Cookie(value) => config.cookie = value,
            Self::StatusStuck(value) => config.status_stuck = value,
            Self::NoUnitNumber(value) => config.no_unit_number = value,
            Self::NoDiscovery(value) => config.no_discovery = value,
            Self::IdlesLow(value) => config.idles_low = value,
        }
    }
}

enum Refusal {
    Key,
    Value,
}

fn setting(key: &str, value: &str) -> Result<Setting, Refusal> {
    let bad = || Refusal::Value;
    let flag = || number(value).map(|n| n != 0).ok_or_else(bad);
    let count = || {
        let count = number(value).and_then(|n| u32::try_from(n).ok());
        count.ok_or_else(bad)
    };
    let byte = || count().and_then(|n| u8::try_from(n).map_err(|_| bad()));
    let time = |unit| duration(value, unit).ok_or_else(bad);
    let bit = || duration(value, 10.0).filter(|&bit| bit > 0).ok_or_else(bad);
    let config = match key {
        "in" => return hex(value).map(Setting::Inputs).ok_or_else(bad),
        "fault" => return byte().map(Setting::Fault),
        "lbpstatus" => return byte().map(Setting::Status),
        "bit" => return bit().map(Setting::Bit),
        "drop" => return count().map(Setting::Drop),
        "badcrc" => return count().map(Setting::BadCrc),
        "extra" => return count().map(Setting::Extra),
        "short" => return count().map(Setting::Short),
        "late" => return time(1e3).map(|late| Setting::Late(Some(late).filter(|&t| t > 0))),
        "brk" => return count().map(Setting::Break),
        "present" => Change::Present(flag()?),
        "name" => Change::Name(name(value).ok_or_else(bad)?),
        "unit" => Change::Unit(count()?),
        "lat" => Change::Latency(time(1e3)?),
        "wd" => Change::Watchdog(time(1e6)?),
        "clrdelay" => Change::ClearDelay(count()?),
        "stuckfault" => Change::StuckFault(byte()?),
        "cookie" => Change::Cookie(byte()?),
        "ststuck" => Change::StatusStuck(flag()?),
        "nobc" => Change::NoUnitNumber(flag()?),
        "nobb" => Change::NoDiscovery(flag()?),
        "idle" => Change::IdlesLow(!flag()?),
        _ => match key.strip_prefix("mode").map(str::parse::<usize>) {
            Some(Ok(mode)) if mode < MAX_MODES => {
                Change::Mode(mode, discovery(value).ok_or_else(bad)?)
            }
            _ => return Err(Refusal::Key),
        },
    };
    Ok(Setting::Config(config))
}

fn discovery(value: &str) -> Option<DiscoveryReply> {
    let mut numbers = value.split(',').map(number);
    let mut next = || numbers.next().flatten();
    let reply = DiscoveryReply {
        rx_size: u8::try_from(next()?).ok()?,
        tx_size: u8::try_from(next()?).ok()?,
        ptoc: u16::try_from(next()?).ok()?,
        gtoc: u16::try_from(next()?).ok()?,
    };
    numbers.next().is_none().then_some(reply)
}

fn name(value: &str) -> Option<[u8; 4]> {
    value.as_bytes().try_into().ok()
}

/// A decimal number, or a hexadecimal one after `0x`.
fn number(text: &str) -> Option<u64> {
    match text.strip_prefix("0x").or(text.strip_prefix("0X")) {
        Some(hex) => u64::from_str_radix(hex, 16).ok(),
        None => text.parse().ok(),
    }
}

/// A time in units of `unit` nanoseconds, with or without a fraction.
fn duration(text: &str, unit: f64) -> Option<Nanos> {
    let value: f64 = text.parse().ok()?;
    (0.0..1e9)
        .contains(&value)
        .then(|| (value * unit).round() as Nanos)
}

fn hex(text: &str) -> Option<Vec<u8>> {
    let digits: Option<Vec<u8>> = text
        .chars()
        .map(|c| c.to_digit(16).map(|digit| digit as u8))
        .collect();
    let digits = digits.filter(|digits| digits.len().is_multiple_of(2))?;
    let pairs = digits.chunks_exact(2);
    Some(
        pairs
            .map(|pair| pair.iter().fold(0, |byte, digit| byte << 4 | digit))
            .collect(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn all_keys_of_the_remote_model_are_understood() {
        let mut remote = SimRemote::model();
        for line in [
            "mem 0x0020 aa77000032000900",
            "nvm 0x0024 32000900",
            "present=1 name=7I77 unit=0x77aa mode0=5,2,0x49a,0x4a4 mode3=12,2,0x88e,0x8a6 lat=2",
            "in=0102 fault=0x20 wd=50 bit=868 clrdelay=3 stuckfault=0x40 cookie=0xA5",
            "lbpstatus=1 ststuck=1 nobc=1 nobb=1 idle=0",
            "drop=1 badcrc=3 extra=2 short=1 late=90 brk=1",
        ] {
            assert_eq!(remote.apply(line), Ok(()), "{line}");
        }
        assert_eq!(remote.memory().word(0x20, 4), 0x77AA);
        assert_eq!(remote.eeprom().cells().byte(0x24), 0x32);
        assert_eq!(remote.config().mode(3).unwrap().rx_size, 12);
        assert_eq!(remote.config().bit, 8_680);
        assert_eq!(remote.config().watchdog, 50_000_000);
        assert_eq!(remote.reply_faults().late, Some(90_000));
    }

    #[test]
    fn line_that_is_not_understood_changes_nothing() {
        let mut remote = SimRemote::model();
        assert_eq!(
            remote.apply("present=1 colour=red"),
            Err(ModelError::UnknownKey { word: 2 })
        );
        assert!(!remote.config().present);
        assert!(remote.apply("mem 0x10").is_err());
        assert!(remote.apply("mode99=1,2,3,4").is_err());
        assert!(remote.apply("mode0=1,2,3").is_err());
        assert!(remote.apply("in=123").is_err());
    }

    proptest! {
        #[test]
        fn arbitrary_lines_never_panic(line in ".{0,60}") {
            let _ = SimRemote::model().apply(&line);
        }
    }
}

//! The words of LinuxCNC's `config=`.
//!
//! Source: manual page hostmot2(9), "config modparam"; LinuxCNC's driver (2.9 and later) for what
//! the page leaves open.

use mesa_hal::driver::Defaults;
use mesa_hal::hostmot2::{CountedKind, Gtag, HostMot2};
use mesa_hal::sslbp::MAX_CHANNELS;
use mesa_hal::{ParseError, SerialConfig, Settings};
use thiserror::Error;

/// A kind of modules that this driver does not have: the beginning of its words, what it is called,
/// and the tags of its modules.
#[derive(Debug)]
struct NotDriven {
    word: &'static str,
    what: &'static str,
    gtags: &'static [Gtag],
}

const fn not_driven(word: &'static str, what: &'static str, gtags: &'static [Gtag]) -> NotDriven {
    NotDriven { word, what, gtags }
}

/// Words that count instances of other modules. 0 and -1 ask for none of them.
const NOT_DRIVEN: [NotDriven; 9] = [
    not_driven("num_resolvers", "resolvers", &[Gtag::RESOLVER]),
    not_driven(
        "num_3pwmgens",
        "three-phase PWM generators",
        &[Gtag::THREE_PHASE_PWM],
    ),
    not_driven("num_rcpwmgens", "RC servo generators", &[Gtag::RC_PWM]),
    not_driven("num_bspis", "buffered SPI", &[Gtag::BUFFERED_SPI]),
    not_driven("num_uarts", "UARTs", &[Gtag::UART_TX, Gtag::UART_RX]),
    not_driven(
        "num_pktuarts",
        "packet UARTs",
        &[Gtag::PACKET_UART_TX, Gtag::PACKET_UART_RX],
    ),
    not_driven("num_xy2mods", "galvanometer interfaces", &[Gtag::XY2_MOD]),
    not_driven("num_oneshots", "one-shots", &[Gtag::ONE_SHOT]),
    not_driven("num_periodms", "period measurement", &[Gtag::PERIOD]),
];

/// Beginnings of words that set up absolute encoders.
const ABSOLUTE: [NotDriven; 3] = [
    not_driven("ssi_chan_", "absolute encoders (SSI)", &[Gtag::SSI]),
    not_driven("biss_chan_", "absolute encoders (BiSS)", &[Gtag::BISS]),
    not_driven("fanuc_chan_", "absolute encoders (Fanuc)", &[Gtag::FABS]),
];

/// A word that asks for modules that the driver does not have.
#[derive(Clone, Debug, PartialEq, Eq)]
struct UndrivenWord {
    word: String,
    /// The name of the modules, in the plural.
    what: &'static str,
    gtags: &'static [Gtag],
}

/// Error in the words of `config=`.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ConfigError {
    /// A word is unknown, or cannot have its meaning here.
    #[error("hostmot2 configuration word '{}': expected {expected}", ParseError::shortened(.word))]
    Word {
        /// The word.
        word: String,
        /// The valid words or values.
        expected: &'static str,
    },
    /// The modes of a serial port.
    #[error(transparent)]
    Modes(#[from] ParseError),
    /// A word asks for modules of the firmware that the driver does not have.
    #[error(
        "hostmot2 configuration word '{word}': the firmware has {what} ({gtag}), which this driver does not drive; without the word the \
         board is loaded and their pins are plain I/O; LinuxCNC's own driver (hm2_eth, hm2_pci) drives them"
    )]
    Undriven {
        /// The word.
        word: String,
        /// The name of the modules, in the plural.
        what: &'static str,
        /// The tag of the first module of the firmware that the word asks for.
        gtag: Gtag,
    },
}

/// All words, for an unknown one.
const KNOWN: &str = "one of num_encoders, num_pwmgens, num_stepgens, num_dplls, num_inmuxs, num_inms, \
     num_ssrs, num_outms, num_leds, sserial_port_0 to sserial_port_3, stepgen_width, firmware, and for modules \
     that this driver does not have num_resolvers, num_3pwmgens, num_rcpwmgens, num_bspis, num_uarts, \
     num_pktuarts, num_xy2mods, num_oneshots, num_periodms, ssi_chan_N, biss_chan_N and fanuc_chan_N, each \
     with = and a value";

/// The value of `sserial_port_N`.
const MODES: &str =
    "a character for each channel: its software mode (0 to 9), or x if it is not used";

/// Ports that words can name.
const PORTS: usize = 4;

/// Outputs of a step generator at most.
const MAX_WIDTH: u8 = 8;

/// Mode of a channel that is not named, as in the words.
const MODE_0: u8 = b'0';
/// The mode of a channel that is not used.
const UNUSED: u8 = b'x';

/// The value of `config=` for one board.
#[derive(Clone, Debug)]
pub struct Config {
    /// The settings of the driver.
    pub settings: Settings,
    /// The value of `firmware=`.
    firmware: Option<String>,
    undriven: Vec<UndrivenWord>,
}

impl Config {
    /// Parses the value of `config=` of LinuxCNC's `loadrt hm2_eth` for one board, so that the same
    /// words have the same meaning: the words are separated by spaces, upper and lower case differ,
    /// and the last of several equal words counts.
    ///
    /// | word | meaning |
    /// |---|---|
    /// | `num_encoders=N`, `num_pwmgens=N`, `num_stepgens=N`, `num_inmuxs=N`, `num_inms=N`, `num_ssrs=N`, `num_outms=N`, `num_leds=N` | number of [instances](Settings::instances) in use; -1 for all |
    /// | `num_dplls=0` | the phase-locked loop is left alone |
    /// | `sserial_port_N=MODES` | as [`SerialConfig`]; characters after the eighth have no channel; ports behind the last one with a mode are not used |
    /// | `num_resolvers=N` and others of modules that this driver does not have | [refused](Self::check) if the firmware has such modules, unless N is 0 or -1; else nothing |
    /// | `ssi_chan_N=`, `biss_chan_N=`, `fanuc_chan_N=` | the same: absolute encoders are not driven |
    /// | `stepgen_width=N` | [number of outputs](Settings::stepgen_width) of a step generator |
    /// | `firmware=F` | nothing, with a line at the load: the board has its firmware |
    /// | `enable_raw` | refused: there are no pins `raw.*`, which read and write any register |
    ///
    /// The values of pins and parameters are [those of LinuxCNC](Defaults::LinuxCnc), without any
    /// word as well. A number beyond that of the firmware is refused when the board is identified,
    /// except, as in LinuxCNC, for a module that the firmware does not have, LEDs, and the
    /// phase-locked loop.
    ///
    /// # Errors
    /// [`ConfigError::Word`] with the word that is unknown, or that cannot have its meaning here.
    pub fn parse(config: &str) -> Result<Self, ConfigError> {
        let mut parsed = Self {
            settings: Settings {
                defaults: Defaults::LinuxCnc,
                ..Settings::default()
            },
            firmware: None,
            undriven: Vec::new(),
        };
        let mut ports = PortModes::default();
        for word in config.split_ascii_whitespace() {
            parsed.take_word(word, &mut ports)?;
        }
        ports.put(&mut parsed.settings)?;
        Ok(parsed)
    }

    /// The value of `firmware=`. The driver does not load it.
    pub fn firmware(&self) -> Option<&str> {
        self.firmware.as_deref()
    }

    /// Refuses words for modules that the firmware has and the driver does not drive. Where the
    /// firmware has none, the words have no effect, as in LinuxCNC.
    ///
    /// # Errors
    /// [`ConfigError::Undriven`] with the first such word.
    pub fn check(&self, firmware: &HostMot2) -> Result<(), ConfigError> {
        for UndrivenWord { word, what, gtags } in &self.undriven {
            let modules = firmware.modules.iter();
            let mut present = modules.filter(|module| module.instances > 0);
            if let Some(module) = present.find(|module| gtags.contains(&module.gtag)) {
                return Err(ConfigError::Undriven {
                    word: word.clone(),
                    what,
                    gtag: module.gtag,
                });
            }
        }
        Ok(())
    }

    fn take_word(&mut self, word: &str, ports: &mut PortModes) -> Result<(), ConfigError> {
        let refuse = |expected| Err(refused(word, expected));
        if let Some(kind) = ABSOLUTE.iter().find(|kind| word.starts_with(kind.word)) {
            self.note(word, kind);
            return Ok(());
        }
        if word.starts_with("enable_raw") {
            return refuse(
                "no raw access, for which this driver has no pins `raw.*`: leave the word out; `mesa peek \
                 --passive` reads registers",
            );
        }
        let Some((name, value)) = word.split_once('=') else {
            return refuse(KNOWN);
        };
        if let Some(port) = name.strip_prefix("sserial_port_") {
            return ports.take(word, port, value);
        }
        if name == "firmware" {
            self.firmware = Some(value.into());
            return Ok(());
        }
        let number = number(value);
        if name == "stepgen_width" {
            let width = number.and_then(|width| u8::try_from(width).ok());
            let Some(width) = width.filter(|width| *width <= MAX_WIDTH) else {
                return refuse("a number from 0 to 8, the outputs that a step generator can have");
            };
            self.settings.stepgen_width = width;
            return Ok(());
        }
        if let Some(kind) = NOT_DRIVEN.iter().find(|kind| kind.word == name) {
            match number {
                None => return refuse("a number from 0 to 255, or -1 for all"),
                Some(-1 | 0) => {}
                Some(_) => self.note(word, kind),
            }
            return Ok(());
        }
        let Some(kind) = CountedKind::counted_by(name) else {
            return refuse(KNOWN);
        };
        let instances = &mut self.settings.instances;
        match (number, number.map(u8::try_from)) {
            (Some(-1), _) => drop(instances.remove(&kind.key())),
            (_, Some(Ok(count))) => drop(instances.insert(kind.key(), count)),
            _ => return refuse("a number from 0 to 255, or -1 for all"),
        }
        Ok(())
    }

    /// Notes a word for modules that this driver does not have.
    fn note(&mut self, word: &str, kind: &NotDriven) {
        self.undriven.push(UndrivenWord {
            word: word.into(),
            what: kind.what,
            gtags: kind.gtags,
        });
    }
}

/// The modes of the channels of all serial ports, as characters. A later word replaces the
/// characters of an earlier one as far as it reaches.
#[derive(Debug, Default)]
struct PortModes {
    /// By port; `None` if it is not named.
    modes: [Option<[u8; MAX_CHANNELS as usize]>; PORTS],
    /// Number of ports in use: up to the last one of which a word had a mode. `None` without a
    /// word, for all ports.
    used: Option<u8>,
}

impl PortModes {
    fn take(&mut self, word: &str, port: &str, value: &str) -> Result<(), ConfigError> {
        let number = port.parse::<u8>().ok().filter(|_| port.len() == 1);
        let modes = number.and_then(|port| Some((port, self.modes.get_mut(usize::from(port))?)));
        let Some((port, modes)) = modes else {
            return Err(refused(word, "sserial_port_0 to sserial_port_3"));
        };
        // LinuxCNC skips other characters, so that those behind them move to another channel.
        let is_mode = |mode: u8| mode.is_ascii_digit() || mode.eq_ignore_ascii_case(&UNUSED);
        if !value.bytes().all(is_mode) {
            return Err(refused(word, MODES));
        }
        // Characters without a channel mean nothing.
        let channels = value.bytes().take(MAX_CHANNELS.into());
        let channels = channels.map(|mode| mode.to_ascii_lowercase());
        let modes = modes.get_or_insert([MODE_0; MAX_CHANNELS as usize]);
        for (mode, new) in modes.iter_mut().zip(channels.clone()) {
            *mode = new;
        }
        let used = self.used.get_or_insert(0);
        if channels.into_iter().any(|mode| mode != UNUSED) {
            *used = (*used).max(port.saturating_add(1));
        }
        Ok(())
    }

    /// Sets the ports up, and leaves those behind the last one with a mode unused.
    fn put(self, settings: &mut Settings) -> Result<(), ConfigError> {
        let Some(used) = self.used else {
            return Ok(());
        };
        settings.instances.insert(Gtag::SSERIAL, used);
        for (port, modes) in (0..used).zip(self.modes) {
            if let Some(modes) = modes {
                let modes: String = modes.into_iter().map(char::from).collect();
                settings
                    .serial_ports
                    .insert(port, modes.parse::<SerialConfig>()?);
            }
        }
        Ok(())
    }
}

/// Parses a number as C does: decimal, octal after `0`, hexadecimal after `0x`.
fn number(text: &str) -> Option<i64> {
    let (is_negative, digits) = match text.strip_prefix('-') {
        Some(digits) => (true, digits),
        None => (false, text),
    };
    let hexadecimal = digits.strip_prefix("0x").or(digits.strip_prefix("0X"));
    let (digits, radix) = match (hexadecimal, digits.strip_prefix('0')) {
        (Some(digits), _) => (digits, 16),
        (None, Some(octal)) if !octal.is_empty() => (octal, 8),
        _ => (digits, 10),
    };
    // A second sign is none.
    let is_digit = |digit: char| digit.is_digit(radix);
    let number = i64::from(u32::from_str_radix(digits, radix).ok()?);
    let number = if is_negative {
        number.saturating_neg()
    } else {
        number
    };
    digits.chars().all(is_digit).then_some(number)
}

fn refused(word: &str, expected: &'static str) -> ConfigError {
    let word = word.into();
    ConfigError::Word { word, expected }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn parsed(config: &str) -> Settings {
        let parsed = Config::parse(config).unwrap_or_else(|error| panic!("{error}"));
        parsed.settings
    }

    /// The word that an error names.
    fn named(error: &ConfigError) -> Option<&str> {
        match error {
            ConfigError::Word { word, .. } => Some(word),
            _ => None,
        }
    }

    fn modes(settings: &Settings, port: u8) -> String {
        let channels = &settings.serial_ports[&port].channels;
        let mode = |channel| match channels.get(&channel) {
            Some(remote) => remote.mode.to_string(),
            None => "x".to_string(),
        };
        (0..8).map(mode).collect()
    }

    #[test]
    fn empty_config_uses_everything_with_linuxcnc_defaults() {
        let expected = Settings {
            defaults: Defaults::LinuxCnc,
            ..Settings::default()
        };
        for config in [
            "",
            "  \t",
            "num_encoders=-1 num_dplls=-1 num_stepgens=-1 stepgen_width=2 num_uarts=0",
        ] {
            assert_eq!(format!("{:?}", parsed(config)), format!("{expected:?}"));
        }
    }

    #[test]
    fn words_of_existing_files_are_numbers_of_instances() {
        let settings =
            parsed("num_encoders=4 num_pwmgens=0x3 num_leds=010 num_encoders=5 num_dplls=0");
        let expected = [
            (Gtag::ENCODER, 5),
            (Gtag::PWM, 3),
            (Gtag::LED, 8),
            (Gtag::HM2DPLL, 0),
        ];
        assert_eq!(settings.instances, expected.into());
        assert_eq!(parsed("num_ssrs=0 num_ssrs=-1").instances, [].into());
    }

    /// As in `hm2_parse_config_string`: the ports up to the last one with a digit.
    #[test]
    fn ports_behind_the_last_one_with_a_mode_are_not_used() {
        let ports = |config| parsed(config).instances.get(&Gtag::SSERIAL).copied();
        for (config, used) in [
            ("num_encoders=1", None),
            ("sserial_port_0=00xxxxxx", Some(1)),
            ("sserial_port_0=xxxxxxxx", Some(0)),
            ("sserial_port_0=", Some(0)),
            ("sserial_port_2=1", Some(3)),
            ("sserial_port_2=1 sserial_port_0=x", Some(3)),
            ("sserial_port_1=xx sserial_port_0=0", Some(1)),
        ] {
            assert_eq!(ports(config), used, "{config}");
        }
        let settings = parsed("sserial_port_1=20x sserial_port_0=1 sserial_port_1=x");
        assert_eq!(modes(&settings, 0), "10000000");
        assert_eq!(modes(&settings, 1), "x0x00000");
    }

    #[test]
    fn words_of_serial_ports_may_be_long_and_have_capitals() {
        for (config, expected) in [
            ("sserial_port_0=0000000000", "00000000"),
            ("sserial_port_0=0xXXXX", "0xxxxx00"),
            ("sserial_port_0=XXXXXXXX0", "xxxxxxxx"),
            ("sserial_port_0=2XxxXXXX00", "2xxxxxxx"),
        ] {
            let settings = parsed(config);
            let used = settings.instances[&Gtag::SSERIAL];
            assert_eq!(used, u8::from(expected != "xxxxxxxx"), "{config}");
            if used > 0 {
                assert_eq!(modes(&settings, 0), expected, "{config}");
            }
        }
    }

    #[test]
    fn words_of_undriven_modules_are_noted() {
        let words = |config: &str| -> Vec<String> {
            let parsed = Config::parse(config).expect(config);
            parsed
                .undriven
                .into_iter()
                .map(|noted| noted.word)
                .collect()
        };
        for kind in NOT_DRIVEN.iter().map(|kind| kind.word) {
            for (value, noted) in [("0", 0), ("-1", 0), ("1", 1), ("0x12", 1)] {
                let config = format!("{kind}={value}");
                assert_eq!(words(&config), vec![config; noted]);
            }
        }
        for config in ["ssi_chan_0=p%2b", "biss_chan_1=x", "fanuc_chan_00=a%3u"] {
            assert_eq!(words(config), [config]);
        }
        let config = Config::parse("firmware=hm2/5i25/7i77_7i76.bit").expect("a firmware");
        assert_eq!(config.firmware(), Some("hm2/5i25/7i77_7i76.bit"));
    }

    #[test]
    fn refused_word_is_named_with_what_is_known() {
        for (config, word, said) in [
            (
                "num_encoders=4 num_encoder=4",
                "num_encoder=4",
                "num_encoders",
            ),
            ("NUM_ENCODERS=4", "NUM_ENCODERS=4", "one of num_encoders"),
            ("num_sserials=1", "num_sserials=1", "sserial_port_0"),
            ("num_encoders", "num_encoders", "each with ="),
            ("num_encoders=", "num_encoders=", "0 to 255"),
            ("num_encoders=256", "num_encoders=256", "0 to 255"),
            ("num_pwmgens=-2", "num_pwmgens=-2", "-1 for all"),
            ("num_pwmgens=08", "num_pwmgens=08", "0 to 255"),
            ("num_stepgens=256", "num_stepgens=256", "0 to 255"),
            ("num_resolvers=one", "num_resolvers=one", "0 to 255"),
            ("sserial_port_4=0", "sserial_port_4=0", "sserial_port_3"),
            ("sserial_port_00=0", "sserial_port_00=0", "sserial_port_3"),
            ("sserial_port_0=0y", "sserial_port_0=0y", "or x"),
            (
                "sserial_port_0=00000000y",
                "sserial_port_0=00000000y",
                "or x",
            ),
            ("stepgen_width=two", "stepgen_width=two", "a number"),
            ("stepgen_width=99", "stepgen_width=99", "0 to 8"),
            ("enable_raw", "enable_raw", "leave the word out"),
        ] {
            let error = Config::parse(config).expect_err(config);
            assert_eq!(named(&error), Some(word));
            assert!(error.to_string().contains(said), "{config}: {error}");
        }
    }

    #[test]
    fn long_word_is_shortened_in_the_message() {
        let word = "num_encoders=4".repeat(400);
        let error = Config::parse(&word).expect_err("no such word");
        let text = error.to_string();
        assert!(text.contains("... (5600 characters)'"), "{text}");
        assert!(text.len() < 700, "{text}");
        assert_eq!(named(&error), Some(&*word), "whole in the error itself");
    }

    proptest! {
        #[test]
        fn any_text_is_parsed_or_refused(text in ".{0,80}") {
            let _ = Config::parse(&text);
        }

        #[test]
        fn anything_that_looks_like_words_is_parsed_or_refused(
            words in proptest::collection::vec("(num_[a-z0-9]{3,8}|sserial_port_[0-9-]|ssi_chan_[0-9]|enable_raw|stepgen_width)=?[-+0-9a-fxX]{0,10}", 0..6)
        ) {
            let _ = Config::parse(&words.join(" "));
        }

        #[test]
        fn valid_words_come_back(
            counts in proptest::collection::btree_map(0..CountedKind::ALL.len(), any::<u8>(), 0..8),
            ports in proptest::collection::btree_map(0..4u8, "[0-9x]{8}", 0..4),
        ) {
            let mut words = Vec::new();
            for (&kind, count) in &counts {
                let word = CountedKind::ALL[kind].word;
                words.extend(word.map(|word| format!("{word}={count}")));
            }
            for (port, modes) in &ports {
                words.push(format!("sserial_port_{port}={modes}"));
            }
            let settings = parsed(&words.join(" "));
            let mut back = Vec::new();
            for kind in CountedKind::ALL {
                if let Some(word) = kind.word
                    && let Some(count) = settings.instances.get(&kind.key())
                {
                    back.push(format!("{word}={count}"));
                }
            }
            let used = settings.instances.get(&Gtag::SSERIAL).copied();
            let is_used = |port: u8| used.is_some_and(|used| port < used);
            for &port in ports.keys() {
                if is_used(port) {
                    back.push(format!("sserial_port_{port}={}", modes(&settings, port)));
                } else {
                    prop_assert_eq!(ports[&port].trim_matches('x'), "");
                    back.push(format!("sserial_port_{port}=xxxxxxxx"));
                }
            }
            words.sort();
            back.sort();
            prop_assert_eq!(words, back);
        }
    }
}

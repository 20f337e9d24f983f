//! The words of `config=`, in hostmot2's grammar.

use mesa_hal::{ParseError, SerialConfig, Settings};

/// Error in a word of `config=`.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum ConfigError {
    /// Not one of hostmot2's words.
    #[error("'{word}' is no word of config=; there are sserial_port_N=, num_encoders= and so on")]
    Unknown {
        /// The word.
        word: String,
    },
    /// A word with a wrong value.
    #[error("'{word}': {error}")]
    Value {
        /// The word.
        word: String,
        /// The error.
        error: ParseError,
    },
    /// A number of instances that is none.
    #[error("'{word}': expected a number of instances, 0 to 255")]
    Count {
        /// The word.
        word: String,
    },
}

/// The settings of a board with LinuxCNC's words: `num_encoders=6 sserial_port_0=000xxxxx`.
pub(crate) fn settings(config: &str) -> Result<Settings, ConfigError> {
    let mut settings = Settings::default();
    for word in config.split_whitespace() {
        parse(word, &mut settings)?;
    }
    Ok(settings)
}

/// Kinds of modules whose number hostmot2 takes, and of which this driver makes all.
const COUNTS: [&str; 18] = [
    "num_3pwmgens",
    "num_bspis",
    "num_dplls",
    "num_inms",
    "num_inmuxs",
    "num_leds",
    "num_oneshots",
    "num_outms",
    "num_pktuarts",
    "num_pwmgens",
    "num_rcpwmgens",
    "num_resolvers",
    "num_sserials",
    "num_ssrs",
    "num_stepgens",
    "num_tp_pwmgens",
    "num_uarts",
    "num_xy2mods",
];

fn parse(word: &str, settings: &mut Settings) -> Result<(), ConfigError> {
    let unknown = || ConfigError::Unknown { word: word.into() };
    let (name, value) = word.split_once('=').ok_or_else(unknown)?;
    let count = || {
        let count: Result<u8, _> = value.parse();
        count.map_err(|_| ConfigError::Count { word: word.into() })
    };
    if let Some(port) = name.strip_prefix("sserial_port_") {
        let port = port.parse().map_err(|_| unknown())?;
        let config = value.parse::<SerialConfig>();
        let config = config.map_err(|error| ConfigError::Value {
            word: word.into(),
            error,
        })?;
        settings.serial_ports.insert(port, config);
    } else if name == "num_encoders" {
        settings.encoders.count = Some(count()?);
    } else if COUNTS.contains(&name) {
        count()?;
    } else {
        return Err(unknown());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_of_an_existing_machine_is_accepted() {
        let line = "num_encoders=6 num_pwmgens=6 num_stepgens=0 sserial_port_0=20xxxxxx";
        let settings = settings(line).expect("words of hostmot2");
        assert_eq!(settings.encoders.count, Some(6));
        let channels = &settings.serial_ports[&0].channels;
        let modes: Vec<_> = channels
            .iter()
            .map(|(n, remote)| (*n, remote.mode))
            .collect();
        assert_eq!(modes, [(0, 2), (1, 0)]);
    }

    #[test]
    fn an_error_names_the_word() {
        for (config, word) in [
            ("num_encoders=6 sserial_port_0=0y", "sserial_port_0=0y"),
            ("num_encoders=-1", "num_encoders=-1"),
            ("num_leds=many", "num_leds=many"),
            ("sserial_port_0", "sserial_port_0"),
            ("sserial_port_x=00", "sserial_port_x=00"),
            ("firmwear=x", "firmwear=x"),
        ] {
            let error = settings(config).expect_err(config).to_string();
            assert!(error.starts_with(&format!("'{word}'")), "{error}");
        }
    }
}

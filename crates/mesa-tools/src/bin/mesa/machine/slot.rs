//! The place of a remote: a serial port and a channel.

use std::fmt;
use std::str::FromStr;

use mesa_hal_sim::{SimFpga, SimTerminal};

/// Serial port of all remotes of the built-in boards.
pub const PORT: u8 = 0;

/// A channel of a serial port. Text form: `CH` on port 0, `PORT.CH` on the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Slot {
    pub port: u8,
    pub channel: u8,
}

impl Slot {
    /// A channel of port 0.
    pub const fn channel(channel: u8) -> Self {
        Self {
            port: PORT,
            channel,
        }
    }

    /// The remote of a terminal; `None` for another terminal.
    pub fn of(terminal: SimTerminal) -> Option<Self> {
        let SimTerminal::Remote { port, channel, .. } = terminal else {
            return None;
        };
        Some(Self {
            port: port.try_into().ok()?,
            channel: channel.try_into().ok()?,
        })
    }

    /// The slot in the name of a value: `remote.CH.…`, or `remote.PORT.CH.…`.
    pub fn in_name(name: &str) -> Option<Self> {
        let (_, rest) = name.split_once("remote.")?;
        let mut parts = rest.split('.').map_while(|part| part.parse().ok());
        let first = parts.next()?;
        Some(match parts.next() {
            Some(channel) => Self {
                port: first,
                channel,
            },
            None => Self::channel(first),
        })
    }

    /// Port and channel as indices.
    pub fn indices(self) -> (usize, usize) {
        (self.port.into(), self.channel.into())
    }
}

impl fmt::Display for Slot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.port == PORT {
            write!(f, "{}", self.channel)
        } else {
            write!(f, "{}.{}", self.port, self.channel)
        }
    }
}

impl FromStr for Slot {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |text: &str| text.parse().ok();
        let slot = match text.split_once('.') {
            Some((port, channel)) => number(port)
                .zip(number(channel))
                .map(|(port, channel)| Self { port, channel }),
            None => number(text).map(Self::channel),
        };
        slot.ok_or_else(|| format!("`{text}` is no channel: expected CH, or PORT.CH"))
    }
}

/// Number of channels of each serial port.
pub fn channels(fpga: &SimFpga) -> Vec<u8> {
    let ports = 0..fpga.serial_ports();
    let ports = ports.filter_map(|port| fpga.serial_port(port));
    let counts = ports.map(|port| port.config().channels());
    counts.map(|count| count.try_into().unwrap_or(0)).collect()
}

/// Refuses slots that a board with these `channels` on its ports does not have, and a slot that is
/// named twice.
pub fn check(channels: &[u8], slots: &[Slot]) -> Result<(), String> {
    for (index, slot) in slots.iter().enumerate() {
        let Some(&count) = channels.get(usize::from(slot.port)) else {
            return Err(match channels.len() {
                0 => "this board has no serial port".to_owned(),
                1 => format!("serial port {}: this board has port 0 only", slot.port),
                ports => format!(
                    "serial port {}: this board has ports 0 to {}",
                    slot.port,
                    ports - 1
                ),
            });
        };
        if slot.channel >= count {
            let port = match channels {
                [_] => "this board".to_owned(),
                _ => format!("serial port {} of this board", slot.port),
            };
            return Err(match count {
                0 => format!("channel {slot}: {port} has no channels"),
                1 => format!("channel {slot}: {port} has channel 0 only"),
                _ => format!("channel {slot}: {port} has channels 0 to {}", count - 1),
            });
        }
        if slots.iter().take(index).any(|other| other == slot) {
            return Err(format!("two remotes on channel {slot}"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_of_a_slot_leads_back_to_it() {
        for (text, port, channel) in [("3", 0, 3), ("1.0", 1, 0), ("0.7", 0, 7)] {
            let slot: Slot = text.parse().expect(text);
            assert_eq!(slot, Slot { port, channel });
            assert_eq!(slot.to_string().parse(), Ok(slot));
        }
        for text in ["", "x", "1.", ".1", "1.2.3", "-1", "300"] {
            assert!(text.parse::<Slot>().is_err(), "{text}");
        }
    }

    #[test]
    fn name_of_a_value_has_its_slot() {
        let slot = |port, channel| Some(Slot { port, channel });
        assert_eq!(Slot::in_name("remote.2.input-00"), slot(0, 2));
        assert_eq!(Slot::in_name("remote.1.2.requests.sent"), slot(1, 2));
        assert_eq!(Slot::in_name("motor.1.position"), None);
    }

    #[test]
    fn slots_that_a_board_does_not_have_are_refused() {
        let check = |channels: &[u8], slots: &[&str]| {
            let slots: Vec<Slot> = slots.iter().map(|slot| slot.parse().unwrap()).collect();
            check(channels, &slots)
        };
        assert_eq!(check(&[8, 3], &["7", "1.2"]), Ok(()));
        for (channels, slots, reason) in [
            (&[][..], &["0"][..], "no serial port"),
            (&[8], &["1.0"], "port 0 only"),
            (&[8, 3], &["2.0"], "ports 0 to 1"),
            (
                &[8, 3],
                &["1.3"],
                "serial port 1 of this board has channels 0 to 2",
            ),
            (&[1], &["1"], "channel 0 only"),
            (&[8], &["8"], "this board has channels 0 to 7"),
            (&[8, 3], &["1.2", "1.2"], "two remotes on channel 1.2"),
        ] {
            let error = check(channels, slots).unwrap_err();
            assert!(error.contains(reason), "{error}");
        }
    }
}

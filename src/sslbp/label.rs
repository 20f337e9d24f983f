//! The name of a remote in texts and pin names.

use core::fmt::{self, Write};

use super::RemoteName;
use crate::hostmot2::RemoteId;

/// A remote as errors, remarks and events name it: address and own name.
///
/// As text, the part of its pins' names behind the board: `7i77.0.1` for the 7I77 on port 0,
/// channel 1; without a name, because nothing is known of what is there, the text of the address,
/// `port 0, channel 1`. Functions that take a remote accept it in place of its address:
///
/// ```
/// use mesa_hal::sslbp::RemoteName;
/// use mesa_hal::{RemoteId, RemoteLabel};
///
/// let remote = RemoteLabel::new((0, 1), RemoteName(*b"7I77"));
/// assert_eq!(remote.to_string(), "7i77.0.1");
/// assert_eq!(remote, RemoteId::new(0, 1));
/// assert_eq!(RemoteLabel::from(remote.id).to_string(), "port 0, channel 1");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct RemoteLabel {
    /// The address of the remote.
    #[cfg_attr(feature = "serde", serde(flatten))]
    pub id: RemoteId,
    /// The name that the remote has reported, or that its table has for an absent one; `None` if
    /// neither is known.
    #[cfg_attr(feature = "serde", serde(default))]
    pub name: Option<RemoteName>,
}

impl RemoteLabel {
    /// The label of the remote with this name at this address.
    pub fn new(id: impl Into<RemoteId>, name: RemoteName) -> Self {
        Self {
            id: id.into(),
            name: Some(name),
        }
    }
}

/// Without a name.
impl From<RemoteId> for RemoteLabel {
    fn from(id: RemoteId) -> Self {
        Self { id, name: None }
    }
}

impl From<RemoteLabel> for RemoteId {
    fn from(label: RemoteLabel) -> Self {
        label.id
    }
}

/// True for the same address.
impl PartialEq<RemoteId> for RemoteLabel {
    fn eq(&self, id: &RemoteId) -> bool {
        self.id == *id
    }
}

/// As in LinuxCNC the second letter of the name is small, and the others are as the card has them:
/// `7i77` for `7I77`, and `TsHW` for `TsHW`.
impl fmt::Display for RemoteLabel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(name) = self.name else {
            return self.id.fmt(f);
        };
        for (at, c) in name.characters().enumerate() {
            let c = if at == 1 { c.to_ascii_lowercase() } else { c };
            f.write_char(in_hal(c))?;
        }
        write!(f, ".{}.{}", self.id.port, self.id.channel)
    }
}

/// A character that a HAL file can hold.
pub(crate) const fn in_hal(c: char) -> char {
    if c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.' | '+') {
        c
    } else {
        '_'
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::string::ToString;

    #[test]
    fn label_is_spelled_as_in_pin_names() {
        for (name, text) in [
            (*b"7I77", "7i77.3.7"),
            (*b"TsHW", "TsHW.3.7"),
            (*b"AB C", "Ab_C.3.7"),
            (*b"7I#\0", "7i__.3.7"),
        ] {
            let label = RemoteLabel::new((3, 7), RemoteName(name));
            assert_eq!(label.to_string(), text);
        }
    }
}

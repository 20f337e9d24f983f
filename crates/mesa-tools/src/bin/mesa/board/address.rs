//! The place of a board: on the network, or on the PCI bus.

use std::fmt::{self, Display};
use std::net::{Ipv4Addr, SocketAddrV4};
use std::path::PathBuf;
use std::str::FromStr;

use mesa_pci::{PciAddress, SYSFS};
use serde::{Serialize, Serializer};

/// The place of a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoardAddress {
    Ethernet(SocketAddrV4),
    Pci(PciAddress),
    /// A simulated board on the PCI bus, in this program.
    Embedded,
}

impl BoardAddress {
    /// The IP address; `None` on the PCI bus.
    pub fn ip(&self) -> Option<Ipv4Addr> {
        self.on_ethernet().map(|address| *address.ip())
    }

    /// The place on the network; `None` on the PCI bus.
    pub const fn on_ethernet(&self) -> Option<SocketAddrV4> {
        match self {
            Self::Ethernet(address) => Some(*address),
            Self::Pci(_) | Self::Embedded => None,
        }
    }
}

impl From<SocketAddrV4> for BoardAddress {
    fn from(address: SocketAddrV4) -> Self {
        Self::Ethernet(address)
    }
}

impl Display for BoardAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ethernet(address) => address.fmt(f),
            Self::Pci(address) => address.fmt(f),
            Self::Embedded => f.pad("simulated PCI bus"),
        }
    }
}

impl Serialize for BoardAddress {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// What `--pci` names: an address on the PCI bus, a folder in which to look for boards, or both.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PciPlace {
    /// `/sys`, or a folder that `mesa sim --pci` has made.
    pub root: PathBuf,
    /// `None`: the only board there.
    pub address: Option<PciAddress>,
}

impl FromStr for PciPlace {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Ok(address) = text.parse() {
            return Ok(Self {
                root: SYSFS.into(),
                address: Some(address),
            });
        }
        let path = PathBuf::from(if text.is_empty() { SYSFS } else { text });
        let last = path.file_name().and_then(|name| name.to_str());
        let address = last.and_then(|name| name.parse().ok());
        let root = match (address, path.parent()) {
            (Some(_), Some(parent)) => parent.to_owned(),
            _ => path.clone(),
        };
        if !root.is_dir() {
            return Err(format!(
                "`{text}` is no address on the PCI bus and no folder; give it as 0000:03:00.0, as a folder \
                 of `mesa sim --pci`, as FOLDER/0000:03:00.0, or give --pci at the end for the only board"
            ));
        }
        Ok(Self { root, address })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn place_is_an_address_a_folder_or_both() {
        let place = |text: &str| {
            let place: PciPlace = text.parse().expect(text);
            let address = place.address.map(|address| address.to_string());
            (place.root.display().to_string(), address)
        };
        let address = || Some("0000:03:00.0".to_owned());
        assert_eq!(place("03:00.0"), ("/sys".to_owned(), address()));
        assert_eq!(place(""), ("/sys".to_owned(), None));
        assert_eq!(place("/tmp"), ("/tmp".to_owned(), None));
        assert_eq!(place("/tmp/0000:03:00.0"), ("/tmp".to_owned(), address()));
        for text in ["*.input-0?", "/no/such/folder", "/no/such/0000:03:00.0"] {
            let error = text.parse::<PciPlace>().expect_err(text);
            assert!(
                error.contains(text) && error.contains("0000:03:00.0"),
                "{error}"
            );
        }
    }
}

//! The address of a device on the PCI bus.

use alloc::borrow::ToOwned;
use alloc::string::String;
use alloc::vec::Vec;
use core::fmt;
use core::str::FromStr;

/// The address of a device as the kernel writes it: `0000:03:00.0`, that is domain, bus, device and
/// function.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PciAddress {
    /// Domain, 0 on most computers.
    pub domain: u32,
    /// Bus.
    pub bus: u8,
    /// Device, 0 to 31.
    pub device: u8,
    /// Function, 0 to 7.
    pub function: u8,
}

/// A text is no address of a PCI device.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{0}` is no address of a PCI device: expected 0000:03:00.0 or 03:00.0, as `lspci -D` prints it"
)]
pub struct PciAddressError(String);

impl crate::MesaError for PciAddressError {}

impl fmt::Display for PciAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            domain,
            bus,
            device,
            function,
        } = self;
        write!(f, "{domain:04x}:{bus:02x}:{device:02x}.{function}")
    }
}

impl FromStr for PciAddress {
    type Err = PciAddressError;

    fn from_str(text: &str) -> Result<Self, PciAddressError> {
        parse(text).ok_or_else(|| PciAddressError(text.to_owned()))
    }
}

fn parse(text: &str) -> Option<PciAddress> {
    let (place, function) = text.rsplit_once('.')?;
    let parts: Vec<_> = place.split(':').collect();
    let (domain, bus, device) = match parts[..] {
        [bus, device] => ("0", bus, device),
        [domain, bus, device] => (domain, bus, device),
        _ => return None,
    };
    let hex = |text: &str, digits| {
        let is_short = (1..=digits).contains(&text.len());
        let is_hex = text.bytes().all(|digit| digit.is_ascii_hexdigit());
        let value = u32::from_str_radix(text, 16).ok();
        value.filter(|_| is_short && is_hex)
    };
    Some(PciAddress {
        domain: hex(domain, 8)?,
        bus: hex(bus, 2)? as u8,
        device: hex(device, 2).filter(|&device| device < 32)? as u8,
        function: hex(function, 1).filter(|&function| function < 8)? as u8,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::format;
    use alloc::string::ToString;

    #[test]
    fn address_is_read_with_and_without_its_domain() {
        let address: PciAddress = "03:1f.7".parse().expect("an address");
        assert_eq!(address.to_string(), "0000:03:1f.7");
        assert_eq!("0000:03:1f.7".parse(), Ok(address));
        assert_eq!(
            "10000:0a:00.0"
                .parse()
                .map(|address: PciAddress| address.domain),
            Ok(0x1_0000)
        );
    }

    #[test]
    fn invalid_pci_address_is_refused_with_its_text() {
        for text in [
            "",
            "3",
            "03:00",
            "03:20.0",
            "03:00.8",
            "0:0:0:0.0",
            "+3:00.0",
            "pci",
        ] {
            let error = text.parse::<PciAddress>().expect_err(text);
            assert!(error.to_string().starts_with(&format!("`{text}`")));
        }
    }
}

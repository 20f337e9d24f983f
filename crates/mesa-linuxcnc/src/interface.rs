//! The interface of the boards: by the name of the file from which LinuxCNC has loaded the
//! component.
//!
//! `mesa_eth.so` and `mesa_pci.so` are the same library. LinuxCNC does not pass the name, so that
//! the component looks which file its own code was loaded from.

use core::ffi::CStr;
use core::fmt;

/// The interface of the boards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Interface {
    /// `mesa_eth`.
    Ethernet,
    /// `mesa_pci`.
    Pci,
}

impl Interface {
    /// The interface of this component.
    pub fn own() -> Self {
        Self::of(&crate::ffi::own_file().unwrap_or_default())
    }

    /// The interface by the file of the component.
    fn of(file: &str) -> Self {
        let name = file.rsplit('/').next().unwrap_or_default();
        if name.contains("mesa_pci") {
            Self::Pci
        } else {
            Self::Ethernet
        }
    }

    /// Its name in HAL.
    pub const fn name(self) -> &'static CStr {
        match self {
            Self::Ethernet => c"mesa_eth",
            Self::Pci => c"mesa_pci",
        }
    }
}

impl fmt::Display for Interface {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name().to_string_lossy())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_of_the_code_names_the_interface() {
        for (file, interface) in [
            ("/usr/lib/linuxcnc/modules/mesa_eth.so", Interface::Ethernet),
            ("/usr/lib/linuxcnc/modules/mesa_pci.so", Interface::Pci),
            ("mesa_pci.so", Interface::Pci),
            ("/home/mesa_pci/mesa_eth.so", Interface::Ethernet),
            ("", Interface::Ethernet),
        ] {
            assert_eq!(Interface::of(file), interface, "{file}");
        }
    }

    #[test]
    fn these_tests_are_a_file_of_neither_name() {
        let file = crate::ffi::own_file().expect("a file");
        assert!(file.contains("mesa_eth"), "{file}");
        assert_eq!(Interface::own(), Interface::Ethernet);
    }
}

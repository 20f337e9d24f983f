//! The interface of the boards: by the name of the file from which LinuxCNC has loaded the component.
//!
//! `mesa_eth.so` and `mesa_pci.so` are the same library. LinuxCNC does not pass the name, so that the
//! component looks which file its own code is mapped from.

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
        let code = crate::ffi::rtapi_app_main as *const ();
        let maps = std::fs::read_to_string("/proc/self/maps").unwrap_or_default();
        Self::of(&maps, code.addr())
    }

    /// The interface by the file that is mapped at an address.
    fn of(maps: &str, address: usize) -> Self {
        let line = maps.lines().find(|line| covers(line, address));
        let path = line
            .and_then(|line| line.split_once('/'))
            .unwrap_or_default();
        let name = path.1.rsplit('/').next().unwrap_or_default();
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

/// True if a line of `maps` is about an address: `7f10-7f20 r-xp ...`.
fn covers(line: &str, address: usize) -> bool {
    let range = line
        .split(' ')
        .next()
        .and_then(|range| range.split_once('-'));
    let number = |text| usize::from_str_radix(text, 16).ok();
    let range = range.and_then(|(start, end)| Some(number(start)?..number(end)?));
    range.is_some_and(|range| range.contains(&address))
}

#[cfg(test)]
mod tests {
    use super::*;

    const MAPS: &str = "\
        00400000-00452000 r-xp 00000000 08:02 173521      /usr/bin/rtapi_app\n\
        7f1000000000-7f1000010000 r-xp 00000000 08:02 42  /usr/lib/linuxcnc/modules/mesa_eth.so\n\
        7f1000020000-7f1000030000 r-xp 00000000 08:02 43  /usr/lib/linuxcnc/modules/mesa_pci.so\n\
        7f1000040000-7f1000050000 rw-p 00000000 00:00 0\n";

    #[test]
    fn the_file_of_the_code_names_the_interface() {
        for (address, interface) in [
            (0x7f10_0000_0000, Interface::Ethernet),
            (0x7f10_0002_0000, Interface::Pci),
            (0x7f10_0002_ffff, Interface::Pci),
            (0x7f10_0003_0000, Interface::Ethernet),
            (0x0040_0000, Interface::Ethernet),
            (0x7f10_0004_0000, Interface::Ethernet),
        ] {
            assert_eq!(Interface::of(MAPS, address), interface, "{address:x}");
        }
    }

    #[test]
    fn these_tests_are_a_file_of_neither_name() {
        assert_eq!(Interface::own(), Interface::Ethernet);
    }
}

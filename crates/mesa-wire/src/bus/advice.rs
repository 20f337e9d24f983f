//! The next step after a bus error.

use core::fmt;

macro_rules! kinds {
    ($($name:ident: $text:literal,)*) => {
        /// The next step after a bus error: [`BusError::advice`](super::BusError::advice).
        ///
        /// `Display` writes it as part of a sentence. A program with other words for its users
        /// matches the value.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[non_exhaustive]
        pub enum BusAdvice {
            $(
                #[doc = concat!("\"", $text, "\".")]
                $name,
            )*
        }

        impl BusAdvice {
            /// All values, in the order of their declaration.
            pub const ALL: &[Self] = &[$(Self::$name),*];

            const fn text(self) -> &'static str {
                match self {
                    $(Self::$name => $text,)*
                }
            }
        }
    };
}

kinds! {
    CheckBoard: "check the board's power, cable, IP address and jumpers, or allow a longer deadline",
    CheckHost: "look for interrupts, power saving and other traffic, or allow a longer deadline",
    CheckAddress: "check the address and the port",
    CheckAddressAndWay: "check the address and the port, and what relays or filters packets on their way",
    CheckInterface: "check that the network interface is up and in the same network, and the board's IP address and cable",
    FindOtherProgram: "find out whether another program communicates with this board",
    EndOtherProgram: "end the other program (LinuxCNC, mesaflash, another driver), also on other hosts",
    OpenFirewall: "LinuxCNC on this computer keeps its board for itself: end it. If it has ended and left its firewall behind: `sudo iptables -F hm2-eth-rules-output`; else it is another rule of `sudo iptables -S`",
    ShortenList: "use shorter lists",
    StartList: "start the list, and run nothing else before its reply is taken",
    PrepareList: "prepare the list on this bus",
    CheckSlot: "check that the board is seated in its slot and has power; after a reload of its FPGA the computer must be restarted",
    ShortenPeriod: "use a shorter period, or let the host pace the cycle",
}

impl fmt::Display for BusAdvice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.text())
    }
}

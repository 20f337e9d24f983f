//! Who a board is, and what it counted.

use core::{fmt, net::Ipv4Addr, time::Duration};

use super::EthernetError;
use super::packets::{Lbp16Board, QUICK, read_words, run};
use crate::lbp16::{Command, ErrorRegister, InfoArea, Lbp16Error, Space, registers};

/// An Ethernet board beside its HostMot2 registers.
///
/// Everything here is for set-up: it takes milliseconds, and tries again when a packet is lost.
#[derive(Debug)]
pub struct EthernetBoard<B> {
    bus: B,
}

/// The address of a network interface. `Display` writes it as usual: `00:60:0e:1b:00:97`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct MacAddress(pub [u8; 6]);

impl fmt::Display for MacAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (n, byte) in self.0.iter().enumerate() {
            let colon = if n == 0 { "" } else { ":" };
            write!(f, "{colon}{byte:02x}")?;
        }
        Ok(())
    }
}

/// A board's name, for example `7I97`: at most 16 characters.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct CardName([u8; 16]);

impl CardName {
    /// The name in these bytes; what is past 16 is left out.
    pub(super) fn from_bytes(bytes: &[u8]) -> Self {
        let mut name = [0; 16];
        for (slot, byte) in name.iter_mut().zip(bytes) {
            *slot = *byte;
        }
        Self(name)
    }

    /// The name without what pads it; `?` if it is no text.
    pub fn as_str(&self) -> &str {
        let end = self.0.iter().position(|&c| c == 0);
        let name = self.0.get(..end.unwrap_or(16)).unwrap_or(&[]);
        core::str::from_utf8(name).unwrap_or("?").trim_end()
    }
}

impl fmt::Display for CardName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl fmt::Debug for CardName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self.as_str(), f)
    }
}

/// What a board says about itself.
///
/// Source: manual 7I97, "SPACE 7: LBP READ ONLY AREA" and "ETHERNET EEPROM LAYOUT".
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// The card's name.
    pub card: CardName,
    /// Version of the protocol.
    pub lbp_version: u16,
    /// Version of the firmware that answers.
    pub firmware_version: u16,
    /// The jumpers, as the board reads them. Which bit is which jumper is not documented.
    pub jumpers: u16,
    /// The MAC address in the EEPROM.
    pub mac: MacAddress,
    /// The IP address in the EEPROM, which the board uses if its jumpers say so.
    pub eeprom_ip: Ipv4Addr,
    /// The netmask in the EEPROM; firmware 16 and later have one.
    pub eeprom_netmask: Option<Ipv4Addr>,
}

impl Identity {
    /// The card's name, for example `7I97`.
    pub fn card_name(&self) -> &str {
        self.card.as_str()
    }
}

/// What a board counted since it was reset; 16 bits, they wrap around.
///
/// Source: manual 7I97, "SPACE 6 LBP STATUS/CONTROL AREA".
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Counters {
    /// Which errors there were.
    pub errors: ErrorRegister,
    /// Commands that could not be parsed.
    pub parse_errors: u16,
    /// Accesses to memory that is not there.
    pub memory_errors: u16,
    /// Writes to what can not be written.
    pub write_errors: u16,
    /// Packets received, of any kind.
    pub received: u16,
    /// UDP packets received.
    pub received_udp: u16,
    /// Damaged packets received.
    pub received_bad: u16,
    /// Packets sent, of any kind.
    pub sent: u16,
    /// UDP packets sent.
    pub sent_udp: u16,
    /// Packets that could not be sent.
    pub sent_bad: u16,
}

/// When the board received this packet and sent the one before, in microseconds of its own
/// clock, which wraps around after 65.536 ms.
///
/// Source: manual 7I97, "MEMORY SPACE 7 LAYOUT".
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timestamps {
    /// The packet began to arrive.
    pub receive_start: u16,
    /// It had arrived.
    pub receive_done: u16,
    /// The reply before this began to be sent.
    pub send_start: u16,
    /// It had been sent.
    pub send_done: u16,
}

impl<B: Lbp16Board> EthernetBoard<B> {
    /// The board behind a bus.
    pub fn new(bus: B) -> Self {
        Self { bus }
    }

    /// Gives the bus back.
    pub fn into_inner(self) -> B {
        self.bus
    }

    /// Who it is. Checks first that it is an LBP16 board at all.
    pub fn identity(&mut self) -> Result<Identity, EthernetError<B::Error>> {
        self.space_info(Space::ReadOnly)?;
        let words: [u16; 11] = self.words(Space::ReadOnly, registers::read_only::CARD_NAME)?;
        let [n0, n1, n2, n3, n4, n5, n6, n7, lbp, firmware, jumpers] = words;
        let name = [n0, n1, n2, n3, n4, n5, n6, n7].map(u16::to_le_bytes);
        let [m0, m1, m2] = self.words(Space::Eeprom, registers::eeprom::MAC)?;
        let mut mac = [0; 6];
        mac.copy_from_slice([m2, m1, m0].map(u16::to_be_bytes).as_flattened());
        Ok(Identity {
            card: CardName::from_bytes(name.as_flattened()),
            lbp_version: lbp,
            firmware_version: firmware,
            jumpers,
            mac: MacAddress(mac),
            eeprom_ip: self.eeprom_address(registers::eeprom::IP_ADDRESS)?,
            eeprom_netmask: if firmware >= registers::eeprom::NETMASK_FIRMWARE {
                Some(self.eeprom_address(registers::eeprom::NETMASK)?)
            } else {
                None
            },
        })
    }

    /// What a memory space says about itself.
    pub fn space_info(&mut self, space: Space) -> Result<InfoArea, EthernetError<B::Error>> {
        let mut reply = [[0; 2]; InfoArea::LEN as usize / 2];
        run(&mut self.bus, reply.as_flattened_mut(), QUICK, |request| {
            request
                .read_info(space, 0, InfoArea::LEN as u8 / 2)
                .map(drop)
        })?;
        InfoArea::parse(space, reply.map(u16::from_le_bytes)).map_err(|error| match error {
            Lbp16Error::Cookie { expected, actual } => EthernetError::Cookie {
                space: space.number(),
                found: actual,
                expected,
            },
            other => EthernetError::Request(other),
        })
    }

    /// What it counted.
    pub fn counters(&mut self) -> Result<Counters, EthernetError<B::Error>> {
        let words: [u16; 10] = self.words(Space::Control, registers::control::ERROR)?;
        let [
            errors,
            parse,
            memory,
            write,
            rx,
            rx_udp,
            rx_bad,
            tx,
            tx_udp,
            tx_bad,
        ] = words;
        Ok(Counters {
            errors: ErrorRegister::from_bits_retain(errors),
            parse_errors: parse,
            memory_errors: memory,
            write_errors: write,
            received: rx,
            received_udp: rx_udp,
            received_bad: rx_bad,
            sent: tx,
            sent_udp: tx_udp,
            sent_bad: tx_bad,
        })
    }

    /// Sets the error register and the counters of errors to 0.
    ///
    /// The counters of packets stay: they serve to tell packets apart.
    pub fn clear_errors(&mut self) -> Result<(), EthernetError<B::Error>> {
        use registers::control::{ERROR, RX_BAD, TX_BAD};
        let mut reply = [0; 2];
        run(&mut self.bus, &mut reply, QUICK, |request| {
            // The register, and the counters of parse, memory and write errors behind it.
            request.write_words(Space::Control, ERROR, &[0; 4])?;
            request.write_words(Space::Control, RX_BAD, &[0])?;
            request.write_words(Space::Control, TX_BAD, &[0])?;
            request.read(Space::Control, ERROR, 1).map(drop)
        })
    }

    /// Its clock at the last packets, to measure where time goes.
    pub fn timestamps(&mut self) -> Result<Timestamps, EthernetError<B::Error>> {
        let words: [u16; 4] = self.words(Space::ReadOnly, registers::read_only::RECEIVE_START)?;
        let [receive_start, receive_done, send_start, send_done] = words;
        Ok(Timestamps {
            receive_start,
            receive_done,
            send_start,
            send_done,
        })
    }

    /// Sets the IP address in the EEPROM, and reads it back.
    ///
    /// The board uses it from its next start on, if its jumpers say "fixed from EEPROM".
    pub fn set_eeprom_ip(&mut self, address: Ipv4Addr) -> Result<(), EthernetError<B::Error>> {
        self.write_eeprom(registers::eeprom::IP_ADDRESS, low_first(address))
    }

    /// Sets the netmask in the EEPROM, and reads it back. Needs firmware 16 or later.
    pub fn set_eeprom_netmask(&mut self, netmask: Ipv4Addr) -> Result<(), EthernetError<B::Error>> {
        let needed = registers::eeprom::NETMASK_FIRMWARE;
        self.need_firmware(needed)?;
        self.write_eeprom(registers::eeprom::NETMASK, low_first(netmask))
    }

    /// Restarts the board's protocol processor. It answers again after up to half a second, with
    /// the address that its jumpers say.
    ///
    /// Nothing answers this, so that a packet that is lost on the way is not noticed here: after
    /// a restart, [`counters`](Self::counters) begin at 0.
    pub fn reset(&mut self) -> Result<(), EthernetError<B::Error>> {
        self.send_control(registers::control::RESET, &[1])?;
        self.bus.wait(Duration::from_millis(500));
        Ok(())
    }

    /// Makes the FPGA load its configuration from flash memory again. Needs firmware 15 or later.
    ///
    /// All outputs go off meanwhile, and every register is lost. `user` is where the user
    /// configuration begins in the flash memory, `fallback` where the other one does.
    ///
    /// Nothing answers this either, see [`reset`](Self::reset).
    pub fn reload(&mut self, user: u32, fallback: u32) -> Result<(), EthernetError<B::Error>> {
        self.need_firmware(registers::read_only::RELOAD_FIRMWARE)?;
        self.send_control(registers::control::ICAP, &icap_reboot(user, fallback))?;
        self.bus.wait(Duration::from_secs(2));
        Ok(())
    }

    fn need_firmware(&mut self, needed: u16) -> Result<(), EthernetError<B::Error>> {
        let [found] = self.words(Space::ReadOnly, registers::read_only::FIRMWARE_VERSION)?;
        if found < needed {
            return Err(EthernetError::Firmware { needed, found });
        }
        Ok(())
    }

    fn eeprom_address(&mut self, address: u16) -> Result<Ipv4Addr, EthernetError<B::Error>> {
        let [low, high] = self.words(Space::Eeprom, address)?;
        Ok(Ipv4Addr::from_bits(u32::from(high) << 16 | u32::from(low)))
    }

    /// The enable is cleared at the end of every packet, so it stands in front of the write.
    pub(super) fn write_eeprom<const N: usize>(
        &mut self,
        address: u16,
        words: [u16; N],
    ) -> Result<(), EthernetError<B::Error>> {
        let mut reply = [[0; 2]; N];
        let count = u8::try_from(N).unwrap_or(u8::MAX);
        run(&mut self.bus, reply.as_flattened_mut(), QUICK, |request| {
            let enable = [registers::control::ENABLE_EEPROM];
            request.write_words(Space::Control, registers::control::WRITE_ENABLE, &enable)?;
            request.write_words(Space::Eeprom, address, &words)?;
            request.read(Space::Eeprom, address, count).map(drop)
        })?;
        let found = reply.map(u16::from_le_bytes);
        let places = (address..).step_by(2);
        for (address, (expected, found)) in places.zip(words.into_iter().zip(found)) {
            if expected != found {
                return Err(EthernetError::NotWritten {
                    address,
                    expected,
                    found,
                });
            }
        }
        Ok(())
    }

    /// Writes one control register several times; the board does not answer.
    fn send_control(
        &mut self,
        address: u16,
        values: &[u16],
    ) -> Result<(), EthernetError<B::Error>> {
        let mut buffer = [0; 128];
        let mut request = crate::lbp16::RequestBuilder::new(&mut buffer);
        for value in values {
            let write = Command::write(Space::Control, 1)?;
            request.command(write.without_increment(), address, &value.to_le_bytes())?;
        }
        self.bus.send(request.bytes()).map_err(EthernetError::Bus)
    }

    fn words<const N: usize>(
        &mut self,
        space: Space,
        address: u16,
    ) -> Result<[u16; N], EthernetError<B::Error>> {
        read_words(&mut self.bus, space, address)
    }

    pub(super) fn bus(&mut self) -> &mut B {
        &mut self.bus
    }
}

fn low_first(address: Ipv4Addr) -> [u16; 2] {
    let bits = address.to_bits();
    [bits as u16, (bits >> 16) as u16]
}

/// What the configuration port of a Spartan-6 takes to load from another address of its flash
/// memory (the IPROG sequence of its configuration guide).
fn icap_reboot(user: u32, fallback: u32) -> [u16; 14] {
    /// Command byte of the flash memory for a fast read.
    const FAST_READ: u16 = 0x0B00;
    let high = |address: u32| FAST_READ | (address >> 16 & 0xFF) as u16;
    [
        0xFFFF, // dummy
        0xAA99,
        0x5566, // synchronise
        0x3261,
        user as u16, // GENERAL1
        0x3281,
        high(user), // GENERAL2
        0x32A1,
        fallback as u16, // GENERAL3
        0x32C1,
        high(fallback), // GENERAL4
        0x30A1,
        0x000E, // CMD: IPROG
        0x2000, // no operation
    ]
}

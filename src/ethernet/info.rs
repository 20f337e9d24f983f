//! Counters, LEDs and EEPROM of a board.

use core::{net::Ipv4Addr, time::Duration};

use super::{EthernetBoard, EthernetError, Lbp16Board};
use crate::lbp16::registers::{control, eeprom, read_only};
use crate::lbp16::{Command, ErrorRegister, InfoArea, Space};

/// Counters of a board since its last reset; 16 bits, wrapping around.
///
/// Source: manual 7I97, "SPACE 6 LBP STATUS/CONTROL AREA".
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct Counters {
    /// The errors that have occurred.
    #[cfg_attr(feature = "serde", serde(serialize_with = "error_names"))]
    pub errors: ErrorRegister,
    /// Commands that could not be parsed.
    pub parse_errors: u16,
    /// Accesses to memory that does not exist.
    pub memory_errors: u16,
    /// Writes to memory that cannot be written.
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

/// Serializes the errors by their names.
#[cfg(feature = "serde")]
#[expect(clippy::trivially_copy_pass_by_ref, reason = "as serde calls it")]
fn error_names<S: serde::Serializer>(
    errors: &ErrorRegister,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(errors.iter_names().map(|(name, _)| name))
}

/// Times at which the board received this packet and sent the previous one, in microseconds of its
/// own clock, which wraps around after 65.536 ms.
///
/// Source: manual 7I97, "MEMORY SPACE 7 LAYOUT".
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Timestamps {
    /// Start of the reception.
    pub receive_start: u16,
    /// End of the reception.
    pub receive_done: u16,
    /// Start of sending the previous reply.
    pub send_start: u16,
    /// End of sending the previous reply.
    pub send_done: u16,
}

/// Source of the user LEDs of a board.
///
/// Source: manual 7I97, "MEMORY SPACE 6 LAYOUT", LEDMode, and "ETHERNET EEPROM LAYOUT", DEBUG LED
/// Mode: only the lowest bit counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
pub enum LedMode {
    /// `HostMot2`: the pins `led.CR01` to `led.CR04`.
    HostMot2 = 0,
    /// A variable of the network side, usually the number of packets received. The factory setting.
    Debug = 1,
}

/// Selects one of the two settings of the LED mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LedTime {
    /// The current mode, until the board restarts.
    Now,
    /// The mode in the EEPROM, which becomes the current one at each restart.
    AtStart,
}

impl LedTime {
    fn register(self) -> (Space, u16) {
        match self {
            Self::Now => (Space::Control, control::LED_MODE),
            Self::AtStart => (Space::Eeprom, eeprom::LED_MODE),
        }
    }
}

/// Queries.
impl<B: Lbp16Board> EthernetBoard<'_, B> {
    /// The information area of a memory space.
    ///
    /// # Errors
    /// [`Lbp16Error::Cookie`](crate::lbp16::Lbp16Error::Cookie) if the firmware does not have it,
    /// and errors of the bus.
    pub fn space_info(&mut self, space: Space) -> Result<InfoArea, EthernetError> {
        let read = Command::read_info(space, InfoArea::WORDS as u8);
        let words = self.ask(|request| request.command(read, 0, &[]))?;
        Ok(InfoArea::parse(space, words)?)
    }

    /// The counters.
    ///
    /// # Errors
    /// Errors of the bus.
    pub fn counters(&mut self) -> Result<Counters, EthernetError> {
        let [errors, counted @ ..]: [u16; 10] = self.words(Space::Control, control::ERROR)?;
        let [parse_errors, memory_errors, write_errors, packets @ ..] = counted;
        let [
            received,
            received_udp,
            received_bad,
            sent,
            sent_udp,
            sent_bad,
        ] = packets;
        Ok(Counters {
            errors: ErrorRegister::from_bits_retain(errors),
            parse_errors,
            memory_errors,
            write_errors,
            received,
            received_udp,
            received_bad,
            sent,
            sent_udp,
            sent_bad,
        })
    }

    /// The board's clock at the last packets, to measure the parts of a round trip.
    ///
    /// # Errors
    /// Errors of the bus.
    pub fn timestamps(&mut self) -> Result<Timestamps, EthernetError> {
        let words = self.words(Space::ReadOnly, read_only::RECEIVE_START)?;
        let [receive_start, receive_done, send_start, send_done] = words;
        Ok(Timestamps {
            receive_start,
            receive_done,
            send_start,
            send_done,
        })
    }

    /// The source of the user LEDs.
    ///
    /// # Errors
    /// Errors of the bus.
    pub fn led_mode(&mut self, time: LedTime) -> Result<LedMode, EthernetError> {
        let (space, address) = time.register();
        let [word] = self.words(space, address)?;
        Ok(match word & LedMode::Debug as u16 {
            0 => LedMode::HostMot2,
            _ => LedMode::Debug,
        })
    }
}

/// Settings. Writes to the EEPROM are read back.
impl<B: Lbp16Board> EthernetBoard<'_, B> {
    /// Sets the error register and the error counters to 0.
    ///
    /// The packet counters are kept: the bus uses them to account for packets.
    ///
    /// # Errors
    /// Errors of the bus.
    pub fn clear_errors(&mut self) -> Result<(), EthernetError> {
        let [_] = self.ask(|request| {
            // The register, and the counters of parse, memory and write errors behind it.
            request.write(Space::Control, control::ERROR, &[0; 8])?;
            request.write(Space::Control, control::RX_BAD, &[0; 2])?;
            request.write(Space::Control, control::TX_BAD, &[0; 2])?;
            request.read(Space::Control, control::ERROR, 1)
        })?;
        Ok(())
    }

    /// Assigns the user LEDs to the FPGA or to the network side, and reads the mode back. The
    /// driver's LED pins have no effect until the LEDs are assigned to the FPGA.
    ///
    /// Writes only on a change, because the EEPROM wears out with writes, and keeps the other bits
    /// of the register.
    ///
    /// # Errors
    /// [`EthernetError::NotKept`], and errors of the bus.
    pub fn set_led_mode(&mut self, time: LedTime, mode: LedMode) -> Result<(), EthernetError> {
        let (space, address) = time.register();
        let [word] = self.words(space, address)?;
        let bit = LedMode::Debug as u16;
        if word & bit == mode as u16 {
            return Ok(());
        }
        self.write_words(space, address, [word ^ bit], bit)
    }

    /// Sets the IP address in the EEPROM.
    ///
    /// The board uses it from its next start on, if its jumpers select "fixed from EEPROM".
    ///
    /// # Errors
    /// [`EthernetError::NotKept`], and errors of the bus.
    pub fn set_eeprom_ip(&mut self, address: Ipv4Addr) -> Result<(), EthernetError> {
        self.write_words(Space::Eeprom, eeprom::IP_ADDRESS, low_first(address), !0)
    }

    /// Sets the netmask in the EEPROM. Needs firmware 16 or later.
    ///
    /// # Errors
    /// [`EthernetError::Firmware`], [`EthernetError::NotKept`], and errors of the bus.
    pub fn set_eeprom_netmask(&mut self, netmask: Ipv4Addr) -> Result<(), EthernetError> {
        self.need_firmware(eeprom::NETMASK_FIRMWARE)?;
        self.write_words(Space::Eeprom, eeprom::NETMASK, low_first(netmask), !0)
    }

    /// Restarts the board's protocol processor. The board answers again after up to half a second,
    /// at the address that its jumpers select.
    ///
    /// The command is not answered, so that its loss is not detected here: after a restart,
    /// [`counters`](Self::counters) start at 0.
    ///
    /// # Errors
    /// Errors of the bus.
    pub fn reset(&mut self) -> Result<(), EthernetError> {
        self.send_control(control::RESET, &[1])?;
        self.bus.wait(Duration::from_millis(500));
        Ok(())
    }

    /// Makes the FPGA load its configuration from flash memory again. Needs firmware 15 or later.
    ///
    /// All outputs go off meanwhile, and every register is lost. `user` is the start of the user
    /// configuration in the flash memory, `fallback` that of the fallback.
    ///
    /// The command is not answered either, see [`reset`](Self::reset).
    ///
    /// # Errors
    /// [`EthernetError::Firmware`], and errors of the bus.
    pub fn reload(&mut self, user: u32, fallback: u32) -> Result<(), EthernetError> {
        self.need_firmware(read_only::RELOAD_FIRMWARE)?;
        self.send_control(control::ICAP, &icap_reboot(user, fallback))?;
        self.bus.wait(Duration::from_secs(2));
        Ok(())
    }

    fn need_firmware(&mut self, needed: u16) -> Result<(), EthernetError> {
        let [found] = self.words(Space::ReadOnly, read_only::FIRMWARE_VERSION)?;
        if found < needed {
            return Err(EthernetError::Firmware { needed, found });
        }
        Ok(())
    }
}

fn low_first(address: Ipv4Addr) -> [u16; 2] {
    let bits = address.to_bits();
    [bits as u16, (bits >> 16) as u16]
}

/// Words for the configuration port of a Spartan-6 that make it load from another address of its
/// flash memory (the IPROG sequence of its configuration guide).
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::{BusError, Clock, Instant};
    use crate::lbp16::Operations;
    use alloc::vec::Vec;

    /// A mode register whose other bits are the board's own and change; `is_stuck`: it keeps no
    /// write.
    #[derive(Debug)]
    struct Leds {
        word: u16,
        is_stuck: bool,
        writes: usize,
    }

    impl Clock for Leds {
        fn now(&mut self) -> Instant {
            Instant::from_nanos(0)
        }

        fn wait(&mut self, _: Duration) {}
    }

    impl Lbp16Board for Leds {
        fn run_commands(
            &mut self,
            commands: &[u8],
            reply: &mut [u8],
            _: Duration,
        ) -> Result<(), BusError> {
            let mut answer = Vec::new();
            for operation in Operations::new(commands).map(Result::unwrap) {
                assert_eq!(operation.address, Some(control::LED_MODE));
                for value in operation.elements() {
                    self.writes += 1;
                    if !self.is_stuck {
                        self.word = value as u16;
                    }
                }
                if !operation.command.write {
                    self.word = self.word.wrapping_add(2);
                    answer.extend(self.word.to_le_bytes());
                }
            }
            reply.copy_from_slice(&answer);
            Ok(())
        }

        fn send(&mut self, _: &[u8]) -> Result<(), BusError> {
            unreachable!("everything is answered")
        }
    }

    #[test]
    fn led_mode_compares_only_its_own_bit() {
        let (word, is_stuck, writes) = (0xFF01, false, 0);
        let mut leds = Leds {
            word,
            is_stuck,
            writes,
        };
        let mut board = EthernetBoard::new(&mut leds);
        for mode in [LedMode::HostMot2, LedMode::HostMot2, LedMode::Debug] {
            assert_eq!(board.set_led_mode(LedTime::Now, mode), Ok(()));
            assert_eq!(board.led_mode(LedTime::Now), Ok(mode));
        }
        assert_eq!((leds.word & 0xFF00, leds.writes), (0xFF00, 2));
        leds.is_stuck = true;
        let mut board = EthernetBoard::new(&mut leds);
        let error = board.set_led_mode(LedTime::Now, LedMode::HostMot2);
        assert!(matches!(error, Err(EthernetError::NotKept { .. })));
    }
}

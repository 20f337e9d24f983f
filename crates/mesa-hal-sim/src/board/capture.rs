//! A capture of a board's packets, in the format of wireshark and tcpdump.

use core::net::{Ipv4Addr, SocketAddrV4};
use core::time::Duration;
use std::io::{self, Write};

use byteorder::{BE, ByteOrder, LE};

/// pcap with nanoseconds, in the byte order of the file.
/// <https://www.ietf.org/archive/id/draft-gharris-opsawg-pcap-01.html>
const MAGIC: u32 = 0xA1B2_3C4D;
const VERSION: [u16; 2] = [2, 4];
const LINK_ETHERNET: u32 = 1;
const SNAP_LENGTH: u32 = 65_535;

const FILE_HEADER: usize = 24;
const RECORD: usize = 16;
const ETHERNET: usize = 14;
const IP: usize = 20;
const UDP: usize = 8;
const HEADERS: usize = ETHERNET + IP + UDP;

const IPV4: u16 = 0x0800;
const UDP_PROTOCOL: u8 = 17;

/// Maximum payload of a UDP packet.
const MAX_BYTES: usize = 65_507;

/// One end of a packet's path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Endpoint {
    /// Its MAC address.
    pub mac: [u8; 6],
    /// Its IP address and its port.
    pub address: SocketAddrV4,
}

impl Endpoint {
    /// An end whose MAC address is unknown: a locally administered address that contains the IP
    /// address.
    pub fn unknown(address: SocketAddrV4) -> Self {
        let [a, b, c, d] = address.ip().octets();
        Self {
            mac: [0x02, 0x00, a, b, c, d],
            address,
        }
    }
}

/// Observer of a board's packets.
pub trait Tap: core::fmt::Debug + Send {
    /// Called for a packet, with its time since 1970: a request as it arrived, a reply as it left.
    fn packet(&mut self, at: Duration, from: Endpoint, to: Endpoint, payload: &[u8]);
}

/// A writer of capture files: pcap 2.4, Ethernet, times in nanoseconds.
#[derive(Debug)]
pub struct PcapWriter<W> {
    to: W,
    left: u64,
    record: Vec<u8>,
}

impl<W: Write> PcapWriter<W> {
    /// A file of at most `limit` bytes; writes its header.
    pub fn new(mut to: W, limit: u64) -> io::Result<Self> {
        let mut header = [0; FILE_HEADER];
        let (magic, rest) = header.split_at_mut(4);
        LE::write_u32(magic, MAGIC);
        let (version, rest) = rest.split_at_mut(4);
        LE::write_u16_into(&VERSION, version);
        // Time zone and accuracy are 0.
        let (_, rest) = rest.split_at_mut(8);
        LE::write_u32_into(&[SNAP_LENGTH, LINK_ETHERNET], rest);
        to.write_all(&header)?;
        Ok(Self {
            to,
            left: limit.saturating_sub(FILE_HEADER as u64),
            record: Vec::new(),
        })
    }

    /// Writes a packet with a single write. Returns `false` without writing if the packet exceeds
    /// the limit.
    pub fn packet(
        &mut self,
        at: Duration,
        from: Endpoint,
        to: Endpoint,
        payload: &[u8],
    ) -> io::Result<bool> {
        let payload = payload.get(..MAX_BYTES).unwrap_or(payload);
        let frame = (HEADERS + payload.len()) as u32;
        let size = u64::from(frame) + RECORD as u64;
        if size > self.left {
            return Ok(false);
        }
        self.left -= size;
        self.record.clear();
        for word in [at.as_secs() as u32, at.subsec_nanos(), frame, frame] {
            self.record.extend(word.to_le_bytes());
        }
        self.record.extend(to.mac);
        self.record.extend(from.mac);
        self.record.extend(IPV4.to_be_bytes());
        let (from, to) = (from.address, to.address);
        self.record.extend(ip_header(*from.ip(), *to.ip(), payload));
        self.record.extend(udp_header(from, to, payload));
        self.record.extend(payload);
        self.to.write_all(&self.record)?;
        Ok(true)
    }

    /// Returns the underlying writer.
    pub fn into_inner(self) -> W {
        self.to
    }
}

fn ip_header(from: Ipv4Addr, to: Ipv4Addr, payload: &[u8]) -> [u8; IP] {
    let mut header = [0; IP];
    let length = (IP + UDP + payload.len()) as u16;
    let [high, low] = length.to_be_bytes();
    // Version 4, five words; not fragmented; time to live 64.
    let start = [0x45, 0, high, low, 0, 0, 0x40, 0, 64, UDP_PROTOCOL, 0, 0];
    let bytes = start.into_iter().chain(from.octets()).chain(to.octets());
    for (slot, byte) in header.iter_mut().zip(bytes) {
        *slot = byte;
    }
    let checksum = (!sum(&header, 0)).to_be_bytes();
    let [.., a, b, _, _, _, _, _, _, _, _] = &mut header;
    [*a, *b] = checksum;
    header
}

fn udp_header(from: SocketAddrV4, to: SocketAddrV4, payload: &[u8]) -> [u8; UDP] {
    let length = (UDP + payload.len()) as u16;
    let mut header = [0; UDP];
    BE::write_u16_into(&[from.port(), to.port(), length, 0], &mut header);
    let mut addresses = [0; 8];
    let octets = from.ip().octets().into_iter().chain(to.ip().octets());
    for (slot, byte) in addresses.iter_mut().zip(octets) {
        *slot = byte;
    }
    // The pseudo header: addresses, protocol, length.
    let start = u32::from(UDP_PROTOCOL) + u32::from(length);
    let start = start + u32::from(sum(&addresses, 0)) + u32::from(sum(&header, 0));
    let checksum = match !sum(payload, start) {
        // A checksum of 0 means that the packet has no checksum.
        0 => 0xFFFF,
        checksum => checksum,
    };
    let [.., a, b] = &mut header;
    [*a, *b] = checksum.to_be_bytes();
    header
}

/// The ones' complement sum of RFC 1071.
fn sum(bytes: &[u8], start: u32) -> u16 {
    let words = bytes.chunks(2).map(|pair| match pair {
        [high, low] => u32::from(u16::from_be_bytes([*high, *low])),
        [high] => u32::from(*high) << 8,
        _ => 0,
    });
    let mut total = words.fold(start, |total, word| total + word);
    while total > 0xFFFF {
        total = (total & 0xFFFF) + (total >> 16);
    }
    total as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    fn end(mac: u8, ip: [u8; 4], port: u16) -> Endpoint {
        Endpoint {
            mac: [0x00, 0x60, 0x1B, 0, 0, mac],
            address: SocketAddrV4::new(Ipv4Addr::from(ip), port),
        }
    }

    fn captured(limit: u64, payloads: &[&[u8]]) -> (Vec<bool>, Vec<u8>) {
        let mut file = PcapWriter::new(Vec::new(), limit).unwrap();
        let from = end(1, [10, 10, 10, 1], 40_000);
        let to = end(2, [10, 10, 10, 10], 27_181);
        let at = Duration::new(1_700_000_000, 123_456_789);
        let written = payloads.iter();
        let written = written.map(|payload| file.packet(at, from, to, payload).unwrap());
        (written.collect(), file.into_inner())
    }

    /// A request of the cookie, as on the wire; the checksums were computed by hand.
    #[test]
    fn packet_has_its_headers_and_checksums() {
        let (_, file) = captured(1000, &[&[0x01, 0x42, 0x00, 0x01]]);
        let header = [
            0x4D, 0x3C, 0xB2, 0xA1, 2, 0, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xFF, 0xFF, 0, 0, 1, 0, 0,
            0,
        ];
        assert_eq!(file[..24], header);
        assert_eq!(
            file[24..32],
            [0x00, 0xF1, 0x53, 0x65, 0x15, 0xCD, 0x5B, 0x07]
        );
        assert_eq!(file[32..40], [46, 0, 0, 0, 46, 0, 0, 0]);
        assert_eq!(file[40..46], [0x00, 0x60, 0x1B, 0, 0, 2]);
        assert_eq!(file[52..54], [0x08, 0x00]);
        // 4500 + 0020 + 4000 + 4011 + 0A0A + 0A01 + 0A0A + 0A0A = ED50, and its complement.
        assert_eq!(file[64..66], [0x12, 0xAF]);
        // Ones' complement sum of the pseudo header, the UDP header and the payload, word by word.
        let words: u32 = [
            0x0A0A, 0x0A01, 0x0A0A, 0x0A0A, 0x0011, 0x000C, 0x9C40, 0x6A2D, 0x000C, 0x0142, 0x0001,
        ]
        .iter()
        .sum();
        let folded = (words & 0xFFFF) + (words >> 16);
        let checksum = u16::from_be_bytes([file[80], file[81]]);
        assert_eq!(u32::from(!checksum), folded);
        assert_eq!(file[82..], [0x01, 0x42, 0x00, 0x01]);
    }

    #[test]
    fn file_does_not_grow_beyond_its_limit() {
        let odd = [0xFF; 101];
        let (written, file) = captured(24 + 2 * (16 + 42 + 101), &[&odd, &odd, &odd, &[]]);
        assert_eq!(written, [true, true, false, false]);
        assert_eq!(file.len(), 24 + 2 * (16 + 42 + 101));
    }
}

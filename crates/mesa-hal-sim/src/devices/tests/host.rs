//! A host on the line of a simulated device.

use crate::wire::{BIT_2M5, Burst, Nanos, RemoteEnd};
use mesa_wire::lbp::{
    AccessSize, DISCOVERY, DiscoveryReply, LocalLocation, PROCESS_DATA, RemoteAccess, RemoteFaults,
    Request, crc8,
};

/// A host on the line of one device; each request advances the time.
pub(super) struct Host<'a> {
    pub(super) remote: &'a mut dyn RemoteEnd,
    pub(super) now: Nanos,
}

impl<'a> Host<'a> {
    pub(super) fn new(remote: &'a mut dyn RemoteEnd) -> Self {
        Self { remote, now: 0 }
    }

    pub(super) fn wait(&mut self, time: Nanos) {
        self.now += time;
        self.remote.advance(self.now);
    }

    /// The data of the reply, if there is one.
    pub(super) fn ask(&mut self, request: &Request) -> Option<Vec<u8>> {
        let reply = self.send(request.as_bytes())?;
        Some(request.check_reply(&reply).unwrap().to_vec())
    }

    /// Sends a frame without its CRC, and returns the reply without its own.
    pub(super) fn raw(&mut self, body: &[u8]) -> Vec<u8> {
        let mut reply = self.send(&[body, &[crc8(body)]].concat()).unwrap();
        let crc = reply.pop();
        assert_eq!(crc, Some(crc8(&reply)));
        reply
    }

    fn send(&mut self, frame: &[u8]) -> Option<Vec<u8>> {
        let mut end = self.now;
        for part in frame.chunks(crate::wire::MAX_BURST) {
            let burst = Burst::new(end, BIT_2M5, part);
            end = burst.end();
            self.remote.advance(end);
            self.remote.receive(&burst);
        }
        self.now = end + 20_000;
        let reply = self.remote.transmit()?;
        self.now = reply.end() + 20_000;
        Some(reply.bytes().to_vec())
    }

    fn access(&mut self, access: RemoteAccess) -> u64 {
        let mut bytes = self.ask(&Request::access(access)).unwrap();
        bytes.resize(8, 0);
        u64::from_le_bytes(bytes.try_into().unwrap())
    }

    pub(super) fn local(&mut self, location: LocalLocation) -> u8 {
        self.access(RemoteAccess::ReadLocal(location)) as u8
    }

    pub(super) fn set(&mut self, location: LocalLocation, value: u8) {
        self.access(RemoteAccess::WriteLocal(location, value));
    }

    pub(super) fn read(&mut self, address: u16, size: AccessSize) -> u64 {
        self.access(RemoteAccess::Read { address, size })
    }

    pub(super) fn write(&mut self, address: u16, size: AccessSize, value: u64) {
        self.access(RemoteAccess::Write {
            address,
            size,
            value,
        });
    }

    pub(super) fn discovery(&mut self) -> DiscoveryReply {
        let request = Request::rpc(DISCOVERY, &[], 6);
        DiscoveryReply::from_bytes(self.ask(&request).unwrap().try_into().unwrap())
    }

    pub(super) fn exchange(
        &mut self,
        sizes: DiscoveryReply,
        out: &[u8],
    ) -> (RemoteFaults, Vec<u8>) {
        let mut data = out.to_vec();
        data.resize(sizes.tx_size.into(), 0);
        let request = Request::rpc(PROCESS_DATA, &data, sizes.rx_size.into());
        let reply = self.ask(&request).unwrap();
        (
            RemoteFaults::from_bits_retain(reply[0]),
            reply[1..].to_vec(),
        )
    }

    /// The steps of SSLBP at START after discovery.
    pub(super) fn start(&mut self, mode: u8) -> DiscoveryReply {
        self.set(LocalLocation::SOFTWARE_MODE, mode);
        let sizes = self.discovery();
        self.exchange(sizes, &[]);
        self.set(LocalLocation::CLEAR_FAULTS, 0xFF);
        assert_eq!(self.local(LocalLocation::CLEAR_FAULTS), 0);
        assert_eq!(self.local(LocalLocation::FAULTS), 0);
        sizes
    }

    pub(super) fn string(&mut self, mut address: u16) -> (String, u16) {
        let mut text = String::new();
        loop {
            let byte = self.read(address, AccessSize::Byte) as u8;
            address += 1;
            if byte == 0 {
                return (text, address);
            }
            text.push(byte.into());
        }
    }

    /// Names of a table's records with their first twelve bytes, in order.
    pub(super) fn table(&mut self, mut address: u16) -> Vec<(String, Vec<u8>)> {
        let mut records = Vec::new();
        loop {
            let record = self.read(address, AccessSize::Word) as u16;
            address += 2;
            if record == 0 {
                return records;
            }
            let head: Vec<u8> = (0..14)
                .map(|n| self.read(record + n, AccessSize::Byte) as u8)
                .collect();
            let name = match head[0] {
                0xA0 => {
                    let (_, name) = self.string(record + 14);
                    self.string(name).0
                }
                0xB0 => self.string(record + 4).0,
                other => panic!("record type {other:02X}"),
            };
            records.push((name, head));
        }
    }
}

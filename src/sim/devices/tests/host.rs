//! A host on the line of a simulated device.

use crate::{
    lbp::{
        Access, DataSize, DiscoveryReply, LocalRead, LocalWrite, RemoteFaults, Request, RpcNumber,
    },
    sim::wire::{BIT_2M5, Burst, Nanos, RemoteEnd},
};

/// A host on the line of one device; time goes on with each request.
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

    /// The data of the answer, if there is one.
    pub(super) fn ask(&mut self, request: &Request) -> Option<Vec<u8>> {
        let mut end = self.now;
        for part in request.as_bytes().chunks(crate::sim::wire::MAX_BURST) {
            let burst = Burst::new(end, BIT_2M5, part);
            end = burst.end();
            self.remote.advance(end);
            self.remote.receive(&burst);
        }
        self.now = end + 20_000;
        let reply = self.remote.transmit()?;
        self.now = reply.end() + 20_000;
        Some(request.check_reply(reply.bytes()).unwrap().to_vec())
    }

    pub(super) fn local(&mut self, read: LocalRead) -> u8 {
        self.ask(&Request::local_read(read)).unwrap()[0]
    }

    pub(super) fn set(&mut self, write: LocalWrite, value: u8) {
        let reply = self.ask(&Request::local_write(write, value)).unwrap();
        assert!(reply.is_empty());
    }

    pub(super) fn read(&mut self, address: u16, size: DataSize) -> u64 {
        let request = Request::access(Access::read(size), Some(address), &[]).unwrap();
        let mut bytes = self.ask(&request).unwrap();
        bytes.resize(8, 0);
        u64::from_le_bytes(bytes.try_into().unwrap())
    }

    pub(super) fn write(&mut self, address: u16, size: DataSize, value: u64) {
        let bytes = &value.to_le_bytes()[..size.bytes()];
        let request = Request::access(Access::write(size), Some(address), bytes).unwrap();
        self.ask(&request).unwrap();
    }

    pub(super) fn discovery(&mut self) -> DiscoveryReply {
        let request = Request::rpc(RpcNumber::DISCOVERY, &[], 6).unwrap();
        DiscoveryReply::from_bytes(self.ask(&request).unwrap().try_into().unwrap())
    }

    pub(super) fn exchange(
        &mut self,
        sizes: DiscoveryReply,
        out: &[u8],
    ) -> (RemoteFaults, Vec<u8>) {
        let mut data = out.to_vec();
        data.resize(sizes.tx_size.into(), 0);
        let request = Request::rpc(RpcNumber::PROCESS_DATA, &data, sizes.rx_size.into());
        let reply = self.ask(&request.unwrap()).unwrap();
        (
            RemoteFaults::from_bits_retain(reply[0]),
            reply[1..].to_vec(),
        )
    }

    /// What SSLBP does at START after discovery.
    pub(super) fn start(&mut self, mode: u8) -> DiscoveryReply {
        self.set(LocalWrite::SoftwareMode, mode);
        let sizes = self.discovery();
        self.exchange(sizes, &[]);
        self.set(LocalWrite::ClearFaults, 0xFF);
        assert_eq!(self.local(LocalRead::ClearFaults), 0);
        assert_eq!(self.local(LocalRead::Faults), 0);
        sizes
    }

    pub(super) fn string(&mut self, mut address: u16) -> (String, u16) {
        let mut text = String::new();
        loop {
            let byte = self.read(address, DataSize::Byte) as u8;
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
            let record = self.read(address, DataSize::Word) as u16;
            address += 2;
            if record == 0 {
                return records;
            }
            let head: Vec<u8> = (0..14)
                .map(|n| self.read(record + n, DataSize::Byte) as u8)
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

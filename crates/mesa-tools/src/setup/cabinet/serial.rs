//! The remote on a serial port, as a cabinet.

use std::io::{Read, Write};

use super::{Cabinet, CabinetRemote, RemotePlace};
use crate::setup::{CabinetError, SerialError, SerialHost, SerialRemote};
use mesa_hal::discovery::{DataRecord, Discovery, DiscoveryOptions};
use mesa_hal::hal::AnyValue;
use mesa_hal::lbp::{RemoteAccess, RemoteLink};
use mesa_hal::remote::ParameterError;

/// The remote on a serial port, with its description.
#[derive(Debug)]
pub struct SerialCabinet<P> {
    host: SerialHost<P>,
    /// Identity of the remote.
    pub remote: SerialRemote,
    /// Result of the discovery.
    pub found: Discovery,
}

impl<P: Read + Write> SerialCabinet<P> {
    /// Identifies the remote on the serial port, and discovers its parameters.
    ///
    /// # Errors
    /// [`SerialError`]: no remote answers. Problems in its tables are in [`found`](Self::found).
    pub fn open(mut host: SerialHost<P>) -> Result<Self, SerialError> {
        let remote = host.identify()?;
        let found = host.discover(&remote, &DiscoveryOptions::default());
        Ok(Self {
            host,
            remote,
            found,
        })
    }

    fn record(&self, name: &str) -> Result<DataRecord, ParameterError> {
        let record = self.found.descriptor.parameter(name);
        record.cloned().ok_or(ParameterError::Unknown)
    }
}

impl<P: Read + Write> Cabinet for SerialCabinet<P> {
    fn remotes(&self) -> Vec<CabinetRemote> {
        vec![CabinetRemote {
            place: RemotePlace::Serial,
            descriptor: self.found.descriptor.clone(),
        }]
    }

    fn read(&mut self, _place: RemotePlace, name: &str) -> Result<u64, CabinetError> {
        let record = self.record(name);
        let value = record.and_then(|record| record.read_parameter(&mut self.host));
        value.map(|value| value.raw).map_err(|source| {
            let name = name.into();
            CabinetError::Serial { name, source }
        })
    }

    fn write(
        &mut self,
        _place: RemotePlace,
        name: &str,
        value: AnyValue,
    ) -> Result<(), CabinetError> {
        let record = self.record(name);
        let written = record.and_then(|record| record.write_parameter(&mut self.host, value));
        written.map_err(|source| {
            let name = name.into();
            CabinetError::Serial { name, source }
        })
    }

    fn exchange(&mut self, _place: RemotePlace, access: RemoteAccess) -> Result<u64, CabinetError> {
        self.host.exchange(access).map_err(|error| {
            let name = access.to_string().into();
            let source = ParameterError::Link(error);
            CabinetError::Serial { name, source }
        })
    }
}

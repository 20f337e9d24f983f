//! LBP host on a serial port.

use core::time::Duration;
use std::io::{ErrorKind, Read, Write};
use std::thread;
use std::time::Instant;

use super::{SerialError, SerialRequest};
use mesa_hal::discovery::{Discovery, DiscoveryOptions, discover};
use mesa_hal::lbp::{
    COOKIE, DISCOVERY, DiscoveryReply, LocalLocation, RemoteAccess, RemoteLink, RemoteLinkError,
    Request, UNIT_NUMBER,
};
use mesa_hal::sslbp::{
    Channel, CsStatus, MAX_INTERFACE_REGISTERS, ProcessDataSizes, RemoteName, StartedRemote,
};

/// Baud rate of a card whose jumper is in the setup position, whatever its `NVBaudRate` is.
///
/// Manual: 7I77, "SETUP/OPERATE MODE".
pub const SETUP_BAUD_RATE: u32 = 115_200;

/// Channel number of a remote on a serial port.
const CHANNEL: Channel = Channel::ALL[0];

/// Number of attempts for a request.
const ATTEMPTS: u8 = 3;

/// Reply timeout, from the end of the request. The longest operation before a reply is the erasure
/// of a flash block; a USB adapter adds some 16 ms in each direction.
const REPLY: Duration = Duration::from_millis(500);

/// Quiet time required on the line after a failure: longer than the frame timeout of a card in
/// setup mode (25.5 characters, 2.1 ms at 115200 baud; manual 7I77, "FRAMING") and an adapter's
/// buffering together.
const QUIET: Duration = Duration::from_millis(60);

/// Time limit for the line to become quiet.
const QUIET_WITHIN: Duration = Duration::from_secs(1);

/// Interval between reads of a port that does not wait by itself.
const LOOK: Duration = Duration::from_micros(500);

/// LBP host on a serial port that is connected to one card in setup mode, with the functions of
/// Mesa's RPD, WPD and UFLBP.
///
/// The port is any type that reads and writes characters, 8N1, at the card's baud rate
/// ([`SETUP_BAUD_RATE`]). Its `read` must not block for ever: it needs a timeout of 1 to 100 ms,
/// after which it fails with [`ErrorKind::TimedOut`] or [`ErrorKind::WouldBlock`], or reads 0
/// bytes.
///
/// ```no_run
/// use mesa_tools::setup::SerialHost;
///
/// # let port = std::fs::File::open("/dev/ttyUSB0")?;
/// // `port` is, for example, serialport::new("/dev/ttyUSB0", SETUP_BAUD_RATE).timeout(...).open()?
/// let mut host = SerialHost::new(port);
/// let remote = host.identify()?;
/// let found = host.discover(&remote, &Default::default());
/// for record in &found.descriptor.parameters {
///     let value = record.read_parameter(&mut host)?;
///     println!("{} {:#x}", record.name, value.raw);
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// Manual: 7I77, "RPD, WPD, AND UFLBP"; FACTS 1.
#[derive(Debug)]
pub struct SerialHost<P> {
    port: P,
    reply: Duration,
    quiet: Duration,
}

/// The remote on a serial port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SerialRemote {
    /// Identity of the remote, as START reports it through an FPGA. Its channel is 0.
    pub started: StartedRemote,
    /// True if the remote answers only what a bootloader answers, and neither the unit number nor
    /// discovery: its program is missing or incomplete, or it is older than discovery.
    pub is_bare: bool,
}

impl<P: Read + Write> SerialHost<P> {
    /// Creates a host on a port that is already open.
    pub const fn new(port: P) -> Self {
        Self {
            port,
            reply: REPLY,
            quiet: QUIET,
        }
    }

    /// Returns the port.
    pub fn into_inner(self) -> P {
        self.port
    }

    /// Identifies the remote, as START does through an FPGA (FACTS 4.1).
    ///
    /// # Errors
    /// [`SerialError`], after at most some seconds.
    pub fn identify(&mut self) -> Result<SerialRemote, SerialError> {
        // An earlier host may have ended in the middle of a request, or of an access to another
        // memory.
        self.become_quiet()?;
        let found = self.access_memory(RemoteAccess::ReadLocal(LocalLocation::COOKIE))? as u8;
        if found != COOKIE {
            return Err(SerialError::NotARemote { found });
        }
        for (location, value) in [(LocalLocation::STATUS, 0), (LocalLocation::NONVOLATILE, 0)] {
            self.access_memory(RemoteAccess::WriteLocal(location, value))?;
        }
        let mut name = [0; 4];
        for (index, character) in (LocalLocation::NAME.index()..).zip(&mut name) {
            if let Some(location) = LocalLocation::new(index) {
                *character = self.access_memory(RemoteAccess::ReadLocal(location))? as u8;
            }
        }
        let software_mode =
            self.access_memory(RemoteAccess::ReadLocal(LocalLocation::SOFTWARE_MODE))? as u8;
        let unit_number = self.call::<4>(UNIT_NUMBER)?.map(u32::from_le_bytes);
        let discovery = self.call::<6>(DISCOVERY)?.map(DiscoveryReply::from_bytes);
        let is_bare = unit_number.is_none() && discovery.is_none();
        let discovery = discovery.unwrap_or_default();
        Ok(SerialRemote {
            started: StartedRemote {
                channel: CHANNEL,
                software_mode,
                unit_number: unit_number.unwrap_or(0),
                name: RemoteName(name),
                ptoc: discovery.ptoc,
                gtoc: discovery.gtoc,
                sizes: ProcessDataSizes {
                    rx: discovery.rx_size,
                    tx: discovery.tx_size,
                },
                cs: CsStatus::default(),
            },
            is_bare,
        })
    }

    /// Reads the tables of the remote that [`identify`](Self::identify) returned: its process data,
    /// parameters and modes. Problems in the tables are part of the result.
    pub fn discover(&mut self, remote: &SerialRemote, options: &DiscoveryOptions<'_>) -> Discovery {
        discover(self, &remote.started, MAX_INTERFACE_REGISTERS, options)
    }

    /// A remote procedure call without data; `None` if the remote does not answer it.
    fn call<const N: usize>(&mut self, command: u8) -> Result<Option<[u8; N]>, SerialError> {
        let request = Request::rpc(command, &[], N);
        match self.ask(SerialRequest::Rpc(command), &request) {
            Ok(reply) => Ok(reply.get(..N).and_then(|reply| reply.try_into().ok())),
            Err(SerialError::NoReply { .. }) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Sends any request once, and returns the data of its reply. It is not repeated, because some
    /// have another effect the second time, as an access with
    /// [`auto_increment`](mesa_hal::lbp::MemoryAddress::auto_increment).
    ///
    /// # Errors
    /// [`SerialError`].
    pub fn request(&mut self, request: &Request) -> Result<Vec<u8>, SerialError> {
        let command = request.as_bytes().first().copied().unwrap_or(0);
        self.ask_times(1, SerialRequest::Command(command), request)
    }

    /// Sends a request until a valid reply arrives, at most `ATTEMPTS` times.
    fn ask(&mut self, asked: SerialRequest, request: &Request) -> Result<Vec<u8>, SerialError> {
        self.ask_times(ATTEMPTS, asked, request)
    }

    fn ask_times(
        &mut self,
        attempts: u8,
        asked: SerialRequest,
        request: &Request,
    ) -> Result<Vec<u8>, SerialError> {
        let mut wrong = None;
        for _ in 0..attempts {
            self.port.write_all(request.as_bytes())?;
            self.port.flush()?;
            let reply = self.reply(request.reply_len())?;
            match request.check_reply(&reply) {
                Ok(data) => return Ok(data.to_vec()),
                Err(_) if reply.is_empty() => {}
                Err(error) => wrong = Some(error),
            }
            self.become_quiet()?;
        }
        Err(match wrong {
            None => SerialError::NoReply { asked, attempts },
            Some(source) => SerialError::Damaged {
                asked,
                attempts,
                source,
            },
        })
    }

    /// Reads `len` characters; fewer if no more arrive in time, more if more arrive together with
    /// them.
    fn reply(&mut self, len: usize) -> Result<Vec<u8>, SerialError> {
        let until = Instant::now() + self.reply;
        let mut reply = Vec::new();
        while reply.len() < len && Instant::now() < until {
            let mut buffer = [0; 64];
            let count = self.read(&mut buffer)?;
            reply.extend(buffer.get(..count).unwrap_or_default());
        }
        Ok(reply)
    }

    /// Discards input until the line has been quiet for the required time.
    fn become_quiet(&mut self) -> Result<(), SerialError> {
        let until = Instant::now() + QUIET_WITHIN;
        let mut since = Instant::now();
        while since.elapsed() < self.quiet {
            if self.read(&mut [0; 64])? > 0 {
                since = Instant::now();
            }
            if since > until {
                return Err(SerialError::NeverQuiet);
            }
        }
        Ok(())
    }

    /// Reads or writes, and returns the value read.
    fn access_memory(&mut self, access: RemoteAccess) -> Result<u64, SerialError> {
        let reply = self.ask(SerialRequest::Access(access), &Request::access(access))?;
        let mut value = [0; 8];
        for (to, from) in value.iter_mut().zip(reply) {
            *to = from;
        }
        Ok(u64::from_le_bytes(value))
    }

    /// Reads the characters that have arrived; 0 after the port's own timeout.
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, SerialError> {
        let asked = Instant::now();
        let count = match self.port.read(buffer) {
            Ok(count) => count,
            Err(error) => match error.kind() {
                ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted => 0,
                _ => return Err(error.into()),
            },
        };
        if count == 0 && asked.elapsed() < LOOK {
            thread::sleep(LOOK);
        }
        Ok(count)
    }
}

impl<P: Read + Write> RemoteLink for SerialHost<P> {
    fn exchange(&mut self, access: RemoteAccess) -> Result<u64, RemoteLinkError> {
        Ok(self.access_memory(access)?)
    }

    fn wait(&mut self, time: Duration) {
        thread::sleep(time);
    }
}

#[cfg(test)]
mod tests;

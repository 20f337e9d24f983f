//! Serial front end of a simulated remote: real hosts, real time.

use core::time::Duration;
use std::io::{self, ErrorKind, Read, Write};
use std::os::fd::AsFd;
use std::thread;
use std::time::Instant;

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::wire::{Burst, MAX_BURST, Nanos, RemoteEnd};

/// Maximum wait of one step.
const LONGEST: Duration = Duration::from_millis(100);

/// A serial port with a simulated remote at its other end, in real time: for example the master
/// side of a pseudoterminal, whose slave side is the serial port of a host.
///
/// Call [`step`](Self::step) in a loop.
#[derive(Debug)]
pub struct SerialFace<P> {
    port: P,
    start: Instant,
    bit: Nanos,
    line_free: Nanos,
}

impl<P: Read + Write + AsFd> SerialFace<P> {
    /// A front end on a port with non-blocking reads, and a line of 115200 baud. The remote is
    /// powered up now.
    pub fn new(port: P) -> Self {
        Self {
            port,
            start: Instant::now(),
            bit: 0,
            line_free: 0,
        }
        .with_baud_rate(115_200)
    }

    fn with_baud_rate(mut self, baud: u32) -> Self {
        self.set_baud_rate(baud);
        self
    }

    /// Sets the baud rate of the host: characters sent at another rate than the remote's arrive as
    /// other characters, or not at all. 1 to 10 million; 0 counts as 1.
    pub fn set_baud_rate(&mut self, baud: u32) {
        self.bit = (1_000_000_000 / u64::from(baud.max(1))).max(1);
    }

    /// Virtual time of the remote.
    pub fn now(&self) -> Nanos {
        self.start.elapsed().as_nanos() as Nanos
    }

    /// The port.
    pub const fn port(&self) -> &P {
        &self.port
    }

    /// Waits for characters, at most `most` and at most 100 ms, passes them to the remote, and
    /// sends its replies.
    ///
    /// # Errors
    /// The port fails.
    pub fn step(&mut self, remote: &mut dyn RemoteEnd, most: Duration) -> io::Result<()> {
        let most = Timespec {
            tv_sec: 0,
            tv_nsec: most.min(LONGEST).as_nanos() as i64,
        };
        let mut wanted = [PollFd::new(&self.port, PollFlags::IN)];
        match poll(&mut wanted, Some(&most)) {
            Err(rustix::io::Errno::INTR) => {}
            result => drop(result?),
        }
        let mut buffer = [0; MAX_BURST];
        let count = match self.port.read(&mut buffer) {
            Ok(count) => count,
            Err(error) if error.kind() == ErrorKind::WouldBlock => 0,
            Err(error) => return Err(error),
        };
        let now = self.now();
        remote.advance(now);
        if count == 0 {
            return Ok(());
        }
        let data = buffer.get(..count).unwrap_or_default();
        let request = Burst::new(now.max(self.line_free), self.bit, data);
        self.line_free = request.end();
        self.wait_until(self.line_free);
        remote.advance(self.line_free);
        remote.receive(&request);
        while let Some(reply) = remote.transmit() {
            self.wait_until(reply.end());
            self.send(&reply)?;
        }
        Ok(())
    }

    /// Sends a reply, sampled at the host's rate: at another one the host gets nonsense.
    fn send(&mut self, reply: &Burst) -> io::Result<()> {
        let mut characters = Vec::new();
        super::remote::sample(reply, self.bit, |_, byte| characters.push(byte));
        self.port.write_all(&characters)
    }

    fn wait_until(&self, time: Nanos) {
        let left = time.saturating_sub(self.now());
        thread::sleep(Duration::from_nanos(left));
    }
}

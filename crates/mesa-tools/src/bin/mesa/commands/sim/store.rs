//! The state file: written beside the old one, then renamed over it, so that a power cut leaves a
//! complete file.

use std::{
    io,
    path::Path,
    sync::mpsc::{Receiver, Sender, channel},
    thread::JoinHandle,
    time::{Duration, Instant},
};

use crate::ui::files::{bounded, probe, put};
use crate::ui::output::complain;

/// Shortest interval of writes while changes follow one another. A first change is written at once.
const OFTEN: Duration = Duration::from_secs(1);

/// Time without a change after which a state is written earlier than `OFTEN`.
const QUIET: Duration = Duration::from_millis(100);

/// Size limit of a state file; no real one comes near it.
const MAX_BYTES: u64 = 4 << 20;

/// Writes states to a file in a thread of its own, because a disk may be slower than a client's
/// timeout.
pub struct Store {
    sender: Sender<Vec<u8>>,
    writer: JoinHandle<()>,
    saved: Saved,
    seen: u64,
    since: Instant,
}

/// Change counter and time of the last write.
struct Saved {
    changes: u64,
    at: Option<Instant>,
}

impl Store {
    /// Reads the file, if it exists, and starts the thread that writes it.
    pub fn open(path: &Path) -> io::Result<(Self, Option<Vec<u8>>)> {
        let old = match bounded(path, MAX_BYTES) {
            Ok(old) => Some(old),
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            Err(error) => return Err(error),
        };
        try_to_write(path)?;
        let (sender, receiver) = channel();
        let path = path.to_owned();
        let store = Self {
            sender,
            writer: std::thread::spawn(move || write_all(&receiver, &path)),
            saved: Saved {
                changes: 0,
                at: None,
            },
            seen: 0,
            since: Instant::now(),
        };
        Ok((store, old))
    }

    /// Writes the state if it has changed.
    pub fn keep(&mut self, changes: u64, state: impl FnOnce() -> Vec<u8>) {
        if changes == self.saved.changes {
            return;
        }
        if changes != self.seen {
            self.seen = changes;
            self.since = Instant::now();
        }
        let waited = self.saved.at.is_none_or(|at| at.elapsed() >= OFTEN);
        if waited || self.since.elapsed() >= QUIET {
            self.saved = Saved {
                changes,
                at: Some(Instant::now()),
            };
            let _ = self.sender.send(state());
        }
    }

    /// Writes the state and waits until it is in the file.
    pub fn close(self, state: Vec<u8>) {
        let _ = self.sender.send(state);
        drop(self.sender);
        let _ = self.writer.join();
    }
}

/// Reports a path that cannot be written at the start, before any state can be lost.
fn try_to_write(path: &Path) -> io::Result<()> {
    probe(path).map_err(|error| {
        let reason = format!("the state could not be written beside it: {error}");
        io::Error::new(error.kind(), reason)
    })
}

fn write_all(receiver: &Receiver<Vec<u8>>, path: &Path) {
    while let Ok(mut state) = receiver.recv() {
        while let Ok(newer) = receiver.try_recv() {
            state = newer;
        }
        if let Err(error) = put(path, &state) {
            let path = path.display();
            complain(format_args!("{path}: {error}; the state is not saved"));
        }
    }
}

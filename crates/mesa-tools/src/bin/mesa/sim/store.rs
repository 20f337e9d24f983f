//! The state file: written beside, then put in place, so that a power cut leaves a whole one.

use std::{
    io,
    path::Path,
    sync::mpsc::{Receiver, Sender, channel},
    thread::JoinHandle,
    time::{Duration, Instant},
};

use crate::files::{bounded, probe, put};
use crate::output::complain;

/// A first change is written at once. While more follow, so often, ...
const OFTEN: Duration = Duration::from_secs(1);

/// ... or when nothing has changed for so long.
const QUIET: Duration = Duration::from_millis(100);

/// More than any state has.
const MOST_BYTES: u64 = 4 << 20;

/// Writes states to a file in a thread of its own, because a disk may be slower than a client waits.
pub struct Store {
    sender: Sender<Vec<u8>>,
    writer: JoinHandle<()>,
    saved: Saved,
    seen: u64,
    since: Instant,
}

/// What was written last.
struct Saved {
    changes: u64,
    at: Option<Instant>,
}

impl Store {
    /// Reads the file, if there is one, and gets ready to write it.
    pub fn open(path: &Path) -> io::Result<(Self, Option<Vec<u8>>)> {
        let old = match bounded(path, MOST_BYTES) {
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

    /// Has the state written when it has changed.
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

    /// Has the state written now, and waits for it.
    pub fn close(self, state: Vec<u8>) {
        let _ = self.sender.send(state);
        drop(self.sender);
        let _ = self.writer.join();
    }
}

/// Says now, and not when there is something to lose, that the state can not be written.
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

//! The state file: written beside, then put in place, so that a power cut leaves a whole one.

use std::{
    fs::{self, File},
    io::{self, Write},
    path::{Path, PathBuf},
    sync::mpsc::{Receiver, Sender, channel},
    thread::JoinHandle,
    time::{Duration, Instant},
};

/// How long nothing has to change before the state is written.
const QUIET: Duration = Duration::from_millis(300);

/// Writes states to a file in a thread of its own, because a disk may be slower than a client waits.
pub struct Store {
    sender: Sender<Vec<u8>>,
    writer: JoinHandle<()>,
    saved: u64,
    seen: u64,
    since: Instant,
}

impl Store {
    /// Reads the file, if there is one, and gets ready to write it.
    pub fn open(path: &Path) -> io::Result<(Self, Option<Vec<u8>>)> {
        let directory = path.parent().filter(|d| !d.as_os_str().is_empty());
        if directory.is_some_and(|directory| !directory.is_dir()) {
            return Err(io::Error::new(
                io::ErrorKind::NotFound,
                "its directory does not exist",
            ));
        }
        let old = match fs::read(path) {
            Ok(bytes) => Some(bytes),
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            Err(error) => return Err(error),
        };
        let (sender, receiver) = channel();
        let path = path.to_owned();
        let store = Self {
            sender,
            writer: std::thread::spawn(move || write_all(&receiver, &path)),
            saved: 0,
            seen: 0,
            since: Instant::now(),
        };
        Ok((store, old))
    }

    /// Has the state written when it has changed and then rested for a while.
    pub fn keep(&mut self, changes: u64, state: impl FnOnce() -> Vec<u8>) {
        if changes != self.seen {
            self.seen = changes;
            self.since = Instant::now();
        } else if changes != self.saved && self.since.elapsed() >= QUIET {
            self.saved = changes;
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

fn write_all(receiver: &Receiver<Vec<u8>>, path: &Path) {
    while let Ok(state) = receiver.recv() {
        if let Err(error) = write(path, &state) {
            eprintln!("{}: {error}; the state is not saved", path.display());
        }
    }
}

fn write(path: &Path, state: &[u8]) -> io::Result<()> {
    let mut beside = path.as_os_str().to_owned();
    beside.push(".new");
    let beside = PathBuf::from(beside);
    let mut file = File::create(&beside)?;
    file.write_all(state)?;
    file.sync_all()?;
    fs::rename(&beside, path)
}

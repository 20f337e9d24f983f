//! Capture file for the packets of all boards.

use std::fs::File;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use mesa_hal_sim::{Endpoint, PcapWriter, Tap};

use crate::ui::context::Failure;
use crate::ui::output::complain;

/// A capture file that several boards write to. Each packet is written at once, so that the file is
/// complete whenever the process ends.
#[derive(Clone, Debug)]
pub struct Capture {
    file: Arc<Mutex<Option<PcapWriter<File>>>>,
    path: Arc<Path>,
}

impl Capture {
    /// Creates a file of at most `limit` bytes.
    pub fn create(path: &Path, limit: u64) -> Result<Self, Failure> {
        let writer = File::create(path).and_then(|file| PcapWriter::new(file, limit));
        let writer = writer
            .map_err(|error| Failure::refused(format_args!("{}: {error}", path.display())))?;
        Ok(Self {
            file: Arc::new(Mutex::new(Some(writer))),
            path: path.into(),
        })
    }
}

impl Tap for Capture {
    fn packet(&mut self, at: Duration, from: Endpoint, to: Endpoint, payload: &[u8]) {
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(writer) = file.as_mut() else {
            return;
        };
        let path = self.path.display();
        match writer.packet(at, from, to, payload) {
            Ok(true) => return,
            Ok(false) => complain(format_args!("{path}: the capture is full, and ends here")),
            Err(error) => complain(format_args!("{path}: {error}; the capture ends here")),
        }
        *file = None;
    }
}

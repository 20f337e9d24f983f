//! Files: whole, or not there.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use crate::context::Failure;

/// Whether a file can be written there, before anything is done for what it shall have: a device, a
/// pipe or a directory stays what it is.
pub fn check(path: &Path) -> Result<(), Failure> {
    let shown = path.display();
    if fs::metadata(path).is_ok_and(|found| !found.is_file()) {
        let what = "no regular file, and it stays what it is; name another";
        return Err(Failure::usage(format_args!("{shown}: {what}")));
    }
    let tried = beside(path).and_then(|beside| {
        File::create(&beside)?;
        fs::remove_file(&beside)
    });
    tried.map_err(|error| Failure::refused(format_args!("{shown}: {error}")))
}

/// Writes a file, [whole](put) or not at all, where it [can be](check).
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    check(path)?;
    put(path, bytes).map_err(|error| {
        let (path, what) = (path.display(), "what was there is as it was");
        Failure::refused(format_args!("{path}: {error}; {what}"))
    })
}

/// Writes a file beside its place, and puts it there when it is on the disk: whoever looks sees the
/// old one, or the whole new one. Nothing is left beside it if that fails.
pub fn put(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let beside = beside(path)?;
    let written = File::create(&beside).and_then(|mut file| {
        file.write_all(bytes)?;
        file.sync_all()?;
        fs::rename(&beside, path)
    });
    if written.is_err() {
        let _ = fs::remove_file(&beside);
    }
    written
}

/// Where the next file is written before it takes the place of the last.
pub fn beside(path: &Path) -> io::Result<PathBuf> {
    let name = path.file_name().map(OsStr::to_owned);
    let mut name = name.ok_or_else(|| {
        let reason = "this is no name of a file; name another";
        io::Error::new(io::ErrorKind::InvalidInput, reason)
    })?;
    name.push(".new");
    Ok(path.with_file_name(name))
}

/// Reads a file that may have so many bytes.
pub fn read(path: &Path, most: u64) -> Result<Vec<u8>, Failure> {
    let bytes = bounded(path, most);
    bytes.map_err(|error| Failure::refused(format_args!("{}: {error}", path.display())))
}

/// Reads a file that may have so many bytes, and that is one: who opens a named pipe waits until
/// somebody writes to it, which may be never.
pub fn bounded(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let refused = |reason: String| Err(io::Error::new(io::ErrorKind::InvalidInput, reason));
    if !fs::metadata(path)?.is_file() {
        return refused("no regular file; copy it into one, and name that".to_owned());
    }
    let mut bytes = Vec::new();
    File::open(path)?.take(most + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most {
        return refused(format!("longer than {most} bytes; is it the right file?"));
    }
    Ok(bytes)
}

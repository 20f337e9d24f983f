//! Files: whole, or not there.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{Read, Write};
use std::path::Path;

use crate::context::Failure;

/// Writes a file beside its place, and puts it there when it is on the disk: whoever looks sees the
/// old one, or the whole new one.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    if fs::metadata(path).is_ok_and(|found| !found.is_file()) {
        let path = path.display();
        let what = "no regular file, and it stays what it is; name another";
        return Err(Failure::usage(format_args!("{path}: {what}")));
    }
    let name = path.file_name().map(OsStr::to_owned);
    let mut name =
        name.ok_or_else(|| Failure::usage(format_args!("{}: no file name", path.display())))?;
    name.push(".new");
    let beside = path.with_file_name(name);
    let written = File::create(&beside).and_then(|mut file| {
        file.write_all(bytes)?;
        file.sync_all()?;
        fs::rename(&beside, path)
    });
    written.map_err(|error| {
        let _ = fs::remove_file(&beside);
        Failure::refused(format_args!(
            "{}: {error}; nothing is left there",
            path.display()
        ))
    })
}

/// Reads a file that may have so many bytes.
pub fn read(path: &Path, most: u64) -> Result<Vec<u8>, Failure> {
    let mut bytes = Vec::new();
    let read = File::open(path).and_then(|file| file.take(most + 1).read_to_end(&mut bytes));
    read.map_err(|error| Failure::refused(format_args!("{}: {error}", path.display())))?;
    if bytes.len() as u64 > most {
        return Err(Failure::refused(format_args!(
            "{}: longer than {most} bytes; is it the right file?",
            path.display()
        )));
    }
    Ok(bytes)
}

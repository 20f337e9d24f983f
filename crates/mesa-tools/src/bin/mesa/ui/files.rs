//! Files: written as a whole or not at all, and read up to a limit.

use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::process;
use std::sync::atomic::{AtomicU32, Ordering};

use crate::ui::context::Failure;

/// Checks that a file can be written at `path`, before the work whose result it takes. Devices,
/// pipes and directories are refused.
pub fn check(path: &Path) -> Result<(), Failure> {
    let shown = path.display();
    if fs::metadata(path).is_ok_and(|found| !found.is_file()) {
        let what = "no regular file, and left unchanged; name another";
        return Err(Failure::usage(format_args!("{shown}: {what}")));
    }
    probe(path).map_err(|error| Failure::refused(format_args!("{shown}: {error}")))
}

/// Checks that a file can be created beside `path`.
pub fn probe(path: &Path) -> io::Result<()> {
    let (_, beside) = create_beside(path)?;
    fs::remove_file(beside)
}

/// True if two paths name the same file, which may not exist yet.
pub fn is_same(one: &Path, other: &Path) -> bool {
    let whole = |path: &Path| {
        let folder = path.parent().filter(|folder| *folder != Path::new(""));
        let folder = fs::canonicalize(folder.unwrap_or(Path::new("."))).ok()?;
        let path = folder.join(path.file_name()?);
        Some(fs::canonicalize(&path).unwrap_or(path))
    };
    one == other || whole(one).is_some_and(|one| Some(one) == whole(other))
}

/// Writes a file as a [whole](put) or not at all, after [checking](check) its path.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    check(path)?;
    put(path, bytes).map_err(|error| {
        let (path, what) = (path.display(), "a file that was there is unchanged");
        Failure::refused(format_args!("{path}: {error}; {what}"))
    })
}

/// Writes a file beside its place, and renames it once it is on the disk: readers see the old file
/// or the whole new one. Nothing is left beside it on failure.
pub fn put(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let (mut file, beside) = create_beside(path)?;
    let written = file.write_all(bytes).and_then(|()| {
        file.sync_all()?;
        fs::rename(&beside, path)
    });
    if written.is_err() {
        let _ = fs::remove_file(&beside);
    }
    written
}

/// Creates a file beside `path`, which takes its place when it is complete. The name must be new:
/// an existing file, or the target of a link, is never opened.
fn create_beside(path: &Path) -> io::Result<(File, PathBuf)> {
    static NEXT: AtomicU32 = AtomicU32::new(0);
    let name = path.file_name().ok_or_else(|| {
        let reason = "not the name of a file; name another";
        io::Error::new(io::ErrorKind::InvalidInput, reason)
    })?;
    let (process, next) = (process::id(), NEXT.fetch_add(1, Ordering::Relaxed));
    let mut name = name.to_owned();
    name.push(format!(".{process}-{next}.new"));
    let beside = path.with_file_name(name);
    let file = File::options().write(true).create_new(true).open(&beside)?;
    Ok((file, beside))
}

/// Reads a file of at most `most` bytes.
pub fn read(path: &Path, most: u64) -> Result<Vec<u8>, Failure> {
    let bytes = bounded(path, most);
    bytes.map_err(|error| Failure::refused(format_args!("{}: {error}", path.display())))
}

/// Reads a regular file of at most `most` bytes. A named pipe is refused, because opening one
/// blocks until another process writes to it.
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

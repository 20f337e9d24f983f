//! One program for one board.

use core::fmt;
use std::fs::{self, File};
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use rustix::fs::{FlockOperation, flock, major, minor};
use rustix::io::Errno;

/// Name of LinuxCNC's realtime process.
const RTAPI_APP: &str = "rtapi_app";

/// A program that has a board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Holder {
    /// Number of its process; 0 if the kernel does not show it.
    pub process: u32,
    /// Its name; empty if the kernel does not show it.
    pub name: String,
}

impl fmt::Display for Holder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.process, &*self.name) {
            (0, _) => f.write_str("another program"),
            (process, "") => write!(f, "process {process}"),
            (process, RTAPI_APP) => write!(f, "LinuxCNC ({RTAPI_APP}, process {process})"),
            (process, name) => write!(f, "`{name}` (process {process})"),
        }
    }
}

/// Reason why a lock was not taken.
#[derive(Debug)]
pub(crate) enum NoLock {
    /// Another program has it.
    Held(Holder),
    /// The kernel does not give it: another program could drive the board at the same time.
    Refused(Errno),
}

/// Takes the lock of a file, which the kernel keeps until the file is closed, also when the process
/// is killed.
pub(crate) fn take(file: &File) -> Result<(), NoLock> {
    flock(file, FlockOperation::NonBlockingLockExclusive).map_err(|error| match error {
        Errno::WOULDBLOCK => NoLock::Held(holder_of(file)),
        error => NoLock::Refused(error),
    })
}

/// The program that has the lock of a file.
fn holder_of(file: &File) -> Holder {
    let locks = fs::read_to_string("/proc/locks").unwrap_or_default();
    let place = file.metadata().map(|file| (file.dev(), file.ino()));
    let process = place.ok().and_then(|(device, inode)| {
        let place = format!("{:02x}:{:02x}:{inode}", major(device), minor(device));
        find_holder(&locks, &place)
    });
    named(process.unwrap_or(0))
}

/// The process with a lock of the whole file at a place, in the form of `/proc/locks`.
fn find_holder(locks: &str, place: &str) -> Option<u32> {
    locks.lines().find_map(|line| {
        let words: Vec<_> = line.split_whitespace().collect();
        match words[..] {
            [_, "FLOCK", _, _, process, at, ..] if at == place => process.parse().ok(),
            _ => None,
        }
    })
}

fn named(process: u32) -> Holder {
    let name = fs::read_to_string(format!("/proc/{process}/comm")).unwrap_or_default();
    Holder {
        process,
        name: name.trim().to_owned(),
    }
}

/// A program without a lock that may have a board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Suspect {
    /// It has mapped the file.
    Maps(Holder),
    /// It is LinuxCNC, and its mappings are hidden from this user.
    Hidden(Holder),
}

/// The first other program that has mapped a file; LinuxCNC does not lock it. Mappings of other
/// users' programs are hidden except from root.
///
/// `processes` is `/proc`, or a folder like it.
pub(crate) fn find_mapping(processes: &Path, file: &Path) -> Option<Suspect> {
    let own = std::process::id();
    let file = fs::canonicalize(file).ok()?;
    let file = format!(" {}", file.to_str()?);
    let mut hidden = None;
    for entry in fs::read_dir(processes).ok()?.flatten() {
        let number = entry
            .file_name()
            .to_str()
            .and_then(|name| name.parse().ok());
        let Some(process) = number.filter(|&process| process != own) else {
            continue;
        };
        let name = fs::read_to_string(entry.path().join("comm")).unwrap_or_default();
        let holder = Holder {
            process,
            name: name.trim().to_owned(),
        };
        match fs::read_to_string(entry.path().join("maps")) {
            Ok(maps) if maps.lines().any(|line| line.ends_with(&file)) => {
                return Some(Suspect::Maps(holder));
            }
            Err(_) if holder.name == RTAPI_APP => hidden = Some(Suspect::Hidden(holder)),
            _ => {}
        }
    }
    hidden
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lines of `/proc/locks` of a running computer.
    const LOCKS: &str = "1: POSIX  ADVISORY  WRITE 901 00:1a:1219 0 EOF\n\
                         2: FLOCK  ADVISORY  WRITE 902 00:15:9371 0 EOF\n\
                         2: -> FLOCK  ADVISORY  WRITE 903 00:15:9371 0 EOF\n\
                         3: OFDLCK ADVISORY  READ  -1 00:05:2066 0 EOF\n";

    #[test]
    fn file_that_the_kernel_does_not_lock_is_refused() {
        use rustix::fs::{Mode, OFlags, open};
        // Of a file that is open for its place alone the kernel locks nothing.
        let file = open("/proc/self/exe", OFlags::PATH, Mode::empty()).expect("a file");
        let result = take(&File::from(file));
        assert!(
            matches!(result, Err(NoLock::Refused(Errno::BADF))),
            "{result:?}"
        );
    }

    #[test]
    fn holder_of_a_lock_is_the_process_at_its_place() {
        assert_eq!(find_holder(LOCKS, "00:15:9371"), Some(902));
        assert_eq!(
            find_holder(LOCKS, "00:1a:1219"),
            None,
            "a lock of another kind"
        );
        assert_eq!(find_holder(LOCKS, "00:15:937"), None);
    }

    #[test]
    fn program_is_named_as_far_as_the_kernel_shows_it() {
        let holder = |process, name: &str| Holder {
            process,
            name: name.to_owned(),
        };
        assert_eq!(holder(0, "").to_string(), "another program");
        assert_eq!(holder(5, "").to_string(), "process 5");
        assert_eq!(holder(5, "mesa").to_string(), "`mesa` (process 5)");
        assert_eq!(
            holder(5, RTAPI_APP).to_string(),
            "LinuxCNC (rtapi_app, process 5)"
        );
    }
}

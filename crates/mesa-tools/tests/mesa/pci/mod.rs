//! Boards on the PCI bus: `mesa sim --pci` in a process of its own, and the commands on it through
//! mapped memory.

mod commands;
mod flash;
mod mesaflash;
mod sim;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::atomic::{AtomicU32, Ordering};

use crate::interop::console::{Console, Values, values};
use crate::interop::{Process, behind_the_feature, mesa, realtime};

/// A simulated board on the PCI bus, with its console.
struct PciBoard {
    process: Process,
    console: Console,
    /// The folder in place of /sys.
    folder: Folder,
}

/// A folder that is removed at the end.
struct Folder(PathBuf);

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

impl PciBoard {
    fn start(arguments: &[&str]) -> Self {
        static NUMBER: AtomicU32 = AtomicU32::new(0);
        behind_the_feature();
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let name = format!("{}-pci-{number}", std::process::id());
        let folder = Folder(Path::new(env!("CARGO_TARGET_TMPDIR")).join(name));
        let mut child = realtime(mesa())
            .args(["sim", "--pci"])
            .arg(&folder.0)
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("mesa sim starts");
        let (input, output) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
        let console = Console::new(input, output);
        console.wait_for("help");
        Self {
            process: Process::new(child),
            console,
            folder,
        }
    }

    fn folder(&self) -> &str {
        self.folder.0.to_str().expect("UTF-8")
    }

    /// Ends the board by a signal, and returns its summary.
    fn stop(mut self) -> (Values, Folder) {
        self.process.signal("TERM");
        let status = self.process.child().wait().expect("it is a child");
        assert!(status.success(), "{status}");
        self.console.wait_for("summary");
        (
            values(self.console.answer().expect("a summary")),
            self.folder,
        )
    }
}

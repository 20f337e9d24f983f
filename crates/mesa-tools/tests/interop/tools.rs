//! External tools, and the treatment of missing ones.

use std::{
    ffi::OsStr,
    io::Write,
    path::PathBuf,
    process::{Command, Stdio},
    sync::OnceLock,
};

/// Says that a test is skipped, and the reason, even where the output of a test that passes is not
/// shown. In CI nothing may be missing: there the test fails.
pub fn skip(what: &str) {
    let why =
        format!("{what}; needed for this test: apt-get install mesaflash linuxcnc-uspace tmux");
    assert!(
        std::env::var_os("CI").is_none_or(|ci| ci != "true"),
        "missing in CI: {why}"
    );
    let thread = std::thread::current();
    let test = thread.name().unwrap_or("a test");
    // `println!` and `eprintln!` are kept by the test program; a write to the stream is not.
    let _ = writeln!(std::io::stderr(), "\nSKIPPED {test}: {why}");
}

/// True if a program is installed.
pub fn has_program(name: &str) -> bool {
    let paths = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&paths)
        .chain([PathBuf::from("/usr/sbin"), PathBuf::from("/sbin")])
        .any(|directory| directory.join(name).is_file())
}

/// The priority of what has to answer in time.
const PRIORITY: &str = "1";

/// The variable of `examples/linuxcnc.sh` with the nice value of LinuxCNC's threads. Its driver
/// polls for a reply: with a realtime priority it would hold up the board that sends it, and the
/// servo loops of other tests.
pub const LINUXCNC_NICE: (&str, &str) = ("LINUXCNC_NICE", "-20");

/// A command for a program with a simulated board, a servo loop or a LinuxCNC in it, which has to
/// answer in time on a busy computer: with a realtime priority where the user may have one.
pub fn realtime(program: impl AsRef<OsStr>) -> Command {
    static PERMITTED: OnceLock<bool> = OnceLock::new();
    const WORDS: [&str; 2] = ["--rr", PRIORITY];
    let is_permitted = || {
        let mut nothing = Command::new("chrt");
        nothing.args(WORDS).arg("true").stderr(Stdio::null());
        nothing.status().is_ok_and(|status| status.success())
    };
    if !PERMITTED.get_or_init(is_permitted) {
        return Command::new(program);
    }
    let mut command = Command::new("chrt");
    command.args(WORDS).arg(program);
    command
}

/// Gives the calling thread, which plays a card or a board, the priority of [`realtime`].
pub fn realtime_thread() {
    let mut set = Command::new("chrt");
    let thread = std::fs::read_link("/proc/thread-self").expect("Linux has it");
    set.args(["--rr", "--pid", PRIORITY])
        .arg(thread.file_name().expect("its number"))
        .stderr(Stdio::null());
    // Without permission it stays as it is.
    let _ = set.status();
}

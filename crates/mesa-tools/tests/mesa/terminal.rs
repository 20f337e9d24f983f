//! Commands that use the whole screen, in a terminal of their own.

use std::fs;
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use crate::interop::tools::{has_program, skip};
use crate::interop::{PATIENCE, mesa, wait_until};

/// Interval of looks at the screen.
const LOOK: Duration = Duration::from_millis(100);

/// A terminal for a command. Ends with the command.
pub struct Terminal {
    socket: String,
}

impl Terminal {
    /// Runs `mesa` with these arguments in a terminal of 120 by 40 characters, and prints its exit
    /// code at its end. Returns `None`, with a clear message, without tmux.
    pub fn start(name: &str, arguments: &str) -> Option<Self> {
        Self::start_with(name, arguments, [120, 40])
    }

    /// As [`start`](Self::start), with other numbers of columns and rows.
    pub fn start_with(name: &str, arguments: &str, size: [u16; 2]) -> Option<Self> {
        crate::interop::behind_the_feature();
        if !has_program("tmux") {
            skip("tmux");
            return None;
        }
        let terminal = Self {
            socket: format!("mesa-{name}-{}", std::process::id()),
        };
        let command = format!(
            "{} {arguments}; echo exit code $?; sleep 600",
            mesa().display()
        );
        let [columns, rows] = size.map(|size| size.to_string());
        let size = ["-x", &columns, "-y", &rows];
        let started = ["-f", "/dev/null", "new-session", "-d"];
        let output = terminal.tmux(&[&started[..], &size, &[&command]].concat());
        assert!(output.status.success(), "{output:?}");
        Some(terminal)
    }

    fn tmux(&self, arguments: &[&str]) -> Output {
        let mut tmux = Command::new("tmux");
        tmux.args(["-L", &self.socket]).args(arguments);
        tmux.env_remove("TMUX")
            .env("LC_ALL", "C.UTF-8")
            .env("TERM", "xterm");
        tmux.output().expect("tmux runs")
    }

    /// Types keys by their tmux names, or text.
    pub fn type_keys(&self, keys: &[&str]) {
        let output = self.tmux(&[&["send-keys"], keys].concat());
        assert!(output.status.success(), "{output:?}");
    }

    /// Sends a signal to the command.
    pub fn signal(&self, name: &str) {
        let kill = format!("kill -{name} {}", self.pid());
        let killed = Command::new("sh").args(["-c", &kill]).status();
        assert!(killed.expect("a shell").success());
    }

    /// Closes the terminal like a window, and waits for the end of the command.
    pub fn close(self) {
        let running = format!("/proc/{}/exe", self.pid());
        assert!(fs::read_link(&running).is_ok(), "it runs");
        drop(self);
        wait_until(format_args!("{running} has ended"), || {
            fs::read_link(&running).is_err()
        });
    }

    /// The process of the command, which is a child of the terminal's shell.
    fn pid(&self) -> String {
        let shell = self.tmux(&["display-message", "-p", "#{pane_pid}"]);
        let shell = String::from_utf8_lossy(&shell.stdout).trim().to_owned();
        let pid = Command::new("pgrep").args(["-P", &shell]).output();
        let pid = pid.expect("pgrep runs").stdout;
        String::from_utf8_lossy(&pid).trim().to_owned()
    }

    /// Content of the screen.
    pub fn text(&self) -> String {
        let output = self.tmux(&["capture-pane", "-p"]);
        String::from_utf8_lossy(&output.stdout).into_owned()
    }

    /// Waits until the screen fulfils a condition, and returns its content a moment later, when all
    /// of it is painted. Fails once the command has ended without that.
    pub fn wait_for(&self, what: &str, mut is: impl FnMut(&str) -> bool) -> String {
        let begun = Instant::now();
        loop {
            let text = self.text();
            if is(&text) {
                std::thread::sleep(LOOK);
                let later = self.text();
                return if is(&later) { later } else { text };
            }
            let is_over = text.contains("exit code ") || begun.elapsed() > PATIENCE;
            assert!(!is_over, "{what} is not on the screen:\n{text}");
            std::thread::sleep(LOOK);
        }
    }

    /// Waits until a text is on the screen, and returns the content of the screen.
    pub fn wait_for_text(&self, wanted: &str) -> String {
        self.wait_for(wanted, |text| text.contains(wanted))
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        self.tmux(&["kill-server"]);
    }
}

//! LinuxCNC's HAL with a simulated board in a private network: `examples/linuxcnc.sh`.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write;
use std::ops::{Deref, DerefMut};
use std::path::{Path, PathBuf};
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

use crate::halcmd::{Halcmd, LOADS, PATIENCE, Started, lines_of};
use crate::tools::realtime;

/// Time limit for a change on one side to arrive at the other on a busy computer.
pub const SETTLE: Duration = Duration::from_secs(20);

/// The words of an existing line.
pub const WORDS: &str = "board_ip=10.97.0.2 config=\"num_encoders=6 num_pwmgens=6 num_stepgens=0 sserial_port_0=000xxxxx\"";

/// Boards in a LinuxCNC.
pub struct Setup {
    /// Options of the simulated boards.
    pub options: &'static [&'static str],
    /// The name of the first board.
    pub prefix: &'static str,
    /// The words of an existing line for it.
    pub words: &'static str,
    /// A pin of the last remote.
    pub last: &'static str,
}

pub const I7I97: Setup = Setup {
    options: &["--board", "7i97"],
    prefix: "hm2_7i97.0",
    words: WORDS,
    last: "7i72.0.2.output-47",
};

/// Type, direction and value of each name.
pub type List = BTreeMap<String, [String; 3]>;

/// LinuxCNC, with a board.
pub struct Session {
    halcmd: Halcmd,
    to_board: File,
    of_board: Receiver<String>,
}

impl Deref for Session {
    type Target = Halcmd;

    fn deref(&self) -> &Halcmd {
        &self.halcmd
    }
}

impl DerefMut for Session {
    fn deref_mut(&mut self) -> &mut Halcmd {
        &mut self.halcmd
    }
}

/// A program of this package that `cargo test` builds beside the test.
pub fn built(name: &str) -> PathBuf {
    let program = std::env::current_exe().expect("a program");
    let path = program.parent().expect("a folder").join(name);
    assert!(
        path.exists(),
        "{} is not built: cargo test -p mesa-linuxcnc builds it",
        path.display()
    );
    path
}

impl Session {
    pub fn start() -> Self {
        Self::start_with(&I7I97, "mesa_eth")
    }

    /// Two LinuxCNCs at the same time are for different drivers.
    fn start_with(setup: &Setup, driver: &str) -> Self {
        let package = Path::new(env!("CARGO_MANIFEST_DIR"));
        let tools = package.join("../mesa-tools/tests/mesa/interop_linuxcnc");
        let mut sandbox = realtime(package.join("../../examples/linuxcnc.sh"));
        sandbox
            .args(setup.options)
            .arg("--")
            .arg(package.join("tests/linuxcnc/with_component.sh"))
            .arg(built("libmesa_eth.so"))
            .arg(tools.join("session.sh"))
            .env("MESA", built("../examples/simulated_board"));
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(driver);
        std::fs::create_dir_all(&folder).expect("a folder");
        let Started {
            halcmd,
            to_board,
            from_board,
        } = Halcmd::start(setup.prefix, sandbox, &folder);
        let session = Self {
            halcmd,
            to_board,
            of_board: lines_of(from_board),
        };
        assert_eq!(session.board_line(), "ready");
        session
    }

    fn board_line(&self) -> String {
        let line = self.of_board.recv_timeout(PATIENCE);
        line.expect("the board answers")
    }

    /// A command for the board.
    pub fn board(&mut self, command: &str) -> String {
        writeln!(self.to_board, "{command}").expect("the board runs");
        let answer = self.board_line();
        // That of a board that was built before is none.
        assert!(!answer.starts_with('?'), "{answer}");
        answer
    }

    pub fn outputs(&mut self) -> String {
        self.board("outputs")
    }

    pub fn expect(&mut self, name: &str, value: &str) {
        self.until(name, |session| session.get(name) == value);
    }

    pub fn expect_outputs(&mut self, outputs: [bool; 3]) {
        let outputs = format!("{outputs:?}");
        self.until(&outputs, |session| session.outputs() == outputs);
    }

    /// Waits for a whole cycle of the thread: the driver has then taken what HAL has.
    pub fn cycles(&mut self) {
        for _ in 0..2 {
            let before = self.get("write.time");
            self.until("the thread runs", |session| {
                session.get("write.time") != before
            });
        }
    }

    pub fn until(&mut self, what: &str, is_so: impl Fn(&mut Self) -> bool) {
        let start = Instant::now();
        while !is_so(self) {
            let in_time = start.elapsed() < SETTLE;
            assert!(in_time, "never: {what}; outputs: {}", self.outputs());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Type, direction and value of all pins and parameters of the board.
    pub fn list(&mut self) -> List {
        let shown = [self.show("pin"), self.show("param")].into_iter().flatten();
        shown
            .map(|(name, [_, kind, direction, value])| (name, [kind, direction, value]))
            .collect()
    }

    /// Loads a driver, with retries where it never retries itself.
    pub fn load(driver: &str) -> Self {
        Self::load_with(&I7I97, driver)
    }

    pub fn load_with(setup: &Setup, driver: &str) -> Self {
        let mut messages = Vec::new();
        let attempts = if driver == "hm2_eth" { LOADS } else { 1 };
        for attempt in 1..=attempts {
            let mut session = Self::start_with(setup, driver);
            session.hal("loadrt hostmot2");
            match session.try_hal(&format!("loadrt {driver} {}", setup.words)) {
                // A packet that comes late can leave a remote out.
                Ok(_) if session.list().contains_key(setup.last) => {
                    println!("{driver} loaded at attempt {attempt}");
                    return session;
                }
                Ok(answer) | Err(answer) => messages = answer,
            }
            println!("{driver}, attempt {attempt}: {messages:?}");
            session.stop();
        }
        panic!("{driver} does not load: {messages:?}");
    }

    /// Starts a thread of 1 kHz, with patience for a busy computer.
    pub fn run(&mut self) {
        self.hal("loadrt threads name1=servo period1=1000000");
        self.set("packet-error-limit", "100000");
        self.set("watchdog.timeout_ns", "1000000000");
        self.hal("addf .read servo");
        self.hal("addf .write servo");
        self.hal("start");
    }

    /// Outputs 3 of the 7I77, 17 of the 7I72, and 2 of the board are on.
    pub fn switch_on(&mut self) {
        self.set("7i77.0.0.output-03", "TRUE");
        self.set("7i72.0.2.output-17", "TRUE");
        self.set("ssr.00.out-02", "TRUE");
        self.expect_outputs([true; 3]);
    }

    pub fn stop(mut self) {
        self.end();
    }
}

//! A running board: its packets, its console and its scheduled commands.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use super::agenda::{Agenda, Condition};
use super::answer::Answer;
use super::console;
use super::face::Face;
use super::store::Store;
use crate::machine::built::Machine;
use crate::machine::description::Description;
use crate::ui::context::Failure;
use crate::ui::output::complain;

/// Longest interval between two checks of everything other than packets.
const TICK: Duration = Duration::from_millis(1);

/// Interval between two checks of conditions.
const LOOK: Duration = Duration::from_millis(1);

/// Limits: commands queued for the board, and commands executed between two checks for packets.
const MAX_REQUESTS: usize = 64;
const AT_A_TIME: usize = 8;

/// Maximum number of clients that wait for a condition.
const MAX_WAITS: usize = 32;

/// State shared by all threads.
#[derive(Debug, Default)]
pub struct Shared {
    ended: AtomicBool,
}

impl Shared {
    /// Ends all boards.
    pub fn end(&self) {
        self.ended.store(true, Ordering::Relaxed);
    }

    pub fn ends(&self) -> bool {
        self.ended.load(Ordering::Relaxed)
    }
}

/// A command, and the channel for its answer.
struct Request {
    line: String,
    answer: SyncSender<Answer>,
}

/// Command channel of a board.
#[derive(Clone)]
pub struct Link {
    pub name: String,
    /// Where clients find it.
    pub address: String,
    described: Arc<Description>,
    inbox: SyncSender<Request>,
}

/// A client waiting for a condition.
struct Wait {
    condition: Condition,
    until: Instant,
    answer: SyncSender<Answer>,
}

/// A board with its machine, its socket, its state file and its commands.
pub struct Station {
    machine: Machine,
    face: Face,
    store: Option<Store>,
    inbox: Receiver<Request>,
    agenda: Agenda,
    waits: VecDeque<Wait>,
    looked: Instant,
}

impl Link {
    /// Schedules a command on a board. A command that would be refused at its time is refused at
    /// once: it is tried on another machine of the same kind.
    pub fn put(&self, time: &str, command: &str) -> Answer {
        let tried = Agenda::takes(command).and_then(|()| {
            let machine = Machine::new(&self.described);
            let mut machine = machine.map_err(|error| error.to_string())?;
            machine.is_rehearsal = true;
            console::rehearse(&mut machine, command)
        });
        match tried {
            Ok(()) => self.ask(&format!("at {time} {command}")),
            Err(reason) => Answer::refused(reason),
        }
    }

    /// Has the board execute a command line, and waits for the answer.
    pub fn ask(&self, line: &str) -> Answer {
        let (answer, answers) = sync_channel(1);
        let request = Request {
            line: line.to_owned(),
            answer,
        };
        match self.inbox.try_send(request) {
            Ok(()) => answers
                .recv()
                .unwrap_or_else(|_| Answer::refused("the board has ended")),
            Err(TrySendError::Full(_)) => Answer::refused("too many commands at a time; try again"),
            Err(TrySendError::Disconnected(_)) => Answer::refused("the board has ended"),
        }
    }
}

impl Station {
    /// Creates a board that listens, and its command channel.
    pub fn new(
        name: String,
        described: Description,
        machine: Machine,
        face: Face,
        store: Option<Store>,
    ) -> Result<(Self, Link), Failure> {
        let (sender, inbox) = sync_channel(MAX_REQUESTS);
        let link = Link {
            name,
            address: face.place()?,
            described: described.into(),
            inbox: sender,
        };
        let station = Self {
            machine,
            face,
            store,
            inbox,
            agenda: Agenda::default(),
            waits: VecDeque::new(),
            looked: Instant::now(),
        };
        Ok((station, link))
    }

    /// Runs until the boards are ended; returns the summary.
    pub fn run(mut self, shared: &Arc<Shared>) -> Result<String, Failure> {
        while !shared.ends() {
            self.face.step(&mut self.machine.board, TICK)?;
            for _ in 0..AT_A_TIME {
                let Ok(request) = self.inbox.try_recv() else {
                    break;
                };
                self.take(request);
            }
            self.do_what_is_due(shared);
            if self.looked.elapsed() >= LOOK {
                self.looked = Instant::now();
                self.look();
            }
            if let Some(store) = &mut self.store {
                store.keep(self.machine.changes(), || self.machine.state());
            }
        }
        if let Some(store) = self.store {
            store.close(self.machine.state());
        }
        Ok(console::summary(&mut self.machine, &self.face))
    }

    fn take(&mut self, request: Request) {
        let Request { line, answer } = request;
        let words: Vec<&str> = line.split_whitespace().collect();
        let now = self.face.now();
        let done = match words[..] {
            ["at", time, ref command @ ..] => {
                let command = command.join(" ");
                self.agenda.add(now, time, &command).map(|()| String::new())
            }
            ["agenda"] => Ok(self.agenda.show()),
            ["wait", "until", ref condition @ ..] => match self.begin_wait(condition, &answer) {
                Ok(()) => return,
                Err(reason) => Err(reason),
            },
            ["wait", ..] => Err("expected wait until NAME VALUE|>X|<X [within S]".to_owned()),
            _ => {
                // A client that has disconnected gets no answer.
                let _ = answer.try_send(console::answer(&mut self.machine, &mut self.face, &line));
                return;
            }
        };
        let _ = answer.try_send(Answer::of(done));
    }

    fn begin_wait(&mut self, words: &[&str], answer: &SyncSender<Answer>) -> Result<(), String> {
        let (condition, patience) = Condition::parse(words)?;
        console::value(&mut self.machine, &self.face, &condition.name)?;
        if self.waits.len() >= MAX_WAITS {
            return Err("too many clients wait already".to_owned());
        }
        self.waits.push_back(Wait {
            condition,
            until: Instant::now() + patience,
            answer: answer.clone(),
        });
        self.look();
        Ok(())
    }

    /// Answers the clients whose conditions are met or whose time is over.
    fn look(&mut self) {
        for _ in 0..self.waits.len() {
            let Some(wait) = self.waits.pop_front() else {
                return;
            };
            let name = &wait.condition.name;
            let done = match console::value(&mut self.machine, &self.face, name) {
                Ok(value) if wait.condition.holds(&value) => Ok(format!("{name} {value}\n")),
                Ok(value) if Instant::now() >= wait.until => {
                    Err(format!("{name} is {value}, and the time is over"))
                }
                Ok(_) => {
                    self.waits.push_back(wait);
                    continue;
                }
                Err(reason) => Err(reason),
            };
            let _ = wait.answer.try_send(Answer::of(done));
        }
    }

    /// Executes the due commands. A refusal is printed on standard error.
    fn do_what_is_due(&mut self, shared: &Shared) {
        let now = self.face.now();
        while let Some(command) = self.agenda.take(now) {
            let answer = console::answer(&mut self.machine, &mut self.face, &command);
            if let Some(reason) = answer.reason() {
                complain(format_args!(
                    "at {:.3}s {command}: {reason}",
                    now as f64 / 1e9
                ));
                self.agenda.failed();
            }
            if answer.quit {
                shared.end();
            }
        }
    }
}

/// All boards, each in a thread of its own.
pub struct Running {
    boards: Vec<JoinHandle<Result<String, Failure>>>,
    shared: Arc<Shared>,
}

impl Running {
    /// Starts all boards.
    pub fn start(stations: Vec<Station>, shared: &Arc<Shared>) -> Self {
        let boards = stations.into_iter().map(|station| {
            let shared = Arc::clone(shared);
            thread::spawn(move || station.run(&shared))
        });
        Self {
            boards: boards.collect(),
            shared: Arc::clone(shared),
        }
    }

    /// True while all boards run and nothing has ended them.
    pub fn goes_on(&self) -> bool {
        !self.shared.ends() && !self.boards.iter().any(JoinHandle::is_finished)
    }

    /// Ends all boards and returns their summaries.
    pub fn end(self) -> Result<Vec<String>, Failure> {
        self.shared.end();
        let boards = self.boards.into_iter();
        let summaries = boards.map(|board| match board.join() {
            Ok(summary) => summary,
            Err(_) => Err(Failure::refused("a simulated board has failed")),
        });
        // Joins all threads before the first failure is returned.
        let summaries: Vec<_> = summaries.collect();
        summaries.into_iter().collect()
    }
}

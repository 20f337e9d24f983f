//! A running board: its packets, its console and its scheduled commands.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::time::{Duration, Instant};

use super::agenda::{Agenda, Condition};
use super::console::{self, Answer};
use super::face::Face;
use super::machine::{Machine, MachineOptions};
use super::network::Shared;
use super::store::Store;
use crate::context::Failure;
use crate::output::complain;

/// Longest interval between two checks of everything other than packets.
const TICK: Duration = Duration::from_millis(1);

/// Interval between two checks of conditions.
const LOOK: Duration = Duration::from_millis(1);

/// Limits: commands queued for the board, and commands executed between two checks for packets.
const MAX_REQUESTS: usize = 64;
const AT_A_TIME: usize = 8;

/// Maximum number of clients that wait for a condition.
const MAX_WAITS: usize = 32;

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
    options: Arc<MachineOptions>,
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
            let machine = Machine::new(&self.options);
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
        options: MachineOptions,
        machine: Machine,
        face: Face,
        store: Option<Store>,
    ) -> Result<(Self, Link), Failure> {
        let (sender, inbox) = sync_channel(MAX_REQUESTS);
        let link = Link {
            name,
            address: face.place()?,
            options: options.into(),
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

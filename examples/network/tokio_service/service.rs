//! The answers to a client's lines.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use mesa_hal::bus::{Clock, RegisterBus};
use mesa_hal::hal::{AnyValue, HalType, PinId, Pins};
use mesa_hal::runner::{CommandError, CommandOutcome, CommandSender, Runner, SnapshotReader};
use tokio::net::TcpStream;
use tokio::time::{sleep, timeout};

/// Commands that wait for the cycle at most.
const ROOM: usize = 64;
/// A pause between two looks at the outcome of a command: the cycle takes it within a period.
const LOOK: Duration = Duration::from_millis(1);
/// A cycle that has not taken a command by then hangs.
const PATIENCE: Duration = Duration::from_secs(1);
/// Longest line of a client.
const LONGEST: usize = 256;

/// Pins and parameters by their names.
pub type Names = HashMap<String, (PinId, HalType)>;

/// All pins and parameters of a driver.
pub fn names(pins: &Pins) -> Names {
    let all = pins.ids().zip(pins.infos());
    all.map(|(id, info)| (info.name.clone(), (id, info.hal_type)))
        .collect()
}

/// What a task needs to serve a client.
#[derive(Clone)]
pub struct Service {
    snapshots: SnapshotReader,
    commands: CommandSender,
    pins: Arc<Names>,
    quit: Arc<AtomicBool>,
}

impl Service {
    /// The service of a runner, whose driver has these pins.
    pub fn new<B: RegisterBus + Clock>(
        runner: &mut Runner<B>,
        pins: Names,
        quit: Arc<AtomicBool>,
    ) -> Self {
        Self {
            snapshots: runner.snapshot(),
            commands: runner.commands(ROOM),
            pins: Arc::new(pins),
            quit,
        }
    }

    /// Answers each line of a client until it leaves.
    pub async fn answer(self, client: TcpStream) {
        let mut rest = Vec::new();
        while let Ok(line) = line_of(&client, &mut rest).await {
            let answer = self.answer_to(&line).await;
            if write_line(&client, &answer).await.is_err() {
                return;
            }
        }
    }

    async fn answer_to(&self, line: &str) -> String {
        let words: Vec<_> = line.split_whitespace().collect();
        match *words {
            ["state"] => match self.snapshots.read() {
                Ok(snapshot) => snapshot.to_string(),
                Err(error) => error.to_string(),
            },
            ["get", name] => self.value(name),
            ["set", name, value] => match self.pins.get(name) {
                None => format!("there is no pin {name}"),
                Some(&(pin, hal_type)) => match parsed(value, hal_type) {
                    None => format!("{value} is no {}", hal_type.as_str()),
                    Some(value) => self.outcome(self.commands.set_any(pin, value)).await,
                },
            },
            ["rearm"] => self.outcome(self.commands.rearm_when_running()).await,
            ["quit"] => {
                self.quit.store(true, Ordering::Relaxed);
                "the cycle ends".to_owned()
            }
            _ => "state, get NAME, set NAME VALUE, rearm or quit".to_owned(),
        }
    }

    fn value(&self, name: &str) -> String {
        let Some(&(pin, _)) = self.pins.get(name) else {
            return format!("there is no pin {name}");
        };
        let snapshot = match self.snapshots.read() {
            Ok(snapshot) => snapshot,
            Err(error) => return error.to_string(),
        };
        match snapshot.read_any(pin) {
            Some(reading) if reading.valid => reading.value.to_string(),
            Some(reading) => format!("not valid; last valid: {}", reading.age),
            None => "not valid".to_owned(),
        }
    }

    /// Waits until the cycle has taken a command.
    async fn outcome(&self, sent: Result<u64, CommandError>) -> String {
        let number = match sent {
            Ok(number) => number,
            Err(error) => return error.to_string(),
        };
        let taken = async {
            loop {
                match self.commands.outcome(number) {
                    CommandOutcome::Waiting => sleep(LOOK).await,
                    outcome => return outcome.to_string(),
                }
            }
        };
        let taken = timeout(PATIENCE, taken).await;
        taken.unwrap_or_else(|_| "the cycle hangs".to_owned())
    }
}

fn parsed(text: &str, hal_type: HalType) -> Option<AnyValue> {
    match hal_type {
        HalType::Bit => Some((text.parse::<u8>().ok()? != 0).into()),
        HalType::Float => Some(text.parse::<f64>().ok()?.into()),
        HalType::S32 => Some(text.parse::<i32>().ok()?.into()),
        HalType::U32 => Some(text.parse::<u32>().ok()?.into()),
        HalType::S64 => Some(text.parse::<i64>().ok()?.into()),
        HalType::U64 => Some(text.parse::<u64>().ok()?.into()),
    }
}

/// The next line; `rest` contains what has arrived after the previous one.
pub async fn line_of(stream: &TcpStream, rest: &mut Vec<u8>) -> std::io::Result<String> {
    loop {
        if let Some(end) = rest.iter().position(|&byte| byte == b'\n') {
            let line: Vec<_> = rest.drain(..=end).collect();
            return Ok(String::from_utf8_lossy(&line).trim().to_owned());
        }
        if rest.len() > LONGEST {
            return Err(std::io::ErrorKind::InvalidData.into());
        }
        stream.readable().await?;
        let mut bytes = [0; LONGEST];
        match stream.try_read(&mut bytes) {
            Ok(0) => return Err(std::io::ErrorKind::UnexpectedEof.into()),
            Ok(count) => rest.extend_from_slice(&bytes[..count]),
            Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => {}
            Err(error) => return Err(error),
        }
    }
}

pub async fn write_line(stream: &TcpStream, line: &str) -> std::io::Result<()> {
    let line = format!("{line}\n");
    let mut left = line.as_bytes();
    while !left.is_empty() {
        stream.writable().await?;
        match stream.try_write(left) {
            Ok(count) => left = &left[count..],
            Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

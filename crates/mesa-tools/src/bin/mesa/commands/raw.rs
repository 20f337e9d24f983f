//! `mesa raw`: LBP16 by hand.

use std::fmt::{self, Display, Write};
use std::time::Duration;

use clap::Args;
use mesa_hal::Rounded;
use mesa_hal::lbp16::{Answered, MAX_PACKET, Operations};
use mesa_hal::transport::udp::PacketLink;
use serde::Serialize;

use crate::board::consent::{Asks, Plan};
use crate::board::link::BoardLink;
use crate::board::target::{Found, Target};
use crate::ui::context::{Context, Ending, Failure};
use mesa_tools::Counted;

const AFTER_HELP: &str = "\
HEX is one packet of at most 1472 bytes: commands, addresses and data as in the board's manual, low
byte first. It is sent once, and not repeated if no reply comes. A packet that writes needs consent.

Example (the cookie of HostMot2, then the IP address in the EEPROM):
  mesa raw 01420001 82492000 --addr 10.10.10.10";

/// Longest timeout in seconds: longer than the erasing of a flash sector.
const LONGEST: f64 = 10.0;

/// Size of the receive buffer: larger than a packet, so that a longer datagram is detected.
const ROOM: usize = 2048;

/// Send LBP16 commands by hand and decode the reply
///
/// Does what the manual's ELBPCOM does, and more.
#[derive(Debug, Args)]
#[command(after_help = AFTER_HELP)]
pub struct Raw {
    #[command(flatten)]
    target: Target,
    /// Packet: pairs of hexadecimal digits, with blanks anywhere between them
    #[arg(required = true, value_name = "HEX")]
    hex: Vec<String>,
    /// Time to wait for the reply, in seconds, 0.001 to 10. Erasing a sector of the flash memory
    /// takes up to 3
    #[arg(long, value_name = "SECONDS", default_value = "1", value_parser = parse_seconds)]
    timeout: Duration,
    /// Print the commands, and send nothing
    #[arg(long)]
    dry_run: bool,
    #[command(flatten)]
    asks: Asks,
}

/// A packet and its reply.
#[derive(Debug, Serialize)]
struct Dialogue {
    /// True if nothing was sent.
    dry_run: bool,
    /// Request in hexadecimal.
    request: String,
    /// Reply in hexadecimal; `None` if nothing was read or sent.
    received: Option<String>,
    commands: Vec<Line>,
}

/// A command of the packet.
#[derive(Debug, Serialize)]
struct Line {
    command: &'static str,
    space: u8,
    space_name: &'static str,
    /// True for the info area of the space.
    info: bool,
    /// `None`: at the address pointer of the space.
    address: Option<u16>,
    bits: usize,
    count: u8,
    /// True if the address pointer advances after each element.
    increment: bool,
    /// Values written or read; fewer than `count` if the reply was missing or too short.
    values: Vec<u64>,
}

impl Raw {
    pub fn run(&self, context: &Context) -> Result<Ending, Failure> {
        let request = self.request()?;
        let mistake = |error| Failure::usage(format_args!("HEX: {error}"));
        let expected = Operations::new(&request).reply_len().map_err(mistake)?;
        if expected > MAX_PACKET {
            return Err(Failure::usage(format_args!(
                "HEX: the reply would have {expected} bytes, more than the {MAX_PACKET} of a packet; \
                 send several"
            )));
        }
        let lines = |reply: &[u8]| -> Result<Vec<Line>, Failure> {
            let commands = Operations::new(&request).with_reply(reply);
            let lines = commands.map(|command| command.map(|command| Line::of(&command)));
            lines.collect::<Result<_, _>>().map_err(mistake)
        };
        if self.dry_run {
            return self.print(context, &request, None, lines(&[])?);
        }
        let found = self.target.find(context)?;
        found.need_ethernet("a packet")?;
        // Before the question: fails if another program drives the board.
        drop(found.open()?);
        self.consent(context, &found, &lines(&[])?)?;
        let mut link = found.link()?;
        let mut buffer = [0; ROOM];
        link.send(&request)?;
        if expected == 0 {
            return self.print(context, &request, None, lines(&[])?);
        }
        let deadline = link.now().after(self.timeout);
        let Some(len) = receive(context, &mut link, &mut buffer, deadline)? else {
            if context.stop.signal().is_some() {
                return Ok(context.ending());
            }
            return Err(Failure::refused(format_args!(
                "{}: no reply within {}; the packet was lost, or the board restarts; what it writes \
                 may have been executed, so read it back before you send it again",
                found.address,
                Rounded(&self.timeout)
            )));
        };
        let reply = &buffer[..len];
        let ending = self.print(context, &request, Some(reply), lines(reply)?)?;
        if len != expected {
            return Err(Failure::refused(format_args!(
                "the reply has {}, expected {expected}; `mesa info` shows the errors that the board \
                 has counted",
                Counted::of(len, "byte")
            )));
        }
        Ok(ending)
    }

    /// Asks whether the commands may be sent, if one of them writes.
    fn consent(&self, context: &Context, found: &Found, lines: &[Line]) -> Result<(), Failure> {
        let writes = lines.iter().filter(|line| line.command == "write");
        let writes: Vec<String> = writes.map(Line::place).collect();
        if writes.is_empty() {
            return Ok(());
        }
        let action = format_args!("write {}", writes.join(", "));
        let plan = Plan::at(found.address, action);
        self.asks.consent_to_change(context, &plan, Some(found))
    }

    fn print(
        &self,
        context: &Context,
        request: &[u8],
        reply: Option<&[u8]>,
        commands: Vec<Line>,
    ) -> Result<Ending, Failure> {
        context.print(&Dialogue {
            dry_run: self.dry_run,
            request: hex(request),
            received: reply.map(hex),
            commands,
        })?;
        Ok(context.ending())
    }

    /// Parses the bytes of the packet.
    fn request(&self) -> Result<Vec<u8>, Failure> {
        let all = self.hex.concat();
        let digits = all.chars().filter(|digit| !digit.is_whitespace());
        let digits = digits.map(|digit| {
            let value = digit
                .to_digit(16)
                .and_then(|value| u8::try_from(value).ok());
            value.ok_or_else(|| {
                Failure::usage(format_args!("HEX: `{digit}` is no hexadecimal digit"))
            })
        });
        let digits = digits.collect::<Result<Vec<u8>, Failure>>()?;
        let (bytes, half) = digits.as_chunks::<2>();
        if !half.is_empty() {
            return Err(Failure::usage(
                "HEX: an odd number of digits; a byte has two",
            ));
        }
        if bytes.is_empty() || bytes.len() > MAX_PACKET {
            return Err(Failure::usage(format_args!(
                "HEX: {} bytes; a packet has 1 to {MAX_PACKET}",
                bytes.len()
            )));
        }
        Ok(bytes.iter().map(|[high, low]| high << 4 | low).collect())
    }
}

/// Waits for a datagram; `None` after the deadline or a signal.
fn receive(
    context: &Context,
    link: &mut BoardLink,
    buffer: &mut [u8],
    deadline: mesa_hal::bus::Instant,
) -> Result<Option<usize>, Failure> {
    const LOOK: Duration = Duration::from_millis(50);
    loop {
        let now = link.now();
        let left = deadline.since(now);
        let received = link.receive(buffer, now.after(left.min(LOOK)))?;
        if received.is_some() || left.is_zero() || context.stop.signal().is_some() {
            return Ok(received);
        }
    }
}

impl Line {
    fn of(answered: &Answered<'_>) -> Self {
        let command = answered.operation.command;
        Self {
            command: if command.write { "write" } else { "read" },
            space: command.space as u8,
            space_name: command.space.name(),
            info: command.info,
            address: answered.operation.address,
            bits: 8 * command.size.bytes(),
            count: command.count,
            increment: command.increment,
            values: answered.elements().collect(),
        }
    }

    fn place(&self) -> String {
        let info = if self.info { "info area of " } else { "" };
        let address = match self.address {
            Some(address) => format!("0x{address:04X}"),
            None => "its pointer".to_owned(),
        };
        let stands = if self.increment { "" } else { " (one place)" };
        format!(
            "{} x {} bits, {info}space {} ({}) at {address}{stands}",
            self.count, self.bits, self.space, self.space_name
        )
    }
}

impl Display for Dialogue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let word = if self.dry_run { "not sent" } else { "sent" };
        writeln!(f, "{word:<9} {}", self.request)?;
        match &self.received {
            Some(received) => writeln!(f, "received  {received}")?,
            None if self.dry_run => {}
            None => writeln!(f, "received  nothing")?,
        }
        for line in &self.commands {
            write!(f, "{:<5} {}", line.command, line.place())?;
            for (index, value) in line.values.iter().enumerate() {
                let before = if index == 0 { ":" } else { "" };
                write!(f, "{before} 0x{value:0width$X}", width = line.bits / 4)?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

fn parse_seconds(text: &str) -> Result<Duration, String> {
    let seconds = text.parse().ok();
    let seconds = seconds.filter(|seconds| (0.001..=LONGEST).contains(seconds));
    let seconds = seconds.ok_or_else(|| format!("`{text}` is no number from 0.001 to {LONGEST}"));
    seconds.map(Duration::from_secs_f64)
}
